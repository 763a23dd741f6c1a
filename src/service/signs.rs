//! Lights and sounds that follow the state: what a person sees of a brick from across the room.
//!
//! | state | lights | sound |
//! |---|---|---|
//! | ready, stopped | green | a high tone when a run has ended |
//! | preparing, stopping | orange | the run's own beeps before it drives off |
//! | running | green, pulsing; none of it where the mission switches the lights itself | |
//! | fault | red | a low tone |
//!
//! Lights are written only when they change, so that other programs can use them between runs.
//! Errors are ignored: a brick without lights, or a user who may not switch them, still runs
//! missions.
//!
//! # Not here
//!
//! The beeps before a run drives off: they are a warning, made by the run itself, and no setting
//! turns them off.

use std::sync::Arc;

use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock, SECOND_NS};
use crate::ev3dev::{LightColour, Platform, Sound, StatusLights, Tree};
use crate::protocol::State;

/// A pulse's length, nanoseconds; half of it is dark.
const PULSE_NS: i64 = SECOND_NS;

/// A tone's length, nanoseconds.
const TONE_NS: i64 = 200 * MILLISECOND_NS;

/// The tone of a run that has ended as wanted, hertz.
const DONE_HZ: i32 = 1320;

/// The tone of a fault.
const FAULT_HZ: i32 = 220;

/// The tones that tell one brick from another.
const IDENTIFY_HZ: [i32; 2] = [880, 1320];

/// What is to be seen and heard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shown {
    pub(super) state: State,
    /// Lights follow the state.
    pub(super) lights: bool,
    /// Sounds are made.
    pub(super) sounds: bool,
    /// The mission switches the lights itself.
    pub(super) missions_own: bool,
}

/// What a light should be, and a tone where there is one.
#[derive(Debug, Default)]
pub(super) struct Signs {
    state: Option<State>,
    colour: Option<LightColour>,
}

impl Signs {
    /// What is to change now: a colour for both lights, and a tone.
    pub(super) fn follow(
        &mut self,
        shown: Shown,
        now_ns: i64,
    ) -> (Option<LightColour>, Option<i32>) {
        let colour = shown.lights.then(|| colour(shown, now_ns)).flatten();
        let changed = colour.filter(|_| colour != self.colour);
        // Lights that other programs had are set again once they are ours.
        self.colour = colour;
        let before = self.state.replace(shown.state);
        let tone_hz = match shown.state {
            _ if !shown.sounds || before == Some(shown.state) => None,
            State::Fault => Some(FAULT_HZ),
            State::Stopped if before.is_some() => Some(DONE_HZ),
            _ => None,
        };
        (changed, tone_hz)
    }
}

/// The lights' colour; nothing where they are the mission's.
fn colour(shown: Shown, now_ns: i64) -> Option<LightColour> {
    Some(match shown.state {
        State::Ready | State::Stopped => LightColour::Green,
        // Control itself shows orange while it beeps; both mean the same.
        State::Preparing | State::Stopping => LightColour::Orange,
        State::Running if shown.missions_own => return None,
        State::Running if now_ns.rem_euclid(PULSE_NS) < PULSE_NS / 2 => LightColour::Green,
        State::Running => LightColour::Off,
        State::Fault => LightColour::Red,
    })
}

/// Sets both lights.
pub(super) fn light(tree: &Arc<dyn Tree>, colour: LightColour) {
    let shown = StatusLights::open(tree, Platform::of(tree)).and_then(|lights| {
        lights.take()?;
        lights.set_both(colour)
    });
    if let Err(error) = shown {
        log::debug!("lights: {error}");
    }
}

/// Makes a tone; takes as long as it lasts.
pub(super) fn tone(tree: &Arc<dyn Tree>, tone_hz: i32) {
    let sounded = Sound::open(tree, Platform::of(tree)).and_then(|mut sound| {
        sound.tone(tone_hz)?;
        MonotonicClock.sleep_ns(TONE_NS);
        sound.silence()
    });
    if let Err(error) = sounded {
        log::debug!("sound: {error}");
    }
}

/// Three times two tones, and three blinks where the lights may be used: a person sees and hears
/// which brick this is.
pub(super) fn identify(tree: &Arc<dyn Tree>, lights: bool) {
    let blink = |colour| {
        if lights {
            light(tree, colour);
        }
    };
    for _ in 0..3 {
        for (tone_hz, colour) in IDENTIFY_HZ.into_iter().zip([LightColour::Amber, LightColour::Off])
        {
            blink(colour);
            let end_ns = MonotonicClock.now_ns() + TONE_NS;
            tone(tree, tone_hz);
            // A brick without a speaker blinks at the same pace.
            while MonotonicClock.now_ns() < end_ns {
                MonotonicClock.sleep_until_ns(end_ns);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = MILLISECOND_NS;

    fn shown(state: State) -> Shown {
        Shown { state, lights: true, sounds: true, missions_own: false }
    }

    #[test]
    fn lights_and_tones_follow_the_state_and_are_written_once() {
        use LightColour::{Green, Off, Orange, Red};
        let mut signs = Signs::default();
        let transcript = [
            (State::Ready, 0, Some(Green), None),
            (State::Ready, 100, None, None),
            (State::Preparing, 200, Some(Orange), None),
            (State::Running, 1000, Some(Green), None),
            (State::Running, 1400, None, None),
            (State::Running, 1500, Some(Off), None),
            (State::Running, 2100, Some(Green), None),
            (State::Stopping, 2200, Some(Orange), None),
            (State::Stopped, 2300, Some(Green), Some(DONE_HZ)),
            (State::Stopped, 2400, None, None),
            (State::Fault, 2500, Some(Red), Some(FAULT_HZ)),
            (State::Fault, 2600, None, None),
        ];
        for (state, ms, colour, tone_hz) in transcript {
            assert_eq!(
                signs.follow(shown(state), ms * MS),
                (colour, tone_hz),
                "{state:?} at {ms} ms"
            );
        }
    }

    #[test]
    fn what_is_switched_off_or_the_missions_own_is_left_alone() {
        let mut signs = Signs::default();
        let quiet = Shown { lights: false, sounds: false, ..shown(State::Fault) };
        assert_eq!(signs.follow(quiet, 0), (None, None));
        let own = Shown { missions_own: true, ..shown(State::Running) };
        assert_eq!(signs.follow(shown(State::Preparing), 0).0, Some(LightColour::Orange));
        assert_eq!((signs.follow(own, 0).0, signs.follow(own, 700 * MS).0), (None, None));
        assert_eq!(
            signs.follow(shown(State::Stopped), 800 * MS).0,
            Some(LightColour::Green),
            "and set again after it"
        );
    }
}
