//! Walls: the straight stretches of a map, and how sure they are.
//!
//! Points vote for all lines through them (Hough; for sonar Tardós, Neira, Newman and Leonard,
//! *Robust mapping and localization in indoor environments using sonar data*, 2002). The line with
//! the most votes is split where points are far apart, each stretch is fitted by total least
//! squares to the points near it (Nguyen et al., *A comparison of line extraction algorithms using
//! 2D range data for indoor mobile robotics*, 2007), and what passes all tests is a wall; its
//! points are taken out, and the next line is looked for.
//!
//! A false wall is worse than a missing one, so there are many tests: how long a stretch is, how
//! thick, how full, how straight, how empty it is beside it, and whether echoes came from behind
//! it. Posts, corners and the arcs that a sonar draws fail one or the other. What does not stand is
//! left out beforehand ([`standing()`]). A thin partition has two faces: what was seen from the
//! other side is none of a wall's.
//!
//! Where a wall ends its points become few ([`ends`]), unless it meets another one ([`corners`]).
//!
//! # Not here
//!
//! No joining of walls to rooms: where two meet they end ([`corners`]), and that is all. Nothing
//! whose points lie along less than 30 cm: of such stretches most are of posts and corners.
//!
//! # What we count on
//!
//! - Points that drift are walls that drift: a wall is where the points are.
//!
//! # What was tried and gave nothing
//!
//! - Points of one place within a stretch had to be from times seconds apart, or from places of
//!   the robot 15 to 30 cm apart along the wall, seen squarely: a third of the walls was lost, and
//!   the share of false ones was no smaller.
//! - Stretches from 25 cm on: 4 % more walls, and twice as many false ones.
//! - Round columns, of which some become walls of half a metre, by how far beside squarely they
//!   were heard, or by how much their points move along with the robot: neither tells one from a
//!   block's face. How thick a short stretch is does ([`thickest_m`]): of the walls found in 40
//!   runs among columns 4 % are false for 17.
//! - All echoes from behind a wall count, however obliquely they passed: 10 % fewer walls, and as
//!   many false ones.
//! - In long runs, instead of a part of the sights, only spots with an eighth of the points of the
//!   fullest one within 6 cm: in real scans 72 % of the walls found are right for 84 %.

mod ballot;
mod corners;
mod ends;

use super::{Sight, standing};
use crate::units::{count, floored};
use ballot::Ballot;

/// A straight stretch of wall.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wall {
    /// One end, world frame, metres.
    pub from_m: [f64; 2],
    /// The other.
    pub to_m: [f64; 2],
    /// Standard deviation of its place across itself, in its middle, metres.
    pub offset_sd_m: f64,
    /// Standard deviation of its direction, radians.
    pub direction_sd_rad: f64,
    /// How many points it is made from.
    pub points: u32,
}

impl Wall {
    /// Metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        libm::hypot(self.to_m[0] - self.from_m[0], self.to_m[1] - self.from_m[1])
    }

    /// Whether an echo comes from behind it.
    pub(super) fn hides(&self, sight: &Sight) -> bool {
        const ENDS_M: f64 = 0.05;
        let length_m = self.length_m();
        let along = [0, 1].map(|axis| (self.to_m[axis] - self.from_m[axis]) / length_m);
        let frame = |[x_m, y_m]: [f64; 2]| {
            let [x_m, y_m] = [x_m - self.from_m[0], y_m - self.from_m[1]];
            [x_m * along[0] + y_m * along[1], y_m * along[0] - x_m * along[1]]
        };
        let ([at_m, beside_m], [from_m, from_beside_m]) = (frame(sight.at_m), frame(sight.from_m));
        let crossing_m = from_m + from_beside_m / (from_beside_m - beside_m) * (at_m - from_m);
        beside_m * from_beside_m < 0.0
            && beside_m.abs() > BEHIND_M
            && from_beside_m.abs() > BEHIND_M / 2.0
            && crossing_m > ENDS_M
            && crossing_m < length_m - ENDS_M
    }
}

