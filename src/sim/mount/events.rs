//! An input device's ioctls: those that libraries ask before they believe in one (`linux/input.h`).
//!
//! They say how long their answer may be, and so cross FUSE. EVIOCGRAB does not: its argument is a
//! number where FUSE expects an address.

use evdev::{EventType, SoundCode};
use nix::errno::Errno;

use crate::ev3dev::Button;
use crate::sim::files::{Device, Kind, SimFile};

/// Every ioctl of an input device has this as its second byte.
const TYPE: u32 = b'E' as u32;

/// `EV_VERSION` of the protocol.
const VERSION: i32 = 0x01_00_01;

/// Bytes in a set of keys: codes to 0x2ff.
const KEY_BYTES: usize = 96;

/// Bytes in any smaller set.
const SMALL_BYTES: usize = 8;

/// Answers an ioctl: its result, and the bytes for the caller, at most `room`.
///
/// # Errors
///
/// ENOTTY for any other, and for what is no input device; ENOENT for an unknown name.
pub(super) fn ioctl(file: &SimFile, command: u32, room: usize) -> Result<(i32, Vec<u8>), Errno> {
    let device = match &file.kind {
        Kind::Events { device, .. } if (command >> 8) & 0xff == TYPE => *device,
        _ => return Err(Errno::ENOTTY),
    };
    let (is_length, mut bytes) = match command & 0xff {
        0x01 => (false, VERSION.to_ne_bytes().to_vec()),
        // Bus, vendor, product and version: BUS_HOST, 1, 1, 0x100.
        0x02 => (false, [0x19_u16, 1, 1, 0x100].into_iter().flat_map(u16::to_ne_bytes).collect()),
        0x06 => (true, text(name(device))),
        0x07 if device == Device::Buttons => (true, text("gpio-keys/input0")),
        0x07 | 0x08 => return Err(Errno::ENOENT),
        0x09 | 0x19..=0x1b => (true, set(&[], SMALL_BYTES)),
        0x18 => (true, set(&pressed(file, device), KEY_BYTES)),
        // How many force feedback effects it plays: none.
        0x84 => (false, 0_i32.to_ne_bytes().to_vec()),
        // The kernel's clock for the events' times: they are the simulation's, whichever was
        // chosen.
        0xa0 => (false, Vec::new()),
        kind @ 0x20..=0x3f => (true, known(device, kind - 0x20)),
        _ => return Err(Errno::ENOTTY),
    };
    bytes.truncate(room);
    let result = if is_length { i32::try_from(bytes.len()).unwrap_or(i32::MAX) } else { 0 };
    Ok((result, bytes))
}

fn name(device: Device) -> &'static str {
    match device {
        Device::Buttons => "EV3 Brick Buttons",
        Device::Speaker => "LEGO MINDSTORMS EV3 Speaker",
    }
}

fn text(text: &str) -> Vec<u8> {
    text.bytes().chain([0]).collect()
}

fn pressed(file: &SimFile, device: Device) -> Vec<u16> {
    if device == Device::Buttons {
        file.pressed().into_iter().map(Button::code).collect()
    } else {
        Vec::new()
    }
}

/// The types of events that a device has, or the codes of one type.
fn known(device: Device, kind: u32) -> Vec<u8> {
    let own = match device {
        Device::Buttons => EventType::KEY,
        Device::Speaker => EventType::SOUND,
    };
    match (device, u16::try_from(kind).map(EventType)) {
        (_, Ok(EventType::SYNCHRONIZATION)) => {
            set(&[EventType::SYNCHRONIZATION.0, own.0], SMALL_BYTES)
        }
        (Device::Buttons, Ok(EventType::KEY)) => {
            let keys: Vec<u16> = Button::ALL.iter().map(|button| button.code()).collect();
            set(&keys, KEY_BYTES)
        }
        (Device::Speaker, Ok(EventType::SOUND)) => {
            set(&[SoundCode::SND_BELL, SoundCode::SND_TONE].map(|code| code.0), SMALL_BYTES)
        }
        _ => set(&[], SMALL_BYTES),
    }
}

/// A set of codes as the kernel gives it: an array of C longs, of which this machine's byte order
/// makes an array of bytes.
fn set(codes: &[u16], length: usize) -> Vec<u8> {
    let mut bytes = vec![0; length];
    let flip = if cfg!(target_endian = "big") { size_of::<std::ffi::c_long>() - 1 } else { 0 };
    for code in codes {
        if let Some(byte) = bytes.get_mut(usize::from(code / 8) ^ flip) {
            *byte |= 1 << (code % 8);
        }
    }
    bytes
}
