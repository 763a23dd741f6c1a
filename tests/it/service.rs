//! The service as its users use it: the real `onbrick serve`, asked at its socket, killed,
//! restarted, with a full disk.
#![cfg(feature = "sim")]

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::RwLockReadGuard;
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use onbrick::protocol::{
    Chosen, Fetch, Kind, LocalOnly, Refusal, Request, RunId, RunInfo, Runs, Start, Started, State,
    Status, Stopped,
};
use onbrick::runtime::StopReason;
use onbrick::service::client::{Client, ClientError};
use serde::de::DeserializeOwned;

use crate::support::real_time::beside_others;
use crate::support::tested_program;
use crate::support::turning_brick::await_that;

mod brick;
mod death;
mod disk;
mod door;
mod place;
mod runs;

/// A mission that drives slowly on for a minute.
pub const STRAIGHT: &str = r#"
name = "straight"
time_limit_s = 60
[machine.drive]
start = "on"
final = "off"
[machine.drive.state.on]
do = { left_dps = 30, right_dps = 30 }
next = [{ when = "time_s > 50", go = "off" }]
[machine.drive.state.off]
"#;

/// The same, for a second and a half.
pub fn short() -> String {
    STRAIGHT.replace("straight", "short").replace("time_s > 50", "time_s > 1.5")
}

const PATIENCE: Duration = Duration::from_secs(20);

/// A service in a folder of its own; it is killed when this is dropped.
pub struct Served {
    pub folder: tempfile::TempDir,
    pub child: Child,
    pub client: Client,
    arguments: Vec<String>,
    /// Its runs need their share of the machine in time.
    machine: Option<RwLockReadGuard<'static, ()>>,
}

impl Served {
    /// On a simulated brick, with two missions and this in its `onbrick.toml`.
    pub fn simulated(config: &str) -> Self {
        Self::with(&["--sim", "arena"], config)
    }

    /// With these arguments besides.
    pub fn with(arguments: &[&str], config: &str) -> Self {
        let machine = beside_others();
        let folder = folder(config);
        let mut served = Self::started(folder, arguments, |command| command);
        served.machine = Some(machine);
        served
    }

    /// In a folder that is there, started by whatever `wrap` makes of the command.
    pub fn started(
        folder: tempfile::TempDir,
        arguments: &[&str],
        wrap: impl Fn(Command) -> Command,
    ) -> Self {
        let arguments: Vec<String> =
            arguments.iter().map(|&argument| argument.to_owned()).collect();
        let child = serve(folder.path(), &arguments, wrap);
        let client = Client::at(folder.path().join("socket"));
        Self { folder, child, client, arguments, machine: None }
    }

