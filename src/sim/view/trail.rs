//! What robots have driven and seen, gathered while time passes.

use std::collections::VecDeque;

use serde::{Serialize, Serializer};

use super::brick::sighted_m;
use crate::clock::MILLISECOND_NS;
use crate::sim::brick::Brick;
use crate::sim::world_physics::WorldPhysics;
use crate::units::rounded;

/// Robots are looked at this often: an ultrasonic sensor has a new value each 100 ms.
const LOOK_NS: i64 = 100 * MILLISECOND_NS;

/// A path's points are so far apart, metres.
const STEP_M: f64 = 0.01;

/// This many marks are kept; beyond that, the oldest go.
const MOST: usize = 50_000;

/// What a mark is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MarkKind {
    /// The robot was here.
    Path,
    /// Its sensor said that something is here.
    Echo,
}

/// A place that a robot has driven over or seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mark {
    /// Whose, from 0.
    pub robot: usize,
    /// What.
    pub kind: MarkKind,
    /// World frame, metres.
    pub x_m: f64,
    /// World frame, metres.
    pub y_m: f64,
}

impl Serialize for Mark {
    /// As a short list, because there are many: robot, 1 for an echo, x and y in whole millimetres.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let millimetres = |metres: f64| rounded(metres * 1000.0);
        let echo = u8::from(self.kind == MarkKind::Echo);
        (self.robot, echo, millimetres(self.x_m), millimetres(self.y_m)).serialize(serializer)
    }
}

/// Marks with their numbers.
#[derive(Debug, Default)]
pub(crate) struct Trail {
    marks: VecDeque<Mark>,
    /// The number of the next mark.
    next: u64,
    /// Each robot's last place on its path.
    last: Vec<Option<[f64; 2]>>,
}

impl Trail {
    /// Looks at the robots, if it is time to.
    pub(crate) fn step(&mut self, now_ns: i64, bricks: &[Brick], world: &WorldPhysics) {
        if now_ns % LOOK_NS != 0 {
            return;
        }
        self.last.resize(bricks.len(), None);
        for (robot, brick) in bricks.iter().enumerate() {
            let (Some(truth), Some((from, axis_rad, _))) = (world.truth(robot), world.sight(robot))
            else {
                continue;
            };
            self.path(robot, [truth.x_m, truth.y_m]);
            let devices = brick.device_views();
            if let Some(echo_m) = devices.iter().find_map(sighted_m).flatten() {
                let (sin, cos) = libm::sincos(axis_rad);
                let [x_m, y_m] = [from[0] + cos * echo_m, from[1] + sin * echo_m];
                self.push(Mark { robot, kind: MarkKind::Echo, x_m, y_m });
            }
        }
    }

    /// The marks from a number on that are still kept, and the number of the next one.
    pub(crate) fn since(&self, since: u64) -> (Vec<Mark>, u64) {
        let first = self.next - self.marks.len() as u64;
        let skipped = usize::try_from(since.saturating_sub(first)).unwrap_or(usize::MAX);
        (self.marks.iter().skip(skipped).copied().collect(), self.next)
    }

    fn path(&mut self, robot: usize, [x_m, y_m]: [f64; 2]) {
        let Some(last) = self.last.get_mut(robot) else { return };
        if last.is_none_or(|[x, y]| libm::hypot(x_m - x, y_m - y) >= STEP_M) {
            *last = Some([x_m, y_m]);
            self.push(Mark { robot, kind: MarkKind::Path, x_m, y_m });
        }
    }

    fn push(&mut self, mark: Mark) {
        if self.marks.len() >= MOST {
            self.marks.pop_front();
        }
        self.marks.push_back(mark);
        self.next += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_have_numbers_and_the_oldest_go() {
        let mut trail = Trail::default();
        let mark = |x: i32| Mark { robot: 0, kind: MarkKind::Echo, x_m: f64::from(x), y_m: 0.0 };
        assert_eq!(trail.since(0), (Vec::new(), 0));
        (0..3).for_each(|x| trail.push(mark(x)));
        assert_eq!(trail.since(2), (vec![mark(2)], 3));
        assert_eq!(trail.since(99), (Vec::new(), 3));
        (0..50_000).for_each(|x| trail.push(mark(x)));
        let (marks, next) = trail.since(1);
        assert_eq!((marks.len(), next), (MOST, 50_003));
        assert_eq!(serde_json::to_string(&mark(2)).unwrap(), "[0,1,2000,0]");
    }

    #[test]
    fn a_robot_that_stands_leaves_one_point() {
        let mut trail = Trail { last: vec![None], ..Trail::default() };
        for x_m in [0.0, 0.004, 0.008, 0.012, 0.013] {
            trail.path(0, [x_m, 0.0]);
        }
        assert_eq!(trail.since(0).1, 2);
    }
}
