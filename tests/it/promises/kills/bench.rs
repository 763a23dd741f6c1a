//! The bench of the kills: a mounted brick that is watched, a run on it with the processes of its
//! kind, and what can become of these.
//!
//! # Not here
//!
//! Which cases there are, how often they are done, and whether this machine was there to see it:
//! `kills.rs`.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock};
use onbrick::ev3dev::LocalTree;
use onbrick::protocol::{Request, Stopped};
use onbrick::recording;
use onbrick::robot::DEFAULT_ROBOT;
use onbrick::runtime::{Brick, HardwareLock, Job, Source};
use onbrick::service::client::Client;
use onbrick::sim::{DeviceFault, Port, World, WorldPhysics};

use super::super::witness::{Seen, Witness};
use super::{COMMANDS_NS, FORCED_REST_NS, HUNG_GUARD_REST_NS, REST_NS};
use crate::foreign::bench::example;
use crate::mount::bench::{Mounted, await_or_fail};
use crate::service::{self, Served};
use crate::support::memory_group::MemoryGroup;
use crate::support::tested_program;

/// The robot's motors.
const MOTORS: [Port; 3] = [Port::OutA, Port::OutB, Port::OutD];

/// How long a sensor needs after it was plugged in again, as its driver has it, and more.
const PLUGGED_NS: i64 = 2500 * MILLISECOND_NS;

/// How long a brick is watched after a fault.
pub(super) const WATCH_NS: i64 = 1000 * MILLISECOND_NS;

/// A robot whose bridges were last under a command longer ago does not drive: the dance has no
/// pause.
const DRIVES_NS: i64 = 20 * MILLISECOND_NS;
/// How fast the wheels dance where a guard is there, degrees per second, and where only the lease
/// is. That ends 0.3 s after a renewal that may have come just before the death, and up to 10 ms
/// later, as the kernel's timer goes; what is left of half a second is the roll-out of a braked
/// robot, 132 ms from 100 and 172 ms from 150 ([`super::roll`]). A wheel that has just been turned
/// round overshoots 150 to 200, and was seen to rest after 506 ms. The shipped missions that drive
/// by themselves go at 60 to 100.
const GUARDED_DPS: f64 = 150.0;
const LEASED_DPS: f64 = 100.0;

/// The mission that is danced.
fn dance(dps: f64) -> String {
    let speed = |share: f64| (dps * share).to_string();
    DANCE
        .replace("BACK", &speed(-1.0))
        .replace("AHEAD", &speed(1.0))
        .replace("LEFT", &speed(-0.73))
        .replace("RIGHT", &speed(0.93))
}

/// Both wheels and the head always move, each now this way and now that, so that a fault hits every
/// moment of a lease and of a change.
const DANCE: &str = r#"
name = "dance"
time_limit_s = 60
finish = "any"

[machine.drive]
start = "ahead"
final = "end"
[machine.drive.state.ahead]
do = { left_dps = AHEAD, right_dps = AHEAD }
next = [{ when = "state_s > 0.37", go = "turn" }]
[machine.drive.state.turn]
do = { left_dps = LEFT, right_dps = RIGHT }
next = [{ when = "state_s > 0.23", go = "back" }]
[machine.drive.state.back]
do = { left_dps = BACK, right_dps = BACK }
next = [{ when = "state_s > 0.41", go = "ahead" }, { when = "time_s > 50", go = "end" }]
[machine.drive.state.end]

[machine.head]
start = "left"
[machine.head.state.left]
do = { head_deg = 60 }
next = [{ when = "state_s > 1.9", go = "right" }]
[machine.head.state.right]
do = { head_deg = -60 }
next = [{ when = "state_s > 1.9", go = "left" }]
"#;

/// What becomes of the processes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Trouble {
    /// SIGKILL.
    Killed,
    /// SIGSTOP, and SIGCONT when everything should be over.
    StoppedAndContinued,
    /// A fault of the program, or its own abort.
    Fault(Signal),
    /// The tick spins for ever.
    Spinning,
    GuardKilled,
    GuardFault(Signal),
    /// The guard gives no sign of life, and then this happens, at once.
    GuardHung(Asked),
    /// Starter and guard are made deaf first, so that they cannot act before they are killed, too.
    AllKilled,
    /// Guard and control give no sign of life, and the starter is told to stop.
    BothHung,
    StarterKilled,
    /// The service that the run was started through is killed, and was told that its runs are to
    /// end with it.
    ServiceKilled,
    /// The kernel kills what drives because it wants more memory than there is.
    OutOfMemory,
    /// This thread of the process that drives panics.
    Panic(&'static str),
}

