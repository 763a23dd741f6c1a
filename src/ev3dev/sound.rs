//! Tones from the brick's speaker, through the kernel's input events.
//!
//! A tone has no end of its own: it lasts until it is silenced, even after the program has died.
//! [`Sound`] therefore silences it when it is dropped.
//!
//! # Not here
//!
//! No recorded sound: that is ALSA's, and while it plays the kernel refuses tones without saying
//! so.

use std::sync::Arc;

use evdev::{EventType, SoundCode};
use nix::errno::Errno;

use super::error::{Cause, DeviceError};
use super::node::Node;
use super::platform::Platform;
use super::stream::{Event, Stream, failure, io_cause, not_built_in};
use super::tree::{Access, Tree};
use super::value::Legal;

/// The tones that the driver plays, Hz; it would clamp others without a word.
const TONES_HZ: std::ops::RangeInclusive<i32> = 100..=10_000;

/// The brick's speaker.
#[derive(Debug)]
pub struct Sound {
    node: Node,
    stream: Stream,
    sounding: bool,
}

impl Sound {
    /// Opens a board's speaker.
    ///
    /// # Errors
    ///
    /// [`Cause::Absent`] where there is no such node; [`Cause::Other`] with EACCES for a user who
    /// is not in the group `input`.
    pub fn open(tree: &Arc<dyn Tree>, platform: &Platform) -> Result<Self, DeviceError> {
        let path = platform.speaker.ok_or_else(|| not_built_in(tree, "speaker"))?;
        let stream = Stream::open(tree, path, Access::Write)?;
        Ok(Self { node: Node::new(tree, path, None), stream, sounding: false })
    }

    /// Starts a tone, or changes the one that sounds.
    ///
    /// # Errors
    ///
    /// [`Cause::Refused`] beyond 100 to 10 000 Hz; what writing gives.
    pub fn tone(&mut self, frequency_hz: i32) -> Result<(), DeviceError> {
        if !TONES_HZ.contains(&frequency_hz) {
            let legal = Legal::Range((*TONES_HZ.start()).into(), (*TONES_HZ.end()).into());
            return Err(failure(&self.node, Cause::Refused { errno: None, legal }));
        }
        self.sounding = true;
        self.send(frequency_hz)
    }

    /// Ends the tone.
    ///
    /// # Errors
    ///
    /// What writing gives.
    pub fn silence(&mut self) -> Result<(), DeviceError> {
        self.send(0)?;
        self.sounding = false;
        Ok(())
    }

    fn send(&mut self, frequency_hz: i32) -> Result<(), DeviceError> {
        let (kind, code) = (EventType::SOUND, SoundCode::SND_TONE.0);
        let event = Event { kind, code, value: frequency_hz }.to_bytes();
        match self.stream.write(&event) {
            Ok(taken) if taken == event.len() => Ok(()),
            Ok(_) => Err(failure(&self.node, io_cause(Errno::EIO))),
            Err(errno) => Err(failure(&self.node, io_cause(errno))),
        }
    }
}

impl Drop for Sound {
    fn drop(&mut self) {
        if self.sounding {
            // An error cannot be reported from here.
            let _ = self.silence();
        }
    }
}