    /// Killed without a word, and restarted.
    pub fn killed_and_started_anew(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
        self.child = serve(self.folder.path(), &self.arguments, |command| command);
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    #[track_caller]
    pub fn ask<T: DeserializeOwned>(&mut self, request: &Request) -> T {
        self.client.ask(request, PATIENCE).unwrap()
    }

    #[track_caller]
    pub fn own<T: DeserializeOwned>(&mut self, request: &LocalOnly) -> T {
        self.client.ask(request, PATIENCE).unwrap()
    }

    #[track_caller]
    pub fn refused(&mut self, request: &Request) -> Refusal {
        refusal(self.client.ask::<serde_json::Value>(request, PATIENCE))
    }

    #[track_caller]
    pub fn own_refused(&mut self, request: &LocalOnly) -> Refusal {
        refusal(self.client.ask::<serde_json::Value>(request, PATIENCE))
    }

    #[track_caller]
    pub fn status(&mut self) -> Status {
        self.ask(&Request::Status)
    }

    #[track_caller]
    pub fn runs(&mut self) -> Vec<RunInfo> {
        self.ask::<Runs>(&Request::Runs).runs
    }

    /// Starts a mission of the folder as a client on the network would.
    #[track_caller]
    pub fn start(&mut self, run: &str, mission: &str) -> Started {
        let token = self.status().token;
        self.ask(&Request::Start(Start { token: Some(token), ..start(run, mission) }))
    }

    #[track_caller]
    pub fn stop(&mut self) -> Stopped {
        self.ask(&Request::Stop { run: None })
    }

    /// Waits until the state is this one.
    #[track_caller]
    pub fn await_state(&mut self, state: State) -> Status {
        let mut status = None;
        await_that(&format!("the state is {state:?}"), || {
            let now = self.status();
            let is = now.state == state;
            assert!(is || now.state != State::Fault, "{now:?}");
            status = Some(now);
            is
        });
        status.unwrap()
    }

    /// Starts a mission and waits until the robot drives; its identifier. A machine under load may
    /// make a run late, which then ends: these tests do not judge that, and start another.
    #[track_caller]
    pub fn drive(&mut self, mission: &str) -> RunId {
        for attempt in 1..=5 {
            let name = format!("r{attempt}");
            self.start(&name, mission);
            let mut status = self.status();
            await_that("it drives or has ended", || {
                status = self.status();
                matches!(status.state, State::Running | State::Stopped | State::Fault)
            });
            if status.state == State::Running {
                return id(&name);
            }
            assert_eq!(
                status.last.as_ref().map(|last| last.stop.reason),
                Some(StopReason::Late),
                "{status:?}"
            );
        }
        panic!("five runs were late");
    }

    /// All of a run's recording, and the hash that comes with its end.
    #[track_caller]
    pub fn fetch_all(&mut self, run: &RunId) -> (Vec<u8>, String) {
        let mut all = Vec::new();
        let mut hash = None;
        await_that("the whole is fetched", || {
            let fetch = Fetch::part(run, all.len() as u64, u32::MAX);
            let (fetched, bytes) = self.client.fetch(&fetch, PATIENCE).unwrap();
            assert_eq!(fetched.offset, all.len() as u64);
            all.extend(bytes);
            hash = fetched.sha256;
            hash.is_some()
        });
        let hash = hash.unwrap();
        let whole = Fetch { sha256: Some(hash.clone()), ..Fetch::part(run, all.len() as u64, 0) };
        self.client.fetch(&whole, PATIENCE).unwrap();
        (all, hash)
    }

    pub fn pid(&self) -> Pid {
        Pid::from_raw(i32::try_from(self.child.id()).unwrap())
    }

    /// Asks it to end; its exit code.
    pub fn end(&mut self) -> Option<i32> {
        kill(self.pid(), Signal::SIGTERM).unwrap();
        self.child.wait().unwrap().code()
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        // Others may have the machine only now.
        drop(self.machine.take());
    }
}

/// A folder of configuration with two missions and one that is broken.
pub fn folder(config: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("missions")).unwrap();
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    put("missions/straight.toml", STRAIGHT);
    put("missions/short.toml", &short());
    put("missions/broken.toml", "name = \"broken\"\n");
    // Services of other tests are there at the same time, and each has a link.
    let [port, pairing_port] = free_ports();
    put(
        "onbrick.toml",
        &format!(
            "{config}\n[link]\naddress = \"127.0.0.1\"\nport = {port}\n\
             pairing_port = {pairing_port}\n"
        ),
    );
    folder
}

fn free_ports() -> [u16; 2] {
    let ports = [(), ()].map(|()| std::net::TcpListener::bind("127.0.0.1:0").unwrap());
    ports.map(|port| port.local_addr().unwrap().port())
}

/// Starts the service and waits for its first line.
fn serve(folder: &Path, arguments: &[String], wrap: impl Fn(Command) -> Command) -> Child {
    let mut command = Command::new(tested_program());
    command.arg("serve").args(arguments).arg("--config").arg(folder).env_remove("RUST_LOG");
    let log = std::fs::File::options().create(true).append(true).open(folder.join("log")).unwrap();
    let mut child =
        wrap(command).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(log).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let log = || std::fs::read_to_string(folder.join("log")).unwrap();
    assert!(line.starts_with("serving "), "it said `{line}` and {}", log());
    child
}

pub fn id(name: &str) -> RunId {
    RunId::new(name).unwrap()
}

pub fn start(run: &str, mission: &str) -> Start {
    Start {
        run: id(run),
        mission: Chosen::Name(mission.to_owned()),
        token: None,
        pose: None,
        set: Vec::new(),
        no_button: false,
    }
}

#[track_caller]
fn refusal(answer: Result<serde_json::Value, ClientError>) -> Refusal {
    match answer {
        Err(ClientError::Refused(refusal)) => refusal,
        other => panic!("no refusal: {other:?}"),
    }
}

#[track_caller]
pub fn refused_as(refusal: &Refusal, kind: Kind, part: &str) {
    assert!(
        refusal.kind == kind && refusal.message.contains(part),
        "{kind:?} `{part}`: {refusal:?}"
    );
}
