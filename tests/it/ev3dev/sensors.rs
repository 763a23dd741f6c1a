//! Sensors: every mode of every one, frames, changes of mode, and what is refused.

use std::time::Duration;

use nix::errno::Errno;
use onbrick::clock::MILLISECOND_NS;
use onbrick::ev3dev::{
    Cause, Colour, ColourMode, ColourSensor, Driver, FindError, GyroMode, GyroReset, GyroSensor,
    InfraredMode, InfraredSensor, Legal, RemoteCode, Sensor, SensorMode, TouchMode, TouchSensor,
    TypedSensor, UltrasonicMode, UltrasonicSensor, settle_ns,
};
use onbrick::units::radians;
use proptest::prelude::*;

use crate::support::allocations::allocations;
use crate::support::brick::{FakeTree, SENSOR, plug_sensor};

const COLOUR_MODES: &str = "COL-REFLECT COL-AMBIENT COL-COLOR REF-RAW RGB-RAW COL-CAL\n";
const ULTRASONIC_MODES: &str =
    "US-DIST-CM US-DIST-IN US-LISTEN US-SI-CM US-SI-IN US-DC-CM US-DC-IN\n";
const GYRO_MODES: &str = "GYRO-ANG GYRO-RATE GYRO-FAS GYRO-G&A GYRO-CAL TILT-RATE TILT-ANG\n";
const INFRARED_MODES: &str = "IR-PROX IR-SEEK IR-REMOTE IR-REM-A IR-S-ALT IR-CAL\n";

fn typed<M: SensorMode>(modes: &str) -> (FakeTree, TypedSensor<M>) {
    let fake = FakeTree::default();
    plug_sensor(&fake, SENSOR, "ev3-ports:in1\n", &format!("{}\n", M::DRIVER), modes);
    let sensor = TypedSensor::find(&fake.tree(), None).unwrap();
    (fake, sensor)
}

/// A mode as the driver describes it, with the bytes of one frame.
fn frame(fake: &FakeTree, num_values: &str, format: &str, bytes: &[u8]) {
    fake.put(SENSOR, "num_values", num_values.as_bytes());
    fake.put(SENSOR, "bin_data_format", format.as_bytes());
    let mut whole = [0xaa; 32];
    whole[..bytes.len()].copy_from_slice(bytes);
    fake.put(SENSOR, "bin_data", &whole);
}

fn value0(fake: &FakeTree, value: i32) {
    fake.put(SENSOR, "value0", format!("{value}\n").as_bytes());
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() < 1e-12
}

#[test]
fn touch_is_pressed_or_not() {
    let (fake, sensor) = typed::<TouchMode>("TOUCH\n");
    assert!(!sensor.is_pressed().unwrap());
    value0(&fake, 1);
    assert!(sensor.is_pressed().unwrap());
    value0(&fake, 2);
    assert_eq!(sensor.is_pressed().unwrap_err().cause, Cause::Malformed(Legal::Range(0, 1)));
    frame(&fake, "1", "s32", &[0xfb, 0, 0, 0]);
    let sensor = TouchSensor::find(&fake.tree(), None).unwrap();
    assert!(near(sensor.pin_v().unwrap(), 0.251));
    assert!(sensor.wait_changed(Duration::ZERO).unwrap());
}

#[test]
fn colour_reflected_and_ambient_light() {
    let (fake, mut sensor) = typed::<ColourMode>(COLOUR_MODES);
    value0(&fake, 57);
    assert_eq!(sensor.reflected_pct().unwrap(), 57.0);
    assert!(matches!(sensor.ambient_pct().unwrap_err().cause, Cause::Refused { errno: None, .. }));
    sensor.set_mode(ColourMode::Ambient).unwrap();
    assert_eq!(sensor.ambient_pct().unwrap(), 57.0);
    // A frame of a mode that was in force before can look like this.
    value0(&fake, -128);
    assert_eq!(sensor.ambient_pct().unwrap_err().cause, Cause::Malformed(Legal::Range(0, 100)));
}

