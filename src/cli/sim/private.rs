//! A private view of this machine in which a mounted simulated brick lies over its devices.
//!
//! Programs for ev3dev look for `/sys/class/…`, `/dev/input/…`, `/dev/fb0` and `/usr/bin/beep`,
//! wherever the brick is mounted. [`PrivateView::enter`] takes this process into a mount namespace
//! of its own, and puts the brick's files there; who it starts from then on takes this machine for
//! the brick, and nothing outside changes. Without root's rights that needs a user namespace, in
//! which the user stays who they are.
//!
//! | path | what lies there |
//! |---|---|
//! | `/sys` | the brick's |
//! | `/dev` | null, zero, full, random, urandom, tty, ptmx, pts, shm of the machine, and no more |
//! | `/dev/input` | the brick's buttons and speaker, also as event0 and event1 |
//! | `/dev/fb0` | a file of the screen's size, copied to the brick's by [`PrivateView::refresh`] |
//! | `/dev/console`, `/dev/tty0` to `tty6` | the terminal, or nothing: the machine's own console is not drawn on |
//! | `/usr/bin/beep`, `aplay`, `espeak`, `amixer` | stand-ins that sound on the brick (`stand_in`) |
//!
//! # Not here
//!
//! Other processes, network and users are the machine's. A frame buffer's ioctls are answered for
//! python alone (`sitecustomize.py`).

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, IsTerminal as _};
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::fs::{FileExt as _, PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};

use nix::errno::Errno;
use nix::fcntl::{OFlag, open};
use nix::mount::{MsFlags, mount};
use nix::sched::{CloneFlags, unshare};
use nix::sys::stat::Mode;
use nix::unistd::{getegid, geteuid};

use super::stand_in::STAND_INS;
use crate::document::if_there;

/// Of a mounted brick: what takes orders, and the screen.
const ORDERS: &str = "sim/orders";
const SCREEN: &str = "dev/fb0";

/// What is ours in the view: stand-ins, the pipe for their orders, what python needs.
const OURS: &str = "/dev/onbrick";

/// Where programs look for the stand-ins.
const PROGRAMS: &str = "/usr/bin";

/// What stays of the machine's `/dev`, where it is there.
const KEPT: [&str; 9] = ["null", "zero", "full", "random", "urandom", "tty", "ptmx", "pts", "shm"];

/// Links that every `/dev` has.
const LINKS: [(&str, &str); 4] = [
    ("fd", "/proc/self/fd"),
    ("stdin", "/proc/self/fd/0"),
    ("stdout", "/proc/self/fd/1"),
    ("stderr", "/proc/self/fd/2"),
];

/// Consoles that a program may draw on.
const CONSOLES: [&str; 8] = ["console", "tty0", "tty1", "tty2", "tty3", "tty4", "tty5", "tty6"];

const SITE: &str = include_str!("sitecustomize.py");

/// Settings of the kernel that forbid an ordinary user a view of their own, with the value that
/// does and one that does not.
const BARRIERS: [[&str; 3]; 3] = [
    ["kernel.apparmor_restrict_unprivileged_userns", "1", "0"],
    ["kernel.unprivileged_userns_clone", "0", "1"],
    ["user.max_user_namespaces", "0", "10000"],
];

/// Why there is no view.
#[derive(Debug, thiserror::Error)]
pub(super) enum PrivateError {
    /// Mount one there first.
    #[error("there is no simulated brick mounted at {}", .0.display())]
    NoBrick(PathBuf),
    /// The machine lets only root have a mount namespace.
    #[error(
        "this machine lets an ordinary user have no private mounts{}",
        .setting.map(|[name, value, _]| format!(": {name} is {value}")).unwrap_or_default()
    )]
    Forbidden {
        /// The one of [`BARRIERS`] that forbids it, where one was found.
        setting: Option<[&'static str; 3]>,
        /// What the system said.
        source: io::Error,
    },
    /// Something else.
    #[error("{doing}")]
    Failed {
        /// What was being done.
        doing: String,
        /// What the system said.
        source: io::Error,
    },
}

impl PrivateError {
    /// The way out.
    pub(super) fn hint(&self) -> String {
        const AS_ROOT: &str = "mount the brick and run this as root";
        match self {
            Self::NoBrick(_) => "onbrick sim FOLDER, and then the same folder here".to_owned(),
            Self::Forbidden { setting: Some([name, _, allows]), .. } => {
                format!("sudo sysctl -w {name}={allows}, or {AS_ROOT}")
            }
            Self::Forbidden { setting: None, .. } => {
                format!(
                    "{AS_ROOT}; in a container: docker run --cap-add SYS_ADMIN --security-opt \
                     apparmor=unconfined"
                )
            }
            Self::Failed { .. } => AS_ROOT.to_owned(),
        }
    }
}

/// The view that this process is in.
#[derive(Debug)]
pub(super) struct PrivateView {
    /// The brick's screen and the view's; none where the board has none.
    screens: Option<[File; 2]>,
    shown: Vec<u8>,
    /// Stand-ins that are found by `PATH` alone, because nothing can be put into the machine's
    /// programs.
    pub(super) lacking: Vec<&'static str>,
}

