//! Scenarios in real time: ahead of others at the processor, and judged only by a machine that kept
//! time.
//!
//! A program that sleeps, polls and drives on the wall's clock is late if the machine gives the
//! processor to others, and a robot keeps rolling meanwhile. So what depends on time is not
//! asserted but reported to a [`Pace`], which takes it as a failure only if neither the scenario
//! nor its processes had to wait for a processor. Otherwise the scenario is played again, and in
//! the end passed over ([`pass_over`]).
//!
//! What does not depend on time is asserted as everywhere, and fails at once. A test whose every
//! assertion depends on processes that keep time is played [`patiently`].
//!
//! # What we count on
//!
//! - `/proc/PID/task/TID/schedstat`: the nanoseconds that a thread was ready to run and did not.
//! - `/proc/stat`: what a hypervisor took. Where either is missing, what this process oversleeps
//!   has to do.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

use super::pass_over;

/// A machine is starved that kept a thread of the scenario waiting for more than this in a
/// [`WINDOW_NS`]. What a scenario allows in time and way must be more than what comes of such a
/// wait.
const MOST_WAIT_NS: i64 = 20 * MILLISECOND_NS;
const WINDOW_NS: i64 = 100 * MILLISECOND_NS;

/// Once in this many windows, the children of the watched processes are looked up again.
const FAMILY_WINDOWS: u32 = 5;

/// How long the watch sleeps at a time, to find out by how much it oversleeps.
const NAP_NS: i64 = 5 * MILLISECOND_NS;

/// A scenario is played so often before it is left without a judgement.
const ATTEMPTS: usize = if QEMU { 3 } else { 5 };

/// A program that runs on QEMU's user mode keeps no time: what it does for the first time is
/// translated first, which takes it up to half a second beside others, and a loop that is so late
/// ends its run, as it should.
const QEMU: bool = cfg!(target_arch = "arm");

/// A tick of the counters in `/proc/stat`: USER_HZ is 100 on every machine that Linux runs on
/// today.
const STAT_TICK_NS: i64 = 10 * MILLISECOND_NS;

static MACHINE: RwLock<()> = RwLock::new(());

/// Keeps a test that takes all the machine has, or measures how fast it is, apart from the others
/// in real time.
pub fn alone() -> RwLockWriteGuard<'static, ()> {
    MACHINE.write().unwrap_or_else(PoisonError::into_inner)
}

/// Of tests in real time that wait most of it: several at once, and none while one is [`alone`].
pub fn beside_others() -> RwLockReadGuard<'static, ()> {
    MACHINE.read().unwrap_or_else(PoisonError::into_inner)
}

/// Threads that are started from now on by this one come before what else this machine does, where
/// that is permitted.
pub fn come_first() -> bool {
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let priority = ThreadPriority::Crossplatform(ThreadPriorityValue::try_from(5).unwrap());
    set_thread_priority_and_policy(thread_native_id(), priority, policy).is_ok()
}

/// Plays a scenario until it has nothing to complain of, or the machine kept time and it has.
///
/// # Panics
///
/// If it complains on a machine that kept time; and when the scenario itself does, at once.
pub fn in_real_time(name: &str, scenario: impl Fn(&Pace)) {
    for attempt in 1..=ATTEMPTS {
        let (complaints, waited_ns) = play(&scenario);
        let how = format!(
            "{name}, kept waiting for a processor for {} ms at worst",
            waited_ns / MILLISECOND_NS
        );
        let all = complaints.join("\n");
        match judge(&complaints, waited_ns) {
            Judgement::Passed => return println!("{how}: passed"),
            Judgement::Failed => panic!("{how}, which is no excuse:\n{all}"),
            Judgement::Starved => println!("{how}: attempt {attempt} is not judged:\n{all}"),
        }
    }
    pass_over(&format!("a processor for {name}: it was starved {ATTEMPTS} times"));
}

/// Plays a test whose processes must keep time, again where it fails on a machine that starved this
/// process or those that it started. The last attempt counts, whatever the machine did; on QEMU's
/// user mode, which starves them by itself, the test is passed over instead.
///
/// # Panics
///
/// As the test does.
pub fn patiently(name: &str, test: impl Fn()) {
    for _ in 1..ATTEMPTS {
        let failure = RefCell::new(None);
        let (_, waited_ns) = play(|pace| {
            pace.watched.lock().unwrap().push(std::process::id());
            *failure.borrow_mut() = catch_unwind(AssertUnwindSafe(&test)).err();
        });
        match failure.into_inner() {
            None => return,
            Some(failure) if waited_ns <= MOST_WAIT_NS => resume_unwind(failure),
            Some(_) => println!(
                "{name}: once more; it failed where the machine let it wait for {} ms",
                waited_ns / MILLISECOND_NS
            ),
        }
    }
    if QEMU {
        return pass_over("a processor that keeps time, which QEMU's user mode is not");
    }
    test();
}