/// Who asks for a stop, and how.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Asked {
    No,
    /// This signal to the starter.
    Starter(Signal),
    /// This signal to the service that the run was started through.
    Service(Signal),
    /// A request to that service.
    ServiceStop,
}

/// What is there to stop the motors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Protection {
    pub(super) lease: bool,
    pub(super) guard: bool,
}

pub(super) const BOTH: Protection = Protection { lease: true, guard: true };
pub(super) const ONLY_LEASE: Protection = Protection { lease: true, guard: false };
pub(super) const ONLY_GUARD: Protection = Protection { lease: false, guard: true };
pub(super) const NEITHER: Protection = Protection { lease: false, guard: false };

pub(super) type Case = (Trouble, Protection);

impl Trouble {
    /// How long after it a shaft may turn, nanoseconds.
    pub(super) fn rest_ns(self) -> i64 {
        match self {
            Self::GuardHung(_) => HUNG_GUARD_REST_NS,
            Self::BothHung => FORCED_REST_NS,
            _ => REST_NS,
        }
    }

    /// How long a brick is watched after it, nanoseconds.
    fn watch_ns(self) -> i64 {
        WATCH_NS + self.rest_ns() - REST_NS
    }

    /// How long after it a motor may be under a command, nanoseconds.
    pub(super) fn commands_ns(self) -> i64 {
        // Braking takes its time after the last command.
        COMMANDS_NS + self.rest_ns() - REST_NS
    }

    /// True for a run that is started through a service.
    fn is_served(self) -> bool {
        matches!(
            self,
            Self::ServiceKilled | Self::GuardHung(Asked::Service(_) | Asked::ServiceStop)
        )
    }
}

/// What was measured, nanoseconds after the fault.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measured {
    pub(super) commands_ns: i64,
    pub(super) rest_ns: i64,
}

impl Measured {
    pub(super) fn is_in_time(self, trouble: Trouble) -> bool {
        self.commands_ns <= trouble.commands_ns() && self.rest_ns <= trouble.rest_ns()
    }
}

/// A mounted brick and what watches it.
pub(super) struct Bench {
    pub(super) mounted: Mounted,
    seen: Arc<Mutex<Seen>>,
    folder: tempfile::TempDir,
    runs: u32,
}

impl Bench {
    pub(super) fn new(seed: u64) -> Self {
        let (world, seen) =
            Witness::new(WorldPhysics::new(World::named("open").unwrap(), 1, seed).unwrap());
        let mounted = Mounted::over(world, Arc::new(MonotonicClock)).unwrap();
        Self { mounted, seen, folder: tempfile::tempdir().unwrap(), runs: 0 }
    }

    pub(super) fn now_ns(&self) -> i64 {
        self.mounted.simulation.now_ns()
    }

    pub(super) fn seen(&self) -> Seen {
        self.mounted.simulation.catch_up();
        *self.seen.lock().unwrap()
    }

    pub(super) fn drives(&self) -> bool {
        self.now_ns() - self.seen().driven_ns < DRIVES_NS
    }

    pub(super) fn await_free(&self) {
        let root = self.mounted.root();
        await_or_fail("the lock is free", || HardwareLock::owner(&root).unwrap().is_none());
    }

    /// Starts a run, waits until it drives, and for a while more.
    fn start(&mut self, (trouble, protection): Case, after_ns: i64) -> Run {
        self.runs += 1;
        let out = self.folder.path().join(self.runs.to_string());
        let mut run = Run::start((trouble, protection), &self.mounted.root(), &out);
        let began_ns = self.now_ns();
        await_or_fail("the robot drives, or the run is over", || {
            self.seen().driven_ns > began_ns || run.is_over()
        });
        if !protection.lease {
            for port in MOTORS {
                self.mounted.simulation.inject(0, port, DeviceFault::Endless).unwrap();
            }
        }
        // By then every lease was renewed.
        MonotonicClock.sleep_ns(200 * MILLISECOND_NS + after_ns);
        run
    }

