//! `run`, `halt` and `devices` on a brick of plain files: whatever happens to the run or to who
//! started it, the motors end still.

use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use onbrick::ev3dev::LocalTree;
use onbrick::recording::Run;
use onbrick::robot::DEFAULT_ROBOT;
use onbrick::runtime::{
    Brick, Environment, HardwareLock, Heartbeat, Job, Lock, Source, StopFlags, StopReason, execute,
};
use onbrick::sim::EventLayout;

use super::{Done, done, keys, names, onbrick, onbrick_in_time, run, text};
use crate::foreign::bench::{no_namespaces, unshare};
use crate::support::real_time::patiently;
use crate::support::tested_program;
use crate::support::turning_brick::{MOTORS, TurningBrick, await_that};

/// A mission that drives straight on and moves the head for a minute.
const DRIVE: &str = r#"
name = "straight"
time_limit_s = 60
[machine.drive]
start = "on"
final = "off"
[machine.drive.state.on]
do = { left_dps = 90, right_dps = 90, head_deg = 60 }
next = [{ when = "time_s > 50", go = "off" }]
[machine.drive.state.off]
"#;

/// Faults that end a process at once, sent once each.
const FAULTS: [Signal; 5] =
    [Signal::SIGSEGV, Signal::SIGBUS, Signal::SIGILL, Signal::SIGFPE, Signal::SIGABRT];

/// A robot that has nothing but wheels: what else is plugged in is no concern of its runs.
const TWO_WHEELS: &str = r#"
name = "two wheels"
[drive]
left = { port = "outB" }
right = { port = "outD" }
wheel_circumference_m = 0.188976
track_width_m = 0.1143
max_dps = 360
"#;

/// A run under way on a brick of plain files.
struct Running {
    brick: TurningBrick,
    folder: tempfile::TempDir,
    child: Child,
}

impl Running {
    fn start(mission: &str) -> Self {
        Self::on(TurningBrick::new(), mission)
    }

    fn on(brick: TurningBrick, mission: &str) -> Self {
        Self::with(brick, mission, tempfile::tempdir().unwrap(), &[])
    }

    /// With options that name files in a folder.
    fn with(
        brick: TurningBrick,
        mission: &str,
        folder: tempfile::TempDir,
        options: &[&str],
    ) -> Self {
        std::fs::write(folder.path().join("mission.toml"), mission).unwrap();
        let root = text(brick.root().to_owned());
        let child = onbrick_in_time(
            folder.path(),
            &["run", "mission.toml", "--brick", &root, "--out", "o"],
        )
        .args(options)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
        Self { brick, folder, child }
    }

    fn starter(&self) -> Pid {
        Pid::from_raw(i32::try_from(self.child.id()).unwrap())
    }

    /// The process that drives, as the lock names it.
    fn control(&self) -> Pid {
        let mut owner = None;
        await_that("the lock has an owner", || {
            // The guard has the lock before control gives its name.
            owner = self.brick.owner().filter(|owner| owner.doing.starts_with("mission"));
            owner.is_some()
        });
        let owner = owner.unwrap();
        assert_eq!(owner.doing, "mission straight");
        Pid::from_raw(owner.pid)
    }

    /// The process between the starter and the one that drives.
    fn guard(&self) -> Pid {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.control())).unwrap();
        let parent = status.lines().find_map(|line| line.strip_prefix("PPid:")).unwrap();
        let parent = Pid::from_raw(parent.trim().parse().unwrap());
        assert_ne!(parent, self.starter(), "the guard is a process of its own");
        parent
    }

    /// Waits for the run's end and looks at what it leaves: the lock free, the recording readable.
    fn finish(self) -> (TurningBrick, Done, Run) {
        let Self { brick, folder, child } = self;
        let said = done(&child.wait_with_output().unwrap());
        await_that("the lock is free", || brick.owner().is_none());
        let recorded = Run::open(&folder.path().join("o/run.mcap")).unwrap();
        (brick, said, recorded)
    }
}

#[test]
fn a_second_run_is_refused_whatever_path_leads_to_the_brick() {
    if no_namespaces() {
        return;
    }
    patiently("a second run through a bind mount", || {
        let running = Running::start(DRIVE);
        running.brick.await_driving();
        let other = running.folder.path().join("other");
        std::fs::create_dir(&other).unwrap();
        let second = unshare()
            .args([
                "sh",
                "-c",
                "mount --bind \"$1\" other && \
                 exec \"$0\" run mission.toml --brick other --out second",
            ])
            .arg(tested_program())
            .arg(running.brick.root())
            .current_dir(running.folder.path())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&second.stderr);
        assert_eq!(second.status.code(), Some(3), "{said}");
        assert!(said.contains("the motors belong to mission straight"), "{said}");
        kill(running.starter(), Signal::SIGTERM).unwrap();
        running.finish();
    });
}

