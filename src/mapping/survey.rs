//! From soundings to places: sweeps into feet, feet into landmarks, echoes onto what they are of.
//!
//! An echo waits until its valley is over ([`Sweep`]). With a foot, it lies on what the foot is of:
//! on the tangent, on the wall that the tangent is of, or at the point. Without one it lies where
//! the slope of the ranges says (`bearing`). What the pose was corrected by moves the echoes that
//! wait.
//!
//! A tangent says nothing of where the surface ends: it is extended by [`EXTENT_M`], and as far as
//! the other feet of its wall reach.

use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};

use super::filter::Step;
use super::landmarks::{Kind, Landmarks, Sighting};
use super::range::Beam;
use super::sweep::{Echo, Foot, Sweep, Valley};
use super::{MapPoint, Placed, Pose, Range};
use crate::units::wrap_rad;

/// Places that wait to be handed out.
const WAITING: usize = 256;
/// How far to each side of its foot a tangent is extended, metres, where nothing else is known.
const EXTENT_M: f64 = 0.1;
/// An echo is on a tangent within this of its foot, radians: 22°, and where its range says so 30°.
const ASIDE_RAD: f64 = 0.384;
const OBLIQUE_RAD: f64 = 0.524;

/// See the module.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Survey {
    sweep: Sweep,
    landmarks: Landmarks,
    waiting: ArrayVec<MapPoint, WAITING>,
}

/// A sounding as it comes to the survey.
#[derive(Debug, Clone, Copy)]
pub(super) struct Heard<'a> {
    pub time_ns: i64,
    pub beam: &'a Beam,
    /// The beam's direction without a wrap.
    pub bearing_rad: f64,
    pub range: Range,
    pub half_cone_rad: f64,
    /// From here on an echo is none of the map's.
    pub max_m: f64,
    /// Whether landmarks correct the pose.
    pub corrects: bool,
}

/// By how much the pose was corrected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Correction {
    pub from: Pose,
    pub to: Pose,
}

impl Correction {
    /// A place of the map as it was, in the map as it is.
    pub(super) fn place(&self, x_m: f64, y_m: f64) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.turn_rad());
        let (x_m, y_m) = (x_m - self.from.x_m, y_m - self.from.y_m);
        [self.to.x_m + cos * x_m - sin * y_m, self.to.y_m + sin * x_m + cos * y_m]
    }

    /// What undoes it, number by number.
    pub(super) fn back(&self) -> Pose {
        Pose {
            x_m: self.from.x_m - self.to.x_m,
            y_m: self.from.y_m - self.to.y_m,
            heading_rad: -self.turn_rad(),
        }
    }

    pub(super) fn turn_rad(&self) -> f64 {
        self.to.heading_rad - self.from.heading_rad
    }
}

impl Survey {
    pub(super) fn new(pose: Pose) -> Self {
        Self { landmarks: Landmarks::new(pose), ..Self::default() }
    }

    pub(super) fn pose(&self) -> Pose {
        self.landmarks.pose()
    }

    /// Covariance of the pose when it was last corrected: xx, xy, xh, yy, yh, hh.
    pub(super) fn covariance(&self) -> [f64; 6] {
        self.landmarks.covariance()
    }

    pub(super) fn step(&mut self, step: &Step) {
        self.landmarks.step(step);
    }

    /// Takes a sounding; returns how far off the axis its echo is as far as can be told at once,
    /// and by what a foot corrected the pose.
    pub(super) fn take(&mut self, heard: &Heard<'_>) -> (f64, Option<Correction>) {
        let (off_rad, over) = self.sweep.take(
            heard.time_ns,
            heard.beam,
            heard.bearing_rad,
            heard.range,
            heard.half_cone_rad,
        );
        let correction = over.and_then(|valley| self.survey(valley, heard));
        (off_rad, correction)
    }

    /// Ends the sweep; all places that wait.
    pub(super) fn finish(&mut self, max_m: f64) -> Vec<MapPoint> {
        if let Some(valley) = self.sweep.end(false) {
            self.place(&valley, None, max_m);
        }
        self.waiting.drain(..).collect()
    }

    /// The places that are due, a few at a time.
    pub(super) fn placed(&mut self) -> Placed {
        let count = self.waiting.len().min(Placed::MOST);
        self.waiting.drain(..count).collect()
    }

