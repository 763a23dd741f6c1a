//! Landmarks: what the feet of sweeps are of, and what they say of the pose.
//!
//! A foot is of a *wall* if it moves along with the robot, and of a *point* - an edge, a post, a
//! corner into which the sound falls and comes back - if it stays where it is. From one place both
//! look alike, so a landmark begins as neither, and the feet seen from other places decide by what
//! each would have had to be (Leonard and Durrant-Whyte 1992; Tardós et al., *Robust mapping and
//! localization in indoor environments using sonar data*, 2002).
//!
//! A foot is of the landmark that it fits best, by the Mahalanobis distance of bearing and
//! distance. One that fits none is a new landmark; one that fits one badly is left out, because
//! either the landmark or the pose is wrong and it cannot be told which.
//!
//! Only walls correct the pose. The foot of a wall that stands near a corner or post may pass for
//! it, since a region's middle is off by 5° to 10° from where a surface stands square; taken for a
//! point it is then off by 20 cm, and the pose with it. Exploring with the usual errors, seeds 101
//! to 120, position of the robot over the run, root mean square, and points within 5 cm of a wall,
//! when a distance's deviation was 4 cm (`figures_of_explore` prints the points of other seeds;
//! nothing prints the position):
//!
//! | | rooms | a passage | arena | pillars | slanted blocks |
//! |---|---|---|---|---|---|
//! | points correct, too | 4.6 cm, 77 % | 2.2, 83 | 3.4, 82 | 5.5, 66 | 3.4, 84 |
//! | walls alone | 1.8 cm, 83 % | 1.8, 84 | 2.2, 86 | 2.6, 76 | 2.5, 86 |
//! | odometry alone | 10.6 cm | 6.4 | 5.3 | 5.1 | 4.9 |
//!
//! # What the deviations are good for
//!
//! The recordings of 170 explorations of such worlds and of drawn rooms, put through estimators
//! with other constants by [`replay_with`](crate::runtime::replay_with), so that nothing else
//! differs. In the last two columns are explorations of `rooms` and the mission `map` in `rooms`
//! and `arena`, which had a say in the last row alone; position over a run, root mean square:
//!
//! | | position | once off by 10 cm | points within 5 cm | `rooms` | `map` |
//! |---|---|---|---|---|---|
//! | distance ±4 cm, bearing ±7.5°, reach 30 cm, `SAME` 7, noise of the way all round | 2.84 cm | 22 | 88.6 % | 3.51 cm | 2.04 cm |
//! | distance ±1.5 cm | 2.41 | 15 | 89.1 | | |
//! | and bearing ±10°, doubt, noise along the way alone | 2.28 | 15 | 89.5 | | |
//! | and a reach of 60 cm, `SAME` 5 | 1.84 | 12 | 89.9 | 1.52 | 2.13 |
//! | and the distance's deviation by distance and width, `DECIDED` 4 for 6 | 1.88 | 12 | 90.2 | 1.50 | 2.07 |
//!
//! Feet are that far off: at 0.15 to 0.25 m eight of ten are within 0.5 cm of their median, at 1 to
//! 1.4 m within 2.3 cm, and there one in seven is off by more than 5 cm; of regions narrower than
//! 32° one in four. Without the doubt of large innovations a foot 12 cm behind its wall moved the
//! pose by as much.
//!
//! A replay favours whatever did not drive: the robot of the recording went on by its own errors.
//! So the doubt, and `SAME`, were judged over 332 explorations of 98 rooms that the true pose
//! drove, 450 s each; 42 of them in rooms whose walls have steps of 3 to 10 cm, the last column:
//!
//! | | position | once off by 10 cm | points within 5 cm | within 2.5 cm | with steps |
//! |---|---|---|---|---|---|
//! | a third of the distance's innovation doubted, `SAME` 5 | 3.09 cm | 45 | 88.7 % | 71.3 % | 5.06 cm, 80.1 % |
//! | all of it and of the bearing's, `SAME` 3 | 3.08 | 33 | 89.3 | 72.3 | 4.74 cm, 81.9 % |
//!
//! Each driving by itself, in the same rooms: 3.05 and 2.94 cm, 50 and 34 runs, 88.6 and 89.1 %.
//! What is left is the gyro's scale: where that is off by 2 % it takes 200 s to be found. With one
//! that `calibrate` measured, off by 0.4 %: 2.1 cm, 9 runs, 90.0 % and 74.2 %. With one that is off
//! by 3 % and was not measured: 83.9 % within 5 cm, and 81.6 % when it was taken to be right to
//! 1.5 % ([`Geometry`](super::Geometry)).
//!
//! # Not here
//!
//! The filter's algebra (`filter`). How feet are found (`sweep`).
//!
//! # What was tried and gave nothing
//!
//! - Landmarks without covariances between them (with the pose's variance as a floor): after half
//!   an hour 19 cm and 14° where these have 8 cm and 3°.
//! - Feet of regions narrower than 22°: many are of two things at once.
//! - Single feet that wait for another one to say the same of the pose (Neira and Tardós, *Data
//!   association in stochastic mapping using the joint compatibility test*, 2001). It made good a
//!   part of what points spoiled; without those it changes nothing.
//! - Points that correct once they are decided, or whose own place alone is corrected.
//! - A bias of the gyro in the filter's state: it is learnt at standstills, and what else there is
//!   to explain, this explains wrongly (30 minutes: 25 cm and 12° for 5 cm and 1°).
//! - The gyro's scale observed by the encoders (`drift`), as far as the track width is right to
//!   1.5 %. Exploring, 100 runs, with the right track width 81 % of the points are within 5 cm of a
//!   wall for 78 %, and with one that is wrong by 3 % it is 73 % for 78 %, and 64 of 80 come home
//!   for 72. `onbrick calibrate` measures both.
//! - What can only be a point, seen from a direction in which its wall could not be heard, counted
//!   for a point: no better a position, and 0.3 % less of the wall.
//! - Constants judged by 40 runs a world in which the robot drove by them: such means differ by
//!   chance as much as by constants.
//! - A landmark that is not decided yet corrects only itself: 41 of those 332 runs once off by 10
//!   cm for 33. A deviation that grows with how far a foot is from where others were: 37.
//! - A reach of 0.9 m and more: by 0.3 cm better where walls are straight, by 1 cm worse where they
//!   have steps. 32 landmarks for 20: nothing.
//! - Heading and bias made uncertain where feet are left out: no gain where the gyro is right, and
//!   half of the error where it drifts by 0.2 °/s.

