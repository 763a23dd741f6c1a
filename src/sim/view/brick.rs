//! What of a brick's devices a person is shown: what a program would read now.

use super::{DeviceView, Light};
use crate::ev3dev::{Hue, Lamp};
use crate::printable;
use crate::senses;
use crate::sim::brick::{Brick, Class};
use crate::sim::driver::Identity;

/// Furthest that the ultrasonic measures, in the numbers of its two units; what it says without an
/// echo.
const FAR: [(&str, f64, f64); 2] = [("CM", 2550.0, 0.001), ("IN", 1003.0, 0.002_54)];

/// One per cent of infrared proximity, metres: 100 % are about 70 cm (interfaces 9).
const INFRARED_M: f64 = 0.007;

impl Brick {
    /// The devices on the ports, in the order of the ports.
    pub(crate) fn device_views(&self) -> Vec<DeviceView> {
        let mut views: Vec<DeviceView> = [Class::Sensor, Class::TachoMotor, Class::DcMotor]
            .into_iter()
            .flat_map(|class| {
                self.names(class).filter_map(move |name| self.device_view(class, name))
            })
            .collect();
        views.sort_by_key(|view| view.port);
        views
    }

    fn device_view(&self, class: Class, name: &str) -> Option<DeviceView> {
        let id = self.find(class.as_str(), name)?;
        let read = |attribute: &str| {
            let mut text = Vec::new();
            match self.read(id, attribute, &mut text) {
                Ok(()) => shown(&text),
                Err(errno) => format!("{errno:?}"),
            }
        };
        let (state, value) = match class {
            Class::Sensor => ("mode", "value0"),
            Class::DcMotor => ("state", "duty_cycle"),
            _ => ("state", "speed"),
        };
        let Identity { driver_name: driver, address } = self.node(id)?.identity.as_ref()?;
        let (state, value) = (read(state), read(value));
        let (what, told) = match value.parse::<i32>() {
            Ok(number) if class == Class::Sensor => told(driver, &state, number),
            Ok(number) => (moves(&state), speed(number, class, read)),
            Err(_) => (state.clone(), value.clone()),
        };
        Some(DeviceView {
            port: crate::sim::Port::named(address)?.as_str(),
            name: name.to_owned(),
            driver,
            state,
            value,
            what,
            told,
        })
    }

    /// The lights of the brick, left and right; a light of one LED shines in both colours.
    pub(crate) fn lights(&self) -> [Light; 2] {
        let part = |lamps: &[Lamp], hue: Hue| {
            let lamp = lamps.iter().find(|lamp| lamp.hue == hue || lamp.hue == Hue::Only);
            lamp.and_then(|lamp| self.led(lamp.led)).map_or(0, |(brightness, _)| brightness)
        };
        self.board
            .platform
            .lights
            .map(|lamps| Light { red: part(lamps, Hue::Red), green: part(lamps, Hue::Green) })
    }
}

/// What a sensor measures, and the value with its unit; the driver's own words for a mode that no
/// robot of ours uses.
fn told(driver: &str, mode: &str, number: i32) -> (String, String) {
    let known = driver.parse().ok().and_then(|driver| senses::told(driver, mode, number));
    known.map_or_else(
        || (mode.to_owned(), number.to_string()),
        |(what, told)| (what.to_owned(), told),
    )
}

/// What a motor does.
fn moves(state: &str) -> String {
    if state.is_empty() { "still" } else { state }.to_owned()
}

/// How fast a motor turns; without an encoder, how hard it is driven.
fn speed(number: i32, class: Class, read: impl Fn(&str) -> String) -> String {
    if class == Class::DcMotor {
        return format!("{number} %");
    }
    let counts = |attribute: &str| read(attribute).parse::<f64>().ok().filter(|count| *count > 0.0);
    let number = f64::from(number);
    match (counts("count_per_rot"), counts("count_per_m")) {
        (Some(per_rot), _) => format!("{:.0} °/s", number * 360.0 / per_rot + 0.0),
        (_, Some(per_m)) => format!("{:.0} mm/s", number * 1000.0 / per_m + 0.0),
        (None, None) => format!("{number} counts/s"),
    }
}

/// A text that may be garbage, as it can be shown: the beginning of its first line.
fn shown(text: &[u8]) -> String {
    let line = text.split(|byte| *byte == b'\n').next().unwrap_or_default();
    printable::name(&String::from_utf8_lossy(line)).into_owned()
}

/// For a range sensor: what it says in metres, with nothing for no echo and for no answer.
#[expect(clippy::option_option, reason = "no range sensor, and no echo")]
pub(super) fn sighted_m(device: &DeviceView) -> Option<Option<f64>> {
    let value: Option<f64> = device.value.parse().ok();
    match device.driver {
        "lego-ev3-us" => {
            let far = FAR.iter().find(|(unit, ..)| device.state.ends_with(unit));
            let echo = value.zip(far).filter(|(value, (_, far, _))| (0.0..*far).contains(value));
            Some(echo.map(|(value, (_, _, metres))| value * metres))
        }
        "lego-ev3-ir" => {
            let echo =
                value.filter(|value| device.state == "IR-PROX" && (0.0..100.0).contains(value));
            Some(echo.map(|value| value * INFRARED_M))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device(driver: &'static str, state: &str, value: &str) -> DeviceView {
        let [state, value] = [state, value].map(str::to_owned);
        let [name, what, told] = ["sensor0", "", ""].map(str::to_owned);
        DeviceView { port: "in1", name, driver, state, value, what, told }
    }

    #[test]
    fn speeds_have_units_and_unknown_modes_the_drivers_words() {
        let rotary = |attribute: &str| match attribute {
            "count_per_rot" => "720".to_owned(),
            _ => "ENOENT".to_owned(),
        };
        assert_eq!(speed(300, Class::TachoMotor, rotary), "150 °/s");
        let linear = |attribute: &str| match attribute {
            "count_per_m" => "2000".to_owned(),
            _ => "ENOENT".to_owned(),
        };
        assert_eq!(speed(-50, Class::TachoMotor, linear), "-25 mm/s");
        assert_eq!(speed(-50, Class::DcMotor, linear), "-50 %");
        let [mode, one] = ["US-LISTEN", "1"].map(str::to_owned);
        assert_eq!(told("lego-ev3-us", "US-LISTEN", 1), (mode, one));
    }

    #[test]
    fn echoes_are_in_metres_and_no_echo_is_none() {
        let near = |echo: Option<Option<f64>>, metres: f64| {
            assert!(
                echo.flatten().is_some_and(|found| (found - metres).abs() < 1e-9),
                "{echo:?} is not {metres}"
            );
        };
        near(sighted_m(&device("lego-ev3-us", "US-DIST-CM", "1234")), 1.234);
        near(sighted_m(&device("lego-ev3-us", "US-DIST-IN", "100")), 0.254);
        near(sighted_m(&device("lego-ev3-ir", "IR-PROX", "50")), 0.35);
        for (state, value) in [
            ("US-DIST-CM", "2550"),
            ("US-DIST-CM", "ENXIO"),
            ("US-LISTEN", "1"),
            ("US-DIST-CM", "-7"),
        ] {
            assert_eq!(
                sighted_m(&device("lego-ev3-us", state, value)),
                Some(None),
                "{state} {value}"
            );
        }
        assert_eq!(sighted_m(&device("lego-ev3-gyro", "GYRO-ANG", "5")), None);
    }
}
