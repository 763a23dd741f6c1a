//! The robot's file and its devices: each on its port, of the right kind, answering.

use std::sync::Arc;

use crate::clock::{MILLISECOND_NS, SECOND_NS};
use crate::ev3dev::{
    ColourMode, DeviceError, GyroMode, InfraredMode, PortAddress, SensorMode, TachoMotor, TouchMode, Tree,
    TypedSensor, UltrasonicMode,
};
use crate::robot::{MotorRole, RobotConfig};
use crate::runtime::GYRO_STILL_RAD;
use crate::units::degrees;

use super::{Diagnosis, Examination, with_causes};

/// How long sensors are watched, nanoseconds: a gyro that drifts is seen in a second.
const WATCH_NS: i64 = SECOND_NS;

/// How often, nanoseconds.
const LOOK_NS: i64 = 20 * MILLISECOND_NS;

/// A sensor that was just put into a mode needs this long, nanoseconds; a UART sensor takes up to half a second.
const SETTLE_NS: i64 = SECOND_NS / 2;

/// What to do about a device that is not where the file says.
const REPLUG: &str = "plug it in there and wait three seconds, or let onbrick setup write robot.toml anew";

/// What to do about a device that is there and does not answer.
const LOOSE: &str = "unplug it, plug it in again, and wait three seconds";

pub(super) fn file(examination: &mut Examination<'_>, diagnosis: &mut Diagnosis) {
    const CHECK: &str = "robot.toml";
    let source = match examination.patient.robot {
        Ok(source) => source,
        Err(why) => return diagnosis.fail(CHECK, why, "onbrick setup writes one"),
    };
    match RobotConfig::load(&source.name, source.text.as_bytes()) {
        Ok((config, warnings)) => {
            for warning in &warnings {
                let place = format!("line {}: {}", warning.line, warning.message);
                diagnosis.warn(CHECK, place, warning.hint.as_deref().unwrap_or("look at this line"));
            }
            diagnosis.ok(CHECK, format!("{} describes \"{}\"", source.name, config.name));
            examination.config = Some(config);
        }
        Err(findings) => {
            for finding in &findings {
                let found = format!("{} line {}: {}", finding.file, finding.line, finding.message);
                diagnosis.fail(CHECK, found, finding.hint.as_deref().unwrap_or("correct this line"));
            }
        }
    }
}

/// Nothing is written to a motor: its command is opened for writing and closed again.
pub(super) fn motors(examination: &mut Examination<'_>, diagnosis: &mut Diagnosis) {
    let Some(config) = &examination.config else { return };
    let mut roles = vec![("drive.left".to_owned(), &config.left), ("drive.right".to_owned(), &config.right)];
    roles.extend(config.head.as_ref().map(|head| ("head".to_owned(), &head.motor)));
    roles.extend(config.motors.iter().map(|named| (format!("motor.{}", named.name), &named.motor)));
    for (role, motor) in roles {
        examine_motor(examination.patient.tree, &role, motor, diagnosis);
    }
}

fn examine_motor(tree: &Arc<dyn Tree>, role: &str, wanted: &MotorRole, diagnosis: &mut Diagnosis) {
    let motor = match TachoMotor::find(tree, wanted.port.as_ref(), None) {
        Ok(motor) => motor,
        Err(error) => return diagnosis.fail(role, with_causes(&error), REPLUG),
    };
    let identity = motor.identity();
    let what = format!("{} on {}", identity.driver, identity.address.short());
    let read = motor.state().and_then(|state| Ok((state, motor.position()?, motor.commands()?)));
    let (state, position, commands) = match read {
        Ok(read) => read,
        Err(error) => return diagnosis.fail(role, format!("{what}: {}", with_causes(&error)), LOOSE),
    };
    if state.is_running() {
        diagnosis.fail(role, format!("{what} is running"), "another program drives it: onbrick halt");
    } else if !commands.contains("run-timed") {
        diagnosis.fail(
            role,
            format!("{what} has no run-timed"),
            "its driver cannot take leases: another motor",
        );
    } else if let Err(error) = motor.check_writable() {
        diagnosis.fail(
            role,
            format!("{what}: {}", with_causes(&error)),
            "sudo usermod -aG ev3dev USER, then log in anew",
        );
    } else {
        diagnosis.ok(role, format!("{what}, at {position}"));
    }
}

