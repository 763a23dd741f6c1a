//! What an ultrasonic sensor hears of a room: two models.
//!
//! # The lobe (the default)
//!
//! Made from 39 turns of real LEGO robots in a known arena (`lego-rotating-sonar`, teams 01 to 03;
//! 11 629 readings), by likelihood over all of them; what one team alone gives stands beside the
//! world's keys. What those scans say:
//!
//! - A wall answers from the foot of the perpendicular and from nowhere else: 76 % of readings
//!   (90 % of echoes) are the distance of a foot or of a concave corner, whether the axis is 0 or
//!   40° beside it. Of 400 echoes that nothing here explains, 10 are where the axis meets a wall:
//!   smooth walls reflect nothing diffusely.
//! - Loudness decides whether a foot is heard: 6 dB less for twice the distance, 2.6 dB a metre in
//!   air, [`LOBE_DB`] for 10° off the axis (and four times that for 20°), and what is missing of
//!   the wall about the foot. A foot at a wall's end has half the pressure (Fresnel's half plane,
//!   with an arc tangent for his integral); a post spreads the sound. The nearest foot that is
//!   loud enough is what is measured.
//! - A concave corner of two walls sends every direction back: [`CORNER_DB`] fainter than a wall.
//! - Faint echoes are late: 3.4 cm at 40° off the axis, with the square of the angle and not with
//!   the distance. The sensor waits for a level, and a weak echo reaches it some periods later.
//! - Walls differ by ±6.8 dB from place to place, and stay the same while the head turns.
//! - Where no foot is loud enough, 22 % of directions still have an echo, up to 1.5 m behind
//!   what the axis meets: the sound went round.
//! - Neighbours on a plateau are the same centimetre in 81 %; single missing echoes are rare.
//!
//! `tests/it/figures/sonar_model.rs` holds the model against those scans.
//!
//! # The cone
//!
//! A fan of [`FAN`] rays over the cone; a surface echoes where a ray meets it less obliquely than
//! the limit, and the nearest echo counts. The README of `lego-rotating-sonar` fits it to 70 scans
//! (81 % of echoes within 5 cm of it), but it promises too much: a mapper that knows the cone gains
//! twice what it gains on the real scans.
//!
//! # Not here
//!
//! - Diffuse reflection: rough walls, cloth, people. Nothing in the scans says how they answer.
//! - Height: boards that are lower than the beam, floors, tables.
//! - Echoes of the ping before, and what two sensors do to each other beyond `range_crosstalk`.
//! - Convex edges by themselves: of the echoes that only one thing explains, 10 are an edge's; here
//!   it answers as the end of a wall does.
//! - Own echoes by default: none of these three teams' robots hears itself.
//!
//! # What we count on
//!
//! Differences between places are drawn from the seed by where the foot is, not by when it is
//! asked: a robot that stands still hears the same, and no stream of chance is used up.

use std::f64::consts::PI;

use arrayvec::ArrayVec;

use super::chance::even;
use super::sensors::Scene;
use super::world::geometry::{Arm, Corner, Hit, Point, Segment, direction};
use crate::units::{radians, wrap_rad};

/// Rays across the cone.
const FAN: i32 = 15;
/// Lost at 10° off the axis, both ways, with a lobe of 14°; it grows with the square of the angle.
const LOBE_DB: f64 = 0.92;
/// The lobe that [`LOBE_DB`] is of.
const LOBE_DEG: f64 = 14.0;
/// Lost in a metre of air, there and back, at 40 kHz.
const AIR_DB_PER_M: f64 = 2.6;
/// Lost at the two bounces of a concave corner.
const CORNER_DB: f64 = 5.6;
/// Length of a wave of 40 kHz.
const WAVE_M: f64 = 0.0086;
/// Off the axis by this, an echo is late by `range_late_m`.
const LATE_RAD: f64 = 40.0 * PI / 180.0;
/// Nothing is heard from further off the axis.
const BESIDE_RAD: f64 = 65.0 * PI / 180.0;
/// Feet as near to each other as this are one foot: walls of several blocks.
const ONE_FOOT_M: f64 = 0.02;
/// Twice the pressure; and the most that four even draws differ from their mean, in deviations.
const TWICE_DB: f64 = 6.1;
const MOST_DIFFERENCE: f64 = 3.47;
/// Walls answer alike within this.
const PLACE_M: f64 = 0.2;
/// Directions in which the sound goes round, and those in which it goes the same way round.
const ROUND_RAD: f64 = 12.0 * PI / 180.0;
const SAME_WAY_RAD: f64 = 2.5 * PI / 180.0;
/// At most how far behind what the axis meets the sound seems to come from that went round.
const BEHIND_M: f64 = 1.5;

