//! The brick's screen in a terminal, and its buttons on a keyboard.
//!
//! A letter of the terminal is two pixels, one above the other, where there is room for that;
//! otherwise eight, as a pattern of Braille dots; and a terminal that is smaller still shows the
//! page's text. Keys are read as bytes of the standard input, so that a pipe can press them too: `u
//! d l r`, `e` Enter, `b` Back, `q` ends.
//!
//! A terminal tells that a key was pressed and not that it was let go: a key counts as held for as
//! long as its repeat keeps coming.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::io::{self, Write};
use std::os::fd::AsFd;

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::termios::{self, LocalFlags, SetArg, Termios};

use crate::ev3dev::{Button, ButtonChanges, ButtonSet};
use crate::menu::{Canvas, Display, HEIGHT, Keys, Menu, MenuError, WIDTH};

/// A terminal that shows the screen, until this is dropped.
#[derive(Debug)]
pub(super) struct Window {
    before: Option<Termios>,
    size: Size,
}

/// How large a terminal is, letters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Size {
    columns: u32,
    rows: u32,
}

impl Size {
    /// Of the terminal at the standard output; what is none has room for all.
    fn now() -> Self {
        terminal_size::terminal_size().map_or(
            Self { columns: WIDTH / 2, rows: u32::MAX },
            |(width, height)| Self { columns: width.0.into(), rows: height.0.into() },
        )
    }

    /// Whether letters of this many pixels show all of the picture, with a row left for the keys.
    fn has_room(self, across: u32, down: u32) -> bool {
        self.columns >= WIDTH / across && self.rows > HEIGHT / down
    }
}

/// What the keys are, under the picture.
const KEYS: &str = "arrows, Enter; Backspace or Escape: Back; q closes";

/// Another screen without a cursor, and back.
const ENTER: &str = "\x1b[?1049h\x1b[?25l\x1b[2J";
const LEAVE: &str = "\x1b[?25h\x1b[?1049l";

impl Window {
    pub(super) fn open() -> io::Result<Self> {
        let stdin = io::stdin();
        let before = termios::tcgetattr(stdin.as_fd()).ok();
        if let Some(before) = &before {
            let mut raw = before.clone();
            // Ctrl-C stays a signal.
            raw.local_flags.remove(LocalFlags::ECHO | LocalFlags::ICANON);
            termios::tcsetattr(stdin.as_fd(), SetArg::TCSANOW, &raw)?;
        }
        let window = Self { before, size: Size::now() };
        put(ENTER)?;
        Ok(window)
    }
}

impl Drop for Window {
    fn drop(&mut self) {
        // A terminal that is gone needs nothing put back.
        let _ = put(LEAVE);
        if let Some(before) = &self.before {
            let _ = termios::tcsetattr(io::stdin().as_fd(), SetArg::TCSANOW, before);
        }
    }
}

impl Display for Window {
    fn show(&mut self, menu: &Menu, picture: &Canvas) -> Result<(), MenuError> {
        let page = match self.size {
            size if size.has_room(1, 2) => format!("{}{KEYS}", blocks(picture)),
            size if size.has_room(2, 4) => format!("{}{KEYS}", dots(picture)),
            size => letters(&menu.text(), size),
        };
        Ok(put(&format!("\x1b[H{page}"))?)
    }

    /// A terminal of another size has broken the lines differently.
    fn has_lost_it(&mut self) -> bool {
        let size = Size::now();
        let has_lost_it = size != std::mem::replace(&mut self.size, size);
        if has_lost_it {
            // A terminal that is gone shows at the next picture.
            let _ = put("\x1b[2J");
        }
        has_lost_it
    }
}

fn put(text: &str) -> io::Result<()> {
    let mut stream = io::stdout().lock();
    stream.write_all(text.as_bytes()).and_then(|()| stream.flush())
}

