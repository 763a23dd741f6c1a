//! The service itself: what the transports ask, answered from the state, the store and the
//! hardware.

use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex};

use serde::Serialize;

use super::config::Config;
use super::hardware::{Charge, Hardware};
use super::machine::{Happening, Machine};
use super::settings::{Kept, addresses};
use super::start::{Stop, busy};
use super::store::Store;
use super::token::Tokens;
use super::{NetworkLink, RobotSite, missions};
use crate::behavior::Capabilities;
use crate::clock::{Clock, MonotonicClock, wall_ns, wrong_year};
use crate::protocol::{
    Answer, Caller, Done, LocalOnly, Missions, Name, Operations, Pairing, Refusal, Request,
    RunInfo, Runs, Settings, SettingsChange, Status, Stopped, VERSION,
};
use crate::robot::BatteryConfig;
use crate::runtime::{LockError, NotReady, StopBy, WhenAbandoned};
use crate::threads::lock;

/// Why there is no service.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// Another service keeps the folder of runs: stop it, or use another configuration.
    #[error("{0}")]
    Kept(String),
    /// No threads: the machine is full.
    #[error("cannot start a thread")]
    Threads(#[from] std::io::Error),
}

/// A brick's service. Clones are handles on the same one.
#[derive(Debug, Clone)]
pub struct Service {
    pub(super) inner: Arc<Inner>,
}

#[derive(Debug)]
pub(super) struct Inner {
    pub(super) config: Config,
    pub(super) place: RobotSite,
    pub(super) name: Name,
    /// This program, which is started again for each run.
    pub(super) program: PathBuf,
    pub(super) tokens: Tokens,
    pub(super) store: Store,
    pub(super) hardware: Hardware,
    pub(super) now: Mutex<Now>,
    /// The state has changed.
    pub(super) changed: Condvar,
    /// One start at a time; it is long, because it makes room on the disk.
    pub(super) starting: Mutex<()>,
    /// One change of the settings at a time: each is made of what is there, and written to the same
    /// file.
    setting: Mutex<()>,
    /// The network's link, or why there is none.
    link: Mutex<Result<Arc<dyn NetworkLink>, String>>,
}

/// What changes.
#[derive(Debug)]
pub(super) struct Now {
    pub(super) machine: Machine,
    pub(super) kept: Kept,
    /// What stops the run that is going on.
    pub(super) stop: Option<Stop>,
    /// On whose behalf it was asked to stop first, and what they are called.
    pub(super) stopped_by: Option<(StopBy, String)>,
    /// When it was last asked to stop whatever runs: a start that was asked for before is not done.
    pub(super) stop_ns: Option<i64>,
    /// The mission that is going on switches the lights itself.
    pub(super) missions_lights: bool,
    /// What is wrong with the robot's file.
    pub(super) robot: Option<String>,
    /// What the robot's file says of the battery.
    pub(super) battery: BatteryConfig,
    /// Nothing starts any more: the service is about to end.
    pub(super) closing: bool,
}

impl Service {
    /// Takes the folder of runs, finds a run that an earlier service started, and begins to keep
    /// state, lights and disk.
    ///
    /// - `program`: this program's file (`std::env::current_exe`).
    ///
    /// # Errors
    ///
    /// [`OpenError`]. A disk or a robot that is not in order is none: the state tells.
    pub fn open(config: Config, place: RobotSite, program: PathBuf) -> Result<Self, OpenError> {
        let store = Store::open(&config.runs, config.quota_bytes)
            .map_err(|error| OpenError::Kept(error.to_string()))?;
        let now_ns = MonotonicClock.now_ns();
        let now = Now {
            machine: Machine::new(now_ns),
            kept: Kept::read(&config.runs),
            stop: None,
            stopped_by: None,
            stop_ns: None,
            missions_lights: false,
            robot: None,
            battery: BatteryConfig::default(),
            closing: false,
        };
        let inner = Arc::new(Inner {
            name: config.name.clone().unwrap_or_else(Name::of_this_machine),
            hardware: Hardware::new(place.clone()),
            config,
            place,
            program,
            tokens: Tokens::new(now_ns, wall_ns()),
            store,
            now: Mutex::new(now),
            changed: Condvar::new(),
            starting: Mutex::new(()),
            setting: Mutex::new(()),
            link: Mutex::new(Err(
                "there is no link: this onbrick, or this service, has none".to_owned()
            )),
        });
        let service = Self { inner };
        service.find_runs()?;
        service.keep()?;
        Ok(service)
    }

