//! Promise 1, on the real binary and a mounted brick: whatever becomes of a run's processes, its
//! motors stop.
//!
//! The fault's time is the simulation's just before the signal is sent; the ends are the
//! simulation's, to a step of 2 ms. Where a bound is missed while this machine let a thread of ours
//! wait for longer than [`STARVED_NS`], the case is done again: then it was the machine's miss. The
//! long form (`ONBRICK_LONG=1`) is 1000 faults on twenty bricks; `ONBRICK_KILLS` and
//! `ONBRICK_BRICKS` say otherwise.

use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock};

use self::bench::{
    Asked, BOTH, Bench, Case, Measured, NEITHER, ONLY_GUARD, ONLY_LEASE, Protection, Run, Trouble,
    WATCH_NS, pass,
};
use crate::foreign::bench::example;
use crate::mount::bench::{await_or_fail, no_fuse, real_time};
use crate::support::is_long;
use crate::support::memory_group::no_memory_groups;
use crate::support::pass_over;
use crate::support::promised::promised;
use crate::support::real_time::come_first;
use crate::support::tested_program;

mod bench;

/// After a death no motor is under a command for longer, and no shaft turns for longer.
pub(super) const COMMANDS_NS: i64 = 350 * MILLISECOND_NS;
pub(super) const REST_NS: i64 = 500 * MILLISECOND_NS;
/// The same where the guard hangs: control must first notice that.
const HUNG_GUARD_REST_NS: i64 = 600 * MILLISECOND_NS;
/// The same where guard and control hang and a stop is asked for.
const FORCED_REST_NS: i64 = 1500 * MILLISECOND_NS;
/// So often a case is done again before this machine is too busy to tell.
const ATTEMPTS: usize = 10;

/// A machine that lets a thread wait for this long is starved.
const STARVED_NS: i64 = 25 * MILLISECOND_NS;

/// One of each, within a minute on a few bricks. A thread that panics stops the motors, even if
/// another process could do it.
const CASES: [Case; 42] = [
    (Trouble::Killed, BOTH),
    (Trouble::StoppedAndContinued, BOTH),
    (Trouble::Fault(Signal::SIGSEGV), BOTH),
    (Trouble::Fault(Signal::SIGBUS), BOTH),
    (Trouble::Fault(Signal::SIGILL), BOTH),
    (Trouble::Fault(Signal::SIGFPE), BOTH),
    (Trouble::Fault(Signal::SIGABRT), BOTH),
    (Trouble::Spinning, BOTH),
    (Trouble::GuardKilled, BOTH),
    (Trouble::GuardFault(Signal::SIGSEGV), BOTH),
    (Trouble::GuardFault(Signal::SIGBUS), BOTH),
    (Trouble::GuardFault(Signal::SIGABRT), BOTH),
    (Trouble::GuardHung(Asked::No), BOTH),
    (Trouble::GuardHung(Asked::No), ONLY_GUARD),
    (Trouble::GuardHung(Asked::Starter(Signal::SIGINT)), BOTH),
    (Trouble::GuardHung(Asked::Starter(Signal::SIGTERM)), BOTH),
    (Trouble::GuardHung(Asked::Starter(Signal::SIGKILL)), BOTH),
    (Trouble::GuardHung(Asked::ServiceStop), BOTH),
    (Trouble::GuardHung(Asked::Service(Signal::SIGTERM)), BOTH),
    (Trouble::GuardHung(Asked::Service(Signal::SIGKILL)), BOTH),
    (Trouble::BothHung, BOTH),
    (Trouble::BothHung, ONLY_GUARD),
    (Trouble::AllKilled, BOTH),
    (Trouble::StarterKilled, BOTH),
    (Trouble::Killed, ONLY_GUARD),
    (Trouble::StoppedAndContinued, ONLY_GUARD),
    (Trouble::Spinning, ONLY_GUARD),
    (Trouble::StarterKilled, ONLY_GUARD),
    (Trouble::Killed, ONLY_LEASE),
    (Trouble::Fault(Signal::SIGSEGV), ONLY_LEASE),
    (Trouble::Fault(Signal::SIGABRT), ONLY_LEASE),
    (Trouble::Spinning, ONLY_LEASE),
    (Trouble::ServiceKilled, BOTH),
    (Trouble::ServiceKilled, ONLY_GUARD),
    (Trouble::OutOfMemory, BOTH),
    (Trouble::OutOfMemory, ONLY_LEASE),
    (Trouble::OutOfMemory, ONLY_GUARD),
    (Trouble::Panic("tick"), BOTH),
    (Trouble::Panic("tick"), NEITHER),
    (Trouble::Panic("recorder"), NEITHER),
    (Trouble::Panic("mender"), NEITHER),
    (Trouble::Panic("orders"), NEITHER),
];
/// Notes when this machine woke a thread of ours late; it has the same priority as what serves the
/// mounts.
struct Canary {
    /// When.
    late: Arc<Mutex<Vec<i64>>>,
    ended: Arc<AtomicBool>,
}