/// How a range sensor hears.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum EchoModel {
    /// Feet of perpendiculars and corners, as loud as they are.
    #[default]
    Lobe,
    /// The nearest surface in a cone that is met steeply enough.
    Cone,
}

impl EchoModel {
    /// The names in a world's file.
    pub const WORDS: [(&str, Self); 2] = [("lobe", Self::Lobe), ("cone", Self::Cone)];
}

/// The nearest echo, metres from the sensor, before any error of a reading.
pub(in crate::sim) fn nearest(scene: &Scene<'_>) -> Option<f64> {
    match scene.model.echo {
        EchoModel::Lobe => Lobe::of(scene)?.nearest(),
        EchoModel::Cone => in_cone(scene),
    }
}

fn in_cone(scene: &Scene<'_>) -> Option<f64> {
    let (origin, axis_rad) = scene.range_sensor()?;
    let errors = &scene.model.errors;
    let least = libm::cos(radians(errors.incidence_deg));
    let echo = |hit: &Hit| hit.cos_incidence >= least;
    super::sensors::fan(radians(errors.cone_deg), FAN)
        .filter_map(|off_rad| scene.hit(origin, direction(axis_rad + off_rad)).filter(echo))
        .map(|hit| hit.range_m)
        .reduce(f64::min)
}

/// A place that may answer.
#[derive(Debug, Clone, Copy)]
struct Foot {
    place: Point,
    range_m: f64,
    /// Share of the pressure that an endless wall would send back.
    pressure: f64,
}

/// The nearest feet, in order; a list that is never allocated, because a tick that reads the sensor
/// must not. The loud ones in a lobe are a dozen at most in rooms full of blocks.
type Feet = ArrayVec<Foot, 32>;

/// Adds a foot at its place; the farthest falls out of a full list.
fn add(feet: &mut Feet, foot: Foot) {
    let at = feet.partition_point(|other| other.range_m <= foot.range_m);
    if feet.is_full() && at < feet.len() {
        feet.pop();
    }
    // There is no room where all others are nearer.
    let _ = feet.try_insert(at, foot);
}

/// One listening.
#[derive(Debug)]
struct Lobe<'s> {
    scene: &'s Scene<'s>,
    origin: Point,
    axis_rad: f64,
}

impl<'s> Lobe<'s> {
    fn of(scene: &'s Scene<'s>) -> Option<Self> {
        let (origin, axis_rad) = scene.range_sensor()?;
        Some(Self { scene, origin, axis_rad })
    }

    fn nearest(&self) -> Option<f64> {
        let feet = self.feet();
        let mut rest = feet.as_slice();
        while let Some(first) = rest.first() {
            let of_one = |foot: &&Foot| {
                foot.range_m - first.range_m < ONE_FOOT_M
                    && (foot.place - first.place).norm() < ONE_FOOT_M + 0.1 * first.range_m
            };
            let same = rest.iter().take_while(of_one);
            let (count, pressure) =
                same.fold((0, 0.0), |(count, sum), foot| (count + 1, sum + foot.pressure));
            if let Some(range_m) = self.heard(&Foot { pressure, ..*first }) {
                return Some(range_m);
            }
            rest = rest.get(count.max(1)..).unwrap_or_default();
        }
        self.round_about()
    }

