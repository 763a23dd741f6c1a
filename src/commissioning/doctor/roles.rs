//! The robot's file and its devices: each on its port, of the right kind, answering.

use std::sync::Arc;

use crate::clock::{MILLISECOND_NS, SECOND_NS};
use crate::ev3dev::{DeviceError, FindError, TachoMotor, Tree};
use crate::robot::{
    MotorRole, NOT_TURNED, PLUG_AGAIN, PLUG_IN, RobotConfig, RoleSensor, WantedMotor, equip,
};
use crate::runtime::{GYRO_STILL_RAD, halt_command};
use crate::senses::{Role, Unit};
use crate::units::degrees;

use super::{Examination, Report, Verdict, with_causes};

/// How long sensors are watched, nanoseconds: a gyro that drifts is seen in a second.
const WATCH_NS: i64 = SECOND_NS;

/// How often, nanoseconds.
const LOOK_NS: i64 = 20 * MILLISECOND_NS;

/// A sensor that was just put into a mode needs this long, nanoseconds; a UART sensor takes up to
/// half a second.
const SETTLE_NS: i64 = SECOND_NS / 2;

pub(super) fn file(examination: &mut Examination<'_>, report: &mut Report<'_>) {
    let source = match examination.patient.robot {
        Ok(source) => source,
        Err((why, to_do)) => return report.fail(why, to_do),
    };
    match source.robot() {
        Ok((config, warnings)) => {
            for warning in &warnings {
                let place = format!("line {}: {}", warning.line, warning.message);
                report.warn(place, warning.hint.as_deref().unwrap_or("look at this line"));
            }
            let is_measured = config.geometry().is_ok_and(|robot| robot.knows_gyro_scale());
            let to_do = (config.has(Role::Gyro) && !is_measured).then_some(
                "onbrick calibrate measures the gyro: else exploring begins with two spins",
            );
            let found = format!("{} describes \"{}\"", source.name, config.name);
            report.add(Verdict::Ok, found, to_do);
            examination.config = Some(config);
        }
        Err(findings) => {
            for finding in &findings {
                let found = format!("{} line {}: {}", finding.file, finding.line, finding.message);
                report.fail(found, finding.hint.as_deref().unwrap_or("correct this line"));
            }
        }
    }
}

/// Nothing is written to a motor: its command is opened for writing and closed again.
pub(super) fn motors(examination: &mut Examination<'_>, report: &mut Report<'_>) {
    let Some(config) = &examination.config else { return };
    for WantedMotor { section, motor, .. } in config.motor_roles() {
        examine_motor(examination.patient.tree, motor, &mut report.of(&section));
    }
}

fn examine_motor(tree: &Arc<dyn Tree>, wanted: &MotorRole, report: &mut Report<'_>) {
    let motor = match TachoMotor::at(tree, &wanted.port) {
        Ok(motor) => motor,
        Err(error) => {
            let is_linear = matches!(&error, FindError::Other { found, .. } if found.is_linear());
            return report.fail(with_causes(&error), if is_linear { NOT_TURNED } else { PLUG_IN });
        }
    };
    let identity = motor.identity();
    let what = format!("{} on {}", identity.driver, identity.address.short());
    let read = motor.state().and_then(|state| Ok((state, motor.position()?, motor.commands()?)));
    let (state, position, commands) = match read {
        Ok(read) => read,
        Err(error) => {
            return report.fail(format!("{what}: {}", with_causes(&error)), PLUG_AGAIN);
        }
    };
    if state.is_driven() {
        let to_do = format!("another program drives it: {}", halt_command(tree.root()));
        report.fail(format!("{what} is running"), &to_do);
    } else if !commands.contains("run-timed") {
        report.fail(
            format!("{what} has no run-timed"),
            "its driver cannot take leases: another motor",
        );
    } else if let Err(error) = motor.check_writable() {
        report.fail(
            format!("{what}: {}", with_causes(&error)),
            "sudo usermod -aG ev3dev USER, then log in again",
        );
    } else {
        report.ok(format!("{what}, at {position}"));
    }
}

