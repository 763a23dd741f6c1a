//! One brick of a class: a thread that asks it how it is, and does what the page wants of it.
//!
//! A brick that does not answer holds up its own thread and no other, and each request has an end.
//! A stop is done before all else that waits, and breaks off what is under way: on the brick it has
//! a thread of its own, so that it overtakes what hangs there as well.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::bring::{Bringing, Brought};
use crate::cli::Failure;
use crate::cli::pc::remote::failure;
use crate::cli::pc::start::limit;
use crate::clock::{Clock as _, MILLISECOND_NS, MonotonicClock, nanoseconds};
use crate::link::client::new_run_id;
use crate::link::{Client, ClientError, KeyPair, KnownBrick, Patience};
use crate::protocol::{Chosen, LiveDevice, RunId, RunInfo, State, Status, Stopped};
use crate::report::live::{Board, Wish};
use crate::threads::{lock, spawn};

/// How often a brick is asked how it is, nanoseconds: as a rule, and until it stands still that was
/// told to stop.
const LOOK_NS: i64 = 500 * MILLISECOND_NS;
const CLOSE_LOOK_NS: i64 = 100 * MILLISECOND_NS;

/// How long the question how it is may take, seconds: with a connection, and without.
const LOOK_S: (f64, f64) = (4.0, 2.0);

/// How long a brick may take over what a person wants of it, seconds.
const ORDER_S: f64 = 10.0;

/// A brick that is away when it is to stop is told so when it is back within this time, seconds.
const STOP_S: f64 = 60.0;

/// What a person wants of a brick.
#[derive(Debug)]
pub(super) enum Order {
    Start(Start),
    Identify,
    Fetch(RunId),
    /// Look what else there is.
    Wake,
}

/// A mission that is to be started.
#[derive(Debug, Clone)]
pub(super) struct Start {
    /// What it is called.
    pub(super) name: String,
    pub(super) text: String,
    pub(super) pose: Option<[f64; 3]>,
}

/// A stop on its way: when it was asked for, when the motors had been told, when the run was over.
#[derive(Debug, Clone, Default)]
pub(super) struct Stopping {
    pub(super) asked_ns: i64,
    pub(super) told_ns: Option<i64>,
    pub(super) still_ns: Option<i64>,
    /// Why it was not told.
    pub(super) failed: Option<String>,
}

/// What the page wants to show of a brick besides, and did not have asked yet.
#[derive(Debug, Default)]
pub(super) struct Wanted {
    pub(super) runs: AtomicBool,
    /// What its ports read.
    pub(super) ports: AtomicBool,
}

/// What came of the last thing that a person wanted of a brick.
#[derive(Debug, Clone)]
pub(super) struct Said {
    pub(super) text: String,
    pub(super) is_good: bool,
}

impl Said {
    fn not_done() -> Self {
        Self { text: "not done: a stop came first".to_owned(), is_good: false }
    }
}

/// What is known of a brick by now.
#[derive(Debug, Default)]
pub(super) struct Seen {
    pub(super) status: Option<Status>,
    /// Since when it does not answer.
    pub(super) silent_ns: Option<i64>,
    /// Why, and the way out.
    pub(super) trouble: Option<String>,
    pub(super) stopping: Option<Stopping>,
    pub(super) said: Option<Said>,
    pub(super) runs: Option<Vec<RunInfo>>,
    /// What is plugged in and what it reads; not while it drives.
    pub(super) ports: Option<Vec<LiveDevice>>,
    /// The run that was started from this page last.
    pub(super) started: Option<RunId>,
    /// The run that is shown and brought home as it grows.
    pub(super) shown: Option<RunId>,
    pub(super) brought: Brought,
}

/// A brick of the class. Threads share it.
#[derive(Debug)]
pub(super) struct Brick {
    pub(super) known: KnownBrick,
    own: KeyPair,
    /// Where its recordings come to lie.
    pub(super) folder: PathBuf,
    /// The page has ended, or the brick is no longer on it.
    pub(super) over: Arc<AtomicBool>,
    /// A stop is wanted.
    halt: Arc<AtomicBool>,
    orders: Sender<Order>,
    pub(super) wanted: Wanted,
    pub(super) seen: Mutex<Seen>,
    pub(super) board: Board,
}