    /// How it is set up.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.inner.config
    }

    /// The brick's name.
    #[must_use]
    pub fn name(&self) -> &Name {
        &self.inner.name
    }

    /// The network's link is there: from now on it tells its own state.
    pub fn attach_link(&self, link: Arc<dyn NetworkLink>) {
        *lock(&self.inner.link) = Ok(link);
    }

    /// There is no network's link, or not yet: why.
    pub fn no_link(&self, why: &str) {
        *lock(&self.inner.link) = Err(why.to_owned());
    }

    fn status(&self) -> Status {
        let inner = &self.inner;
        let now_ns = MonotonicClock.now_ns();
        let disk = inner.store.disk();
        let link = lock(&inner.link).as_ref().map_or_else(String::clone, |link| link.state());
        let is_idle = lock(&inner.now).machine.run().is_none();
        let taken = is_idle.then(|| inner.hardware.other_owner()).flatten();
        let now = lock(&inner.now);
        let progress = now.machine.run().and_then(|run| run.progress.as_ref());
        let sensed_v = progress.and_then(|progress| progress.battery_v);
        let status = Status {
            brick: inner.name.to_string(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            protocol: VERSION,
            state: now.machine.state(),
            state_s: now.machine.state_s(now_ns),
            run: now.machine.run().cloned(),
            last: now.machine.last().cloned(),
            battery_v: sensed_v,
            simulated: inner.hardware.machine().is_none(),
            battery: None,
            taken: taken.map(|owner| LockError::Taken(owner).to_string()),
            token: inner.tokens.make(now_ns),
            link,
            disk,
            robot: now.robot.clone(),
            clock: clock_finding(),
        };
        let wanted = now.battery;
        drop(now);
        let Some(charge) = inner.hardware.battery(now_ns).filter(|_| sensed_v.is_none()) else {
            return status;
        };
        let Charge { volts, cells, platform } = charge;
        let least_v = wanted.on(cells, platform).limits().slow_v;
        let most_v = platform.most_v;
        let low =
            (volts < least_v).then(|| NotReady::Battery { volts, least_v, most_v }.to_string());
        Status { battery_v: Some(volts), battery: low, ..status }
    }

    fn missions(&self) -> Result<Missions, Refusal> {
        let folder = &self.inner.config.missions;
        // A robot that is not in order is said elsewhere; missions are then checked for themselves.
        let capabilities = missions::robot(&self.inner.config.robot)
            .map_or_else(|_| Capabilities::all(), |(_, robot)| robot.capabilities());
        let missions = missions::list(folder, &capabilities).map_err(|error| {
            Refusal::failed(format!("cannot list the missions in {}: {error}", folder.display()))
        })?;
        Ok(Missions { missions })
    }

    fn runs(&self) -> Runs {
        let mut runs = self.inner.store.list();
        let now = lock(&self.inner.now);
        if let Some(run) = now.machine.run()
            && let Some(progress) = &run.progress
        {
            for info in runs.iter_mut().filter(|info| info.run == run.run) {
                *info = RunInfo {
                    travelled_m: Some(progress.travelled_m),
                    points: Some(progress.points),
                    ..info.clone()
                };
            }
        }
        Runs { runs }
    }

    fn settings(&self) -> Settings {
        let kept = lock(&self.inner.now).kept.clone();
        let link = lock(&self.inner.link).clone();
        Settings {
            brick: self.inner.name.to_string(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            addresses: addresses(&self.inner.config.link.address),
            fingerprint: link.ok().and_then(|link| link.fingerprint()),
            lights: kept.lights,
            sounds: kept.sounds,
            time_limit_s: kept.time_limit_s,
        }
    }

    fn set(&self, change: &SettingsChange) -> Result<Settings, Refusal> {
        let _one_at_a_time = lock(&self.inner.setting);
        let kept = lock(&self.inner.now).kept.changed(change)?;
        kept.write(&self.inner.config.runs).map_err(|error| {
            let folder = self.inner.config.runs.display();
            Refusal::failed(format!("cannot keep the settings in {folder}: {error}"))
        })?;
        lock(&self.inner.now).kept = kept;
        Ok(self.settings())
    }

    fn pairing(&self, ask: impl FnOnce(&dyn NetworkLink) -> Pairing) -> Pairing {
        let link = lock(&self.inner.link).clone();
        link.map_or_else(|why| Pairing::NoLink { why }, |link| ask(&*link))
    }

    fn menu_closed(&self, asker: &str) -> Result<Answer, Refusal> {
        if self.inner.config.when_menu_closes == WhenAbandoned::GoOn {
            return answer(&Stopped { run: None, stopped: true, other: None });
        }
        answer(&self.stop(None, StopBy::MenuClosed, asker)?)
    }

    /// Nothing of ours or of others may drive while a person looks or turns motors by hand.
    pub(super) fn between_runs(&self) -> Result<(), Refusal> {
        lock(&self.inner.now).machine.run().map_or(Ok(()), |run| Err(busy(&run.run)))
    }
}

impl Operations for Service {
    fn shared(&self, request: &Request, caller: &Caller) -> Result<Answer, Refusal> {
        match request {
            Request::Status => answer(&self.status()),
            Request::Missions => answer(&self.missions()?),
            Request::Start(start) => answer(&self.start(start, caller, true)?),
            Request::Stop { run } => {
                let by = match caller {
                    Caller::Key(_) => StopBy::Remote,
                    Caller::Here | Caller::Menu => StopBy::Here,
                };
                answer(&self.stop(run.as_ref(), by, &named(caller))?)
            }
            Request::Runs => answer(&self.runs()),
            Request::Fetch(fetch) => {
                let (fetched, bytes) = self.inner.store.fetch(fetch)?;
                Ok(Answer { bytes: Some(bytes), ..answer(&fetched)? })
            }
            Request::Identify => answer(&self.identify()),
            Request::Live => {
                self.between_runs()?;
                let robot = missions::robot(&self.inner.config.robot).ok();
                let robot = robot.as_ref().map(|(_, robot)| robot);
                answer(&self.inner.hardware.live(robot, MonotonicClock.now_ns())?)
            }
        }
    }

    fn own(&self, request: &LocalOnly, caller: &Caller) -> Result<Answer, Refusal> {
        let now_ns = MonotonicClock.now_ns();
        match request {
            LocalOnly::Jog { port, percent } => {
                // A start waits until this turn of the motor is on its way, and then takes it back.
                let _no_start = lock(&self.inner.starting);
                self.between_runs()?;
                self.inner.hardware.jog(port, *percent, now_ns)?;
                answer(&Done {})
            }
            LocalOnly::Delete { run } => {
                self.inner.store.delete(run)?;
                answer(&Done {})
            }
            LocalOnly::StartHere(start) => answer(&self.start(start, caller, false)?),
            LocalOnly::MenuHere | LocalOnly::StarterHere { .. } => answer(&Done {}),
            LocalOnly::MenuClosed => self.menu_closed(&named(caller)),
            LocalOnly::Acknowledge => {
                self.inner.happen(Happening::Acknowledged);
                answer(&Done {})
            }
            LocalOnly::PairingWindow { seconds } => {
                answer(&self.pairing(|link| link.open_pairing(*seconds)))
            }
            LocalOnly::PairingState => answer(&self.pairing(|link| link.pairing())),
            LocalOnly::PairingAnswer { same } => {
                answer(&self.pairing(|link| link.answer_pairing(*same)))
            }
            LocalOnly::Settings => answer(&self.settings()),
            LocalOnly::SetSettings(change) => answer(&self.set(change)?),
        }
    }
}

impl Inner {
    /// Something happens now.
    pub(super) fn happen(&self, happening: Happening) {
        lock(&self.now).machine.happen(MonotonicClock.now_ns(), happening);
        self.changed.notify_all();
    }
}

/// A wall clock that stands wrong: what it says, and what to do.
pub(super) fn clock_finding() -> Option<String> {
    wrong_year(wall_ns()).map(|(found, way_out)| format!("{found}; {way_out}"))
}

/// What a caller is called.
pub(super) fn named(caller: &Caller) -> String {
    match caller {
        Caller::Key(name) => name.clone(),
        Caller::Here => "here".to_owned(),
        Caller::Menu => "menu".to_owned(),
    }
}

fn answer(value: &impl Serialize) -> Result<Answer, Refusal> {
    let value = serde_json::to_value(value).map_err(|error| Refusal::failed(error.to_string()))?;
    Ok(Answer { value, bytes: None })
}