/// Sights that are looked at, at most.
const MOST: usize = 5000;
/// Points so near to one another count as one: a robot that stands still would outvote one that
/// drives.
const SPOT_M: f64 = 0.02;
/// Lines that came to nothing before the search ends.
const FAILURES: usize = 100;
/// So far from a line a point may be to be of it, metres.
const BAND_M: f64 = 0.04;
/// Points of one wall are not further apart, metres.
const GAP_M: f64 = 0.15;
/// The shortest wall, metres.
const SHORTEST_M: f64 = 0.3;
/// The fewest spots of a wall.
const FEWEST: usize = 10;
/// The largest standard deviation of a wall's spots, metres: of one without length, what each metre
/// adds, and of any.
const THIN_M: f64 = 0.012;
const THICKER_M_M: f64 = 0.006;
const THICKEST_M: f64 = 0.02;
/// A wall is looked at in pieces of this length, metres: the share of them that must have
/// points, and the share that may have been looked through.
const PIECE_M: f64 = 0.05;
const FILLED: f64 = 0.75;
const SEEN_THROUGH: f64 = 0.3;
/// A piece was looked through where echoes from behind it are more than this share of its own; of
/// those only that passed it within 32° of squarely, cosine.
const THROUGH: f64 = 0.5;
const SQUARELY: f64 = 0.85;
/// What is nearer to a line than this is not behind it, metres; and what is nearer to the robot
/// than half of it is not looked through.
const BEHIND_M: f64 = 0.1;
/// Within the first of these distances from the line there must be this many times as
/// dense spots as between the two, metres.
const INSIDE_M: f64 = 0.03;
const BESIDE_M: f64 = 0.12;
const CONTRAST: f64 = 4.0;
/// A wall's middle is not further than this from the line between its ends, metres.
const BENT_M: f64 = 0.012;
/// What is nearer to a wall, and to its ends along it, is not looked at again, metres.
const TAKEN_M: f64 = 0.08;
const TAKEN_ENDS_M: f64 = 0.05;
/// A wall that is nearer to a better one, and not turned against it by more than 17°, is the same
/// wall, seen with another error of the pose.
const DOUBLE_M: f64 = 0.12;
const DOUBLE_SINE: f64 = 0.3;
/// Places along a wall in which errors are independent, metres: a sonar's echoes from one place
/// are as wide.
const INDEPENDENT_M: f64 = 0.25;
/// What all points of a wall have in common, standard deviations: errors of the pose and of the
/// range. From simulated rooms, two to five minutes.
const COMMON_M: f64 = 0.02;
const COMMON_RAD: f64 = 0.03;

/// The walls of a map, the best first. Sights of several robots may be mixed.
///
/// Of more than 5000 sights it looks at an even part: in a small room strays fill all spots beside
/// the walls in time, and at a run's end a brick has its work bounded. Takes memory for each of
/// them, and votes of 0.1 MB for a room, 3 MB for 200 m.
#[must_use]
pub fn walls(sights: &[Sight]) -> Vec<Wall> {
    let some: Vec<Sight> = part(sights).copied().collect();
    let found = found(&some, &standing(&some));
    let whole: Vec<Wall> = found.iter().map(Stretch::wall).collect();
    let dense: Vec<Wall> = found.iter().map(Stretch::dense).collect();
    corners::met(&whole, &dense)
}

/// An even part of things, no more than [`MOST`].
fn part<T>(all: &[T]) -> impl Iterator<Item = &T> {
    all.iter().step_by(all.len().div_ceil(MOST).max(1))
}

/// The walls that some of the points make.
pub(super) fn walls_of(sights: &[Sight], counts: &[bool]) -> Vec<Wall> {
    found(sights, counts).iter().map(Stretch::wall).collect()
}

