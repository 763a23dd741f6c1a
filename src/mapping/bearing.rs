//! Where in its cone a sonar's echo comes from.
//!
//! The sensor hears the nearest thing in a cone of 14° to each side and does not say where in the
//! cone it is. Seen from the axis, a wall that is met obliquely therefore curls towards the sensor
//! at its ends: at 45° by a fifth of its distance. A sweep tells more than a reading: while the
//! head turns past a wall, the nearest place of it is
//!
//! - at the foot of the perpendicular, as long as that is in the cone: the range does not change;
//! - else at the cone's edge on the side on which the range falls, and then the range changes as
//!   the tangent of the angle at which that edge meets the wall (with bearing b, dr/db = r tan).
//!
//! So the echo is taken to be off the axis towards falling ranges, by the whole half cone where the
//! range changes as on a wall met at [`STEEP`] or more, and in proportion below. What comes into
//! view, out of nothing or before something farther, does so at the edge that leads the sweep.
//! (Constant and changing range as two kinds of regions of a sweep: Leonard and Durrant-Whyte,
//! *Directed sonar sensing for mobile robot navigation*, 1992; the nearest echo in a cone fits the
//! scans in `lego-rotating-sonar`.)
//!
//! # Not here
//!
//! A post or an edge that echoes to every side gives a constant range too, over the whole width of
//! the cone: its arc stays an arc.

use serde::{Deserialize, Serialize};

use super::pose::Correction;
use super::range::Beam;

/// dr/db / r from which on the echo is at the edge: the tangent of 7°. Ranges are noisy by half a
/// centimetre.
const STEEP: f64 = 0.12;
/// No surface that echoes changes the range faster than this over the bearing: the tangent of 40°.
const STEEPEST: f64 = 0.84;
/// What noise may add to that, metres.
const NOISE_M: f64 = 0.03;
/// Bearings nearer than this to each other say nothing of a slope, radians: 1.4°.
const SPREAD_RAD: f64 = 0.025;
/// Soundings further apart than this are no sweep any more, radians.
pub(super) const SWEEP_RAD: f64 = 0.35;

/// The soundings before, as far as they are of the same sweep.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Slope {
    last: Option<Heard>,
    before: Option<Heard>,
    /// The direction that the last echo was taken to come from.
    echo_rad: f64,
}

/// An echo: how far, in which direction of the beam, and where the sensor was.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Heard {
    range_m: f64,
    bearing_rad: f64,
    x_m: f64,
    y_m: f64,
}

impl Slope {
    /// Takes an echo of the same sweep; returns how far off the beam's axis it is, radians
    /// anticlockwise, at most the half cone.
    ///
    /// - `bearing_rad`: the beam's direction in the world, without a wrap.
    /// - `swept_rad`: how far it has turned since the last sounding, echo or not.
    pub(super) fn off_axis_rad(
        &mut self,
        beam: &Beam,
        bearing_rad: f64,
        range_m: f64,
        swept_rad: f64,
        half_cone_rad: f64,
    ) -> f64 {
        let now = Heard { range_m, bearing_rad, x_m: beam.x_m, y_m: beam.y_m };
        let share = self.share(&now, beam, swept_rad);
        let off_rad = match share {
            Some(share) => share * half_cone_rad,
            // The head stands: the echo comes from where it came from.
            None => (self.echo_rad - bearing_rad).clamp(-half_cone_rad, half_cone_rad),
        };
        self.echo_rad = bearing_rad + off_rad;
        off_rad
    }

    /// Moves what is known with the map.
    pub(super) fn correct(&mut self, correction: &Correction) {
        for heard in [&mut self.last, &mut self.before].into_iter().flatten() {
            correction.apply(&mut heard.x_m, &mut heard.y_m, &mut heard.bearing_rad);
        }
        correction.turn(&mut self.echo_rad);
    }

    /// The share of the half cone by which the echo is off the axis, −1 to 1; `None` where nothing
    /// new can be said.
    fn share(&mut self, now: &Heard, beam: &Beam, swept_rad: f64) -> Option<f64> {
        let leading = if swept_rad.abs() < SPREAD_RAD { 0.0 } else { swept_rad.signum() };
        let Some(last) = self.last else {
            (self.last, self.before) = (Some(*now), None);
            return Some(leading);
        };
        let turned_rad = now.bearing_rad - last.bearing_rad;
        if turned_rad.abs() < SPREAD_RAD {
            // Later bearings are compared with the one from which on the head stood.
            return None;
        }
        let grown_m = last.grown_m(now, beam);
        let most_m = most_grown_m(turned_rad, now.range_m.min(last.range_m));
        let before = self.before.filter(|before| {
            let onward = (last.bearing_rad - before.bearing_rad) * turned_rad > 0.0;
            onward && (now.bearing_rad - before.bearing_rad).abs() < SWEEP_RAD
        });
        self.before = Some(last);
        self.last = Some(*now);
        if grown_m.abs() > most_m {
            self.before = None;
            return Some(if grown_m < 0.0 { leading } else { 0.0 });
        }
        // Over two steps the noise weighs half as much.
        let from = before.unwrap_or(last);
        let slope = from.grown_m(now, beam)
            / ((now.bearing_rad - from.bearing_rad) * now.range_m.max(0.05));
        Some((-slope / STEEP).clamp(-1.0, 1.0))
    }
}

