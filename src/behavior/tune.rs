//! Tunes: notes as text, and what sounds at a moment of them.
//!
//! Notes are written as Pybricks' `play_notes` has them (docs.pybricks.com, Speaker): the note's
//! name, `#` or `b`, the octave, `/` and the part of a whole note that it lasts, a dot for half as
//! long again: `C4/4 F#5/8 Bb3/2. R/4`, where R is a rest. A note of which no part is said lasts a
//! quarter.
//!
//! # Not here
//!
//! The speaker: a tune says which tone is wanted in a tick.

use std::ops::Range;

use serde::{Deserialize, Serialize};

/// Notes one after the other.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tune(Vec<Note>);

/// A tone, or a rest.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Note {
    hz: Option<f64>,
    /// When it ends, seconds from the tune's beginning.
    ends_s: f64,
    length_s: f64,
}

/// A text that is no note, and its bytes in the tune.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{text}` is no note")]
pub struct NoNote {
    /// The text.
    pub text: String,
    /// Where it stands.
    pub place: Range<usize>,
}

/// The most notes that a tune may have.
pub const MAX_NOTES: usize = 200;

/// Quarter notes a minute where a mission says nothing.
pub const TEMPO_BPM: f64 = 120.0;

/// So much of a note sounds; the rest sets it apart from the next one.
const SOUNDING: f64 = 0.9;

/// Named sounds: their notes, at [`TEMPO_BPM`].
pub(super) const BEEPS: [(&str, &str); 5] = [
    ("beep", "A5/16"),
    ("ok", "C6/16 E6/16 G6/8"),
    ("error", "G3/8 E3/4"),
    ("alarm", "C6/16 G5/16 C6/16 G5/16 C6/16 G5/16"),
    ("hello", "G5/16 C6/8"),
];

impl Tune {
    /// Reads notes.
    ///
    /// - `tempo_bpm`: quarter notes a minute.
    ///
    /// # Errors
    ///
    /// The first that is no note.
    pub fn parse(text: &str, tempo_bpm: f64) -> Result<Self, NoNote> {
        let mut notes = Vec::new();
        let mut ends_s = 0.0;
        for word in text.split_whitespace() {
            let refuse = || {
                let start = word.as_ptr() as usize - text.as_ptr() as usize;
                NoNote { text: word.to_owned(), place: start..start + word.len() }
            };
            let (hz, whole_parts) = note(word).ok_or_else(refuse)?;
            let length_s = whole_parts * 4.0 * 60.0 / tempo_bpm;
            ends_s += length_s;
            notes.push(Note { hz, ends_s, length_s });
        }
        Ok(Self(notes))
    }

    /// How many notes and rests it has.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether it has none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// How long it takes, seconds.
    #[must_use]
    pub fn length_s(&self) -> f64 {
        self.0.last().map_or(0.0, |last| last.ends_s)
    }

    /// The tone at a moment, hertz, seconds from its beginning.
    #[must_use]
    pub fn tone_hz(&self, at_s: f64) -> Option<f64> {
        let note = self.0.iter().find(|note| at_s < note.ends_s)?;
        note.hz.filter(|_| at_s < note.ends_s - (1.0 - SOUNDING) * note.length_s)
    }
}

/// A note's tone, hertz, and which part of a whole note it lasts.
fn note(word: &str) -> Option<(Option<f64>, f64)> {
    let (pitch, length) = word.split_once('/').unwrap_or((word, "4"));
    let (length, dotted) = length.strip_suffix('.').map_or((length, 1.0), |length| (length, 1.5));
    let parts = length.parse::<u8>().ok().filter(|parts| (1..=99).contains(parts))?;
    let whole_parts = dotted / f64::from(parts);
    if pitch.eq_ignore_ascii_case("r") {
        return Some((None, whole_parts));
    }
    let mut letters = pitch.chars();
    let semitone = match letters.next()?.to_ascii_uppercase() {
        'C' => 0,
        'D' => 2,
        'E' => 4,
        'F' => 5,
        'G' => 7,
        'A' => 9,
        'B' => 11,
        _ => return None,
    };
    let rest = letters.as_str();
    let (shift, octave) = match rest.chars().next()? {
        '#' => (1, &rest[1..]),
        'b' => (-1, &rest[1..]),
        _ => (0, rest),
    };
    let octave = octave.parse::<u8>().ok().filter(|octave| (2..=8).contains(octave))?;
    // A4 is 440 Hz, and nine semitones above C4.
    let from_a4 = f64::from(semitone + shift - 9) / 12.0 + f64::from(octave) - 4.0;
    Some((Some(440.0 * libm::exp2(from_a4)), whole_parts))
}

/// What a machine has begun to play.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Playing {
    pub(super) sound: Sound,
    /// When it began, nanoseconds.
    pub(super) began_ns: i64,
}

/// A sound that ends by itself.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) enum Sound {
    /// A tune of the mission, by its place.
    Tune(u16),
    /// One tone.
    Tone {
        /// Hertz.
        hz: f64,
        /// Seconds.
        length_s: f64,
    },
}

impl Playing {
    /// The tone that sounds `at_s` seconds after it began; `None` once it is over, and
    /// `Some(None)` in a rest.
    pub(super) fn tone_hz(self, tunes: &[Tune], at_s: f64) -> Option<Option<f64>> {
        match self.sound {
            Sound::Tune(place) => {
                let tune = tunes.get(usize::from(place))?;
                (at_s < tune.length_s()).then(|| tune.tone_hz(at_s))
            }
            Sound::Tone { hz, length_s } => (at_s < length_s).then_some(Some(hz)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_sound_as_they_are_written() {
        let tune = Tune::parse("A4/4 c#5/8 Bb3/2. R/16 G8", 120.0).unwrap();
        // Quarters of half a second.
        for (at_s, hz) in [
            (0.0, Some(440.0)),
            (0.44, Some(440.0)),
            (0.46, None),
            (0.5, Some(554.365)),
            (0.75, Some(233.082)),
            (2.0, Some(233.082)),
            (2.26, None),
            (2.375, Some(6271.927)),
            (2.875, None),
        ] {
            match (tune.tone_hz(at_s), hz) {
                (Some(is), Some(hz)) => assert!((is - hz).abs() < 1e-3, "{at_s} s: {is} Hz"),
                (is, hz) => assert_eq!(is, hz, "{at_s} s"),
            }
        }
        assert!((tune.length_s() - 2.875).abs() < 1e-9);
    }

    #[test]
    fn what_is_no_note_is_named_with_its_place() {
        for wrong in
            ["H4/4", "C/4", "C1/4", "C9/4", "C4/0", "C4/100", "C4/x", "C##4", "4", "é4", "/4"]
        {
            let text = format!("C4/4 {wrong}");
            let refused = Tune::parse(&text, 120.0).unwrap_err();
            assert_eq!((refused.text.as_str(), refused.place.start), (wrong, 5), "{wrong}");
        }
    }

    #[test]
    fn every_named_sound_is_made_of_notes() {
        for (name, notes) in BEEPS {
            assert!(!Tune::parse(notes, TEMPO_BPM).unwrap().is_empty(), "{name}");
        }
    }
}