    /// What could answer if nothing were in between, nearest first.
    fn feet(&self) -> Feet {
        let surfaces = &self.scene.world.surfaces;
        let walls = surfaces.segments.iter().copied().chain(self.scene.others());
        let walls = walls.filter_map(|wall| self.of_wall(&wall));
        let posts = surfaces.discs.iter().filter_map(|disc| {
            let way = disc.centre - self.origin;
            let range_m = way.norm() - disc.radius_m;
            // The returning wave front is bent by the post.
            let pressure = libm::sqrt(disc.radius_m / (disc.radius_m + range_m.max(0.0)));
            self.foot(self.origin + way * (range_m / way.norm().max(1e-9)), pressure)
        });
        let corners = surfaces.corners.iter().filter_map(|corner| self.of_corner(corner));
        let mut feet = Feet::default();
        for foot in walls.chain(posts).chain(corners) {
            // Another part of the same wall may add as much again, and the place its difference.
            let errors = &self.scene.model.errors;
            let most_db = TWICE_DB + MOST_DIFFERENCE * errors.range_walls_sd_db;
            if self.level_db(&foot) + most_db >= 0.0 {
                add(&mut feet, foot);
            }
        }
        feet
    }

    fn foot(&self, place: Point, pressure: f64) -> Option<Foot> {
        let way = place - self.origin;
        let range_m = way.norm();
        // In front of the sensor; cheap, and most of a room is not.
        (range_m > 1e-6
            && range_m < super::sensors::FAR_M
            && way.dot(&direction(self.axis_rad)) > 0.0)
            .then_some(Foot { place, range_m, pressure })
    }

    fn of_wall(&self, wall: &Segment) -> Option<Foot> {
        let along = wall.to - wall.from;
        let length_m = along.norm();
        let place = wall.closest(self.origin);
        let foot = self.foot(place, 1.0)?;
        let from_m = (self.origin - wall.from).dot(&along) / length_m.max(1e-9);
        let pressure = inside(from_m, foot.range_m) + inside(length_m - from_m, foot.range_m) - 1.0;
        Some(Foot { pressure, ..foot })
    }

    fn of_corner(&self, corner: &Corner) -> Option<Foot> {
        let foot = self.foot(corner.place, 1.0)?;
        let way = self.origin - corner.place;
        let arm = |arm: &Arm| {
            let [behind_m, ahead_m] = arm.reach_m;
            let reach_m = if way.dot(&arm.along) < 0.0 { behind_m } else { ahead_m };
            2.0 * inside(reach_m, foot.range_m) - 1.0
        };
        let pressure: f64 = corner.arms.iter().map(arm).product();
        let loss = libm::pow(10.0, -CORNER_DB / 20.0);
        (pressure > 0.01).then_some(Foot { pressure: pressure * loss, ..foot })
    }

    /// How much louder a foot is than what is heard, before its place counts; far below 0 where it
    /// is beside the lobe.
    fn level_db(&self, foot: &Foot) -> f64 {
        let off_rad = self.off_rad(foot);
        if off_rad > BESIDE_RAD || foot.pressure <= 0.0 {
            return f64::NEG_INFINITY;
        }
        let errors = &self.scene.model.errors;
        let off = off_rad / radians(10.0) * LOBE_DEG / errors.cone_deg;
        errors.range_gain_db - LOBE_DB * off * off - AIR_DB_PER_M * foot.range_m
            + 20.0 * libm::log10(foot.pressure / foot.range_m)
    }

    fn off_rad(&self, foot: &Foot) -> f64 {
        let way = foot.place - self.origin;
        wrap_rad(libm::atan2(way.y, way.x) - self.axis_rad).abs()
    }

    /// The range of a foot if it is loud enough, and in sight.
    fn heard(&self, foot: &Foot) -> Option<f64> {
        let errors = &self.scene.model.errors;
        if self.level_db(foot) + errors.range_walls_sd_db * self.difference(foot) < 0.0 {
            return None;
        }
        let free = self.scene.hit(self.origin, (foot.place - self.origin) / foot.range_m);
        let in_sight = free.is_none_or(|hit| hit.range_m > foot.range_m - 0.005);
        let late = self.off_rad(foot) / LATE_RAD;
        in_sight.then_some(foot.range_m + errors.range_late_m * late * late)
    }

