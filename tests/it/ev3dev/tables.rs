//! The tables against independent witnesses: what the kernel's drivers listed, and the classes'
//! source as the reference restates it.

use std::collections::BTreeMap;

use onbrick::ev3dev::{
    AttributeSpec, Battery, DcMotor, Direction, Driver, Led, LegoPort, ServoMotor,
};

use crate::support::brick;
use crate::support::{pass_over, shared};

const TRANSCRIPT: &str = include_str!("../../data/kernel-transcript.txt");

/// Entries that the driver model adds to every device.
const STANDARD: [&str; 4] = ["uevent", "subsystem", "device", "power"];

type Listing = BTreeMap<String, u32>;

/// A device's folder as the kernel listed it: names and file modes; folders have the mode of a
/// folder.
fn listed(device: &str) -> Listing {
    let head = format!("list of {device} (");
    let lines = TRANSCRIPT.lines().skip_while(|line| !line.starts_with(&head)).skip(1);
    let rows = lines.take_while(|line| line.starts_with("  "));
    let entries = rows.map(|row| {
        let mut fields = row.split_whitespace();
        let mode = u32::from_str_radix(fields.next().unwrap(), 8).unwrap();
        (fields.nth(1).unwrap().to_owned(), mode)
    });
    // A port lists what is plugged into it as a folder with a colon in its name.
    entries.filter(|(name, _)| !STANDARD.contains(&name.as_str()) && !name.contains(':')).collect()
}

/// What a listing of the tables' rows would be.
fn expected(tables: &[&[AttributeSpec]]) -> Listing {
    let rows = tables.iter().copied().flatten().map(|spec| match spec.name.split_once('/') {
        Some((folder, _)) => (folder.to_owned(), 0o040_755),
        None => (spec.name.to_owned(), 0o100_000 | mode(spec.direction)),
    });
    rows.collect()
}

fn mode(direction: Direction) -> u32 {
    match direction {
        Direction::Readable => 0o444,
        Direction::Writeable => 0o200,
        Direction::Readwriteable => 0o644,
    }
}

#[test]
fn the_tables_are_what_the_kernels_drivers_list() {
    let cases: [(&str, Vec<&[AttributeSpec]>); 6] = [
        ("outA", brick::rotary_tables().into()),
        ("outB", brick::rotary_tables().into()),
        ("in1", brick::sensor_tables().into()),
        ("in2", brick::sensor_tables().into()),
        ("port:outB", vec![LegoPort::ATTRIBUTES]),
        ("port:in1", vec![LegoPort::ATTRIBUTES]),
    ];
    for (device, tables) in cases {
        let listed = listed(device);
        assert!(listed.len() > 5, "{device}: {listed:?}");
        assert_eq!(expected(&tables), listed, "{device}");
    }
}

#[test]
fn every_driver_of_the_transcript_is_known_by_name() {
    let lines = TRANSCRIPT.lines().filter(|line| line.contains(" driver_name -> \""));
    let names: Vec<&str> =
        lines.filter_map(|line| line.split('"').nth(1)?.strip_suffix("\\n")).collect();
    assert!(names.len() >= 8, "{names:?}");
    for name in names {
        assert!(name.parse::<Driver>().is_ok(), "{name}");
    }
}

#[test]
fn every_attribute_that_the_transcript_uses_is_in_a_table() {
    let tables = [
        brick::rotary_tables(),
        brick::linear_tables(),
        brick::sensor_tables(),
        [LegoPort::ATTRIBUTES; 2],
    ];
    let known: Vec<&str> =
        tables.iter().flatten().copied().flatten().map(|spec| spec.name).collect();
    let mut seen = 0;
    for line in TRANSCRIPT.lines() {
        let mut fields = line.split_whitespace().skip(1);
        if let (Some("r" | "w"), Some(_), Some(attribute)) =
            (fields.next(), fields.next(), fields.next())
        {
            assert!(attribute == "uevent" || known.contains(&attribute), "{line}");
            seen += 1;
        }
    }
    assert!(seen > 500, "{seen} reads and writes");
}

/// Name, mode, what is legal.
type Row = (&'static str, u32, &'static str);

