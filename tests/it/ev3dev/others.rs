//! Ports, lights, battery, board, buttons and speaker.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use nix::errno::Errno;
use onbrick::ev3dev::{
    Battery, BoardInfo, Button, Buttons, Cause, Direction, EV3, Led, LegoPort, LightColour,
    LocalTree, PortMode, Side, Sound, StatusLights, Technology, Tree,
};

use crate::support::allocations::allocations;
use crate::support::brick::FakeTree;

const PORT: &str = "sys/class/lego-port/port0";
const BATTERY: &str = "sys/class/power_supply/lego-ev3-battery";
const LEDS: [&str; 4] = [
    "led0:red:brick-status",
    "led0:green:brick-status",
    "led1:red:brick-status",
    "led1:green:brick-status",
];

fn event(kind: u16, code: u16, value: i32) -> Vec<u8> {
    let mut bytes = vec![0; 2 * size_of::<std::ffi::c_long>()];
    bytes.extend(kind.to_ne_bytes());
    bytes.extend(code.to_ne_bytes());
    bytes.extend(value.to_ne_bytes());
    bytes
}

/// A stream of events as a plain file, and the tree that it is in.
fn stream(folder: &Path, path: &str) -> (Arc<dyn Tree>, File) {
    let file = folder.join(path);
    std::fs::create_dir_all(file.parent().unwrap()).unwrap();
    let writer = OpenOptions::new().create(true).append(true).open(file).unwrap();
    (Arc::new(LocalTree::new(folder)), writer)
}

#[test]
fn a_ports_attributes_are_read_and_its_mode_is_checked() {
    let fake = FakeTree::default();
    let modes = "auto nxt-analog nxt-color nxt-i2c other-i2c ev3-analog ev3-uart other-uart raw\n";
    let texts = [
        ("address", "ev3-ports:in1\n"),
        ("driver_name", "ev3-input-port\n"),
        ("modes", modes),
        ("mode", "auto\n"),
        ("status", "ev3-uart\n"),
    ];
    fake.plug(PORT, &[LegoPort::ATTRIBUTES], &texts);
    let port = LegoPort::at(&fake.tree(), &"in1".parse().unwrap()).unwrap();
    assert_eq!(
        (port.mode().unwrap().as_str(), port.status().unwrap().as_str()),
        ("auto", "ev3-uart")
    );
    assert_eq!(port.modes().iter().count(), 9);
    port.set_mode(PortMode::NxtAnalog).unwrap();
    port.set_device("lego-nxt-sound").unwrap();
    assert_eq!(fake.written(PORT, "mode"), ["nxt-analog\n"]);
    assert_eq!(fake.written(PORT, "set_device"), ["lego-nxt-sound\n"]);
    let error = port.set_mode(PortMode::TachoMotor).unwrap_err();
    assert!(
        error.to_string().contains("mode `tacho-motor`: refused, legal is one of auto nxt-analog"),
        "{error}"
    );
    assert!(port.set_device(&"x".repeat(100)).is_err());
    fake.fail(PORT, "set_device", None, Some(Errno::EOPNOTSUPP));
    assert!(matches!(
        port.set_device("x").unwrap_err().cause,
        Cause::Refused { errno: Some(_), .. }
    ));
}

#[test]
fn the_words_of_the_port_modes_are_those_that_the_kernel_lists() {
    let transcript = include_str!("../../data/kernel-transcript.txt");
    for port in ["port:in1", "port:outB"] {
        let line = transcript.lines().find(|line| line.contains(&format!("r {port} modes")));
        let text = line.unwrap().split('"').nth(1).unwrap().trim_end_matches("\\n");
        for word in text.split(' ') {
            assert!(word.parse::<PortMode>().is_ok(), "{word}");
        }
    }
}

fn lights(max: &str) -> (FakeTree, StatusLights) {
    let fake = FakeTree::default();
    for led in LEDS {
        let texts =
            [("max_brightness", max), ("trigger", "none mmc0 timer [heartbeat] default-on\n")];
        fake.plug(&format!("sys/class/leds/{led}"), &[Led::ATTRIBUTES], &texts);
    }
    let lights = StatusLights::open(&fake.tree(), &EV3).unwrap();
    (fake, lights)
}

