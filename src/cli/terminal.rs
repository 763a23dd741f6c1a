//! A person at a terminal, or a script that answers line by line: the [`Dialogue`] of commands.
//!
//! Reading waits in short naps, so that Ctrl-C is heard while a question is open. The end of the
//! input is no answer, and what asked is refused.

use std::fs::File;
use std::io::{self, Read, Write};
use std::os::fd::AsFd;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock};

use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use super::output::safe;
use super::{Context, Exit, Failure, Hint};
use crate::commissioning::{Dialogue, NoAnswer};
use crate::runtime::{HardwareLock, STOP_SIGNALS, StopFlags, halt_command};
use crate::threads::Background;

/// How long a nap is, milliseconds.
const NAP_MS: u8 = 100;

/// A longer answer is none.
const LONGEST_LINE: usize = 4096;

/// How often a choice is offered again.
const TRIES: usize = 5;

/// Questions on the error stream, which leaves the output to results; answers from a file or
/// standard input.
#[derive(Debug)]
pub(super) struct Terminal {
    input: File,
    pending: Vec<u8>,
    flags: StopFlags,
    /// Answers come from a file: they are shown, so that what was printed reads as a whole.
    echoes: bool,
}

impl Terminal {
    /// Answers from `answers`, or from standard input.
    pub(super) fn open(answers: Option<&Path>, flags: &StopFlags) -> Result<Self, Failure> {
        let opened = match answers {
            Some(path) => File::open(path),
            None => io::stdin().as_fd().try_clone_to_owned().map(File::from),
        };
        let what =
            answers.map_or_else(|| "standard input".to_owned(), |path| path.display().to_string());
        let input =
            opened.context(Exit::Refused, format_args!("cannot read answers from {what}"))?;
        Ok(Self { input, pending: Vec::new(), flags: flags.clone(), echoes: answers.is_some() })
    }

    /// The next line, without its end.
    fn line(&mut self) -> Result<String, NoAnswer> {
        loop {
            if let Some(line) = self.take_line() {
                if self.echoes {
                    print(&format!("{line}\n"));
                }
                return Ok(line);
            }
            if self.flags.is_raised() {
                return Err(NoAnswer::Stopped);
            }
            if self.is_readable(NAP_MS) && !self.fill() {
                // What stands before the end of a file without a newline is a line too.
                if self.pending.is_empty() {
                    return Err(NoAnswer::Closed);
                }
                self.pending.push(b'\n');
            }
        }
    }

    fn take_line(&mut self) -> Option<String> {
        let end = self.pending.iter().position(|&byte| byte == b'\n')?;
        let line: Vec<u8> = self.pending.drain(..=end).collect();
        Some(String::from_utf8_lossy(&line).trim().to_owned())
    }

    /// Takes what there is; false at the end of the input.
    fn fill(&mut self) -> bool {
        let mut bytes = [0; 256];
        match self.input.read(&mut bytes) {
            Ok(0) => false,
            Ok(count) => {
                self.pending.extend(bytes.iter().take(count));
                self.pending.len() <= LONGEST_LINE
            }
            Err(error) => error.kind() == io::ErrorKind::Interrupted,
        }
    }

    fn is_readable(&self, wait_ms: u8) -> bool {
        let mut watched = [PollFd::new(self.input.as_fd(), PollFlags::POLLIN)];
        match poll(&mut watched, PollTimeout::from(wait_ms)) {
            Ok(count) => count > 0,
            // A signal: the flags are looked at next.
            Err(errno) => errno != Errno::EINTR,
        }
    }
}

impl Dialogue for Terminal {
    fn say(&mut self, text: &str) {
        print(&format!("{text}\n"));
    }

    fn choose(
        &mut self,
        question: &str,
        choices: &[&str],
        default: usize,
    ) -> Result<usize, NoAnswer> {
        let is_short = choices == ["yes", "no"];
        for _ in 0..TRIES {
            print(&format!("{question}\n"));
            if !is_short {
                for (number, choice) in (1..).zip(choices) {
                    print(&format!("  {number}  {choice}\n"));
                }
            }
            let shown = if is_short {
                choices.get(default).copied().unwrap_or("").to_owned()
            } else {
                (default + 1).to_string()
            };
            print(&format!("[{shown}] "));
            let answer = self.line()?;
            if let Some(choice) = chosen(&answer, choices, default) {
                return Ok(choice);
            }
            let none = if is_short { "neither yes nor no" } else { "none of these" };
            print(&format!("`{answer}` is {none}\n"));
        }
        Err(NoAnswer::Unclear)
    }

    fn text(&mut self, question: &str, default: &str) -> Result<String, NoAnswer> {
        print(&format!("{question}\n[{default}] "));
        let answer = self.line()?;
        Ok(if answer.is_empty() { default.to_owned() } else { answer })
    }

    fn is_pressed(&mut self) -> bool {
        // Whatever is in the line, Enter is what counts.
        while self.is_readable(0) {
            if !self.fill() {
                break;
            }
            if self.pending.contains(&b'\n') {
                break;
            }
        }
        self.take_line().is_some()
    }
}

