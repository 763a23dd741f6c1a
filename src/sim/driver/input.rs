//! Buttons and speaker: streams of the kernel's input events.

use std::collections::VecDeque;
use std::ffi::c_long;

use evdev::{EventType, SoundCode, SynchronizationCode};
use nix::errno::Errno;

use crate::ev3dev::Button;

/// The width of the time before an event: two C longs of the reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EventLayout {
    /// 16 bytes an event: the brick's own, and what a 32-bit program reads, also one that an
    /// emulator runs on a 64-bit machine.
    Bits32,
    /// 24 bytes an event: 64-bit programs.
    Bits64,
}

impl EventLayout {
    /// This program's own.
    pub const NATIVE: Self = if size_of::<c_long>() == 4 { Self::Bits32 } else { Self::Bits64 };

    /// The length of an event, bytes.
    #[must_use]
    pub const fn length(self) -> usize {
        self.time_length() + 8
    }

    const fn time_length(self) -> usize {
        match self {
            Self::Bits32 => 8,
            Self::Bits64 => 16,
        }
    }
}

/// A reader that is further behind than this has lost events, as with the kernel's own buffer.
const KEPT: usize = 64;

#[derive(Debug, Clone, Copy)]
struct Event {
    time_ns: i64,
    kind: EventType,
    code: u16,
    value: i32,
}

impl Event {
    fn bytes(self, layout: EventLayout, out: &mut Vec<u8>) {
        let microseconds = self.time_ns / 1000;
        for part in [microseconds / 1_000_000, microseconds % 1_000_000] {
            let bytes = part.to_ne_bytes();
            let half = layout.time_length() / 2;
            let low = if cfg!(target_endian = "big") { bytes.len() - half } else { 0 };
            out.extend_from_slice(bytes.get(low..low + half).unwrap_or_default());
        }
        out.extend_from_slice(&self.kind.0.to_ne_bytes());
        out.extend_from_slice(&self.code.to_ne_bytes());
        out.extend_from_slice(&self.value.to_ne_bytes());
    }
}

/// The last events of a device, numbered from its start.
#[derive(Debug, Default)]
pub(crate) struct Events {
    kept: VecDeque<Event>,
    /// Events ever: the number of the next one, where a reader that opens the file now begins.
    pub(crate) total: usize,
}

impl Events {
    /// Appends whole events from number `from` on, at most `room` bytes; returns the number of the
    /// next one.
    ///
    /// # Errors
    ///
    /// EINVAL where not one fits, EAGAIN where there is none.
    pub(crate) fn read(
        &self,
        from: usize,
        room: usize,
        layout: EventLayout,
        out: &mut Vec<u8>,
    ) -> Result<usize, Errno> {
        let room = room / layout.length();
        if room == 0 {
            return Err(Errno::EINVAL);
        }
        if from >= self.total {
            return Err(Errno::EAGAIN);
        }
        let oldest = self.total - self.kept.len();
        if from < oldest {
            let (kind, code) = (EventType::SYNCHRONIZATION, SynchronizationCode::SYN_DROPPED.0);
            Event { time_ns: 0, kind, code, value: 0 }.bytes(layout, out);
            return Ok(oldest);
        }
        let events = self.kept.iter().skip(from - oldest).take(room);
        Ok(from + events.inspect(|event| event.bytes(layout, out)).count())
    }

    /// An event and the report that ends it.
    fn push(&mut self, time_ns: i64, kind: EventType, code: u16, value: i32) {
        let report = (EventType::SYNCHRONIZATION, SynchronizationCode::SYN_REPORT.0, 0);
        for (kind, code, value) in [(kind, code, value), report] {
            self.kept.push_back(Event { time_ns, kind, code, value });
            self.total += 1;
            if self.kept.len() > KEPT {
                self.kept.pop_front();
            }
        }
    }
}

/// What the buttons have done.
#[derive(Debug, Default)]
pub(crate) struct Buttons {
    pub(crate) events: Events,
    /// The buttons that are down.
    pub(crate) pressed: Vec<Button>,
}

impl Buttons {
    /// A button goes down or up; nothing happens if it is there already.
    pub(crate) fn set(&mut self, button: Button, pressed: bool, now_ns: i64) {
        if self.pressed.contains(&button) == pressed {
            return;
        }
        if pressed {
            self.pressed.push(button);
        } else {
            self.pressed.retain(|other| *other != button);
        }
        self.events.push(now_ns, EventType::KEY, button.code(), i32::from(pressed));
    }
}

/// What the speaker plays. What is written to it, its readers read, as with any input device.
#[derive(Debug, Default)]
pub(crate) struct Speaker {
    pub(crate) events: Events,
    /// The tone that sounds now, in hertz.
    pub(crate) tone_hz: Option<u32>,
    /// The last tone that was played, also if it has ended.
    pub(crate) last_tone_hz: Option<u32>,
}

impl Speaker {
    /// Takes whole events; returns how many bytes they were.
    ///
    /// # Errors
    ///
    /// EINVAL where there is less than one event.
    pub(crate) fn write(
        &mut self,
        bytes: &[u8],
        layout: EventLayout,
        now_ns: i64,
    ) -> Result<usize, Errno> {
        let events = bytes.chunks_exact(layout.length());
        if events.len() == 0 && !bytes.is_empty() {
            return Err(Errno::EINVAL);
        }
        let taken = events.len() * layout.length();
        for event in events {
            let fields = event.get(layout.time_length()..);
            if let Some([kind_low, kind_high, code_low, code_high, value @ ..]) = fields {
                let kind = EventType(u16::from_ne_bytes([*kind_low, *kind_high]));
                let code = u16::from_ne_bytes([*code_low, *code_high]);
                let value = value.try_into().map_or(0, i32::from_ne_bytes);
                self.play(kind, code, value, now_ns);
            }
        }
        Ok(taken)
    }

    /// Sounds at a frequency in hertz, or with 0 falls silent, as if a program had written it.
    pub(crate) fn tone(&mut self, hz: u32, now_ns: i64) {
        let hz = i32::try_from(hz).unwrap_or(i32::MAX);
        self.play(EventType::SOUND, SoundCode::SND_TONE.0, hz, now_ns);
    }

    fn play(&mut self, kind: EventType, code: u16, value: i32, now_ns: i64) {
        if kind != EventType::SOUND {
            return;
        }
        let tone = match (SoundCode(code), value) {
            (SoundCode::SND_BELL | SoundCode::SND_TONE, 0) => None,
            (SoundCode::SND_BELL, _) => Some(1000),
            (SoundCode::SND_TONE, hz) => Some(hz.clamp(100, 10_000).unsigned_abs()),
            _ => return,
        };
        self.tone_hz = tone;
        self.last_tone_hz = tone.or(self.last_tone_hz);
        self.events.push(now_ns, kind, code, value);
    }
}