#[test]
fn a_status_light_is_a_mix_of_red_and_green() {
    let (fake, lights) = lights("255\n");
    for colour in LightColour::ALL {
        lights.set(Side::Left, *colour).unwrap();
        let (red, green) = colour.mix();
        let last =
            |led| fake.written(&format!("sys/class/leds/{led}"), "brightness").pop().unwrap();
        assert_eq!(
            (last(LEDS[0]), last(LEDS[1])),
            (format!("{red}\n"), format!("{green}\n")),
            "{colour}"
        );
    }
    assert!(fake.written(&format!("sys/class/leds/{}", LEDS[2]), "brightness").is_empty());
    lights.set_both(LightColour::Orange).unwrap();
}

#[test]
fn changing_a_light_allocates_nothing_after_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let lights = StatusLights::open(&lights("255\n").0.write(folder.path()), &EV3).unwrap();
    lights.set_both(LightColour::Green).unwrap();
    let (allocated, ()) = allocations(|| {
        for colour in LightColour::ALL {
            lights.set_both(*colour).unwrap();
        }
    });
    assert_eq!(allocated, 0);
}

#[test]
fn lights_of_another_brightness_are_scaled_and_a_little_stays_a_little() {
    let (fake, lights) = lights("1\n");
    lights.set_both(LightColour::Yellow).unwrap();
    for led in LEDS {
        assert_eq!(fake.written(&format!("sys/class/leds/{led}"), "brightness"), ["1\n"]);
    }
}

#[test]
fn lights_are_taken_from_what_else_switches_them() {
    let (fake, lights) = lights("255\n");
    lights.take().unwrap();
    for led in LEDS {
        assert_eq!(fake.written(&format!("sys/class/leds/{led}"), "trigger"), ["none\n"]);
        fake.put(&format!("sys/class/leds/{led}"), "trigger", b"[none] mmc0\n");
    }
    let before = fake.calls().writes;
    lights.take().unwrap();
    assert_eq!(fake.calls().writes, before, "what is none already is not written");
}

#[test]
fn a_led_refuses_what_it_does_not_have() {
    let (fake, _) = lights("255\n");
    let led = Led::named(&fake.tree(), LEDS[0]).unwrap();
    assert_eq!(led.trigger().unwrap(), "heartbeat");
    led.set_brightness(255).unwrap();
    assert_eq!(
        (led.brightness().unwrap(), led.max_brightness(), led.read_max_brightness().unwrap()),
        (255, 255, 255)
    );
    led.set_delay_on(100).unwrap();
    led.set_delay_off(200).unwrap();
    assert_eq!((led.delay_on().unwrap(), led.delay_off().unwrap()), (100, 200));
    for refused in [
        led.set_brightness(256),
        led.set_brightness(-1),
        led.set_trigger("disco"),
        led.set_delay_on(-1),
        led.set_delay_off(-1),
    ] {
        assert!(matches!(refused.unwrap_err().cause, Cause::Refused { errno: None, .. }));
    }
    fake.put(&format!("sys/class/leds/{}", LEDS[0]), "trigger", b"none mmc0\n");
    assert!(matches!(led.trigger().unwrap_err().cause, Cause::Malformed(_)));
    assert!(Led::named(&fake.tree(), "led9:red").unwrap_err().is_gone());
}

fn battery(technology: &str, max: &str, min: &str) -> (FakeTree, Battery) {
    let fake = FakeTree::default();
    let texts = [
        ("voltage_now", "7400000\n"),
        ("current_now", "180000\n"),
        ("voltage_max_design", max),
        ("voltage_min_design", min),
        ("technology", technology),
        ("type", "Battery\n"),
        ("scope", "System\n"),
    ];
    fake.plug(BATTERY, &[Battery::ATTRIBUTES], &texts);
    let battery = Battery::open(&fake.tree(), &EV3).unwrap();
    (fake, battery)
}