#[test]
fn every_signal_to_either_process_stops_the_motors_and_ends_the_run_in_order() {
    patiently("every_signal_to_either_process_stops_the_motors_and_ends_the_run_in_order", || {
        let case = |signal: Signal, to_control: bool| {
            let running = Running::start(DRIVE);
            running.brick.await_driving();
            let control = running.control();
            assert_ne!(control, running.starter(), "control is a process of its own");
            let sent = Instant::now();
            kill(if to_control { control } else { running.starter() }, signal).unwrap();
            await_that("every motor is still", || running.brick.is_still());
            let took = sent.elapsed();
            let (brick, said, recorded) = running.finish();
            let case = format!("{signal}, to control: {to_control}");
            assert!(took < Duration::from_secs(1), "{case}: still after {took:?}");
            // Who started it hears of Ctrl-C as a shell expects it.
            let dies = signal == Signal::SIGINT && !to_control;
            let code = (!dies).then_some(6);
            assert_eq!(said.code, code, "{case}: {}{}", said.out, said.err);
            assert!(said.out.contains("stopped by a signal"), "{case}: {}", said.out);
            assert_eq!(brick.commands(), ["stop"; 3], "{case}");
            let ending = recorded.ending.expect("the recording is complete");
            assert_eq!(ending.stop.reason, StopReason::Signal, "{case}");
            assert!(!recorded.senses.is_empty(), "{case}");
        };
        std::thread::scope(|scope| {
            for signal in [Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP] {
                scope.spawn(move || case(signal, false));
                scope.spawn(move || case(signal, true));
            }
        });
    });
}

#[test]
fn buttons_and_a_speaker_with_other_names_stop_the_run_and_beep() {
    patiently("buttons_and_a_speaker_with_other_names_stop_the_run_and_beep", || {
        let folder = tempfile::tempdir().unwrap();
        let (buttons, speaker) = (folder.path().join("keyboard"), folder.path().join("beeper"));
        nix::unistd::mkfifo(&buttons, nix::sys::stat::Mode::S_IRWXU).unwrap();
        std::fs::write(&speaker, "").unwrap();
        // Held open in both directions, so that its reader always has a writer.
        let mut keyboard =
            std::fs::OpenOptions::new().read(true).write(true).open(&buttons).unwrap();
        let options = ["--buttons", "keyboard", "--speaker", "beeper"];
        let running = Running::with(TurningBrick::new(), DRIVE, folder, &options);
        running.brick.await_driving();
        let played = std::fs::read(&speaker).unwrap();
        let length = EventLayout::NATIVE.length();
        let tones =
            played.chunks(length).filter(|event| event[length - 8..length - 4] == [0x12, 0, 2, 0]);
        assert!(
            tones.count() >= 2,
            "a tone and its end, before anything moved: {} bytes",
            played.len()
        );
        // EV_KEY, KEY_BACKSPACE, pressed: the Back button; and the EV_SYN that ends what belongs
        // together.
        let mut events = vec![0; 2 * length];
        events[length - 8..length].copy_from_slice(&[1, 0, 14, 0, 1, 0, 0, 0]);
        keyboard.write_all(&events).unwrap();
        let (brick, said, recorded) = running.finish();
        assert_eq!(said.code, Some(6), "{}{}", said.out, said.err);
        assert_eq!(recorded.ending.unwrap().stop.to_string(), "stopped by a button on the brick");
        assert_eq!(brick.commands(), ["stop"; 3]);
    });
}

#[test]
fn promise_1_the_run_stops_when_its_starter_is_killed_or_hangs() {
    patiently("promise_1_the_run_stops_when_its_starter_is_killed_or_hangs", || {
        for signal in [Signal::SIGKILL, Signal::SIGSTOP] {
            let running = Running::start(DRIVE);
            running.brick.await_driving();
            kill(running.starter(), signal).unwrap();
            await_that("every motor is still", || running.brick.is_still());
            kill(running.starter(), Signal::SIGCONT).unwrap();
            let (brick, said, recorded) = running.finish();
            assert_eq!(brick.commands(), ["stop"; 3], "{signal}");
            let why = StopReason::Abandoned.to_string();
            assert_eq!(recorded.ending.unwrap().stop.to_string(), why, "{signal}");
            if signal == Signal::SIGSTOP {
                assert_eq!(said.code, Some(1), "{}", said.err);
                assert!(said.err.contains(&why), "{}", said.err);
            }
        }
    });
}

