//! A run over time: what it sensed and estimated, what it was told to do, its machines' states, and
//! what happened.
//!
//! What was sensed and what happened is recorded. What the machines demanded is not, and is worked
//! out again as a replay does ([`Cast`]), so it is what it was, bit for bit.
//!
//! | column | is |
//! |---|---|
//! | `range_m`, `heading_deg`, `motor.NAME`, `sensor.NAME` ... | a signal by its name in conditions, in its unit |
//! | `travelled_m` | metres driven |
//! | `found` | a variable of the mission |
//! | `do.left_dps`, `do.right_dps`, `do.head_deg`, `do.NAME_dps`, `do.tone_hz` | what was demanded |
//! | `drive.state` | the state of a machine |
//! | `do.led`, `do.say` | what people were shown and told |
//!
//! # Not here
//!
//! Signals that each machine has for itself (`state_s`, `done`).

use std::fmt::Write as _;

use super::export::csv_text;
use crate::behavior::Demands;
use crate::clock::seconds;
use crate::document::one_of;
use crate::mapping::Range;
use crate::printable;
use crate::recording::Run;
use crate::runtime::{Again, Cast, ReplayError, Step};
use crate::senses::{Channel, QUANTITIES, Senses};
use crate::units::{degrees, rounded_to, wrap_rad};

/// A run over time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Timeline {
    /// The robot's name.
    pub robot: String,
    /// The mission's.
    pub mission: String,
    /// Seconds since the run's start, of each tick.
    pub times_s: Vec<f64>,
    /// What has numbers.
    pub signals: Vec<Signal>,
    /// The state of each machine, and further texts.
    pub texts: Vec<Texts>,
    /// How many of `texts` are machines'.
    pub machines: usize,
    /// What happened, in order.
    pub marks: Vec<Mark>,
}

/// A signal: a number for each tick.
#[derive(Debug, Clone, PartialEq)]
pub struct Signal {
    /// Its name.
    pub name: String,
    /// NaN where it was not known, or had nothing to measure.
    pub values: Vec<f64>,
}

/// A text for each tick; empty where there was none.
#[derive(Debug, Clone, PartialEq)]
pub struct Texts {
    /// Its name.
    pub name: String,
    /// In the order of the ticks.
    pub values: Vec<String>,
}

/// Something that happened.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// Seconds since the run's start.
    pub time_s: f64,
    /// Which kind: one of [`Mark::KINDS`].
    pub kind: &'static str,
    /// What.
    pub text: String,
}

impl Mark {
    /// The kinds of marks: what the mission says, shows and sounds, what the robot runs into, and
    /// what the runtime has to say.
    pub const KINDS: [&'static str; 6] = ["says", "lights", "tone", "bump", "stall", "log"];

    /// A line of the log, whose first word says what it is of.
    fn of_log(time_s: f64, line: &str) -> Self {
        let said = line.split_once(": ").and_then(|(word, text)| {
            let kind = Self::KINDS.into_iter().find(|kind| *kind == word)?;
            Some((kind, text))
        });
        let (kind, text) = said.unwrap_or(("log", line));
        Self { time_s, kind, text: text.to_owned() }
    }
}

/// A name that no signal of the run has.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the run has no signal `{name}`")]
pub struct UnknownSignal {
    /// The name.
    pub name: String,
    /// All names, and the nearest, where one is near.
    pub hint: String,
}

impl Signal {
    /// What its values are in, by its name.
    #[must_use]
    pub fn unit(&self) -> &'static str {
        const UNITS: [(&str, &str); 9] = [
            ("_mps", "m/s"),
            ("_dps", "°/s"),
            ("_deg", "°"),
            ("_pct", "%"),
            ("_hz", "Hz"),
            ("_cm", "cm"),
            ("_m", "m"),
            ("_s", "s"),
            ("_v", "V"),
        ];
        if self.name.starts_with("motor.") {
            return "°";
        }
        let found = UNITS.iter().find(|(ending, _)| self.name.ends_with(ending));
        found.map_or("", |(_, unit)| unit)
    }
}