use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};

use super::Pose;
use super::filter::{Filter, Jacobian, LANDMARKS, Symmetric, inverse, single};
use super::sweep::Foot;
use crate::units::wrap_rad;

/// Standard deviation of a foot's bearing: 10°.
const BEARING_RAD: f32 = 0.18;
/// That of its distance, and what each metre adds; a region narrower than [`WIDE_RAD`], 40°, is of
/// a weak echo or of a part of the surface, and the deviation grows with the square.
const DISTANCE_M: [f64; 2] = [0.01, 0.01];
const WIDE_RAD: f64 = 0.7;
/// A foot narrower than this says nothing certain of the pose, radians: 22°.
const NARROWEST_RAD: f64 = 0.38;
/// Squared Mahalanobis distances of two numbers: a foot that is nearer than the first is of the
/// landmark (78 %), one that is farther than the second from all is of a new one.
const SAME: f32 = 3.0;
const OTHER: f32 = 25.0;
/// A foot farther than this from a landmark's known extent is not of it, metres: as far as a robot
/// drives along a wall between two sweeps of its head.
const NEAR_M: f64 = 0.6;
/// A wall's direction is not off by more than this, radians: 25°.
const TURNED_RAD: f64 = 0.436;
/// A point nearer than this to the sensor has no bearing, metres.
const NEAREST_M: f64 = 0.05;
/// What a single foot can say for wall or point, and from where on it is decided: likelihoods of 7
/// to 1.
const SAYS: f32 = 8.0;
const DECIDED: f32 = 4.0;
/// Landmarks seen this often are given up last.
const KNOWN: u16 = 3;

/// What a landmark is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub(super) enum Kind {
    /// Seen from too few places.
    #[default]
    Unknown,
    Wall,
    Point,
}

/// What is known of a landmark beside what the filter estimates.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
struct Landmark {
    kind: Kind,
    seen: u16,
    /// How much speaks for a wall; below 0 for a point.
    wall: f32,
    last_ns: i64,
    /// How far feet lay along the wall from its place, metres.
    from_m: f64,
    to_m: f64,
}