    /// How a wall differs here from others: normal, deviation 1.
    fn difference(&self, foot: &Foot) -> f64 {
        let draws: f64 = (0..4).map(|draw| self.draw(draw, foot.place, 0)).sum();
        // Four even draws: mean 2, variance a third.
        (draws - 2.0) * libm::sqrt(3.0)
    }

    /// Without a foot that is loud enough: what the sound finds on the way round.
    fn round_about(&self) -> Option<f64> {
        let errors = &self.scene.model.errors;
        let part = |width_rad: f64| whole(self.axis_rad / width_rad);
        if self.draw(4, self.origin, part(ROUND_RAD)) >= errors.range_round_share {
            return None;
        }
        let behind_m = BEHIND_M * self.draw(5, self.origin, part(SAME_WAY_RAD));
        let first = self.scene.hit(self.origin, direction(self.axis_rad))?;
        Some(first.range_m + behind_m)
    }

    /// Evenly from 0 to 1, the same for the same sensor, foot's place and part. The sensor's own
    /// place counts too: what answers from there need not answer from here.
    fn draw(&self, number: u64, place: Point, part: i64) -> f64 {
        let cell = |metres: f64| whole(metres / PLACE_M).cast_unsigned();
        let [x, y, own_x, own_y] = [place.x, place.y, self.origin.x, self.origin.y].map(cell);
        let mix = [number, x, y, own_x, own_y, part.cast_unsigned()];
        even(mix.into_iter().fold(self.scene.seed, mixed))
    }
}

/// The share of the pressure on this side of a wall's end: half where the foot is at the end.
fn inside(beyond_m: f64, range_m: f64) -> f64 {
    let zones = 2.0 * beyond_m / libm::sqrt(WAVE_M * range_m.max(0.02));
    0.5 + libm::atan(std::f64::consts::SQRT_2 * zones) / PI
}

/// Mixes a number into a seed (the finisher of splitmix64, Steele, Lea and Flood 2014).
fn mixed(seed: u64, number: u64) -> u64 {
    let mut z = (seed ^ number).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "a cast from float saturates, and NaN becomes 0"
)]
fn whole(value: f64) -> i64 {
    libm::floor(value) as i64
}

#[cfg(test)]
mod tests {
    use crate::sim::{StartPose, World, WorldPhysics};
    use crate::units::radians;

    /// What a robot without errors at the origin, sensor above its axle, says in a direction.
    fn heard(things: &str, heading_deg: f64) -> Option<f64> {
        let text = format!("name = \"t\"\n{things}\n[robot]\nrange_ahead_m = 0.0\n");
        let (world, _) = World::parse("t", text.as_bytes()).unwrap_or_else(|e| panic!("{e}"));
        let mut physics = WorldPhysics::new(world.without_errors(), 1, 1).unwrap();
        let heading_rad = radians(heading_deg);
        physics.carry(0, StartPose { x_m: 0.0, y_m: 0.0, heading_rad });
        physics.echo(0)
    }

    fn wall_at(x: f64) -> String {
        format!("[[wall]]\npoints = [[{x}, -9.0], [{x}, 9.0]]")
    }

    #[test]
    fn a_wall_is_as_far_as_its_foot_until_it_is_too_faint() {
        for heading_deg in [-35.0, -20.0, 0.0, 35.0] {
            let range_m = heard(&wall_at(0.5), heading_deg).expect("it is loud enough");
            assert!((range_m - 0.5).abs() < 1e-9, "{range_m} m at {heading_deg} degrees");
        }
        assert_eq!(heard(&wall_at(0.5), 45.0), None, "too far beside the axis");
        assert_eq!((heard(&wall_at(1.8), 0.0), heard(&wall_at(2.0), 0.0)), (Some(1.8), None));
        assert_eq!(heard(&wall_at(1.5), 25.0), None, "far and oblique");
        // A wider lobe hears more.
        let wide = format!("{}\n[robot.errors]\ncone_deg = 20", wall_at(0.5));
        let (world, _) = World::parse("t", format!("name = \"t\"\n{wide}").as_bytes()).unwrap();
        assert!((world.robot().errors.cone_deg - 20.0).abs() < 1e-12);
    }

