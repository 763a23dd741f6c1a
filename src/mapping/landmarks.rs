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
//! # Not here
//!
//! The filter's algebra (`filter`). How feet are found (`sweep`).
//!
//! # What was tried and gave nothing
//!
//! - Landmarks without covariances between them (with the pose's variance as a floor): after half
//!   an hour 19 cm and 14° where these have 8 cm and 3°.
//! - Feet of regions narrower than 22°: many are of two things at once.
//! - A bias of the gyro in the filter's state: it is learnt at standstills, and what else there is
//!   to explain, this explains wrongly (30 minutes: 25 cm and 12° for 5 cm and 1°).
//! - Heading and bias made uncertain where feet are left out: no gain where the gyro is right, and
//!   half of the error where it drifts by 0.2 °/s.

use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};

use super::Pose;
use super::filter::{Filter, Jacobian, LANDMARKS, Step, Symmetric, inverse, single};
use super::sweep::Foot;
use crate::units::wrap_rad;

/// Standard deviations of a foot's bearing, 5°, and distance. A region's ends are known to a
/// reading of the sweep and its range to half a centimetre; with that, wrong matches of a landmark
/// lead the pose astray, and with this they do not.
const BEARING_RAD: f32 = 0.087;
const DISTANCE_M: f32 = 0.04;
/// A foot narrower than this says nothing certain of the pose, radians: 22°.
const NARROWEST_RAD: f64 = 0.38;
/// Squared Mahalanobis distances of two numbers: a foot that is nearer than the first is of the
/// landmark (97 %), one that is farther than the second from all is of a new one.
const SAME: f32 = 7.0;
const OTHER: f32 = 25.0;
/// A foot farther than this from a landmark's known extent is not of it, metres.
const NEAR_M: f64 = 0.3;
/// A wall's direction is not off by more than this, radians: 25°.
const TURNED_RAD: f64 = 0.436;
/// A point nearer than this to the sensor has no bearing, metres.
const NEAREST_M: f64 = 0.05;
/// What a single foot can say for wall or point, and from where on it is decided: likelihoods of
/// 20 to 1.
const SAYS: f32 = 8.0;
const DECIDED: f32 = 6.0;
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
    kind: Kind,
    distance: f32,
    innovation: [f32; 2],
    by: Jacobian,
    covariance: Symmetric,
}

/// Pose, scales and landmarks.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Landmarks {
    filter: Filter,
    known: ArrayVec<Landmark, LANDMARKS>,
}

impl Landmarks {
    pub(super) fn new(pose: Pose) -> Self {
        Self { filter: Filter::new(pose), known: ArrayVec::new() }
    }

    pub(super) fn pose(&self) -> Pose {
        self.filter.pose
    }

    /// Covariance of the pose when a foot was last taken: xx, xy, xh, yy, yh, hh.
    pub(super) fn covariance(&self) -> [f64; 6] {
        self.filter.of_pose()
    }

    pub(super) fn step(&mut self, step: &Step) {
        self.filter.step(step);
    }

    /// Takes a foot; corrects the pose where it is of a known landmark. `None` where it was left
    /// out.
    pub(super) fn take(&mut self, foot: &Foot, time_ns: i64) -> Option<Sighting> {
        if foot.width_rad < NARROWEST_RAD {
            return None;
        }
        self.filter.settle();
        let (sin, cos) = libm::sincos(foot.bearing_rad);
        let seen = Seen {
            foot: *foot,
            normal: [cos, sin],
            at: [foot.x_m + cos * foot.distance_m, foot.y_m + sin * foot.distance_m],
            // How the sensor's place moves as the robot turns.
            lever: [self.filter.pose.y_m - foot.y_m, foot.x_m - self.filter.pose.x_m],
        };
        let best = (0..self.known.len())
            .filter_map(|index| Some((index, self.matches(index, &seen)?)))
            .min_by(|(_, one), (_, other)| one[0].distance.total_cmp(&other[0].distance));
        match best {
            Some((index, matches)) if matches[0].distance < SAME => {
                Some(self.observe(index, &matches, &seen, time_ns))
            }
            Some((_, matches)) if matches[0].distance < OTHER => None,
            _ => Some(self.add(&seen, time_ns)),
        }
    }

    /// The ways in which a foot can be of a landmark, the better one first; `None` where there is
    /// none.
    fn matches(&self, index: usize, seen: &Seen) -> Option<ArrayVec<Match, 2>> {
        let known = self.known.get(index)?;
        let [x_m, y_m, direction_rad] = self.filter.landmark(index);
        let to = [x_m - seen.at[0], y_m - seen.at[1]];
        let reach_m = NEAR_M + (-known.from_m).max(known.to_m);
        if to[0] * to[0] + to[1] * to[1] > reach_m * reach_m {
            return None;
        }
        let mut matches = ArrayVec::new();
        let as_point = (known.kind != Kind::Wall).then(|| seen.as_point([x_m, y_m])).flatten();
        let as_wall = (known.kind != Kind::Point)
            .then(|| seen.as_wall([x_m, y_m], direction_rad, [known.from_m, known.to_m]))
            .flatten();
        for (kind, innovation, by) in as_point.into_iter().chain(as_wall) {
            let [bearing, mixed, distance] = self.filter.of_innovation(index, &by);
            let covariance =
                [bearing + BEARING_RAD * BEARING_RAD, mixed, distance + DISTANCE_M * DISTANCE_M];
            let Some([first, mixed, second]) = inverse(covariance) else { continue };
            let [bearing, distance] = innovation;
            let distance = bearing * bearing * first
                + 2.0 * bearing * distance * mixed
                + distance * distance * second;
            matches.push(Match { kind, distance, innovation, by, covariance });
        }
        matches.sort_by(|one: &Match, other| one.distance.total_cmp(&other.distance));
        (!matches.is_empty()).then_some(matches)
    }

    fn observe(&mut self, index: usize, matches: &[Match], seen: &Seen, time_ns: i64) -> Sighting {
        if let (Some(best), Some(known)) = (matches.first(), self.known.get_mut(index)) {
            if let Some(other) = matches.get(1) {
                let says = (other.distance - best.distance).min(SAYS);
                known.wall += if best.kind == Kind::Wall { says } else { -says };
                known.kind = match known.wall {
                    wall if wall > DECIDED => Kind::Wall,
                    wall if wall < -DECIDED => Kind::Point,
                    _ => Kind::Unknown,
                };
            }
            known.seen = known.seen.saturating_add(1);
            known.last_ns = time_ns;
            self.filter.observe(index, best.innovation, &best.by, best.covariance);
            if best.kind == Kind::Wall {
                let [x_m, y_m, direction_rad] = self.filter.landmark(index);
                let (sin, cos) = libm::sincos(direction_rad);
                let along_m = (seen.at[1] - y_m) * cos - (seen.at[0] - x_m) * sin;
                known.from_m = known.from_m.min(along_m);
                known.to_m = known.to_m.max(along_m);
            }
        }
        self.sighting(index)
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
        let (bearing_rad2, distance_m2) = (BEARING_RAD * BEARING_RAD, DISTANCE_M * DISTANCE_M);
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

/// A foot, and what follows from it.
#[derive(Debug, Clone, Copy)]
struct Seen {
    foot: Foot,
    /// Unit vector from the sensor to the foot.
    normal: [f64; 2],
    /// The foot's place.
    at: [f64; 2],
    /// Derivative of the sensor's place by the robot's heading.
    lever: [f64; 2],
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