#[test]
fn promise_1_a_key_of_the_terminal_stops_the_run_though_all_its_processes_hear_it() {
    patiently("promise_1_a_key_of_the_terminal_stops_the_run", || {
        for signal in [Signal::SIGINT, Signal::SIGQUIT, Signal::SIGTSTP] {
            let running = Running::start(DRIVE);
            running.brick.await_driving();
            for process in [running.control(), running.guard(), running.starter()] {
                kill(process, signal).unwrap();
            }
            let (brick, said, recorded) = running.finish();
            let code = (signal != Signal::SIGINT).then_some(6);
            assert_eq!(said.code, code, "{signal}: {}", said.err);
            assert_eq!(brick.commands(), ["stop"; 3], "{signal}");
            assert_eq!(recorded.ending.unwrap().stop.reason, StopReason::Signal, "{signal}");
        }
    });
}

#[test]
fn promise_1_when_control_is_killed_the_guard_stops_the_motors_and_the_starter_says_so() {
    patiently(
        "promise_1_when_control_is_killed_the_guard_stops_the_motors_and_the_starter_says_so",
        || {
            for signal in FAULTS.into_iter().chain([Signal::SIGKILL, Signal::SIGSTOP]) {
                let running = Running::start(DRIVE);
                running.brick.await_driving();
                kill(running.control(), signal).unwrap();
                await_that("every motor is still", || running.brick.is_still());
                let (brick, said, recorded) = running.finish();
                assert_eq!(said.code, Some(1), "{signal}: {}", said.err);
                let how = if signal == Signal::SIGSTOP {
                    "gave no sign of life".to_owned()
                } else {
                    format!("signal: {}", signal as i32)
                };
                assert!(
                    said.err.contains("the guard stopped the motors") && said.err.contains(&how),
                    "{}",
                    said.err
                );
                assert_eq!(brick.commands(), ["stop"; 3], "{signal}");
                for name in MOTORS {
                    let read = |attribute| brick.read(&format!("tacho-motor/{name}"), attribute);
                    let settings =
                        ["time_sp", "stop_action", "ramp_up_sp", "ramp_down_sp"].map(read);
                    assert_eq!(
                        settings,
                        ["300", "brake", "0", "0"],
                        "{name}: it was under a lease"
                    );
                }
                assert!(recorded.ending.is_none(), "no process was left to end it");
            }
        },
    );
}

#[test]
fn promise_1_when_the_guard_is_killed_control_stops_the_run() {
    patiently("promise_1_when_the_guard_is_killed_control_stops_the_run", || {
        for signal in FAULTS.into_iter().chain([Signal::SIGKILL]) {
            let running = Running::start(DRIVE);
            running.brick.await_driving();
            kill(running.guard(), signal).unwrap();
            await_that("every motor is still", || running.brick.is_still());
            let (brick, said, recorded) = running.finish();
            assert_eq!(said.code, Some(1), "{signal}: {}", said.err);
            let who = "the run's guard ended without a word";
            let how = format!("signal: {}", signal as i32);
            assert!(said.err.contains(who) && said.err.contains(&how), "{signal}: {}", said.err);
            assert!(said.err.contains("its motors were stopped"), "{signal}: {}", said.err);
            assert_eq!(brick.commands(), ["stop"; 3], "{signal}");
            assert_eq!(
                recorded.ending.unwrap().stop.to_string(),
                StopReason::Unguarded.to_string(),
                "{signal}"
            );
        }
    });
}

#[test]
fn promise_1_when_the_guard_hangs_control_stops_the_motors_and_ends_the_run() {
    patiently("promise_1_when_the_guard_hangs_control_stops_the_motors_and_ends_the_run", || {
        let running = Running::start(DRIVE);
        running.brick.await_driving();
        kill(running.guard(), Signal::SIGSTOP).unwrap();
        let hung = Instant::now();
        await_that("every motor is still", || running.brick.is_still());
        let took = hung.elapsed();
        assert!(took < Duration::from_millis(400), "told after {took:?}");
        let (brick, said, recorded) = running.finish();
        assert_eq!(said.code, Some(1), "{}", said.err);
        assert!(
            said.err.contains("the guard gives no sign of life, and is killed"),
            "{}",
            said.err
        );
        assert_eq!(brick.commands(), ["stop"; 3]);
        assert_eq!(recorded.ending.unwrap().stop.to_string(), StopReason::Unguarded.to_string());
    });
}

