//! What the sensors of a simulated robot measure.
//!
//! # Not here
//!
//! No frames, modes' names on files or resets: the driver asks for a mode's values when the sensor
//! would send a frame, and keeps the gyro's zero.
//!
//! # What we count on
//!
//! - Where an echo comes from is said in `sim::echo`; here are the errors of a reading.
//! - The infrared sensor sees oblique surfaces too; its scale is not linear and ends at 70 cm
//!   (interfaces 9 and 15.3).

use super::body::Body;
use super::chance::Chance;
use super::echo;
use super::world::geometry::{Hit, Point, Segment, direction, nearer};
use super::world::{OwnEcho, RobotModel, World};
use crate::ev3dev::Colour;
use crate::senses::Mount;
use crate::units::{degrees, radians, rounded, wrap_rad};

/// Furthest that the ultrasonic measures; also what it says without an echo.
pub(super) const FAR_M: f64 = 2.55;
/// Half of the infrared sensor's beam.
const INFRARED_HALF_RAD: f64 = 0.1;
/// Furthest that infrared proximity tells from nothing.
const INFRARED_FAR_M: f64 = 0.7;
/// Furthest that the beacon is seen.
const BEACON_FAR_M: f64 = 2.0;
/// Half of the field in which the beacon is seen: 25 steps.
const BEACON_HALF_RAD: f64 = 1.6;
/// Where a colour sensor is, metres ahead of the axle and left of the middle.
const COLOUR_AT_M: [f64; 2] = [0.07, 0.0];

/// One robot as its sensors need it.
#[derive(Debug)]
pub(in crate::sim) struct Scene<'s> {
    pub(in crate::sim) world: &'s World,
    pub(in crate::sim) model: &'s RobotModel,
    pub(in crate::sim) bodies: &'s [Body],
    pub(in crate::sim) robot: usize,
    pub(in crate::sim) head_rad: f64,
    /// Where the sensor is.
    pub(in crate::sim) mount: Mount,
    pub(in crate::sim) time_s: f64,
    /// What the room's differences between places are drawn from.
    pub(in crate::sim) seed: u64,
}

