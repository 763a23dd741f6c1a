//! Poses in the plane and what can be done with them.

use nalgebra::{Isometry2, Point2, Vector2};
use serde::{Deserialize, Serialize};

/// A pose in the plane, world frame: x ahead of the start, y left, heading anticlockwise from x.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose {
    /// Metres.
    pub x_m: f64,
    /// Metres.
    pub y_m: f64,
    /// Radians; it does not wrap, so that turns can be counted.
    pub heading_rad: f64,
}

impl Pose {
    /// The transform that takes points of this pose's frame (x ahead, y left) to the world's.
    #[must_use]
    pub fn body_to_world(&self) -> Isometry2<f64> {
        Isometry2::new(Vector2::new(self.x_m, self.y_m), self.heading_rad)
    }

    /// A point of this pose's frame, in metres, in the world's frame.
    #[must_use]
    pub fn place(&self, x_m: f64, y_m: f64) -> [f64; 2] {
        let placed = self.body_to_world() * Point2::new(x_m, y_m);
        [placed.x, placed.y]
    }

    /// The pose that is `step` when seen from this one; headings add up without wrapping.
    #[must_use]
    pub fn then(&self, step: &Self) -> Self {
        let [x_m, y_m] = self.place(step.x_m, step.y_m);
        Self { x_m, y_m, heading_rad: self.heading_rad + step.heading_rad }
    }

    /// The pose of the world's origin when seen from this one.
    #[must_use]
    pub(super) fn inverse(&self) -> Self {
        let back = self.body_to_world().inverse().translation;
        Self { x_m: back.x, y_m: back.y, heading_rad: -self.heading_rad }
    }

    /// The pose at `share` of the way (0 to 1) from this one to `next`, each number on its straight
    /// line.
    #[must_use]
    pub(super) fn toward(&self, next: &Self, share: f64) -> Self {
        Self {
            x_m: self.x_m + (next.x_m - self.x_m) * share,
            y_m: self.y_m + (next.y_m - self.y_m) * share,
            heading_rad: self.heading_rad + (next.heading_rad - self.heading_rad) * share,
        }
    }

    /// Number by number, in the world's frame.
    #[must_use]
    pub(super) fn plus(&self, other: &Self) -> Self {
        Self {
            x_m: self.x_m + other.x_m,
            y_m: self.y_m + other.y_m,
            heading_rad: self.heading_rad + other.heading_rad,
        }
    }

    /// Whether every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.x_m.is_finite() && self.y_m.is_finite() && self.heading_rad.is_finite()
    }
}

/// By how much the pose was corrected, and with it what was placed by it lately.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Correction {
    pub from: Pose,
    pub to: Pose,
}

impl Correction {
    /// Moves a place and a direction of the map as it was to where they are in the map as it is.
    pub(super) fn apply(&self, x_m: &mut f64, y_m: &mut f64, direction_rad: &mut f64) {
        let (sin, cos) = libm::sincos(self.turn_rad());
        let (from_x_m, from_y_m) = (*x_m - self.from.x_m, *y_m - self.from.y_m);
        *x_m = self.to.x_m + cos * from_x_m - sin * from_y_m;
        *y_m = self.to.y_m + sin * from_x_m + cos * from_y_m;
        self.turn(direction_rad);
    }

    /// The same for a direction alone.
    pub(super) fn turn(&self, direction_rad: &mut f64) {
        *direction_rad += self.turn_rad();
    }

    /// What undoes it, number by number.
    pub(super) fn back(&self) -> Pose {
        Pose {
            x_m: self.from.x_m - self.to.x_m,
            y_m: self.from.y_m - self.to.y_m,
            heading_rad: -self.turn_rad(),
        }
    }

    fn turn_rad(&self) -> f64 {
        self.to.heading_rad - self.from.heading_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn a_point_ahead_of_a_robot_that_looks_left_lies_to_the_left() {
        let pose = Pose { x_m: 3.0, y_m: 0.0, heading_rad: FRAC_PI_2 };
        let [x_m, y_m] = pose.place(1.0, 0.0);
        assert!((x_m - 3.0).abs() < 1e-12 && (y_m - 1.0).abs() < 1e-12, "({x_m}, {y_m}) m");
    }

    #[test]
    fn four_steps_with_quarter_turns_come_back_and_count_the_turn() {
        let side = Pose { x_m: 1.0, y_m: 0.0, heading_rad: FRAC_PI_2 };
        let round = (0..4).fold(Pose::default(), |pose, _| pose.then(&side));
        assert!(round.x_m.abs() < 1e-12 && round.y_m.abs() < 1e-12, "{round:?}");
        assert!((round.heading_rad - 4.0 * FRAC_PI_2).abs() < 1e-12, "{round:?}");
    }

    #[test]
    fn a_pose_and_its_inverse_are_none() {
        let pose = Pose { x_m: 1.0, y_m: -2.0, heading_rad: 0.3 };
        let Pose { x_m, y_m, heading_rad } = pose.then(&pose.inverse());
        assert!(x_m.abs() + y_m.abs() + heading_rad.abs() < 1e-12, "{x_m} {y_m} {heading_rad}");
    }

    #[test]
    fn a_correction_takes_its_own_pose_along_and_what_stands_before_it() {
        let from = Pose { x_m: 1.0, y_m: 2.0, heading_rad: 0.3 };
        let to = Pose { x_m: 1.1, y_m: 1.9, heading_rad: 0.3 + FRAC_PI_2 };
        let correction = Correction { from, to };
        for ahead_m in [0.0, 1.5] {
            let ([mut x_m, mut y_m], mut direction_rad) = (from.place(ahead_m, 0.2), 0.3);
            correction.apply(&mut x_m, &mut y_m, &mut direction_rad);
            let [to_x_m, to_y_m] = to.place(ahead_m, 0.2);
            assert!((x_m - to_x_m).abs() < 1e-12 && (y_m - to_y_m).abs() < 1e-12, "{x_m} {y_m}");
            assert!((direction_rad - to.heading_rad).abs() < 1e-12);
        }
        let back = to.plus(&correction.back());
        assert!((back.x_m - from.x_m).abs() + (back.heading_rad - 0.3).abs() < 1e-12, "{back:?}");
    }
}