impl Timeline {
    /// A run over time.
    ///
    /// # Errors
    ///
    /// [`ReplayError`]: the recording does not say with which robot or mission it was made, or
    /// these do not load any more.
    pub fn of_run(run: &Run) -> Result<Self, ReplayError> {
        let mut again = Again::of(run, Cast::of(run)?);
        let names = Names::of(&again.cast);
        let start_ns = again.cast.info.start_ns;
        let since_s = |time_ns: i64| seconds(time_ns.saturating_sub(start_ns));
        let mut columns: Vec<Vec<f64>> = vec![Vec::new(); names.numbers.len()];
        let mut texts: Vec<Vec<String>> = vec![Vec::new(); names.texts.len()];
        let mut marks = Vec::new();
        let (mut touched, mut stalled) = (false, false);
        for senses in &run.senses {
            let step = again.step(senses, |_| {});
            let time_s = since_s(senses.time_ns);
            let known = step.as_ref().map(|step| (step, &again.demands));
            let row = numbers(&again.cast, senses, known);
            columns.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
            let row = words(&again.cast, known);
            texts.iter_mut().zip(row).for_each(|(column, text)| column.push(text));
            let mut mark = |kind, text: &str| {
                marks.push(Mark { time_s, kind, text: text.to_owned() });
            };
            let is_touched = senses.get(Channel::Touch).is_some_and(|touch| touch.value > 0.5);
            if is_touched && !touched {
                mark("bump", "the touch sensor is pressed");
            }
            let is_stalled = step.is_some_and(|step| step.stalled);
            if is_stalled && !stalled {
                mark("stall", "a wheel is blocked");
            }
            (touched, stalled) = (is_touched, is_stalled);
        }
        marks.extend(run.logs.iter().map(|line| Mark::of_log(since_s(line.time_ns), &line.text)));
        marks.sort_by(|one, other| one.time_s.total_cmp(&other.time_s));
        let is_known = |values: &[f64]| values.iter().any(|value| !value.is_nan());
        let mut signals: Vec<_> = names.numbers.into_iter().zip(columns).collect();
        // A robot that heard no echo in the whole run has a range all the same.
        let listened = signals.iter().any(|(name, values)| name == "echo" && is_known(values));
        signals.retain(|(name, values)| is_known(values) || listened && name == "range_m");
        let texts = names.texts.into_iter().zip(texts);
        let cast = again.cast;
        Ok(Self {
            robot: cast.info.brick,
            mission: cast.info.mission,
            times_s: run.senses.iter().map(|senses| since_s(senses.time_ns)).collect(),
            signals: signals.into_iter().map(|(name, values)| Signal { name, values }).collect(),
            texts: texts.map(|(name, values)| Texts { name, values }).collect(),
            machines: cast.mission.machines().len(),
            marks,
        })
    }

    /// Signals by their names.
    ///
    /// # Errors
    ///
    /// [`UnknownSignal`], the first.
    pub fn named(&self, names: &[String]) -> Result<Vec<&Signal>, UnknownSignal> {
        let find = |name: &String| {
            self.signals.iter().find(|signal| signal.name == *name).ok_or_else(|| {
                let hint = one_of(name, self.signals.iter().map(|signal| signal.name.as_str()));
                UnknownSignal { name: printable::line(name).into_owned(), hint }
            })
        };
        names.iter().map(find).collect()
    }

    /// Seconds from the start to the last tick.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.times_s.last().copied().unwrap_or(0.0)
    }
}