/// The stretches that are walls, the best first.
fn found(sights: &[Sight], counts: &[bool]) -> Vec<Stretch> {
    let sights: &Vec<Sight> = &part(sights).copied().collect();
    let counts = part(counts);
    let counted = sights.iter().zip(counts).filter(|(_, counts)| **counts);
    let all = spots(counted.map(|(sight, _)| sight));
    let mut ballot = Ballot::of(&all);
    let mut left = all.clone();
    let mut found: Vec<Stretch> = Vec::new();
    let mut failures = 0;
    while failures < FAILURES {
        let Some((place, line)) = ballot.best() else { break };
        let stretches = stretches(&line, &left, BAND_M).into_iter();
        let best = stretches
            .filter(|spots| spots.len() >= FEWEST)
            .filter_map(|spots| fitted(spots, &left))
            .filter(|stretch| stretch.is_wall(&all, sights))
            .max_by_key(|stretch| stretch.spots.len());
        let Some(best) = best else {
            ballot.dismiss(place);
            failures += 1;
            continue;
        };
        left.retain(|spot| {
            let taken = best.has_taken(spot);
            if taken {
                ballot.count(spot, -1);
            }
            !taken
        });
        if !found.iter().any(|other| other.is_same_wall(&best)) {
            found.push(best);
        }
    }
    found
}

/// Points that count as one: where they are in the mean and from where they were seen, and how
/// many.
#[derive(Debug, Clone, Copy)]
struct Spot {
    at_m: [f64; 2],
    from_m: [f64; 2],
    points: u32,
}

fn spots<'a>(sights: impl Iterator<Item = &'a Sight>) -> Vec<Spot> {
    let is_near = |sight: &&Sight| sight.at_m.iter().all(|m| m.abs() < 1e5);
    let cell = |at_m: [f64; 2]| at_m.map(|m| floored(m / SPOT_M));
    let mut placed: Vec<([i32; 2], &Sight)> =
        sights.filter(is_near).map(|sight| (cell(sight.at_m), sight)).collect();
    placed.sort_by_key(|(cell, _)| *cell);
    let spots = placed.chunk_by(|a, b| a.0 == b.0).map(|points| {
        let mean = |place: fn(&Sight) -> [f64; 2]| {
            let sum = |axis: usize| points.iter().map(|(_, sight)| place(sight)[axis]).sum::<f64>();
            [0, 1].map(|axis| sum(axis) / count(points.len()))
        };
        Spot {
            at_m: mean(|sight| sight.at_m),
            from_m: mean(|sight| sight.from_m),
            points: u32::try_from(points.len()).unwrap_or(u32::MAX),
        }
    });
    spots.collect()
}

/// A line: its normal, and its distance from the origin along it.
#[derive(Debug, Clone, Copy)]
struct Line {
    normal: [f64; 2],
    distance_m: f64,
}

impl Line {
    /// Where a place is in the line's own frame: along it, and how far beside it; metres.
    fn frame(&self, [x_m, y_m]: [f64; 2]) -> [f64; 2] {
        let [nx, ny] = self.normal;
        [y_m * nx - x_m * ny, x_m * nx + y_m * ny - self.distance_m]
    }

    /// The place of the line that is so far along it.
    fn place(&self, along_m: f64) -> [f64; 2] {
        let ([nx, ny], m) = (self.normal, self.distance_m);
        [m * nx - along_m * ny, m * ny + along_m * nx]
    }

    /// Total least squares: through the mean, along the principal axis.
    fn through(spots: &[Spot]) -> Self {
        let n = count(spots.len()).max(1.0);
        let mean = [0, 1].map(|axis| spots.iter().map(|spot| spot.at_m[axis]).sum::<f64>() / n);
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for spot in spots {
            let [x, y] = [0, 1].map(|axis| spot.at_m[axis] - mean[axis]);
            xx += x * x;
            xy += x * y;
            yy += y * y;
        }
        let (sin, cos) = libm::sincos(0.5 * libm::atan2(2.0 * xy, xx - yy));
        Self { normal: [-sin, cos], distance_m: mean[1] * cos - mean[0] * sin }
    }
}

