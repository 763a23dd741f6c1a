//! What can go wrong with a device, split by what the caller should do next.
//!
//! Making a [`DeviceError`] allocates nothing, only showing it does: so a sensor that is gone does
//! not cost the control loop its promise.

use std::sync::Arc;

use arrayvec::ArrayString;
use nix::errno::Errno;

use super::address::PortAddress;
use super::find::Identity;
use super::value::Legal;

/// The beginning of a value, for a message.
pub type Excerpt = ArrayString<32>;

/// One access to a device that failed: which device, which attribute, with which value, and why.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {attribute}{}: {cause}", full_name(.port.as_ref(), .device), quoted(.value.as_ref()))]
pub struct DeviceError {
    /// The device's port, where it has one and it is known.
    pub port: Option<PortAddress>,
    /// The device's folder below the root: `sys/class/tacho-motor/motor0`.
    pub device: Arc<str>,
    /// The attribute.
    pub attribute: &'static str,
    /// The value that was to be written, or the text that was read and not understood; cut where it
    /// is long.
    pub value: Option<Excerpt>,
    /// Why, sorted by what to do.
    pub cause: Cause,
}

/// Why an access failed, split by what to do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Cause {
    /// The cable was pulled, the driver was unbound, or a UART sensor has lost its connection and
    /// is coming back: look the port up again.
    #[error("the device is gone ({0})")]
    Gone(Errno),
    /// The device is there and has nothing of this name, or no such value in its present mode: the
    /// wrong device or the wrong mode.
    #[error("the device has no such attribute ({0})")]
    Absent(Errno),
    /// The value is not legal, by our own check (no error number) or by the driver's: change the
    /// value, do not try again.
    #[error("refused{}, legal is {legal}", number(.errno.as_ref()))]
    Refused {
        /// The driver's answer; none if nothing was written because we knew it to be wrong.
        errno: Option<Errno>,
        /// What is legal.
        legal: Legal,
    },
    /// The text is not what such an attribute reads as: the driver and this program disagree.
    #[error("not understood, expected {0}")]
    Malformed(Legal),
    /// Permissions (EACCES; wait a second after plugging in, then look at the groups), a mode
    /// change that was not answered (ETIMEDOUT; try again), a battery that is not measured yet
    /// (ENODATA, EAGAIN; try again), and everything else.
    #[error("{0}{hint}", hint = hint(*.0))]
    Other(Errno),
}

impl DeviceError {
    /// Whether the device is gone.
    #[must_use]
    pub fn is_gone(&self) -> bool {
        matches!(self.cause, Cause::Gone(_))
    }

    /// Whether the device has no such attribute.
    #[must_use]
    pub fn is_absent(&self) -> bool {
        matches!(self.cause, Cause::Absent(_))
    }

    /// Whether permission was denied: for a moment after a device was plugged in, or for good.
    #[must_use]
    pub fn is_denied(&self) -> bool {
        matches!(self.cause, Cause::Other(Errno::EACCES | Errno::EPERM))
    }

    /// The kernel's error number, if it was the kernel who refused.
    #[must_use]
    pub fn errno(&self) -> Option<Errno> {
        match self.cause {
            Cause::Gone(errno) | Cause::Absent(errno) | Cause::Other(errno) => Some(errno),
            Cause::Refused { errno, .. } => errno,
            Cause::Malformed(_) => None,
        }
    }
}

/// A device that could not be found, or not exactly one.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FindError {
    /// Nothing fits: plug it in, or write another port.
    #[error("no {wanted}; {}", what_is(.there))]
    Nothing {
        /// What was looked for.
        wanted: String,
        /// What there is of this class.
        there: Vec<Identity>,
    },
    /// Something else is plugged in there.
    #[error("no {wanted}, but {}; {}", .found.driver, what_is(.there))]
    Other {
        /// What was looked for.
        wanted: String,
        /// What is there instead.
        found: Box<Identity>,
        /// What there is of this class.
        there: Vec<Identity>,
    },
    /// More than one fits: say which port.
    #[error("more than one {wanted}, name a port; {}", what_is(.fitting))]
    Several {
        /// What was looked for.
        wanted: String,
        /// What fits.
        fitting: Vec<Identity>,
    },
    /// The class's folder could not be listed.
    #[error("{folder} cannot be listed: {errno}")]
    Unlisted {
        /// The folder below the root.
        folder: String,
        /// The kernel's answer.
        errno: Errno,
    },
    /// The device was found, and then could not be read.
    #[error(transparent)]
    Device(#[from] DeviceError),
}

/// The beginning of some bytes as text that can be printed.
pub(crate) fn excerpt(bytes: &[u8]) -> Excerpt {
    let mut text = Excerpt::new();
    for &byte in bytes {
        let printed = if byte.is_ascii_graphic() || byte == b' ' { char::from(byte) } else { '?' };
        if text.remaining_capacity() <= '…'.len_utf8() {
            text.push('…');
            break;
        }
        text.push(printed);
    }
    text
}

fn full_name(port: Option<&PortAddress>, folder: &str) -> String {
    port.map_or_else(|| folder.to_owned(), |port| format!("{port} ({folder})"))
}

fn quoted(value: Option<&Excerpt>) -> String {
    value.map_or_else(String::new, |value| format!(" `{value}`"))
}

fn number(errno: Option<&Errno>) -> String {
    errno.map_or_else(String::new, |errno| format!(" ({errno})"))
}

fn hint(errno: Errno) -> &'static str {
    match errno {
        Errno::EACCES => "; just plugged in, wait a second; else join the groups ev3dev and input",
        Errno::ETIMEDOUT => "; the sensor did not answer, try again or replug it",
        Errno::ENODATA | Errno::EAGAIN => "; not measured yet, try again",
        _ => "",
    }
}

fn what_is(there: &[Identity]) -> String {
    let each: Vec<String> =
        there.iter().map(|one| format!("{} on {}", one.driver, one.address)).collect();
    if each.is_empty() {
        return "nothing of this kind is plugged in".to_owned();
    }
    format!("there is {}", each.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_is_small_and_can_be_sent_to_another_thread() {
        fn sendable<T: Send + Sync + 'static>() {}
        sendable::<DeviceError>();
        sendable::<FindError>();
        assert!(size_of::<DeviceError>() <= 128, "{} bytes", size_of::<DeviceError>());
    }

    #[test]
    fn an_excerpt_shows_the_beginning_of_anything() {
        assert_eq!(excerpt(b"fly").as_str(), "fly");
        assert_eq!(excerpt(b"a\nb\xff").as_str(), "a?b?");
        let cut = excerpt(&[b'x'; 100]);
        assert!(cut.ends_with('…') && cut.len() <= 32, "{cut}");
    }

    #[test]
    fn a_message_names_port_attribute_value_and_what_is_legal() {
        let error = DeviceError {
            port: "ev3-ports:outB".parse().ok(),
            device: "sys/class/tacho-motor/motor0".into(),
            attribute: "speed_sp",
            value: Some(excerpt(b"1051")),
            cause: Cause::Refused { errno: None, legal: Legal::Range(-1050, 1050) },
        };
        assert_eq!(
            error.to_string(),
            "outB (sys/class/tacho-motor/motor0): speed_sp `1051`: refused, legal is -1050 to 1050"
        );
    }
}
