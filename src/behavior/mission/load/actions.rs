//! The tables `do`, `on_entry` and `on_exit`: what a state asks of the actuators.

use std::collections::BTreeMap;
use std::ops::Range;

use arrayvec::ArrayString;

use super::{Outputs, Reader, nearest, shown};
use crate::behavior::demands::{Led, SAY_BYTES};
use crate::behavior::expression::{Expression, Mistake};
use crate::behavior::mission::DrivePlan;
use crate::document::{Item, Section};
use crate::ev3dev::StopAction;
use crate::printable::is_printable;
use crate::senses::{QUANTITIES, Role};

/// What can be asked on entry and on exit.
const SIGNS: [&str; 3] = ["led", "tone_hz", "say"];

/// What can be asked in `do`.
const ACTIONS: [&str; 10] = [
    "left_dps",
    "right_dps",
    "forward_mps",
    "turn_dps",
    "stop",
    "head_deg",
    "motor",
    "led",
    "tone_hz",
    "say",
];

/// Keys that move the wheels; those of one row go together.
const DRIVES: [(&str, usize); 5] =
    [("left_dps", 0), ("right_dps", 0), ("forward_mps", 1), ("turn_dps", 1), ("stop", 2)];

/// No actuator is asked for more by a slip of the finger: degrees per second, metres per second.
const DPS: (f64, f64) = (-10_000.0, 10_000.0);
const MPS: (f64, f64) = (-10.0, 10.0);
const HEAD_DEG: (f64, f64) = (-720.0, 720.0);

/// What the brick's speaker can play and ears can hear.
const TONE_HZ: (f64, f64) = (20.0, 20_000.0);

type Moves = BTreeMap<Role, Range<usize>>;

impl<'d> Reader<'_, 'd, '_> {
    /// The table `do`; notes in `moves` what is moved, and where.
    pub(super) fn actions(&mut self, table: &Section<'d>, moves: &mut Moves) -> Outputs {
        table.allow(&ACTIONS);
        let drive = self.drive(table, moves);
        let head_deg = table.get("head_deg").and_then(|item| {
            self.moves(Role::Head, &item, moves);
            self.number(&item, HEAD_DEG)
        });
        let motors = table.section("motor").map(|motors| motors.items()).unwrap_or_default();
        let motors_dps = motors.iter().filter_map(|item| self.motor(item, moves)).collect();
        Outputs { drive, head_deg, motors_dps, ..self.lights(table) }
    }

    /// The tables `on_entry` and `on_exit`: what is done once.
    pub(super) fn signs(&mut self, table: &Section<'d>) -> Outputs {
        for item in table.items() {
            if ACTIONS.contains(&item.key()) && !SIGNS.contains(&item.key()) {
                item.error_at_key(format!(
                    "`{}` is asked for in every tick, so it belongs in `do`",
                    item.key()
                ));
            } else if !SIGNS.contains(&item.key()) {
                let hint = nearest(item.key(), SIGNS)
                    .unwrap_or_else(|| format!("known here: {}", SIGNS.join(", ")));
                item.error_at_key(format!("unknown key `{}` in [{}]", item.key(), table.path()))
                    .hint(hint);
            }
        }
        self.lights(table)
    }

    fn lights(&mut self, table: &Section<'d>) -> Outputs {
        Outputs {
            led: table.get("led").and_then(|item| item.word(&Led::WORDS)),
            tone_hz: table.get("tone_hz").and_then(|item| self.number(&item, TONE_HZ)),
            say: table.get("say").and_then(|item| line(&item)),
            ..Outputs::default()
        }
    }

    fn drive(&mut self, table: &Section<'d>, moves: &mut Moves) -> Option<DrivePlan> {
        let given: Vec<(Item<'d>, usize)> =
            DRIVES.iter().filter_map(|(key, row)| Some((table.get(key)?, *row))).collect();
        let (first, row) = given.first()?;
        self.moves(Role::Wheels, first, moves);
        if let Some((other, _)) = given.iter().find(|(_, other)| other != row) {
            let (one, two) = (first.key(), other.key());
            other
                .error_at_key(format!("`{one}` and `{two}` both say what the wheels do"))
                .hint("leave one out");
            return None;
        }
        let optional = |reader: &mut Self, key: &str, range| match table.get(key) {
            Some(item) => reader.number(&item, range),
            None => Some(Expression::constant(0.0)),
        };
        match row {
            0 => self.wheels(table, first),
            1 => {
                let forward_mps = optional(self, "forward_mps", MPS);
                let turn_dps = optional(self, "turn_dps", DPS);
                Some(DrivePlan::Twist { forward_mps: forward_mps?, turn_dps: turn_dps? })
            }
            _ => first
                .word(
                    &StopAction::ALL.iter().map(|stop| (stop.as_str(), *stop)).collect::<Vec<_>>(),
                )
                .map(DrivePlan::Stop),
        }
    }

    /// The speeds of the two wheels, which go together.
    fn wheels(&mut self, table: &Section<'d>, first: &Item<'d>) -> Option<DrivePlan> {
        let (Some(left), Some(right)) = (table.get("left_dps"), table.get("right_dps")) else {
            let missing = if first.key() == "left_dps" { "right_dps" } else { "left_dps" };
            first
                .error_at_key(format!("`{}` goes together with `{missing}`", first.key()))
                .hint(format!("`{missing} = 0` keeps that wheel still"));
            return None;
        };
        let (left_dps, right_dps) = (self.number(&left, DPS), self.number(&right, DPS));
        Some(DrivePlan::Wheels { left_dps: left_dps?, right_dps: right_dps? })
    }

    fn motor(&mut self, item: &Item<'d>, moves: &mut Moves) -> Option<(u8, Expression)> {
        match self.vocabulary.motor(item.key()) {
            Ok(place) => {
                self.moves(Role::Motor(place), item, moves);
                Some((place, self.number(item, DPS)?))
            }
            Err(mistake) => {
                let hint = self.vocabulary.motor_hint(item.key());
                let message = match mistake {
                    Mistake::NoMotor(name) => Mistake::NoMotor(shown(&name)),
                    other => other,
                };
                item.error_at_key(message.to_string()).hint(hint);
                None
            }
        }
    }

    /// Notes that a part is moved; a finding where the robot does not have it.
    fn moves(&mut self, role: Role, item: &Item<'d>, moves: &mut Moves) {
        moves.entry(role).or_insert_with(|| item.key_place());
        // What moves is sensed as well: the head, a named motor. Wheels always are.
        let sensed =
            QUANTITIES.iter().filter(|quantity| quantity.role == role && role != Role::Wheels);
        self.uses.extend(sensed.map(|quantity| (quantity.channel, item.key_place())));
        if !self.vocabulary.capabilities().has(role) {
            item.error_at_key(format!(
                "`{}` takes {}, which the robot does not have",
                item.key(),
                role.what()
            ))
            .hint(format!("[{}] in the robot's file would be that part", role.section()));
        }
    }
}

/// A line for the screen.
fn line(item: &Item<'_>) -> Option<ArrayString<SAY_BYTES>> {
    let text = item.text()?;
    if !text.chars().all(is_printable) {
        item.error(format!("`{}` must be one line", item.path()))
            .hint("a later state can say more");
        return None;
    }
    let line = ArrayString::from(text).ok();
    if line.is_none() {
        item.error(format!(
            "`{}` has {} bytes; at most {SAY_BYTES} fit the screen",
            item.path(),
            text.len()
        ))
        .hint("make it shorter");
    }
    line
}
