//! Faults and orders from text: one parser for control commands, scenario files, the command line
//! and the page.
//!
//! ```text
//! in1 stuck                     outB block for 2.5
//! in4 delayed 200               outB write speed_sp 500
//! in4 unplug                    battery 6.2
//! in4 plug                      battery 8 5 60
//! in4 clear                     clear
//! press enter for 1.5           release enter
//! place 0.5 -0.2 90             reset
//! tone 440                      say Hello
//! robot 2 in1 garbage text      # a comment
//! ```

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use super::kind::USUAL;
use super::{Button, DeviceFault, Port};
use crate::clock::{nanoseconds, seconds};
use crate::document::nearest_or_all;
use crate::printable::{self, Layout};
use crate::units::rounded;

/// The longest time that an order can name, seconds: a day.
pub(super) const LONGEST_S: f64 = 86_400.0;

/// Volts that a battery can have: no cells, to more than any pack gives.
pub(super) const VOLTS: RangeInclusive<f64> = 0.0..=12.0;

/// How long a press lasts that names no time, nanoseconds.
pub(super) const PRESS_NS: i64 = 200_000_000;

/// What the speaker can be asked for, hertz: what it plays is 100 to 10,000.
const TONE_HZ: RangeInclusive<f64> = 0.0..=20_000.0;

/// The most characters of `say` that are recorded.
const MOST_SAID: usize = 200;

/// How far from the world's origin a robot can be put, metres.
const PLACE_M: RangeInclusive<f64> = -1000.0..=1000.0;

/// A heading, degrees.
const HEADING_DEG: RangeInclusive<f64> = -360.0..=360.0;

/// What to do.
#[derive(Debug, Clone, PartialEq)]
pub enum Act {
    /// Something goes wrong on a port, for this many nanoseconds or until it is cleared.
    Inject(Port, DeviceFault, Option<i64>),
    /// A port is in order again, with what was in it; without one, the whole robot.
    Clear(Option<Port>),
    /// The battery goes from a voltage at rest to another.
    Battery {
        /// Volts at first.
        from_v: f64,
        /// Volts at the end, and from then on.
        to_v: f64,
        /// How long that takes, nanoseconds; 0 at once.
        over_ns: i64,
    },
    /// A button goes down, for this time in nanoseconds.
    Press(Button, i64),
    /// A button that is down goes up.
    Release(Button),
    /// The speaker sounds at this frequency in hertz, or with 0 falls silent.
    Tone(u32),
    /// Words that a person would hear.
    Say(String),
    /// A hand puts the robot elsewhere: metres, and degrees anticlockwise from x. It stands still
    /// there.
    Place {
        /// World frame.
        x_m: f64,
        /// World frame.
        y_m: f64,
        /// Anticlockwise from the world's x.
        heading_deg: f64,
    },
    /// A hand puts the robot back to where it started.
    Reset,
}

impl fmt::Display for Act {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Inject(port, fault, None) => write!(f, "{port} {fault}"),
            Self::Inject(port, fault, Some(for_ns)) => {
                write!(f, "{port} {fault} for {}", seconds(*for_ns))
            }
            Self::Clear(Some(port)) => write!(f, "{port} clear"),
            Self::Clear(None) => f.write_str("clear"),
            Self::Battery { to_v, over_ns: 0, .. } => write!(f, "battery {to_v}"),
            Self::Battery { from_v, to_v, over_ns } => {
                write!(f, "battery {from_v} {to_v} {}", seconds(*over_ns))
            }
            Self::Press(button, for_ns) => {
                write!(f, "press {} for {}", button.as_str(), seconds(*for_ns))
            }
            Self::Tone(hz) => write!(f, "tone {hz}"),
            Self::Say(words) => write!(f, "say {words}"),
            Self::Release(button) => write!(f, "release {}", button.as_str()),
            Self::Place { x_m, y_m, heading_deg } => write!(f, "place {x_m} {y_m} {heading_deg}"),
            Self::Reset => f.write_str("reset"),
        }
    }
}

/// What to do, and with which robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Order {
    /// From 0. People and files count from 1.
    pub robot: usize,
    /// What.
    pub act: Act,
}

/// A text that is no order.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "line {line}: {message}{}",
    .hint.as_ref().map(|hint| format!("; {hint}")).unwrap_or_default()
)]
pub struct OrderError {
    /// Which line, from 1.
    pub line: usize,
    /// What is wrong.
    pub message: String,
    /// The way out.
    pub hint: Option<String>,
}

impl OrderError {
    fn new(message: impl Into<String>) -> Self {
        Self { line: 1, message: message.into(), hint: None }
    }

    fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }
}

