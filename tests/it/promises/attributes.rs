//! Faults under the attribute files, call by call: one that fails is got over, one that takes too
//! long ends the run, and behind one that never comes back (the process is dead) the motors stand
//! still.

use std::sync::Arc;

use nix::errno::Errno;
use onbrick::clock::{Clock, MILLISECOND_NS, VirtualClock};
use onbrick::runtime::{StopReason, replay};

use crate::support::faulty::{Kind, Plan, Rule, Trouble};
use crate::support::is_long;
use crate::support::promised::promised;
use crate::support::stage::{Play, Played};

const CALLS: [Kind; 2] = [Kind::Read, Kind::Write];

fn play(plan: &Plan) -> Played {
    let play = Play { attributes: plan.clone(), ..Play::of("map", "arena", 3).seconds(5.0) };
    play.play().unwrap()
}

/// This many calls of a run, spread over it evenly; all of them in the long form.
fn some_of(calls: u64, some: u64) -> impl Iterator<Item = u64> {
    let step = if is_long() { 1 } else { (calls / some).max(1) };
    (1..=calls).step_by(usize::try_from(step).unwrap())
}

fn clean_calls() -> u64 {
    let plan = Plan::counting(&CALLS);
    let played = play(&plan);
    assert_eq!(played.reason, StopReason::Finished);
    plan.calls()
}

#[test]
fn promise_3_a_call_that_fails_once_or_comes_short_is_got_over() {
    let calls = clean_calls();
    let troubles = [
        Trouble::Fail(Errno::EIO),
        Trouble::Fail(Errno::ENODEV),
        Trouble::Fail(Errno::EAGAIN),
        Trouble::Fail(Errno::EINTR),
        Trouble::Short(0),
        Trouble::Short(1),
    ];
    let mut tried = 0;
    for (nth, trouble) in some_of(calls, 36).zip(troubles.iter().cycle()) {
        let plan = Plan::once(&CALLS, nth, trouble.clone());
        let played = play(&plan);
        assert_eq!(plan.hits(), 1);
        assert_eq!(played.reason, StopReason::Finished, "call {nth} {trouble:?}");
        played.assert_at_rest("a single failure");
        let replayed = replay(&played.run()).unwrap();
        assert!(replayed.is_same(), "call {nth} {trouble:?}: {replayed}");
        tried += 1;
        assert!(played.ended.travelled_m > 0.1, "call {nth}: {} m", played.ended.travelled_m);
    }
    promised(&format!(
        "{tried} of {calls} attribute calls of a run failed or came short, one a run: every run \
         finished and replays bit for bit"
    ));
}

#[test]
fn promise_2_a_call_that_takes_too_long_ends_the_run() {
    let calls = clean_calls();
    let mut ended = 0;
    for nth in some_of(calls, 12) {
        let played = delayed(nth);
        // A call in the last tick delays nothing.
        if played.reason != StopReason::Finished {
            assert_eq!(played.reason, StopReason::Late, "call {nth}");
            ended += 1;
        }
        played.assert_at_rest("a late tick");
    }
    assert!(ended > 10, "{ended} runs ended");
    promised(&format!(
        "an attribute call of 300 ms at {ended} places of a run: the run ended each time"
    ));
}

/// The delay is on the run's own clock, which the stage hands over when it has made it.
fn delayed(nth: u64) -> Played {
    let plan = Plan::counting(&CALLS);
    let clock = Arc::new(VirtualClock::default());
    let late: Arc<dyn Clock> = clock.clone();
    plan.add(Rule { nth, times: 1, trouble: Trouble::Delay(late, 300 * MILLISECOND_NS) });
    Play { attributes: plan, clock, ..Play::of("map", "arena", 3).seconds(5.0) }.play().unwrap()
}

#[test]
fn promise_1_a_process_that_dies_at_any_call_leaves_motors_that_stop() {
    let calls = clean_calls();
    let mut tried = 0;
    for nth in some_of(calls, 24) {
        let plan = Plan::once(&CALLS, nth, Trouble::Die(0));
        let played = play(&plan);
        // Nothing of what control does behind that call reaches the brick, not even its own
        // stopping.
        played.assert_at_rest(&format!("dead at call {nth}"));
        tried += 1;
    }
    promised(&format!(
        "dead at {tried} of {calls} attribute calls: the wheels stand each time, by the \
         leases alone"
    ));
}
