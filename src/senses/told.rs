//! What a device says, for people: with the unit that it has in missions, and not as the driver
//! counts.

use super::{QUANTITIES, Quantity, Source, Unit};
use crate::ev3dev::Driver;
use crate::units::rounded_to;

/// What a sensor measures in a mode, by the name that missions have for it or by what people call
/// the device, and the first value with its unit: `range_m` and `1.50 m` for 1499 of `US-DIST-CM`.
/// `None` for a mode that no quantity comes from.
#[must_use]
pub fn told(driver: Driver, mode: &str, number: i32) -> Option<(&'static str, String)> {
    let of_mode = |source: &&Source| {
        source.driver == driver && source.mode == mode && source.is_first_value()
    };
    let found = QUANTITIES.iter().find_map(|quantity| {
        quantity.sources.iter().find(of_mode).map(|source| (quantity, source))
    });
    let (quantity, source) = found?;
    let name = if quantity.name.is_empty() { quantity.what } else { quantity.name };
    Some((name, quantity.told(source.value_of(number))))
}

impl Quantity {
    /// The least and the greatest value that can come, as conditions see it: where the domain has
    /// no end, what its sensors can say. Infinity for "nothing" is not among them.
    #[must_use]
    pub fn reach(&self) -> (f64, f64) {
        let (low, high) = self.domain;
        let said = |source: &Source| {
            let (first, last) = source.legal;
            // A number that people read: 2.55, and not what 2550 times 0.001 is.
            let value = |number: i32| {
                rounded_to(self.unit.in_conditions(f64::from(number) * source.scale), 1e6)
            };
            [value(first), value(last)]
        };
        let (least, most) = self
            .sources
            .iter()
            .flat_map(said)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), value| {
                (least.min(value), most.max(value))
            });
        let is_said = least <= most;
        (
            if low.is_infinite() && is_said { least } else { low },
            if high.is_infinite() && is_said { most } else { high },
        )
    }

    /// A value for people.
    #[must_use]
    pub fn told(&self, value: f64) -> String {
        if let Some((name, _)) = self.values().find(|(_, known)| (known - value).abs() < 0.5) {
            return name.replace('_', " ");
        }
        if !value.is_finite() {
            let what = if self.unit == Unit::Metres { "no echo" } else { "nothing" };
            return what.to_owned();
        }
        let value = self.unit.in_conditions(value);
        // No zero has a sign.
        let whole = libm::round(value) + 0.0;
        match self.unit {
            Unit::Truth => if value > 0.5 { "yes" } else { "no" }.to_owned(),
            Unit::Number => format!("{whole}"),
            Unit::Percent => format!("{whole} %"),
            Unit::Metres => format!("{value:.2} m"),
            Unit::Radians => format!("{whole}°"),
            Unit::RadiansPerSecond => format!("{whole} °/s"),
            Unit::Volts => format!("{value:.2} V"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_first_value_of_a_mode_is_told_with_its_unit() {
        let told = |driver, mode, number| told(driver, mode, number).unwrap();
        for (driver, mode, number, name, value) in [
            (Driver::Ultrasonic, "US-DIST-CM", 1499, "range_m", "1.50 m"),
            (Driver::Ultrasonic, "US-DIST-CM", 2550, "range_m", "no echo"),
            (Driver::Infrared, "IR-PROX", 50, "range_m", "0.35 m"),
            (Driver::Gyro, "GYRO-ANG", 90, "gyro", "-90°"),
            (Driver::Gyro, "GYRO-ANG", 0, "gyro", "0°"),
            (Driver::Touch, "TOUCH", 1, "touch", "yes"),
            (Driver::Colour, "COL-COLOR", 5, "colour", "red"),
            (Driver::Colour, "COL-REFLECT", 42, "reflect_pct", "42 %"),
            (Driver::Infrared, "IR-REMOTE", 6, "remote", "left up right down"),
        ] {
            assert_eq!(told(driver, mode, number), (name, value.to_owned()), "{mode} {number}");
        }
        assert_eq!(super::told(Driver::Ultrasonic, "US-LISTEN", 1), None);
        for source in QUANTITIES.iter().flat_map(|quantity| quantity.sources) {
            let is_told = super::told(source.driver, source.mode, source.legal.1).is_some();
            let first = QUANTITIES.iter().flat_map(|quantity| quantity.sources).any(|other| {
                (other.driver, other.mode) == (source.driver, source.mode) && other.is_first_value()
            });
            assert_eq!(is_told, first, "{}", source.mode);
        }
    }
}
