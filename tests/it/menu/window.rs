//! `onbrick menu --window` in a pseudo-terminal: what a person sees there, at every size, and what
//! is left behind.

use std::fs::File;
use std::io::{Read, Write as _};
use std::os::fd::OwnedFd;
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};

use nix::pty::{Winsize, openpty};
use nix::sys::termios::{Termios, tcgetattr};
use nix::unistd::ttyname;

use super::live::{Running, Served, eventually, onbrick};

/// A terminal with the menu in it.
struct Terminal {
    menu: Running,
    keyboard: File,
    line: OwnedFd,
    before: Termios,
    written: Arc<Mutex<Vec<u8>>>,
}

impl Terminal {
    fn with(config: &str, columns: u16, rows: u16) -> Self {
        let size = Winsize { ws_row: rows, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 };
        let pty = openpty(Some(&size), None).unwrap();
        let before = tcgetattr(&pty.slave).unwrap();
        let end = || Stdio::from(pty.slave.try_clone().unwrap());
        let mut command = onbrick(&["menu", "--window", "--config", config]);
        let menu = command.stdin(end()).stdout(end()).stderr(end()).spawn().unwrap();
        let written = Arc::new(Mutex::new(Vec::new()));
        let keyboard = File::from(pty.master);
        let (mut screen, seen) = (keyboard.try_clone().unwrap(), written.clone());
        // It ends with the last descriptor of the other side, at the latest with the test's
        // process.
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(count @ 1..) = screen.read(&mut bytes) {
                seen.lock().unwrap().extend(&bytes[..count]);
            }
        });
        Self { menu: Running(menu), keyboard, line: pty.slave, before, written }
    }

    fn keys(&mut self, keys: &str) {
        self.keyboard.write_all(keys.as_bytes()).unwrap();
    }

    fn resize(&self, columns: u16, rows: u16) {
        let mut command = Command::new("stty");
        command.arg("-F").arg(ttyname(&self.line).unwrap());
        let status =
            command.args(["cols", &columns.to_string(), "rows", &rows.to_string()]).status();
        assert!(status.unwrap().success());
    }

    fn written(&self) -> String {
        String::from_utf8_lossy(&self.written.lock().unwrap()).into_owned()
    }

    /// What was written from the upper left corner on, the last time.
    fn page(&self) -> String {
        let written = self.written();
        let page = written.rsplit_once("\x1b[H").map_or("", |(_, page)| page);
        page.replace("\x1b[K", "").replace("\x1b[J", "").replace('\r', "")
    }

    #[track_caller]
    fn shows(&self, what: &str) -> String {
        eventually(what, || {
            let page = self.page();
            if page.contains(what) { Ok(page) } else { Err(page) }
        })
    }

    /// The rows of pixels that are dark, once the picture is there in letters of this kind.
    #[track_caller]
    fn picture(&self, read: impl Fn(&str) -> Vec<Vec<bool>>) -> Vec<Vec<bool>> {
        eventually("a picture", || {
            let picture = read(&self.page());
            let is_whole = picture.len() == 128 && picture.iter().all(|row| row.len() == 178);
            if is_whole { Ok(picture) } else { Err(self.page()) }
        })
    }
}

/// Two pixels a letter, by their colours.
fn blocks(page: &str) -> Vec<Vec<bool>> {
    let mut rows = Vec::new();
    for line in page.lines().filter(|line| line.contains('▄')) {
        let (mut upper, mut lower) = (Vec::new(), Vec::new());
        for run in line.split("\x1b[48;5;").skip(1) {
            let (colours, letters) = run.split_once('m').unwrap_or_default();
            let mut dark = colours.split(";38;5;").map(|colour| ["16", "240"].contains(&colour));
            let (above, below) = (dark.next().unwrap_or_default(), dark.next().unwrap_or_default());
            for _ in letters.matches('▄') {
                upper.push(above);
                lower.push(below);
            }
        }
        rows.extend([upper, lower]);
    }
    rows
}

/// Eight pixels a letter: Unicode counts the dots of a Braille cell down the left side, down the
/// right, and the lowest row last.
fn dots(page: &str) -> Vec<Vec<bool>> {
    let is_dots = |letter: &char| ('\u{2800}'..='\u{28ff}').contains(letter);
    let mut rows = Vec::new();
    for line in page.lines().filter(|line| line.chars().any(|letter| is_dots(&letter))) {
        let mut four = vec![Vec::new(); 4];
        for letter in line.chars().filter(is_dots) {
            let bits = u32::from(letter) - 0x2800;
            for (row, (left, right)) in four.iter_mut().zip([(0, 3), (1, 4), (2, 5), (6, 7)]) {
                row.extend([left, right].map(|bit| bits >> bit & 1 == 1));
            }
        }
        rows.extend(four);
    }
    rows
}

#[test]
fn the_window_shows_one_page_at_every_size_and_leaves_the_terminal_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let mut terminal = Terminal::with(folder.path().to_str().unwrap(), 80, 24);
    let text = terminal.shows("No service");
    assert!(text.starts_with("[onbrick]\n"), "{text}");
    assert!(text.contains("q closes") && text.contains("from 89 columns and 33 rows on"), "{text}");
    terminal.resize(200, 70);
    let large = terminal.picture(blocks);
    terminal.resize(100, 40);
    assert_eq!(terminal.picture(dots), large, "the same pixels, eight a letter");
    let dark = large.iter().flatten().filter(|dark| **dark).count();
    assert!(
        (178 * 15..178 * 40).contains(&dark),
        "a black head and some words: {dark} dark pixels"
    );
    terminal.resize(40, 10);
    assert!(terminal.shows("[onbrick]").lines().count() <= 10, "{}", terminal.page());
    terminal.keys("q");
    let end = eventually("the window's end", || {
        terminal.menu.0.try_wait().unwrap().ok_or_else(|| terminal.page())
    });
    assert_eq!(end.code(), Some(0));
    eventually("the other screen's end", || {
        let written = terminal.written();
        if written.ends_with("\x1b[?25h\x1b[?1049l") { Ok(()) } else { Err(written) }
    });
    assert_eq!(tcgetattr(&terminal.line).unwrap(), terminal.before);
}

#[test]
fn arrows_enter_and_escape_lead_through_every_page_of_the_window() {
    let served = Served::new();
    let mut terminal = Terminal::with(served.config(), 80, 24);
    terminal.shows("[Missions]\n> bump");
    for page in ["[Runs]", "[Ports]", "[Set up]", "[Settings]", "[Missions]"] {
        terminal.keys("\x1b[C");
        terminal.shows(page);
    }
    terminal.keys("\r");
    terminal.shows("[Mission]\n");
    terminal.keys("\x1b");
    terminal.shows("[Missions]");
    // Pages that are read from the service: each with something that only it knows.
    for (keys, sees) in [
        ("\x1b[D", "> Lights: on"),
        ("\x1b[B\x1b[B\x1b[B", "> Pair a PC"),
        ("\r", "> Open for two minutes"),
    ] {
        terminal.keys(keys);
        terminal.shows(sees);
    }
    terminal.keys("\x7f\x1b[D\x1b[D");
    terminal.shows("outB");
    assert_eq!(terminal.menu.end().code(), Some(0));
}
