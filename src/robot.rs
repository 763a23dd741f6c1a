//! A robot: which port is the left wheel, the head, the range sensor; what it senses and does, in
//! SI units.
//!
//! [`RobotConfig`] is `robot.toml`. [`Robot::bind`] finds a device for each role, puts sensors into
//! the modes that the mission needs and takes the motors over. Then, tick by tick, [`Robot::sense`]
//! reads each attribute with one system call into [`Senses`], and [`Robot::act`] turns demands into
//! leases ([`LeasedMotor`]): motions that the kernel itself ends unless they are renewed.
//!
//! This is where the robot's own conventions end: gears and inverted motors are undone here, counts
//! become radians at the axle, and the gyro sensor's clockwise reading is turned round. Above,
//! everything is x ahead, y left, anticlockwise positive.
//!
//! # Not here
//!
//! No poses and no understanding of readings (`mapping`), no decision when to stop (`runtime`).
//!
//! # What we count on
//!
//! - A reading that fails leaves the last one with its age; [`Robot::trouble_with`] tells
//!   why.
//! - Dropping a robot stops its motors, on every way out that unwinds.

use std::io;

use crate::behavior::demands::towards;
use crate::behavior::{Demands, Drive};
use crate::clock::{MILLISECOND_NS, SECOND_NS};
use crate::ev3dev::{
    Battery, Button, Buttons, DeviceError, LightColour, Platform, Sound, StatusLights, StopAction,
};
use crate::senses::{Channel, Role, Senses};

mod battery;
mod bind;
mod config;
mod drive;
mod halt;
mod lease;
mod mend;
mod ports;
mod sensor;
mod shipped;
mod stop;
mod trouble;

use bind::Bound;
use mend::{Mended, Mender};
use stop::StopSwitch;
use trouble::Troubles;

pub use battery::{BatteryConfig, BatteryLimits};
pub use bind::{BindError, NOT_TURNED, PLUG_AGAIN, PLUG_IN};
pub use config::{
    DriveBase, HeadRole, MotorRole, NamedMotor, NamedSensor, RobotConfig, StopButton, WantedMotor,
};
pub(crate) use config::{is_name, is_own_name};
pub use halt::{HaltError, Halted, brake_all, halt, still, watch_still};
pub use lease::{Aspect, LEASE_MS, LeasedMotor, RENEW_NS};
pub use ports::{equip, equip_port};
pub use sensor::RoleSensor;
pub use shipped::{DEFAULT_ROBOT, ROBOTS, ShippedRobot};
pub use stop::stop_button_answers;

/// How near the head must come to what is asked of it, radians: half a degree, less than the gears'
/// play.
const HEAD_NEAR_RAD: f64 = 0.0087;

/// A robot whose roles are bound to devices.
#[derive(Debug)]
pub struct Robot {
    config: RobotConfig,
    left: LeasedMotor,
    right: LeasedMotor,
    head: Option<LeasedMotor>,
    motors: Vec<LeasedMotor>,
    sensors: Vec<RoleSensor>,
    /// The buttons that the mission asks for.
    buttons_needed: Vec<Channel>,
    platform: &'static Platform,
    battery: Option<Battery>,
    battery_due_ns: i64,
    buttons: Result<Buttons, DeviceError>,
    stop_switch: Option<StopSwitch>,
    /// When the stop switch was read last, nanoseconds, and why it could not be since.
    stop_read_ns: i64,
    stop_trouble: Option<DeviceError>,
    lights: Option<StatusLights>,
    sound: Option<Sound>,
    led: Option<LightColour>,
    tone_hz: Option<i32>,
    head_rad: Option<f64>,
    /// What the gyro's reading is counted from; not known between plugging it in again and its
    /// first reading.
    gyro_zero_rad: Option<f64>,
    /// Readings that failed, and commands.
    troubles: Troubles,
    refusals: Troubles,
    settle_ns: i64,
    mender: Mender,
    /// What of which motor is looked at, and which of these looks is next.
    looks: Vec<(Channel, Aspect)>,
    look: usize,
    outside: Option<Channel>,
}