/// Puts sensors into their modes if no other program has them, and watches them all for a second.
pub(super) fn sensors(examination: &mut Examination<'_>, report: &mut Report<'_>) {
    let Some(config) = &examination.config else { return };
    let tree = examination.patient.tree;
    let may_set = examination.is_free;
    if may_set && let Err(error) = equip(tree, config, examination.patient.clock) {
        let to_do = error.way_out().unwrap_or(PLUG_IN);
        report.of("ports").fail(with_causes(&error), to_do);
    }
    let mut watched = Vec::new();
    for role in config.sensors.keys() {
        match Watch::begin(tree, config, *role, may_set) {
            Ok(watch) => watched.push(watch),
            // A run does without it where the mission does.
            Err((found, to_do))
                if to_do == PLUG_IN && !matches!(role, Role::Range | Role::Gyro) =>
            {
                report.of(&config.section(*role)).warn(found, to_do);
            }
            Err((found, to_do)) => report.of(&config.section(*role)).fail(found, to_do),
        }
    }
    let clock = examination.patient.clock;
    clock.sleep_ns(SETTLE_NS);
    let end_ns = clock.now_ns() + WATCH_NS;
    while clock.now_ns() < end_ns && !examination.patient.flags.is_raised() {
        for sensor in &mut watched {
            sensor.look();
        }
        clock.sleep_ns(LOOK_NS);
    }
    for sensor in &watched {
        sensor.judge(&mut report.of(&sensor.name));
    }
}

/// A sensor and what it said.
struct Watch {
    /// What its section in the robot's file is called.
    name: String,
    sensor: RoleSensor,
    values: Vec<f64>,
    failed: Option<DeviceError>,
}

impl Watch {
    /// Finds the sensor of a role and puts it into its mode; why it cannot be watched, and what to
    /// do.
    fn begin(
        tree: &Arc<dyn Tree>,
        config: &RobotConfig,
        role: Role,
        may_set: bool,
    ) -> Result<Self, (String, &'static str)> {
        let mut sensor = RoleSensor::find(tree, config, role, &[])
            .map_err(|error| (with_causes(&error), PLUG_IN))?;
        if !sensor.is_in_mode() {
            if !may_set {
                let found = format!(
                    "it is in another mode than {}, and another program has it",
                    sensor.mode()
                );
                return Err((found, "look again when the other program is done"));
            }
            sensor.set_mode().map_err(|error| (with_causes(&error), PLUG_AGAIN))?;
        }
        Ok(Self { name: config.section(role), sensor, values: Vec::new(), failed: None })
    }

    fn look(&mut self) {
        let lead = self.sensor.lead();
        let values = &mut self.values;
        let note = |channel, value| {
            if channel == lead {
                values.push(value);
            }
        };
        if let Err(error) = self.sensor.read(note) {
            self.failed = Some(error);
        }
    }

    fn judge(&self, report: &mut Report<'_>) {
        let identity = self.sensor.identity();
        let what = format!("{} on {}", identity.driver, identity.address.short());
        let role = self.sensor.role();
        if let Some(error) = &self.failed {
            return report.fail(format!("{what}: {}", with_causes(error)), PLUG_AGAIN);
        }
        let (Some(first), Some(last)) = (self.values.first(), self.values.last()) else {
            return report.fail(format!("{what} was not read"), PLUG_AGAIN);
        };
        let moved = (last - first).abs();
        match role {
            Role::Gyro if moved > GYRO_STILL_RAD => report.fail(
                format!("{what} drifts, {:.0} degrees in a second", degrees(moved)),
                "unplug it, hold the robot still, and plug it in again",
            ),
            Role::Gyro => report.ok(format!("{what}, at rest")),
            Role::Range if self.values.iter().all(|value| value.is_infinite()) => report.warn(
                format!("{what} hears no echo"),
                "hold a hand 20 cm before it and look again: nearer than 4 cm it hears none either",
            ),
            Role::Touch if *last > 0.5 => {
                report.warn(format!("{what} is pressed"), "free the bumper before a run");
            }
            _ if self.sensor.lead().quantity().unit == Unit::Metres => {
                report.ok(format!("{what}, {last:.3} m"));
            }
            _ => report.ok(format!("{what}, reads {last:.0}")),
        }
    }
}