/// The spots near a line, by stretches without a gap, each in its order along the line.
fn stretches(line: &Line, spots: &[Spot], band_m: f64) -> Vec<Vec<Spot>> {
    let mut near: Vec<(f64, Spot)> = spots
        .iter()
        .filter_map(|spot| {
            let [along_m, beside_m] = line.frame(spot.at_m);
            (beside_m.abs() <= band_m).then_some((along_m, *spot))
        })
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    let stretches = near.chunk_by(|a, b| b.0 - a.0 <= GAP_M);
    stretches.map(|stretch| stretch.iter().map(|(_, spot)| *spot).collect()).collect()
}

/// How thick a wall of this length may be. A post's points lie along a short stretch, and scatter.
fn thickest_m(length_m: f64) -> f64 {
    (THIN_M + THICKER_M_M * length_m).min(THICKEST_M)
}

/// What may be a wall.
#[derive(Debug)]
struct Stretch {
    line: Line,
    /// Where it begins and ends along its line, metres.
    ends_m: [f64; 2],
    spots: Vec<Spot>,
    /// Standard deviation of its spots across the line, metres.
    sd_m: f64,
    /// Whether most of them were seen from the side to which the line's normal points.
    from_normal: bool,
}

/// Fits a line to spots, takes those that are near it, and again, within a band that narrows.
fn fitted(mut spots: Vec<Spot>, left: &[Spot]) -> Option<Stretch> {
    const ROUNDS: usize = 4;
    const NARROWEST_M: f64 = 0.02;
    let mut band_m = BAND_M;
    for _ in 0..ROUNDS {
        let old = Stretch::of(spots);
        let overlaps = |spots: &Vec<Spot>| {
            let [from_m, to_m] = ends_m(&old.line, spots);
            from_m <= old.ends_m[1] && to_m >= old.ends_m[0]
        };
        let all = stretches(&old.line, left, band_m).into_iter();
        spots = all.filter(overlaps).max_by_key(Vec::len)?;
        let square = |spot: &Spot| old.line.frame(spot.at_m)[1] * old.line.frame(spot.at_m)[1];
        let sd_m = libm::sqrt(spots.iter().map(square).sum::<f64>() / count(spots.len()));
        band_m = (2.5 * sd_m).clamp(NARROWEST_M, BAND_M);
    }
    Some(Stretch::of(spots))
}

/// Where spots begin and end along a line, metres.
fn ends_m(line: &Line, spots: &[Spot]) -> [f64; 2] {
    let along = spots.iter().map(|spot| line.frame(spot.at_m)[0]);
    along.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], m| [least.min(m), most.max(m)])
}

impl Stretch {
    fn of(spots: Vec<Spot>) -> Self {
        let line = Line::through(&spots);
        let square = |spot: &Spot| line.frame(spot.at_m)[1] * line.frame(spot.at_m)[1];
        let squares: f64 = spots.iter().map(square).sum();
        let sd_m = libm::sqrt(squares / (count(spots.len()) - 2.0).max(1.0));
        let from_normal = spots.iter().filter(|spot| line.frame(spot.from_m)[1] > 0.0).count();
        let from_normal = 2 * from_normal > spots.len();
        Self { line, ends_m: ends_m(&line, &spots), spots, sd_m, from_normal }
    }

    /// Whether a spot is of another face: beside the line, and seen from the other side.
    fn is_other_face(&self, spot: &Spot) -> bool {
        self.line.frame(spot.at_m)[1].abs() > INSIDE_M
            && (self.line.frame(spot.from_m)[1] > 0.0) != self.from_normal
    }

    fn length_m(&self) -> f64 {
        self.ends_m[1] - self.ends_m[0]
    }

    /// All tests, the cheapest first.
    fn is_wall(&self, all: &[Spot], sights: &[Sight]) -> bool {
        self.length_m() >= SHORTEST_M
            && self.spots.len() >= FEWEST
            && self.sd_m <= thickest_m(self.length_m())
            && self.bent_m().abs() <= BENT_M
            && self.is_filled()
            && self.stands_out(all)
            && !self.is_seen_through(sights)
    }