#[test]
fn colours_are_told_by_their_numbers() {
    let (fake, mut sensor) = typed::<ColourMode>(COLOUR_MODES);
    sensor.set_mode(ColourMode::Colour).unwrap();
    for (number, colour) in (0..).zip(Colour::ALL) {
        value0(&fake, number);
        assert_eq!(sensor.colour().unwrap(), *colour);
        assert_eq!(i32::from(colour.number()), number);
    }
    value0(&fake, 8);
    assert!(matches!(sensor.colour().unwrap_err().cause, Cause::Malformed(_)));
}

#[test]
fn colour_raw_values_are_one_frame() {
    let (fake, mut sensor) = typed::<ColourMode>(COLOUR_MODES);
    frame(&fake, "2", "s16", &[0x10, 0x02, 0x20, 0x03]);
    sensor.set_mode(ColourMode::RefRaw).unwrap();
    let raw = sensor.raw_reflection().unwrap();
    assert_eq!((raw.lit, raw.dark), (0x210, 0x320));

    frame(&fake, "3", "s16", &[1, 0, 2, 0, 0xff, 3]);
    sensor.set_mode(ColourMode::RgbRaw).unwrap();
    let before = fake.calls();
    let rgb = sensor.raw_rgb().unwrap();
    assert_eq!((rgb.red, rgb.green, rgb.blue, rgb.dark), (1, 2, 1023, None));
    assert_eq!(fake.calls().reads - before.reads, 1);

    let (fake, mut sensor) = typed::<ColourMode>(COLOUR_MODES);
    frame(&fake, "4", "s16", &[1, 0, 2, 0, 0xff, 3, 9, 0]);
    sensor.set_mode(ColourMode::RgbRaw).unwrap();
    assert_eq!(sensor.raw_rgb().unwrap().dark, Some(9));
}

#[test]
fn ultrasonic_distances_in_every_measuring_mode() {
    let (fake, mut sensor) = typed::<UltrasonicMode>(ULTRASONIC_MODES);
    #[rustfmt::skip]
    let cases = [
        // mode                      value  metres
        (UltrasonicMode::DistCm,     1234,  Some(1.234)),
        (UltrasonicMode::DistCm,     2549,  Some(2.549)),
        (UltrasonicMode::DistCm,     2550,  None),
        (UltrasonicMode::SingleCm,   250,   Some(0.25)),
        (UltrasonicMode::DcCm,       0,     Some(0.0)),
        (UltrasonicMode::DistIn,     100,   Some(0.254)),
        (UltrasonicMode::SingleIn,   1003,  None),
        (UltrasonicMode::DcIn,       1002,  Some(100.2 * 0.0254)),
    ];
    for (mode, value, metres) in cases {
        sensor.set_mode(mode).unwrap();
        value0(&fake, value);
        let distance = sensor.distance_m().unwrap();
        let same = match (distance, metres) {
            (Some(a), Some(b)) => near(a, b),
            (a, b) => a == b,
        };
        assert!(same, "{mode}: {value} is {distance:?}, not {metres:?}");
    }
    for value in [-1, 2551] {
        sensor.set_mode(UltrasonicMode::DistCm).unwrap();
        value0(&fake, value);
        assert_eq!(sensor.distance_m().unwrap_err().cause, Cause::Malformed(Legal::Range(0, 2550)));
    }
}

#[test]
fn an_ultrasonic_sensor_listens_to_others() {
    let (fake, mut sensor) = typed::<UltrasonicMode>(ULTRASONIC_MODES);
    sensor.set_mode(UltrasonicMode::Listen).unwrap();
    assert!(!sensor.hears_another().unwrap());
    value0(&fake, 1);
    assert!(sensor.hears_another().unwrap());
    let error = sensor.distance_m().unwrap_err();
    assert!(
        error.to_string().contains("mode `US-LISTEN`: refused, legal is one of US-DIST-CM"),
        "{error}"
    );
}