    /// Lets one fault happen, and watches what the motors do; nothing where the run has ended by
    /// itself before, as it does where this machine lets it wait for more than 200 ms.
    pub(super) fn suffer(&mut self, case: Case, after_ns: i64) -> Option<Measured> {
        let mut run = self.start(case, after_ns);
        let processes = run.control().and_then(|control| Some((control, parent_of(control)?)));
        let group = (case.0 == Trouble::OutOfMemory).then(|| MemoryGroup::new().unwrap());
        let mut fault_ns = self.now_ns();
        let Some((control, parent)) =
            processes.filter(|_| fault_ns - self.seen().driven_ns < DRIVES_NS)
        else {
            run.end();
            self.await_free();
            return None;
        };
        let guard = case.1.guard.then_some(parent);
        if let Some(group) = &group {
            group.put(control);
        }
        case.0.strike(&mut run, guard, control);
        if let Some(group) = &group {
            // It drives on while it fills its memory: the fault is the kernel's, just before it is
            // seen.
            let deadline_ns = fault_ns + 3 * WATCH_NS;
            while group.kills() == 0 && fault_ns < deadline_ns {
                fault_ns = self.now_ns();
                pass(MILLISECOND_NS);
            }
            // One that had ended by itself before does not want memory any more.
            if group.kills() == 0 {
                run.end();
                self.await_free();
                return None;
            }
        }
        if case.0 == Trouble::Panic("mender") {
            // It does something only where something is not there.
            self.mounted.simulation.inject(0, Port::In1, DeviceFault::Unplug).unwrap();
        }
        let over_ns = case.0.commands_ns() + COMMANDS_NS;
        pass(over_ns);
        // One that is dead needs no going on.
        for process in [Some(control), guard].into_iter().flatten() {
            let _ = kill(process, Signal::SIGCONT);
        }
        pass(case.0.watch_ns() - over_ns);
        let seen = self.seen();
        for process in [Some(control), guard].into_iter().flatten() {
            let _ = kill(process, Signal::SIGKILL);
        }
        run.end();
        self.await_free();
        if !case.1.lease {
            for port in MOTORS {
                self.mounted.simulation.clear(0, port).unwrap();
            }
        }
        if case.0 == Trouble::Panic("mender") {
            self.mounted.simulation.control(0, "clear").unwrap();
            pass(PLUGGED_NS);
        }
        Some(Measured {
            commands_ns: seen.driven_ns - fault_ns,
            rest_ns: seen.turned_ns - fault_ns,
        })
    }
}

pub(super) fn pass(ns: i64) {
    MonotonicClock.sleep_ns(ns);
}

impl Trouble {
    fn strike(self, run: &mut Run, guard: Option<Pid>, control: Pid) {
        let send = |process: Pid, signal| kill(process, signal).unwrap();
        let starter = run.starter();
        match self {
            Self::Killed => send(control, Signal::SIGKILL),
            Self::StoppedAndContinued => send(control, Signal::SIGSTOP),
            Self::Fault(signal) => send(control, signal),
            Self::GuardFault(signal) => send(guard.unwrap(), signal),
            Self::GuardHung(asked) => {
                send(guard.unwrap(), Signal::SIGSTOP);
                run.ask(asked);
            }
            Self::BothHung => {
                send(guard.unwrap(), Signal::SIGSTOP);
                send(control, Signal::SIGSTOP);
                send(starter, Signal::SIGTERM);
            }
            Self::Spinning => send(control, Signal::SIGVTALRM),
            Self::GuardKilled => send(guard.unwrap(), Signal::SIGKILL),
            Self::AllKilled => {
                for process in [starter, guard.unwrap()] {
                    send(process, Signal::SIGSTOP);
                }
                for process in [control, guard.unwrap(), starter] {
                    send(process, Signal::SIGKILL);
                }
            }
            Self::StarterKilled | Self::ServiceKilled => send(starter, Signal::SIGKILL),
            Self::OutOfMemory | Self::Panic(_) => send(control, Signal::SIGPROF),
        }
    }

    /// The program that can have this trouble, and what it is told for it.
    fn program(self) -> Command {
        let troubled = |thread| {
            let mut command = Command::new(example("troubled").unwrap());
            command.env("TROUBLED_THREAD", thread);
            command
        };
        match self {
            Self::Spinning => Command::new(example("troubled").unwrap()),
            Self::OutOfMemory => troubled("memory"),
            Self::Panic(thread) => troubled(thread),
            _ => Command::new(tested_program()),
        }
    }
}

