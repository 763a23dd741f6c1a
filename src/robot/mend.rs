//! Plugs come loose: a device that cannot be read any more is looked for by its port, and bound
//! again when it is back.
//!
//! Binding lists folders, opens files and writes modes, which takes a sensor up to half a second;
//! none of that belongs on the tick's path. In a run in real time a helper thread does it, and
//! hands the ready device over through a lock-free ring; the replaced device goes back to the
//! helper, which closes its files. In virtual time, where no thread waits, the tick does it itself,
//! so that a simulated run repeats to the bit.
//!
//! - It is tried at once, and then after 0.1, 0.2, 0.4 and at last each 0.5 s: after a plug is put
//!   in, the files cannot be opened for a moment (EACCES), and a serial sensor needs two seconds.
//! - Modes and the settings of a lease are restored, a motion never: the next one is what the
//!   mission asks for then.
//! - A motor that was never away is left as it is: a `reset` would move its zero.
//!
//! # Not here
//!
//! Where angles go on from is decided when the device is put in place (`Robot::put_back`).

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::Thread;

use rtrb::{Consumer, Producer, RingBuffer};

use super::bind::{Binder, Bound};
use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock};
use crate::senses::Channel;
use crate::threads;

/// A device that answers with errors for so long is looked for, nanoseconds; one that says that it
/// is gone, at once.
const PATIENCE_NS: i64 = 100 * MILLISECOND_NS;

/// The first pause between two tries, and the longest, nanoseconds.
const FIRST_PAUSE_NS: i64 = 100 * MILLISECOND_NS;
const LONGEST_PAUSE_NS: i64 = 500 * MILLISECOND_NS;

/// How often the helper looks at what it has to do while something is wanted, nanoseconds.
const LOOK_NS: i64 = 20 * MILLISECOND_NS;

const CHANNELS: usize = Channel::COUNT;

/// A device that was bound again.
#[derive(Debug)]
pub(super) struct Mended {
    pub(super) channel: Channel,
    pub(super) bound: Bound,
    /// It was replugged, so its count has restarted.
    pub(super) replugged: bool,
}

/// Which devices are looked for, and who does it.
#[derive(Debug)]
pub(super) struct Mender {
    /// Bits by channel.
    wanted: u32,
    failing_since_ns: [Option<i64>; CHANNELS],
    by: By,
}

#[derive(Debug)]
enum By {
    /// The tick itself.
    Itself(Box<Search>),
    Helper(Helper),
}

impl Mender {
    pub(super) fn new(binder: Binder) -> Self {
        let search = Search { binder, jobs: std::array::from_fn(|_| Work::default()), last_ns: 0 };
        Self { wanted: 0, failing_since_ns: [None; CHANNELS], by: By::Itself(Box::new(search)) }
    }

    /// Tells the kernel's name of the device that is in place.
    pub(super) fn knows(&mut self, channel: Channel, name: String) {
        if let By::Itself(search) = &mut self.by {
            search.jobs[channel as usize].known = Some(name);
        }
    }

    /// From now on a helper thread does it.
    pub(super) fn move_to_helper(&mut self) -> io::Result<()> {
        let By::Itself(search) = &mut self.by else { return Ok(()) };
        // Two more than can be under way: one that comes back for each that goes out.
        let (hand_over, mended) = RingBuffer::new(2 * CHANNELS);
        let (give_back, old) = RingBuffer::new(2 * CHANNELS);
        let shared = Arc::new(Shared::default());
        let moved = search.clone_idle();
        let thread = {
            let shared = Arc::clone(&shared);
            threads::spawn("mender", move || help(moved, &shared, hand_over, old))?
        };
        let thread = thread.thread().clone();
        self.by = By::Helper(Helper { shared, thread, mended, give_back });
        self.want(self.wanted);
        Ok(())
    }

    /// Notes how reading a channel went.
    pub(super) fn note(&mut self, channel: Channel, failed: Option<bool>, now_ns: i64) {
        let bit = 1 << (channel as u32);
        let since_ns = &mut self.failing_since_ns[channel as usize];
        let Some(gone) = failed else {
            *since_ns = None;
            if self.wanted & bit != 0 {
                self.want(self.wanted & !bit);
            }
            return;
        };
        let failing_ns = now_ns - *since_ns.get_or_insert(now_ns);
        if self.wanted & bit == 0 && (gone || failing_ns >= PATIENCE_NS) {
            self.want(self.wanted | bit);
        }
    }