#[derive(Debug, PartialEq, Eq)]
enum Judgement {
    Passed,
    Failed,
    Starved,
}

fn judge(complaints: &[String], waited_ns: i64) -> Judgement {
    match (complaints.is_empty(), waited_ns > MOST_WAIT_NS) {
        (true, _) => Judgement::Passed,
        (false, false) => Judgement::Failed,
        (false, true) => Judgement::Starved,
    }
}

/// What a scenario starts its processes with, and says its judgements to.
#[derive(Default)]
pub struct Pace {
    watched: Mutex<Vec<u32>>,
    complaints: RefCell<Vec<String>>,
}

impl Pace {
    /// A program that comes first at the processor, where the kernel grants that to us.
    pub fn command(program: &str) -> Command {
        static GRANTED: OnceLock<bool> = OnceLock::new();
        // It runs the program all the same where it is refused, and then says so.
        let first = ["-n", "-10"];
        let granted = GRANTED.get_or_init(|| {
            let probe = Command::new("nice").args(first).arg("true").output();
            probe.is_ok_and(|output| output.status.success() && output.stderr.is_empty())
        });
        if !granted {
            return Command::new(program);
        }
        let mut command = Command::new("nice");
        command.args(first).arg(program);
        command
    }

    /// What this process and those that it starts wait for is counted from now on.
    pub fn watch(&self, process: &Child) {
        self.watched.lock().unwrap().push(process.id());
    }

    /// Something that depends on time.
    pub fn ensure(&self, holds: bool, what: impl FnOnce() -> String) {
        if !holds {
            self.complaints.borrow_mut().push(what());
        }
    }

    /// Two things that are the same if nothing came late.
    pub fn same<T: PartialEq<U> + Debug, U: Debug>(&self, what: &str, found: &T, expected: &U) {
        self.ensure(found == expected, || format!("{what}: {found:?}, not {expected:?}"));
    }

    /// A number that comes near another if nothing came late.
    pub fn near(&self, what: &str, found: f64, expected: f64, within: f64) {
        let holds = (found - expected).abs() <= within;
        self.ensure(holds, || format!("{what}: {found}, not within {within} of {expected}"));
    }
}

/// Plays it once: what it complains of, and how long it was kept waiting in the worst stretch.
fn play(scenario: impl Fn(&Pace)) -> (Vec<String>, i64) {
    let pace = Pace::default();
    let (over, worst_ns) = (AtomicBool::new(false), Mutex::new(0));
    std::thread::scope(|scope| {
        let (watched, over) = (&pace.watched, &over);
        scope.spawn(|| watch(watched, over, &worst_ns));
        // Set on the way out of a panic, too: the scope waits for the watch.
        let _end = End(over);
        scenario(&pace);
    });
    (pace.complaints.into_inner(), worst_ns.into_inner().unwrap())
}

struct End<'f>(&'f AtomicBool);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Keeps the longest wait in a window until it is over.
fn watch(watched: &Mutex<Vec<u32>>, over: &AtomicBool, worst_ns: &Mutex<i64>) {
    let (mut family, mut known) = (Vec::new(), 0);
    let mut before = Counters::of(&family);
    for window in 0.. {
        if over.load(Ordering::Relaxed) {
            return;
        }
        let roots = watched.lock().unwrap().clone();
        if window % FAMILY_WINDOWS == 0 || roots.len() != known {
            known = roots.len();
            family = with_children(roots);
        }
        let overslept_ns = oversleep();
        let counters = Counters::of(&family);
        let mut worst_ns = worst_ns.lock().unwrap();
        *worst_ns = (*worst_ns).max(overslept_ns).max(counters.since(&before));
        before = counters;
    }
}

/// By how much this thread oversleeps in a window, nanoseconds.
fn oversleep() -> i64 {
    let begun_ns = MonotonicClock.now_ns();
    let mut overslept_ns = 0;
    while MonotonicClock.now_ns() - begun_ns < WINDOW_NS {
        let due_ns = MonotonicClock.now_ns() + NAP_NS;
        MonotonicClock.sleep_until_ns(due_ns);
        overslept_ns += MonotonicClock.now_ns() - due_ns;
    }
    overslept_ns
}

