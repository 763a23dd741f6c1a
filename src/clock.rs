//! Monotonic time: the one place that reads a clock or sleeps.
//!
//! Time is a count of nanoseconds since a start that means nothing by itself, as an `i64`: 292
//! years fit. The wall clock is only for names and records, because it jumps: an ev3dev brick
//! without a network wakes up years ago.
//!
//! A [`Clock`] is an argument wherever time matters, so that the same code runs against real time
//! and, with a [`VirtualClock`], as fast as the machine allows.
//!
//! # Not here
//!
//! No deadlines and no periods: the control loop keeps its own (`runtime`).

#[cfg(feature = "sim")]
mod paced;

use std::fmt::Debug;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use nix::time::{ClockId, ClockNanosleepFlags, clock_gettime, clock_nanosleep};

#[cfg(feature = "sim")]
pub use paced::PacedClock;

/// Nanoseconds in a second.
pub const SECOND_NS: i64 = 1_000_000_000;

/// Nanoseconds in a millisecond.
pub const MILLISECOND_NS: i64 = 1_000_000;

/// Nanoseconds as seconds, for people and for formulas.
#[must_use]
#[expect(
    clippy::cast_precision_loss,
    reason = "exact for 104 days of nanoseconds; one rounding beyond"
)]
pub fn seconds(ns: i64) -> f64 {
    ns as f64 / 1e9
}

