//! A service that says what a test wants it to say, and notes what it was asked to do.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, OnceLock};

use onbrick::clock::{MILLISECOND_NS, SECOND_NS, seconds};
use onbrick::mapping::{Pose, Range};
use onbrick::protocol::{
    Answer, Caller, Chosen, Disk, Done, Fetch, Fetched, Kind, LastStop, Live, LiveDevice,
    LocalOnly, MissionInfo, Missions, Operations, Pairing, Refusal, Request, RunId, RunInfo,
    RunStatus, Runs, Settings, Start, Started, State, Status, Stopped,
};
use onbrick::recording;
use onbrick::runtime::StopReason;
use serde::Serialize;

use crate::missions::play_in;

/// How long a jog turns the motor unless it is renewed.
const LEASE_NS: i64 = 300 * MILLISECOND_NS;

/// A recording of the mapping mission: a real one.
pub fn recorded() -> &'static [u8] {
    static RECORDED: OnceLock<Vec<u8>> = OnceLock::new();
    RECORDED.get_or_init(|| play_in("map", "arena", 1).bytes)
}

/// What the service knows. Tests set it as they like.
#[derive(Debug)]
pub struct World {
    now_ns: i64,
    pub gone: bool,
    pub status: Status,
    since_ns: i64,
    /// Goes from preparing to running by itself, and counts.
    pub runs_by_itself: bool,
    pub missions: Missions,
    pub runs: Runs,
    pub live: Live,
    pub settings: Settings,
    pub pairing: Pairing,
    /// How many bytes of the recording there are by now.
    pub recorded: usize,
    /// Every operation that changes something.
    pub done: Vec<String>,
    /// The next order is refused with this.
    pub refuses: Option<Refusal>,
    /// Motors that turn, and until when.
    pub turning: BTreeMap<String, i64>,
}

#[derive(Debug)]
pub struct Scripted(Mutex<World>);

fn reading(port: &str, driver: &str, reading: &str, role: Option<&str>) -> LiveDevice {
    LiveDevice {
        port: port.to_owned(),
        driver: driver.to_owned(),
        role: role.map(str::to_owned),
        reading: reading.to_owned(),
        motor: driver.ends_with("motor"),
    }
}

pub fn mission(name: &str, findings: Option<&str>) -> MissionInfo {
    MissionInfo {
        name: name.to_owned(),
        sha256: "0".repeat(64),
        time_limit_s: findings.is_none().then_some(120.0),
        findings: findings.map(str::to_owned),
    }
}

pub fn last(reason: StopReason) -> LastStop {
    LastStop::new(RunId::new("r-12").ok(), "map", reason.into())
}

pub fn run_info(number: u64, mission: &str, end: Option<LastStop>) -> RunInfo {
    RunInfo {
        run: RunId::new(&format!("r-{number}")).unwrap(),
        mission: mission.to_owned(),
        number,
        bytes: 3_200_000,
        going_on: false,
        fetched: false,
        end,
        travelled_m: Some(3.4),
        points: Some(512),
    }
}

impl Default for Scripted {
    fn default() -> Self {
        let status = Status {
            brick: "mapper".to_owned(),
            version: "0.1.0".to_owned(),
            protocol: 1,
            state: State::Ready,
            state_s: 0.0,
            run: None,
            last: None,
            battery_v: Some(7.9),
            simulated: false,
            token: String::new(),
            link: "ready".to_owned(),
            disk: Disk { used: 12 << 20, quota: 512 << 20, free: 4 << 30 },
            battery: None,
            taken: None,
            robot: None,
            clock: None,
        };
        let broken = "wall.toml:14:12: there is no signal `rang_m`; did you mean `range_m`?\n\
                      wall.toml:21:1: the state `turn_back` can never be reached\n\
                      wall.toml:30:14: two machines drive `left_dps`: `drive` and `head`";
        Self(Mutex::new(World {
            now_ns: 0,
            gone: false,
            status,
            since_ns: 0,
            runs_by_itself: true,
            missions: Missions {
                missions: vec![
                    mission("bump", None),
                    mission("map", None),
                    mission("wall", Some(broken)),
                ],
            },
            runs: Runs {
                runs: vec![
                    run_info(12, "map", Some(last(StopReason::Finished))),
                    run_info(11, "bump", Some(last(StopReason::Button))),
                    run_info(9, "map", None),
                ],
            },
            live: Live {
                devices: vec![
                    reading("in1", "lego-ev3-us", "82.4 cm", Some("range")),
                    reading("in4", "lego-ev3-gyro", "-3 deg", Some("gyro")),
                    reading("outA", "lego-ev3-m-motor", "0°", Some("head")),
                    reading("outB", "lego-ev3-l-motor", "120°", Some("left wheel")),
                    reading("outD", "lego-ev3-l-motor", "118°", Some("right wheel")),
                ],
            },
            settings: Settings {
                brick: "mapper".to_owned(),
                version: "0.1.0".to_owned(),
                addresses: vec!["192.168.1.17".to_owned()],
                fingerprint: Some("k7Qe-93Xa-Lm2P-0vTz".to_owned()),
                lights: true,
                sounds: false,
                time_limit_s: None,
            },
            pairing: Pairing::Closed,
            recorded: usize::MAX,
            done: Vec::new(),
            refuses: None,
            turning: BTreeMap::new(),
        }))
    }
}

