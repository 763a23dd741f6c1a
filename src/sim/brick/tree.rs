//! Where a brick's devices are in its tree: `sys/class` with links, `sys/devices` with the folders,
//! `dev`.
//!
//! The folders are those of ev3dev's stretch: a port below the platform device `ev3-ports`, below
//! the port what is plugged into it, a device of the bus `lego`, and below that the device of a
//! class.
//!
//! # Not here
//!
//! `sys/bus/iio`, other buses, modules and firmware: nothing that we have read says what is in them
//! on a brick. The terminal (`tty`) that a serial sensor hangs below on a brick.

use nix::errno::Errno;

use super::{Brick, Class, Device, Node, UEVENT};
use crate::ev3dev::AttributeSpec;
use crate::sim::driver::bus::{BusDevice, POWER};
use crate::sim::driver::{Entry, EntryKind};

/// Where a robot truly is: no file of a real brick, and so outside the folders that programs look
/// into.
pub(crate) const TRUTH: &str = "sim/truth";

/// What is wrong on purpose: written to make it so.
pub(crate) const FAULTS: &str = "sim/faults";

/// What is to be done to the robot, and what was: faults, pressed buttons, a hand that carries it.
pub(crate) const ORDERS: &str = "sim/orders";

/// Folders whose entries are always the same.
const FIXED: &[(&str, &[&str])] = &[
    ("", &["dev", "sim", "sys"]),
    ("dev", &["input"]),
    ("dev/input", &["by-path"]),
    ("dev/input/by-path", &[]),
    ("sim", &[]),
    ("sys", &["bus", "class", "devices"]),
    ("sys/bus", &["lego"]),
    ("sys/bus/lego", &["devices", "drivers"]),
];

/// Where the devices of the bus are listed, and its drivers, each with those that are bound to it.
const BUS_DEVICES: &str = "sys/bus/lego/devices";
const BUS_DRIVERS: &str = "sys/bus/lego/drivers/";

impl Brick {
    /// The entries of any folder as `lstat` shows them, sorted by name. A path may go through the
    /// links of `sys/class`.
    ///
    /// # Errors
    ///
    /// ENOENT where there is no such folder.
    pub(crate) fn list(&self, folder: &str) -> Result<Vec<Entry>, Errno> {
        let mut entries = if let Some((_, folders)) = FIXED.iter().find(|(path, _)| *path == folder)
        {
            let files = self
                .files()
                .filter_map(|path| path.rsplit_once('/').filter(|(parent, _)| *parent == folder));
            let files = files.map(|(_, name)| self.other_file(name));
            folders.iter().map(|name| Entry::folder(name)).chain(files).collect()
        } else if folder == "sys/class" {
            Class::in_sys_class().map(|class| Entry::folder(class.as_str())).collect()
        } else if folder == BUS_DEVICES {
            self.names(Class::LegoBus).map(Entry::link).collect()
        } else if folder == BUS_DRIVERS.trim_end_matches('/') {
            BusDevice::drivers(self.board).map(Entry::folder).collect()
        } else if let Some(driver) = folder.strip_prefix(BUS_DRIVERS) {
            if !BusDevice::drivers(self.board).any(|known| known == driver) {
                return Err(Errno::ENOENT);
            }
            let bound = self.nodes.iter().filter(
                |node| matches!(&node.device, Device::Bus(device) if device.driver == driver),
            );
            bound.map(|node| Entry::link(&node.name)).collect()
        } else if let Some(entries) =
            self.locate(folder).and_then(|(id, rest)| self.entries(id, rest).ok())
        {
            entries
        } else if let Some(class) = folder.strip_prefix("sys/class/") {
            let class =
                Class::in_sys_class().find(|known| known.as_str() == class).ok_or(Errno::ENOENT)?;
            self.names(class).map(Entry::link).collect()
        } else {
            self.folders_between(folder.strip_prefix("sys/").ok_or(Errno::ENOENT)?)?
        };
        entries.sort_by(|one, other| one.name.cmp(&other.name));
        Ok(entries)
    }

