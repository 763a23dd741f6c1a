//! The console behind the screen: its text and cursor kept off the picture, and what the buttons
//! type kept out of it.
//!
//! The kernel's console draws on the same memory as we do, and the buttons are its keyboard:
//! without this a blinking cursor would stand in the picture, and every press would be typed into
//! the shell behind it.
//!
//! # What we count on
//!
//! - Dropping a [`Console`] restores everything, also on a panic and on a signal that ends a loop.
//!   After SIGKILL, brickman's console server and systemd's `TTYReset=yes` restore it.

use std::fs::{File, OpenOptions};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

use nix::sys::termios::{self, FlushArg, LocalFlags, SetArg, Termios};

use super::kernel::{self, KD_GRAPHICS, KD_TEXT};

/// A console in graphics mode, until this is dropped.
#[derive(Debug)]
pub struct Console {
    file: File,
    typed: Option<Termios>,
}

impl Console {
    /// Takes the console that this process was started on (its standard input), or the one that is
    /// named.
    ///
    /// `None` where there is no console: over ssh, in a test, on a PC's window system. The picture
    /// is then drawn without.
    #[must_use]
    pub fn take(named: Option<&Path>) -> Option<Self> {
        let file = match named {
            Some(path) => OpenOptions::new()
                .read(true)
                .write(true)
                .custom_flags(nix::libc::O_NOCTTY | nix::libc::O_CLOEXEC)
                .open(path)
                .ok()?,
            None => File::from(std::io::stdin().as_fd().try_clone_to_owned().ok()?),
        };
        kernel::set_mode(file.as_fd(), KD_GRAPHICS).ok()?;
        let typed = quiet(file.as_fd());
        Some(Self { file, typed })
    }
}

/// No echo, and nothing handed to a shell line by line; what it was before.
fn quiet(fd: BorrowedFd<'_>) -> Option<Termios> {
    let before = termios::tcgetattr(fd).ok()?;
    let mut quiet = before.clone();
    quiet.local_flags.remove(LocalFlags::ECHO | LocalFlags::ICANON);
    termios::tcsetattr(fd, SetArg::TCSANOW, &quiet).ok()?;
    Some(before)
}

impl Drop for Console {
    fn drop(&mut self) {
        let fd = self.file.as_fd();
        if let Some(typed) = &self.typed {
            // Discards what the buttons typed meanwhile.
            let _ = termios::tcflush(fd, FlushArg::TCIFLUSH);
            let _ = termios::tcsetattr(fd, SetArg::TCSANOW, typed);
        }
        // Text, whatever it was before: a program that was killed may have left it in graphics
        // mode.
        let _ = kernel::set_mode(fd, KD_TEXT);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_console_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tty");
        std::fs::write(&path, "as it was").unwrap();
        assert!(Console::take(Some(&path)).is_none());
        assert!(Console::take(Some(&folder.path().join("none"))).is_none());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "as it was");
    }
}