#[test]
fn a_battery_reads_in_volts_and_amperes_and_the_drivers_slip_is_undone() {
    #[rustfmt::skip]
    let cases = [
        ("Li-ion\n",  "84000000\n", "60000000\n", Technology::LiIon,   8.4, 6.0),
        ("Unknown\n", "90000000\n", "48000000\n", Technology::Unknown, 9.0, 4.8),
        ("NiMH\n",    "7800000\n",  "5400000\n",  Technology::NiMh,    7.8, 5.4),
    ];
    for (text, max, min, technology, full_v, empty_v) in cases {
        let (_, battery) = battery(text, max, min);
        assert_eq!(battery.technology().unwrap(), technology);
        assert!(
            (battery.full_v().unwrap() - full_v).abs() < 1e-9
                && (battery.empty_v().unwrap() - empty_v).abs() < 1e-9
        );
        assert!((battery.voltage_v().unwrap() - 7.4).abs() < 1e-9);
        assert!((battery.current_a().unwrap() - 0.18).abs() < 1e-9);
        assert_eq!(
            (battery.kind().unwrap().as_str(), battery.scope().unwrap().as_str()),
            ("Battery", "System")
        );
    }
}

#[test]
fn a_battery_that_is_not_measured_yet_is_an_error_and_not_zero() {
    let (fake, battery) = battery("Unknown\n", "90000000\n", "48000000\n");
    fake.fail(BATTERY, "voltage_now", Some(Errno::ENODATA), None);
    let error = battery.voltage_v().unwrap_err();
    assert!(error.to_string().ends_with("not measured yet, try again"), "{error}");
    fake.fail(BATTERY, "technology", None, Some(Errno::EINVAL));
    assert!(matches!(
        battery.set_rechargeable().unwrap_err().cause,
        Cause::Refused { errno: Some(_), .. }
    ));
    assert!(Battery::open(&FakeTree::default().tree(), &EV3).unwrap_err().is_gone());
}

#[test]
fn another_platforms_battery_is_found_by_its_ending() {
    let fake = FakeTree::default();
    fake.plug(
        "sys/class/power_supply/brickpi-battery",
        &[Battery::ATTRIBUTES],
        &[("voltage_now", "9100000\n")],
    );
    fake.plug("sys/class/power_supply/AC", &[Battery::ATTRIBUTES], &[]);
    assert!((Battery::open(&fake.tree(), &EV3).unwrap().voltage_v().unwrap() - 9.1).abs() < 1e-9);
}

#[test]
fn the_main_board_says_which_brick_it_is() {
    let fake = FakeTree::default();
    assert_eq!(BoardInfo::read(&fake.tree()).unwrap(), None);
    fake.file(
        "sys/class/board-info/board0",
        "uevent",
        Direction::Readwriteable,
        "BOARD_INFO_TYPE=aux\n",
    );
    assert_eq!(BoardInfo::read(&fake.tree()).unwrap(), None);
    let text = "BOARD_INFO_HW_REV=7\nBOARD_INFO_MODEL=LEGO MINDSTORMS EV3\nBOARD_INFO_ROM_REV=6\n\
                BOARD_INFO_SERIAL_NUM=0016535A1B2C\nBOARD_INFO_TYPE=main\n";
    fake.file("sys/class/board-info/board1", "uevent", Direction::Readwriteable, text);
    let board = BoardInfo::read(&fake.tree()).unwrap().unwrap();
    assert_eq!(board.model.as_deref(), Some("LEGO MINDSTORMS EV3"));
    assert_eq!(board.hardware_revision.as_deref(), Some("7"));
    assert_eq!(board.rom_revision.as_deref(), Some("6"));
    assert_eq!(board.serial_number.as_deref(), Some("0016535A1B2C"));
    fake.put("sys/class/board-info/board0", "uevent", &[0xff, 0xfe]);
    assert!(matches!(BoardInfo::read(&fake.tree()).unwrap_err().cause, Cause::Malformed(_)));
}

#[test]
fn buttons_are_held_until_they_are_let_go() {
    let folder = tempfile::tempdir().unwrap();
    let (tree, mut writer) = stream(folder.path(), EV3.buttons.unwrap());
    let mut buttons = Buttons::open(&tree, &EV3).unwrap();
    assert!(buttons.changes().unwrap().pressed.is_empty());
    for &button in Button::ALL {
        writer.write_all(&[event(1, button.code(), 1), event(0, 0, 0)].concat()).unwrap();
        let changes = buttons.changes().unwrap();
        assert_eq!(changes.pressed.iter().collect::<Vec<_>>(), [button]);
        assert!(changes.released.is_empty() && buttons.held().contains(button));
        assert_eq!(buttons.changes().unwrap(), Default::default());
        writer.write_all(&[event(1, button.code(), 0), event(0, 0, 0)].concat()).unwrap();
        assert!(buttons.changes().unwrap().released.contains(button));
        assert!(buttons.held().is_empty());
    }
}