/// Puts sensors into their modes where nobody else has them, and watches them all for a second.
pub(super) fn sensors(examination: &mut Examination<'_>, diagnosis: &mut Diagnosis) {
    let Some(config) = &examination.config else { return };
    let tree = examination.patient.tree;
    let may_set = examination.is_free;
    let mut watched: Vec<Box<dyn Watched>> = Vec::new();
    let mut add = |role: &'static str, sensor: Result<Box<dyn Watched>, Trouble>| match sensor {
        Ok(sensor) => watched.push(sensor),
        Err(Trouble { found, to_do }) => diagnosis.fail(role, found, to_do),
    };
    if let Some(role) = &config.range {
        add("range", range(tree, role.port.as_ref(), may_set));
    }
    if let Some(role) = &config.gyro {
        add(
            "gyro",
            watch(tree, "gyro", role.port.as_ref(), GyroMode::Angle, may_set, |gyro| gyro.angle_rad()),
        );
    }
    if let Some(role) = &config.touch {
        let pressed =
            |touch: &TypedSensor<TouchMode>| touch.is_pressed().map(|pressed| f64::from(u8::from(pressed)));
        add("touch", watch(tree, "touch", role.port.as_ref(), TouchMode::Touch, may_set, pressed));
    }
    if let Some(role) = &config.colour {
        let colour =
            |colour: &TypedSensor<ColourMode>| colour.colour().map(|colour| f64::from(colour.number()));
        add("colour", watch(tree, "colour", role.port.as_ref(), ColourMode::Colour, may_set, colour));
    }
    if let Some(role) = &config.remote {
        let code = |remote: &TypedSensor<InfraredMode>| remote.remote().map(|code| f64::from(code.number()));
        add("remote", watch(tree, "remote", role.port.as_ref(), InfraredMode::Remote, may_set, code));
    }
    let clock = examination.patient.clock;
    clock.sleep_until_ns(clock.now_ns() + SETTLE_NS);
    let end_ns = clock.now_ns() + WATCH_NS;
    while clock.now_ns() < end_ns && !examination.patient.flags.is_raised() {
        for sensor in &mut watched {
            sensor.look();
        }
        clock.sleep_until_ns(clock.now_ns() + LOOK_NS);
    }
    for sensor in &watched {
        sensor.judge(diagnosis);
    }
}

/// Why a sensor cannot be watched.
struct Trouble {
    found: String,
    to_do: &'static str,
}

/// A sensor under watch, whatever its kind.
trait Watched {
    fn look(&mut self);
    fn judge(&self, diagnosis: &mut Diagnosis);
}

/// A sensor and what it said.
struct Watch<M: SensorMode, R> {
    role: &'static str,
    sensor: TypedSensor<M>,
    read: R,
    values: Vec<f64>,
    failed: Option<DeviceError>,
}

/// The ultrasonic sensor, or where there is none the infrared one.
fn range(
    tree: &Arc<dyn Tree>,
    port: Option<&PortAddress>,
    may_set: bool,
) -> Result<Box<dyn Watched>, Trouble> {
    let metres = |sensor: &TypedSensor<UltrasonicMode>| {
        sensor.distance_m().map(|range_m| range_m.unwrap_or(f64::INFINITY))
    };
    let ultrasonic = watch(tree, "range", port, UltrasonicMode::DistCm, may_set, metres);
    if ultrasonic.is_err() && TypedSensor::<InfraredMode>::find(tree, port).is_ok() {
        let percent = |sensor: &TypedSensor<InfraredMode>| sensor.proximity_pct();
        return watch(tree, "range", port, InfraredMode::Proximity, may_set, percent);
    }
    ultrasonic
}

fn watch<M: SensorMode>(
    tree: &Arc<dyn Tree>,
    role: &'static str,
    port: Option<&PortAddress>,
    mode: M,
    may_set: bool,
    read: impl Fn(&TypedSensor<M>) -> Result<f64, DeviceError> + 'static,
) -> Result<Box<dyn Watched>, Trouble> {
    let mut sensor = TypedSensor::<M>::find(tree, port)
        .map_err(|error| Trouble { found: with_causes(&error), to_do: REPLUG })?;
    if sensor.mode() != Some(mode) {
        if !may_set {
            let found = format!("it is in another mode than {}, and somebody else has it", mode.word());
            return Err(Trouble { found, to_do: "look again when the other program is done" });
        }
        sensor.set_mode(mode).map_err(|error| Trouble { found: with_causes(&error), to_do: LOOSE })?;
    }
    Ok(Box::new(Watch { role, sensor, read, values: Vec::new(), failed: None }))
}

impl<M: SensorMode, R: Fn(&TypedSensor<M>) -> Result<f64, DeviceError>> Watched for Watch<M, R> {
    fn look(&mut self) {
        match (self.read)(&self.sensor) {
            Ok(value) => self.values.push(value),
            Err(error) => self.failed = Some(error),
        }
    }

    fn judge(&self, diagnosis: &mut Diagnosis) {
        let identity = self.sensor.identity();
        let what = format!("{} on {}", identity.driver, identity.address.short());
        if let Some(error) = &self.failed {
            return diagnosis.fail(self.role, format!("{what}: {}", with_causes(error)), LOOSE);
        }
        let (Some(first), Some(last)) = (self.values.first(), self.values.last()) else {
            return diagnosis.fail(self.role, format!("{what} was not read"), LOOSE);
        };
        let moved = (last - first).abs();
        match self.role {
            "gyro" if moved > GYRO_STILL_RAD => diagnosis.fail(
                self.role,
                format!("{what} drifts, {:.0} degrees in a second", degrees(moved)),
                "unplug it, hold the robot still, and plug it in again",
            ),
            "gyro" => diagnosis.ok(self.role, format!("{what}, at rest")),
            "range" if self.values.iter().all(|value| value.is_infinite()) => diagnosis.warn(
                self.role,
                format!("{what} hears no echo"),
                "hold a hand 20 cm before it and look again: nearer than 4 cm it hears none either",
            ),
            "range" if M::DRIVER == UltrasonicMode::DRIVER => {
                diagnosis.ok(self.role, format!("{what}, {last:.3} m"));
            }
            "touch" if *last > 0.5 => {
                diagnosis.warn(self.role, format!("{what} is pressed"), "free the bumper before a run");
            }
            _ => diagnosis.ok(self.role, format!("{what}, reads {last:.0}")),
        }
    }
}
