//! What a run needs of the machine: permissions, disk, clock, priority; and whether its missions
//! are in order.

use std::path::Path;

use nix::sys::resource::{Resource, getrlimit};
use nix::unistd::{Gid, geteuid, getgroups};

use crate::behavior::Capabilities;
use crate::clock::{wrong_year, year};
use crate::document::{read_bounded, toml_files};

use super::{Examination, Report, Verdict, with_causes};
use crate::recording::free_bytes;
use crate::runtime::{Source, groups};

/// What gives access to what on ev3dev's images.
const GROUPS: [(&str, &str, Verdict); 3] = [
    ("ev3dev", "motors, sensors and lights", Verdict::Failed),
    ("input", "buttons and speaker", Verdict::Failed),
    ("video", "the screen", Verdict::Warning),
];

/// A recording of two minutes takes about 4 MB; with less than this a run would soon end.
const LEAST_BYTES: u64 = 20 << 20;

/// With less than this it is time to clear up.
const FEW_BYTES: u64 = 200 << 20;

pub(super) fn groups(examination: &mut Examination<'_>, report: &mut Report<'_>) {
    let is_this_machine =
        examination.patient.tree.local_path("").is_some_and(|path| path == Path::new("/"));
    if !is_this_machine {
        return report.ok("not needed: this brick is not the machine itself");
    }
    if geteuid().is_root() {
        return report.ok("root may do everything");
    }
    let mine: Vec<Gid> = getgroups().unwrap_or_default();
    let mut all = true;
    for (name, what, verdict) in GROUPS {
        let group = groups::number_of(name).ok().flatten();
        if !group.is_some_and(|group| mine.contains(&group)) {
            all = false;
            let to_do = format!("sudo usermod -aG {name} USER, then log in again");
            report.add(
                verdict,
                format!("you are not in the group {name}: no {what}"),
                Some(&to_do),
            );
        }
    }
    if all {
        report.ok("ev3dev, input and video");
    }
}

/// The folder itself, or the nearest of its parents that is there: a run makes the rest.
pub(super) fn disk(examination: &mut Examination<'_>, report: &mut Report<'_>) {
    let wanted = examination.patient.recordings;
    let here = Path::new(".");
    let folder = wanted
        .ancestors()
        .map(|folder| if folder.as_os_str().is_empty() { here } else { folder })
        .find(|folder| folder.exists())
        .unwrap_or(here);
    if let Err(error) = try_to_write(folder) {
        return report.fail(
            format!("recordings cannot be written to {}: {error}", wanted.display()),
            "another folder, or chown and chmod this one",
        );
    }
    let free = match free_bytes(folder) {
        Ok(free) => free,
        Err(errno) => {
            return report.warn(errno.to_string(), "look how full it is with df");
        }
    };
    let found = format!("{} MB free for recordings in {}", free >> 20, wanted.display());
    if free < LEAST_BYTES {
        report.fail(found, "delete runs that are fetched");
    } else if free < FEW_BYTES {
        report.warn(found, "delete runs that are fetched");
    } else {
        report.ok(found);
    }
}

/// Only writing shows whether one can write: a full disk and one that is mounted read-only have
/// fine permissions.
fn try_to_write(folder: &Path) -> std::io::Result<()> {
    let file = folder.join(format!(".onbrick-doctor-{}", nix::unistd::getpid()));
    let written = std::fs::write(&file, b"is there place?");
    let removed = std::fs::remove_file(&file);
    written.and(removed)
}

pub(super) fn clock(examination: &mut Examination<'_>, report: &mut Report<'_>) {
    let wall_ns = examination.patient.wall_ns;
    match wrong_year(wall_ns) {
        Some((found, way_out)) => report.warn(found, way_out),
        None => report.ok(format!("it is {}", year(wall_ns))),
    }
}

pub(super) fn priority(_examination: &mut Examination<'_>, report: &mut Report<'_>) {
    match getrlimit(Resource::RLIMIT_RTPRIO) {
        _ if geteuid().is_root() => report.ok("root may have real-time priority"),
        Ok((soft, _)) if soft > 0 => report.ok(format!("real-time priority up to {soft}")),
        Ok(_) => report.warn(
            "no real-time priority: ticks come late while the brick is busy",
            "a line `USER - rtprio 50` in /etc/security/limits.conf, then log in again",
        ),
        Err(errno) => report.warn(errno.to_string(), "a run goes without real-time priority"),
    }
}

pub(super) fn missions(examination: &mut Examination<'_>, report: &mut Report<'_>) {
    let Some(folder) = examination.patient.missions else { return };
    let capabilities = examination
        .config
        .as_ref()
        .map_or_else(Capabilities::all, crate::robot::RobotConfig::capabilities);
    let files = match toml_files(folder) {
        Ok(files) => files,
        Err(error) => {
            let found = format!("cannot look into {}: {error}", folder.display());
            return report.fail(found, "the folder with the mission files");
        }
    };
    if files.is_empty() {
        report.warn(format!("none in {}", folder.display()), "onbrick new mission FILE");
    }
    for file in files {
        mission(&file, &capabilities, &mut report.of("mission"));
    }
}

fn mission(file: &Path, capabilities: &Capabilities, report: &mut Report<'_>) {
    let name = file
        .file_name()
        .map_or_else(|| file.display().to_string(), |name| name.to_string_lossy().into_owned());
    let bytes = match read_bounded(file) {
        Ok(bytes) => bytes,
        Err(error) => {
            return report.fail(
                format!("{name}: {}", with_causes(&error)),
                "a mission is a file that you may read",
            );
        }
    };
    let source = Source::of(&name, &bytes).map(|source| source.with_submachines(file.parent()));
    match source.and_then(|source| source.mission(capabilities)) {
        Ok((mission, _)) => report.ok(format!("{name}: \"{}\" is in order", mission.name())),
        Err(findings) => {
            let first = findings.iter().next();
            let found = first.map_or_else(String::new, |first| {
                format!("line {}: {}", first.line, first.message)
            });
            let to_do =
                format!("onbrick check {} shows all {}", file.display(), findings.iter().count());
            report.fail(format!("{name} {found}"), &to_do);
        }
    }
}
