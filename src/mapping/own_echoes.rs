//! Echoes of the robot's own body: at fixed angles of the head, always the same distance.
//!
//! Two of nine LEGO robots hear themselves so, at 19 to 22 cm (`lego-rotating-sonar`). Such a
//! reading says nothing of the room: it is no echo, and what lies behind it is not free. What is
//! nearer than the robot's own part is heard as ever.
//!
//! # Not here
//!
//! Finding them: `onbrick calibrate` does, at standstill.

use crate::units::wrap_rad;

/// Readings as near to the learnt distance as this are of the same part, metres.
const SAME_M: f64 = 0.02;
/// The head is as far from where it was read as this, radians: 4°.
const BESIDE_RAD: f64 = 0.07;

/// A part of the robot that the range sensor hears.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OwnEcho {
    /// From this angle of the head on, radians anticlockwise from straight ahead, −π to π.
    pub from_rad: f64,
    /// Up to this one, anticlockwise from the first.
    pub to_rad: f64,
    /// What the sensor says there, metres, as it says it.
    pub range_m: f64,
}

/// Where a robot hears itself; a fixed number of places.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OwnEchoes([Option<OwnEcho>; OwnEchoes::MAX]);

impl OwnEchoes {
    /// How many there can be.
    pub const MAX: usize = 8;
    /// How far off a part of the robot can be, metres.
    pub const RANGE_M: std::ops::RangeInclusive<f64> = 0.01..=0.5;

    /// The first [`OwnEchoes::MAX`] of them.
    #[must_use]
    pub fn of(echoes: impl IntoIterator<Item = OwnEcho>) -> Self {
        let mut own = Self::default();
        own.0.iter_mut().zip(echoes).for_each(|(place, echo)| *place = Some(echo));
        own
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = &OwnEcho> {
        self.0.iter().flatten()
    }

    /// Whether a reading, metres, at an angle of the head is the robot itself.
    #[must_use]
    pub fn has(&self, head_rad: f64, reading_m: f64) -> bool {
        self.iter().any(|own| {
            let middle_rad = own.from_rad + turn(own.to_rad - own.from_rad) / 2.0;
            let half_rad = turn(own.to_rad - own.from_rad) / 2.0 + BESIDE_RAD;
            (reading_m - own.range_m).abs() <= SAME_M
                && wrap_rad(head_rad - middle_rad).abs() <= half_rad
        })
    }
}

/// An angle as an anticlockwise turn, 0 to 2π.
fn turn(angle_rad: f64) -> f64 {
    let wrapped = wrap_rad(angle_rad);
    if wrapped < 0.0 { wrapped + 2.0 * std::f64::consts::PI } else { wrapped }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::radians;

    #[test]
    fn a_reading_is_the_robots_own_at_its_angles_and_distance_alone() {
        let behind = OwnEcho { from_rad: radians(170.0), to_rad: radians(-170.0), range_m: 0.2 };
        let own = OwnEchoes::of([behind]);
        #[rustfmt::skip]
        let readings = [
            // head, degrees  reading, m  own
            ( 180.0,          0.20,       true),
            ( 540.0,          0.21,       true),
            ( 167.0,          0.19,       true),
            (-167.0,          0.20,       true),
            ( 160.0,          0.20,       false),
            (   0.0,          0.20,       false),
            ( 180.0,          0.15,       false),
            ( 180.0,          0.30,       false),
        ];
        for (head_deg, reading_m, is_own) in readings {
            assert_eq!(own.has(radians(head_deg), reading_m), is_own, "{head_deg}, {reading_m}");
        }
        assert!(!OwnEchoes::default().has(0.0, 0.2), "a robot without any");
        assert_eq!(OwnEchoes::of([behind; 20]).iter().count(), OwnEchoes::MAX);
    }
}
