//! What a state tells people: lights, sounds, words. In `on_entry` and `on_exit` there is nothing
//! else.

use super::actions::actions;
use super::{Outputs, Reader, Section};
use crate::behavior::demands::{SAY_BYTES, SAY_LINES};
use crate::behavior::expression::Expression;
use crate::behavior::mission::SoundPlan;
use crate::behavior::telling::{Piece, Telling, parts};
use crate::behavior::tune::{BEEPS, MAX_NOTES, TEMPO_BPM, Tune};
use crate::document::{Item, Severity};
use crate::ev3dev::LightColour;
use crate::printable::is_printable;

/// What can be asked on entry and on exit.
pub(super) const SIGNS: [&str; 7] =
    ["led", "tone_hz", "tone_s", "tune", "tempo_bpm", "beep", "say"];

/// The keys that say what the speaker plays, and the key that goes with each.
const SOUNDS: [(&str, Option<&str>); 3] =
    [("tone_hz", Some("tone_s")), ("tune", Some("tempo_bpm")), ("beep", None)];

/// The colours that a mission can ask for: by amber one brick is told from another.
const COLOURS: [LightColour; 5] = [
    LightColour::Off,
    LightColour::Green,
    LightColour::Red,
    LightColour::Orange,
    LightColour::Yellow,
];

/// What the brick's speaker can play and ears can hear.
const TONE_HZ: (f64, f64) = (20.0, 20_000.0);

/// How long a tone is where it is not said, seconds.
const TONE_S: f64 = 0.2;

impl<'d> Reader<'_, 'd, '_> {
    /// The tables `on_entry` and `on_exit`: what is done once.
    ///
    /// - `more`: keys that are read elsewhere.
    pub(super) fn signs(&mut self, table: &Section<'d>, more: &[&str]) -> Outputs {
        let known = [SIGNS.as_slice(), more].concat();
        for item in table.items() {
            let key = item.key();
            if known.contains(&key) {
                continue;
            } else if actions().contains(&key) {
                item.error_at_key(format!("`{key}` is what a state does, so it belongs in `do`"));
            } else {
                table.unknown(&item, &known);
            }
        }
        self.telling(table, Some(TONE_S))
    }

    /// Lights, sound and words.
    ///
    /// - `tone_s`: how long a tone is; `None`: as long as the state.
    pub(super) fn telling(&mut self, table: &Section<'d>, tone_s: Option<f64>) -> Outputs {
        let colours = COLOURS.map(|colour| (colour.as_str(), colour));
        Outputs {
            led: table.get("led").and_then(|item| item.word(&colours)),
            sound: self.sound(table, tone_s),
            say: table.get("say").and_then(|item| self.say(&item)),
            ..Outputs::default()
        }
    }

    fn sound(&mut self, table: &Section<'d>, tone_s: Option<f64>) -> Option<SoundPlan> {
        for (sound, with) in SOUNDS {
            let with = with.and_then(|with| table.get(with));
            if let Some(item) = with.filter(|_| table.get(sound).is_none()) {
                let message = format!("`{}` goes together with `{sound}`", item.key());
                item.error_at_key(message);
            }
        }
        let given: Vec<Item<'d>> =
            SOUNDS.iter().filter_map(|(sound, _)| table.get(sound)).collect();
        if let [one, other, ..] = given.as_slice() {
            let (one, two) = (one.key(), other.key());
            other
                .error_at_key(format!("`{one}` and `{two}` both say what the speaker plays"))
                .hint("leave one out");
        }
        let item = given.first()?;
        match item.key() {
            "tone_hz" => {
                let length_s =
                    table.value_or("tone_s", tone_s, |item| item.number(0.01..=60.0).map(Some));
                let hz = self.number(item, TONE_HZ)?;
                Some(match length_s? {
                    Some(length_s) => SoundPlan::Tone { hz, length_s },
                    None => SoundPlan::Lasting { hz },
                })
            }
            "tune" => {
                let tempo_bpm =
                    table.value_or("tempo_bpm", TEMPO_BPM, |item| item.number(20.0..=600.0));
                self.tune(item, item.text()?, tempo_bpm?)
            }
            _ => self.tune(item, item.word(&BEEPS)?, TEMPO_BPM),
        }
    }

    fn tune(&mut self, item: &Item<'d>, notes: &str, tempo_bpm: f64) -> Option<SoundPlan> {
        let tune = match Tune::parse(notes, tempo_bpm) {
            Ok(tune) => tune,
            Err(wrong) => {
                let place = item.place_within(wrong.place.clone());
                self.root
                    .note(place, Severity::Error, wrong.to_string())
                    .hint("notes are written like C4/4, F#5/8, Bb3/2. or R/4");
                return None;
            }
        };
        if !(1..=MAX_NOTES).contains(&tune.len()) {
            item.error(format!("a tune has 1 to {MAX_NOTES} notes, and this has {}", tune.len()));
            return None;
        }
        let place = self.tunes.iter().position(|known| *known == tune).unwrap_or_else(|| {
            self.tunes.push(tune);
            self.tunes.len() - 1
        });
        u16::try_from(place).ok().map(SoundPlan::Tune)
    }

    /// A text with values.
    fn say(&mut self, item: &Item<'d>) -> Option<Telling> {
        let text = item.text()?;
        if !text.lines().all(|line| line.chars().all(is_printable)) {
            item.error(format!("`{}` has a character that no screen can show", item.path()));
            return None;
        }
        let lines = text.lines().count();
        if lines > SAY_LINES {
            item.error(format!("{lines} lines are too many; the screen has room for {SAY_LINES}"));
            return None;
        }
        let parts = match parts(text) {
            Ok(parts) => parts,
            Err((message, place)) => {
                let place = item.place_within(place);
                self.root.note(place, Severity::Error, message);
                return None;
            }
        };
        let pieces = parts.into_iter().map(|part| match part {
            Piece::Text(words) => Some(Piece::Text(words)),
            Piece::Value { value: place, digits } => {
                let read = Expression::parse(&text[place.clone()], None, &mut self.vocabulary);
                let value = self.understood(item, place.start, read)?;
                Some(Piece::Value { value, digits })
            }
        });
        let pieces: Vec<Option<Piece>> = pieces.collect();
        let telling = Telling(pieces.into_iter().collect::<Option<_>>()?);
        let words = telling.words();
        if words > SAY_BYTES {
            item.error(format!(
                "`{}` has {words} bytes; at most {SAY_BYTES} fit the screen",
                item.path()
            ))
            .hint("make it shorter");
        }
        Some(telling)
    }
}
