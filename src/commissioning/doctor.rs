//! Every check before motion, as a report: what is in order, what is not, and what to do.
//!
//! A check is a function in a table; it looks at one thing and adds lines to the report. A failure
//! does not end the checks, so one report shows everything. Nothing moves: no motor gets a command,
//! and a sensor's mode is set only while no other program has the hardware.
//!
//! | what | where |
//! |---|---|
//! | `robot.toml`, devices on their ports, readings, gyro at rest | `roles` |
//! | brick, lock, battery, buttons, lights, speaker | `brick` |
//! | groups, disk, clock, real-time priority, missions | `machine` |
//!
//! # Not here
//!
//! No repair, and no motion: whether wheels turn the right way is seen in `setup`.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use serde::Serialize;

use crate::clock::Clock;
use crate::ev3dev::{Platform, Tree};
use crate::robot::RobotConfig;

use crate::printable::with_causes;
use crate::runtime::{HardwareLock, Source, StopFlags};

mod brick;
mod machine;
mod roles;

/// What is examined.
#[derive(Debug)]
pub struct Patient<'p> {
    /// The brick's files.
    pub tree: &'p Arc<dyn Tree>,
    /// Its time.
    pub clock: &'p dyn Clock,
    /// Who asks to stop: the report then ends early and says so.
    pub flags: &'p StopFlags,
    /// The robot's file as it was read, or why it could not be, and what to do then.
    pub robot: Result<&'p Source, (&'p str, &'p str)>,
    /// The brick's root in the file system, which the hardware lock goes by; `None` for a brick
    /// inside this process.
    pub root: Option<&'p Path>,
    /// Where recordings go; looked at whether it is there or not.
    pub recordings: &'p Path,
    /// A folder of missions to check as well.
    pub missions: Option<&'p Path>,
    /// What the wall clock says, nanoseconds since 1970.
    pub wall_ns: i64,
}

/// How a check ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// In order.
    Ok,
    /// A run can go without it.
    Warning,
    /// A run will be refused, or will not be what it should.
    Failed,
}

impl fmt::Display for Verdict {
    /// The word that it is serialized by.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// One line of the report.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Checked {
    /// What was looked at.
    pub check: String,
    /// How it is.
    pub verdict: Verdict,
    /// What was seen.
    pub found: String,
    /// What to do, where something is to be done.
    pub to_do: Option<String>,
}

impl fmt::Display for Checked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<8} {:<14} {}", self.verdict, self.check, self.found)?;
        match &self.to_do {
            Some(to_do) => write!(f, " -> {to_do}"),
            None => Ok(()),
        }
    }
}

/// All lines.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct Diagnosis {
    /// In the order of the table.
    pub checks: Vec<Checked>,
}

impl Diagnosis {
    /// How many ended so.
    #[must_use]
    pub fn count(&self, verdict: Verdict) -> usize {
        self.checks.iter().filter(|checked| checked.verdict == verdict).count()
    }
}

/// The lines of one check.
struct Report<'d> {
    check: &'d str,
    diagnosis: &'d mut Diagnosis,
}

impl Report<'_> {
    /// The lines of another check.
    fn of<'d>(&'d mut self, check: &'d str) -> Report<'d> {
        Report { check, diagnosis: self.diagnosis }
    }

    fn add(&mut self, verdict: Verdict, found: impl Into<String>, to_do: Option<&str>) {
        let (check, to_do) = (self.check.to_owned(), to_do.map(str::to_owned));
        self.diagnosis.checks.push(Checked { check, verdict, found: found.into(), to_do });
    }

    fn ok(&mut self, found: impl Into<String>) {
        self.add(Verdict::Ok, found, None);
    }

    fn warn(&mut self, found: impl Into<String>, to_do: &str) {
        self.add(Verdict::Warning, found, Some(to_do));
    }

    fn fail(&mut self, found: impl Into<String>, to_do: &str) {
        self.add(Verdict::Failed, found, Some(to_do));
    }
}

/// What checks know of each other.
#[derive(Debug)]
struct Examination<'p> {
    patient: &'p Patient<'p>,
    platform: &'static Platform,
    config: Option<RobotConfig>,
    /// There is a brick to look at.
    has_brick: bool,
    /// No other program drives: sensors may be put into their modes.
    is_free: bool,
    _lock: Option<HardwareLock>,
}

type Check = fn(&mut Examination<'_>, &mut Report<'_>);

/// What a check looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Of {
    /// The brick: there is nothing to look at where there is none.
    Brick,
    /// Files and this machine.
    Machine,
}

/// Each with its name in the report. The order is that in which a person puts things right: the
/// file, the brick, the devices, then what a run needs besides.
const CHECKS: &[(Of, &str, Check)] = &[
    (Of::Machine, "robot.toml", roles::file),
    (Of::Machine, "brick", brick::tree),
    (Of::Brick, "lock", brick::lock),
    (Of::Brick, "groups", machine::groups),
    (Of::Brick, "motors", roles::motors),
    (Of::Brick, "sensors", roles::sensors),
    (Of::Brick, "battery", brick::battery),
    (Of::Brick, "buttons", brick::buttons),
    (Of::Brick, "lights", brick::lights),
    (Of::Brick, "speaker", brick::speaker),
    (Of::Machine, "disk", machine::disk),
    (Of::Machine, "clock", machine::clock),
    (Of::Machine, "priority", machine::priority),
    (Of::Machine, "missions", machine::missions),
];

/// Looks at everything, in about two seconds. Nothing moves.
#[must_use]
pub fn examine(patient: &Patient<'_>) -> Diagnosis {
    let mut examination = Examination {
        patient,
        platform: Platform::of(patient.tree),
        config: None,
        has_brick: true,
        is_free: false,
        _lock: None,
    };
    let mut diagnosis = Diagnosis::default();
    for (of, name, check) in CHECKS {
        if *of == Of::Brick && !examination.has_brick {
            continue;
        }
        let mut report = Report { check: name, diagnosis: &mut diagnosis };
        if patient.flags.is_raised() {
            report.of("doctor").fail("stopped before the end", "start it again for the rest");
            break;
        }
        check(&mut examination, &mut report);
    }
    diagnosis
}