#[test]
fn promise_1_whoever_asks_a_run_to_stop_whose_guard_and_control_hang_ends_it_by_force() {
    patiently(
        "promise_1_whoever_asks_a_run_to_stop_whose_guard_and_control_hang_ends_it_by_force",
        || {
            let case = |how: &str, code: Option<i32>, ask: &dyn Fn(&Running) -> Option<Child>| {
                let running = Running::start(DRIVE);
                running.brick.await_driving();
                let (control, guard) = (running.control(), running.guard());
                for process in [guard, control] {
                    kill(process, Signal::SIGSTOP).unwrap();
                }
                let asked = Instant::now();
                let helper = ask(&running);
                await_that("every motor is still", || running.brick.is_still());
                let took = asked.elapsed();
                let (brick, said, _) = running.finish();
                assert!(took < Duration::from_millis(1500), "{how}: told after {took:?}");
                assert_eq!(said.code, code, "{how}: {}{}", said.out, said.err);
                assert!(said.err.contains("error: "), "{how}: {}", said.err);
                assert_eq!(brick.commands(), ["stop"; 3], "{how}");
                helper.map(|helper| done(&helper.wait_with_output().unwrap()))
            };
            let signal = |signal| {
                move |running: &Running| {
                    kill(running.starter(), signal).unwrap();
                    None
                }
            };
            case("Ctrl-C", None, &signal(Signal::SIGINT));
            case("SIGTERM", Some(1), &signal(Signal::SIGTERM));
            let halt = |running: &Running| {
                let root = text(running.brick.root().to_owned());
                let mut halt = onbrick_in_time(running.folder.path(), &["halt", "--brick", &root]);
                Some(halt.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap())
            };
            let said = case("halt", Some(1), &halt).expect("halt says something");
            assert_eq!(said.code, Some(0), "{}", said.err);
            assert!(said.out.contains("stopped mission straight"), "{}", said.out);
        },
    );
}

#[test]
fn a_pc_that_runs_neither_guard_nor_control_for_a_while_is_said_to_be_too_busy() {
    patiently(
        "a_pc_that_runs_neither_guard_nor_control_for_a_while_is_said_to_be_too_busy",
        || {
            let running = Running::start(DRIVE);
            running.brick.await_driving();
            let processes = [running.guard(), running.control()];
            for signal in [Signal::SIGSTOP, Signal::SIGCONT] {
                processes.iter().for_each(|process| kill(*process, signal).unwrap());
                std::thread::sleep(Duration::from_millis(400));
            }
            let (brick, said, recorded) = running.finish();
            assert_eq!(said.code, Some(1), "{}", said.err);
            assert!(said.err.contains("the loop stood still"), "{}", said.err);
            let busy = "this machine was too busy: the guard did not get a processor for 0.";
            assert!(
                said.err.contains(busy) && said.err.contains("close other programs"),
                "{}",
                said.err
            );
            assert_eq!(brick.commands(), ["stop"; 3]);
            assert_eq!(recorded.ending.unwrap().stop.to_string(), StopReason::Late.to_string());
        },
    );
}

#[test]
fn promise_10_halt_frees_a_brick_whose_guard_hangs_over_a_dead_control() {
    patiently("promise_10_halt_frees_a_brick_whose_guard_hangs_over_a_dead_control", || {
        let running = Running::start(DRIVE);
        running.brick.await_driving();
        let (control, guard) = (running.control(), running.guard());
        kill(guard, Signal::SIGSTOP).unwrap();
        kill(control, Signal::SIGKILL).unwrap();
        await_that("control is a zombie", || state_of(control) == Some('Z'));
        let root = text(running.brick.root().to_owned());
        let folder = tempfile::tempdir().unwrap();
        run(folder.path(), &["halt", "--brick", &root]).expect(0);
        assert_eq!(
            running.brick.commands(),
            ["stop"; 3],
            "the motors are told whatever the processes do"
        );
        assert_eq!(running.brick.owner(), None, "the lock is free");
        let (brick, said, _) = running.finish();
        assert_eq!(said.code, Some(1), "{}", said.err);
        let again = Running::on(brick, DRIVE);
        again.brick.await_driving();
        kill(again.starter(), Signal::SIGTERM).unwrap();
        assert_eq!(again.finish().1.code, Some(6), "a new run has the hardware");
    });
}

/// A process's state as `/proc` has it.
fn state_of(process: Pid) -> Option<char> {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    stat.rsplit_once(") ")?.1.chars().next()
}