/// A number, or the beginning of a choice that no other begins with.
fn chosen(answer: &str, choices: &[&str], default: usize) -> Option<usize> {
    if answer.is_empty() {
        return Some(default);
    }
    if let Ok(number) = answer.parse::<usize>() {
        return number.checked_sub(1).filter(|&choice| choice < choices.len());
    }
    let answer = answer.to_lowercase();
    let mut fitting =
        (0..).zip(choices).filter(|(_, choice)| choice.to_lowercase().starts_with(&answer));
    let (choice, _) = fitting.next()?;
    fitting.next().is_none().then_some(choice)
}

/// The hardware below a brick's root, for a command that turns motors itself.
pub(super) struct Driving {
    /// Raised by whatever stops a run.
    pub(super) flags: StopFlags,
    _requests: Background,
    _lock: HardwareLock,
}

impl Driving {
    /// - `doing`: what others are told of it.
    pub(super) fn begin(root: &Path, doing: &str) -> Result<Self, Failure> {
        let flags = StopFlags::on_signals().context(Exit::Failed, NO_SIGNALS)?;
        raised_by(SIGINT, &INTERRUPTED)?;
        let _lock = HardwareLock::take(root, doing)
            .context(Exit::Refused, "the robot is taken")
            .hint(&halt_command(root))?;
        let _requests = flags
            .watch_requests(root)
            .context(Exit::Failed, "cannot listen to requests to stop")?;
        Ok(Self { flags, _requests, _lock })
    }
}

/// Flags that Ctrl-C, SIGTERM and SIGHUP raise; Ctrl-Z suspends as usual.
pub(super) fn stop_flags() -> Result<StopFlags, Failure> {
    let flags = StopFlags::default();
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        raised_by(signal, &flags.signal)?;
    }
    raised_by(SIGINT, &INTERRUPTED)?;
    Ok(flags)
}

/// The signals that stop a run, as they come: a process that drives a robot does not leave its
/// terminal while the robot drives on.
pub(super) fn signals() -> Result<Signals, Failure> {
    raised_by(SIGINT, &INTERRUPTED)?;
    Signals::new(STOP_SIGNALS).context(Exit::Failed, NO_SIGNALS)
}

fn raised_by(signal: i32, flag: &Arc<AtomicBool>) -> Result<(), Failure> {
    signal_hook::flag::register(signal, Arc::clone(flag)).context(Exit::Failed, NO_SIGNALS)?;
    Ok(())
}

/// Ctrl-C came.
static INTERRUPTED: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);

/// Ends this process as Ctrl-C does, where that came: a shell then ends its loop or script, too,
/// and drives no next mission.
pub(super) fn die_of_interrupt() {
    if INTERRUPTED.load(Ordering::Relaxed) {
        let _ = signal_hook::low_level::emulate_default_handler(SIGINT);
    }
}

const NO_SIGNALS: &str = "cannot listen to signals";

/// A reader that has gone away is no failure of the robot's.
fn print(text: &str) {
    let mut stream = io::stderr().lock();
    let _ = stream.write_all(safe(text).as_bytes()).and_then(|()| stream.flush());
}

#[cfg(test)]
mod tests {
    use super::*;

    fn person(answers: &str) -> Terminal {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("answers");
        std::fs::write(&path, answers).unwrap();
        Terminal::open(Some(&path), &StopFlags::default()).unwrap()
    }

    #[test]
    fn a_choice_may_be_a_number_or_its_beginning() {
        let choices = ["the left wheel", "the right wheel", "nothing"];
        assert_eq!(chosen("", &choices, 2), Some(2));
        assert_eq!(chosen("2", &choices, 0), Some(1));
        assert_eq!(chosen("The R", &choices, 0), Some(1));
        for answer in ["the", "0", "4", "wheel", "-1"] {
            assert_eq!(chosen(answer, &choices, 0), None, "`{answer}`");
        }
        assert_eq!(chosen("n", &["yes", "no"], 0), Some(1));
    }

    #[test]
    fn questions_are_answered_line_by_line_and_the_end_is_no_answer() {
        let mut person = person("y\n\n 0,25\nlast");
        assert_eq!(person.confirm("ready?"), Ok(true));
        assert_eq!(person.text("name?", "mapper"), Ok("mapper".to_owned()));
        assert_eq!(person.number("how wide?", 0.1, 0.0..=1.0), Ok(0.25));
        assert_eq!(person.text("name?", ""), Ok("last".to_owned()));
        assert_eq!(person.text("name?", "x"), Err(NoAnswer::Closed));
    }

    #[test]
    fn a_signal_ends_a_question_and_nonsense_ends_a_choice() {
        let mut lost = person("5\n6\n7\n8\n9\n");
        assert_eq!(lost.choose("which?", &["a", "b"], 0), Err(NoAnswer::Unclear));
        let stopped = person("");
        stopped.flags.signal.store(true, Ordering::Relaxed);
        let mut stopped = stopped;
        assert_eq!(stopped.confirm("ready?"), Err(NoAnswer::Stopped));
    }

    #[test]
    fn a_press_is_a_line_and_is_not_waited_for() {
        let mut person = person("\n\n");
        assert_eq!(
            [person.is_pressed(), person.is_pressed(), person.is_pressed()],
            [true, true, false]
        );
    }
}