/// Rows of the reference's sections 2 to 4, 7 and 8 (restated from the classes' source): name,
/// mode, what is legal in it.
#[test]
fn the_other_classes_tables_are_what_the_reference_says() {
    #[rustfmt::skip]
    let classes: [(&str, Vec<AttributeSpec>, &[Row]); 5] = [
        ("linear", brick::linear_tables()[1].to_vec(), &[
            ("count_per_m", 0o444, "a whole number"),
            ("full_travel_count", 0o444, "a whole number"),
        ]),
        ("dc-motor", DcMotor::ATTRIBUTES.to_vec(), &[
            ("address", 0o444, "text"),
            ("driver_name", 0o444, "text"),
            ("commands", 0o444, "text"),
            ("command", 0o200, "one of run-forever run-timed run-direct stop"),
            ("duty_cycle", 0o444, "-100 to 100"),
            ("duty_cycle_sp", 0o644, "-100 to 100"),
            ("polarity", 0o644, "one of normal inversed"),
            ("ramp_up_sp", 0o644, "0 to 10000"),
            ("ramp_down_sp", 0o644, "0 to 10000"),
            ("state", 0o444, "any of running ramping holding overloaded stalled"),
            ("stop_action", 0o200, "one of coast brake"),
            ("stop_actions", 0o444, "text"),
            ("time_sp", 0o644, "0 to 60000"),
        ]),
        ("servo-motor", ServoMotor::ATTRIBUTES.to_vec(), &[
            ("address", 0o444, "text"),
            ("driver_name", 0o444, "text"),
            ("command", 0o200, "one of run float"),
            ("min_pulse_sp", 0o644, "0 to 1000"),
            ("mid_pulse_sp", 0o644, "1000 to 2000"),
            ("max_pulse_sp", 0o644, "2000 to 3000"),
            ("polarity", 0o644, "one of normal inversed"),
            ("position_sp", 0o644, "-100 to 100"),
            ("rate_sp", 0o644, "0 to 2147483647"),
            ("state", 0o444, "any of running ramping holding overloaded stalled"),
        ]),
        ("leds", Led::ATTRIBUTES.to_vec(), &[
            ("brightness", 0o644, "0 to 255"),
            ("max_brightness", 0o444, "a whole number"),
            ("trigger", 0o644, "text"),
            ("delay_on", 0o644, "0 to 2147483647"),
            ("delay_off", 0o644, "0 to 2147483647"),
        ]),
        ("power_supply", Battery::ATTRIBUTES.to_vec(), &[
            ("voltage_now", 0o444, "a whole number"),
            ("current_now", 0o444, "a whole number"),
            ("voltage_max_design", 0o444, "a whole number"),
            ("voltage_min_design", 0o444, "a whole number"),
            ("technology", 0o644, "one of Unknown Li-ion NiMH"),
            ("type", 0o444, "text"),
            ("scope", 0o444, "text"),
        ]),
    ];
    for (class, table, witness) in classes {
        let rows: Vec<_> = table
            .iter()
            .map(|spec| (spec.name, mode(spec.direction), spec.legal.to_string()))
            .collect();
        let expected: Vec<_> =
            witness.iter().map(|(name, mode, legal)| (*name, *mode, (*legal).to_owned())).collect();
        assert_eq!(rows, expected, "{class}");
    }
}

/// The rows of the tables in a section of the reference: names and file modes.
fn described(reference: &str, section: &str) -> Listing {
    let text =
        reference.split("\n## ").find(|part| part.starts_with(section)).expect("the section");
    let rows = text.lines().filter_map(|line| line.strip_prefix("| `")?.split_once(" | "));
    let modes = rows.filter_map(|(names, rest)| {
        let mode = match rest.split(" | ").next()?.trim_matches('*') {
            "R" => 0o100_444,
            "W" | "W only" | "**W only" => 0o100_200,
            "RW" => 0o100_644,
            _ => return None,
        };
        Some((names, mode))
    });
    let is_name = |name: &&str| name.starts_with(|c: char| c.is_ascii_lowercase());
    let entries = modes.flat_map(|(names, mode)| {
        names
            .split('`')
            .filter(is_name)
            .map(move |name| (name.to_owned(), mode))
            .collect::<Vec<_>>()
    });
    entries.filter(|(name, _)| !STANDARD.contains(&name.as_str())).collect()
}

#[test]
fn the_tables_have_the_rows_of_the_references_sections() {
    let reference = shared().map(|folder| folder.join("reference/ev3dev-interfaces.md"));
    let Some(reference) = reference.and_then(|path| std::fs::read_to_string(path).ok()) else {
        return pass_over("the interfaces' reference beside the repository");
    };
    let sections: [(&str, Vec<&[AttributeSpec]>); 5] = [
        ("3. dc-motor", vec![DcMotor::ATTRIBUTES]),
        ("4. servo-motor", vec![ServoMotor::ATTRIBUTES]),
        ("5. lego-port", vec![LegoPort::ATTRIBUTES]),
        ("7. LEDs", vec![Led::ATTRIBUTES]),
        ("8. Battery", vec![Battery::ATTRIBUTES]),
    ];
    for (section, tables) in sections {
        assert_eq!(expected(&tables), described(&reference, section), "section {section}");
    }
}

#[test]
fn what_is_legal_for_a_motor_is_what_the_driver_took_in_the_transcript() {
    let rows = brick::rotary_tables().concat();
    let section = TRANSCRIPT
        .split("\n# ")
        .find(|part| part.starts_with("what writes are refused, large motor"));
    let mut checked = 0;
    for line in section.expect("the section").lines().skip(1) {
        let (operation, answer) = line.split_once(" -> ").unwrap();
        let fields: Vec<&str> = operation.split_whitespace().collect();
        let [_, "w", "outB", attribute, value] = fields[..] else { continue };
        let Some(spec) = rows.iter().find(|spec| spec.name == attribute) else { continue };
        let Ok(number) = value.parse::<i64>() else { continue };
        if answer.starts_with("open") || attribute == "speed_sp" {
            continue;
        }
        assert_eq!(spec.legal.allows(number), answer.parse::<u32>().is_ok(), "{line}");
        checked += 1;
    }
    assert!(checked > 20, "{checked} numbers");
}