/// All signals of runs, their commands and states, a row a tick: `time_s`, `robot`, and the columns
/// of each run; what a run does not have or did not know is empty.
#[must_use]
pub fn csv(timelines: &[Timeline]) -> String {
    let mut names: Vec<&str> = Vec::new();
    for timeline in timelines {
        let own = timeline.signals.iter().map(|signal| &signal.name);
        for name in own.chain(timeline.texts.iter().map(|texts| &texts.name)) {
            if !names.contains(&name.as_str()) {
                names.push(name);
            }
        }
    }
    let head: String = names.iter().map(|name| format!(",{}", csv_text(name))).collect();
    let mut text = format!("time_s,robot{head}\n");
    for timeline in timelines {
        let robot = csv_text(&timeline.robot);
        let columns: Vec<(Option<&Signal>, Option<&Texts>)> = names
            .iter()
            .map(|name| {
                let signal = timeline.signals.iter().find(|signal| signal.name == *name);
                (signal, timeline.texts.iter().find(|texts| texts.name == *name))
            })
            .collect();
        for (tick, time_s) in timeline.times_s.iter().enumerate() {
            // Writing to a string cannot fail.
            let _ = write!(text, "{time_s:.6},{robot}");
            for (signal, texts) in &columns {
                text.push(',');
                if let Some(value) = signal.and_then(|signal| signal.values.get(tick))
                    && value.is_finite()
                {
                    // Minus zero plus zero is zero, without the sign.
                    let _ = write!(text, "{}", rounded_to(*value, 1e6) + 0.0);
                }
                if let Some(word) = texts.and_then(|texts| texts.values.get(tick)) {
                    text.push_str(&csv_text(word));
                }
            }
            text.push('\n');
        }
    }
    text
}

/// The names of all columns that a run may have.
struct Names {
    numbers: Vec<String>,
    texts: Vec<String>,
}

impl Names {
    /// In the order of [`numbers()`] and [`words()`].
    fn of(cast: &Cast) -> Self {
        let sensed = QUANTITIES.iter().filter(|quantity| !quantity.name.is_empty());
        let mut numbers: Vec<String> = sensed.map(|quantity| quantity.name.to_owned()).collect();
        let motors = || cast.robot.motors.iter().map(|motor| &motor.name);
        numbers.extend(motors().map(|name| format!("motor.{name}")));
        let sensors = cast.robot.named_sensors.iter();
        numbers.extend(sensors.map(|sensor| format!("sensor.{}", sensor.name)));
        numbers.extend(["echo", "heading_deg", "x_m", "y_m", "travelled_m"].map(str::to_owned));
        numbers.extend(cast.mission.variables().iter().map(|(name, _)| name.clone()));
        let demanded = ["do.left_dps", "do.right_dps", "do.head_deg", "do.tone_hz"];
        numbers.extend(demanded.map(str::to_owned));
        numbers.extend(motors().map(|name| format!("do.{name}_dps")));
        let machines = cast.mission.machines().iter();
        let texts = machines.map(|machine| format!("{}.state", machine.name));
        let texts = texts.chain(["do.led", "do.say"].map(str::to_owned)).collect();
        Self { numbers, texts }
    }
}