/// A file or folder of the machine, kept while something else is put over its path.
struct Kept(OwnedFd);

impl Kept {
    fn new(path: &Path) -> io::Result<Self> {
        Ok(Self(open(path, OFlag::O_PATH | OFlag::O_CLOEXEC, Mode::empty())?))
    }

    /// Puts it at a path as well, which is made.
    fn bind(&self, target: &Path) -> io::Result<()> {
        let source = PathBuf::from(format!("/proc/self/fd/{}", self.0.as_raw_fd()));
        if fs::metadata(&source)?.is_dir() {
            fs::create_dir_all(target)?;
        } else if fs::symlink_metadata(target).is_err() {
            File::create(target)?;
        }
        Ok(mount(
            Some(&source),
            target,
            None::<&str>,
            MsFlags::MS_BIND | MsFlags::MS_REC,
            None::<&str>,
        )?)
    }
}

impl PrivateView {
    /// Takes this process, which must have one thread, into a view in which a mounted brick lies
    /// over the machine's devices; `program` is this program's file, for the stand-ins to start.
    ///
    /// # Errors
    ///
    /// [`PrivateError`]. The process may then be in a view that is not complete, and ends best.
    pub(super) fn enter(brick: &Path, program: &Path) -> Result<Self, PrivateError> {
        let no_brick = |_| PrivateError::NoBrick(brick.to_owned());
        let brick = brick.canonicalize().map_err(no_brick)?;
        if !brick.join(ORDERS).exists() {
            return Err(PrivateError::NoBrick(brick));
        }
        let failed = |doing: &str| {
            let doing = format!("cannot {doing}");
            move |source: io::Error| PrivateError::Failed { doing, source }
        };
        let opened = File::options().read(true).write(true).open(brick.join(SCREEN));
        let brick_screen = if_there(opened).map_err(failed("open the brick's screen"))?;
        let inputs = brick.join("dev/input/by-path");
        let mut events: Vec<OsString> = fs::read_dir(&inputs)
            .into_iter()
            .flatten()
            .filter_map(|entry| Some(entry.ok()?.file_name()))
            .collect();
        events.sort();
        become_private()?;
        // What was opened before belongs to the machine's own view, and can be put nowhere in this
        // one.
        let keep =
            |path: &Path| Kept::new(path).map_err(failed(&format!("open {}", path.display())));
        let [sys, sim] = ["sys", "sim"].map(|folder| keep(&brick.join(folder)));
        let (sys, sim) = (sys?, sim?);
        let input = inputs.exists().then(|| keep(&inputs)).transpose()?;
        let devices = Path::new("/dev");
        let machine: Vec<(&str, Kept)> = KEPT
            .into_iter()
            .filter_map(|name| Some((name, Kept::new(&devices.join(name)).ok()?)))
            .collect();
        let terminal = terminal().map(|path| keep(&path)).transpose()?;

        sys.bind(Path::new("/sys")).map_err(failed("put the brick's files at /sys"))?;
        let mut view = (|| {
            mount(Some("tmpfs"), devices, Some("tmpfs"), MsFlags::MS_NOSUID, Some("mode=755"))?;
            for (name, kept) in &machine {
                kept.bind(&devices.join(name))?;
            }
            for (name, target) in LINKS {
                symlink(target, devices.join(name))?;
            }
            let nothing = machine.iter().find(|(name, _)| *name == "null").map(|(_, kept)| kept);
            if let Some(console) = terminal.as_ref().or(nothing) {
                CONSOLES.into_iter().try_for_each(|name| console.bind(&devices.join(name)))?;
            }
            fs::create_dir(devices.join("input"))?;
            if let Some(input) = &input {
                input.bind(&devices.join("input/by-path"))?;
            }
            for (number, device) in events.iter().enumerate() {
                symlink(
                    Path::new("by-path").join(device),
                    devices.join(format!("input/event{number}")),
                )?;
            }
            sim.bind(&Path::new(OURS).join("sim"))?;
            let mut shown = Vec::new();
            let mut screens = None;
            if let Some(mut brick_screen) = brick_screen {
                io::Read::read_to_end(&mut brick_screen, &mut shown)?;
                fs::write(devices.join("fb0"), &shown)?;
                screens = Some([brick_screen, File::open(devices.join("fb0"))?]);
            }
            Ok(Self { screens, shown, lacking: Vec::new() })
        })()
        .map_err(failed("put the brick's files into /dev"))?;
        view.lacking = stand_ins(program).map_err(failed("make the stand-ins"))?;
        Ok(view)
    }

    /// Variables that who is started in the view gets: where the stand-ins are, and what python
    /// loads.
    pub(super) fn environment() -> Vec<(&'static str, OsString)> {
        [("PATH", "bin", "/usr/local/bin:/usr/bin:/bin"), ("PYTHONPATH", "python", "")]
            .map(|(name, folder, usual)| {
                let rest = std::env::var_os(name).unwrap_or_else(|| usual.into());
                let mut value = OsString::from(format!("{OURS}/{folder}"));
                if !rest.is_empty() {
                    value.push(":");
                    value.push(rest);
                }
                (name, value)
            })
            .into()
    }

