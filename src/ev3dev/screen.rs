//! The brick's screen: 178 × 128 pixels in four greys, as the kernel's frame buffer.
//!
//! A picture is one byte a pixel, 0 black to 255 white, row by row; [`Screen::show`] puts all of it
//! on the panel. [`Console`] keeps the kernel's text off it meanwhile.
//!
//! The driver refreshes the panel some 50 ms after a write *through a memory map*; a write to the
//! file stays invisible until then (ev3dev issue 1357), so a frame buffer is mapped. A file that is
//! no frame buffer (the mounted simulated brick, a test's) has no ioctls and mostly cannot be
//! mapped: its layout comes from `sys/class/graphics/fb0`, and frames are written.
//!
//! # Not here
//!
//! No drawing: that is the menu's. No other layouts than 32 bits a pixel, red, green, blue from the
//! top, or the other way round as a virtual frame buffer has it: the images of ev3dev before April
//! 2018 had 1 bit, and are refused with a message.
//!
//! # What we count on
//!
//! - `FBIOGET_VSCREENINFO` and `FBIOGET_FSCREENINFO` give the layout; the name (`fix.id`) is empty
//!   on an EV3 and says nothing.
//! - The panel shows the luma's top two bits.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::fd::AsFd;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use memmap2::MmapMut;
use nix::errno::Errno;

mod console;
mod kernel;

pub use console::Console;

/// How a screen's memory is laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ScreenLayout {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Bytes from one row to the next.
    pub line_length: usize,
}

/// Why there is no screen, or no longer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScreenError {
    /// Not there, or not for this user.
    #[error("cannot use the screen {}{}", path.display(), hint(source))]
    Io {
        /// The screen's file.
        path: PathBuf,
        /// What the kernel says.
        source: io::Error,
    },
    /// The kernel's description is not understood, or the memory is laid out otherwise.
    #[error(
        "the screen {} is laid out as {found}; known is 32 bits a pixel, red 16, green 8, blue 0 \
         (or blue 16, red 0): an image of ev3dev since April 2018 has that",
        path.display()
    )]
    Layout {
        /// The screen's file.
        path: PathBuf,
        /// What it has.
        found: String,
    },
}

fn hint(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::PermissionDenied => {
            ": join the group video (sudo usermod -aG video USER, log in again)"
        }
        _ => "",
    }
}

/// A screen that pictures are put on.
#[derive(Debug)]
pub struct Screen {
    path: PathBuf,
    layout: ScreenLayout,
    memory: Memory,
}

#[derive(Debug)]
enum Memory {
    Mapped(MmapMut),
    Written { file: File, bytes: Vec<u8> },
}

impl Screen {
    /// Opens the screen at `path`; `description` is the folder where the layout is looked up if the
    /// file itself cannot be asked.
    ///
    /// # Errors
    ///
    /// [`ScreenError`].
    pub fn open(path: &Path, description: &Path) -> Result<Self, ScreenError> {
        let failed = |source| ScreenError::Io { path: path.to_owned(), source };
        let flags = nix::libc::O_CLOEXEC | nix::libc::O_NOCTTY;
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags(flags)
            .open(path)
            .map_err(failed)?;
        let (layout, memory) = match kernel::layout(file.as_fd()) {
            Ok(asked) => {
                let layout =
                    asked.map_err(|found| ScreenError::Layout { path: path.to_owned(), found })?;
                (layout, Memory::Mapped(kernel::map(&file, layout.size()).map_err(failed)?))
            }
            // It knows nothing of a frame buffer's questions.
            Err(Errno::ENOTTY | Errno::EINVAL | Errno::ENOSYS | Errno::ENODEV) => {
                let layout = described(description, path)?;
                (layout, Memory::Written { file, bytes: vec![0; layout.size()] })
            }
            Err(errno) => return Err(failed(errno.into())),
        };
        Ok(Self { path: path.to_owned(), layout, memory })
    }

    /// How the memory is laid out.
    #[must_use]
    pub fn layout(&self) -> ScreenLayout {
        self.layout
    }

    /// Shows a picture of `width` pixels a row, one byte a pixel, in the upper left corner; what
    /// does not fit is left out.
    ///
    /// # Errors
    ///
    /// [`ScreenError::Io`], only where frames are written and not mapped.
    pub fn show(&mut self, picture: &[u8], width: usize) -> Result<(), ScreenError> {
        match &mut self.memory {
            Memory::Mapped(map) => paint(map, self.layout, picture, width),
            Memory::Written { file, bytes } => {
                paint(bytes, self.layout, picture, width);
                let failed = |source| ScreenError::Io { path: self.path.clone(), source };
                file.write_all_at(bytes, 0).map_err(failed)?;
            }
        }
        Ok(())
    }
}