/// What a foot turned out to be of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sighting {
    pub kind: Kind,
    /// Whether more than this foot is known of it.
    pub is_known: bool,
    /// Where the landmark's place is, and the direction in which it stands square.
    pub place: [f64; 2],
    pub direction_rad: f64,
    pub from_m: f64,
    pub to_m: f64,
}

/// A foot taken for a landmark, as a wall or as a point.
#[derive(Debug, Clone, Copy)]
struct Match {
    index: usize,
    kind: Kind,
    /// Squared Mahalanobis distance.
    distance: f32,
    /// By how much it is nearer as a wall than as a point, where it can be both.
    says: f32,
    innovation: [f32; 2],
    by: Jacobian,
    covariance: Symmetric,
}

/// Pose, scales and landmarks.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Landmarks {
    pub filter: Filter,
    known: ArrayVec<Landmark, LANDMARKS>,
}

impl Landmarks {
    pub(super) fn new(pose: Pose, gyro_scale_sd: f64) -> Self {
        Self { filter: Filter::new(pose, gyro_scale_sd), ..Self::default() }
    }

    /// Whether its parts fit each other: what was read back need not have been written by us.
    pub(super) fn is_whole(&self) -> bool {
        self.filter.is_of(self.known.len())
    }

    /// Takes a foot; corrects the pose where it is of a known wall. `None` where it was left out.
    pub(super) fn take(&mut self, foot: &Foot, time_ns: i64) -> Option<Sighting> {
        if foot.width_rad < NARROWEST_RAD {
            return None;
        }
        self.filter.settle();
        let seen = self.seen(foot);
        let fitting = (0..self.known.len())
            .filter_map(|index| self.matches(index, &seen))
            .min_by(|one, other| one.distance.total_cmp(&other.distance));
        let Some(best) = fitting.filter(|best| best.distance < OTHER) else {
            return Some(self.add(&seen, time_ns));
        };
        if best.distance >= SAME {
            return None;
        }
        self.observe(&best, &seen, time_ns);
        Some(self.sighting(best.index))
    }

    fn seen(&self, foot: &Foot) -> Seen {
        let (sin, cos) = libm::sincos(foot.bearing_rad);
        let narrow = (WIDE_RAD / foot.width_rad).max(1.0);
        let distance_sd_m = (DISTANCE_M[0] + DISTANCE_M[1] * foot.distance_m) * narrow * narrow;
        Seen {
            foot: *foot,
            normal: [cos, sin],
            at: [foot.x_m + cos * foot.distance_m, foot.y_m + sin * foot.distance_m],
            lever: [self.filter.pose.y_m - foot.y_m, foot.x_m - self.filter.pose.x_m],
            distance_m2: single(distance_sd_m * distance_sd_m),
        }
    }

    /// How a foot fits a landmark; `None` where it can't be of it.
    fn matches(&self, index: usize, seen: &Seen) -> Option<Match> {
        let known = self.known.get(index)?;
        let [x_m, y_m, direction_rad] = self.filter.landmark(index);
        let to = [x_m - seen.at[0], y_m - seen.at[1]];
        let reach_m = NEAR_M + (-known.from_m).max(known.to_m);
        if to[0] * to[0] + to[1] * to[1] > reach_m * reach_m {
            return None;
        }
        let as_point = (known.kind != Kind::Wall).then(|| seen.as_point([x_m, y_m])).flatten();
        let as_wall = (known.kind != Kind::Point)
            .then(|| seen.as_wall([x_m, y_m], direction_rad, [known.from_m, known.to_m]))
            .flatten();
        let weighed = |as_it: Option<_>| self.weighed(index, seen, as_it?);
        let [point, wall] = [as_point, as_wall].map(weighed);
        match (point, wall) {
            (Some(point), Some(wall)) => {
                let says = point.distance - wall.distance;
                Some(Match { says, ..if says > 0.0 { wall } else { point } })
            }
            (only, None) | (None, only) => only,
        }
    }

    fn weighed(
        &self,
        index: usize,
        seen: &Seen,
        (kind, innovation, by): (Kind, [f32; 2], Jacobian),
    ) -> Option<Match> {
        let [bearing, mixed, distance] = self.filter.of_innovation(index, &by);
        let covariance = [bearing + BEARING_RAD * BEARING_RAD, mixed, distance + seen.distance_m2];
        let distance = squared(innovation, inverse(covariance)?);
        Some(Match { index, kind, distance, says: 0.0, innovation, by, covariance })
    }