impl Order {
    /// The orders in a text, one a line; `robot` is meant where a line names none. Empty lines and
    /// comments (`#`) are left out.
    ///
    /// # Errors
    ///
    /// [`OrderError`] for the first line that is not understood.
    pub fn parse(robot: usize, text: &str) -> Result<Vec<Self>, OrderError> {
        let mut orders = Vec::new();
        for (index, line) in text.lines().enumerate() {
            let words: Vec<&str> =
                line.split('#').next().unwrap_or_default().split_whitespace().collect();
            if words.is_empty() {
                continue;
            }
            let order = Self::from_words(robot, &words);
            orders.push(order.map_err(|error| OrderError { line: index + 1, ..error })?);
        }
        Ok(orders)
    }

    fn from_words(robot: usize, words: &[&str]) -> Result<Self, OrderError> {
        if let ["robot", number, rest @ ..] = words {
            let robot = number.parse::<usize>().ok().and_then(|number| number.checked_sub(1));
            let robot = robot.ok_or_else(|| {
                OrderError::new(format!("`robot {}` is no robot", printable::name(number)))
                    .hint("robots count from 1")
            })?;
            return Ok(Self { robot, act: act(rest)? });
        }
        Ok(Self { robot, act: act(words)? })
    }
}

fn act(words: &[&str]) -> Result<Act, OrderError> {
    match words {
        [] => Err(OrderError::new("there is no order").hint("write for example `in1 stuck`")),
        ["clear"] => Ok(Act::Clear(None)),
        ["reset"] => Ok(Act::Reset),
        ["battery", rest @ ..] => battery(rest),
        ["press", rest @ ..] => press(rest),
        ["release", name] => Ok(Act::Release(button(name)?)),
        ["tone", hz] => Ok(Act::Tone(rounded(number(hz, TONE_HZ)?).unsigned_abs())),
        ["say", words @ ..] if !words.is_empty() => {
            let said = printable::shown(&words.join(" "), Layout::Line, MOST_SAID).into_owned();
            Ok(Act::Say(said))
        }
        ["place", x, y, heading] => Ok(Act::Place {
            x_m: number(x, PLACE_M)?,
            y_m: number(y, PLACE_M)?,
            heading_deg: number(heading, HEADING_DEG)?,
        }),
        ["release" | "tone" | "say" | "place", ..] => Err(OrderError::new(format!(
            "`{}` does not say it all",
            printable::name(&words.join(" "))
        ))
        .hint(
            "`release enter`, `tone 440`, `say WORDS`, or `place 0.5 -0.2 90`: metres, metres \
                 and degrees",
        )),
        [name, "clear"] => Ok(Act::Clear(Some(port(name)?))),
        [name, rest @ ..] => {
            let port = port(name)?;
            let (words, for_ns) = duration(rest)?;
            let fault = DeviceFault::from_words(words)?;
            if for_ns.is_some() && fault.is_momentary() {
                return Err(
                    OrderError::new(format!("`{fault}` is done at once")).hint("leave out `for`")
                );
            }
            Ok(Act::Inject(port, fault, for_ns))
        }
    }
}

/// A port by its name.
pub(super) fn port(name: &str) -> Result<Port, OrderError> {
    Port::named(name).ok_or_else(|| {
        OrderError::new(format!("there is no port `{}`", printable::name(name))).hint(
            "there are in1 to in4, outA to outD, and for the whole robot `battery`, `clear`, \
             `press`, `release`, `place` and `reset`",
        )
    })
}

/// A button by its name.
pub(super) fn button(name: &str) -> Result<Button, OrderError> {
    name.parse().map_err(|_| {
        let near = nearest_or_all(name, "there are", Button::WORDS.iter().copied());
        OrderError::new(format!("there is no button `{}`", printable::name(name))).hint(near)
    })
}

fn press(words: &[&str]) -> Result<Act, OrderError> {
    match duration(words)? {
        ([name], for_ns) => Ok(Act::Press(button(name)?, for_ns.unwrap_or(PRESS_NS))),
        _ => Err(OrderError::new("`press` takes one button")
            .hint("`press enter`, or `press enter for 1.5`")),
    }
}

/// Takes `for SECONDS` from the end. `write ATTRIBUTE VALUE` keeps its words: a value may be
/// anything.
fn duration<'w, 't>(words: &'w [&'t str]) -> Result<(&'w [&'t str], Option<i64>), OrderError> {
    match words {
        ["write", ..] => Ok((words, None)),
        [rest @ .., "for", time] => Ok((rest, Some(nanoseconds(number(time, 0.002..=LONGEST_S)?)))),
        _ => Ok((words, None)),
    }
}

fn battery(words: &[&str]) -> Result<Act, OrderError> {
    match words {
        [volts] => {
            let volts = number(volts, VOLTS)?;
            Ok(Act::Battery { from_v: volts, to_v: volts, over_ns: 0 })
        }
        [from, to, over] => Ok(Act::Battery {
            from_v: number(from, VOLTS)?,
            to_v: number(to, VOLTS)?,
            over_ns: nanoseconds(number(over, 0.0..=LONGEST_S)?),
        }),
        _ => Err(OrderError::new("`battery` takes one number or three")
            .hint("`battery 6.2`, or `battery 8 5 60`: from 8 V to 5 V in 60 s")),
    }
}