/// Processes, and those that they started, and so on.
fn with_children(mut family: Vec<u32>) -> Vec<u32> {
    let parents: Vec<(u32, u32)> =
        fs::read_dir("/proc").into_iter().flatten().flatten().filter_map(parent).collect();
    let mut index = 0;
    while let Some(&process) = family.get(index) {
        family.extend(
            parents.iter().filter(|(_, parent)| *parent == process).map(|(child, _)| child),
        );
        index += 1;
    }
    family
}

/// A process of `/proc`, and which one started it.
fn parent(entry: fs::DirEntry) -> Option<(u32, u32)> {
    let process = entry.file_name().to_str()?.parse().ok()?;
    let stat = fs::read_to_string(entry.path().join("stat")).ok()?;
    // The name before it may hold anything, brackets and spaces too.
    let parent = stat.rsplit_once(')')?.1.split_whitespace().nth(1)?.parse().ok()?;
    Some((process, parent))
}

/// How long was waited until now, nanoseconds.
struct Counters {
    /// By each thread of the watched processes and of those that they started.
    threads: BTreeMap<PathBuf, i64>,
    /// By the whole machine, for its hypervisor.
    stolen_ns: i64,
}

impl Counters {
    fn of(processes: &[u32]) -> Self {
        let tasks = processes
            .iter()
            .filter_map(|process| fs::read_dir(format!("/proc/{process}/task")).ok());
        let files = tasks.flatten().flatten().map(|task| task.path().join("schedstat"));
        let threads =
            files.filter_map(|file| field(&file, 1).map(|waited_ns| (file, waited_ns))).collect();
        // user nice system idle iowait irq softirq steal, after the word `cpu` and two spaces.
        Self { threads, stolen_ns: field(Path::new("/proc/stat"), 9).unwrap_or(0) * STAT_TICK_NS }
    }

    /// The longest wait since then. A thread that is new may have waited for all that it has
    /// counted.
    fn since(&self, before: &Self) -> i64 {
        let waited =
            self.threads.iter().map(|(thread, ns)| ns - before.threads.get(thread).unwrap_or(&0));
        waited.max().unwrap_or(0).max(self.stolen_ns - before.stolen_ns)
    }
}

/// A number in a file's first line.
fn field(path: &Path, index: usize) -> Option<i64> {
    fs::read_to_string(path).ok()?.lines().next()?.split(' ').nth(index)?.parse().ok()
}

#[test]
fn a_scenario_that_has_nothing_to_complain_of_is_played_once() {
    let played = std::cell::Cell::new(0);
    in_real_time("content", |pace| {
        played.set(played.get() + 1);
        pace.same("one", &1, &1);
        pace.near("half", 0.5, 0.6, 0.11);
    });
    assert_eq!(played.get(), 1);
}

#[test]
fn only_a_machine_that_kept_time_is_a_judge() {
    let wrong = ["late".to_owned()];
    assert_eq!(judge(&[], 90 * MILLISECOND_NS), Judgement::Passed);
    assert_eq!(judge(&wrong, 90 * MILLISECOND_NS), Judgement::Starved);
    assert_eq!(judge(&wrong, 3 * MILLISECOND_NS), Judgement::Failed);
}

/// A process that another one keeps from the only processor both may use.
#[test]
fn a_process_that_waits_for_a_processor_is_found_out() {
    let pinned = |script: &str| {
        let child = Command::new("taskset").args(["-c", "0", "sh", "-c", script]).spawn();
        child.expect("taskset, of util-linux")
    };
    let spin = "while :; do :; done";
    let (mut first, mut second) = (pinned(spin), pinned(spin));
    let (complaints, waited_ns) = play(|pace| {
        pace.watch(&second);
        // The window in which it came to be watched, the next, which counts it from its beginning,
        // and room for a watch that is late itself.
        MonotonicClock.sleep_ns(10 * WINDOW_NS);
        pace.ensure(false, || "late".to_owned());
    });
    for process in [&mut first, &mut second] {
        process.kill().unwrap();
        process.wait().unwrap();
    }
    assert_eq!(complaints, ["late"]);
    assert!(waited_ns > MOST_WAIT_NS, "{waited_ns} ns");
}