    /// A device that is ready to be put in place.
    pub(super) fn next(&mut self, now_ns: i64) -> Option<Box<Mended>> {
        if self.wanted == 0 {
            return None;
        }
        let mended = match &mut self.by {
            By::Itself(search) => search.work(self.wanted, now_ns),
            By::Helper(helper) => helper.mended.pop().ok(),
        }?;
        let bit = 1 << (mended.channel as u32);
        if self.wanted & bit == 0 {
            // The old one works again.
            self.give_back(mended);
            return None;
        }
        self.want(self.wanted & !bit);
        self.failing_since_ns[mended.channel as usize] = None;
        Some(mended)
    }

    /// Takes the device that another one has taken the place of.
    pub(super) fn give_back(&mut self, old: Box<Mended>) {
        if let By::Helper(helper) = &mut self.by {
            // There is room for all that can be under way; else its files are closed here.
            let _ = helper.give_back.push(old);
            helper.thread.unpark();
        }
    }

    fn want(&mut self, wanted: u32) {
        self.wanted = wanted;
        if let By::Helper(helper) = &self.by {
            helper.shared.wanted.store(wanted, Ordering::Release);
            helper.thread.unpark();
        }
    }
}

/// What is done for one channel.
#[derive(Debug, Default)]
struct Work {
    /// The kernel's name of the device that was there last.
    known: Option<String>,
    due_ns: i64,
    pause_ns: i64,
    /// A device, and when its values are no longer stale.
    ready: Option<(Box<Mended>, i64)>,
}

/// Looks for devices and binds them.
#[derive(Debug)]
struct Search {
    binder: Binder,
    jobs: [Work; CHANNELS],
    last_ns: i64,
}

impl Search {
    /// The same, with nothing begun.
    fn clone_idle(&self) -> Self {
        let jobs =
            self.jobs.each_ref().map(|work| Work { known: work.known.clone(), ..Work::default() });
        Self { binder: self.binder.clone(), jobs, last_ns: 0 }
    }

    /// Does what is due; a device that is ready.
    fn work(&mut self, wanted: u32, now_ns: i64) -> Option<Box<Mended>> {
        // A run's clock restarts when the robot starts to drive.
        let again = now_ns < self.last_ns;
        self.last_ns = now_ns;
        for (channel, work) in Channel::ALL.into_iter().zip(&mut self.jobs) {
            if wanted & (1 << (channel as u32)) == 0 || again {
                let known = work.known.take();
                *work = Work { known, pause_ns: FIRST_PAUSE_NS, ..Work::default() };
            }
            if wanted & (1 << (channel as u32)) == 0 {
                continue;
            }
            if work.ready.is_none() && now_ns >= work.due_ns {
                work.attempt(&self.binder, channel, now_ns);
            }
            if let Some((mended, _)) = work.ready.take_if(|(_, ready_ns)| now_ns >= *ready_ns) {
                // If it fails at once, it is looked for again.
                work.due_ns = now_ns + LONGEST_PAUSE_NS;
                return Some(mended);
            }
        }
        None
    }
}

impl Work {
    fn attempt(&mut self, binder: &Binder, channel: Channel, now_ns: i64) {
        match binder.again(channel, self.known.as_deref()) {
            Ok(Some((bound, settle_ns))) => {
                let replugged = self.known.as_deref() != Some(bound.name());
                self.known = Some(bound.name().to_owned());
                self.ready =
                    Some((Box::new(Mended { channel, bound, replugged }), now_ns + settle_ns));
            }
            Ok(None) => self.wait(now_ns),
            Err(error) => {
                log::debug!("the {channel} is not back yet: {error}");
                self.wait(now_ns);
            }
        }
    }

    fn wait(&mut self, now_ns: i64) {
        self.due_ns = now_ns + self.pause_ns;
        self.pause_ns = (2 * self.pause_ns).min(LONGEST_PAUSE_NS);
    }
}

/// The tick's end of the helper thread.
#[derive(Debug)]
struct Helper {
    shared: Arc<Shared>,
    thread: Thread,
    mended: Consumer<Box<Mended>>,
    give_back: Producer<Box<Mended>>,
}

#[derive(Debug, Default)]
struct Shared {
    wanted: AtomicU32,
    ended: AtomicBool,
}

impl Drop for Helper {
    fn drop(&mut self) {
        self.shared.ended.store(true, Ordering::Release);
        self.thread.unpark();
    }
}

fn help(
    mut search: Search,
    shared: &Shared,
    mut hand_over: Producer<Box<Mended>>,
    mut old: Consumer<Box<Mended>>,
) {
    while !shared.ended.load(Ordering::Acquire) {
        while let Ok(mended) = old.pop() {
            drop(mended);
        }
        let wanted = shared.wanted.load(Ordering::Acquire);
        if let Some(mended) = search.work(wanted, MonotonicClock.now_ns()) {
            // There is room: no channel has two under way.
            let _ = hand_over.push(mended);
        }
        if wanted == 0 {
            std::thread::park();
        } else {
            MonotonicClock.sleep_ns(LOOK_NS);
        }
    }
}
