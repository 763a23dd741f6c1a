//! The infrared sensor, with its remote control and beacon.

use crate::ev3dev::error::DeviceError;
use crate::ev3dev::words::words;

use super::Frame;
use super::typed::{TypedSensor, sensor_modes};

words! {
    /// The infrared sensor's usable modes. IR-S-ALT and IR-CAL are left out: the sensor stops
    /// answering in the first, and the second is the factory's.
    InfraredMode {
        /// How much comes back of what it sends.
        Proximity = "IR-PROX",
        /// Where the beacons are.
        Seek = "IR-SEEK",
        /// Which buttons of the remotes are pressed, on four channels.
        Remote = "IR-REMOTE",
        /// Which buttons of the remote on channel 1 are pressed, any number of them.
        RemoteA = "IR-REM-A",
    }
}

sensor_modes!(InfraredMode, Infrared);

/// The infrared sensor, `lego-ev3-ir`.
pub type InfraredSensor = TypedSensor<InfraredMode>;

/// A beacon that is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beacon {
    /// Where it is, −25 (left) to 25 (right); the sensor's own scale, no angle. Clockwise is
    /// positive, as the sensor has it.
    pub heading: i64,
    /// How far it is, percent of about 2 m.
    pub distance_pct: f64,
}

words! {
    /// What is pressed on one channel of the remote, with its name in missions; the discriminant is
    /// the sensor's code. Red is the left column, blue the right; more than two buttons mostly read
    /// as none.
    #[repr(u8)]
    RemoteCode {
        /// Nothing.
        None = "none",
        /// Red up.
        RedUp = "left_up",
        /// Red down.
        RedDown = "left_down",
        /// Blue up.
        BlueUp = "right_up",
        /// Blue down.
        BlueDown = "right_down",
        /// Red up and blue up.
        RedUpBlueUp = "both_up",
        /// Red up and blue down.
        RedUpBlueDown = "left_up_right_down",
        /// Red down and blue up.
        RedDownBlueUp = "left_down_right_up",
        /// Red down and blue down.
        RedDownBlueDown = "both_down",
        /// The beacon is on.
        Beacon = "beacon",
        /// Red up and red down.
        RedUpRedDown = "left_up_left_down",
        /// Blue up and blue down.
        BlueUpBlueDown = "right_up_right_down",
    }
}

impl RemoteCode {
    /// The sensor's code for it.
    #[must_use]
    pub const fn number(self) -> u8 {
        self as u8
    }
}

/// The buttons of one remote, each by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RemoteButtons {
    /// Left column, up.
    pub red_up: bool,
    /// Left column, down.
    pub red_down: bool,
    /// Right column, up.
    pub blue_up: bool,
    /// Right column, down.
    pub blue_down: bool,
}

/// What IR-REM-A reads while nothing is pressed, though its bit for blue down is set.
const REM_A_NOTHING: i32 = 384;

/// What IR-SEEK reads as the distance if it sees no beacon.
const NO_BEACON: i64 = -128;

impl InfraredSensor {
    /// How near something is, percent: 100 at about 70 cm or with nothing there. It has no unit and
    /// depends on the surface. Mode [`InfraredMode::Proximity`].
    ///
    /// # Errors
    ///
    /// [`Cause::Refused`](crate::ev3dev::Cause::Refused) in any other mode;
    /// [`Cause::Malformed`](crate::ev3dev::Cause::Malformed) beyond 0 to 100.
    pub fn proximity_pct(&self) -> Result<f64, DeviceError> {
        self.first_in(InfraredMode::Proximity, 0, 100).map(f64::from)
    }

    /// The beacons on channels 1 to 4, of one frame; `None` if there is none. Mode
    /// [`InfraredMode::Seek`].
    ///
    /// # Errors
    ///
    /// As [`InfraredSensor::proximity_pct`].
    pub fn beacons(&self) -> Result<[Option<Beacon>; 4], DeviceError> {
        self.frame_in(InfraredMode::Seek, beacons)
    }

    /// What is pressed on channels 1 to 4, of one frame. Mode [`InfraredMode::Remote`].
    ///
    /// # Errors
    ///
    /// As [`InfraredSensor::proximity_pct`], with 0 to 11.
    pub fn remotes(&self) -> Result<[RemoteCode; 4], DeviceError> {
        self.frame_in(InfraredMode::Remote, remotes)
    }

    /// What is pressed on channel 1: a short text instead of a frame. Mode
    /// [`InfraredMode::Remote`].
    ///
    /// # Errors
    ///
    /// As [`InfraredSensor::remotes`].
    pub fn remote(&self) -> Result<RemoteCode, DeviceError> {
        let number = self.first_in(InfraredMode::Remote, 0, 11)?;
        code(number.into()).ok_or_else(|| self.sensor().illegal(number, 0, 11))
    }

    /// The buttons of channel 1, each by itself. For about a second after the last was let go, and
    /// while the beacon is on, none reads as pressed. Mode [`InfraredMode::RemoteA`].
    ///
    /// # Errors
    ///
    /// As [`InfraredSensor::proximity_pct`], with 256 to 511.
    pub fn remote_buttons(&self) -> Result<RemoteButtons, DeviceError> {
        let bits = self.first_in(InfraredMode::RemoteA, 256, 511)?;
        if bits == REM_A_NOTHING {
            return Ok(RemoteButtons::default());
        }
        let is_set = |bit: i32| bits & (1 << bit) != 0;
        Ok(RemoteButtons {
            red_up: is_set(4),
            red_down: is_set(5),
            blue_up: is_set(6),
            blue_down: is_set(7),
        })
    }
}

fn beacons(frame: &Frame) -> Option<[Option<Beacon>; 4]> {
    let mut beacons = [None; 4];
    for (channel, beacon) in beacons.iter_mut().enumerate() {
        let (heading, distance) = (frame.whole(2 * channel)?, frame.whole(2 * channel + 1)?);
        *beacon = match distance {
            NO_BEACON => None,
            0..=100 if (-25..=25).contains(&heading) => {
                Some(Beacon { heading, distance_pct: *frame.values().get(2 * channel + 1)? })
            }
            _ => return None,
        };
    }
    Some(beacons)
}

fn remotes(frame: &Frame) -> Option<[RemoteCode; 4]> {
    Some([
        code(frame.whole(0)?)?,
        code(frame.whole(1)?)?,
        code(frame.whole(2)?)?,
        code(frame.whole(3)?)?,
    ])
}

fn code(number: i64) -> Option<RemoteCode> {
    RemoteCode::ALL.get(usize::try_from(number).ok()?).copied()
}