#[test]
fn promise_1_the_guard_brakes_before_a_killed_control_is_reaped() {
    patiently("promise_1_the_guard_brakes_before_a_killed_control_is_reaped", || {
        let running = Running::start(DRIVE);
        running.brick.await_driving();
        let control = running.control();
        // A traced process that has ended is its tracer's to reap before it is its parent's.
        nix::sys::ptrace::seize(control, nix::sys::ptrace::Options::empty()).unwrap();
        kill(control, Signal::SIGKILL).unwrap();
        let killed = Instant::now();
        await_that("every motor is still", || running.brick.is_still());
        let took = killed.elapsed();
        assert_eq!(state_of(control), Some('Z'), "it is not reaped yet");
        nix::sys::wait::waitpid(control, None).unwrap();
        assert!(took < Duration::from_millis(50), "told after {took:?}");
        let (brick, said, _) = running.finish();
        assert!(said.err.contains("the guard stopped the motors"), "{}", said.err);
        assert_eq!(brick.commands(), ["stop"; 3]);
    });
}

/// Kills all of the run's processes at once: starter and guard are stopped first, so that neither
/// sees another one go.
fn kill_all(running: &Running) {
    let (control, guard, starter) = (running.control(), running.guard(), running.starter());
    for process in [starter, guard] {
        kill(process, Signal::SIGSTOP).unwrap();
    }
    for process in [control, guard, starter] {
        kill(process, Signal::SIGKILL).unwrap();
    }
}

#[test]
fn promise_1_motors_that_a_killed_run_left_are_stopped_and_nobody_elses() {
    patiently("promise_1_motors_that_a_killed_run_left_are_stopped_and_nobody_elses", || {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("wheels.toml"), TWO_WHEELS).unwrap();
        let mission = DRIVE.replace(", head_deg = 60", "");
        let running =
            Running::with(TurningBrick::new(), &mission, folder, &["--robot", "wheels.toml"]);
        let root = text(running.brick.root().to_owned());
        let folder = tempfile::tempdir().unwrap();
        let orphaned =
            || run(folder.path(), &["halt", "--orphaned", "--brick", &root]).expect(0).out;
        running.brick.await_driving();
        let said = orphaned();
        assert!(said.contains("mission straight (process ") && said.contains("itself"), "{said}");
        assert_eq!(
            running.brick.read("tacho-motor/motor1", "command"),
            "run-timed",
            "its run continues"
        );
        kill_all(&running);
        let (brick, _, _) = running.finish();
        brick.put("tacho-motor/motor0", "command", b"run-forever\n");
        let said = orphaned();
        assert!(said.contains("outB, outD"), "{said}");
        assert_eq!(brick.commands(), ["run-forever", "stop", "stop"], "another program has outA");
        brick.put("tacho-motor/motor1", "command", b"run-forever\n");
        assert_eq!(orphaned(), "no run has left a motor behind\n");
        assert_eq!(
            brick.commands(),
            ["run-forever", "run-forever", "stop"],
            "another program has outB now"
        );
    });
}

#[test]
fn promise_9_a_foreign_command_is_said_with_the_motor_and_the_program_and_the_way_out() {
    patiently(
        "promise_9_a_foreign_command_is_said_with_the_motor_and_the_program_and_the_way_out",
        || {
            let running = Running::start(DRIVE);
            running.brick.await_driving();
            let motor = running.brick.path("tacho-motor/motor1", "");
            let mut other = std::process::Command::new("sh")
                .args([
                    "-c",
                    "exec 3>\"$0\"/state 4>\"$0\"/speed_sp; echo running >&3; echo 77 >&4; exec \
                     sleep 60",
                ])
                .arg(&motor)
                .spawn()
                .unwrap();
            let (brick, said, _) = running.finish();
            let expected = format!(
                "left wheel: outB (speed_sp), which turns; onbrick halt --brick {} stops it; its \
                 files are open in sleep (process {})",
                brick.root().display(),
                other.id()
            );
            other.kill().unwrap();
            other.wait().unwrap();
            assert_eq!(said.code, Some(1), "{}", said.err);
            assert!(said.err.contains(&expected), "{} is not in\n{}", expected, said.err);
            assert_eq!(brick.commands(), ["stop", "run-timed", "stop"], "another program has outB");
        },
    );
}