impl Scene<'_> {
    /// The ultrasonic's values in a mode.
    pub(in crate::sim) fn ultrasonic(&self, mode: &str, chance: &mut Chance) -> [i32; 8] {
        if mode == "US-LISTEN" {
            return one(i32::from(self.hears_another()));
        }
        let errors = &self.model.errors;
        let noise = chance.normal();
        let (dropped, spoiled, share) = (
            chance.happens(errors.range_dropout),
            chance.happens(errors.range_crosstalk) && self.hears_another(),
            chance.even(),
        );
        let mut range_m = self.echo().map_or(f64::INFINITY, |true_m| {
            let sd_m = errors.range_sd_m + errors.range_sd_per_m * true_m;
            true_m * (1.0 + errors.range_scale) + errors.range_bias_m + sd_m * noise
        });
        if spoiled {
            range_m = errors.too_near_m + share * (range_m.min(FAR_M) - errors.too_near_m);
        }
        let seen = !dropped && range_m >= errors.too_near_m && range_m < FAR_M;
        let range_m = if seen { range_m } else { FAR_M };
        one(if mode.ends_with("IN") {
            rounded(range_m / 0.0254 * 10.0)
        } else {
            rounded(range_m * 1000.0)
        })
    }

    /// The nearest echo, of the room or of the robot itself, metres from the sensor, before any
    /// error.
    pub(in crate::sim) fn echo(&self) -> Option<f64> {
        let head_deg = degrees(wrap_rad(self.head_rad));
        let is_heard = |own: &&OwnEcho| self.is_on_head() && own.is_at(head_deg);
        let own = self.model.own_echoes.iter().filter(is_heard);
        own.map(|own| own.range_m).chain(echo::nearest(self)).reduce(f64::min)
    }

    /// Infrared values in a mode.
    pub(in crate::sim) fn infrared(&self, mode: &str, chance: &mut Chance) -> [i32; 8] {
        match mode {
            "IR-PROX" => one(self.proximity(chance)),
            "IR-SEEK" => self.seek(),
            "IR-REMOTE" => self.buttons(),
            "IR-REM-A" => one(remote_bits(self.buttons()[0])),
            _ => [0; 8],
        }
    }

    /// Colour values in a mode.
    pub(in crate::sim) fn colour(&self, mode: &str, chance: &mut Chance) -> [i32; 8] {
        let (colour, light) = self.spot();
        let sd = self.model.errors.colour_sd_pct;
        let mut noisy = |pct: f64| (pct + sd * chance.normal()).clamp(0.0, 100.0);
        let [red, green, blue] = light.map(&mut noisy);
        match mode {
            "COL-REFLECT" => one(rounded(red)),
            // A lit room from above; the sensor's own shadow leaves little of it.
            "COL-AMBIENT" => one(rounded(red * 0.08)),
            "COL-COLOR" => one(colour.number().into()),
            // Darker is larger; the second value is the same with the light off.
            "REF-RAW" => [rounded(620.0 - red * 4.5), 640, 0, 0, 0, 0, 0, 0],
            "RGB-RAW" => {
                [rounded(red * 4.5), rounded(green * 4.5), rounded(blue * 4.5), 8, 0, 0, 0, 0]
            }
            _ => [0; 8],
        }
    }

    pub(super) fn hit(&self, origin: Point, toward: Point) -> Option<Hit> {
        self.others().fold(self.world.surfaces.hit(origin, toward), |best, side| {
            nearer(best, side.hit(origin, toward))
        })
    }

    /// The sides of the other robots.
    pub(super) fn others(&self) -> impl Iterator<Item = Segment> {
        let others = self.bodies.iter().enumerate().filter(|(index, _)| *index != self.robot);
        others.flat_map(|(_, body)| body.outline_now().hull())
    }

    fn body(&self) -> Option<&Body> {
        self.bodies.get(self.robot)
    }

    /// Where the range sensor is, and where it looks.
    pub(in crate::sim) fn range_sensor(&self) -> Option<(Point, f64)> {
        let body = self.body()?;
        let (place_m, turned_rad) = if self.is_on_head() {
            ([self.model.range_ahead_m, 0.0], self.head_rad)
        } else {
            let Mount { at_m, facing_deg } = self.mount;
            (at_m.unwrap_or_default(), radians(facing_deg.unwrap_or_default()))
        };
        Some((body.place_of(place_m), body.heading_rad + turned_rad))
    }

    fn is_on_head(&self) -> bool {
        self.mount == Mount::default()
    }

    /// Whether a touch sensor is pressed.
    pub(in crate::sim) fn is_pressed(&self) -> bool {
        let quarters = rounded(self.mount.facing_deg.unwrap_or_default() / 90.0).rem_euclid(4);
        let side = usize::try_from(quarters).ok();
        let pressed = self.body().zip(side).and_then(|(body, side)| body.bumped.get(side));
        pressed.copied().unwrap_or_default()
    }

    /// True where another robot stands in the half plane ahead with nothing between, within reach.
    fn hears_another(&self) -> bool {
        let Some((origin, axis_rad)) = self.range_sensor() else { return false };
        self.bodies.iter().enumerate().filter(|(index, _)| *index != self.robot).any(
            |(_, other)| {
                let way = other.place - origin;
                let range_m = way.norm();
                let facing =
                    way.dot(&direction(axis_rad)) > 0.0 && range_m < FAR_M && range_m > 1e-6;
                let wall = self.world.surfaces.hit(origin, way / range_m.max(1e-6));
                facing && wall.is_none_or(|hit| hit.range_m > range_m)
            },
        )
    }

    fn proximity(&self, chance: &mut Chance) -> i32 {
        let noise = self.model.errors.infrared_sd_pct * chance.normal();
        let Some((origin, axis_rad)) = self.range_sensor() else { return 100 };
        let range_m = fan(INFRARED_HALF_RAD, 5)
            .filter_map(|off_rad| self.hit(origin, direction(axis_rad + off_rad)))
            .map(|hit| hit.range_m)
            .fold(f64::INFINITY, f64::min);
        if range_m >= INFRARED_FAR_M {
            return 100;
        }
        rounded((100.0 * libm::pow(range_m / INFRARED_FAR_M, 0.8) + noise).clamp(0.0, 100.0))
    }

    fn seek(&self) -> [i32; 8] {
        let mut values = [0, -128, 0, -128, 0, -128, 0, -128];
        let Some(((origin, axis_rad), beacon)) = self.range_sensor().zip(self.world.beacon) else {
            return values;
        };
        let way = beacon.place - origin;
        let range_m = way.norm();
        let bearing_rad = wrap_rad(libm::atan2(way.y, way.x) - axis_rad);
        let hidden =
            self.hit(origin, way / range_m.max(1e-6)).is_some_and(|hit| hit.range_m < range_m);
        if hidden || range_m > BEACON_FAR_M || bearing_rad.abs() > BEACON_HALF_RAD {
            return values;
        }
        // Left is negative on the sensor.
        let found = [
            rounded(-25.0 * bearing_rad / BEACON_HALF_RAD),
            rounded(100.0 * range_m / BEACON_FAR_M),
        ];
        if let Some(pair) = values.get_mut(2 * beacon.channel..2 * beacon.channel + 2) {
            pair.copy_from_slice(&found);
        }
        values
    }

    fn buttons(&self) -> [i32; 8] {
        let mut values = [0; 8];
        let held = |from_s: f64, to_s: f64| (from_s..to_s).contains(&self.time_s);
        for press in self.world.remote.iter().filter(|press| held(press.from_s, press.to_s)) {
            if let Some(value) = values.get_mut(press.channel) {
                *value = press.code;
            }
        }
        values
    }

    /// The colour in the middle of the spot, and the light from all of it.
    fn spot(&self) -> (Colour, [f64; 3]) {
        let Some(body) = self.body() else { return (Colour::None, [0.0; 3]) };
        let centre = body.place_of(self.mount.at_m.unwrap_or(COLOUR_AT_M));
        let middle = self.world.floor.at(centre);
        if self.world.floor.marks.is_empty() && self.world.floor.table.is_empty() {
            return (middle.colour, middle.reflects_pct);
        }
        // The middle and two rings of six, which stand for equal shares of the disc's light.
        let radius_m = self.model.errors.colour_spot_m / 2.0;
        let mut sum = middle.reflects_pct;
        for ring in [0.5, 0.9] {
            for sixth in 0..6 {
                let place =
                    centre + direction(radians(f64::from(sixth) * 60.0)) * (ring * radius_m);
                let light = self.world.floor.at(place).reflects_pct;
                sum.iter_mut().zip(light).for_each(|(sum, light)| *sum += light);
            }
        }
        (middle.colour, sum.map(|pct| pct / 13.0))
    }
}

