//! The six buttons of the brick, as the kernel's input events.
//!
//! A real node is opened through the crate `evdev`, which also tells which buttons are held at the
//! start. A node that is no input device (the simulated brick's) is a stream of the same events.
//! Reading never blocks and allocates nothing after the first.
//!
//! # What we count on
//!
//! - The driver has debounced already (5 ms).
//! - Every reader of the node gets every event; under brickman, Back also kills the program.

use std::sync::Arc;

use arrayvec::ArrayVec;
use evdev::raw_stream::RawDevice;
use evdev::{AttributeSet, EventType, KeyCode, SynchronizationCode};
use nix::errno::Errno;

use super::error::DeviceError;
use super::node::Node;
use super::platform::Platform;
use super::stream::{EVENT_SIZE, Event, Stream, failure, io_cause, not_built_in};
use super::tree::{Access, Tree, errno};
use super::words::words;

words! {
    /// A button of the brick, with its name in orders and on the page.
    Button {
        /// Upper left, grey.
        Back = "back",
        /// The centre.
        Enter = "enter",
        /// Up.
        Up = "up",
        /// Left.
        Left = "left",
        /// Right.
        Right = "right",
        /// Down.
        Down = "down",
    }
}

impl Button {
    /// The kernel's code for the key (`input-event-codes.h`).
    #[must_use]
    pub const fn code(self) -> u16 {
        match self {
            Self::Back => 14,
            Self::Enter => 28,
            Self::Up => 103,
            Self::Left => 105,
            Self::Right => 106,
            Self::Down => 108,
        }
    }

    fn from_code(code: u16) -> Option<Self> {
        Self::ALL.iter().copied().find(|button| button.code() == code)
    }
}

/// Some of the buttons.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ButtonSet(u8);

impl ButtonSet {
    /// Whether a button is among them.
    #[must_use]
    pub const fn contains(self, button: Button) -> bool {
        self.0 & (1 << button as u8) != 0
    }

    /// Whether the set is empty.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether one that stops a run is among them: Enter or Back.
    #[must_use]
    pub const fn stops(self) -> bool {
        self.contains(Button::Enter) || self.contains(Button::Back)
    }

    /// The buttons.
    pub fn iter(self) -> impl Iterator<Item = Button> {
        Button::ALL.iter().copied().filter(move |button| self.contains(*button))
    }

    fn set(&mut self, button: Button, is_in: bool) {
        let bit = 1 << button as u8;
        self.0 = if is_in { self.0 | bit } else { self.0 & !bit };
    }
}

impl FromIterator<Button> for ButtonSet {
    fn from_iter<I: IntoIterator<Item = Button>>(buttons: I) -> Self {
        let mut set = Self::default();
        for button in buttons {
            set.set(button, true);
        }
        set
    }
}

/// What happened since the last look. A button that was pressed and let go in between is in both
/// sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ButtonChanges {
    /// Pressed.
    pub pressed: ButtonSet,
    /// Let go.
    pub released: ButtonSet,
}

/// The brick's buttons.
#[derive(Debug)]
pub struct Buttons {
    node: Node,
    source: Source,
    seen: Seen,
}

/// Which buttons are held, and what happened since the look before.
#[derive(Debug, Default)]
struct Seen {
    held: ButtonSet,
    changes: ButtonChanges,
}

#[derive(Debug)]
enum Source {
    Device { device: Box<RawDevice>, keys: AttributeSet<KeyCode> },
    Stream { stream: Stream, rest: Rest },
}

/// The beginning of an event whose end has not come yet.
type Rest = ArrayVec<u8, EVENT_SIZE>;

/// Events that one look takes at most, as `evdev` does.
const EVENTS_PER_READ: usize = 32;

impl Buttons {
    /// Opens a board's buttons.
    ///
    /// # Errors
    ///
    /// [`Cause::Absent`](super::Cause::Absent) where there is no such node;
    /// [`Cause::Other`](super::Cause::Other) with EACCES for a user who is not in the group
    /// `input`.
    pub fn open(tree: &Arc<dyn Tree>, platform: &Platform) -> Result<Self, DeviceError> {
        Self::open_at(tree, platform.buttons.ok_or_else(|| not_built_in(tree, "buttons"))?)
    }