#[test]
fn a_ping_writes_the_mode_again_and_only_in_a_single_shot_mode() {
    let (fake, mut sensor) = typed::<UltrasonicMode>(ULTRASONIC_MODES);
    assert!(matches!(sensor.ping().unwrap_err().cause, Cause::Refused { errno: None, .. }));
    sensor.set_mode(UltrasonicMode::SingleCm).unwrap();
    sensor.ping().unwrap();
    assert_eq!(fake.written(SENSOR, "mode"), ["US-SI-CM\n", "US-SI-CM\n"]);
}

#[test]
fn gyro_angles_and_rates_keep_the_sensors_sign() {
    let (fake, mut sensor) = typed::<GyroMode>(GYRO_MODES);
    value0(&fake, -90);
    assert!(near(sensor.angle_rad().unwrap(), radians(-90.0)));
    sensor.set_mode(GyroMode::Rate).unwrap();
    assert!(near(sensor.rate_rad_s().unwrap(), radians(-90.0)));
    sensor.set_mode(GyroMode::TiltRate).unwrap();
    assert!(near(sensor.tilt_rate_rad_s().unwrap(), radians(-90.0)));
    sensor.set_mode(GyroMode::TiltAngle).unwrap();
    assert!(near(sensor.tilt_angle_rad().unwrap(), radians(-90.0)));
    sensor.set_mode(GyroMode::Fast).unwrap();
    assert_eq!(sensor.fast_rate_raw().unwrap(), -90);
    frame(&fake, "2", "s16", &[0x0a, 0x00, 0xf6, 0xff]);
    sensor.set_mode(GyroMode::AngleAndRate).unwrap();
    let both = sensor.angle_and_rate().unwrap();
    assert!(
        near(both.angle_rad, radians(10.0)) && near(both.rate_rad_s, radians(-10.0)),
        "{both:?}"
    );
    sensor.set_mode(GyroMode::Angle).unwrap();
    value0(&fake, 32_768);
    assert!(matches!(sensor.angle_rad().unwrap_err().cause, Cause::Malformed(_)));
}

#[test]
fn a_gyro_is_reset_by_one_byte_in_the_angle_mode_only() {
    let (fake, mut sensor) = typed::<GyroMode>(GYRO_MODES);
    sensor.reset(GyroReset::Zero).unwrap();
    assert_eq!(fake.written(SENSOR, "direct"), ["\u{11}"]);
    sensor.reset(GyroReset::Calibrate).unwrap();
    assert_eq!(fake.written(SENSOR, "direct").len(), 2);
    sensor.set_mode(GyroMode::Rate).unwrap();
    assert!(matches!(
        sensor.reset(GyroReset::Zero).unwrap_err().cause,
        Cause::Refused { errno: None, .. }
    ));
}

#[test]
fn an_older_gyro_has_no_tilt() {
    let (_, mut sensor) = typed::<GyroMode>("GYRO-ANG GYRO-RATE GYRO-FAS GYRO-G&A GYRO-CAL\n");
    assert!(sensor.has(GyroMode::Rate) && !sensor.has(GyroMode::TiltAngle));
    let error = sensor.set_mode(GyroMode::TiltAngle).unwrap_err();
    assert!(
        error.to_string().contains("mode `TILT-ANG`: refused, legal is one of GYRO-ANG GYRO-RATE"),
        "{error}"
    );
    assert_eq!(sensor.mode(), Some(GyroMode::Angle));
}

