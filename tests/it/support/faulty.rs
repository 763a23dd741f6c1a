//! Faults under all file access of a brick's path, attributes and records alike: one plan says
//! which call goes wrong and how.
//!
//! A [`Plan`] counts the calls that pass through it. [`FaultyTree`] puts it under the attributes
//! ([`Tree`]), [`FaultySink`] under a recording ([`Sink`]); one plan may be under both. What
//! devices do by themselves belongs to the simulated brick's faults, not here.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use nix::errno::Errno;
use onbrick::clock::Clock;
use onbrick::ev3dev::{Access, AttributeFile, Tree};
use onbrick::recording::Sink;

/// How a call goes wrong.
#[derive(Debug, Clone)]
pub enum Trouble {
    /// With an error, and nothing done.
    Fail(Errno),
    /// After this many bytes: a read gives no more, a write takes no more and then fails with
    /// ENOSPC.
    Short(usize),
    /// Late, by this many nanoseconds of a clock.
    Delay(Arc<dyn Clock>, i64),
    /// Never: the process is dead or the power gone. A write still stores this many bytes; no later
    /// call reaches a file.
    Die(usize),
}

/// Which calls are counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Open,
    Read,
    Write,
    Sync,
}

/// Which call goes wrong, and whether those after it do as well.
#[derive(Debug, Clone)]
pub struct Rule {
    /// From 1.
    pub nth: u64,
    /// How many in a row, this one included.
    pub times: u64,
    pub trouble: Trouble,
}

/// Rules and the count so far. Clones are handles on the same one.
#[derive(Debug, Clone)]
pub struct Plan(Arc<Mutex<State>>);

#[derive(Debug)]
struct State {
    counted: Vec<Kind>,
    rules: Vec<Rule>,
    calls: u64,
    hits: u64,
    rests: bool,
    dead: bool,
}

impl Plan {
    /// Calls of these kinds are counted; nothing goes wrong yet.
    pub fn counting(kinds: &[Kind]) -> Self {
        let state = State {
            counted: kinds.to_vec(),
            rules: Vec::new(),
            calls: 0,
            hits: 0,
            rests: false,
            dead: false,
        };
        Self(Arc::new(Mutex::new(state)))
    }

    /// The `nth` call of these kinds goes wrong, and no other.
    pub fn once(kinds: &[Kind], nth: u64, trouble: Trouble) -> Self {
        let plan = Self::counting(kinds);
        plan.add(Rule { nth, times: 1, trouble });
        plan
    }

    pub fn add(&self, rule: Rule) {
        self.0.lock().unwrap().rules.push(rule);
    }

    /// Nothing is counted and nothing goes wrong until [`wake`](Self::wake).
    pub fn rest(&self) {
        self.0.lock().unwrap().rests = true;
    }

    pub fn wake(&self) {
        self.0.lock().unwrap().rests = false;
    }

    /// How many calls were counted.
    pub fn calls(&self) -> u64 {
        self.0.lock().unwrap().calls
    }

    /// How many of them went wrong.
    pub fn hits(&self) -> u64 {
        self.0.lock().unwrap().hits
    }

    /// Counts a call and says what becomes of it.
    fn next(&self, kind: Kind) -> Option<Trouble> {
        let mut state = self.0.lock().unwrap();
        if state.dead {
            return Some(Trouble::Die(0));
        }
        if state.rests || !state.counted.contains(&kind) {
            return None;
        }
        state.calls += 1;
        let number = state.calls;
        let hit = |rule: &&Rule| (rule.nth..rule.nth.saturating_add(rule.times)).contains(&number);
        let trouble = state.rules.iter().find(hit).map(|rule| rule.trouble.clone());
        state.hits += u64::from(trouble.is_some());
        state.dead = matches!(trouble, Some(Trouble::Die(_)));
        trouble
    }
}

/// A brick's files with faults under them.
#[derive(Debug)]
pub struct FaultyTree {
    pub tree: Arc<dyn Tree>,
    pub plan: Plan,
}

impl Tree for FaultyTree {
    fn list(&self, folder: &str) -> Result<Vec<String>, Errno> {
        self.tree.list(folder)
    }

    fn open(&self, path: &str, access: Access) -> Result<Box<dyn AttributeFile>, Errno> {
        match self.plan.next(Kind::Open) {
            Some(Trouble::Fail(errno)) => return Err(errno),
            Some(Trouble::Die(_)) => return Err(Errno::EIO),
            Some(Trouble::Delay(clock, ns)) => clock.sleep_ns(ns),
            Some(Trouble::Short(_)) | None => {}
        }
        Ok(Box::new(FaultyFile { file: self.tree.open(path, access)?, plan: self.plan.clone() }))
    }

    fn root(&self) -> &Path {
        self.tree.root()
    }

    fn local_path(&self, path: &str) -> Option<PathBuf> {
        self.tree.local_path(path)
    }
}

#[derive(Debug)]
struct FaultyFile {
    file: Box<dyn AttributeFile>,
    plan: Plan,
}

impl AttributeFile for FaultyFile {
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Errno> {
        match self.plan.next(Kind::Read) {
            Some(Trouble::Fail(errno)) => return Err(errno),
            Some(Trouble::Die(_)) => return Err(Errno::EIO),
            Some(Trouble::Short(bytes)) => return Ok(self.file.read(buffer)?.min(bytes)),
            Some(Trouble::Delay(clock, ns)) => clock.sleep_ns(ns),
            None => {}
        }
        self.file.read(buffer)
    }

    fn write(&self, value: &[u8]) -> Result<usize, Errno> {
        match self.plan.next(Kind::Write) {
            Some(Trouble::Fail(errno)) => return Err(errno),
            Some(Trouble::Die(_)) => return Err(Errno::EIO),
            // The kernel stores an attribute whole or not at all; what it takes of it is for the
            // caller to look at.
            Some(Trouble::Short(bytes)) => return Ok(bytes.min(value.len())),
            Some(Trouble::Delay(clock, ns)) => clock.sleep_ns(ns),
            None => {}
        }
        self.file.write(value)
    }

    fn wait_changed(&self, timeout: Duration) -> Result<bool, Errno> {
        self.file.wait_changed(timeout)
    }
}

/// A recording's file with faults under it.
#[derive(Debug)]
pub struct FaultySink<S> {
    pub sink: S,
    pub plan: Plan,
}

impl<S: Sink> Sink for FaultySink<S> {
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self.plan.next(Kind::Write) {
            Some(Trouble::Fail(errno)) => return Err(errno.into()),
            Some(Trouble::Short(fit)) => {
                self.sink.write_all(bytes.get(..fit).unwrap_or(bytes))?;
                return Err(Errno::ENOSPC.into());
            }
            // The writer does not learn of it: its process is dead as well.
            Some(Trouble::Die(fit)) => {
                return self.sink.write_all(bytes.get(..fit).unwrap_or(bytes));
            }
            Some(Trouble::Delay(clock, ns)) => clock.sleep_ns(ns),
            None => {}
        }
        self.sink.write_all(bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        match self.plan.next(Kind::Sync) {
            Some(Trouble::Fail(errno)) => return Err(errno.into()),
            Some(Trouble::Die(_)) => return Ok(()),
            Some(Trouble::Delay(clock, ns)) => clock.sleep_ns(ns),
            Some(Trouble::Short(_)) | None => {}
        }
        self.sink.sync()
    }
}