    /// Brings what was drawn since the last time to the brick's screen. The EV3's own is refreshed
    /// 50 ms after something was drawn.
    ///
    /// # Errors
    ///
    /// The brick is gone.
    pub(super) fn refresh(&mut self) -> io::Result<()> {
        let Some([brick_screen, screen]) = &self.screens else { return Ok(()) };
        let mut drawn = vec![0; self.shown.len()];
        let length = screen.read_at(&mut drawn, 0)?;
        drawn.truncate(length);
        if self.shown.get(..length) != Some(drawn.as_slice()) {
            brick_screen.write_all_at(&drawn, 0)?;
            if let Some(shown) = self.shown.get_mut(..length) {
                shown.copy_from_slice(&drawn);
            }
        }
        Ok(())
    }
}

/// The terminal that this process talks to.
fn terminal() -> Option<PathBuf> {
    let streams =
        [io::stdin().is_terminal(), io::stdout().is_terminal(), io::stderr().is_terminal()];
    let number = streams.iter().position(|is_terminal| *is_terminal)?;
    fs::read_link(format!("/proc/self/fd/{number}")).ok()
}

/// A mount namespace of its own, from which nothing gets out; with a user namespace where that is
/// needed.
fn become_private() -> Result<(), PrivateError> {
    let (user, group) = (geteuid(), getegid());
    let enter = || -> io::Result<()> {
        match unshare(CloneFlags::CLONE_NEWNS) {
            Err(Errno::EPERM) => {
                unshare(CloneFlags::CLONE_NEWUSER | CloneFlags::CLONE_NEWNS)?;
                fs::write("/proc/self/setgroups", "deny")?;
                fs::write("/proc/self/uid_map", format!("{user} {user} 1"))?;
                fs::write("/proc/self/gid_map", format!("{group} {group} 1"))?;
            }
            other => other?,
        }
        Ok(mount(
            None::<&str>,
            "/",
            None::<&str>,
            MsFlags::MS_REC | MsFlags::MS_PRIVATE,
            None::<&str>,
        )?)
    };
    let forbids = |[name, value, _]: &[&str; 3]| {
        let path = format!("/proc/sys/{}", name.replace('.', "/"));
        fs::read_to_string(path).is_ok_and(|now| now.trim() == *value)
    };
    enter().map_err(|source| PrivateError::Forbidden {
        setting: BARRIERS.into_iter().find(forbids),
        source,
    })
}

/// Makes the stand-ins and puts them over the machine's programs; returns those for which that
/// cannot be done.
fn stand_ins(program: &Path) -> io::Result<Vec<&'static str>> {
    let folder = Path::new(OURS).join("bin");
    fs::create_dir_all(&folder)?;
    let parts: Vec<&[u8]> = program.as_os_str().as_bytes().split(|byte| *byte == b'\'').collect();
    let quoted = parts.join(&b"'\\''"[..]);
    for (name, _) in STAND_INS {
        let file = folder.join(name);
        let rest = format!("' sim stand-in {OURS} {name} \"$@\"\n");
        fs::write(&file, [b"#!/bin/sh\nexec '", quoted.as_slice(), rest.as_bytes()].concat())?;
        fs::set_permissions(&file, fs::Permissions::from_mode(0o755))?;
    }
    let python = Path::new(OURS).join("python");
    fs::create_dir_all(&python)?;
    fs::write(python.join("sitecustomize.py"), SITE)?;
    let layers = format!("lowerdir={}:{PROGRAMS}", folder.display());
    if mount(Some("overlay"), PROGRAMS, Some("overlay"), MsFlags::MS_RDONLY, Some(layers.as_str()))
        .is_ok()
    {
        return Ok(Vec::new());
    }
    // A file that is there can be covered by itself.
    let covered = |name: &&str| {
        let target = Path::new(PROGRAMS).join(name);
        target.exists() && Kept::new(&folder.join(name)).and_then(|kept| kept.bind(&target)).is_ok()
    };
    Ok(STAND_INS.map(|(name, _)| name).into_iter().filter(|name| !covered(name)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_setting_that_forbids_a_view_is_named_with_the_value_that_allows_it() {
        let said = |setting| {
            let error = PrivateError::Forbidden { setting, source: Errno::EPERM.into() };
            format!("{error}; {}", error.hint())
        };
        for (name, value, allows) in [
            ("kernel.apparmor_restrict_unprivileged_userns", "1", "=0,"),
            ("kernel.unprivileged_userns_clone", "0", "=1,"),
            ("user.max_user_namespaces", "0", "=10000,"),
        ] {
            let barrier = BARRIERS.into_iter().find(|barrier| barrier.starts_with(&[name, value]));
            let said = said(Some(barrier.unwrap()));
            let expected =
                [format!("{name} is {value};"), format!("sudo sysctl -w {name}{allows} or mount")];
            assert!(expected.iter().all(|part| said.contains(part)), "{said}");
        }
        assert!(said(None).contains("--cap-add SYS_ADMIN"), "{}", said(None));
    }
}