#[test]
fn infrared_proximity_and_remote() {
    let (fake, mut sensor) = typed::<InfraredMode>(INFRARED_MODES);
    value0(&fake, 100);
    assert_eq!(sensor.proximity_pct().unwrap(), 100.0);
    frame(&fake, "4", "s8", &[1, 0, 11, 9]);
    sensor.set_mode(InfraredMode::Remote).unwrap();
    assert_eq!(
        sensor.remotes().unwrap(),
        [RemoteCode::RedUp, RemoteCode::None, RemoteCode::BlueUpBlueDown, RemoteCode::Beacon]
    );
    for (number, code) in (0..).zip(RemoteCode::ALL) {
        value0(&fake, number);
        assert_eq!(sensor.remote().unwrap(), *code);
        assert_eq!(i32::from(code.number()), number);
    }
    value0(&fake, 12);
    assert!(matches!(sensor.remote().unwrap_err().cause, Cause::Malformed(_)));
    frame(&fake, "4", "s8", &[1, 0, 12, 9]);
    assert!(matches!(sensor.remotes().unwrap_err().cause, Cause::Malformed(_)));
}

#[test]
fn an_infrared_sensor_sees_beacons() {
    let (fake, mut sensor) = typed::<InfraredMode>(INFRARED_MODES);
    frame(&fake, "8", "s8", &[0xe7, 50, 0, 0x80, 25, 100, 0, 0]);
    sensor.set_mode(InfraredMode::Seek).unwrap();
    let beacons = sensor
        .beacons()
        .unwrap()
        .map(|beacon| beacon.map(|seen| (seen.heading, seen.distance_pct)));
    assert_eq!(beacons, [Some((-25, 50.0)), None, Some((25, 100.0)), Some((0, 0.0))]);
    frame(&fake, "8", "s8", &[26, 50, 0, 0x80, 25, 100, 0, 0]);
    assert!(matches!(sensor.beacons().unwrap_err().cause, Cause::Malformed(_)));
}

#[test]
fn infrared_buttons_each_by_itself() {
    let (fake, mut sensor) = typed::<InfraredMode>(INFRARED_MODES);
    sensor.set_mode(InfraredMode::RemoteA).unwrap();
    #[rustfmt::skip]
    let cases = [
        // value             red up  red down  blue up  blue down
        // 384 is nothing, though the bit for blue down is set.
        (384,                [false, false,    false,   false]),
        (262,                [false, false,    false,   false]),
        (270,                [false, false,    false,   false]),
        (256 + 0x10,         [true,  false,    false,   false]),
        (256 + 0x20,         [false, true,     false,   false]),
        (256 + 0x40,         [false, false,    true,    false]),
        (256 + 0x80 + 0x0f,  [false, false,    false,   true]),
        (256 + 0xf0,         [true,  true,     true,    true]),
    ];
    for (value, pressed) in cases {
        value0(&fake, value);
        let buttons = sensor.remote_buttons().unwrap();
        let read = [buttons.red_up, buttons.red_down, buttons.blue_up, buttons.blue_down];
        assert_eq!(read, pressed, "{value}");
    }
    value0(&fake, 0);
    assert!(matches!(sensor.remote_buttons().unwrap_err().cause, Cause::Malformed(_)));
}

#[test]
fn a_mode_is_written_only_when_it_changes_and_says_how_long_to_wait() {
    let (fake, mut sensor) = typed::<UltrasonicMode>(ULTRASONIC_MODES);
    assert_eq!(sensor.set_mode(UltrasonicMode::DistCm).unwrap(), 0);
    assert_eq!(fake.calls().writes, 0);
    assert_eq!(sensor.set_mode(UltrasonicMode::Listen).unwrap(), 2000 * MILLISECOND_NS);
    assert_eq!(sensor.set_mode(UltrasonicMode::Listen).unwrap(), 0);
    assert_eq!(fake.written(SENSOR, "mode"), ["US-LISTEN\n"]);
}

#[test]
fn every_change_of_a_real_sensors_mode_has_a_time_to_wait() {
    for (driver, modes) in [
        ("lego-ev3-color", COLOUR_MODES),
        ("lego-ev3-us", ULTRASONIC_MODES),
        ("lego-ev3-gyro", GYRO_MODES),
        ("lego-ev3-ir", INFRARED_MODES),
        ("lego-nxt-us", "A B\n"),
        ("made-by-somebody", "A B\n"),
    ] {
        for from in modes.split_whitespace() {
            for to in modes.split_whitespace() {
                let settle = settle_ns(driver.parse().ok(), from, to);
                assert_eq!(settle == 0, from == to, "{driver}: {from} to {to}: {settle}");
                assert!(settle <= 2000 * MILLISECOND_NS);
            }
        }
    }
    assert_eq!(settle_ns(Some(Driver::Colour), "COL-REFLECT", "COL-COLOR"), 20 * MILLISECOND_NS);
}