    /// How far its middle is beside the line between its ends: the quadratic part of a fit.
    fn bent_m(&self) -> f64 {
        let n = count(self.spots.len());
        let half_m = self.length_m() / 2.0;
        let square = |along_m: f64| {
            let from_middle = (along_m - self.ends_m[0]) / half_m - 1.0;
            from_middle * from_middle
        };
        let places = || self.spots.iter().map(|spot| self.line.frame(spot.at_m));
        let mean = places().map(|[along_m, _]| square(along_m)).sum::<f64>() / n;
        let mean_beside_m = places().map(|[_, beside_m]| beside_m).sum::<f64>() / n;
        let (mut over, mut under) = (0.0, f64::MIN_POSITIVE);
        for [along_m, beside_m] in places() {
            let from_mean = square(along_m) - mean;
            over += from_mean * (beside_m - mean_beside_m);
            under += from_mean * from_mean;
        }
        over / under
    }

    fn pieces(&self) -> usize {
        usize::try_from(floored(self.length_m() / PIECE_M) + 1).unwrap_or(1)
    }

    /// The piece of a place along the line; `None` beyond its ends.
    fn piece(&self, along_m: f64) -> Option<usize> {
        let piece = floored((along_m - self.ends_m[0]) / PIECE_M);
        (along_m <= self.ends_m[1]).then(|| usize::try_from(piece).ok()).flatten()
    }

    fn is_filled(&self) -> bool {
        let mut filled = vec![false; self.pieces()];
        for spot in &self.spots {
            let piece = self.piece(self.line.frame(spot.at_m)[0]);
            if let Some(piece) = piece.and_then(|piece| filled.get_mut(piece)) {
                *piece = true;
            }
        }
        let has = filled.iter().filter(|piece| **piece).count();
        count(has) >= FILLED * count(filled.len())
    }

    /// Whether there is little beside it on its own side.
    fn stands_out(&self, all: &[Spot]) -> bool {
        let (mut inside, mut beside) = (0.0, 0.0);
        for spot in all.iter().filter(|spot| !self.is_other_face(spot)) {
            let [along_m, beside_m] = self.line.frame(spot.at_m);
            if self.piece(along_m).is_some() {
                match beside_m.abs() {
                    m if m <= INSIDE_M => inside += 1.0,
                    m if m <= BESIDE_M => beside += 1.0,
                    _ => {}
                }
            }
        }
        inside * (BESIDE_M - INSIDE_M) >= CONTRAST * beside * INSIDE_M
    }

    /// Whether echoes came from behind too much of it.
    fn is_seen_through(&self, sights: &[Sight]) -> bool {
        // Of each piece: its own echoes, and those from behind it.
        let mut pieces = vec![[0.0, 0.0]; self.pieces()];
        for sight in sights {
            let [along_m, beside_m] = self.line.frame(sight.at_m);
            let [from_along_m, from_beside_m] = self.line.frame(sight.from_m);
            let (crossing_m, through) = if beside_m.abs() <= BAND_M {
                (along_m, 0)
            } else if beside_m.abs() > BEHIND_M
                && from_beside_m.abs() > BEHIND_M / 2.0
                && beside_m * from_beside_m < 0.0
                && (beside_m - from_beside_m).abs()
                    >= SQUARELY * libm::hypot(along_m - from_along_m, beside_m - from_beside_m)
            {
                let part = from_beside_m / (from_beside_m - beside_m);
                (from_along_m + part * (along_m - from_along_m), 1)
            } else {
                continue;
            };
            let piece = self.piece(crossing_m);
            if let Some(piece) = piece.and_then(|piece| pieces.get_mut(piece)) {
                piece[through] += 1.0;
            }
        }
        let through = pieces.iter().filter(|[own, behind]| *behind > THROUGH * own).count();
        count(through) > SEEN_THROUGH * count(pieces.len())
    }

    fn has_taken(&self, spot: &Spot) -> bool {
        let [along_m, beside_m] = self.line.frame(spot.at_m);
        let [from_m, to_m] = [self.ends_m[0] - TAKEN_ENDS_M, self.ends_m[1] + TAKEN_ENDS_M];
        let is_near = beside_m.abs() <= TAKEN_M && along_m >= from_m && along_m <= to_m;
        is_near && !self.is_other_face(spot)
    }

