//! From soundings to places: sweeps into feet, feet into landmarks, echoes onto what they are of.
//!
//! An echo waits until its valley is over ([`Sweep`]). With a foot, it lies on what the foot is of:
//! on the tangent, on the wall that the tangent is of, or at the point. Without one it lies where
//! the slope of the ranges says (`bearing`). What the pose was corrected by moves the echoes that
//! wait.
//!
//! A tangent says nothing of where the surface ends: it is extended by [`EXTENT_M`], and as far as
//! the other feet of its wall reach.
//!
//! # What was tried
//!
//! - Tangents that reach 6 cm, and echoes that are beside the foot only from where their range is
//!   beyond the noise: of pillars' points 84 % within 5 cm of a wall for 80 (16 explorations), of
//!   real scans' 76 for 75. But in the real scans 66 % of the wall has a point for 72 (team 1), and
//!   69 % of the walls found are right for 78.
//! - A foot for regions with one end only: half a cone, and what the noise hides, from that end.
//!   Its tangent reaching 20 cm, 0.7 % more of an exploration's points are within 5 cm (320 runs),
//!   and 77 % of real scans' for 75; 1.2 % less wall has a point.
//! - Leaving out what is heard over less than the beam between something nearer and something
//!   farther, or nothing: of real scans' points 76 % within 5 cm for 75, the tenth that is worst
//!   from 9.0 cm for 9.5; 0.4 % more of an exploration's points (96 runs). But a lone wrong reading
//!   is such a neighbour, too: with crosstalk of 10 % between two robots 87 % of the wall has a
//!   point, too little for `figures::together`. Counting a neighbour only when a second reading
//!   agrees keeps the gain in the real scans, but 1 to 7 % less of an explored room's wall has a
//!   point (4 rooms, 40 runs each).
//! - Taking a lone reading that jumps for a whim, as a lone missing echo is, inside its
//!   valley. Nothing for explorations, 0.6 % fewer of the real scans' points are within 5 cm.

use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};

use super::filter::Filter;
use super::keyframes::{Keyframe, KeyframeList, Keyframes};
use super::landmarks::{Kind, Landmarks, Sighting};
use super::pose::Correction;
use super::range::Beam;
use super::sweep::{Echo, Foot, Sweep, Valley};
use super::{MapPoint, Placed, Pose, Range};
use crate::units::{within, wrap_rad};

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
    pub landmarks: Landmarks,
    keyframes: Keyframes,
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

impl Survey {
    pub(super) fn new(pose: Pose, gyro_scale_sd: f64) -> Self {
        Self { landmarks: Landmarks::new(pose, gyro_scale_sd), ..Self::default() }
    }

    pub(super) fn pose(&self) -> Pose {
        self.landmarks.filter.pose
    }

    /// Keeps the pose of now, if it is time for it.
    pub(super) fn keep_pose(&mut self, time_ns: i64) {
        if let Some(slot) = self.keyframes.slot(time_ns, self.pose()) {
            self.landmarks.filter.keep_pose(slot);
        }
    }

    /// The poses that were kept, by time, and that of now.
    pub(super) fn keyframes(&self, now_ns: i64) -> KeyframeList {
        let kept = self.keyframes.by_time().into_iter().map(|(slot, (time_ns, placed))| Keyframe {
            time_ns,
            placed,
            now: self.landmarks.filter.kept_pose(slot),
        });
        let now = Keyframe { time_ns: now_ns, placed: self.pose(), now: self.pose() };
        kept.chain([now]).collect()
    }

