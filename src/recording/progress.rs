//! How a run is going, read from its recording while another process writes it: for a service that
//! finds a run and has no pipe to the process that drives.

use std::io;
use std::path::Path;

use super::about::{info, names};
use super::growing::GrowingFile;
use super::run::{RecordedPose, log_line, senses, transition, variables};
use super::status::{SAYS, Status};
use super::tick::Level;
use super::topic::Topic;
use super::walk::Found;
use super::{message, points};
use crate::behavior::{Capabilities, Mission};
use crate::senses::Channel;

/// A recording that is followed. It lags behind the run by a sync, a second as a rule.
#[derive(Debug)]
pub struct Progress {
    file: GrowingFile,
    heard: Heard,
}

/// What has been read of the recording so far.
#[derive(Debug, Default)]
pub(super) struct Heard {
    pub(super) status: Status,
    start_ns: i64,
    /// The run has begun to drive.
    pub(super) drives: bool,
}

impl Progress {
    /// Begins at a recording's beginning; nothing is read yet.
    ///
    /// # Errors
    ///
    /// The file cannot be opened.
    pub fn of(recording: &Path) -> io::Result<Self> {
        Ok(Self { file: GrowingFile::open(recording)?, heard: Heard::default() })
    }

    /// Reads on; how the run is going, where that is news.
    ///
    /// # Errors
    ///
    /// The file cannot be read.
    pub fn look(&mut self) -> io::Result<Option<Status>> {
        let before = self.heard.status.time_ns;
        let heard = &mut self.heard;
        self.file.look(&mut |found| {
            let _ = heard.take(&found);
        })?;
        let is_news = self.heard.drives && self.heard.status.time_ns != before;
        Ok(is_news.then(|| self.heard.status.clone()))
    }
}

impl Heard {
    /// `None` where that cannot be understood.
    pub(super) fn take(&mut self, found: &Found<'_>) -> Option<()> {
        let status = &mut self.status;
        match found {
            Found::Attachment { name, data, .. } if name == names::MISSION => {
                let (mission, _) = Mission::parse(name, data, &Capabilities::all()).ok()?;
                status.states =
                    super::names::machines(&mission).iter().map(Status::begins).collect();
            }
            Found::Metadata(metadata) if metadata.name == names::ABOUT => {
                self.start_ns = info(metadata).start_ns;
            }
            Found::Message { topic: Some(topic), data, .. } => match topic {
                Topic::Pose => {
                    let pose: RecordedPose = message::decode(data)?;
                    (status.tick, status.time_ns, status.pose) =
                        (pose.tick, pose.time_ns, pose.pose);
                    status.elapsed_ns = pose.time_ns.saturating_sub(self.start_ns);
                    (status.travelled_m, status.range) = (pose.travelled_m, pose.range);
                    self.drives = true;
                }
                Topic::Points => {
                    let count = points::points(&message::decode(data)?)?.len();
                    status.points = status.points.saturating_add(u64::try_from(count).unwrap_or(0));
                }
                Topic::Senses => {
                    let battery = senses(&message::decode(data)?)?.get(Channel::Battery)?.value;
                    status.battery_v = Some(battery);
                }
                Topic::Transitions => {
                    let taken = transition(message::decode(data)?)?;
                    status.enter(taken.taken.machine, &taken.to);
                }
                Topic::Variables => {
                    let now = variables(message::decode(data)?)?;
                    status.variables = now.name.into_iter().zip(now.value).collect();
                }
                Topic::Log => {
                    let line = log_line(0, data)?;
                    if let Some(said) = line.text.strip_prefix(SAYS) {
                        status.said = said.split(" / ").map(str::to_owned).collect();
                    } else if line.level >= Level::Warn {
                        status.warning = Some(line.text);
                    }
                }
                Topic::Statistics => {
                    let statistics: message::TickStatistics = message::decode(data)?;
                    status.overruns =
                        status.overruns.saturating_add(u64::from(statistics.overruns));
                    status.latest_ns = status.latest_ns.max(statistics.lateness_max_ns);
                }
                _ => {}
            },
            _ => {}
        }
        Some(())
    }
}
