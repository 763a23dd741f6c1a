//! What a command prints, and how it ends.

use std::borrow::Cow;
use std::error::Error;
use std::fmt::Display;
use std::io::{self, IsTerminal, Write};
use std::path::Path;
use std::process::ExitCode;

use serde::Serialize;

use crate::printable::with_causes;
use crate::printable::{self, Layout};

/// How a command ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// It went wrong while it was being done.
    Failed = 1,
    /// The arguments make no sense.
    Usage = 2,
    /// A check failed before anything moved.
    Refused = 3,
    /// No brick answered in time.
    NoAnswer = 4,
    /// It worked on some bricks and not on others.
    SomeFailed = 5,
    /// A run was stopped before its end.
    Stopped = 6,
}

/// Why a command did not do what it was asked to.
#[derive(Debug)]
pub struct Failure {
    /// The exit code.
    pub exit: Exit,
    /// What went wrong, with its causes.
    pub message: String,
    /// The way out, where one is known.
    pub hint: Option<String>,
}

impl Failure {
    /// A failure with this message.
    pub fn new(exit: Exit, message: impl Into<String>) -> Self {
        Self { exit, message: message.into(), hint: None }
    }

    /// It was tried, and failed.
    pub fn failed(message: impl Into<String>) -> Self {
        Self::new(Exit::Failed, message)
    }

    /// What was asked for makes no sense.
    pub fn usage(message: impl Into<String>) -> Self {
        Self::new(Exit::Usage, message)
    }

    /// A check failed before anything moved.
    pub fn refused(message: impl Into<String>) -> Self {
        Self::new(Exit::Refused, message)
    }

    /// A run did not start; nothing moved.
    pub fn of_refused(message: impl Into<String>, way_out: Option<&str>) -> Self {
        Self { hint: way_out.map(str::to_owned), ..Self::refused(message) }
    }

    /// An error with all its causes, after what was being done.
    pub fn from_error(exit: Exit, doing: &str, error: &dyn Error) -> Self {
        Self::new(exit, format!("{doing}: {}", with_causes(error)))
    }

    /// What a person reads.
    #[must_use]
    pub fn to_text(&self) -> String {
        let message = self.message.trim_end();
        // Findings say "error:" themselves, once each.
        let prefix = if message.starts_with("error:") || message.starts_with("warning:") {
            ""
        } else {
            "error: "
        };
        let hint = self.hint.as_ref().map(|hint| format!("\n  try: {hint}")).unwrap_or_default();
        format!("{prefix}{message}{hint}")
    }

    /// The same failure with a way out.
    #[must_use]
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }
}

/// What was being done when an error came up, as `anyhow` has it.
pub(super) trait Context<T> {
    /// Fails with the error and all its causes, after what was being done.
    fn context(self, exit: Exit, doing: impl Display) -> Result<T, Failure>;
}

impl<T, E: Error> Context<T> for Result<T, E> {
    fn context(self, exit: Exit, doing: impl Display) -> Result<T, Failure> {
        self.map_err(|error| Failure::from_error(exit, &doing.to_string(), &error))
    }
}

/// The way out of a failure.
pub(super) trait Hint {
    /// The same result, a failure with a way out.
    fn hint(self, hint: &str) -> Self;
}

impl<T> Hint for Result<T, Failure> {
    fn hint(self, hint: &str) -> Self {
        self.map_err(|failure| failure.hint(hint))
    }
}

/// Nothing that is printed can control the terminal. Its length is not limited here.
pub(super) fn safe(text: &str) -> Cow<'_, str> {
    printable::shown(text, Layout::Lines, usize::MAX)
}

/// Where a command prints to.
#[derive(Debug)]
pub struct Output {
    json: bool,
    /// Why nothing can be printed any more.
    broken: Option<io::Error>,
    /// The exit code of what was done, where it is not 0.
    code: u8,
}

impl Output {
    /// Text for people, or JSON for programs.
    #[must_use]
    pub fn new(json: bool) -> Self {
        Self { json, broken: None, code: 0 }
    }

