//! When a kernel timer fires.
//!
//! The brick's kernel ticks at 100 Hz. A timer that is due further ahead than 62 ticks is kept in a
//! coarser ring of the timer wheel (`kernel/time/timer.c`, since 4.8): it fires up to 80 ms late,
//! further ones later still. A `run-timed` of 300 ms ends within 310 ms, one of 1000 ms within 1090
//! ms; the kernel transcript shows the latter (scenario 6).

/// One tick of the kernel, in nanoseconds.
pub(crate) const JIFFY_NS: i64 = 10_000_000;

/// Ticks in each ring of the wheel, but for the one that is being emptied.
const RING: i64 = 63;

/// Each ring's ticks are this many times longer than those of the ring before.
const COARSER: i64 = 8;

/// The kernel's count of ticks at a time.
pub(crate) fn jiffies(now_ns: i64) -> i64 {
    now_ns.div_euclid(JIFFY_NS)
}

/// Milliseconds as ticks, rounded up.
pub(crate) fn from_ms(ms: i32) -> i64 {
    (i64::from(ms) + 9).div_euclid(10)
}

/// When work that is queued now with a delay is done, in nanoseconds; at once without a delay.
pub(crate) fn due_ns(now_ns: i64, delay: i64) -> i64 {
    if delay <= 0 {
        return now_ns;
    }
    let mut step = 1;
    while delay >= RING * step && step < COARSER.pow(8) {
        step *= COARSER;
    }
    let expires = jiffies(now_ns).saturating_add(delay);
    (expires.saturating_add(step).div_euclid(step) * step).saturating_mul(JIFFY_NS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_timer_is_never_early_and_late_by_its_ring() {
        for now_ns in (0..1000).map(|k| k * 1_234_567) {
            for (delay, most_late_ms) in
                [(1, 10), (30, 10), (62, 10), (63, 80), (100, 80), (503, 80), (600, 640)]
            {
                let late_ns = due_ns(now_ns, delay) - (now_ns + delay * JIFFY_NS);
                assert!(
                    (0..=most_late_ms * 1_000_000).contains(&late_ns),
                    "{delay} ticks from {now_ns} ns: {late_ns} ns late"
                );
            }
        }
        assert_eq!(due_ns(5, 0), 5);
    }
}