#[test]
fn after_a_failed_change_nothing_is_read_as_if_in_the_old_mode() {
    let (fake, mut sensor) = typed::<ColourMode>(COLOUR_MODES);
    fake.fail(SENSOR, "mode", None, Some(Errno::ETIMEDOUT));
    let error = sensor.set_mode(ColourMode::Ambient).unwrap_err();
    assert_eq!(error.cause, Cause::Other(Errno::ETIMEDOUT));
    assert_eq!(sensor.mode(), None);
    assert!(matches!(
        sensor.reflected_pct().unwrap_err().cause,
        Cause::Refused { errno: None, .. }
    ));
    fake.fail(SENSOR, "mode", None, None);
    assert_ne!(
        sensor.set_mode(ColourMode::Reflect).unwrap(),
        0,
        "it is written again, though it was the old one"
    );
    assert_eq!(sensor.mode(), Some(ColourMode::Reflect));
}

#[test]
fn a_mode_that_somebody_else_changed_is_noticed_when_it_is_looked_at() {
    let (fake, sensor) = typed::<ColourMode>(COLOUR_MODES);
    let mut sensor = sensor.into_sensor();
    assert!(sensor.refresh_mode().unwrap());
    fake.put(SENSOR, "mode", b"COL-CAL\n");
    assert!(!sensor.refresh_mode().unwrap());
    let sensor = ColourSensor::find(&fake.tree(), None).unwrap();
    assert_eq!(sensor.mode(), None, "a mode that is not usable is none of the typed ones");
}

#[test]
fn any_sensor_has_its_own_modes_units_and_decimals() {
    let fake = FakeTree::default();
    plug_sensor(&fake, SENSOR, "ev3-ports:in2:i2c1\n", "ht-nxt-thing\n", "ALL RAW\n");
    let mut sensor = Sensor::at(&fake.tree(), &"in2".parse().unwrap()).unwrap();
    for (index, name) in
        ["value0", "value1", "value2", "value3", "value4", "value5", "value6", "value7"]
            .iter()
            .enumerate()
    {
        fake.put(SENSOR, name, format!("{}\n", 650 + index).as_bytes());
    }
    frame(&fake, "8", "u8", &[1, 2, 3, 4, 5, 6, 7, 8]);
    fake.put(SENSOR, "decimals", b"1\n");
    fake.put(SENSOR, "units", b"mT\n");
    assert_eq!(sensor.set_mode("RAW").unwrap(), 200 * MILLISECOND_NS);
    // The seed's test: 650 with one decimal is 65.0.
    assert_eq!(sensor.value(0).unwrap(), 65.0);
    assert_eq!(sensor.raw_value(7).unwrap(), 657);
    assert!(sensor.raw_value(8).unwrap_err().is_absent());
    let mode = sensor.mode();
    assert_eq!(
        (mode.name.as_str(), mode.num_values, mode.decimals, mode.units.as_str()),
        ("RAW", 8, 1, "mT")
    );
    assert_eq!(sensor.frame().unwrap().values(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]);
    assert_eq!(sensor.modes().iter().collect::<Vec<_>>(), ["ALL", "RAW"]);
    assert_eq!(sensor.read_modes().unwrap(), *sensor.modes());
    sensor.set_poll_ms(50).unwrap();
    assert_eq!(sensor.poll_ms().unwrap(), 50);
    assert!(matches!(
        sensor.set_poll_ms(-1).unwrap_err().cause,
        Cause::Refused { errno: None, .. }
    ));
    fake.put(SENSOR, "fw_version", b"V1.0\n");
    fake.put(SENSOR, "text_value", b"hello there\n");
    assert_eq!(sensor.fw_version().unwrap().as_str(), "V1.0");
    assert_eq!(sensor.text_value().unwrap().as_str(), "hello there");
    fake.put(SENSOR, "commands", b"ZERO SCAN\n");
    sensor.command("SCAN").unwrap();
    assert_eq!(fake.written(SENSOR, "command"), ["SCAN\n"]);
    assert!(matches!(
        sensor.command("JUMP").unwrap_err().cause,
        Cause::Refused { errno: None, .. }
    ));
}

