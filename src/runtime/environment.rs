//! Where a run happens: on a brick, on a mounted one, in a simulation.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::Heartbeat;
use crate::clock::{Clock, MonotonicClock};
use crate::ev3dev::{LocalTree, Tree};
use crate::mapping::Pose;
use crate::recording::{self, Pace, Sink};

/// Where a run happens: the robot's files, its time, and where its recording goes.
pub struct Environment {
    /// The robot's files.
    pub tree: Arc<dyn Tree>,
    /// What time it is.
    pub clock: Arc<dyn Clock>,
    /// Whether that is the time on the wall.
    pub pace: Pace,
    /// Wall clock minus run clock when the run begins, nanoseconds; `None` asks the clock then.
    pub wall_offset_ns: Option<i64>,
    /// Makes the recording, once the robot is ready.
    pub create: Box<CreateSink>,
    /// People are near: they are told by light and sound that the robot is about to move.
    pub announce: bool,
    /// What all chance of a simulation comes from.
    pub seed: Option<u64>,
    /// A simulation's world.
    pub world_toml: Option<String>,
    /// How things truly are, in a simulation.
    pub truth: Option<Arc<SeeTruth>>,
}

/// Makes the recording at a path.
pub type CreateSink = dyn Fn(&Path) -> io::Result<Box<dyn Sink>>;

/// Sees how things truly are; nothing where that is not known.
pub type SeeTruth = dyn Fn() -> Option<Truth> + Send + Sync;

/// How things truly are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Where the robot is in the world.
    pub pose: Pose,
    /// It drove over the edge of the floor.
    pub fallen: bool,
}

impl Environment {
    /// These files and this time, nothing simulated, the recording a file.
    #[must_use]
    pub fn new(tree: Arc<dyn Tree>, clock: Arc<dyn Clock>) -> Self {
        Self {
            tree,
            clock,
            pace: Pace::Real,
            wall_offset_ns: None,
            create: Box::new(|path| Ok(Box::new(recording::create(path)?))),
            announce: false,
            seed: None,
            world_toml: None,
            truth: None,
        }
    }

    /// A brick in this machine's files, in its time.
    #[must_use]
    pub fn local(tree: &LocalTree) -> Self {
        Self { announce: true, ..Self::new(Arc::new(tree.clone()), Arc::new(MonotonicClock)) }
    }

    pub(super) fn truth(&self) -> Option<Truth> {
        self.truth.as_ref().and_then(|see| see())
    }
}

crate::printable::debug_by!(Environment, pace);

/// Looks with each beat whether a simulated robot is still on the floor. A real one that falls has
/// ended its run.
pub(super) struct Floor<'h> {
    pub(super) truth: Option<Arc<SeeTruth>>,
    pub(super) fallen: Arc<AtomicBool>,
    pub(super) next: &'h mut dyn Heartbeat,
}

impl Heartbeat for Floor<'_> {
    fn beat(&mut self, now_ns: i64) {
        if self.truth.as_ref().and_then(|see| see()).is_some_and(|truth| truth.fallen) {
            self.fallen.store(true, Ordering::Relaxed);
        }
        self.next.beat(now_ns);
    }
}
