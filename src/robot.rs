//! A robot: which port is the left wheel, the head, the range sensor; what it senses and does, in SI units.
//!
//! [`RobotConfig`] is `robot.toml`. [`Robot::bind`] finds a device for each role, puts sensors into the modes that the mission needs
//! and takes the motors over. Then, tick by tick, [`Robot::sense`] reads each attribute with one system call into [`Senses`], and
//! [`Robot::act`] turns demands into leases ([`LeasedMotor`]): motions that the kernel itself ends unless they are renewed.
//!
//! This is where the robot's own conventions end: gears and inverted motors are undone here, counts become radians at the
//! axle, and the gyro sensor's clockwise reading is turned round. Above, everything is x ahead, y left, anticlockwise positive.
//!
//! # Not here
//!
//! No poses and no understanding of readings (`mapping`), no decision when to stop (`runtime`).
//!
//! # What we count on
//!
//! - A reading that fails leaves the last one with its age; [`Robot::trouble`] tells the last error.
//! - Dropping a robot stops its motors, on every way out that unwinds.

use crate::behavior::{Demands, Drive, Led};
use crate::clock::{Clock, MILLISECOND_NS, SECOND_NS};
use crate::ev3dev::{
    Battery, Button, Buttons, ColourSensor, DeviceError, GyroSensor, InfraredSensor, LightColour, Sound,
    StatusLights, StopAction, TouchSensor, UltrasonicSensor,
};

mod battery;
mod bind;
mod config;
mod drive;
mod halt;
mod lease;
mod senses;

pub use battery::{BatteryConfig, BatteryLimits};
pub use bind::BindError;
pub use config::{DEFAULT_ROBOT, HeadRole, MotorRole, NamedMotor, RangeRole, RobotConfig, SensorRole};
pub use halt::{HaltError, Halted, halt, still, watch_still};
pub use lease::{LEASE_MS, LeasedMotor, RENEW_NS};
pub use senses::{Channel, Reading, Senses};

/// How near the head must come to what is asked of it, radians: half a degree, less than the gears' play.
const HEAD_NEAR_RAD: f64 = 0.0087;

/// In what time the head closes the rest of its way: it slows down on the last stretch instead of swinging over.
const HEAD_CLOSE_S: f64 = 0.1;

/// A robot whose roles are bound to devices.
#[derive(Debug)]
pub struct Robot {
    config: RobotConfig,
    left: LeasedMotor,
    right: LeasedMotor,
    head: Option<LeasedMotor>,
    motors: Vec<LeasedMotor>,
    range: Option<RangeSensor>,
    gyro: Option<GyroSensor>,
    touch: Option<TouchSensor>,
    colour: Option<(ColourSensor, Channel)>,
    remote: Option<InfraredSensor>,
    battery: Option<Battery>,
    battery_due_ns: i64,
    buttons: Result<Buttons, DeviceError>,
    lights: Option<StatusLights>,
    sound: Option<Sound>,
    led: Option<Led>,
    tone_hz: Option<i32>,
    head_rad: Option<f64>,
    trouble: Option<(Channel, DeviceError)>,
    refused: Option<DeviceError>,
    settle_ns: i64,
}

/// What measures the range.
#[derive(Debug)]
enum RangeSensor {
    Ultrasonic(UltrasonicSensor),
    Infrared { sensor: InfraredSensor, m_per_pct: f64 },
}

impl RangeSensor {
    /// Metres; infinite where nothing is in range.
    fn range_m(&self) -> Result<f64, DeviceError> {
        match self {
            Self::Ultrasonic(sensor) => Ok(sensor.distance_m()?.unwrap_or(f64::INFINITY)),
            Self::Infrared { sensor, m_per_pct } => {
                // 100 % is "far away or nothing" (`ev3dev-interfaces`, 6.3).
                let pct = sensor.proximity_pct()?;
                Ok(if pct >= 100.0 { f64::INFINITY } else { pct * m_per_pct })
            }
        }
    }
}

impl Robot {
    /// The robot as its file describes it.
    #[must_use]
    pub fn config(&self) -> &RobotConfig {
        &self.config
    }

    /// For how long after binding values may be stale, nanoseconds.
    #[must_use]
    pub fn settle_ns(&self) -> i64 {
        self.settle_ns
    }

