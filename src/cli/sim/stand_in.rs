//! Stand-ins for the programs that sound on ev3dev: `beep`, `aplay`, `espeak` and `amixer`.
//!
//! They take the arguments that libraries give them, and take as long. The simulated speaker knows
//! tones alone: a recording sounds as the tone of each piece of it, and speech as a tone a word;
//! what was said is noted in the brick's `sim/orders`.
//!
//! # Not here
//!
//! Sampled sound, and loudness: `amixer` only remembers what it was told.

use std::fs::{self, File};
use std::io::{self, Read as _, Write as _};
use std::path::Path;

use crate::clock::{Clock, MonotonicClock, nanoseconds};

/// A recording is heard in pieces of this length, seconds.
const PIECE_S: f64 = 0.05;

/// Samples that swing by less are silence, of 32,767.
const QUIET: i32 = 300;

/// No recording is longer, bytes: an hour of what the brick can play.
const MOST_BYTES: u64 = 160_000_000;

/// What `espeak` would speak at, in samples a second, and the tone that stands for it, hertz.
const SPEECH_RATE: u32 = 22_050;
const SPEECH_HZ: u32 = 180;

/// How often a sleeper checks whether to end.
const LOOK_NS: i64 = 10_000_000;

/// Why a stand-in did not sound.
#[derive(Debug, thiserror::Error)]
pub(super) enum StandInError {
    /// An argument makes no sense.
    #[error("{0}")]
    Usage(String),
    /// What is to be played is no recording.
    #[error("{0} is not a WAV recording")]
    NotWav(String),
    /// A file was not to be read or written.
    #[error("{doing}")]
    Io {
        /// What was being done.
        doing: String,
        /// What the system said.
        source: io::Error,
    },
}

/// A tone, or silence, for some seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Note {
    hz: Option<u32>,
    time_s: f64,
}

/// Does what a program would do with these arguments; what goes to the standard output is written
/// to the last one.
type StandIn = fn(&Speaker<'_>, &[String], &mut dyn io::Write) -> Result<(), StandInError>;

/// The programs by their names: tones by frequency and length; a recording (WAV) from a file or the
/// standard input; speech, or a recording of it on the standard output; the volume.
pub(super) const STAND_INS: [(&str, StandIn); 4] = [
    ("beep", |speaker, arguments, _| speaker.play(&beep(arguments)?)),
    ("aplay", |speaker, arguments, _| speaker.play(&heard(&recording(arguments)?))),
    ("espeak", |speaker, arguments, out| speaker.speak(&Speech::read(arguments)?, out)),
    ("amixer", |speaker, arguments, out| amixer(&speaker.view.join("volume"), arguments, out)),
];

fn io_error(doing: impl Into<String>) -> impl FnOnce(io::Error) -> StandInError {
    let doing = doing.into();
    move |source| StandInError::Io { doing, source }
}

/// The brick's speaker.
pub(super) struct Speaker<'e> {
    /// The folder with the brick's `sim` in it.
    pub(super) view: &'e Path,
    /// Is asked whether to end early.
    pub(super) ends: &'e dyn Fn() -> bool,
}

impl Speaker<'_> {
    fn order(&self, order: &str) -> Result<(), StandInError> {
        let written = fs::write(self.view.join("sim/orders"), order);
        written.map_err(io_error("the brick's speaker does not answer"))
    }

    /// Plays notes one after the other, and falls silent.
    fn play(&self, notes: &[Note]) -> Result<(), StandInError> {
        let clock = MonotonicClock;
        let mut until_ns = clock.now_ns();
        let mut sounds = None;
        for note in notes {
            if note.hz != sounds {
                self.order(&format!("tone {}", note.hz.unwrap_or(0)))?;
                sounds = note.hz;
            }
            until_ns = until_ns.saturating_add(nanoseconds(note.time_s));
            while clock.now_ns() < until_ns && !(self.ends)() {
                clock.sleep_until_ns(until_ns.min(clock.now_ns() + LOOK_NS));
            }
            if (self.ends)() {
                break;
            }
        }
        if sounds.is_some() { self.order("tone 0") } else { Ok(()) }
    }

    fn speak(&self, speech: &Speech, out: &mut dyn io::Write) -> Result<(), StandInError> {
        if !speech.text.is_empty() {
            self.order(&format!("say {}", speech.text))?;
        }
        if let Some(path) = &speech.file {
            return File::create(path)
                .and_then(|mut file| file.write_all(&wav(&speech.notes())))
                .map_err(io_error(format!("cannot write {path}")));
        }
        if speech.to_output {
            return out
                .write_all(&wav(&speech.notes()))
                .map_err(io_error("cannot write the recording"));
        }
        self.play(&speech.notes())
    }
}