impl Canary {
    fn new() -> Self {
        let canary = Self { late: Arc::default(), ended: Arc::default() };
        let (late, ended) = (Arc::clone(&canary.late), Arc::clone(&canary.ended));
        std::thread::spawn(move || {
            while !ended.load(Ordering::Relaxed) {
                let due_ns = MonotonicClock.now_ns() + 2 * MILLISECOND_NS;
                MonotonicClock.sleep_until_ns(due_ns);
                let now_ns = MonotonicClock.now_ns();
                if now_ns - due_ns > STARVED_NS {
                    late.lock().unwrap().push(now_ns);
                }
            }
        });
        canary
    }

    /// True if this machine was starved at any time since then.
    fn starved_since(&self, since_ns: i64) -> bool {
        self.late.lock().unwrap().iter().any(|at_ns| *at_ns >= since_ns)
    }
}

impl Drop for Canary {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
    }
}
fn number(variable: &str, default: usize) -> usize {
    std::env::var(variable).map_or(default, |text| text.parse().unwrap())
}

/// The same sequence at each run: multiplicative hashing spreads the moments over the dance's
/// period of a second.
fn moment_ns(number: usize) -> i64 {
    let spread = u32::try_from(number).unwrap().wrapping_mul(2_654_435_769);
    i64::from(spread / 4_295) * 1000
}

/// In milliseconds.
fn quantile(sorted_ns: &[i64], per_cent: usize) -> i64 {
    sorted_ns[((sorted_ns.len() - 1) * per_cent).div_ceil(100)] / MILLISECOND_NS
}

fn report(what: &str, mut ns: Vec<i64>) {
    ns.sort_unstable();
    let [p50, p99, max] = [50, 99, 100].map(|per_cent| quantile(&ns, per_cent));
    promised(&format!("{what}: {} times, p50 {p50} ms, p99 {p99} ms, max {max} ms", ns.len()));
}

#[test]
fn promise_1_whatever_becomes_of_a_runs_processes_its_motors_stop() {
    if no_fuse() || no_memory_groups() || example("troubled").is_none() {
        return;
    }
    let _alone = real_time();
    let kills = number("ONBRICK_KILLS", if is_long() { 1000 } else { CASES.len() });
    let bricks = number("ONBRICK_BRICKS", if is_long() { 20 } else { 5 });
    let first = come_first();
    promised(&format!(
        "{kills} faults on {bricks} bricks; what serves them comes first on this machine: {first}"
    ));
    let canary = Canary::new();
    let next = Mutex::new(0);
    let results: Mutex<Vec<(Case, Measured)>> = Mutex::default();
    let starved = Mutex::new(0);
    std::thread::scope(|scope| {
        for brick in 0..bricks {
            let (canary, next, results, starved) = (&canary, &next, &results, &starved);
            scope.spawn(move || {
                let mut bench = Bench::new(brick as u64);
                loop {
                    let number = {
                        let mut next = next.lock().unwrap();
                        *next += 1;
                        *next - 1
                    };
                    if number >= kills {
                        return;
                    }
                    let case = CASES[number % CASES.len()];
                    if let Some(measured) = bench.judged(case, number, canary, starved) {
                        results.lock().unwrap().push((case, measured));
                    }
                }
            });
        }
    });
    let results = results.into_inner().unwrap();
    for case in CASES {
        let of_case: Vec<Measured> = results
            .iter()
            .filter(|(done, _)| *done == case)
            .map(|(_, measured)| *measured)
            .collect();
        let (trouble, Protection { lease, guard }) = case;
        let what = format!("{trouble:?}, lease {lease}, guard {guard}");
        if !of_case.is_empty() {
            report(
                &format!("{what}: last command ended"),
                of_case.iter().map(|one| one.commands_ns).collect(),
            );
            report(&format!("{what}: at rest"), of_case.iter().map(|one| one.rest_ns).collect());
        }
    }
    report("all: last command ended", results.iter().map(|(_, one)| one.commands_ns).collect());
    report("all: at rest", results.iter().map(|(_, one)| one.rest_ns).collect());
    promised(&format!(
        "done again because this machine was starved: {}",
        starved.into_inner().unwrap()
    ));
    if results.len() < kills {
        pass_over(&format!(
            "a processor for {} of {kills} kills: it was starved each time",
            kills - results.len()
        ));
    }
    assert!(!results.is_empty(), "this machine is too busy for a control loop");
    let missed: Vec<_> =
        results.iter().filter(|((trouble, _), measured)| !measured.is_in_time(*trouble)).collect();
    assert!(missed.is_empty(), "{missed:#?}");
}