    fn observe(&mut self, best: &Match, seen: &Seen, time_ns: i64) {
        if best.kind == Kind::Wall {
            // An innovation may be all error that the deviation knows nothing of: sound that went
            // round, another wall, the middle of a region that has two. What is greater than its
            // deviation counts less and less, as by Cauchy's weight.
            let [bearing, mixed, distance] = best.covariance;
            let doubt = best.innovation.map(|innovation| innovation * innovation);
            let covariance = [bearing + doubt[0], mixed, distance + doubt[1]];
            self.filter.observe(best.index, best.innovation, &best.by, covariance);
        }
        let [x_m, y_m, direction_rad] = self.filter.landmark(best.index);
        if let Some(known) = self.known.get_mut(best.index) {
            known.wall += best.says.clamp(-SAYS, SAYS);
            known.kind = match known.wall {
                wall if wall > DECIDED => Kind::Wall,
                wall if wall < -DECIDED => Kind::Point,
                _ => Kind::Unknown,
            };
            known.seen = known.seen.saturating_add(1);
            known.last_ns = time_ns;
            if best.kind == Kind::Wall {
                let (sin, cos) = libm::sincos(direction_rad);
                let along_m = (seen.at[1] - y_m) * cos - (seen.at[0] - x_m) * sin;
                known.from_m = known.from_m.min(along_m);
                known.to_m = known.to_m.max(along_m);
            }
        }
    }

    fn add(&mut self, seen: &Seen, time_ns: i64) -> Sighting {
        if self.known.is_full() {
            let least = self
                .known
                .iter()
                .enumerate()
                .min_by_key(|(_, known)| (known.seen >= KNOWN, known.last_ns))
                .map(|(index, _)| index);
            if let Some(index) = least {
                self.known.remove(index);
                self.filter.remove(index);
            }
        }
        let Foot { bearing_rad, distance_m, .. } = seen.foot;
        let [cos, sin] = seen.normal;
        let across = [-sin * distance_m, cos * distance_m];
        let by_pose = [
            [1.0, 0.0, single(seen.lever[0] + across[0])],
            [0.0, 1.0, single(seen.lever[1] + across[1])],
            [0.0, 0.0, 1.0],
        ];
        let (bearing_rad2, distance_m2) = (BEARING_RAD * BEARING_RAD, seen.distance_m2);
        let [across, normal] = [across, seen.normal].map(|vector| vector.map(single));
        let place = |row: usize, column: usize| {
            across[row] * across[column] * bearing_rad2 + normal[row] * normal[column] * distance_m2
        };
        let measured = [
            [place(0, 0), place(0, 1), across[0] * bearing_rad2],
            [place(1, 0), place(1, 1), across[1] * bearing_rad2],
            [across[0] * bearing_rad2, across[1] * bearing_rad2, bearing_rad2],
        ];
        self.filter.add([seen.at[0], seen.at[1], bearing_rad], by_pose, measured);
        self.known.push(Landmark { seen: 1, last_ns: time_ns, ..Landmark::default() });
        self.sighting(self.known.len() - 1)
    }

    fn sighting(&self, index: usize) -> Sighting {
        let known = self.known.get(index).copied().unwrap_or_default();
        let [x_m, y_m, direction_rad] = self.filter.landmark(index);
        Sighting {
            kind: known.kind,
            is_known: known.seen >= KNOWN,
            place: [x_m, y_m],
            direction_rad,
            from_m: known.from_m,
            to_m: known.to_m,
        }
    }
}

/// The squared Mahalanobis distance of an innovation.
fn squared([first, second]: [f32; 2], [one, mixed, other]: Symmetric) -> f32 {
    first * first * one + 2.0 * first * second * mixed + second * second * other
}

/// A foot, and what follows from it.
#[derive(Debug, Clone, Copy)]
struct Seen {
    foot: Foot,
    /// Unit vector from the sensor to the foot.
    normal: [f64; 2],
    /// The foot's place.
    at: [f64; 2],
    /// How the sensor's place moves as the robot turns: its derivative by the heading.
    lever: [f64; 2],
    /// Variance of the distance.
    distance_m2: f32,
}