/// The channels of motors.
fn motors() -> impl Iterator<Item = Channel> {
    Channel::WHEELS.into_iter().chain([Channel::Head]).chain(Channel::MOTORS)
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
        let head = self.head.iter().map(|_| Channel::Head);
        let battery = self.battery.iter().map(|_| Channel::Battery);
        let sensors = self.sensors.iter().flat_map(RoleSensor::channels);
        let buttons = self.buttons_needed.iter().copied();
        let wheels = Channel::WHEELS.into_iter();
        wheels.chain(head).chain(sensors).chain(battery).chain(motors).chain(buttons)
    }

    /// The ports of the motors that this robot has taken over, as the kernel names them.
    #[must_use]
    pub fn motor_ports(&self) -> Vec<String> {
        let motors = [&self.left, &self.right].into_iter().chain(&self.head).chain(&self.motors);
        motors.map(|motor| motor.motor().identity().address.to_string()).collect()
    }

    /// The board that it sits on.
    #[must_use]
    pub fn platform(&self) -> &'static Platform {
        self.platform
    }

    /// Whether a person can stop the robot by a button, or why not.
    ///
    /// # Errors
    ///
    /// What opening the buttons gave.
    pub fn stop_button(&self) -> Result<(), &DeviceError> {
        match &self.stop_switch {
            Some(_) => Ok(()),
            None => self.buttons.as_ref().map(|_| ()),
        }
    }

    /// Why the stop button of `robot.toml` can no longer be read, if so.
    #[must_use]
    pub fn stop_trouble(&self) -> Option<&DeviceError> {
        self.stop_trouble.as_ref()
    }

    /// From now on devices that were unplugged are looked for by a thread of their own, as a run in
    /// real time needs it: what that takes is not on the tick's path. Until then [`Robot::sense`]
    /// does it.
    ///
    /// # Errors
    ///
    /// The kernel has no room for a thread.
    pub fn mend_in_background(&mut self) -> io::Result<()> {
        self.mender.move_to_helper()
    }

    /// Reads everything once, one system call an attribute, and notes it in `senses`, whose tick
    /// and time the caller has set. True if Enter or Back was pressed, or the robot's stop button,
    /// or if that cannot be read for longer than a reading may be old.
    ///
    /// What cannot be read keeps its last reading. The battery is read about once a second. A
    /// replugged device continues from its last reading, because its own count starts at 0 again.
    pub fn sense(&mut self, senses: &mut Senses) -> bool {
        while let Some(mended) = self.mender.next(senses.time_ns) {
            let old = self.put_back(mended, senses);
            self.mender.give_back(old);
        }
        for channel in motors() {
            let Some(motor) = self.motor_mut(channel) else { continue };
            let read = motor.angle_rad().map(|angle_rad| senses.set(channel, angle_rad));
            self.note(channel, read, senses.time_ns);
        }
        for at in 0..self.sensors.len() {
            let (lead, read) = self.read_sensor(at, senses);
            self.note(lead, read, senses.time_ns);
        }
        self.read_battery(senses);
        if let Some(reading) = senses.get(Channel::Head).filter(|_| self.head.is_some()) {
            self.head_rad = Some(reading.value);
        }
        self.look_for_others(senses.time_ns);
        let is_stopped = self.read_stop_switch(senses.time_ns);
        self.read_buttons(senses) || is_stopped
    }

    fn read_stop_switch(&mut self, now_ns: i64) -> bool {
        let Some(switch) = &mut self.stop_switch else { return false };
        match switch.is_pressed() {
            Ok(is_pressed) => {
                (self.stop_read_ns, self.stop_trouble) = (now_ns, None);
                is_pressed
            }
            Err(error) => {
                self.stop_trouble = Some(error);
                now_ns - self.stop_read_ns > self.config.max_age_ns
            }
        }
    }

    /// The motor that another program has commanded or reset, if one has; it is left alone from
    /// then on.
    #[must_use]
    pub fn outside(&self) -> Option<Channel> {
        self.outside
    }

    /// As [`Robot::outside`], after a close look at everything: for a tick in which something else
    /// went wrong with a motor, which may be another program's doing.
    pub fn look_closely(&mut self, now_ns: i64) -> Option<Channel> {
        for channel in motors() {
            let taken = self.motor_mut(channel).is_some_and(|motor| motor.look_closely(now_ns));
            self.outside = self.outside.or(taken.then_some(channel));
        }
        self.outside
    }

    /// Looks at one aspect of one motor a tick, each in its turn, and at the same one again where
    /// it raised a doubt. A motor under a lease is besides looked at closely when that is renewed,
    /// so this is for those that stand.
    fn look_for_others(&mut self, now_ns: i64) {
        let Some((channel, aspect)) = self.looks.get(self.look).copied() else { return };
        let Some(motor) = self.motor_mut(channel) else { return };
        let taken = motor.is_taken(aspect, now_ns);
        let doubt = motor.is_in_doubt();
        self.outside = self.outside.or(taken.then_some(channel));
        if !doubt {
            self.look = (self.look + 1) % self.looks.len();
        }
    }

    /// Notes how reading a device went, by its first channel.
    fn note(&mut self, channel: Channel, read: Result<(), DeviceError>, now_ns: i64) {
        self.mender.note(channel, read.as_ref().err().map(DeviceError::is_gone), now_ns);
        self.troubles.note(channel, read);
    }

    /// Reads a sensor. The gyro does not know the turn that it made while unplugged: it continues
    /// from its last reading.
    fn read_sensor(
        &mut self,
        at: usize,
        senses: &mut Senses,
    ) -> (Channel, Result<(), DeviceError>) {
        let (sensor, zero_rad) = (&self.sensors[at], &mut self.gyro_zero_rad);
        let read = sensor.read(|channel, value| {
            let value = if channel == Channel::Gyro {
                let last = senses.get(channel).map(|reading| reading.value);
                value + *zero_rad.get_or_insert_with(|| last.unwrap_or(value) - value)
            } else {
                value
            };
            senses.set(channel, value);
        });
        (sensor.lead(), read)
    }

    fn read_battery(&mut self, senses: &mut Senses) {
        let Some(battery) = self.battery.as_ref().filter(|_| senses.time_ns >= self.battery_due_ns)
        else {
            return;
        };
        self.battery_due_ns = senses.time_ns + SECOND_NS;
        let read = battery.voltage_v().map(|volts| senses.set(Channel::Battery, volts));
        self.note(Channel::Battery, read, senses.time_ns);
    }

    /// A motor of this robot by its channel.
    #[must_use]
    pub fn motor(&mut self, channel: Channel) -> Option<&LeasedMotor> {
        self.motor_mut(channel).map(|motor| &*motor)
    }

    fn motor_mut(&mut self, channel: Channel) -> Option<&mut LeasedMotor> {
        match channel {
            Channel::Left => Some(&mut self.left),
            Channel::Right => Some(&mut self.right),
            Channel::Head => self.head.as_mut(),
            _ => {
                let place = Channel::MOTORS.into_iter().position(|motor| motor == channel)?;
                self.motors.get_mut(place)
            }
        }
    }

    /// Replaces a failed device with the one that was bound again; returns the failed one.
    fn put_back(&mut self, mut mended: Box<Mended>, senses: &Senses) -> Box<Mended> {
        let last = senses.get(mended.channel).map(|reading| reading.value);
        match &mut mended.bound {
            Bound::Motor(new) => {
                // Its count restarts at 0.
                new.set_zero_rad(last.unwrap_or(0.0));
                if let Some(place) = self.motor_mut(mended.channel) {
                    std::mem::swap(place, new);
                }
            }
            Bound::Sensor(new) => {
                if mended.replugged && new.role() == Role::Gyro {
                    self.gyro_zero_rad = None;
                }
                if let Some(place) =
                    self.sensors.iter_mut().find(|sensor| sensor.role() == new.role())
                {
                    std::mem::swap(place, new);
                }
            }
        }
        mended
    }

    /// Carries out the demands, within the robot's limits. A motor without a demand does not turn.
    ///
    /// A write that fails is tried again at the next tick; the lease behind it runs out meanwhile.
    pub fn act(&mut self, demands: &Demands, now_ns: i64) {
        let action = match demands.drive {
            Some(Drive::Stop(action)) => Some(action),
            _ => None,
        };
        let speeds = self.config.wheel_speeds(demands.drive);
        let wheels = [(Channel::Left, &mut self.left), (Channel::Right, &mut self.right)];
        for ((channel, wheel), speed) in wheels.into_iter().zip(speeds) {
            let done = match action {
                Some(action) => wheel.stop(action),
                None => wheel.turn(speed, now_ns),
            };
            self.refusals.note(channel, done);
        }
        let head_rad_s = self.head_speed(demands);
        if let Some(head) = &mut self.head {
            self.refusals.note(Channel::Head, head.turn(head_rad_s, now_ns));
        }
        let motors = Channel::MOTORS.into_iter().zip(&mut self.motors);
        for ((channel, motor), speed) in motors.zip(demands.motors) {
            let done = motor.turn(speed.unwrap_or(0.0), now_ns);
            self.refusals.note(channel, done);
        }
        self.show(demands);
    }

    /// Stops every motor now; true if each of them took the command.
    pub fn stop(&mut self, action: StopAction) -> bool {
        let mut stopped = true;
        for channel in motors() {
            let Some(done) = self.motor_mut(channel).map(|motor| motor.stop(action)) else {
                continue;
            };
            stopped &= done.is_ok();
            if done.is_err() {
                self.refusals.note(channel, done);
            }
        }
        if let Some(sound) = &mut self.sound {
            // A tone lasts until it is ended, also when the program has gone.
            let _ = sound.silence();
            self.tone_hz = None;
        }
        stopped
    }

    /// Why the device behind a channel could not be read the last time, or else why a motor there
    /// refused the last command. None of them where both went well: it is another device's trouble
    /// then, or its driver is silent.
    #[must_use]
    pub fn trouble_with(&self, channel: Channel) -> Option<&DeviceError> {
        let sensor = self.sensors.iter().find(|sensor| sensor.channels().any(|of| of == channel));
        let lead = sensor.map_or(channel, RoleSensor::lead);
        self.troubles.of(lead).or_else(|| self.refusals.of(lead))
    }

    /// Tells people near that the robot is about to move: an orange light, and a beep each second.
    ///
    /// - `for_ns`: how long they have been told, nanoseconds.
    pub fn announce(&mut self, for_ns: i64) {
        const BEEP_HZ: i32 = 880;
        const BEEP_NS: i64 = 200 * MILLISECOND_NS;
        self.light(LightColour::Orange);
        self.tone((for_ns.rem_euclid(SECOND_NS) < BEEP_NS).then_some(BEEP_HZ));
    }

    /// The time of the senses begins at 0 again: what is due by it is due at once.
    pub(crate) fn restart_time(&mut self) {
        (self.battery_due_ns, self.stop_read_ns) = (0, 0);
    }

    /// Notes the buttons that the mission asks for; true if Enter or Back went down since the last
    /// look, or is held down.
    fn read_buttons(&mut self, senses: &mut Senses) -> bool {
        let Ok(buttons) = &mut self.buttons else { return false };
        let Ok(changes) = buttons.changes() else { return false };
        let held = buttons.held();
        for channel in &self.buttons_needed {
            let is_down = button(*channel)
                .is_some_and(|button| held.contains(button) || changes.pressed.contains(button));
            senses.set(*channel, f64::from(u8::from(is_down)));
        }
        changes.pressed.stops()
    }

    /// The speed that takes the head to an angle within its limits, radians per second.
    fn head_speed(&self, demands: &Demands) -> f64 {
        let (Some(role), Some(wanted_rad), Some(head_rad)) =
            (&self.config.head, demands.head_rad, self.head_rad)
        else {
            return 0.0;
        };
        let missing_rad = wanted_rad.clamp(-role.limit_rad, role.limit_rad) - head_rad;
        let most_rad_s = demands.head_rad_s.unwrap_or(role.speed_rad_s).clamp(0.0, role.max_rad_s);
        towards(missing_rad, HEAD_NEAR_RAD, most_rad_s)
    }

    /// Carries out what is for people: lights and tones.
    pub fn show(&mut self, demands: &Demands) {
        if let Some(led) = demands.led {
            self.light(led);
        }
        self.tone(demands.tone_hz.and_then(audible));
    }

    /// Lights and sounds are for people: when they fail, the robot drives on.
    fn light(&mut self, led: LightColour) {
        if self.led != Some(led)
            && let Some(lights) = &mut self.lights
        {
            self.led = Some(led);
            let _ = lights.set_both(led);
        }
    }

    /// A tone from now on, hertz, or none.
    pub(crate) fn tone(&mut self, tone_hz: Option<i32>) {
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

/// The button behind a channel.
fn button(channel: Channel) -> Option<Button> {
    match channel {
        Channel::ButtonUp => Some(Button::Up),
        Channel::ButtonDown => Some(Button::Down),
        Channel::ButtonLeft => Some(Button::Left),
        Channel::ButtonRight => Some(Button::Right),
        _ => None,
    }
}

/// A tone that the speaker can make, hertz (`ev3dev-interfaces`, 11.1: 100 to 10000).
#[expect(clippy::cast_possible_truncation, reason = "limited just before")]
fn audible(tone_hz: f64) -> Option<i32> {
    (tone_hz > 0.0).then(|| tone_hz.clamp(100.0, 10_000.0) as i32)
}