#[test]
fn a_short_press_between_two_looks_is_not_lost() {
    let folder = tempfile::tempdir().unwrap();
    let (tree, mut writer) = stream(folder.path(), EV3.buttons.unwrap());
    let mut buttons = Buttons::open(&tree, &EV3).unwrap();
    let code = Button::Enter.code();
    writer
        .write_all(&[event(1, code, 1), event(0, 0, 0), event(1, code, 0), event(0, 0, 0)].concat())
        .unwrap();
    let changes = buttons.changes().unwrap();
    assert!(changes.pressed.contains(Button::Enter) && changes.released.contains(Button::Enter));
    assert!(buttons.held().is_empty());
}

#[test]
fn an_event_that_comes_in_two_parts_and_others_keys_do_no_harm() {
    let folder = tempfile::tempdir().unwrap();
    let (tree, mut writer) = stream(folder.path(), EV3.buttons.unwrap());
    let mut buttons = Buttons::open(&tree, &EV3).unwrap();
    let bytes = [event(1, 30, 1), event(4, 14, 1), event(1, 14, 2), event(1, 14, 1)].concat();
    for byte in &bytes[..bytes.len() - 1] {
        writer.write_all(&[*byte]).unwrap();
        assert!(buttons.changes().unwrap().pressed.is_empty());
    }
    writer.write_all(&bytes[bytes.len() - 1..]).unwrap();
    assert!(buttons.changes().unwrap().pressed.contains(Button::Back));
}

#[test]
fn looking_at_the_buttons_allocates_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (tree, mut writer) = stream(folder.path(), EV3.buttons.unwrap());
    let mut buttons = Buttons::open(&tree, &EV3).unwrap();
    writer.write_all(&event(1, 28, 1)).unwrap();
    let (allocated, pressed) = allocations(|| {
        let pressed = buttons.changes().unwrap().pressed;
        (0..100).for_each(|_| assert!(buttons.changes().unwrap().pressed.is_empty()));
        pressed
    });
    assert!(pressed.contains(Button::Enter));
    assert_eq!(allocated, 0);
}

#[test]
fn a_simulation_in_the_process_has_buttons_and_a_speaker_as_well() {
    let fake = FakeTree::default();
    let (folder, name) = EV3.buttons.unwrap().rsplit_once('/').unwrap();
    fake.file(folder, name, Direction::Readable, "");
    fake.put(folder, name, &event(1, 106, 1));
    let mut buttons = Buttons::open(&fake.tree(), &EV3).unwrap();
    assert!(buttons.changes().unwrap().pressed.contains(Button::Right));

    let (folder, name) = EV3.speaker.unwrap().rsplit_once('/').unwrap();
    fake.file(folder, name, Direction::Writeable, "");
    Sound::open(&fake.tree(), &EV3).unwrap().tone(440).unwrap();
    assert_eq!(fake.written(folder, name).len(), 2, "a tone, and the silence of the drop");
}

#[test]
fn a_tone_is_one_event_and_ends_when_the_speaker_is_dropped() {
    let folder = tempfile::tempdir().unwrap();
    let (tree, _writer) = stream(folder.path(), EV3.speaker.unwrap());
    let mut sound = Sound::open(&tree, &EV3).unwrap();
    for hz in [0, 99, 10_001, -440] {
        assert!(
            matches!(sound.tone(hz).unwrap_err().cause, Cause::Refused { errno: None, .. }),
            "{hz} Hz"
        );
    }
    sound.tone(100).unwrap();
    sound.tone(10_000).unwrap();
    sound.silence().unwrap();
    sound.tone(440).unwrap();
    drop(sound);
    let written = std::fs::read(folder.path().join(EV3.speaker.unwrap())).unwrap();
    let expected: Vec<u8> =
        [100, 10_000, 0, 440, 0].into_iter().flat_map(|hz| event(0x12, 2, hz)).collect();
    assert_eq!(written, expected);
}

#[test]
fn nodes_that_are_not_there_are_absent() {
    let folder = tempfile::tempdir().unwrap();
    let tree: Arc<dyn Tree> = Arc::new(LocalTree::new(folder.path()));
    assert!(Buttons::open(&tree, &EV3).unwrap_err().is_absent());
    assert!(Sound::open(&tree, &EV3).unwrap_err().is_absent());
}