    fn survey(&mut self, mut valley: Valley, heard: &Heard<'_>) -> Option<Correction> {
        let from = self.pose();
        let sighting = valley
            .foot
            .filter(|_| heard.corrects)
            .and_then(|foot| self.landmarks.take(&foot, heard.time_ns));
        let correction = Correction { from, to: self.pose() };
        let moved = correction.from != correction.to;
        if moved {
            let turn_rad = correction.turn_rad();
            self.sweep.correct(|x_m, y_m| correction.place(x_m, y_m), turn_rad);
            for echo in &mut valley.echoes {
                [echo.x_m, echo.y_m] = correction.place(echo.x_m, echo.y_m);
                echo.bearing_rad += turn_rad;
            }
            if let Some(foot) = &mut valley.foot {
                [foot.x_m, foot.y_m] = correction.place(foot.x_m, foot.y_m);
                foot.bearing_rad += turn_rad;
            }
        }
        self.place(&valley, sighting, heard.max_m);
        moved.then_some(correction)
    }

    fn place(&mut self, valley: &Valley, sighting: Option<Sighting>, max_m: f64) {
        let surface = valley.foot.map(|foot| Surface::of(&foot, sighting));
        for echo in valley.echoes.iter().filter(|echo| echo.range_m < max_m) {
            let [x_m, y_m] = surface.map_or_else(|| echo.by_slope(), |surface| surface.place(echo));
            if self.waiting.is_full() {
                self.waiting.remove(0);
            }
            self.waiting.push(MapPoint { time_ns: echo.time_ns, x_m, y_m });
        }
    }
}

/// What the echoes of a valley are of.
#[derive(Debug, Clone, Copy)]
enum Surface {
    Point([f64; 2]),
    /// A place on it, its normal's direction, and how far from the place it reaches at least.
    Wall {
        place: [f64; 2],
        direction_rad: f64,
        from_m: f64,
        to_m: f64,
    },
}

impl Surface {
    fn of(foot: &Foot, sighting: Option<Sighting>) -> Self {
        let (sin, cos) = libm::sincos(foot.bearing_rad);
        let at = [foot.x_m + cos * foot.distance_m, foot.y_m + sin * foot.distance_m];
        match sighting.filter(|sighting| sighting.is_known) {
            Some(Sighting { kind: Kind::Point, place, .. }) => Self::Point(place),
            Some(Sighting { kind: Kind::Wall, place, direction_rad, from_m, to_m, .. }) => {
                Self::Wall {
                    place,
                    direction_rad,
                    from_m: from_m - EXTENT_M,
                    to_m: to_m + EXTENT_M,
                }
            }
            _ => Self::Wall {
                place: at,
                direction_rad: foot.bearing_rad,
                from_m: -EXTENT_M,
                to_m: EXTENT_M,
            },
        }
    }

    fn place(&self, echo: &Echo) -> [f64; 2] {
        match *self {
            Self::Point([x_m, y_m]) => {
                let to = [x_m - echo.x_m, y_m - echo.y_m];
                let share = echo.range_m / libm::hypot(to[0], to[1]).max(f64::MIN_POSITIVE);
                [echo.x_m + to[0] * share, echo.y_m + to[1] * share]
            }
            Self::Wall { place: [x_m, y_m], direction_rad, from_m, to_m } => {
                let (sin, cos) = libm::sincos(direction_rad);
                let to = [x_m - echo.x_m, y_m - echo.y_m];
                let distance_m = to[0] * cos + to[1] * sin;
                // From the foot of this echo's own sensor place to the wall's place.
                let along_m = to[1] * cos - to[0] * sin;
                let aside_rad = wrap_rad(echo.bearing_rad - direction_rad);
                let by_bearing_m = distance_m * libm::tan(aside_rad.clamp(-ASIDE_RAD, ASIDE_RAD));
                let within_m = by_bearing_m.clamp(from_m + along_m, to_m + along_m);
                // A range beyond the foot's is of a place beside it, as far as it says.
                let beyond_m2 = echo.range_m * echo.range_m - distance_m * distance_m;
                let by_range_m = libm::sqrt(beyond_m2.max(0.0))
                    .min(distance_m * libm::tan(OBLIQUE_RAD))
                    .copysign(aside_rad);
                let aside_m = if by_range_m.abs() > within_m.abs() { by_range_m } else { within_m };
                [
                    echo.x_m + cos * distance_m - sin * aside_m,
                    echo.y_m + sin * distance_m + cos * aside_m,
                ]
            }
        }
    }
}