/// A tick's numbers.
fn numbers(cast: &Cast, senses: &Senses, known: Option<(&Step, &Demands)>) -> Vec<f64> {
    let sensed = |channel: Channel| {
        let value = senses.fresh(channel, cast.robot.age_limit_ns(channel));
        value.map_or(f64::NAN, |value| channel.quantity().unit.in_conditions(value))
    };
    let estimate = known.map(|(step, _)| step.estimate);
    let range = estimate.and_then(|estimate| estimate.range);
    let range_m = match range {
        Some(Range::Echo(range_m)) => range_m,
        Some(Range::TooNear) => 0.0,
        Some(Range::NoEcho) | None => f64::NAN,
    };
    let is_echo = |range| f64::from(u8::from(!matches!(range, Range::NoEcho)));
    let quantities = QUANTITIES.iter().filter(|quantity| !quantity.name.is_empty());
    let mut row: Vec<f64> = quantities
        .map(|quantity| match quantity.channel {
            Channel::Range => range_m,
            channel => sensed(channel),
        })
        .map(|value| if value.is_finite() { value } else { f64::NAN })
        .collect();
    let motors = cast.robot.motors.len();
    row.extend(Channel::MOTORS.into_iter().take(motors).map(sensed));
    let sensors = cast.robot.named_sensors.len();
    row.extend(Channel::SENSORS.into_iter().take(sensors).map(sensed));
    row.push(range.map_or(f64::NAN, is_echo));
    let unknown = [f64::NAN; 4];
    row.extend(estimate.map_or(unknown, |estimate| {
        let pose = estimate.pose;
        [degrees(wrap_rad(pose.heading_rad)), pose.x_m, pose.y_m, estimate.travelled_m]
    }));
    let variables = cast.pilot.program().variables();
    row.extend(variables.iter().map(|value| if known.is_some() { *value } else { f64::NAN }));
    let Some((_, demands)) = known else {
        row.extend(std::iter::repeat_n(f64::NAN, 4 + motors));
        return row;
    };
    let or_nan = |value: Option<f64>| value.unwrap_or(f64::NAN);
    row.extend(cast.robot.wheel_speeds(demands.drive).map(degrees));
    row.extend([or_nan(demands.head_rad.map(degrees)), or_nan(demands.tone_hz)]);
    row.extend(demands.motors.iter().take(motors).map(|speed| degrees(speed.unwrap_or(0.0))));
    row
}

/// A tick's texts.
fn words(cast: &Cast, known: Option<(&Step, &Demands)>) -> Vec<String> {
    let machines = cast.mission.machines().len();
    let Some((_, demands)) = known else { return vec![String::new(); machines + 2] };
    let states = cast.pilot.program().states().map(|state| printable::line(state).into_owned());
    states
        .chain([
            demands.led.map_or_else(String::new, |led| led.to_string()),
            demands.say.map_or_else(String::new, |say| {
                printable::line(&say.replace('\n', " / ")).into_owned()
            }),
        ])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_follow_from_names() {
        let unit = |name: &str| Signal { name: name.to_owned(), values: Vec::new() }.unit();
        let names = ["range_m", "do.left_dps", "heading_deg", "motor.arm", "battery_v", "found"];
        assert_eq!(names.map(unit), ["m", "°/s", "°", "°", "V", ""]);
    }

    #[test]
    fn lines_of_the_log_are_marks_of_their_kinds() {
        let kind = |line: &str| Mark::of_log(1.0, line).kind;
        let lines = ["says: found 3", "lights: red", "tone: 440 Hz", "lost: head; waiting"];
        assert_eq!(lines.map(kind), ["says", "lights", "tone", "log"]);
        assert_eq!(Mark::of_log(1.0, "says: a: b").text, "a: b");
    }

    #[test]
    fn a_table_has_the_columns_of_all_runs_and_what_is_not_known_is_empty() {
        let signal =
            |name: &str, values: &[f64]| Signal { name: name.to_owned(), values: values.to_vec() };
        let one = Timeline {
            robot: "a,b".to_owned(),
            times_s: vec![0.0, 0.02],
            signals: vec![signal("range_m", &[f64::NAN, 0.25])],
            texts: vec![Texts { name: "m.state".to_owned(), values: vec!["x".to_owned(); 2] }],
            machines: 1,
            ..Timeline::default()
        };
        let other = Timeline {
            robot: "c".to_owned(),
            times_s: vec![0.0],
            signals: vec![signal("found", &[-0.0])],
            ..Timeline::default()
        };
        let expected = "time_s,robot,range_m,m.state,found\n0.000000,\"a,b\",,x,\n\
                        0.020000,\"a,b\",0.25,x,\n0.000000,c,,,0\n";
        assert_eq!(csv(&[one, other]), expected);
    }
}
