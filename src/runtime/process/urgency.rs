//! How urgent the kernel takes a run's processes: the guard before control, and both before
//! everything else.
//!
//! It needs root or CAP_SYS_NICE, which the service on the brick has. Where it is not permitted, as
//! on most PCs, the run continues without it and the log says so (`-v`).

use nix::sys::mman::{MlockAllFlags, mlockall};
use nix::sys::resource::{Resource, setrlimit};
use thread_priority::{
    NormalThreadSchedulePolicy, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue,
    ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id,
};

/// Priorities of SCHED_FIFO, 1 to 99: below the kernel's own threads for interrupts, which have 50.
const GUARD: u8 = 20;
const CONTROL: u8 = 10;

/// The priority that the crate turns into a nice value of 0.
const USUAL: u8 = 49;

/// How long guard and control may compute without waiting before the kernel kills the process,
/// microseconds: a loop that spins at real-time priority keeps a brick's one core from all others.
const LONGEST_SPIN_US: nix::libc::rlim_t = 200_000;

/// This thread comes before everything else of ours, may not spin for ever, and its memory stays
/// where it is.
pub(super) fn as_guard() {
    limited(GUARD);
    if let Err(errno) = mlockall(MlockAllFlags::MCL_CURRENT | MlockAllFlags::MCL_FUTURE) {
        log::info!("the guard's memory is not locked: {errno}");
    }
}

/// This thread comes before everything but the guard, and may not spin for ever.
pub(super) fn as_control() {
    limited(CONTROL);
}

/// This thread is as urgent as any other again.
pub(super) fn as_others() {
    let policy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);
    set(policy, USUAL);
}

fn limited(priority: u8) {
    let (soft, hard) = (LONGEST_SPIN_US, nix::libc::RLIM_INFINITY);
    match setrlimit(Resource::RLIMIT_RTTIME, soft, hard) {
        Ok(()) => set(ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo), priority),
        Err(errno) => log::info!("no real-time priority, because it could not be limited: {errno}"),
    }
}

/// The robot stands still: from here on a long computation is no danger.
pub(super) fn may_compute() {
    let unlimited = nix::libc::RLIM_INFINITY;
    if let Err(errno) = setrlimit(Resource::RLIMIT_RTTIME, unlimited, unlimited) {
        log::info!("the limit of real-time computing stays: {errno}");
    }
}

fn set(policy: ThreadSchedulePolicy, priority: u8) {
    let set = ThreadPriorityValue::try_from(priority).and_then(|priority| {
        set_thread_priority_and_policy(
            thread_native_id(),
            ThreadPriority::Crossplatform(priority),
            policy,
        )
        .map_err(|error| error.to_string())
    });
    if let Err(error) = set {
        log::info!("the priority stays: {error}");
    }
}