#[test]
fn promise_1_when_guard_and_control_are_killed_the_starter_stops_the_motors() {
    patiently("promise_1_when_guard_and_control_are_killed_the_starter_stops_the_motors", || {
        let running = Running::start(DRIVE);
        running.brick.await_driving();
        let (control, guard) = (running.control(), running.guard());
        for (process, signal) in
            [(guard, Signal::SIGSTOP), (control, Signal::SIGKILL), (guard, Signal::SIGKILL)]
        {
            kill(process, signal).unwrap();
        }
        let (brick, said, recorded) = running.finish();
        assert_eq!(said.code, Some(1), "{}", said.err);
        assert!(
            said.err.contains("the run's guard") && said.err.contains("signal: 9"),
            "{}",
            said.err
        );
        assert!(said.err.contains("its motors were stopped"), "{}", said.err);
        assert_eq!(brick.commands(), ["stop"; 3]);
        assert!(recorded.ending.is_none(), "no process was left to end it");
    });
}

#[test]
fn promise_1_when_all_are_killed_the_leases_end_by_themselves() {
    patiently("promise_1_when_all_are_killed_the_leases_end_by_themselves", || {
        let running = Running::start(DRIVE);
        running.brick.await_driving();
        kill_all(&running);
        let (brick, _, recorded) = running.finish();
        for name in MOTORS {
            // What the kernel was told last is a motion that ends, with nothing to roll on with.
            let read = |attribute| brick.read(&format!("tacho-motor/{name}"), attribute);
            assert_eq!(
                ["command", "time_sp", "stop_action"].map(read),
                ["run-timed", "300", "brake"],
                "{name}"
            );
        }
        assert!(recorded.ending.is_none(), "no process was left to end it");
        let root = text(brick.root().to_owned());
        let folder = tempfile::tempdir().unwrap();
        run(folder.path(), &["halt", "--brick", &root]).expect(0);
        assert_eq!(brick.commands(), ["stop"; 3]);
    });
}

/// A heartbeat that fails after a few ticks, as a mistake in the program would.
#[derive(Debug)]
struct Failing(u32);

impl Heartbeat for Failing {
    fn beat(&mut self, _now_ns: i64) {
        self.0 += 1;
        assert!(self.0 < 5, "a mistake, made on purpose");
    }
}

/// Notes each motor's last command at each beat.
#[derive(Debug)]
struct Commanded {
    motors: Vec<PathBuf>,
    at_beat: Vec<Vec<String>>,
}

impl Heartbeat for Commanded {
    fn beat(&mut self, _now_ns: i64) {
        let command = |path: &PathBuf| std::fs::read_to_string(path).unwrap().trim().to_owned();
        self.at_beat.push(self.motors.iter().map(command).collect());
    }
}

/// The guard waits longer for the first beat than for all others, which is no danger only as long
/// as nothing has been commanded.
#[test]
fn promise_1_control_beats_for_its_guard_before_it_commands_a_motor() {
    let brick = TurningBrick::new();
    let folder = tempfile::tempdir().unwrap();
    let source = |name: &str, text: &str| Source { name: name.to_owned(), text: text.to_owned() };
    let job = Job {
        // Behind a guard, which gives no beat here: that ends the run.
        lock: Lock::Inherited,
        ..Job::new(
            source("mission.toml", DRIVE),
            source("robot.toml", DEFAULT_ROBOT),
            Brick::Local(LocalTree::new(brick.root())),
            folder.path().join("run.mcap"),
        )
    };
    let _lock = HardwareLock::take(brick.root(), "a guard's work").unwrap();
    let motors = MOTORS.map(|name| brick.path(&format!("tacho-motor/{name}"), "command"));
    let mut seen = Commanded { motors: motors.to_vec(), at_beat: Vec::new() };
    let environment = Environment::local(&LocalTree::new(brick.root()));
    let ended = execute(&job, environment, &StopFlags::default(), &mut seen, |_| {}).unwrap();
    assert!(!ended.stop.reason.is_wanted() && ended.stopped, "{ended}");
    let [first, second, ..] = &seen.at_beat[..] else { panic!("{:?}", seen.at_beat) };
    assert!(first.iter().all(|command| command == "reset"), "{first:?}");
    assert!(second.iter().any(|command| command == "run-timed"), "{second:?}");
}

#[test]
fn promise_1_a_panic_inside_a_tick_stops_the_motors_and_finishes_the_recording() {
    let brick = TurningBrick::new();
    let folder = tempfile::tempdir().unwrap();
    let source = |name: &str, text: &str| Source { name: name.to_owned(), text: text.to_owned() };
    let job = Job::new(
        source("mission.toml", DRIVE),
        source("robot.toml", DEFAULT_ROBOT),
        Brick::Local(LocalTree::new(brick.root())),
        folder.path().join("run.mcap"),
    );
    let ended = execute(
        &job,
        Environment::local(&LocalTree::new(brick.root())),
        &StopFlags::default(),
        &mut Failing(0),
        |_| {},
    )
    .unwrap();
    assert_eq!(
        (ended.stop.reason.word().as_str(), ended.stop.reason.is_wanted(), ended.stopped),
        ("panicked", false, true),
        "{ended}"
    );
    assert_eq!(brick.commands(), ["stop"; 3]);
    assert_eq!(brick.owner(), None, "the lock is free");
    let recorded = Run::open(&job.file).unwrap();
    assert!(
        recorded.ending.unwrap().stop.to_string().contains("failed") && recorded.senses.len() >= 4
    );
}

