//! Why the last try at a device failed: kept for what a person is told at the end of a run.

use crate::ev3dev::DeviceError;
use crate::senses::Channel;

/// The devices whose last try failed, by their first channels.
#[derive(Debug)]
pub(super) struct Troubles(Vec<(Channel, DeviceError)>);

impl Troubles {
    /// None yet, with room for all that there can be: a tick takes no memory.
    pub(super) fn none() -> Self {
        Self(Vec::with_capacity(Channel::ALL.len()))
    }

    /// Notes how a try went; one that went well ends the device's trouble.
    pub(super) fn note(&mut self, channel: Channel, done: Result<(), DeviceError>) {
        match done {
            Ok(()) if self.0.is_empty() => {}
            Ok(()) => self.0.retain(|(other, _)| *other != channel),
            Err(error) => match self.0.iter_mut().find(|(other, _)| *other == channel) {
                Some((_, last)) => *last = error,
                None => self.0.push((channel, error)),
            },
        }
    }

    /// Why it failed last, if it did.
    pub(super) fn of(&self, channel: Channel) -> Option<&DeviceError> {
        self.0.iter().find(|(other, _)| *other == channel).map(|(_, error)| error)
    }
}