#[test]
fn a_sensors_errors_say_what_to_do() {
    let (fake, sensor) = typed::<UltrasonicMode>(ULTRASONIC_MODES);
    let sensor = sensor.into_sensor();
    fake.fail(SENSOR, "value1", Some(Errno::ENXIO), None);
    assert!(sensor.value(1).unwrap_err().is_absent(), "the mode has one value");
    fake.fail(SENSOR, "value0", Some(Errno::ENXIO), None);
    assert!(sensor.value(0).unwrap_err().is_gone(), "a UART sensor builds its tables again");
    fake.fail(SENSOR, "poll_ms", Some(Errno::EOPNOTSUPP), Some(Errno::EOPNOTSUPP));
    assert!(sensor.poll_ms().unwrap_err().is_absent());
    assert!(matches!(
        sensor.set_poll_ms(50).unwrap_err().cause,
        Cause::Refused { errno: Some(Errno::EOPNOTSUPP), .. }
    ));
    fake.put(SENSOR, "bin_data", &[1]);
    assert!(sensor.frame().is_ok(), "one byte of u8 is one value");
    fake.put(SENSOR, "bin_data", &[]);
    assert_eq!(sensor.frame().unwrap_err().cause, Cause::Malformed(Legal::Bytes));
}

#[test]
fn a_sensor_that_describes_itself_wrongly_is_malformed() {
    for (name, text) in [
        ("num_values", "-1"),
        ("num_values", "256"),
        ("decimals", "10"),
        ("bin_data_format", "u64"),
    ] {
        let fake = FakeTree::default();
        plug_sensor(&fake, SENSOR, "ev3-ports:in1\n", "lego-ev3-us\n", ULTRASONIC_MODES);
        fake.put(SENSOR, name, text.as_bytes());
        let error = UltrasonicSensor::find(&fake.tree(), None).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("not understood"), "{error}");
    }
}

#[test]
fn nothing_is_ever_sent_to_a_colour_sensor() {
    let (fake, sensor) = typed::<ColourMode>(COLOUR_MODES);
    let sensor = sensor.into_sensor();
    for bytes in [b"LEGO-FAC-CAL-1".as_slice(), &[0x11]] {
        assert!(matches!(
            sensor.write_direct(bytes).unwrap_err().cause,
            Cause::Refused { errno: None, .. }
        ));
    }
    let (other, gyro) = typed::<GyroMode>(GYRO_MODES);
    assert!(gyro.sensor().write_direct(&[0; 33]).is_err());
    assert!(gyro.sensor().write_direct(&[]).is_err());
    assert_eq!((fake.calls().writes, other.calls().writes), (0, 0));
}

#[test]
fn a_sensors_reading_is_one_call_and_allocates_nothing_after_the_first() {
    let (fake, mut sensor) = typed::<GyroMode>(GYRO_MODES);
    frame(&fake, "2", "s16", &[0x0a, 0x00, 0xf6, 0xff]);
    sensor.angle_rad().unwrap();
    let before = fake.calls();
    let (allocated, ()) =
        allocations(|| (0..100).for_each(|_| assert!(sensor.angle_rad().is_ok())));
    assert_eq!(
        (fake.calls().reads - before.reads, fake.calls().opens - before.opens, allocated),
        (100, 0, 0)
    );
    sensor.set_mode(GyroMode::AngleAndRate).unwrap();
    sensor.angle_and_rate().unwrap();
    let before = fake.calls();
    let (allocated, ()) =
        allocations(|| (0..100).for_each(|_| assert!(sensor.angle_and_rate().is_ok())));
    assert_eq!(
        (fake.calls().reads - before.reads, fake.calls().opens - before.opens, allocated),
        (100, 0, 0)
    );
}