/// The notes of a call of `beep(1)`.
fn beep(arguments: &[String]) -> Result<Vec<Note>, StandInError> {
    let mut notes = Vec::new();
    for note in arguments.split(|word| word == "-n" || word == "--new") {
        let (mut hz, mut length_ms, mut times, mut delay_ms, mut also_after) =
            (440.0, 200.0, 1.0, 100.0, false);
        let mut words = note.iter();
        while let Some(word) = words.next() {
            // `-f440` is `-f 440`.
            let (option, joined) = word.split_at_checked(2).unwrap_or((word, ""));
            let mut number = |low: f64, high: f64| {
                let text = if joined.is_empty() {
                    words.next().map_or("", String::as_str)
                } else {
                    joined
                };
                let number =
                    text.parse::<f64>().ok().filter(|number| (low..=high).contains(number));
                number.ok_or_else(|| {
                    StandInError::Usage(format!("`{option}` takes a number from {low} to {high}"))
                })
            };
            match option {
                "-f" => hz = number(0.0, 20_000.0)?,
                "-l" => length_ms = number(0.0, 300_000.0)?,
                "-r" => times = number(0.0, 300_000.0)?,
                "-d" => delay_ms = number(0.0, 300_000.0)?,
                "-D" => (delay_ms, also_after) = (number(0.0, 300_000.0)?, true),
                "-e" => drop(words.next()),
                _ => {
                    return Err(StandInError::Usage(format!(
                        "the stand-in for beep knows no `{option}`"
                    )));
                }
            }
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "both are in range"
        )]
        let (hz, times) = (libm::round(hz) as u32, times as usize);
        for time in 1..=times {
            notes.push(Note { hz: Some(hz).filter(|hz| *hz > 0), time_s: length_ms / 1e3 });
            if also_after || time < times {
                notes.push(Note { hz: None, time_s: delay_ms / 1e3 });
            }
        }
    }
    Ok(notes)
}

/// One channel of a recording.
struct Samples {
    rate: u32,
    values: Vec<i32>,
}

/// The recording that a call of `aplay(1)` names, or the one on the standard input.
fn recording(arguments: &[String]) -> Result<Samples, StandInError> {
    const WITH_VALUE: [&str; 9] = ["-D", "-t", "-c", "-f", "-r", "-d", "-s", "-F", "-B"];
    let mut file = None;
    let mut words = arguments.iter();
    while let Some(word) = words.next() {
        if WITH_VALUE.contains(&word.as_str()) {
            words.next();
        } else if !word.starts_with('-') || word == "-" {
            file = Some(word.as_str()).filter(|name| *name != "-");
        }
    }
    let name = file.unwrap_or("the standard input");
    let mut bytes = Vec::new();
    let read = match file {
        Some(path) => {
            File::open(path).and_then(|file| file.take(MOST_BYTES).read_to_end(&mut bytes))
        }
        None => io::stdin().lock().take(MOST_BYTES).read_to_end(&mut bytes),
    };
    read.map_err(io_error(format!("cannot read {name}")))?;
    samples(&bytes).ok_or_else(|| StandInError::NotWav(name.to_owned()))
}

/// The first channel of a WAV file of 8 or 16 bits. What it says of its length may be more than
/// there is: a stream does not know it.
fn samples(bytes: &[u8]) -> Option<Samples> {
    let mut rest = bytes.strip_prefix(b"RIFF")?.get(4..)?.strip_prefix(b"WAVE")?;
    let mut form = None;
    while let Some((name, after)) = rest.split_first_chunk::<4>() {
        let (length, after) = after.split_first_chunk::<4>()?;
        let length = usize::try_from(u32::from_le_bytes(*length)).ok()?;
        let body = after.get(..length).unwrap_or(after);
        match name {
            b"fmt " => {
                let word =
                    |at: usize| body.get(at..at + 2)?.try_into().ok().map(u16::from_le_bytes);
                let rate = u32::from_le_bytes(body.get(4..8)?.try_into().ok()?);
                form = Some((word(2)?, rate, word(14)?));
            }
            b"data" => {
                let (channels, rate, bits) = form?;
                let width = usize::from(channels) * usize::from(bits / 8);
                if width == 0 || rate == 0 {
                    return None;
                }
                let value = |frame: &[u8]| match (bits, frame) {
                    (8, [byte, ..]) => Some((i32::from(*byte) - 128) * 256),
                    (16, [low, high, ..]) => Some(i32::from(i16::from_le_bytes([*low, *high]))),
                    _ => None,
                };
                let values = body.chunks_exact(width).map(value).collect::<Option<Vec<_>>>()?;
                return Some(Samples { rate, values });
            }
            _ => {}
        }
        // Chunks begin at even places.
        rest = after.get(length + length % 2..).unwrap_or_default();
    }
    None
}