impl Scripted {
    pub fn world(&self) -> MutexGuard<'_, World> {
        self.0.lock().unwrap()
    }

    pub fn is_gone(&self) -> bool {
        self.world().gone
    }

    /// Sets the time: a run comes from one state to the next, a lease ends.
    pub fn at(&self, now_ns: i64) {
        let mut world = self.world();
        world.now_ns = now_ns;
        world.turning.retain(|_, until_ns| *until_ns > now_ns);
        let age_s = seconds(now_ns - world.since_ns);
        match world.status.state {
            State::Preparing if world.runs_by_itself && age_s > 0.5 => world.enter(State::Running),
            State::Running if world.runs_by_itself => {
                let progress = progress(age_s);
                if let Some(run) = &mut world.status.run {
                    run.progress = Some(progress);
                }
            }
            State::Stopping if world.runs_by_itself && age_s > 0.3 => {
                world.enter(State::Stopped);
                world.status.run = None;
            }
            _ => {}
        }
    }

    /// What was done since the last time.
    pub fn done(&self) -> Vec<String> {
        std::mem::take(&mut self.world().done)
    }

    /// A person presses a button on the brick: the run's own process stops.
    pub fn hand_stop(&self) {
        let mut world = self.world();
        world.status.last = Some(last(StopReason::Button));
        world.enter(State::Stopping);
    }
}

/// How the mapping mission is going after some seconds.
pub fn progress(elapsed_s: f64) -> recording::Status {
    let elapsed_ns = onbrick::clock::nanoseconds(elapsed_s);
    recording::Status {
        tick: u64::try_from(elapsed_ns / (20 * MILLISECOND_NS)).unwrap(),
        time_ns: elapsed_ns,
        elapsed_ns,
        pose: Pose { x_m: 0.4, y_m: -0.1, heading_rad: -0.65 },
        travelled_m: 0.1 * elapsed_s,
        range: Some(Range::Echo(0.82)),
        points: u64::try_from(elapsed_ns / SECOND_NS * 9).unwrap(),
        states: vec![
            ("drive".to_owned(), "forward".to_owned()),
            ("head".to_owned(), "sweep_left".to_owned()),
        ],
        said: Vec::new(),
        variables: Vec::new(),
        battery_v: Some(7.8),
        overruns: 0,
        latest_ns: 0,
        warning: None,
        dropped: 0,
    }
}

impl World {
    pub fn enter(&mut self, state: State) {
        self.status.state = state;
        self.since_ns = self.now_ns;
    }

    /// A run that is under way.
    pub fn begin(&mut self, name: &str, by: &str) {
        self.status.run = Some(RunStatus {
            run: RunId::new("r-13").unwrap(),
            mission: name.to_owned(),
            time_limit_s: 120.0,
            by: by.to_owned(),
            waits: Some("hold the robot still: the gyro drifts".to_owned()),
            progress: None,
        });
        self.enter(State::Preparing);
    }

    fn start(&mut self, start: &Start) -> Result<Answer, Refusal> {
        if self.status.run.is_some() {
            return Err(Refusal::new(Kind::Busy, "a mission runs already: map"));
        }
        let Chosen::Name(name) = &start.mission else { panic!("the menu starts by name") };
        self.done.push(format!("start {name}"));
        self.begin(name, "menu");
        answer(&Started { run: start.run.clone(), repeated: false, limited_s: None })
    }