    #[test]
    fn a_wall_of_blocks_is_a_wall_and_its_end_is_not() {
        let blocks: String = (-4..=4)
            .map(|block| {
                format!(
                    "[[block]]\nat = [1.2, {}]\nsize_m = [0.2, 0.4]\n",
                    0.4 * f64::from(block) + 0.2
                )
            })
            .collect();
        // The foot is where two blocks meet: each alone has half the pressure.
        let range_m = heard(&blocks, 20.0).expect("as loud as a whole wall");
        assert!((range_m - 1.1).abs() < 1e-9, "{range_m} m");
        let end = "[[wall]]\npoints = [[0.9, 0.0], [0.9, 2.0]]";
        assert!(heard(end, 0.0).is_some());
        assert_eq!(heard(end, 20.0), None, "6 dB are missing");
        assert!(heard(&wall_at(0.9), 20.0).is_some());
    }

    #[test]
    fn corners_send_the_sound_back_and_posts_spread_it() {
        let corner = "[[wall]]\npoints = [[0.7, -3.0], [0.7, 0.7], [-3.0, 0.7]]";
        let range_m = heard(corner, 45.0).expect("a corner");
        // The walls' feet are 45 degrees off the axis, too faint at 0.7 m.
        assert!((range_m - 0.7 * std::f64::consts::SQRT_2).abs() < 1e-9, "{range_m} m");
        let outside = "[[block]]\nat = [1.0, 1.0]\nsize_m = [0.6, 0.6]";
        assert_eq!(heard(outside, 45.0), None, "an edge towards the sensor");
        let post = |x: f64| format!("[[circle]]\nat = [{x}, 0.0]\nradius_m = 0.05");
        assert!(heard(&post(0.6), 0.0).is_some_and(|range_m| (range_m - 0.55).abs() < 1e-9));
        assert_eq!(heard(&post(1.5), 0.0), None);
    }

    #[test]
    fn the_nearest_of_many_feet_are_kept_in_order() {
        let mut feet = super::Feet::default();
        for range_m in (0..100).map(|step| f64::from(step * 37 % 100)) {
            let place = super::Point::zeros();
            super::add(&mut feet, super::Foot { place, range_m, pressure: 1.0 });
        }
        let kept: Vec<f64> = feet.as_slice().iter().map(|foot| foot.range_m).collect();
        assert_eq!(kept, (0..32).map(f64::from).collect::<Vec<_>>());
    }

    #[test]
    fn a_wall_in_front_hides_a_wall_behind() {
        let board = format!("{}\n[[wall]]\npoints = [[0.3, -0.04], [0.3, 0.04]]", wall_at(0.6));
        assert!(heard(&board, 0.0).is_some_and(|range_m| (range_m - 0.3).abs() < 1e-9));
        assert_eq!(heard("", 0.0), None, "an empty world");
    }

    #[test]
    fn a_robot_hears_itself_where_its_file_says_so() {
        let text = "name = \"t\"\n[robot]\nown_echoes = [[170, -170, 0.2]]\n";
        let (world, _) = World::parse("t", text.as_bytes()).unwrap();
        let own = &world.robot().own_echoes[0];
        assert_eq!(
            [165.0, 170.0, 180.0, -171.0, 0.0].map(|deg| own.is_at(deg)),
            [false, true, true, true, false]
        );
        let ahead = text.replace("[170, -170, 0.2]", "[-5, 5, 0.2]");
        let (world, _) = World::parse("t", ahead.as_bytes()).unwrap();
        let physics = WorldPhysics::new(world.without_errors(), 1, 1).unwrap();
        assert_eq!(physics.echo(0), Some(0.2));
    }
}