    /// Opens another input device with keys, by its path below the root.
    ///
    /// # Errors
    ///
    /// As [`Buttons::open`].
    pub fn open_at(tree: &Arc<dyn Tree>, path: &str) -> Result<Self, DeviceError> {
        let node = Node::new(tree, path, None);
        let source = match Self::open_device(tree, path, &node)? {
            Some(source) => source,
            None => Source::Stream {
                stream: Stream::open(tree, path, Access::Read)?,
                rest: Rest::default(),
            },
        };
        let mut buttons = Self { node, source, seen: Seen::default() };
        buttons.learn_held()?;
        Ok(buttons)
    }

    /// The buttons that are held, as of the last look.
    #[must_use]
    pub fn held(&self) -> ButtonSet {
        self.seen.held
    }

    /// Looks what happened since the last time, with one read.
    ///
    /// # Errors
    ///
    /// What reading the node gives; nothing pending is no error.
    pub fn changes(&mut self) -> Result<ButtonChanges, DeviceError> {
        self.seen.changes = ButtonChanges::default();
        let dropped = match &mut self.source {
            Source::Device { device, .. } => read_device(device, &mut self.seen),
            Source::Stream { stream, rest } => read_stream(stream, rest, &mut self.seen),
        };
        if dropped.map_err(|errno| failure(&self.node, io_cause(errno)))? {
            self.learn_held()?;
        }
        Ok(self.seen.changes)
    }

    /// The node as an input device of the kernel; `None` if it is none.
    fn open_device(
        tree: &Arc<dyn Tree>,
        path: &str,
        node: &Node,
    ) -> Result<Option<Source>, DeviceError> {
        if tree.local_path(path).is_none() {
            return Ok(None);
        }
        let Stream::Local(file) = Stream::open(tree, path, Access::Read)? else { return Ok(None) };
        match RawDevice::from_fd(file.into()).map_err(errno) {
            Ok(device) => {
                Ok(Some(Source::Device { device: Box::new(device), keys: AttributeSet::new() }))
            }
            Err(Errno::ENODEV) => Err(failure(node, io_cause(Errno::ENODEV))),
            // A plain file, a pipe, a mounted simulation: they know nothing of an input device's
            // questions.
            Err(_) => Ok(None),
        }
    }

    /// Asks the kernel which buttons are held: at the start, and when it had to drop events.
    fn learn_held(&mut self) -> Result<(), DeviceError> {
        let Source::Device { device, keys } = &mut self.source else { return Ok(()) };
        device
            .update_key_state(keys)
            .map_err(|error| failure(&self.node, io_cause(errno(error))))?;
        for &button in Button::ALL {
            self.seen.note(button, keys.contains(KeyCode::new(button.code())));
        }
        Ok(())
    }
}

/// Takes what is pending; true if the kernel had to drop events before.
fn read_device(device: &mut RawDevice, seen: &mut Seen) -> Result<bool, Errno> {
    let events = match device.fetch_events().map_err(errno) {
        Ok(events) => events,
        Err(Errno::EAGAIN | Errno::EINTR) => return Ok(false),
        Err(errno) => return Err(errno),
    };
    let events = events.map(|event| Event {
        kind: event.event_type(),
        code: event.code(),
        value: event.value(),
    });
    Ok(seen.take(events))
}

fn read_stream(stream: &mut Stream, rest: &mut Rest, seen: &mut Seen) -> Result<bool, Errno> {
    let mut buffer = [0; EVENT_SIZE * EVENTS_PER_READ];
    let (before, free) = buffer.split_at_mut(rest.len());
    before.copy_from_slice(rest);
    let length = rest.len() + stream.read(free)?;
    let events = buffer.get(..length).unwrap_or_default().chunks_exact(EVENT_SIZE);
    *rest = events.remainder().iter().copied().collect();
    Ok(seen.take(events.filter_map(Event::parse)))
}

impl Seen {
    /// Takes what happened; true if the kernel had to drop events before.
    fn take(&mut self, events: impl Iterator<Item = Event>) -> bool {
        let mut dropped = false;
        for event in events {
            match (event.kind, Button::from_code(event.code), event.value) {
                (EventType::KEY, Some(button), 0 | 1) => self.note(button, event.value == 1),
                (EventType::SYNCHRONIZATION, ..)
                    if event.code == SynchronizationCode::SYN_DROPPED.0 =>
                {
                    dropped = true;
                }
                _ => {}
            }
        }
        dropped
    }

    fn note(&mut self, button: Button, is_held: bool) {
        if self.held.contains(button) != is_held {
            self.held.set(button, is_held);
            let ButtonChanges { pressed, released } = &mut self.changes;
            let set = if is_held { pressed } else { released };
            set.set(button, true);
        }
    }
}
