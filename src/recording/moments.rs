//! What happens in a run, read from its recording while another process writes it.
//!
//! # Not here
//!
//! How the run is going: [`super::Progress`].

use std::fmt;
use std::io;
use std::path::Path;

use serde::Serialize;

use super::about::{info, names};
use super::growing::GrowingFile;
use super::message;
use super::run::{LogLine, Transition, log_line, transition};
use super::status::SAYS;
use super::topic::Topic;
use super::walk::Found;
use crate::clock::seconds;

/// Something that happened in a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Moment {
    /// A machine went from a state to another.
    Transition(Transition),
    /// The mission said or showed something, or the runtime has something to say.
    Log(LogLine),
}

impl Moment {
    /// Whether it is what the mission says.
    #[must_use]
    pub fn is_said(&self) -> bool {
        matches!(self, Self::Log(line) if line.text.starts_with(SAYS))
    }
}

impl fmt::Display for Moment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let time_ns = match self {
            Self::Transition(transition) => transition.time_ns,
            Self::Log(line) => line.time_ns,
        };
        write!(f, "{:8.2} s  ", seconds(time_ns))?;
        match self {
            Self::Transition(Transition { machine, from, to, condition, .. }) => {
                // The runtime moves a machine only so.
                let why = if condition.is_empty() { "a wheel is blocked" } else { bare(condition) };
                write!(f, "{machine}: {from} -> {to}  ({why})")
            }
            Self::Log(line) => f.write_str(&line.text),
        }
    }
}

/// A condition without the parentheses around all of it.
fn bare(condition: &str) -> &str {
    let Some(inside) = condition.strip_prefix('(').and_then(|text| text.strip_suffix(')')) else {
        return condition;
    };
    // Whether the first one is closed by the last.
    let mut open = 0_i32;
    let is_one = inside.chars().all(|sign| {
        open += i32::from(sign == '(') - i32::from(sign == ')');
        open >= 0
    });
    if is_one { inside } else { condition }
}

/// A recording that is followed for what happens.
#[derive(Debug)]
pub struct Moments {
    file: GrowingFile,
    offset_ns: i64,
}

impl Moments {
    /// Begins at a recording's beginning; nothing is read yet.
    ///
    /// # Errors
    ///
    /// The file cannot be opened.
    pub fn of(recording: &Path) -> io::Result<Self> {
        Ok(Self { file: GrowingFile::open(recording)?, offset_ns: 0 })
    }

    /// Reads on to the end of what is there, and tells what has happened, in order.
    ///
    /// # Errors
    ///
    /// The file cannot be read.
    pub fn look(&mut self, tell: &mut dyn FnMut(&Moment)) -> io::Result<()> {
        let offset_ns = &mut self.offset_ns;
        while self.file.look(&mut |found| {
            if let Found::Metadata(metadata) = &found
                && metadata.name == names::ABOUT
            {
                *offset_ns = info(metadata).wall_offset_ns;
            }
            if let Some(moment) = moment(&found, *offset_ns) {
                tell(&moment);
            }
        })? {}
        Ok(())
    }
}

fn moment(found: &Found<'_>, offset_ns: i64) -> Option<Moment> {
    let Found::Message { topic: Some(topic), header, data } = found else { return None };
    match topic {
        Topic::Transitions => Some(Moment::Transition(transition(message::decode(data)?)?)),
        Topic::Log => {
            let stamp_ns = i64::try_from(header.log_time).unwrap_or(i64::MAX);
            let line = log_line(stamp_ns.saturating_sub(offset_ns), data)?;
            Some(Moment::Log(line))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::behavior::Taken;
    use crate::recording::Level;

    #[test]
    fn a_moment_is_a_line_with_its_time_and_why() {
        let mut transition = Transition {
            tick: 617,
            time_ns: 12_340_000_000,
            taken: Taken { machine: 0, from: 0, to: 1, transition: Some(0) },
            machine: "drive".to_owned(),
            from: "ahead".to_owned(),
            to: "turn".to_owned(),
            condition: "(range_m < (1 / 4))".to_owned(),
        };
        let shown = |transition: &Transition| Moment::Transition(transition.clone()).to_string();
        assert_eq!(shown(&transition), "   12.34 s  drive: ahead -> turn  (range_m < (1 / 4))");
        assert_eq!(bare("(a) and (b)"), "(a) and (b)");
        transition.condition.clear();
        assert_eq!(shown(&transition), "   12.34 s  drive: ahead -> turn  (a wheel is blocked)");
        let line = LogLine { time_ns: 0, level: Level::Info, text: "says: hello".to_owned() };
        assert_eq!(Moment::Log(line).to_string(), "    0.00 s  says: hello");
    }
}