fn number(text: &str, range: RangeInclusive<f64>) -> Result<f64, OrderError> {
    within(text, range, "a number")
}

fn within<N: FromStr + PartialOrd + fmt::Display>(
    text: &str,
    range: RangeInclusive<N>,
    what: &str,
) -> Result<N, OrderError> {
    let shown = printable::name(text);
    let number = text.parse().map_err(|_| OrderError::new(format!("`{shown}` is not {what}")))?;
    if range.contains(&number) {
        return Ok(number);
    }
    let (least, most) = range.into_inner();
    Err(OrderError::new(format!("{shown} is out of range; it can be {least} to {most}")))
}

impl DeviceFault {
    /// A fault from its text, such as `delayed 200`.
    ///
    /// # Errors
    ///
    /// [`OrderError`] with the nearest word.
    pub fn parse(text: &str) -> Result<Self, OrderError> {
        Self::from_words(&text.split_whitespace().collect::<Vec<_>>())
    }

    pub(super) fn from_words(words: &[&str]) -> Result<Self, OrderError> {
        let Some((word, arguments)) = words.split_first() else {
            let words: Vec<&str> = Self::words().collect();
            return Err(OrderError::new("no fault is named")
                .hint(format!("there are {}", words.join(", "))));
        };
        match (*word, arguments) {
            ("garbage", ["text"]) => return Ok(Self::GarbageText),
            ("write", [attribute, value @ ..]) if !value.is_empty() => {
                return Ok(Self::Write {
                    attribute: (*attribute).to_owned(),
                    value: value.join(" "),
                });
            }
            ("write", _) => return Err(OrderError::new("`write` takes an attribute and a value")),
            _ => {}
        }
        let usual = USUAL.iter().find(|(usual, _)| usual == word).map(|(_, fault)| fault.clone());
        let Some(mut fault) = usual.or_else(|| (*word == "reset").then(Self::reset)) else {
            let message = format!("there is no fault `{}`", printable::name(word));
            let near = nearest_or_all(word, "there are", Self::words());
            return Err(OrderError::new(message).hint(near));
        };
        let mut numbers = Numbers { word, rest: arguments };
        fault.take(&mut numbers)?;
        numbers.end(fault)
    }

    /// Takes the numbers that a text has in place of the usual ones.
    fn take(&mut self, numbers: &mut Numbers<'_>) -> Result<(), OrderError> {
        match self {
            Self::Wrong { scale, offset } => {
                *scale = numbers.next(*scale, -100.0..=100.0)?;
                *offset = numbers.whole(*offset, -1_000_000..=1_000_000)?;
            }
            Self::Slow { times } => {
                *times = numbers.whole(times.cast_signed(), 1..=100_000)?.unsigned_abs();
            }
            Self::Delayed { delay_ns } => *delay_ns = numbers.milliseconds(*delay_ns, 10_000.0)?,
            Self::Intermittent { share } => *share = numbers.next(*share, 0.01..=0.99)?,
            Self::Jump { by } => *by = numbers.whole(*by, -1_000_000..=1_000_000)?,
            Self::Stale { for_ns } => *for_ns = numbers.milliseconds(*for_ns, 60_000.0)?,
            _ => {}
        }
        Ok(())
    }
}

/// The numbers behind a fault's word; each may be left out.
struct Numbers<'w> {
    word: &'w str,
    rest: &'w [&'w str],
}

impl<'w> Numbers<'w> {
    fn pop(&mut self) -> Option<&'w str> {
        let (first, rest) = self.rest.split_first()?;
        self.rest = rest;
        Some(first)
    }

    fn next(&mut self, usual: f64, range: RangeInclusive<f64>) -> Result<f64, OrderError> {
        self.pop().map_or(Ok(usual), |text| number(text, range))
    }

    fn milliseconds(&mut self, usual_ns: i64, most: f64) -> Result<i64, OrderError> {
        let text = self.pop();
        text.map_or(Ok(usual_ns), |text| Ok(nanoseconds(number(text, 0.0..=most)? / 1e3)))
    }

    fn whole(&mut self, usual: i32, range: RangeInclusive<i32>) -> Result<i32, OrderError> {
        self.pop().map_or(Ok(usual), |text| within(text, range, "a whole number"))
    }

    fn end(self, fault: DeviceFault) -> Result<DeviceFault, OrderError> {
        match self.rest.first() {
            None => Ok(fault),
            Some(word) => Err(OrderError::new(format!(
                "`{}` does not belong to `{}`",
                printable::name(word),
                self.word
            ))),
        }
    }
}