/// Two pixels a letter: the upper one is the paper's colour, the lower one the letter's.
fn blocks(picture: &Canvas) -> String {
    // The 24 greys of the 256 colours, and their white and black.
    let colour = |grey: u8| [16, 240, 248, 231].get(usize::from(grey / 64)).copied().unwrap_or(231);
    let mut text = String::new();
    for y in (0..HEIGHT).step_by(2) {
        let mut last = None;
        for x in 0..WIDTH {
            let pair = (colour(picture.pixel(x, y)), colour(picture.pixel(x, y + 1)));
            if last != Some(pair) {
                let _ = write!(text, "\x1b[48;5;{};38;5;{}m", pair.0, pair.1);
                last = Some(pair);
            }
            text.push('▄');
        }
        text.push_str("\x1b[0m\r\n");
    }
    text
}

/// Where each of a letter's eight dots is, from the lowest bit of Unicode's Braille patterns on.
const DOTS: [(u32, u32); 8] = [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (0, 3), (1, 3)];

/// Eight pixels a letter; what is darker than the middle is a dot.
fn dots(picture: &Canvas) -> String {
    let mut text = String::new();
    for y in (0..HEIGHT).step_by(4) {
        for x in (0..WIDTH).step_by(2) {
            let dark =
                |(right, down): (u32, u32)| u32::from(picture.pixel(x + right, y + down) < 128);
            let pattern = (0..).zip(DOTS).fold(0, |pattern, (bit, dot)| pattern | dark(dot) << bit);
            text.push(char::from_u32(0x2800 + pattern).unwrap_or(' '));
        }
        text.push_str("\r\n");
    }
    text
}

/// The page's text, with what is chosen in view, for a terminal without room for pixels.
fn letters(page: &str, size: Size) -> String {
    let columns = usize::try_from(size.columns.max(1)).unwrap_or(usize::MAX);
    let lines: Vec<Vec<char>> = page
        .lines()
        .flat_map(|line| {
            let letters: Vec<char> = line.chars().collect();
            let rows = letters.len().div_ceil(columns).max(1);
            (0..rows)
                .map(move |row| letters.iter().skip(row * columns).take(columns).copied().collect())
        })
        .collect();
    let rows = usize::try_from(size.rows).unwrap_or(usize::MAX);
    let from =
        format!("the screen itself from {} columns and {} rows on", WIDTH / 2, HEIGHT / 4 + 1);
    // The page needs what few rows there are.
    let foot = if rows < 8 { &[][..] } else { &["", KEYS, &from] };
    let foot = foot.iter().map(|line| line.chars().take(columns).collect());
    let room = rows.saturating_sub(foot.len()).max(1);
    let chosen = lines.iter().position(|line| line.starts_with(&['>', ' '])).unwrap_or(0);
    let shown = lines.iter().skip((chosen + room.min(2)).saturating_sub(room)).take(room);
    let shown: Vec<String> = shown.map(|line| line.iter().collect()).chain(foot).collect();
    // Erasing behind a full line would take its last letter.
    format!("\x1b[J{}", shown.join("\r\n"))
}

/// How many turns of the menu's loop a key counts as held: 0.4 s, shorter than the menu waits
/// before it repeats by itself, and long enough for most keyboards' own repeat to hold on.
const HELD_TURNS: u32 = 8;

/// The buttons on a keyboard.
#[derive(Debug)]
pub(super) struct TerminalKeys {
    waiting: VecDeque<Button>,
    /// The beginning of an arrow key's sequence.
    escape: Vec<u8>,
    held: Option<(Button, u32)>,
    ended: bool,
}

impl TerminalKeys {
    pub(super) fn open() -> Self {
        Self { waiting: VecDeque::new(), escape: Vec::new(), held: None, ended: false }
    }

    fn read(&mut self) -> io::Result<()> {
        let stdin = io::stdin();
        let mut watched = [PollFd::new(stdin.as_fd(), PollFlags::POLLIN)];
        // A signal ends the wait early, and the menu looks at its flag.
        if poll(&mut watched, PollTimeout::ZERO).unwrap_or(0) == 0 {
            // An Escape that nothing follows is the key itself.
            if self.escape.len() == 1 {
                self.escape.clear();
                self.waiting.push_back(Button::Back);
            }
            return Ok(());
        }
        let mut bytes = [0; 64];
        // Past the library's buffer, of which `poll` knows nothing.
        let count = nix::unistd::read(stdin.as_fd(), &mut bytes)?;
        self.ended |= count == 0;
        for byte in bytes.iter().take(count) {
            self.take(*byte);
        }
        Ok(())
    }

