//! Typed devices over the attribute files of ev3dev: one file, one value, one Rust type.
//!
//! A device is a folder of small text files, and its class says which. Each class is a table: a row
//! names the file, whether it is readable, writeable or readwriteable, its Rust type and what is
//! legal in it. The macro `attributes!` makes of the table the accessors and an `ATTRIBUTES` list,
//! and the tests build their fakes of that list and hold it against a listing that the kernel's own
//! drivers gave.
//!
//! | class | type |
//! |---|---|
//! | `tacho-motor` | [`TachoMotor`] (turns), [`LinearActuator`] (pushes): a [`PositionMotor`] each |
//! | `dc-motor`, `servo-motor` | [`DcMotor`], [`ServoMotor`] |
//! | `lego-sensor` | [`TouchSensor`], [`ColourSensor`], [`UltrasonicSensor`], [`GyroSensor`], [`InfraredSensor`]; any other: [`Sensor`] |
//! | `lego-port` | [`LegoPort`] |
//! | `leds` | [`Led`], [`StatusLights`] |
//! | `power_supply` | [`Battery`] |
//! | `board-info` | [`BoardInfo`] |
//! | input events | [`Buttons`], [`Sound`] |
//! | frame buffer, console | [`Screen`], [`Console`] |
//!
//! # Use
//!
//! ```no_run
//! use std::sync::Arc;
//! use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock};
//! use onbrick::ev3dev::{LocalTree, StopAction, TachoCommand, TachoMotor, Tree};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let brick: Arc<dyn Tree> = Arc::new(LocalTree::new("/"));
//! let motor = TachoMotor::at(&brick, &"outB".parse()?)?;
//! motor.reset()?;
//! motor.set_stop_action(StopAction::Brake)?;
//! motor.set_speed_sp(motor.max_speed() / 2)?;
//! motor.set_time_sp(500)?;
//! motor.command(TachoCommand::RunTimed)?;
//! // Dropping the motor stops it: it is kept for as long as it turns.
//! MonotonicClock.sleep_ns(500 * MILLISECOND_NS);
//! # Ok(())
//! # }
//! ```
//!
//! # Costs
//!
//! A file is opened on its first use and kept. From then on a reading is one `pread` into 64 bytes
//! of stack, a write one `pwrite`, and neither allocates; nor does an error. Lists (`modes`,
//! `commands`, `trigger`) are longer, and are read when a device is bound.
//!
//! # Not here
//!
//! No retries, no sleeping, no cached readings, no motion policy: those are the layers' above. No
//! images before 2018 (Debian 8): their names differ. No camera, no recorded sound.
//!
//! # What we count on
//!
//! - The text of an attribute is made when it is read at offset 0; a write is one whole store.
//! - Set points wait for the next `command`; only `duty_cycle_sp` acts at once, in `run-direct`.
//! - Only the first line of a file matters (`uevent` apart). Plain files therefore stand in for
//!   sysfs in tests.
//! - A pulled cable takes the folder with it, and a new number comes with the next:
//!   [`Cause::Gone`], never a zero. Find the device again by its port.
//! - Other programs may change a sensor's mode between runs, but not during one: a mode is read
//!   when a sensor is bound.
//!
//! # Troubleshooting
//!
//! | what it says | what it is on the machine | what to do |
//! |---|---|---|
//! | no … on in1; there is … on in3 | the cable is in another port, or the configuration names another | move the cable, or write the other port |
//! | nothing of this kind is plugged in | a cable is loose; a UART sensor needs 1 to 3 s after it is plugged in; the port is not in the mode `auto` | wait, replug, look at `onbrick devices` |
//! | more than one … fits | two such devices and no port named | name a port |
//! | EACCES at the first write after plugging in | udev's helper makes the files group-writable some tens to hundreds of ms after they appear | try again for a second |
//! | EACCES always | the user is in neither group: `ev3dev` for devices and LEDs, `input` for buttons and speaker | `sudo usermod -aG ev3dev,input USER`, log in again |
//! | gone (ENODEV) | cable pulled; port mode written; a UART sensor lost its connection and comes back within seconds | find it again by its port |
//! | gone (ENXIO) of `value0` | a UART sensor is building its tables again | as above |
//! | no such attribute (ENXIO) of `value1` and up | the mode has fewer values | set the mode that has them |
//! | no such attribute (EOPNOTSUPP) | this driver lacks it: `poll_ms` of an EV3 sensor | do without |
//! | refused, legal is … | the value; for `speed_sp` the motor's own `max_speed` | another value |
//! | refused (EBUSY) of `mode` | another program is just setting a mode | stop that program |
//! | ETIMEDOUT of `mode` | the sensor does not answer; some gyros hang in GYRO-G&A | write the port's mode ([`LegoPort::set_mode`]), or replug |
//! | ENODATA, EAGAIN of the battery | nothing has been measured yet | try again |
//! | a motor stops, or starts, by itself | another program: brickman resets all motors at a program's end | run one program at a time |
//! | the program dies when Back is pressed | brickman's `brickrun` kills its whole process group | start it by a service or over ssh, or set `delay` in `/etc/brickrun.conf` |
//! | gyro drifts | it was moved while it started | unplug it, hold still, plug it in |

mod address;
mod battery;
mod board;
mod buttons;
mod error;
mod find;
mod inventory;
mod led;
mod motor;
mod node;
mod platform;
mod port;
mod screen;
mod sensor;
mod sound;
mod stream;
mod tree;
mod value;
mod words;

pub use address::{NotAPort, PortAddress};
pub use battery::Battery;
pub use board::BoardInfo;
pub use buttons::{Button, ButtonChanges, ButtonSet, Buttons};
pub use error::{Cause, DeviceError, Excerpt, FindError};
pub use find::{Class, Identity, devices, find};
pub use inventory::{Entry, Inventory, LiveValue};
pub use led::{Led, LightColour, Side, StatusLights};
pub use motor::{
    DcMotor, Linear, LinearActuator, MotorKind, MotorState, PositionMotor, Rotary, ServoMotor,
    TachoMotor,
};
pub use node::{AttributeSpec, Direction};
pub use platform::{
    BRICKPI, BRICKPI3, EV3, EVB, FrameBuffer, Hue, Lamp, PISTORMS, PLATFORMS, Platform,
};
pub use port::LegoPort;
pub use screen::{Console, Screen, ScreenError, ScreenLayout};
pub use sensor::{
    AngleAndRate, Beacon, Colour, ColourMode, ColourSensor, Frame, GyroMode, GyroReset, GyroSensor,
    InfraredMode, InfraredSensor, MIN_PING_INTERVAL_NS, Mode, RawReflection, RawRgb, RemoteButtons,
    RemoteCode, Sensor, SensorMode, TouchMode, TouchSensor, TypedSensor, UltrasonicMode,
    UltrasonicSensor, settle_ns,
};
pub use sound::Sound;
pub use tree::{Access, AttributeFile, LocalTree, Tree};
pub use value::{Legal, Word, Words};
pub use words::{
    BinFormat, DcCommand, Driver, Polarity, PortMode, ServoCommand, StopAction, TachoCommand,
    Technology, UnknownWord,
};