    /// Whether another stretch, found later, is of the same wall.
    fn is_same_wall(&self, other: &Self) -> bool {
        let ([ax, ay], [bx, by]) = (self.line.normal, other.line.normal);
        let middle = other.line.place((other.ends_m[0] + other.ends_m[1]) / 2.0);
        let [along_m, beside_m] = self.line.frame(middle);
        let is_same_side = (ax * bx + ay * by > 0.0) == (self.from_normal == other.from_normal);
        (ax * by - ay * bx).abs() < DOUBLE_SINE
            && beside_m.abs() < if is_same_side { DOUBLE_M } else { INSIDE_M }
            && along_m > self.ends_m[0]
            && along_m < self.ends_m[1]
    }

    /// Variances: of independent places along it, and of what all have in common.
    fn wall(&self) -> Wall {
        let length_m = self.length_m();
        let places = (length_m / INDEPENDENT_M).max(1.0);
        let offset = self.sd_m * self.sd_m / places;
        // A line through evenly spaced places: 12 / (n L²) times their variance.
        let direction = 12.0 * offset / (length_m * length_m);
        Wall {
            from_m: self.line.place(self.ends_m[0]),
            to_m: self.line.place(self.ends_m[1]),
            offset_sd_m: libm::sqrt(offset + COMMON_M * COMMON_M),
            direction_sd_rad: libm::sqrt(direction + COMMON_RAD * COMMON_RAD),
            points: self.spots.iter().map(|spot| spot.points).sum(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Points every 2 cm along a line, a centimetre to either side of it, seen from `from_m`.
    fn line(from: [f64; 2], to: [f64; 2], from_m: [f64; 2]) -> Vec<Sight> {
        let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
        let length_m = libm::hypot(dx, dy);
        let count = floored(length_m / 0.02);
        let place = |step: i32| {
            let along = f64::from(step) / f64::from(count);
            let beside_m = if step % 2 == 0 { 0.01 } else { -0.01 };
            let at_m = [
                from[0] + along * dx - beside_m * dy / length_m,
                from[1] + along * dy + beside_m * dx / length_m,
            ];
            Sight { at_m, from_m }
        };
        (0..=count).map(place).collect()
    }

    #[test]
    fn a_room_has_four_walls_where_they_are() {
        let corners = [[-1.0, -1.0], [2.0, -1.0], [2.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]];
        let sights: Vec<Sight> =
            corners.windows(2).flat_map(|ends| line(ends[0], ends[1], [0.0, 0.0])).collect();
        let found = walls(&sights);
        assert_eq!(found.len(), 4, "{found:?}");
        for wall in &found {
            let is_square = (0..2).any(|axis| (wall.from_m[axis] - wall.to_m[axis]).abs() < 0.02);
            assert!(is_square, "{wall:?}");
            assert!(wall.points >= 90 && wall.length_m() > 1.7, "{wall:?}");
        }
    }

    #[test]
    fn no_wall_goes_where_the_robot_went() {
        // It drove through a door, in which echoes of the frame lie, and looked back.
        let mut sights = line([1.0, -1.0], [1.0, 1.0], [0.3, 0.0]);
        let way = (0..=20).map(|step| [f64::from(step) * 0.1, 0.2]);
        sights.extend(way.map(|from_m| Sight { at_m: [2.5, 0.2], from_m }));
        let found = walls(&sights);
        assert_eq!(found.len(), 2, "{found:?}");
        for wall in &found {
            let sides = [wall.from_m[1] > 0.27, wall.to_m[1] > 0.27];
            assert_eq!(sides[0], sides[1], "{wall:?}");
        }
    }

    #[test]
    fn a_post_and_an_arc_are_no_walls() {
        let circle = |radius_m: f64, from_deg: i32, to_deg: i32| {
            (from_deg..to_deg).map(move |deg| {
                let (sin, cos) = libm::sincos(f64::from(deg).to_radians());
                Sight { at_m: [radius_m * cos, radius_m * sin], from_m: [0.0, 0.0] }
            })
        };
        assert_eq!(walls(&circle(0.3, 0, 360).collect::<Vec<_>>()), []);
        assert_eq!(walls(&circle(1.0, -20, 20).collect::<Vec<_>>()), []);
    }

    #[test]
    fn the_short_face_of_a_block_is_a_wall_and_what_scatters_as_a_posts_echoes_is_none() {
        let face = line([1.0, -0.2], [1.0, 0.2], [0.0, 0.0]);
        assert_eq!(walls(&face).len(), 1);
        let scattered = |sight: &Sight| {
            let [x_m, y_m] = sight.at_m;
            Sight { at_m: [1.0 + 1.8 * (x_m - 1.0), y_m], ..*sight }
        };
        assert_eq!(walls(&face.iter().map(scattered).collect::<Vec<_>>()), []);
        // So thick a longer wall may be.
        let long: Vec<Sight> = line([1.0, -1.0], [1.0, 1.0], [0.0, 0.0]);
        assert_eq!(walls(&long.iter().map(scattered).collect::<Vec<_>>()).len(), 1);
    }

    #[test]
    fn what_echoes_come_through_is_no_wall() {
        let mut sights = line([1.0, -0.5], [1.0, 0.5], [0.0, 0.0]);
        assert_eq!(walls(&sights).len(), 1);
        sights.extend(line([2.0, -1.0], [2.0, 1.0], [0.0, 0.0]));
        let found = walls(&sights);
        assert!(found.len() == 1 && (found[0].from_m[0] - 2.0).abs() < 0.02, "{found:?}");
    }

    #[test]
    fn a_thin_partition_has_two_faces_each_seen_from_its_side() {
        let mut sights = line([1.0, -1.0], [1.0, 1.0], [0.0, 0.0]);
        sights.extend(line([1.06, -1.0], [1.06, 1.0], [2.0, 0.0]));
        let mut found = walls(&sights);
        found.sort_by(|one, other| one.from_m[0].total_cmp(&other.from_m[0]));
        assert_eq!(found.len(), 2, "{found:?}");
        for (wall, x_m) in found.iter().zip([1.0, 1.06]) {
            assert!((wall.from_m[0] - x_m).abs() < 0.01 && wall.length_m() > 1.9, "{wall:?}");
        }
    }

    #[test]
    fn a_panel_ends_where_its_points_become_few() {
        let mut sights = line([1.0, -0.5], [1.0, 0.5], [0.0, 0.0]);
        // Its end, heard from beside and beyond it.
        let beyond = [(0.56, 0.4), (0.62, 0.4), (0.68, 0.8)];
        sights
            .extend(beyond.map(|(y_m, from_m)| Sight { at_m: [1.0, y_m], from_m: [0.2, from_m] }));
        let found = walls(&sights);
        assert_eq!(found.len(), 1, "{found:?}");
        let [mut low_m, mut high_m] = [found[0].from_m[1], found[0].to_m[1]];
        if low_m > high_m {
            (low_m, high_m) = (high_m, low_m);
        }
        assert!((low_m + 0.5).abs() < 0.01 && (high_m - 0.5).abs() < 0.01, "{found:?}");
    }

    proptest! {
        #[test]
        fn any_numbers_at_all_are_survived(
            sights in proptest::collection::vec(
                (any::<f64>(), any::<f64>(), -1.0..1.0, -1e4..1e4), 0..60
            )
        ) {
            let sights: Vec<Sight> = sights
                .into_iter()
                .flat_map(|(a, b, c, d)| {
                    [Sight { at_m: [a, b], from_m: [c, d] }, Sight { at_m: [c, d], from_m: [a, b] }]
                })
                .collect();
            for wall in walls(&sights) {
                prop_assert!(wall.length_m() >= SHORTEST_M && wall.offset_sd_m > 0.0, "{:?}", wall);
            }
        }
    }
}