    /// The files outside `sys` that this board has.
    fn files(&self) -> impl Iterator<Item = &'static str> {
        let platform = self.board.platform;
        let screen = platform.screen.as_ref().ok().map(|screen| screen.device);
        let built_in = [platform.buttons, platform.speaker, screen];
        built_in.into_iter().flatten().chain([TRUTH, FAULTS, ORDERS])
    }

    /// One entry, as `lstat` shows it.
    ///
    /// # Errors
    ///
    /// ENOENT where there is none.
    pub(crate) fn entry(&self, path: &str) -> Result<Entry, Errno> {
        if path.is_empty() {
            return Ok(Entry::folder(""));
        }
        let (folder, name) = path.rsplit_once('/').unwrap_or(("", path));
        self.list(folder)?.into_iter().find(|entry| entry.name == name).ok_or(Errno::ENOENT)
    }

    /// Where a link points to, relative to its folder.
    ///
    /// # Errors
    ///
    /// ENOENT where there is none, EINVAL where there is something else.
    pub(crate) fn target(&self, path: &str) -> Result<String, Errno> {
        // From the folder that the link is in to `sys`.
        let up = "../".repeat(path.split('/').count().saturating_sub(2));
        if let Some(name) = path.strip_prefix("sys/bus/").and_then(|path| path.rsplit('/').next()) {
            let id = self.find(Class::LegoBus.as_str(), name).ok_or(Errno::EINVAL)?;
            return Ok(format!("{up}{}", self.folder(id).ok_or(Errno::ENOENT)?));
        }
        let (id, rest) = self.locate(path).ok_or(Errno::EINVAL)?;
        let folder = self.folder(id).ok_or(Errno::ENOENT)?;
        let node = self.node(id).ok_or(Errno::ENOENT)?;
        let bus_driver = match &node.device {
            Device::Bus(device) => Some(device.driver),
            _ => None,
        };
        match (rest, bus_driver) {
            ("subsystem", Some(_)) => Ok(format!("{up}bus/lego")),
            ("driver", Some(driver)) => Ok(format!("{up}bus/lego/drivers/{driver}")),
            ("", None) if path.starts_with("sys/class/") => Ok(format!("../../{folder}")),
            ("subsystem", None) => {
                let class = node.class.as_str();
                Ok(format!("{}class/{class}", "../".repeat(folder.split('/').count())))
            }
            // Above are the class's folder, and the device that it belongs to.
            ("device", None) => {
                Ok(format!("../../../{}", folder.rsplit('/').nth(2).unwrap_or_default()))
            }
            _ => Err(Errno::EINVAL),
        }
    }

    /// The device whose folder a path is, or goes into, and the rest of the path. Of two, the inner
    /// one.
    pub(crate) fn locate<'p>(&self, path: &'p str) -> Option<(u32, &'p str)> {
        if let Some(path) = path.strip_prefix("sys/class/") {
            let (class, path) = path.split_once('/')?;
            let (name, rest) = path.split_once('/').unwrap_or((path, ""));
            return Some((self.find(class, name)?, rest));
        }
        let path = path.strip_prefix("sys/")?;
        let inside = self.folders().filter_map(|(id, folder)| {
            let rest = path.strip_prefix(folder.as_str())?;
            if rest.is_empty() { Some((id, rest)) } else { Some((id, rest.strip_prefix('/')?)) }
        });
        inside.min_by_key(|(_, rest)| rest.len())
    }

    /// Folders on the way to those of devices.
    fn folders_between(&self, folder: &str) -> Result<Vec<Entry>, Errno> {
        let mut names: Vec<String> = self
            .folders()
            .filter_map(|(_, path)| {
                let rest = path.strip_prefix(folder)?.strip_prefix('/')?;
                Some(rest.split('/').next()?.to_owned())
            })
            .collect();
        names.sort();
        names.dedup();
        if names.is_empty() {
            return Err(Errno::ENOENT);
        }
        Ok(names.iter().map(|name| Entry::folder(name)).collect())
    }

    /// A file in `dev`, as long as the picture, or of no length; or the truth, which is read-only.
    fn other_file(&self, name: &str) -> Entry {
        let size = if name == "fb0" { self.lcd_bytes().len() } else { 0 };
        Entry {
            name: name.to_owned(),
            kind: EntryKind::File,
            permissions: if TRUTH.ends_with(name) { 0o444 } else { 0o660 },
            size: u64::try_from(size).unwrap_or_default(),
        }
    }

    /// The entries of a device's folder, or of a folder in it (`speed_pid`).
    ///
    /// # Errors
    ///
    /// ENOENT where there is no such folder.
    fn entries(&self, id: u32, folder: &str) -> Result<Vec<Entry>, Errno> {
        let driver = self.driver(id).ok_or(Errno::ENOENT)?;
        let file = |spec: &AttributeSpec| self.with_udev(id, Entry::file(spec));
        let inside = |spec: &AttributeSpec| spec.name.split_once('/');
        let specs = || driver.attributes().into_iter().flatten().chain(&POWER);
        if !folder.is_empty() {
            let files = specs().filter_map(|spec| match spec.name.split_once('/') {
                Some((parent, name)) if parent == folder => {
                    Some(Entry { name: name.to_owned(), ..file(spec) })
                }
                _ => None,
            });
            let entries: Vec<Entry> = files.collect();
            return if entries.is_empty() { Err(Errno::ENOENT) } else { Ok(entries) };
        }
        let mut entries: Vec<Entry> =
            specs().filter(|spec| inside(spec).is_none()).map(file).collect();
        let mut folders: Vec<&str> = specs().filter_map(inside).map(|(folder, _)| folder).collect();
        folders.dedup();
        entries.extend(folders.into_iter().map(Entry::folder));
        // What lies below it: on a port the device of the bus, on that the one of a class.
        entries.extend(
            self.folder(id)
                .and_then(|folder| self.folders_between(&folder).ok())
                .unwrap_or_default(),
        );
        let is_on_bus = self.node(id).is_some_and(|node| node.class == Class::LegoBus);
        let owner = if is_on_bus { "driver" } else { "device" };
        entries.extend([owner, "subsystem"].map(Entry::link));
        entries.push(file(&UEVENT));
        entries.sort_by(|one, other| one.name.cmp(&other.name));
        Ok(entries)
    }

    /// As udev's rules leave it: in the classes that people use, the group `ev3dev` may do what the
    /// owner may.
    fn with_udev(&self, id: u32, entry: Entry) -> Entry {
        let class = self.node(id).map(|node| node.class);
        let untouched = [Class::BoardInfo, Class::Graphics, Class::PowerSupply].map(Some);
        if !self.options.udev || untouched.contains(&class) {
            return entry;
        }
        Entry { permissions: entry.permissions | ((entry.permissions & 0o600) >> 3), ..entry }
    }

    /// Every device, with its folder below `sys`.
    fn folders(&self) -> impl Iterator<Item = (u32, String)> {
        self.nodes.iter().filter_map(|node| Some((node.id, self.folder(node.id)?)))
    }

    /// A device's own folder below `sys`, to which its class has a link.
    fn folder(&self, id: u32) -> Option<String> {
        let node = self.node(id)?;
        let parent = match (&node.device, node.port) {
            (Device::Port(port), _) if self.board.nested => {
                format!("{}/{}", self.board.parent, self.board.address(*port))
            }
            (Device::Port(_), _) => self.board.parent.to_owned(),
            (Device::Bus(_), Some(port)) => {
                let is_port =
                    |node: &&Node| matches!(node.device, Device::Port(other) if other == port);
                let port = self.nodes.iter().find(is_port)?;
                return Some(format!("{}/{}", self.folder(port.id)?, node.name));
            }
            (_, Some(port)) => {
                let is_on_bus =
                    |node: &&Node| node.class == Class::LegoBus && node.port == Some(port);
                let on_bus = self.folder(self.nodes.iter().find(is_on_bus)?.id)?;
                return Some(format!("{on_bus}/{}/{}", node.class.as_str(), node.name));
            }
            (Device::Battery(_), _) => "platform/battery".to_owned(),
            (Device::Board(_), _) => "platform/board".to_owned(),
            (Device::Lcd(_), _) => "platform/display".to_owned(),
            (Device::Led(_), _) => "platform/leds".to_owned(),
            _ => "platform/servo-controller".to_owned(),
        };
        Some(format!("devices/{parent}/{}/{}", node.class.as_str(), node.name))
    }
}