    /// Follows what is found out about the gyro.
    pub(super) fn correct(&mut self, change: impl FnOnce(&mut Filter)) -> Correction {
        let from = self.pose();
        change(&mut self.landmarks.filter);
        let correction = Correction { from, to: self.pose() };
        self.sweep.correct(&correction);
        correction
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
            self.sweep.correct(&correction);
            valley.correct(&correction);
        }
        self.place(&valley, sighting, heard.max_m);
        moved.then_some(correction)
    }

    fn place(&mut self, valley: &Valley, sighting: Option<Sighting>, max_m: f64) {
        if valley.stray {
            return;
        }
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
                let within_m = within(by_bearing_m, from_m + along_m, to_m + along_m);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::Geometry;
    use crate::units::radians;

    const STEP_NS: i64 = 50_000_000;

    /// A sweep from −80° to 80° past a wall 0.8 m ahead.
    fn sweep(survey: &mut Survey) -> usize {
        let mut echoes = 0;
        for step in 0..40_i32 {
            let bearing_rad = radians(4.3 * f64::from(step) - 84.0);
            let (sin, cos) = libm::sincos(bearing_rad);
            let nearest_rad = (bearing_rad.abs() - radians(14.0)).max(0.0);
            let range = if nearest_rad > radians(32.0) {
                Range::NoEcho
            } else {
                echoes += 1;
                Range::Echo(0.8 / libm::cos(nearest_rad))
            };
            survey.take(&Heard {
                time_ns: i64::from(step) * STEP_NS,
                beam: &Beam { x_m: 0.0, y_m: 0.0, cos, sin },
                bearing_rad,
                range,
                half_cone_rad: radians(14.0),
                max_m: 2.0,
                corrects: true,
            });
        }
        echoes
    }

    #[test]
    fn the_echoes_of_a_wall_lie_on_it_and_come_a_few_at_a_time() {
        let mut survey = Survey::new(Pose::default(), Geometry::GYRO_SCALE_SD);
        let echoes = sweep(&mut survey);
        let mut points = Vec::new();
        loop {
            let placed = survey.placed();
            if placed.is_empty() {
                break;
            }
            points.extend(placed.iter().copied());
        }
        assert!(survey.finish(2.0).is_empty(), "the sweep was over");
        assert_eq!(points.len(), echoes);
        for point in &points {
            assert!((point.x_m - 0.8).abs() < 0.01, "{point:?}");
        }
        let across_m = points.iter().map(|point| point.y_m.abs()).fold(0.0, f64::max);
        assert!((0.1..0.6).contains(&across_m), "from -{across_m} to {across_m} m");
    }

    #[test]
    fn what_waits_at_the_end_is_handed_out_and_what_is_too_far_is_not() {
        let mut survey = Survey::new(Pose::default(), Geometry::GYRO_SCALE_SD);
        for step in 0..5_i32 {
            let bearing_rad = radians(4.3 * f64::from(step));
            let (sin, cos) = libm::sincos(bearing_rad);
            survey.take(&Heard {
                time_ns: i64::from(step) * STEP_NS,
                beam: &Beam { x_m: 0.0, y_m: 0.0, cos, sin },
                bearing_rad,
                range: Range::Echo(if step < 3 { 0.8 } else { 0.81 }),
                half_cone_rad: radians(14.0),
                max_m: 0.805,
                corrects: true,
            });
        }
        assert!(survey.placed().is_empty(), "the sweep is not over");
        assert_eq!(survey.finish(0.805).len(), 3);
    }

    #[test]
    fn a_known_point_draws_its_echoes_to_itself_and_a_known_wall_lets_them_lie_along_it() {
        let echo = |bearing_deg: f64, range_m: f64| Echo {
            bearing_rad: radians(bearing_deg),
            range_m,
            ..Echo::default()
        };
        let point = Surface::Point([1.0, 0.0]);
        for bearing_deg in [-14.0, 0.0, 10.0] {
            let [x_m, y_m] = point.place(&echo(bearing_deg, 0.99));
            assert!((x_m - 0.99).abs() < 1e-9 && y_m.abs() < 1e-9, "{x_m}, {y_m}");
        }
        let wall = |reach_m: f64| Surface::Wall {
            place: [1.0, 0.0],
            direction_rad: 0.0,
            from_m: -reach_m,
            to_m: reach_m,
        };
        let [x_m, short_m] = wall(0.1).place(&echo(20.0, 1.0));
        let [_, long_m] = wall(1.0).place(&echo(20.0, 1.0));
        assert!((x_m - 1.0).abs() < 1e-9 && (short_m - 0.1).abs() < 1e-9, "{x_m}, {short_m}");
        assert!((long_m - libm::tan(radians(20.0))).abs() < 1e-9, "{long_m}");
        // A range that is longer says how far beside the foot it is.
        let [_, by_range_m] = wall(0.1).place(&echo(20.0, 1.05));
        assert!((by_range_m - libm::sqrt(1.05 * 1.05 - 1.0)).abs() < 1e-9, "{by_range_m}");
    }
}