/// What a range can change by over a turn of the beam while it stays on one surface, metres.
pub(super) fn most_grown_m(turned_rad: f64, range_m: f64) -> f64 {
    STEEPEST * turned_rad.abs() * range_m + NOISE_M
}

impl Heard {
    /// By how much the range has grown to `now`, what the sensor's own way along the beam explains
    /// left out, metres.
    fn grown_m(&self, now: &Self, beam: &Beam) -> f64 {
        let nearer_m = (now.x_m - self.x_m) * beam.cos + (now.y_m - self.y_m) * beam.sin;
        now.range_m - self.range_m + nearer_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::Range;
    use crate::units::{degrees, radians};

    const HALF_RAD: f64 = 14.0 * std::f64::consts::PI / 180.0;

    /// What a sensor at the origin hears of a wall one metre ahead, as wide as the incidence of 32°
    /// lets it be seen.
    fn wall(bearing_deg: f64) -> Range {
        let nearest_deg = (bearing_deg.abs() - 14.0).max(0.0);
        if nearest_deg > 32.0 {
            Range::NoEcho
        } else {
            Range::Echo(1.0 / libm::cos(radians(nearest_deg)))
        }
    }

    /// The x of each point of a sweep, with its bearing.
    fn sweep(
        bearings_deg: impl Iterator<Item = f64>,
        hear: impl Fn(f64) -> Range,
    ) -> Vec<(f64, f64, f64)> {
        let mut sweep = Slope::default();
        let mut last_deg = None;
        bearings_deg
            .filter_map(|bearing_deg| {
                let bearing_rad = radians(bearing_deg);
                let beam = Beam {
                    x_m: 0.0,
                    y_m: 0.0,
                    cos: libm::cos(bearing_rad),
                    sin: libm::sin(bearing_rad),
                };
                let swept_deg =
                    last_deg.replace(bearing_deg).map_or(0.0, |last| bearing_deg - last);
                let Range::Echo(range_m) = hear(bearing_deg) else { return None };
                let off_rad =
                    sweep.off_axis_rad(&beam, bearing_rad, range_m, radians(swept_deg), HALF_RAD);
                Some((
                    bearing_deg,
                    range_m * libm::cos(bearing_rad + off_rad),
                    range_m * libm::cos(bearing_rad),
                ))
            })
            .collect()
    }

    #[test]
    fn a_wall_swept_past_is_straight_to_both_ends() {
        for direction in [1.0, -1.0] {
            let points = sweep((-16..=16).map(|step| direction * 4.3 * f64::from(step)), wall);
            let worst = |along: fn(&(f64, f64, f64)) -> f64| {
                points.iter().map(|point| (along(point) - 1.0).abs()).fold(0.0, f64::max)
            };
            let (placed_m, axis_m) = (worst(|point| point.1), worst(|point| point.2));
            assert!(points.len() > 18, "{} points", points.len());
            assert!(axis_m > 0.15, "on the axis the ends curl by {axis_m} m");
            assert!(placed_m < 0.05, "placed they curl by {placed_m} m: {points:?}");
        }
    }

    #[test]
    fn a_standing_head_hears_the_same_place_on() {
        let mut bearings: Vec<f64> = (-10..=-6).map(|step| 4.3 * f64::from(step)).collect();
        bearings.extend([-25.8; 5]);
        let points = sweep(bearings.into_iter(), wall);
        for (bearing_deg, placed_m, axis_m) in &points[5..] {
            assert!(
                (placed_m - 1.0).abs() < 0.03,
                "{placed_m} m at {bearing_deg} degrees, {axis_m} on the axis"
            );
        }
    }

    #[test]
    fn what_comes_into_view_does_so_at_the_leading_edge() {
        // A post's near side in front of a wall: nearer by more than any wall allows.
        let mut sweep = Slope::default();
        let beam = Beam { x_m: 0.0, y_m: 0.0, cos: 1.0, sin: 0.0 };
        let step_rad = radians(4.3);
        let mut hear = |bearing_deg: f64, range_m: f64| {
            let bearing_rad = radians(bearing_deg);
            degrees(sweep.off_axis_rad(&beam, bearing_rad, range_m, step_rad, HALF_RAD))
        };
        hear(0.0, 1.0);
        assert!(hear(4.3, 1.0).abs() < 1e-9, "a constant range is on the axis");
        assert!((hear(8.6, 0.5) - 14.0).abs() < 1e-9, "nearer: at the leading edge");
        assert!(hear(12.9, 0.5).abs() < 1e-9, "then constant again");
        assert!(hear(17.2, 1.0).abs() < 1e-9, "farther: nothing is known");
    }

    #[test]
    fn driving_towards_a_wall_is_no_slope() {
        let mut sweep = Slope::default();
        for step in 0..10 {
            let x_m = 0.02 * f64::from(step);
            let beam = Beam { x_m, y_m: 0.0, cos: 1.0, sin: 0.0 };
            let bearing_rad = 0.03 * f64::from(step);
            let off_rad = sweep.off_axis_rad(&beam, bearing_rad, 1.0 - x_m, 0.03, HALF_RAD);
            assert!(step == 0 || off_rad.abs() < 1e-9, "{off_rad} rad at {x_m} m");
        }
    }
}