impl Seen {
    /// Taken for a point at a place: what was seen less what was expected, bearing and distance,
    /// with its derivatives.
    fn as_point(&self, [x_m, y_m]: [f64; 2]) -> Option<(Kind, [f32; 2], Jacobian)> {
        let to = [x_m - self.foot.x_m, y_m - self.foot.y_m];
        let distance_m = libm::hypot(to[0], to[1]);
        if distance_m < NEAREST_M {
            return None;
        }
        let [cos, sin] = to.map(|part| part / distance_m);
        let bearing_rad = wrap_rad(self.foot.bearing_rad - libm::atan2(sin, cos));
        let across = [-sin / distance_m, cos / distance_m];
        let by_heading = 1.0 + across[0] * self.lever[0] + across[1] * self.lever[1];
        let along = cos * self.lever[0] + sin * self.lever[1];
        let by = [
            [across[0], across[1], by_heading, -across[0], -across[1], 0.0],
            [cos, sin, along, -cos, -sin, 0.0],
        ];
        let innovation = [bearing_rad, self.foot.distance_m - distance_m];
        Some((Kind::Point, innovation.map(single), by.map(|row| row.map(single))))
    }

    /// Taken for a wall through a place, which stands square to a direction and reaches so far to
    /// both sides of the place.
    fn as_wall(
        &self,
        [x_m, y_m]: [f64; 2],
        direction_rad: f64,
        [from_m, to_m]: [f64; 2],
    ) -> Option<(Kind, [f32; 2], Jacobian)> {
        let turned_rad = wrap_rad(self.foot.bearing_rad - direction_rad);
        if turned_rad.abs() > TURNED_RAD {
            return None;
        }
        let (sin, cos) = libm::sincos(direction_rad);
        let along_m = (self.at[1] - y_m) * cos - (self.at[0] - x_m) * sin;
        if !(from_m - NEAR_M..to_m + NEAR_M).contains(&along_m) {
            return None;
        }
        let to = [x_m - self.foot.x_m, y_m - self.foot.y_m];
        let distance_m = to[0] * cos + to[1] * sin;
        let across_m = to[1] * cos - to[0] * sin;
        let along = cos * self.lever[0] + sin * self.lever[1];
        let by = [[0.0, 0.0, 1.0, 0.0, 0.0, -1.0], [cos, sin, along, -cos, -sin, -across_m]];
        let innovation = [turned_rad, self.foot.distance_m - distance_m];
        Some((Kind::Wall, innovation.map(single), by.map(|row| row.map(single))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::SECOND_NS;
    use crate::mapping::Geometry;
    use crate::mapping::filter::Step;
    use crate::mapping::pose::Correction;
    use crate::units::radians;
    use std::f64::consts::FRAC_PI_2;

    const WIDTH_RAD: f64 = 0.7;

    /// What a robot at a pose sees of the wall x = 2, of the wall y = 1.5 and of a post.
    fn feet(pose: &Pose) -> [Foot; 3] {
        let foot = |direction_rad: f64, distance_m: f64| Foot {
            x_m: pose.x_m,
            y_m: pose.y_m,
            bearing_rad: direction_rad,
            distance_m,
            width_rad: WIDTH_RAD,
        };
        let to = [0.4 - pose.x_m, -0.8 - pose.y_m];
        [
            foot(0.0, 2.0 - pose.x_m),
            foot(FRAC_PI_2, 1.5 - pose.y_m),
            foot(libm::atan2(to[1], to[0]), libm::hypot(to[0], to[1])),
        ]
    }

    /// The same as a robot takes it to be that is off by a turn.
    fn turned(foot: &Foot, pose: &Pose, turn_rad: f64) -> Foot {
        let mut foot = *foot;
        let to = Pose { heading_rad: pose.heading_rad + turn_rad, ..*pose };
        foot.correct(&Correction { from: *pose, to });
        foot
    }

    /// Landmarks of a robot that has driven to and fro between the walls.
    fn has_driven(ways: u32) -> (Landmarks, Pose) {
        let mut landmarks = Landmarks::new(Pose::default(), Geometry::GYRO_SCALE_SD);
        let (mut pose, mut time_ns) = (Pose::default(), 0);
        for way in 0..ways {
            for _ in 0..4 {
                for foot in feet(&pose) {
                    landmarks.take(&foot, time_ns);
                    time_ns += SECOND_NS;
                }
                let [forward_m, left_m] = if way % 2 == 0 { [0.2, 0.1] } else { [-0.2, -0.1] };
                let step = Step { forward_m, left_m, passed_s: 1.0, ..Step::default() };
                landmarks.filter.step(&step);
                (pose.x_m, pose.y_m) = (pose.x_m + forward_m, pose.y_m + left_m);
            }
        }
        (landmarks, pose)
    }

    #[test]
    fn feet_from_many_places_tell_walls_from_posts() {
        let (landmarks, pose) = has_driven(8);
        let kinds: Vec<Kind> = landmarks.known.iter().map(|known| known.kind).collect();
        assert_eq!(kinds, [Kind::Wall, Kind::Wall, Kind::Point]);
        let [x_m, y_m, _] = landmarks.filter.landmark(2);
        assert!((x_m - 0.4).abs() < 0.02 && (y_m + 0.8).abs() < 0.02, "the post at {x_m}, {y_m}");
        let off_m =
            libm::hypot(landmarks.filter.pose.x_m - pose.x_m, landmarks.filter.pose.y_m - pose.y_m);
        assert!(off_m < 0.01, "{:?}, not {pose:?}", landmarks.filter.pose);
        // The feet of the first wall lay along the way between them: 0.4 m.
        let wall = landmarks.known[0];
        assert!((0.3..0.6).contains(&(wall.to_m - wall.from_m)), "{wall:?}");
    }

    #[test]
    fn a_foot_of_a_wall_corrects_the_pose_and_one_of_a_post_does_not() {
        let (mut landmarks, pose) = has_driven(8);
        landmarks.filter.step(&Step { turn_rad: 6.0, passed_s: 60.0, ..Step::default() });
        let off_rad = radians(6.0);
        let [wall, _, post] = feet(&pose).map(|foot| turned(&foot, &pose, off_rad));
        let before = landmarks.filter.pose;
        let sighting = landmarks.take(&post, 100 * SECOND_NS).expect("a known post");
        assert!(sighting.is_known && sighting.kind == Kind::Point, "{sighting:?}");
        assert_eq!(landmarks.filter.pose, before);
        let sighting = landmarks.take(&wall, 101 * SECOND_NS).expect("a known wall");
        assert!(sighting.is_known && sighting.kind == Kind::Wall, "{sighting:?}");
        let turned_rad = landmarks.filter.pose.heading_rad - before.heading_rad;
        assert!((-1.1 * off_rad..-0.1 * off_rad).contains(&turned_rad), "turned by {turned_rad}");
    }

    #[test]
    fn a_foot_that_fits_badly_corrects_nothing_and_is_no_new_landmark() {
        let (mut landmarks, pose) = has_driven(8);
        let before = landmarks.filter.pose;
        let [mut wall, ..] = feet(&pose);
        wall.distance_m += 0.1;
        assert!(landmarks.take(&wall, 100 * SECOND_NS).is_none());
        assert_eq!((landmarks.filter.pose, landmarks.known.len()), (before, 3));
    }

    #[test]
    fn what_is_new_when_the_memory_is_full_takes_the_place_of_what_was_seen_least_and_longest_ago()
    {
        let (mut landmarks, pose) = has_driven(8);
        for post in 0..2 * LANDMARKS {
            let [mut foot, ..] = feet(&pose);
            foot.x_m += 10.0 * (post as f64 + 1.0);
            landmarks.take(&foot, (100 + post as i64) * SECOND_NS);
        }
        assert_eq!(landmarks.known.len(), LANDMARKS);
        let seen: Vec<u16> = landmarks.known.iter().map(|known| known.seen).take(4).collect();
        assert!(seen[..3].iter().all(|seen| *seen >= KNOWN) && seen[3] == 1, "{seen:?}");
        assert_eq!(landmarks.known[3].last_ns, (100 + LANDMARKS as i64 + 3) * SECOND_NS);
    }

    #[test]
    fn a_narrow_foot_says_nothing() {
        let mut landmarks = Landmarks::new(Pose::default(), Geometry::GYRO_SCALE_SD);
        let [foot, ..] = feet(&Pose::default());
        assert!(landmarks.take(&Foot { width_rad: 0.3, ..foot }, 0).is_none());
        assert!(landmarks.known.is_empty());
    }
}