/// As [`seconds`], to within a unit in the last place, for filters: by a multiplication, which
/// costs a processor without floating point a tenth of the division.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "as in `seconds`")]
pub fn seconds_nearly(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

/// Seconds as nanoseconds, rounded; what is not finite or does not fit ends at the limits, NaN at
/// 0.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "a cast from float saturates")]
pub fn nanoseconds(seconds: f64) -> i64 {
    libm::round(seconds * 1e9) as i64
}

/// A span in nanoseconds; one of more than 292 years ends at the limit.
#[must_use]
pub fn span_ns(span: Duration) -> i64 {
    i64::try_from(span.as_nanos()).unwrap_or(i64::MAX)
}

/// A source of monotonic time that can be waited on.
pub trait Clock: Debug + Send + Sync {
    /// Nanoseconds since this clock's start.
    fn now_ns(&self) -> i64;

    /// Returns when `now_ns` is at least `deadline_ns`, or earlier if a signal came in between.
    fn sleep_until_ns(&self, deadline_ns: i64);

    /// Returns when this many nanoseconds have passed, or earlier if a signal came in between.
    fn sleep_ns(&self, span_ns: i64) {
        self.sleep_until_ns(self.now_ns() + span_ns);
    }

    /// Waits for something of which no event tells, by looking every `look_ns`; false where it is
    /// still not so after `patience_ns`.
    fn wait_for(&self, patience_ns: i64, look_ns: i64, is_so: &dyn Fn() -> bool) -> bool {
        let deadline_ns = self.now_ns().saturating_add(patience_ns);
        while !is_so() {
            if self.now_ns() >= deadline_ns {
                return false;
            }
            self.sleep_ns(look_ns);
        }
        true
    }
}

/// The kernel's monotonic clock: one system call a reading on the brick, which has no vDSO.
#[derive(Debug, Clone, Copy, Default)]
pub struct MonotonicClock;

impl Clock for MonotonicClock {
    fn now_ns(&self) -> i64 {
        // The kernel refuses only clocks that it does not know; this one has been there since 2.6.
        clock_gettime(ClockId::CLOCK_MONOTONIC).map_or(0, |time| span_ns(time.into()))
    }

    fn sleep_until_ns(&self, deadline_ns: i64) {
        let deadline = Duration::from_nanos(deadline_ns.max(0).cast_unsigned());
        // EINTR is an early return, as promised: the caller looks at its signal flags and comes
        // back.
        let _ = clock_nanosleep(
            ClockId::CLOCK_MONOTONIC,
            ClockNanosleepFlags::TIMER_ABSTIME,
            &deadline.into(),
        );
    }
}

/// A clock that stands still until its sleeper sleeps: a mission's two minutes pass in two seconds.
///
/// It is for one sleeper; all other users only read the time.
#[derive(Debug, Default)]
pub struct VirtualClock {
    // A lock, because the brick's processor has no 64-bit atomics.
    now_ns: Mutex<i64>,
}

impl Clock for VirtualClock {
    fn now_ns(&self) -> i64 {
        *self.now_ns.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn sleep_until_ns(&self, deadline_ns: i64) {
        let mut now_ns = self.now_ns.lock().unwrap_or_else(PoisonError::into_inner);
        *now_ns = deadline_ns.max(*now_ns);
    }
}

/// The wall clock's time as interfaces of the system want it, such as a file's.
pub type WallTime = SystemTime;

/// The wall clock as [`WallTime`]: for names and records only.
#[must_use]
pub fn wall_time() -> WallTime {
    SystemTime::now()
}

/// The wall clock, nanoseconds since 1970: for names and records only. A clock before 1970 reads 0.
#[must_use]
pub fn wall_ns() -> i64 {
    span_ns(SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default())
}

/// Seconds from 1970 to 2024: this program is younger, so a clock before that stands wrong.
const SECONDS_TO_2024: i64 = 1_704_067_200;

/// Seconds of a mean Gregorian year.
const SECONDS_A_YEAR: i64 = 31_556_952;

/// The year that a wall clock shows, by its nanoseconds since 1970.
#[must_use]
pub fn year(wall_ns: i64) -> i64 {
    1970 + wall_ns / SECOND_NS / SECONDS_A_YEAR
}

/// What a wall clock says, by its nanoseconds since 1970, that stands wrong, and a way out; `None`
/// from 2024 on. A brick has no battery for its clock: after power-on it stands where it stood
/// before, or at 1970, until a network tells it the time.
#[must_use]
pub fn wrong_year(wall_ns: i64) -> Option<(String, &'static str)> {
    (wall_ns / SECOND_NS < SECONDS_TO_2024).then(|| {
        let way_out =
            "recordings get wrong dates; connect to a network for a minute, or sudo date -s";
        (format!("it is {}, says the clock", year(wall_ns)), way_out)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_clock_before_2024_stands_wrong() {
        let new_year_ns = SECONDS_TO_2024 * SECOND_NS;
        let (found, _) = wrong_year(0).unwrap();
        assert_eq!(found, "it is 1970, says the clock");
        let (found, _) = wrong_year(new_year_ns - 1).unwrap();
        assert_eq!(found, "it is 2023, says the clock");
        assert_eq!(wrong_year(new_year_ns), None);
    }

    #[test]
    fn a_virtual_clock_moves_only_forward_and_only_by_sleeping() {
        let clock = VirtualClock::default();
        assert_eq!(clock.now_ns(), 0);
        clock.sleep_until_ns(5 * SECOND_NS);
        clock.sleep_until_ns(2 * SECOND_NS);
        assert_eq!(clock.now_ns(), 5 * SECOND_NS);
    }

    #[test]
    fn the_monotonic_clock_sleeps_until_its_deadline() {
        let clock = MonotonicClock;
        let deadline_ns = clock.now_ns() + 2 * MILLISECOND_NS;
        clock.sleep_until_ns(deadline_ns);
        assert!(clock.now_ns() >= deadline_ns);
    }

    #[test]
    fn seconds_and_nanoseconds_convert_and_saturate() {
        assert_eq!(nanoseconds(1.5), 1_500_000_000);
        assert_eq!(nanoseconds(f64::NAN), 0);
        assert_eq!(nanoseconds(f64::INFINITY), i64::MAX);
        assert!((seconds(2_500_000_000) - 2.5).abs() < 1e-12);
        for ns in (-20_000..20_000).map(|step| step * 123_457) {
            let (exact, near) = (seconds(ns), seconds_nearly(ns));
            assert!(
                (exact - near).abs() <= f64::EPSILON * exact.abs(),
                "{ns} ns: {exact} s and {near} s"
            );
        }
    }
}