impl Brick {
    /// A brick with its thread. `folder` is that of the class.
    pub(super) fn start(known: &KnownBrick, own: &KeyPair, folder: &Path) -> Arc<Self> {
        let (orders, ordered) = channel();
        let board = Board::default();
        board.grants(&[Wish::Stop]);
        let name = crate::protocol::Name::nearest(&known.name);
        let brick = Arc::new(Self {
            known: known.clone(),
            own: own.clone(),
            folder: folder.join("runs").join(name.as_str()),
            over: Arc::default(),
            halt: Arc::default(),
            orders,
            wanted: Wanted::default(),
            seen: Mutex::new(Seen { silent_ns: Some(MonotonicClock.now_ns()), ..Seen::default() }),
            board,
        });
        let worker = Arc::clone(&brick);
        if let Err(error) = spawn("brick", move || worker.work(&ordered)) {
            lock(&brick.seen).trouble = Some(format!("no thread for it: {error}"));
        }
        brick
    }

    /// Has the brick's thread do something, one after the other.
    pub(super) fn order(&self, order: Order) {
        // A thread that has ended has said so.
        let _ = self.orders.send(order);
    }

    /// Has it stop, before all else.
    pub(super) fn stop(&self) {
        let asked_ns = MonotonicClock.now_ns();
        if !self.halt.swap(true, Ordering::Relaxed) {
            let mut seen = lock(&self.seen);
            (seen.stopping, seen.said) = (Some(Stopping { asked_ns, ..Stopping::default() }), None);
        }
        self.order(Order::Wake);
    }

    /// A client for it.
    pub(super) fn client(&self) -> Result<Client, ClientError> {
        Client::new(&self.known.address, self.known.key, &self.own)
    }

    /// As a person reads it, with the way out; the card has the name already.
    pub(super) fn told(&self, error: &ClientError) -> String {
        let Failure { message, hint, .. } = failure(&self.known, error);
        let message = message.trim_end();
        match hint.filter(|_| !matches!(error, ClientError::NoAnswer { .. })) {
            Some(hint) => format!("{message}\n{hint}"),
            None => message.to_owned(),
        }
    }