    fn stop(&mut self, reason: StopReason) -> Result<Answer, Refusal> {
        self.done.push(format!("stop ({})", reason.word()));
        if matches!(self.status.state, State::Preparing | State::Running) {
            self.status.last = Some(last(reason));
            self.enter(State::Stopping);
        }
        answer(&Stopped { run: None, stopped: true, other: None })
    }

    fn fetch(&self, fetch: &Fetch) -> Result<Answer, Refusal> {
        let all = recorded();
        let total = self.recorded.min(all.len());
        let offset = usize::try_from(fetch.offset).unwrap();
        let end = (offset + usize::try_from(fetch.length).unwrap()).min(total);
        let Some(bytes) = all.get(offset..end) else {
            return Err(Refusal::new(Kind::BeyondEnd, "there are fewer bytes"));
        };
        let fetched = Fetched {
            run: fetch.run.clone(),
            offset: fetch.offset,
            length: u32::try_from(bytes.len()).unwrap(),
            total: total as u64,
            complete: total == all.len(),
            sha256: None,
        };
        Ok(Answer { bytes: Some(bytes.to_vec()), ..answer(&fetched)? })
    }

    fn refused(&mut self) -> Result<(), Refusal> {
        self.refuses.take().map_or(Ok(()), Err)
    }
}

fn answer(value: &impl Serialize) -> Result<Answer, Refusal> {
    Ok(Answer { value: serde_json::to_value(value).unwrap(), bytes: None })
}

impl Operations for Scripted {
    fn shared(&self, request: &Request, _caller: &Caller) -> Result<Answer, Refusal> {
        let mut world = self.world();
        match request {
            Request::Status => {
                world.status.token = format!("t-{}", world.now_ns);
                world.status.state_s = seconds(world.now_ns - world.since_ns);
                answer(&world.status)
            }
            Request::Missions => answer(&world.missions),
            Request::Runs => answer(&world.runs),
            Request::Live => answer(&world.live),
            Request::Stop { .. } => world.stop(StopReason::Remote),
            Request::Fetch(fetch) => world.fetch(fetch),
            Request::Start(_) | Request::Identify => {
                panic!("the menu does not ask for this: {request:?}")
            }
        }
    }

    fn own(&self, request: &LocalOnly, _caller: &Caller) -> Result<Answer, Refusal> {
        let mut world = self.world();
        match request {
            LocalOnly::Settings => return answer(&world.settings),
            LocalOnly::PairingState => return answer(&world.pairing),
            LocalOnly::MenuHere => return answer(&Done {}),
            _ => world.refused()?,
        }
        match request {
            LocalOnly::StartHere(start) => return world.start(start),
            LocalOnly::Jog { port, percent } => {
                let until_ns = world.now_ns + LEASE_NS;
                if *percent == 0 {
                    world.turning.remove(port);
                } else {
                    world.turning.insert(port.clone(), until_ns);
                }
                world.done.push(format!("jog {port} {percent}"));
            }
            LocalOnly::Delete { run } => {
                world.runs.runs.retain(|known| known.run != *run);
                world.done.push(format!("delete {run}"));
            }
            LocalOnly::Acknowledge => {
                world.done.push("acknowledge".to_owned());
                if world.status.state == State::Fault {
                    world.enter(State::Ready);
                }
            }
            LocalOnly::SetSettings(change) => {
                world.done.push(format!("set {}", serde_json::to_value(change).unwrap()));
                world.settings.lights = change.lights.unwrap_or(world.settings.lights);
                world.settings.sounds = change.sounds.unwrap_or(world.settings.sounds);
                if let Some(limit_s) = change.time_limit_s {
                    world.settings.time_limit_s = Some(limit_s).filter(|limit_s| *limit_s > 0.0);
                }
                return answer(&world.settings);
            }
            LocalOnly::PairingWindow { seconds } => {
                world.done.push(format!("pairing window {seconds} s"));
                world.pairing = if *seconds > 0 {
                    Pairing::Open { seconds: *seconds }
                } else {
                    Pairing::Closed
                };
                return answer(&world.pairing);
            }
            LocalOnly::PairingAnswer { same } => {
                world.done.push(format!("the codes are the same: {same}"));
                world.pairing = if *same {
                    Pairing::Paired { name: "annas-laptop".to_owned() }
                } else {
                    Pairing::Failed { why: "the codes are not the same".to_owned() }
                };
                return answer(&world.pairing);
            }
            other => panic!("the menu does not ask for this: {other:?}"),
        }
        answer(&Done {})
    }
}
