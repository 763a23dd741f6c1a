//! The brick itself: its files, its owner, and what people see, hear and press.

use crate::ev3dev::{Battery, Buttons, DeviceError, Inventory, Sound, StatusLights};
use crate::robot::{BatteryConfig, BatteryLimits, StopButton, stop_button_answers};
use crate::runtime::{HardwareLock, LockError, halt_command};
use crate::units::counted;

use super::{Examination, Report, with_causes};

/// What to do about EACCES on buttons and speaker.
const INPUT_GROUP: &str = "sudo usermod -aG input USER, then log in again";

pub(super) fn tree(examination: &mut Examination<'_>, report: &mut Report<'_>) {
    let root = examination.patient.tree.root().display();
    match Inventory::read(examination.patient.tree) {
        Err(error) => report.fail(with_causes(&error), "onbrick devices shows more"),
        Ok(inventory) if inventory.is_empty() => {
            examination.has_brick = false;
            report.fail(
                format!("there is none below {root}: no device classes of ev3dev"),
                "run this on the brick, or give --brick the folder where one is mounted",
            );
        }
        Ok(inventory) => {
            let devices = inventory.devices.iter().filter(|entry| entry.class != "lego-port");
            let what = examination.platform.what;
            let devices = counted(devices.count(), "device");
            report.ok(format!("{what}, {devices} below {root}"));
        }
    }
}

/// Takes the hardware for the time of the examination, where it is to be had.
pub(super) fn lock(examination: &mut Examination<'_>, report: &mut Report<'_>) {
    let Some(root) = examination.patient.root else {
        examination.is_free = true;
        return report.ok("not needed: this brick is inside the program");
    };
    match HardwareLock::take(root, "onbrick doctor") {
        Ok(lock) => {
            examination.is_free = true;
            examination._lock = Some(lock);
            report.ok("no other program drives");
        }
        Err(error @ LockError::Taken(_)) => {
            let to_do = format!("wait until it is done, or {}", halt_command(root));
            report.fail(error.to_string(), &to_do);
        }
        Err(error) => {
            report
                .fail(with_causes(&error), "make its folder writable, or remove the file as root");
        }
    }
}

pub(super) fn battery(examination: &mut Examination<'_>, report: &mut Report<'_>) {
    let config =
        examination.config.as_ref().map_or_else(BatteryConfig::default, |config| config.battery);
    let most_v = examination.platform.most_v;
    let read = Battery::open(examination.patient.tree, examination.platform).and_then(|battery| {
        let volts = battery.voltage_v()?;
        let cells = battery.technology().unwrap_or_default();
        Ok((volts, config.on(cells, examination.platform).limits()))
    });
    let (volts, BatteryLimits { warn_v, slow_v, .. }) = match read {
        Ok(read) => read,
        Err(error) => {
            return report.warn(with_causes(&error), "a run goes without, and cannot warn of it");
        }
    };
    if !(slow_v..=most_v).contains(&volts) {
        let to_do = format!("charge it, or put in fresh cells; a run needs at least {slow_v:.1} V");
        report.fail(format!("{volts:.2} V"), &to_do);
    } else if volts < warn_v {
        report.warn(format!("{volts:.2} V is low"), "charge it soon, or have fresh cells ready");
    } else {
        report.ok(format!("{volts:.2} V"));
    }
}

/// A run that a person beside the robot cannot stop may never happen, so this is no warning.
pub(super) fn buttons(examination: &mut Examination<'_>, report: &mut Report<'_>) {
    let Examination { patient, platform, config, .. } = &*examination;
    let own = config.as_ref().and_then(|config| config.stop_button.as_ref());
    if let Some(button) = own {
        let what = match button {
            StopButton::Touch(port) => format!("the touch sensor on {port} stops a run"),
            StopButton::Device(device) => format!("{} stops a run", device.display()),
        };
        let to_do = "[stop_button] of robot.toml names what is there";
        return match stop_button_answers(patient.tree, button) {
            Ok(()) => report.ok(what),
            Err(error) => report.fail(with_causes(&error), to_do),
        };
    }
    if platform.buttons.is_none() {
        let found = format!("{} has none, and a run is refused without", platform.one());
        let to_do = "a touch sensor as [stop_button] in robot.toml, or --no-button each time";
        return report.fail(found, to_do);
    }
    let opened = Buttons::open(examination.patient.tree, examination.platform);
    let looked = opened.and_then(|mut buttons| buttons.changes().map(|_| buttons.held()));
    match looked {
        Ok(held) if held.stops() => {
            report.warn("Enter or Back is held down", "let go of it: it stops a run");
        }
        Ok(_) => {
            let verb = if platform.stop_buttons.contains(' ') { "stop" } else { "stops" };
            report.ok(format!("{} {verb} a run", platform.stop_buttons));
        }
        Err(error) => {
            report.fail(
                format!("a run could not be stopped by hand: {}", with_causes(&error)),
                advice(&error),
            );
        }
    }
}

pub(super) fn lights(examination: &mut Examination<'_>, report: &mut Report<'_>) {
    if examination.platform.lights.iter().all(|lamps| lamps.is_empty()) {
        return report.ok(format!("{} has none", examination.platform.one()));
    }
    match StatusLights::open(examination.patient.tree, examination.platform)
        .and_then(|lights| lights.check_writable())
    {
        Ok(()) => report.ok("they can be switched"),
        Err(error) => report.warn(
            with_causes(&error),
            "a run goes without light signals; sudo usermod -aG ev3dev USER where access is denied",
        ),
    }
}

pub(super) fn speaker(examination: &mut Examination<'_>, report: &mut Report<'_>) {
    if examination.platform.speaker.is_none() {
        return report.ok(format!("none is known on {}", examination.platform.one()));
    }
    match Sound::open(examination.patient.tree, examination.platform) {
        Ok(_) => report.ok("it can be heard"),
        Err(error) => report.warn(
            format!("a run starts without its beeps: {}", with_causes(&error)),
            advice(&error),
        ),
    }
}

fn advice(error: &DeviceError) -> &'static str {
    if error.is_denied() {
        INPUT_GROUP
    } else {
        "is this an EV3 under ev3dev, with this as an input device?"
    }
}