/// A recording as the speaker can play it: of each piece the tone, by how often it crosses zero.
fn heard(samples: &Samples) -> Vec<Note> {
    let rate = f64::from(samples.rate);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a few thousand samples"
    )]
    let piece = ((rate * PIECE_S) as usize).max(1);
    let note = |values: &[i32]| {
        let swing = values.iter().map(|value| value.abs()).max().unwrap_or(0);
        let crossings = values
            .iter()
            .zip(values.iter().skip(1))
            .filter(|(one, next)| (**one < 0) != (**next < 0));
        #[expect(clippy::cast_precision_loss, reason = "a few thousand samples")]
        let (crossings, length) = (crossings.count() as f64, values.len() as f64);
        let time_s = length / rate;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let hz = libm::round(crossings / 2.0 / time_s).clamp(100.0, 10_000.0) as u32;
        Note { hz: (swing >= QUIET).then_some(hz), time_s }
    };
    samples.values.chunks(piece).map(note).collect()
}

/// What a call of `espeak(1)` says, and where to.
#[derive(Debug)]
struct Speech {
    text: String,
    words_a_minute: f64,
    to_output: bool,
    file: Option<String>,
}

impl Speech {
    fn read(arguments: &[String]) -> Result<Self, StandInError> {
        const WITH_VALUE: [&str; 8] = ["-a", "-b", "-f", "-g", "-k", "-l", "-p", "-v"];
        let mut speech =
            Self { text: String::new(), words_a_minute: 175.0, to_output: false, file: None };
        let mut said = Vec::new();
        let mut words = arguments.iter();
        while let Some(word) = words.next() {
            match word.as_str() {
                "--stdout" => speech.to_output = true,
                "-w" => speech.file = words.next().cloned(),
                "-s" => {
                    let speed = words.next().and_then(|speed| speed.parse::<f64>().ok());
                    speech.words_a_minute =
                        speed.filter(|speed| (1.0..=1000.0).contains(speed)).ok_or_else(|| {
                            StandInError::Usage("`-s` takes words a minute".to_owned())
                        })?;
                }
                option if WITH_VALUE.contains(&option) => drop(words.next()),
                option if option.starts_with('-') && option.len() > 1 => {}
                text => said.push(text),
            }
        }
        speech.text = said.join(" ").split_whitespace().collect::<Vec<_>>().join(" ");
        Ok(speech)
    }

    /// A tone a word, and a breath after it.
    fn notes(&self) -> Vec<Note> {
        let word_s = 60.0 / self.words_a_minute;
        let word = [
            Note { hz: Some(SPEECH_HZ), time_s: 0.8 * word_s },
            Note { hz: None, time_s: 0.2 * word_s },
        ];
        self.text.split_whitespace().flat_map(|_| word).collect()
    }
}

/// Notes as a recording.
fn wav(notes: &[Note]) -> Vec<u8> {
    let mut data = Vec::new();
    for note in notes {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "seconds of samples"
        )]
        let length = (note.time_s * f64::from(SPEECH_RATE)) as u32;
        for index in 0..length {
            // A square wave.
            let half = note.hz.map(|hz| index * 2 * hz / SPEECH_RATE % 2);
            let value: i16 = half.map_or(0, |half| if half == 0 { 8000 } else { -8000 });
            data.extend_from_slice(&value.to_le_bytes());
        }
    }
    let length = u32::try_from(data.len()).unwrap_or(u32::MAX - 36);
    let mut file = b"RIFF".to_vec();
    file.extend_from_slice(&(length + 36).to_le_bytes());
    file.extend_from_slice(b"WAVEfmt \x10\0\0\0\x01\0\x01\0");
    file.extend_from_slice(&SPEECH_RATE.to_le_bytes());
    file.extend_from_slice(&(2 * SPEECH_RATE).to_le_bytes());
    file.extend_from_slice(b"\x02\0\x10\0data");
    file.extend_from_slice(&length.to_le_bytes());
    file.extend_from_slice(&data);
    file
}

