//! The co-processor's counter: edges, and the speed from the times between them.
//!
//! It logs count and time of every edge in a ring, and every 50 ms without an edge. Speed is the
//! difference from the newest entry back, four entries at a time until 20 ms are spanned or 64
//! entries: the mean over about the last 20 ms, stale for up to 50 ms after an abrupt stop, and 0
//! some 200 ms after it.

const LENGTH: usize = 256;
const STRIDE: usize = 4;
const MOST_BACK: usize = 64;
const SPAN_NS: i64 = 20_000_000;
const IDLE_NS: i64 = 50_000_000;

/// Edge counts with their times.
#[derive(Debug)]
pub(crate) struct Encoder {
    ring: Box<[(i64, i64); LENGTH]>,
    newest: usize,
    /// Edges so far.
    pub(crate) edges: i64,
    exact: f64,
    /// Edges a second, as the co-processor reckons.
    pub(crate) speed: i64,
}

impl Encoder {
    /// A counter that has stood at `edges` for a long time.
    pub(crate) fn new(edges: i64, exact: f64, now_ns: i64) -> Self {
        let ring = Box::new([(edges, now_ns - SPAN_NS * 64); LENGTH]);
        Self { ring, newest: 0, edges, exact, speed: 0 }
    }

    /// Takes the count at the end of a step of `step_ns`; `exact` says where between two edges the
    /// motor is, so that each edge in the step gets its own time.
    pub(crate) fn observe(&mut self, edges: i64, exact: f64, now_ns: i64, step_ns: i64) {
        let (before, exact_before) = (self.edges, self.exact);
        (self.edges, self.exact) = (edges, exact);
        let moved = edges - before;
        if moved == 0 {
            let (_, at_ns) = self.ring[self.newest];
            if now_ns - at_ns >= IDLE_NS {
                self.log(edges, now_ns);
            }
            return;
        }
        let skipped = (moved.abs() - 256).max(0);
        for nth in skipped + 1..=moved.abs() {
            // Going up, edge k is where the exact position passes k; going down, where it leaves k
            // + 1.
            let (count, boundary) = if moved > 0 {
                (before + nth, before + nth)
            } else {
                (before - nth, before - nth + 1)
            };
            let at_ns = now_ns - step_ns + passed_ns(boundary, exact_before, exact, step_ns);
            self.log(count, at_ns);
        }
    }

    fn log(&mut self, count: i64, at_ns: i64) {
        self.newest = (self.newest + 1) % LENGTH;
        self.ring[self.newest] = (count, at_ns);
        self.speed = self.measure();
    }

    fn measure(&self) -> i64 {
        let (count, at_ns) = self.ring[self.newest];
        for steps in (STRIDE..=MOST_BACK).step_by(STRIDE) {
            let (older_count, older_ns) = self.ring[(self.newest + LENGTH - steps) % LENGTH];
            let span_ns = at_ns - older_ns;
            if span_ns >= SPAN_NS || steps == MOST_BACK {
                return (count - older_count).saturating_mul(1_000_000_000) / span_ns.max(1);
            }
        }
        0
    }
}

/// When within the step the motor passed an edge.
#[expect(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    reason = "edges are far below 2^53; a part of a step fits"
)]
fn passed_ns(boundary: i64, from: f64, to: f64, step_ns: i64) -> i64 {
    let share = ((boundary as f64 - from) / (to - from)).clamp(0.0, 1.0);
    let share = if share.is_nan() { 1.0 } else { share };
    (share * step_ns as f64) as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_NS: i64 = 2_000_000;

    /// Turns at a speed for a time; returns where it is then.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_precision_loss,
        reason = "small numbers"
    )]
    fn turn(encoder: &mut Encoder, from: f64, speed: f64, start_ns: i64, steps: i64) -> f64 {
        for step in 1..=steps {
            let exact = from + speed * (step * STEP_NS) as f64 / 1e9;
            encoder.observe(libm::floor(exact) as i64, exact, start_ns + step * STEP_NS, STEP_NS);
        }
        from + speed * (steps * STEP_NS) as f64 / 1e9
    }

    #[test]
    fn a_steady_speed_is_measured_exactly_in_both_directions() {
        for speed in [37.0, 120.0, 800.0, 2100.0, -120.0, -2100.0] {
            let mut encoder = Encoder::new(0, 0.0, 0);
            turn(&mut encoder, 0.0, speed, 0, 1000);
            let measured = encoder.speed;
            assert!(
                (f64::from(i32::try_from(measured).unwrap()) - speed).abs() <= 1.0,
                "{measured} of {speed}"
            );
        }
    }

    #[test]
    fn an_abrupt_stop_shows_late_and_is_zero_within_about_200_ms() {
        let mut encoder = Encoder::new(0, 0.0, 0);
        let stopped_at = turn(&mut encoder, 0.0, 800.0, 0, 500);
        turn(&mut encoder, stopped_at, 0.0, 500 * STEP_NS, 20);
        assert_eq!(encoder.speed, 800, "40 ms after the stop");
        turn(&mut encoder, stopped_at, 0.0, 520 * STEP_NS, 90);
        assert_eq!(encoder.speed, 0, "220 ms after the stop");
    }
}