    fn work(self: &Arc<Self>, orders: &Receiver<Order>) {
        let mut client = match self.client() {
            Ok(client) => client,
            Err(error) => {
                lock(&self.seen).trouble = Some(self.told(&error));
                return;
            }
        };
        let mut next_ns = 0_i64;
        while !self.over.load(Ordering::Relaxed) {
            if self.halt.load(Ordering::Relaxed) {
                self.halt_now(&mut client);
                // What was wanted before the stop is not done after it.
                let dropped = orders.try_iter().filter(|order| matches!(order, Order::Start(_)));
                if dropped.count() > 0 {
                    lock(&self.seen).said = Some(Said::not_done());
                }
                next_ns = 0;
            }
            let left_ms = next_ns.saturating_sub(MonotonicClock.now_ns()).max(0) / MILLISECOND_NS;
            let left = Duration::from_millis(left_ms.unsigned_abs());
            match orders.recv_timeout(left) {
                Ok(order) => self.obey(&mut client, order),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            // A question that is broken off would take the stop's connection with it.
            if !self.halt.load(Ordering::Relaxed) {
                next_ns = MonotonicClock.now_ns().saturating_add(self.look(&mut client));
            }
        }
    }

    /// Asks how it is, and what the page wants to show; returns when to ask again.
    fn look(self: &Arc<Self>, client: &mut Client) -> i64 {
        let (there_s, absent_s) = LOOK_S;
        let patience = Patience::new(there_s).if_absent(absent_s);
        client.set_patience(patience.unless(Arc::clone(&self.halt)).quietly());
        let asked_ns = MonotonicClock.now_ns();
        match client.status() {
            Ok(status) => {
                let pace_ns = self.heard(status);
                self.ask_wanted(client);
                pace_ns
            }
            Err(ClientError::Interrupted) => LOOK_NS,
            Err(error) => {
                self.silent(asked_ns, &error);
                LOOK_NS
            }
        }
    }

    /// It has not answered what it was asked then.
    fn silent(&self, asked_ns: i64, error: &ClientError) {
        let trouble = match error {
            // The card says for how long.
            ClientError::NoAnswer { silence, .. } => silence.to_string(),
            error => self.told(error),
        };
        let mut seen = lock(&self.seen);
        seen.silent_ns.get_or_insert(asked_ns);
        seen.trouble = Some(trouble);
    }

    /// Asks what the page wants to show of a brick that answers.
    fn ask_wanted(&self, client: &mut Client) {
        if self.wanted.runs.swap(false, Ordering::Relaxed) {
            let runs = client.runs();
            lock(&self.seen).runs = runs.ok().map(|runs| runs.runs);
        }
        if self.wanted.ports.swap(false, Ordering::Relaxed) {
            let live = client.live();
            lock(&self.seen).ports = live.ok().map(|live| live.devices);
        }
    }

    fn heard(self: &Arc<Self>, status: Status) -> i64 {
        let is_going = matches!(status.state, State::Preparing | State::Running | State::Stopping);
        let mut seen = lock(&self.seen);
        (seen.silent_ns, seen.trouble) = (None, None);
        if let Some(stopping) = &mut seen.stopping
            && stopping.told_ns.is_some()
            && !is_going
        {
            stopping.still_ns.get_or_insert(MonotonicClock.now_ns());
        }
        let is_awaited = seen
            .stopping
            .as_ref()
            .is_some_and(|stopping| stopping.told_ns.is_some() && stopping.still_ns.is_none());
        let run = status.run.as_ref().map(|run| (run.run.clone(), run.mission.clone()));
        let progress = status.run.as_ref().and_then(|run| run.progress.clone());
        let is_new = run.as_ref().is_some_and(|(run, _)| seen.shown.as_ref() != Some(run));
        if let Some((run, _)) = run.as_ref().filter(|_| is_new) {
            seen.shown = Some(run.clone());
        }
        seen.status = Some(status);
        drop(seen);
        if let Some((run, mission)) = run.filter(|_| is_new) {
            Bringing::of(self, run).begin(Some(&mission));
        }
        if let Some(progress) = progress {
            self.board.hear_status(&progress);
        }
        if is_awaited { CLOSE_LOOK_NS } else { LOOK_NS }
    }

    fn halt_now(&self, client: &mut Client) {
        let (there_s, absent_s) = LOOK_S;
        let patience = Patience::new(there_s).if_absent(absent_s);
        client.set_patience(patience.unless(Arc::clone(&self.over)).quietly());
        let until_ns = MonotonicClock.now_ns().saturating_add(nanoseconds(STOP_S));
        let (stopped, now_ns) = loop {
            let asked_ns = MonotonicClock.now_ns();
            let stopped = client.stop(None);
            let now_ns = MonotonicClock.now_ns();
            match &stopped {
                // The card says so while it is told again and again.
                Err(error @ ClientError::NoAnswer { .. }) if now_ns < until_ns => {
                    self.silent(asked_ns, error);
                }
                _ => break (stopped, now_ns),
            }
        };
        let mut seen = lock(&self.seen);
        let stopping = seen.stopping.get_or_insert_default();
        match stopped {
            Ok(Stopped { run, stopped, .. }) if run.is_none() || stopped => {
                stopping.told_ns = Some(now_ns);
            }
            Ok(_) => stopping.failed = Some("not every motor took the stop".to_owned()),
            Err(error) => stopping.failed = Some(self.told(&error)),
        }
        self.halt.store(false, Ordering::Relaxed);
    }

    fn obey(self: &Arc<Self>, client: &mut Client, order: Order) {
        client.set_patience(Patience::new(ORDER_S).unless(Arc::clone(&self.halt)).quietly());
        let said = match order {
            Order::Start(start) => self.begin(client, start),
            Order::Identify => client.identify().map(|_| "it beeps and blinks".to_owned()),
            Order::Fetch(run) => {
                Bringing::of(self, run).begin(None);
                return;
            }
            Order::Wake => return,
        };
        let said = match said {
            Ok(text) => Said { text, is_good: true },
            Err(ClientError::Interrupted) => Said::not_done(),
            Err(error) => Said { text: self.told(&error), is_good: false },
        };
        lock(&self.seen).said = Some(said);
    }

    fn begin(&self, client: &mut Client, start: Start) -> Result<String, ClientError> {
        let Start { name, text, pose } = start;
        let run = new_run_id(&name)?;
        {
            let mut seen = lock(&self.seen);
            (seen.stopping, seen.started) = (None, None);
        }
        let started = client.start_as(run.clone(), Chosen::Text(text), pose, &[])?;
        lock(&self.seen).started = Some(run);
        Ok(format!("started {name}{}", limit(&started)))
    }
}