/// The one control there is, and its volume in per cent.
fn amixer(file: &Path, arguments: &[String], out: &mut dyn io::Write) -> Result<(), StandInError> {
    const CONTROL: &str = "Simple mixer control 'Playback',0\n";
    let words: Vec<&str> =
        arguments.iter().map(String::as_str).filter(|word| !word.starts_with('-')).collect();
    let said = match words.as_slice() {
        [] | ["scontrols", ..] => CONTROL.to_owned(),
        ["get" | "sget", ..] => {
            let volume = fs::read_to_string(file).unwrap_or_else(|_| "20".to_owned());
            format!("{CONTROL}  Mono: Playback [{volume}%] [on]\n")
        }
        ["set" | "sset", _, volume, ..] => {
            let volume =
                volume.trim_end_matches('%').parse::<u8>().ok().filter(|volume| *volume <= 100);
            let volume =
                volume.ok_or_else(|| StandInError::Usage("a volume is 0% to 100%".to_owned()))?;
            fs::write(file, volume.to_string()).map_err(io_error("cannot keep the volume"))?;
            return Ok(());
        }
        _ => {
            return Err(StandInError::Usage(
                "the stand-in for amixer knows scontrols, get and set".to_owned(),
            ));
        }
    };
    out.write_all(said.as_bytes()).map_err(io_error("cannot write"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<String> {
        text.split_whitespace().map(str::to_owned).collect()
    }

    fn total_s(notes: &[Note]) -> f64 {
        notes.iter().map(|note| note.time_s).sum()
    }

    #[test]
    fn beep_reads_what_libraries_write() {
        let note = |hz: u32, ms: f64| Note { hz: Some(hz).filter(|hz| *hz > 0), time_s: ms / 1e3 };
        for (arguments, notes) in [
            ("", vec![note(440, 200.0)]),
            ("-f 311.1 -l 250 -D 100", vec![note(311, 250.0), note(0, 100.0)]),
            ("-f1000 -l 10 -n -f 500 -l 20", vec![note(1000, 10.0), note(500, 20.0)]),
            ("-r 2 -d 30 -l 5", vec![note(440, 5.0), note(0, 30.0), note(440, 5.0)]),
        ] {
            assert_eq!(beep(&words(arguments)).unwrap(), notes, "{arguments}");
        }
        for wrong in ["-f", "-f high", "-l -5", "--what"] {
            assert!(beep(&words(wrong)).is_err(), "{wrong}");
        }
    }

    #[test]
    fn speech_takes_its_time_and_is_heard_as_it_was_written() {
        let speech = Speech::read(&words("--stdout -a 200 -s 120 Hello my robot")).unwrap();
        assert_eq!((speech.text.as_str(), speech.to_output), ("Hello my robot", true));
        let notes = speech.notes();
        assert!((total_s(&notes) - 1.5).abs() < 1e-9);
        let heard = heard(&samples(&wav(&notes)).unwrap());
        assert!((total_s(&heard) - 1.5).abs() < 0.01);
        let near = |note: &&Note| note.hz.is_some_and(|hz| hz.abs_diff(SPEECH_HZ) <= 20);
        assert!(heard.iter().filter(near).count() >= 20, "{heard:?}");
        assert!(heard.iter().any(|note| note.hz.is_none()), "a breath is silent");
    }

    #[test]
    fn what_is_no_recording_is_none_and_a_cut_one_is_what_is_there() {
        let whole = wav(&[Note { hz: Some(1000), time_s: 0.2 }]);
        for length in 0..44 {
            assert!(
                samples(&whole[..length]).is_none_or(|samples| samples.values.is_empty()),
                "{length}"
            );
        }
        assert_eq!(samples(&whole[..244]).unwrap().values.len(), 100);
        assert!(samples(b"RIFFxxxxWAVEdata\x04\0\0\0abcd").is_none(), "no form before the data");
    }
}