    /// The channels that this robot senses.
    pub fn channels(&self) -> impl Iterator<Item = Channel> + '_ {
        let motors = Channel::MOTORS.into_iter().take(self.motors.len());
        let optional = [
            (Channel::Head, self.head.is_some()),
            (Channel::Range, self.range.is_some()),
            (Channel::Gyro, self.gyro.is_some()),
            (Channel::Touch, self.touch.is_some()),
            (Channel::Remote, self.remote.is_some()),
            (Channel::Battery, self.battery.is_some()),
        ];
        let optional = optional.into_iter().filter(|(_, there)| *there).map(|(channel, _)| channel);
        let colour = self.colour.iter().map(|(_, channel)| *channel);
        [Channel::Left, Channel::Right].into_iter().chain(optional).chain(colour).chain(motors)
    }

    /// The ports of the motors that this robot has taken over, as the kernel names them.
    #[must_use]
    pub fn motor_ports(&self) -> Vec<String> {
        let motors = [&self.left, &self.right].into_iter().chain(&self.head).chain(&self.motors);
        motors.map(|motor| motor.motor().identity().address.to_string()).collect()
    }

    /// Whether a person can stop the robot by a button, or why not.
    ///
    /// # Errors
    ///
    /// What opening the buttons gave.
    pub fn stop_button(&self) -> Result<(), &DeviceError> {
        self.buttons.as_ref().map(|_| ())
    }

    /// Reads everything once, one system call an attribute, and notes it in `senses`, whose tick and time the caller has set. True if
    /// Enter or Back was pressed.
    ///
    /// What cannot be read keeps its last reading. The battery is read about once a second.
    pub fn sense(&mut self, senses: &mut Senses) -> bool {
        let mut trouble = None;
        let mut note = |channel, value: Result<f64, DeviceError>| match value {
            Ok(value) => senses.set(channel, value),
            Err(error) => trouble = Some((channel, error)),
        };
        note(Channel::Left, self.left.angle_rad());
        note(Channel::Right, self.right.angle_rad());
        if let Some(head) = &self.head {
            note(Channel::Head, head.angle_rad());
        }
        for (channel, motor) in Channel::MOTORS.into_iter().zip(&self.motors) {
            note(channel, motor.angle_rad());
        }
        if let Some(range) = &self.range {
            note(Channel::Range, range.range_m());
        }
        if let Some(gyro) = &self.gyro {
            // The sensor counts clockwise; from here on, anticlockwise is positive.
            note(Channel::Gyro, gyro.angle_rad().map(|clockwise_rad| -clockwise_rad));
        }
        if let Some(touch) = &self.touch {
            note(Channel::Touch, touch.is_pressed().map(|pressed| f64::from(u8::from(pressed))));
        }
        if let Some((colour, channel)) = &self.colour {
            note(
                *channel,
                match channel {
                    Channel::Colour => colour.colour().map(|colour| f64::from(colour as u8)),
                    _ => colour.reflected_pct(),
                },
            );
        }
        if let Some(remote) = &self.remote {
            note(Channel::Remote, remote.remote().map(|code| f64::from(code as u8)));
        }
        let battery = self.battery.as_ref().filter(|_| senses.time_ns >= self.battery_due_ns);
        if let Some(battery) = battery {
            self.battery_due_ns = senses.time_ns + SECOND_NS;
            match battery.voltage_v() {
                Ok(volts) => senses.set(Channel::Battery, volts),
                Err(error) => trouble = Some((Channel::Battery, error)),
            }
        }
        if let Some(reading) = senses.get(Channel::Head).filter(|_| self.head.is_some()) {
            self.head_rad = Some(reading.value);
        }
        if trouble.is_some() {
            self.trouble = trouble;
        }
        self.stop_pressed()
    }

    /// Carries out what is wanted, within the robot's limits. What nobody wants does not turn.
    ///
    /// A write that fails is tried again at the next tick; the lease behind it runs out meanwhile.
    pub fn act(&mut self, demands: &Demands, now_ns: i64) {
        let action = match demands.drive {
            Some(Drive::Stop(action)) => Some(action),
            _ => None,
        };
        let speeds = self.config.wheel_speeds(demands.drive);
        for (wheel, speed) in [&mut self.left, &mut self.right].into_iter().zip(speeds) {
            let done = match action {
                Some(action) => wheel.stop(action),
                None => wheel.turn(speed, now_ns),
            };
            self.refused = done.err().or(self.refused.take());
        }
        let head_rad_s = self.head_speed(demands.head_rad);
        if let Some(head) = &mut self.head {
            self.refused = head.turn(head_rad_s, now_ns).err().or(self.refused.take());
        }
        for (motor, speed) in self.motors.iter_mut().zip(demands.motors) {
            self.refused = motor.turn(speed.unwrap_or(0.0), now_ns).err().or(self.refused.take());
        }
        self.show(demands);
    }

    /// Stops every motor now; true if each of them took the command.
    pub fn stop(&mut self, action: StopAction) -> bool {
        let mut stopped = true;
        for motor in
            [&mut self.left, &mut self.right].into_iter().chain(&mut self.head).chain(&mut self.motors)
        {
            if let Err(error) = motor.stop(action) {
                stopped = false;
                self.refused = Some(error);
            }
        }
        if let Some(sound) = &mut self.sound {
            // A tone lasts until it is ended, also when the program has gone.
            let _ = sound.silence();
            self.tone_hz = None;
        }
        stopped
    }

    /// The last reading that failed, and the last command.
    #[must_use]
    pub fn trouble(&self) -> Option<String> {
        let reading = self.trouble.as_ref().map(|(channel, error)| format!("{channel}: {error}"));
        reading.or_else(|| self.refused.as_ref().map(ToString::to_string))
    }

    /// Why a channel could not be read the last time that anything could not be.
    #[must_use]
    pub fn trouble_with(&self, channel: Channel) -> Option<&DeviceError> {
        self.trouble.as_ref().filter(|(troubled, _)| *troubled == channel).map(|(_, error)| error)
    }

    /// Tells people near that the robot is about to move: three seconds of orange light and beeps, or until `stopped`.
    pub fn announce(&mut self, clock: &dyn Clock, stopped: &dyn Fn() -> bool) {
        const BEEP_HZ: i32 = 880;
        self.light(Led::Orange);
        for _ in 0..3 {
            let start_ns = clock.now_ns();
            for (tone_hz, until_ns) in [(Some(BEEP_HZ), 200 * MILLISECOND_NS), (None, SECOND_NS)] {
                self.tone(tone_hz);
                while clock.now_ns() < start_ns + until_ns && !stopped() {
                    clock.sleep_until_ns((clock.now_ns() + 20 * MILLISECOND_NS).min(start_ns + until_ns));
                }
            }
        }
    }

    /// Enter or Back went down since the last look, or is held down.
    fn stop_pressed(&mut self) -> bool {
        let Ok(buttons) = &mut self.buttons else { return false };
        let Ok(changes) = buttons.changes() else { return false };
        [Button::Enter, Button::Back].into_iter().any(|stop| changes.pressed.contains(stop))
    }

    /// The speed that takes the head to an angle within its limits, radians per second.
    fn head_speed(&self, wanted_rad: Option<f64>) -> f64 {
        let (Some(role), Some(wanted_rad), Some(head_rad)) = (&self.config.head, wanted_rad, self.head_rad)
        else {
            return 0.0;
        };
        let missing_rad = wanted_rad.clamp(-role.limit_rad, role.limit_rad) - head_rad;
        if missing_rad.abs() < HEAD_NEAR_RAD {
            return 0.0;
        }
        (missing_rad / HEAD_CLOSE_S).clamp(-role.speed_rad_s, role.speed_rad_s)
    }

    fn show(&mut self, demands: &Demands) {
        if let Some(led) = demands.led {
            self.light(led);
        }
        self.tone(demands.tone_hz.and_then(audible));
    }

    /// Lights and sounds are for people: when they fail, the robot drives on.
    fn light(&mut self, led: Led) {
        if self.led != Some(led)
            && let Some(lights) = &mut self.lights
        {
            self.led = Some(led);
            let _ = lights.set_both(match led {
                Led::Off => LightColour::Off,
                Led::Green => LightColour::Green,
                Led::Red => LightColour::Red,
                Led::Orange => LightColour::Orange,
                Led::Yellow => LightColour::Yellow,
            });
        }
    }

    fn tone(&mut self, tone_hz: Option<i32>) {
        if self.tone_hz != tone_hz
            && let Some(sound) = &mut self.sound
        {
            self.tone_hz = tone_hz;
            let _ = match tone_hz {
                Some(tone_hz) => sound.tone(tone_hz),
                None => sound.silence(),
            };
        }
    }
}

/// A tone that the speaker can make, hertz (`ev3dev-interfaces`, 11.1: 100 to 10000).
#[expect(clippy::cast_possible_truncation, reason = "limited just before")]
fn audible(tone_hz: f64) -> Option<i32> {
    (tone_hz > 0.0).then(|| tone_hz.clamp(100.0, 10_000.0) as i32)
}