    fn take(&mut self, byte: u8) {
        self.escape.push(byte);
        let button = match self.escape.as_slice() {
            [0x1b] | [0x1b, b'['] => return,
            [0x1b, b'[', b'A'] | [b'u'] => Some(Button::Up),
            [0x1b, b'[', b'B'] | [b'd'] => Some(Button::Down),
            [0x1b, b'[', b'C'] | [b'r'] => Some(Button::Right),
            [0x1b, b'[', b'D'] | [b'l'] => Some(Button::Left),
            [b'\r' | b'\n' | b'e'] => Some(Button::Enter),
            [0x7f | 0x08 | b'b'] => Some(Button::Back),
            [b'q'] => {
                self.ended = true;
                None
            }
            _ => None,
        };
        self.escape.clear();
        self.waiting.extend(button);
    }
}

impl Keys for TerminalKeys {
    /// One key a turn. The same key again continues the hold if it comes soon enough, and is a new
    /// press for what counts presses.
    fn look(&mut self) -> Result<Option<(ButtonChanges, ButtonSet)>, MenuError> {
        self.read()?;
        let mut changes = ButtonChanges::default();
        match (self.waiting.pop_front(), self.held.take()) {
            (Some(button), held) => {
                changes.released = held.map(|(button, _)| button).into_iter().collect();
                changes.pressed = [button].into_iter().collect();
                self.held = Some((button, HELD_TURNS));
            }
            (None, Some((button, 0))) => changes.released = [button].into_iter().collect(),
            (None, Some((button, turns))) => self.held = Some((button, turns - 1)),
            (None, None) if self.ended => return Ok(None),
            (None, None) => {}
        }
        let held = self.held.map(|(button, _)| button).into_iter().collect();
        Ok(Some((changes, held)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn typed(bytes: &[u8]) -> Vec<Button> {
        let mut keys = TerminalKeys::open();
        bytes.iter().for_each(|byte| keys.take(*byte));
        keys.waiting.into_iter().collect()
    }

    #[test]
    fn arrows_and_letters_are_the_same_buttons() {
        use Button::{Back, Down, Enter, Left, Right, Up};
        assert_eq!(typed(b"\x1b[A\x1b[B\x1b[C\x1b[D\r\x7f"), [Up, Down, Right, Left, Enter, Back]);
        assert_eq!(typed(b"u d\nl r"), [Up, Down, Enter, Left, Right]);
        assert_eq!(typed(b"\x1b[Zx9u"), [Up], "what is no button is passed over");
    }

    #[test]
    fn a_picture_has_two_or_eight_pixels_a_letter() {
        let picture = Canvas::default();
        assert_eq!(blocks(&picture).matches('▄').count(), 178 * 64);
        assert_eq!(dots(&picture).matches('\u{2800}').count(), 89 * 32);
    }

    #[test]
    fn a_small_terminal_shows_the_text_around_what_is_chosen() {
        let page = format!("[Runs]\n{}> 42 map: cut\n  43", "  a run of before\n".repeat(40));
        let shown = letters(&page, Size { columns: 9, rows: 12 });
        let lines: Vec<&str> = shown.trim_start_matches("\x1b[J").split("\r\n").collect();
        assert!(lines.contains(&"> 42 map:") && lines.contains(&" cut"), "{lines:?}");
        assert!(
            lines.len() <= 12 && lines.iter().all(|line| line.chars().count() <= 9),
            "{lines:?}"
        );
        let short = letters("[Missions]\n> bump", Size { columns: 80, rows: 24 });
        assert!(short.starts_with("\x1b[J[Missions]\r\n> bump\r\n"), "{short:?}");
        let tiny = letters(&page, Size { columns: 20, rows: 5 });
        assert!(tiny.matches("\r\n").count() < 5 && tiny.contains("> 42 map: cut"), "{tiny:?}");
    }
}