impl ScreenLayout {
    /// Bytes of the whole.
    #[must_use]
    pub const fn size(self) -> usize {
        self.line_length * self.height
    }
}

/// Each grey is red, green and blue alike, so their order in a word does not matter, and the fourth
/// byte is unused.
fn paint(memory: &mut [u8], layout: ScreenLayout, picture: &[u8], width: usize) {
    let rows = memory.chunks_exact_mut(layout.line_length.max(1)).take(layout.height);
    for (row, pixels) in rows.zip(picture.chunks_exact(width.max(1))) {
        let (words, _) = row.as_chunks_mut::<4>();
        for (word, luma) in words.iter_mut().take(layout.width).zip(pixels) {
            *word = [*luma, *luma, *luma, 0];
        }
    }
}

/// The layout as the files of class `graphics` say it.
fn described(folder: &Path, path: &Path) -> Result<ScreenLayout, ScreenError> {
    let number = |name: &str, place: usize| -> Result<usize, ScreenError> {
        let file = folder.join(name);
        let text = std::fs::read_to_string(&file)
            .map_err(|source| ScreenError::Io { path: file.clone(), source })?;
        let numbers: Option<Vec<usize>> =
            text.trim().split(',').map(|number| number.trim().parse().ok()).collect();
        let known = numbers.and_then(|numbers| numbers.get(place).copied());
        known.ok_or_else(|| ScreenError::Layout {
            path: path.to_owned(),
            found: format!("`{}` in {}", text.trim(), file.display()),
        })
    };
    let bits = number("bits_per_pixel", 0)?;
    let layout = ScreenLayout {
        width: number("virtual_size", 0)?,
        height: number("virtual_size", 1)?,
        line_length: number("stride", 0)?,
    };
    let largest = 4096;
    let fits = (1..=largest).contains(&layout.width)
        && (1..=largest).contains(&layout.height)
        && (layout.width * 4..=largest * 4).contains(&layout.line_length);
    if bits == 32 && fits {
        Ok(layout)
    } else {
        let ScreenLayout { width, height, line_length } = layout;
        let found = format!("{width}x{height}, {bits} bits a pixel, {line_length} bytes a row");
        Err(ScreenError::Layout { path: path.to_owned(), found })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Device and description in one folder.
    fn folder(bits: &str, size: &str, stride: &str) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        let class = root.path();
        for (name, text) in [("bits_per_pixel", bits), ("virtual_size", size), ("stride", stride)] {
            std::fs::write(class.join(name), format!("{text}\n")).unwrap();
        }
        std::fs::write(root.path().join("fb0"), []).unwrap();
        root
    }

    #[test]
    fn a_picture_lies_in_the_upper_left_corner_and_keeps_the_rows_apart() {
        let root = folder("32", "3,2", "16");
        let path = root.path().join("fb0");
        let mut screen = Screen::open(&path, root.path()).unwrap();
        screen.show(&[0, 85, 170, 255], 2).unwrap();
        let mut expected = vec![0; 32];
        expected[4..7].fill(85);
        expected[16..19].fill(170);
        expected[20..23].fill(255);
        assert_eq!(std::fs::read(&path).unwrap(), expected);
        // Larger than the screen: what does not fit is left out.
        screen.show(&[9; 100], 10).unwrap();
        assert_eq!(std::fs::read(&path).unwrap().len(), 32);
    }

    #[test]
    fn other_layouts_are_refused_with_what_they_are() {
        for (bits, size, stride) in [
            ("1", "178,128", "24"),
            ("32", "178", "712"),
            ("32", "0,128", "712"),
            ("32", "178,128", "100"),
            ("x", "178,128", "712"),
        ] {
            let root = folder(bits, size, stride);
            let refused =
                Screen::open(&root.path().join("fb0"), root.path()).unwrap_err().to_string();
            assert!(
                refused.contains("known is 32 bits a pixel"),
                "{bits} {size} {stride}: {refused}"
            );
        }
    }

    #[test]
    fn a_screen_that_is_not_there_is_said_with_its_path() {
        let root = tempfile::tempdir().unwrap();
        let refused = Screen::open(&root.path().join("fb9"), root.path()).unwrap_err().to_string();
        assert!(refused.contains("fb9"), "{refused}");
    }
}