/// The gyro: an angle that it sums up itself from a rate that it clips.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::sim) struct Gyro {
    scale: f64,
    drift_dps: f64,
    angle_deg: f64,
    rate_dps: f64,
}

impl Gyro {
    /// Fastest turn that it follows, degrees a second (interfaces, GYRO-RATE).
    const CLIP_DPS: f64 = 440.0;

    pub(in crate::sim) fn new(scale_error: f64, drift_dps: f64) -> Self {
        Self { scale: 1.0 + scale_error, drift_dps, angle_deg: 0.0, rate_dps: 0.0 }
    }

    /// Follows the body's turning, anticlockwise; the sensor counts clockwise.
    pub(in crate::sim) fn follow(&mut self, turning_rad_s: f64, step_s: f64) {
        let rate = -degrees(turning_rad_s) * self.scale + self.drift_dps;
        self.rate_dps = rate.clamp(-Self::CLIP_DPS, Self::CLIP_DPS);
        self.angle_deg += self.rate_dps * step_s;
    }

    /// Values in a mode.
    pub(in crate::sim) fn values(&self, mode: &str) -> [i32; 8] {
        // The angle is 16 bits wide on the wire and wraps there.
        let angle = (rounded(self.angle_deg) + 32768).rem_euclid(65536) - 32768;
        let rate = rounded(self.rate_dps);
        match mode {
            "GYRO-ANG" => one(angle),
            "GYRO-RATE" => one(rate),
            "GYRO-FAS" => one(rounded((self.rate_dps * (1500.0 / 2000.0)).clamp(-1464.0, 1535.0))),
            "GYRO-G&A" => [angle, rate, 0, 0, 0, 0, 0, 0],
            _ => [0; 8],
        }
    }
}

pub(super) fn one(value: i32) -> [i32; 8] {
    [value, 0, 0, 0, 0, 0, 0, 0]
}

/// Angles evenly across a beam, both edges and the middle among them.
pub(super) fn fan(half_rad: f64, rays: i32) -> impl Iterator<Item = f64> {
    let steps = f64::from(rays / 2);
    (-(rays / 2)..=rays / 2).map(move |ray| half_rad * f64::from(ray) / steps)
}

/// `IR-REM-A` for a button code of channel 1: bits 4 to 7 red up, red down, blue up, blue down
/// (interfaces section 9).
fn remote_bits(code: i32) -> i32 {
    const RED_UP: i32 = 0x10;
    const RED_DOWN: i32 = 0x20;
    const BLUE_UP: i32 = 0x40;
    const BLUE_DOWN: i32 = 0x80;
    match code {
        1 => 0x100 | RED_UP,
        2 => 0x100 | RED_DOWN,
        3 => 0x100 | BLUE_UP,
        4 => 0x100 | BLUE_DOWN,
        5 => 0x100 | RED_UP | BLUE_UP,
        6 => 0x100 | RED_UP | BLUE_DOWN,
        7 => 0x100 | RED_DOWN | BLUE_UP,
        8 => 0x100 | RED_DOWN | BLUE_DOWN,
        9 => 262,
        10 => 0x100 | RED_UP | RED_DOWN,
        11 => 0x100 | BLUE_UP | BLUE_DOWN,
        _ => 384,
    }
}
