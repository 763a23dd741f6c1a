//! Finding devices: by port, by driver, or because there is only one.
//!
//! A device's number (`motor0`) only ever grows and says nothing; what identifies it is its
//! address, with its driver's name.

use std::sync::Arc;

use nix::errno::Errno;

use super::address::PortAddress;
use super::error::{DeviceError, FindError};
use super::node::{Attribute, AttributeSpec, Node};
use super::tree::Tree;
use super::value::{Legal, Value, Word};
use super::words::{Driver, words};

words! {
    /// A class of devices that have an address and a driver: a folder below `sys/class`.
    Class {
        /// Motors with a position.
        TachoMotor = "tacho-motor",
        /// Motors without one.
        DcMotor = "dc-motor",
        /// Servos.
        ServoMotor = "servo-motor",
        /// Sensors.
        LegoSensor = "lego-sensor",
        /// The ports themselves.
        LegoPort = "lego-port",
    }
}

/// What identifies a device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// Its class.
    pub class: Class,
    /// Its folder in the class, valid until it is replugged: `motor0`.
    pub name: String,
    /// Where it is plugged in.
    pub address: PortAddress,
    /// What it is: `lego-ev3-l-motor`.
    pub driver: Word,
}

impl Identity {
    /// The driver, if this program knows it by name.
    #[must_use]
    pub fn known_driver(&self) -> Option<Driver> {
        Driver::parse(self.driver.as_bytes())
    }

    /// Whether it is a linear actuator: the class of motors names those `linearN` and all others
    /// `motorN` (`tacho_motor_class.c`).
    #[must_use]
    pub fn is_linear(&self) -> bool {
        self.name.starts_with("linear")
    }

    /// The folder of its attributes, below the tree's root.
    #[must_use]
    pub fn folder(&self) -> String {
        format!("sys/class/{}/{}", self.class, self.name)
    }

    pub(crate) fn node(&self, tree: &Arc<dyn Tree>) -> Node {
        Node::new(tree, &self.folder(), Some(self.address.clone()))
    }
}

/// The devices of a class, in the order in which they were plugged in; none where the class has no
/// folder.
///
/// # Errors
///
/// [`FindError::Unlisted`], and [`FindError::Device`] for one that is there and cannot be read. One
/// that is pulled while we look is left out.
pub fn devices(tree: &Arc<dyn Tree>, class: Class) -> Result<Vec<Identity>, FindError> {
    let folder = format!("sys/class/{class}");
    let names = match tree.list(&folder) {
        Ok(names) => names,
        Err(Errno::ENOENT) => Vec::new(),
        Err(errno) => return Err(FindError::Unlisted { folder, errno }),
    };
    let mut found = Vec::new();
    for name in names {
        match identity(tree, class, name) {
            Ok(identity) => found.push(identity),
            Err(error) if error.is_gone() => {}
            Err(error) => return Err(error.into()),
        }
    }
    found.sort_by(|a, b| (number(&a.name), &a.name).cmp(&(number(&b.name), &b.name)));
    Ok(found)
}

/// The one device of a class that is at `port`, if given, and has the driver `driver`, if given.
///
/// # Errors
///
/// [`FindError`], which says what there is instead.
pub fn find(
    tree: &Arc<dyn Tree>,
    class: Class,
    port: Option<&PortAddress>,
    driver: Option<&str>,
) -> Result<Identity, FindError> {
    let fits = |identity: &Identity| driver.is_none_or(|driver| identity.driver.as_str() == driver);
    find_where(tree, class, port, driver.unwrap_or(class.as_str()), fits)
}

/// The one device that is at `port`, if given, and of which `fits` is true; `what` it is called in
/// messages.
pub(crate) fn find_where(
    tree: &Arc<dyn Tree>,
    class: Class,
    port: Option<&PortAddress>,
    what: &str,
    fits: impl Fn(&Identity) -> bool,
) -> Result<Identity, FindError> {
    let there = devices(tree, class)?;
    let at_port = |identity: &&Identity| port.is_none_or(|port| port.fits(&identity.address));
    let fitting: Vec<&Identity> =
        there.iter().filter(at_port).filter(|identity| fits(identity)).collect();
    let wanted = || port.map_or_else(|| what.to_owned(), |port| format!("{what} on {port}"));
    match fitting.as_slice() {
        [one] => Ok((*one).clone()),
        [] => match port.and_then(|_| there.iter().find(at_port).cloned()) {
            Some(found) => {
                Err(FindError::Other { wanted: wanted(), found: Box::new(found), there })
            }
            None => Err(FindError::Nothing { wanted: wanted(), there }),
        },
        several => Err(FindError::Several {
            wanted: wanted(),
            fitting: several.iter().copied().cloned().collect(),
        }),
    }
}

fn identity(tree: &Arc<dyn Tree>, class: Class, name: String) -> Result<Identity, DeviceError> {
    let node = Node::new(tree, &format!("sys/class/{class}/{name}"), None);
    let text = |name| AttributeSpec::readable(name, Legal::Text);
    let address = Attribute::<PortAddress>::new(text("address")).read(&node)?;
    let driver = Attribute::<Word>::new(text("driver_name")).read(&node)?;
    Ok(Identity { class, name, address, driver })
}

/// The number at a name's end: motor10 comes after motor9.
fn number(name: &str) -> Option<u32> {
    name.trim_start_matches(|c: char| !c.is_ascii_digit()).parse().ok()
}