impl Bench {
    /// Suffers a case until this machine was there to see it.
    fn judged(
        &mut self,
        case: Case,
        number: usize,
        canary: &Canary,
        starved: &Mutex<u32>,
    ) -> Option<Measured> {
        for attempt in 0..ATTEMPTS {
            let since_ns = MonotonicClock.now_ns();
            let measured = self.suffer(case, moment_ns(number + 7919 * attempt));
            if let Some(measured) = measured
                && (measured.is_in_time(case.0) || !canary.starved_since(since_ns))
            {
                return Some(measured);
            }
            println!("on a starved machine: {case:?}: {measured:?}");
            *starved.lock().unwrap() += 1;
        }
        None
    }
}

#[test]
fn promise_1_without_lease_and_guard_the_motors_would_go_on() {
    if no_fuse() {
        return;
    }
    let _alone = real_time();
    let mut bench = Bench::new(1);
    let measured = (0..ATTEMPTS).find_map(|_| bench.suffer((Trouble::Killed, NEITHER), 0));
    let measured = measured.expect("this machine is too busy for a control loop");
    assert!(measured.commands_ns > WATCH_NS / 2, "the harness sees what turns: {measured:?}");
    let halt = Command::new(tested_program())
        .args(["halt", "--brick"])
        .arg(bench.mounted.root())
        .output()
        .unwrap();
    assert!(halt.status.success(), "{}", String::from_utf8_lossy(&halt.stderr));
    std::thread::sleep(Duration::from_millis(20));
    let seen = bench.seen();
    assert!(
        bench.now_ns() - seen.turned_ns > 500 * MILLISECOND_NS,
        "halt stopped what was left running"
    );
}

#[test]
fn promise_1_a_run_that_may_outlive_its_service_goes_on_under_its_guard() {
    if no_fuse() {
        return;
    }
    let _alone = real_time();
    println!("what serves the brick comes first: {}", come_first());
    let bench = Bench::new(1);
    for attempt in 1..=ATTEMPTS {
        let mut run = Run::served("when_service_dies = \"go on\"", &bench.mounted.root());
        let began_ns = bench.now_ns();
        await_or_fail("the robot drives, or the run is over", || {
            bench.seen().driven_ns > began_ns || run.is_over()
        });
        kill(run.starter(), Signal::SIGKILL).unwrap();
        pass(WATCH_NS);
        let (control, drives, fault_ns) = (run.control(), bench.drives(), bench.now_ns());
        if let Some(control) = control {
            kill(control, Signal::SIGKILL).unwrap();
        }
        pass(WATCH_NS);
        let seen = bench.seen();
        let measured =
            Measured { commands_ns: seen.driven_ns - fault_ns, rest_ns: seen.turned_ns - fault_ns };
        bench.await_free();
        if control.is_none() || !drives {
            println!("attempt {attempt}: it does not drive: {:?}", run.end_of_served());
            continue;
        }
        if measured.is_in_time(Trouble::ServiceKilled) {
            return promised(&format!(
                "the service killed, the run continues; then control is killed: last command ended \
                 after {} ms, at rest after {} ms",
                measured.commands_ns / MILLISECOND_NS,
                measured.rest_ns / MILLISECOND_NS
            ));
        }
        println!("attempt {attempt}: {measured:?}");
    }
    panic!("{ATTEMPTS} times the guard was late, or the run did not go on");
}