#[test]
fn a_signal_before_it_drives_ends_the_run_before_anything_moved() {
    patiently("a_signal_before_it_drives_ends_the_run_before_anything_moved", || {
        let running = Running::start(DRIVE);
        kill(running.control(), Signal::SIGTERM).unwrap();
        let said = done(&running.child.wait_with_output().unwrap());
        assert_eq!(said.code, Some(3), "{}{}", said.out, said.err);
        assert!(said.err.contains("stopped by a signal: before it started"), "{}", said.err);
        assert_eq!(running.brick.commands(), ["reset"; 3]);
        assert_eq!(names(running.folder.path()), ["mission.toml"], "no empty folder stays behind");
    });
}

#[test]
fn promise_10_a_second_run_is_refused_with_the_first_ones_name_and_halt_stops_the_first() {
    patiently(
        "promise_10_a_second_run_is_refused_with_the_first_ones_name_and_halt_stops_the_first",
        || {
            let running = Running::start(DRIVE);
            running.brick.await_driving();
            let root = text(running.brick.root().to_owned());
            let folder = tempfile::tempdir().unwrap();
            let refused = run(folder.path(), &["run", "map", "--brick", &root]).expect(3);
            let owner = format!("mission straight (process {})", running.control());
            let halt = format!("wait until it is over, or onbrick halt --brick {root}\n");
            assert!(refused.err.contains(&owner) && refused.err.contains(&halt), "{}", refused.err);
            assert!(!running.brick.is_still(), "the first one drives on");

            let [halted] = run(folder.path(), &["halt", "--brick", &root, "--json"])
                .expect(0)
                .json()
                .try_into()
                .unwrap();
            assert_eq!(keys(&halted), ["motors", "still", "stopped_run"]);
            assert_eq!(halted["stopped_run"]["doing"], "mission straight");
            assert_eq!(halted["motors"].as_array().unwrap().len(), 3);
            assert_eq!(halted["still"], true);
            let (brick, said, _) = running.finish();
            assert_eq!(
                (said.code, brick.commands()),
                (Some(6), vec!["stop".to_owned(); 3]),
                "{}",
                said.err
            );
        },
    );
}

#[test]
fn a_blocked_wheel_ends_the_run_as_failed() {
    patiently("a_blocked_wheel_ends_the_run_as_failed", || {
        let running = Running::start(&DRIVE.replace("left_dps = 90", "left_dps = 10.5"));
        running.brick.await_driving();
        // From here on the left wheel stands at one place, whatever is commanded.
        let position = running.brick.path("tacho-motor/motor1", "position");
        std::fs::remove_file(&position).unwrap();
        std::fs::create_dir(&position).unwrap();
        let (brick, said, recorded) = running.finish();
        assert_eq!(said.code, Some(1), "{}{}", said.out, said.err);
        assert_eq!(brick.commands(), ["stop"; 3]);
        let reason = recorded.ending.unwrap().stop.to_string();
        assert!(said.err.contains(&reason) && reason.contains("blocked"), "{reason}: {}", said.err);
    });
}

#[test]
fn a_device_that_goes_away_ends_the_run_with_its_name() {
    patiently("a_device_that_goes_away_ends_the_run_with_its_name", || {
        let running = Running::start(DRIVE);
        running.brick.await_driving();
        // A reading that cannot be understood is no reading, and after 0.3 s it is lost.
        running.brick.put("lego-sensor/sensor1", "value0", b"fly\n");
        let (brick, said, recorded) = running.finish();
        assert_eq!(said.code, Some(1), "{}{}", said.out, said.err);
        assert!(said.err.contains("lost: gyro") && said.err.contains("in4"), "{}", said.err);
        assert_eq!(said.err.matches("gyro").count(), 1, "{}", said.err);
        assert_eq!(brick.commands(), ["stop"; 3]);
        assert!(recorded.ending.unwrap().stop.to_string().starts_with("lost: gyro"));
    });
}

