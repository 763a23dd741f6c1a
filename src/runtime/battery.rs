//! A battery that gets low during a run: warn, slow down, stop.
//!
//! A voltage sags for moments while motors start, so a threshold counts when the voltage has been
//! below it for [`HOLD_NS`]. A battery is not charged while a robot drives, so what was reached
//! stays reached until the run is over: a robot that slows down, whose voltage then recovers, does
//! not speed up again.

use serde::{Deserialize, Serialize};

use super::StopReason;
use crate::behavior::{Demands, Drive};
use crate::clock::SECOND_NS;
use crate::ev3dev::LightColour;
use crate::robot::BatteryLimits;

/// For how long the voltage must be below a threshold, nanoseconds: it is read once a second, so
/// three readings agree.
pub const HOLD_NS: i64 = 2 * SECOND_NS;

/// What share of the demanded speed a robot drives at when its battery is very low.
pub const SLOW_SHARE: f64 = 0.5;

/// How the battery is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, thiserror::Error)]
pub enum Charge {
    /// Nothing to worry about.
    #[default]
    #[error("the battery is good")]
    Good,
    /// A person is warned, and the brick's lights are orange, as under LEGO's firmware.
    #[error("the battery is low: charge it soon, or have fresh cells ready")]
    Low,
    /// The robot drives at [`SLOW_SHARE`] of what is demanded.
    #[error("the battery is very low: driving at half the speed")]
    VeryLow,
    /// The run ends.
    #[error("{}", StopReason::Battery)]
    Empty,
}

/// Watches the voltage.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct BatteryWatch {
    /// Since when the voltage has been below each threshold, the highest first; [`ABOVE`] where it
    /// is not.
    since_ns: [i64; 3],
    /// How many thresholds were reached.
    reached: u8,
}

/// The voltage is above the threshold.
const ABOVE: i64 = i64::MAX;

impl Default for BatteryWatch {
    fn default() -> Self {
        Self { since_ns: [ABOVE; 3], reached: 0 }
    }
}

impl BatteryWatch {
    /// One tick, with the last voltage that was read; without one nothing is known, and nothing
    /// changes.
    pub(super) fn step(
        &mut self,
        limits: &BatteryLimits,
        time_ns: i64,
        volts: Option<f64>,
    ) -> Charge {
        if let Some(volts) = volts {
            let thresholds = [limits.warn_v, limits.slow_v, limits.stop_v];
            for ((since_ns, threshold_v), count) in
                self.since_ns.iter_mut().zip(thresholds).zip(1..)
            {
                *since_ns = if volts < threshold_v { time_ns.min(*since_ns) } else { ABOVE };
                if time_ns.saturating_sub(*since_ns) >= HOLD_NS {
                    self.reached = self.reached.max(count);
                }
            }
        }
        self.charge()
    }

    fn charge(self) -> Charge {
        match self.reached {
            0 => Charge::Good,
            1 => Charge::Low,
            2 => Charge::VeryLow,
            _ => Charge::Empty,
        }
    }
}

impl Charge {
    /// Changes what the machines want to what the battery allows. The head is not slowed down: it
    /// takes little, and a mission's view of the room depends on it.
    pub(super) fn limit(self, demands: &mut Demands) {
        if self >= Self::Low {
            demands.led = Some(LightColour::Orange);
        }
        if self >= Self::VeryLow {
            demands.drive = demands.drive.map(slowed);
            demands.motors = demands.motors.map(|speed| speed.map(|rad_s| rad_s * SLOW_SHARE));
        }
    }
}

fn slowed(drive: Drive) -> Drive {
    match drive {
        Drive::Wheels { left_rad_s, right_rad_s } => Drive::Wheels {
            left_rad_s: left_rad_s * SLOW_SHARE,
            right_rad_s: right_rad_s * SLOW_SHARE,
        },
        Drive::Twist { forward_m_s, turn_rad_s } => Drive::Twist {
            forward_m_s: forward_m_s * SLOW_SHARE,
            turn_rad_s: turn_rad_s * SLOW_SHARE,
        },
        Drive::Stop(action) => Drive::Stop(action),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::nanoseconds;
    use crate::ev3dev::Technology;

    /// The charge at each second of a course of voltages.
    fn course(volts: impl IntoIterator<Item = Option<f64>>) -> Vec<Charge> {
        let limits = BatteryLimits::of(Technology::Unknown);
        let mut watch = BatteryWatch::default();
        let seconds = volts.into_iter().zip(0_u32..);
        seconds
            .map(|(volts, second)| watch.step(&limits, nanoseconds(f64::from(second)), volts))
            .collect()
    }

    #[test]
    fn a_battery_that_runs_down_is_low_then_very_low_then_empty() {
        // 8 V to 5 V in a minute: below 6.2 V from 36 s on, below 5.5 V from 50 s, below 5.2 V from
        // 56 s.
        let charges = course((0..60).map(|second| Some(7.99 - 0.05 * f64::from(second))));
        let at = |charge| charges.iter().position(|&reached| reached == charge).unwrap();
        assert_eq!([at(Charge::Low), at(Charge::VeryLow), at(Charge::Empty)], [38, 52, 58]);
        assert!(charges.is_sorted());
    }

    #[test]
    fn a_sag_of_a_moment_is_nothing_and_what_was_reached_stays() {
        let sags = course((0..60).map(|second| Some(if second % 3 == 2 { 7.0 } else { 5.0 })));
        assert_eq!(sags.last(), Some(&Charge::Good));
        let recovered = course([5.4, 5.4, 5.4, 7.0, 7.0, 7.0].map(Some));
        assert_eq!(recovered.last(), Some(&Charge::VeryLow), "{recovered:?}");
    }

    #[test]
    fn a_voltage_that_cannot_be_read_changes_nothing() {
        assert_eq!(course([None; 20]).last(), Some(&Charge::Good));
        let held = course([Some(5.0), None, None, None, Some(5.0)]);
        assert_eq!(
            held.last(),
            Some(&Charge::Empty),
            "it was below before and is below after: {held:?}"
        );
    }

    #[test]
    fn a_very_low_battery_halves_what_is_demanded_and_a_stop_stays_one() {
        let wheels = Drive::Wheels { left_rad_s: 2.0, right_rad_s: -1.0 };
        let mut demands = Demands { drive: Some(wheels), ..Demands::default() };
        Charge::Low.limit(&mut demands);
        assert_eq!((demands.drive, demands.led), (Some(wheels), Some(LightColour::Orange)));
        demands.motors[1] = Some(3.0);
        Charge::VeryLow.limit(&mut demands);
        assert_eq!(demands.drive, Some(Drive::Wheels { left_rad_s: 1.0, right_rad_s: -0.5 }));
        assert_eq!(demands.motors[1], Some(1.5));
        let stop = Some(Drive::Stop(crate::ev3dev::StopAction::Brake));
        let mut demands = Demands { drive: stop, ..Demands::default() };
        Charge::VeryLow.limit(&mut demands);
        assert_eq!(demands.drive, stop);
    }
}