proptest! {
    #[test]
    fn whatever_a_driver_says_is_a_value_or_malformed(
        bytes in proptest::collection::vec(any::<u8>(), 0..90),
    ) {
        let (fake, sensor) = typed::<UltrasonicMode>(ULTRASONIC_MODES);
        fake.put(SENSOR, "value0", &bytes);
        if let Err(error) = sensor.distance_m() {
            prop_assert!(matches!(error.cause, Cause::Malformed(_)), "{}", error);
        }
        let mut sensor = sensor.into_sensor();
        for name in ["mode", "num_values", "decimals", "units", "bin_data_format", "bin_data"] {
            fake.put(SENSOR, name, &bytes);
            let outcomes = [sensor.refresh_mode().err(), sensor.frame().err()];
            for error in outcomes.into_iter().flatten() {
                prop_assert!(matches!(error.cause, Cause::Malformed(_)), "{}", error);
            }
            if let Err(FindError::Device(error)) = Sensor::find(&fake.tree(), None, None) {
                prop_assert!(matches!(error.cause, Cause::Malformed(_)), "{}", error);
            }
        }
    }
}

#[test]
fn the_typed_modes_are_all_that_the_sensors_list_but_the_unusable() {
    const UNUSABLE: [&str; 4] = ["COL-CAL", "GYRO-CAL", "IR-S-ALT", "IR-CAL"];
    let usable = |modes: &'static str| -> Vec<&str> {
        modes.split_whitespace().filter(|mode| !UNUSABLE.contains(mode)).collect()
    };
    assert_eq!(usable(COLOUR_MODES), ColourMode::WORDS);
    assert_eq!(usable(ULTRASONIC_MODES), UltrasonicMode::WORDS);
    assert_eq!(usable(GYRO_MODES), GyroMode::WORDS);
    assert_eq!(usable(INFRARED_MODES), InfraredMode::WORDS);
    let transcript = include_str!("../../data/kernel-transcript.txt");
    for modes in [COLOUR_MODES, ULTRASONIC_MODES, GYRO_MODES] {
        assert!(transcript.contains(modes.trim_end()), "{modes}");
    }
}

#[test]
fn each_kind_of_sensor_is_found_by_its_driver() {
    let fake = FakeTree::default();
    plug_sensor(&fake, "sys/class/lego-sensor/sensor0", "in1\n", "lego-ev3-us\n", ULTRASONIC_MODES);
    plug_sensor(&fake, "sys/class/lego-sensor/sensor1", "in2\n", "lego-ev3-gyro\n", GYRO_MODES);
    plug_sensor(&fake, "sys/class/lego-sensor/sensor2", "in3\n", "lego-ev3-color\n", COLOUR_MODES);
    plug_sensor(&fake, "sys/class/lego-sensor/sensor3", "in4\n", "lego-ev3-ir\n", INFRARED_MODES);
    plug_sensor(&fake, "sys/class/lego-sensor/sensor4", "in5\n", "lego-ev3-touch\n", "TOUCH\n");
    let tree = fake.tree();
    let names = [
        UltrasonicSensor::find(&tree, None).unwrap().identity().name.clone(),
        GyroSensor::find(&tree, None).unwrap().identity().name.clone(),
        ColourSensor::find(&tree, None).unwrap().identity().name.clone(),
        InfraredSensor::find(&tree, None).unwrap().identity().name.clone(),
        TouchSensor::find(&tree, None).unwrap().identity().name.clone(),
    ];
    assert_eq!(names, ["sensor0", "sensor1", "sensor2", "sensor3", "sensor4"]);
}