#[test]
fn preparing_says_what_a_person_should_do_and_an_unready_robot_is_refused() {
    patiently("preparing_says_what_a_person_should_do_and_an_unready_robot_is_refused", || {
        let refused = |prepare: &dyn Fn(&TurningBrick), expected: &[&str]| {
            let brick = TurningBrick::new();
            prepare(&brick);
            let running = Running::on(brick, DRIVE);
            let said = done(&running.child.wait_with_output().unwrap());
            assert_eq!(said.code, Some(3), "{}{}", said.out, said.err);
            for expected in expected {
                assert!(said.err.contains(expected), "`{expected}` is not in\n{}", said.err);
            }
            assert!(running.brick.is_still(), "{:?}", running.brick.commands());
        };
        std::thread::scope(|scope| {
            scope.spawn(|| {
                refused(
                    &|brick| {
                        brick.put("power_supply/lego-ev3-battery", "voltage_now", b"4900000\n")
                    },
                    &["4.9 V", "charge"],
                );
            });
            scope.spawn(|| {
                let pull = |brick: &TurningBrick| {
                    std::fs::remove_dir_all(brick.path("lego-sensor/sensor1", "")).unwrap()
                };
                let plug_in = "try: plug it in there and wait three seconds, or let onbrick setup";
                refused(&pull, &["gyro", "in4", "lego-ev3-us on in1", plug_in]);
            });
            scope.spawn(|| {
                refused(
                    &|brick| brick.put("tacho-motor/motor2", "address", b"ev3-ports:outC\n"),
                    &["drive.right", "outD", "outC"],
                );
            });
            scope.spawn(|| {
                // Patience is ten seconds: a plug may be put in again meanwhile.
                refused(
                    &|brick| brick.put("lego-sensor/sensor0", "value0", b"fly\n"),
                    &["range sensor", "`fly`"],
                );
            });
        });
    });
}

#[test]
fn devices_shows_what_is_plugged_in_and_what_it_reads() {
    let brick = TurningBrick::new();
    let root = text(brick.root().to_owned());
    let folder = tempfile::tempdir().unwrap();
    let said = run(folder.path(), &["devices", "--brick", &root]).expect(0);
    for expected in ["outA", "outB", "outD", "lego-ev3-l-motor", "in1", "lego-ev3-us", "in4", "7.5"]
    {
        assert!(said.out.contains(expected), "`{expected}` is not in\n{}", said.out);
    }
    let [json] = run(folder.path(), &["devices", "--brick", &root, "--json"])
        .expect(0)
        .json()
        .try_into()
        .unwrap();
    assert_eq!(keys(&json), ["battery", "devices"]);
    assert_eq!(
        keys(&json["devices"][0]),
        ["address", "class", "driver", "name", "problem", "readings"]
    );

    let mut watching = onbrick(folder.path(), &["devices", "--brick", &root, "--watch"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(watching.stdout.take().unwrap()).lines();
    let tables = lines.map(Result::unwrap).filter(|line| line.starts_with("outA")).take(2).count();
    assert_eq!(tables, 2, "it looks again");
    // The reader is gone now, so the watch has no purpose.
    assert_eq!(watching.wait().unwrap().code(), Some(0));
}

#[test]
fn what_is_no_brick_is_said_to_be_none() {
    let folder = tempfile::tempdir().unwrap();
    for command in ["devices", "halt"] {
        let said = run(folder.path(), &[command, "--brick", "."]).expect(1);
        assert!(
            said.err.contains("there is no brick below .") && said.err.contains("--brick"),
            "{}",
            said.err
        );
    }
}

#[test]
fn halt_stops_what_turns_and_says_what_still_does() {
    let brick = TurningBrick::new();
    let folder = tempfile::tempdir().unwrap();
    let root = text(brick.root().to_owned());
    brick.put("tacho-motor/motor1", "speed_sp", b"200\n");
    brick.put("tacho-motor/motor1", "command", b"run-timed\n");
    let said = run(folder.path(), &["halt", "--brick", &root]).expect(0);
    assert_eq!(brick.commands(), ["stop"; 3]);
    for port in ["outA", "outB", "outD"] {
        assert!(said.out.contains(port), "{}", said.out);
    }
    // A motor that does not take the command: its file cannot be written.
    let command = brick.path("tacho-motor/motor0", "command");
    std::fs::remove_file(&command).unwrap();
    std::fs::create_dir(&command).unwrap();
    brick.put("tacho-motor/motor1", "command", b"run-forever\n");
    let said = run(folder.path(), &["halt", "--brick", &root]).expect(1);
    assert!(said.err.contains("outA") && said.err.contains("unplug"), "{}", said.err);
    assert_eq!(
        brick.read("tacho-motor/motor1", "command"),
        "stop",
        "the others were told all the same"
    );
}