/// The processes of a run: a service or `onbrick run` with a guard, or control by itself.
pub(super) struct Run {
    starter: Starter,
    guarded: bool,
    root: PathBuf,
}

enum Starter {
    Child(Child),
    Service(Box<Served>),
}

impl Run {
    fn start((trouble, protection): Case, root: &Path, out: &Path) -> Self {
        if trouble.is_served() {
            return Self::served("", root);
        }
        let guarded = protection.guard;
        let dance =
            dance(if guarded && trouble != Trouble::AllKilled { GUARDED_DPS } else { LEASED_DPS });
        fs::create_dir(out).unwrap();
        let mission = out.join("dance.toml");
        fs::write(&mission, &dance).unwrap();
        let mut command = trouble.program();
        command.stdout(Stdio::null()).stderr(Stdio::null()).stdin(Stdio::piped());
        if guarded {
            command.arg("run").arg(&mission).arg("--brick").arg(root).arg("--out").arg(out);
        } else {
            command.arg("control");
        }
        let mut child = command.spawn().unwrap();
        if !guarded {
            let source =
                |name: &str, text: &str| Source { name: name.to_owned(), text: text.to_owned() };
            let job = Job::new(
                source("dance.toml", &dance),
                source("robot.toml", DEFAULT_ROBOT),
                Brick::Local(LocalTree::new(root)),
                out.join("run.mcap"),
            );
            let line = serde_json::to_string(&job).unwrap() + "\n";
            child.stdin.as_mut().unwrap().write_all(line.as_bytes()).unwrap();
        }
        Self { starter: Starter::Child(child), guarded, root: root.to_owned() }
    }

    /// Through a service with this in its `onbrick.toml`.
    pub(super) fn served(config: &str, root: &Path) -> Self {
        let folder = service::folder(config);
        fs::write(folder.path().join("missions/dance.toml"), dance(GUARDED_DPS)).unwrap();
        let mut served =
            Served::started(folder, &["--brick", root.to_str().unwrap()], |command| command);
        served.start("dance", "dance");
        Self { starter: Starter::Service(Box::new(served)), guarded: true, root: root.to_owned() }
    }

    /// How a run that was started through a service has ended, by its recording.
    pub(super) fn end_of_served(&self) -> Option<String> {
        let Starter::Service(served) = &self.starter else { return None };
        let recorded = recording::Run::open(&served.path("runs").join("dance/run.mcap")).ok()?;
        recorded.ending.map(|ending| ending.stop.to_string())
    }

    pub(super) fn starter(&self) -> Pid {
        let child = match &self.starter {
            Starter::Child(child) => child,
            Starter::Service(served) => &served.child,
        };
        Pid::from_raw(i32::try_from(child.id()).unwrap())
    }

    pub(super) fn control(&self) -> Option<Pid> {
        let owner = HardwareLock::owner(&self.root).unwrap()?;
        assert_eq!(
            (owner.doing.as_str(), !self.guarded),
            ("mission dance", owner.pid == self.starter().as_raw())
        );
        Some(Pid::from_raw(owner.pid))
    }

    pub(super) fn is_over(&mut self) -> bool {
        match &mut self.starter {
            Starter::Child(child) => child.try_wait().unwrap().is_some(),
            Starter::Service(served) => served.status().last.is_some(),
        }
    }

    /// Asks for a stop, and does not wait for what comes of it.
    fn ask(&mut self, asked: Asked) {
        let starter = self.starter();
        match (asked, &self.starter) {
            (Asked::No, _) => {}
            (Asked::Starter(signal) | Asked::Service(signal), _) => kill(starter, signal).unwrap(),
            (Asked::ServiceStop, Starter::Service(served)) => {
                let mut client = Client::at(served.path("socket"));
                let patience = std::time::Duration::from_secs(10);
                std::thread::spawn(move || {
                    client
                        .ask::<Stopped>(&Request::Stop { run: None }, patience)
                        .expect("it is stopped")
                });
            }
            (Asked::ServiceStop, Starter::Child(_)) => unreachable!("a run of a service"),
        }
    }

    fn end(mut self) {
        if let Starter::Child(child) = &mut self.starter {
            // One that is over needs no killing.
            let _ = child.kill();
            child.wait().unwrap();
        }
    }
}

fn parent_of(process: Pid) -> Option<Pid> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let parent = status.lines().find_map(|line| line.strip_prefix("PPid:"))?;
    Some(Pid::from_raw(parent.trim().parse().unwrap()))
}
