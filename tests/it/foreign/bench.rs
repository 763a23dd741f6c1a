//! A simulator in a process of its own, and a namespace in which a program takes it for the
//! machine's devices.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock, SECOND_NS};
use serde_json::Value;

use crate::mount::bench::no_fuse;
use crate::support::pass_over;
use crate::support::real_time::Pace;
use crate::support::tested_program;

/// No program here takes longer.
const LONGEST_NS: i64 = 90 * SECOND_NS;

/// `onbrick sim` with a brick in a folder of its own.
pub(crate) struct Simulator {
    process: Child,
    folder: tempfile::TempDir,
}

/// Where the robot truly is.
#[derive(Debug, serde::Deserialize)]
pub(crate) struct Truth {
    pub(crate) x_m: f64,
    pub(crate) y_m: f64,
    pub(crate) heading_deg: f64,
    pub(crate) speed_mps: f64,
    pub(crate) travelled_m: f64,
    pub(crate) left_deg: f64,
    pub(crate) right_deg: f64,
    pub(crate) echo_m: Option<f64>,
    pub(crate) touching: bool,
    pub(crate) fallen: bool,
    pub(crate) tone_hz: Option<u32>,
    pub(crate) last_tone_hz: Option<u32>,
    lights: BTreeMap<String, u32>,
}

impl Truth {
    /// The brightness of a status light, `led0:red`.
    pub(crate) fn light(&self, name: &str) -> u32 {
        self.lights[&format!("{name}:brick-status")]
    }
}

/// A foreign program, running in its namespace.
pub(crate) struct Foreign {
    name: String,
    process: Child,
    said: BufReader<ChildStdout>,
}

impl Simulator {
    /// Starts it in a world of `tests/data` or a built-in one.
    pub(crate) fn start(pace: &Pace, world: &str) -> Self {
        Self::start_with(pace, world, &[])
    }

    /// The same, with further arguments.
    pub(crate) fn start_with(pace: &Pace, world: &str, arguments: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let file = format!("{}/tests/data/{world}.toml", env!("CARGO_MANIFEST_DIR"));
        let world = if Path::new(&file).exists() { &file } else { world };
        let mut process = Pace::command(tested_program())
            .arg("sim")
            .arg(folder.path().join("brick"))
            .args(["--world", world])
            .args(arguments)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        pace.watch(&process);
        let mut said = BufReader::new(process.stdout.take().unwrap());
        let mut line = String::new();
        while !line.starts_with("mounted") {
            line.clear();
            assert_ne!(
                said.read_line(&mut line).unwrap(),
                0,
                "the simulator ended before it mounted"
            );
        }
        // The pipe stays open, so that its last words do not kill it before it has unmounted.
        process.stdout = Some(said.into_inner());
        Self { process, folder }
    }

    pub(crate) fn root(&self) -> PathBuf {
        self.folder.path().join("brick")
    }

    /// Has something done to the robot.
    pub(crate) fn order(&self, order: &str) {
        fs::write(self.root().join("sim/orders"), order).unwrap();
    }

    pub(crate) fn truth(&self) -> Truth {
        serde_json::from_str(&fs::read_to_string(self.root().join("sim/truth")).unwrap()).unwrap()
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        // It unmounts on this signal; the folder is taken away after it.
        if let Ok(process) = i32::try_from(self.process.id()) {
            let _ = kill(Pid::from_raw(process), Signal::SIGTERM);
        }
        let _ = self.process.wait();
    }
}

impl Foreign {
    /// Starts a program in a private view of a mounted brick: `onbrick sim exec`.
    pub(crate) fn start(pace: &Pace, name: &str, brick: &Path, command: &[&str]) -> Self {
        let mut process = Pace::command(tested_program())
            .args(["sim", "exec"])
            .arg(brick)
            .arg("--")
            .args(command)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        pace.watch(&process);
        let said = BufReader::new(process.stdout.take().unwrap());
        Self { name: name.to_owned(), process, said }
    }

    /// Asks it to end, as Ctrl-C does; how it ended.
    pub(crate) fn interrupt(mut self) -> std::process::ExitStatus {
        self.ask_to_end();
        self.process.wait().unwrap()
    }

    /// The program that it started ends with it, if it is asked and not killed.
    fn ask_to_end(&self) {
        if let Ok(process) = i32::try_from(self.process.id()) {
            let _ = kill(Pid::from_raw(process), Signal::SIGTERM);
        }
    }

    /// The next line it says.
    pub(crate) fn line(&mut self) -> String {
        let mut line = String::new();
        self.said.read_line(&mut line).unwrap();
        line.trim_end().to_owned()
    }

    /// Waits for its end; what it said, or nothing and a complaint if it does not end well.
    pub(crate) fn end(mut self, pace: &Pace) -> Option<String> {
        let deadline_ns = MonotonicClock.now_ns() + LONGEST_NS;
        let mut status = None;
        while status.is_none() && MonotonicClock.now_ns() < deadline_ns {
            MonotonicClock.sleep_ns(20 * MILLISECOND_NS);
            status = self.process.try_wait().unwrap();
        }
        let Some(status) = status else {
            pace.ensure(false, || format!("{} does not end", self.name));
            return None;
        };
        let mut said = String::new();
        self.said.read_to_string(&mut said).unwrap();
        println!("{}: {said}", self.name);
        pace.ensure(status.success(), || format!("{} failed: {status}", self.name));
        status.success().then_some(said)
    }

    /// Waits for its end; the JSON in its last line.
    pub(crate) fn json(self, pace: &Pace) -> Option<Value> {
        let said = self.end(pace)?;
        Some(serde_json::from_str(said.lines().last().unwrap_or_default()).unwrap())
    }
}

impl Drop for Foreign {
    fn drop(&mut self) {
        // For the test that fails while it runs.
        if matches!(self.process.try_wait(), Ok(None)) {
            self.ask_to_end();
        }
        let _ = self.process.wait();
    }
}

/// A command in a mount namespace of its own: with the rights we have, or as root of a user
/// namespace.
pub(crate) fn unshare() -> Command {
    let mut command = Pace::command("unshare");
    if !nix::unistd::geteuid().is_root() {
        command.args(["--user", "--map-root-user"]);
    }
    command.args(["--mount", "--propagation", "private"]);
    command
}

/// True, and said, where this machine cannot mount, or has no namespaces.
pub(crate) fn no_namespaces() -> bool {
    if no_fuse() {
        return true;
    }
    let can = unshare().args(["mount", "-t", "tmpfs", "tmpfs", "/dev"]).output();
    let can = can.is_ok_and(|output| output.status.success());
    if !can {
        pass_over("mount namespaces: unshare, with root's rights or user namespaces");
    }
    !can
}

/// True, and said, where python or the library is missing.
pub(crate) fn no_python() -> bool {
    let probe = Command::new("python3").args(["-c", "import ev3dev2, evdev, PIL"]).output();
    let can = probe.is_ok_and(|output| output.status.success());
    if !can {
        pass_over("python3 with the packages python-ev3dev2, evdev and pillow");
    }
    !can
}

/// A program of `tests/python`.
pub(crate) fn script(name: &str) -> String {
    format!("{}/tests/python/{name}.py", env!("CARGO_MANIFEST_DIR"))
}

/// An example of this crate, which `cargo test` builds beside its binary.
pub(crate) fn example(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_BIN_EXE_onbrick")).parent()?.join("examples").join(name);
    if !path.exists() {
        pass_over(&format!(
            "the example {name}: cargo test builds it, cargo test --test it does not"
        ));
        return None;
    }
    Some(path)
}