    /// Has this program end with an exit code, such as another one's.
    pub fn ends_with(&mut self, code: u8) {
        self.code = code;
    }

    /// True where a run was stopped before its end.
    #[must_use]
    pub fn was_stopped(&self) -> bool {
        self.code == Exit::Stopped as u8
    }

    /// The exit code of a command that ended so; on the error stream, why it failed.
    pub fn conclude(&mut self, ended: Result<(), Failure>) -> ExitCode {
        match ended.and_then(|()| self.arrived()) {
            Ok(()) => ExitCode::from(self.code),
            Err(failure) => self.fail(&failure),
        }
    }

    /// True where a program reads the output.
    #[must_use]
    pub fn is_json(&self) -> bool {
        self.json
    }

    /// True once nothing can be printed any more: the reader has gone away, or the disk is full.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.broken.is_some()
    }

    /// Whether all that was printed has arrived, as far as it was read.
    ///
    /// A reader that has gone away (`onbrick … | head`) is no failure.
    ///
    /// # Errors
    ///
    /// A file that the output goes into has not taken it.
    pub fn arrived(&self) -> Result<(), Failure> {
        match &self.broken {
            Some(error) if error.kind() != io::ErrorKind::BrokenPipe => {
                Err(Failure::from_error(Exit::Failed, "cannot write the output", error)
                    .hint("a file on a disk with room"))
            }
            _ => Ok(()),
        }
    }

    /// True where a person watches: progress is worth showing.
    #[must_use]
    pub fn is_watched(&self) -> bool {
        !self.json && io::stderr().is_terminal()
    }

    /// True where a person sees in one place what is printed and why it failed.
    #[must_use]
    pub fn is_one_screen(&self) -> bool {
        !self.json && io::stdout().is_terminal() && io::stderr().is_terminal()
    }

    /// Prints a line of text for people; nothing where a program reads.
    pub fn line(&mut self, text: impl AsRef<str>) {
        if !self.json {
            self.print(&safe(text.as_ref()));
        }
    }

    /// Prints a value for programs; nothing where a person reads.
    pub fn value(&mut self, value: &impl Serialize) {
        if self.json {
            // Values of ours are plain structs; what cannot be JSON would be a mistake in the
            // program, and is reported as such.
            let json = serde_json::to_string(value)
                .unwrap_or_else(|error| format!("{{\"error\":\"{error}\"}}"));
            self.print(&printable::json(&json));
        }
    }

    /// Prints the same content as text for a person and as JSON for a program.
    pub fn show(&mut self, text: impl AsRef<str>, value: &impl Serialize) {
        self.line(text);
        self.value(value);
    }

    /// As [`Output::show`]: a person gets a file's text unchanged, a program gets the value.
    pub fn text(&mut self, text: &str, value: &impl Serialize) {
        self.show(text.trim_end_matches('\n'), value);
    }

    /// Says that a file was written.
    pub fn wrote(&mut self, file: &Path) {
        self.show(format!("wrote {}", file.display()), &serde_json::json!({ "wrote": file }));
    }

    /// Says on the error stream why a command failed, and gives its exit code.
    pub fn fail(&mut self, failure: &Failure) -> ExitCode {
        #[derive(Serialize)]
        struct Said<'f> {
            error: &'f str,
            hint: Option<&'f str>,
            exit: u8,
        }
        let exit = failure.exit as u8;
        self.value(&Said { error: &failure.message, hint: failure.hint.as_deref(), exit });
        let _ = writeln!(io::stderr(), "{}", safe(&failure.to_text()));
        ExitCode::from(exit)
    }

    /// Prints bytes as they are: what another program would have.
    pub fn bytes(&mut self, bytes: &[u8]) {
        let mut out = io::stdout().lock();
        if let Err(error) = out.write_all(bytes).and_then(|()| out.flush()) {
            self.broken.get_or_insert(error);
        }
    }

    fn print(&mut self, text: &str) {
        self.bytes(format!("{text}\n").as_bytes());
    }
}
