//! A sweep's echoes, as long as it is not clear what they come from.
//!
//! While the head turns past a surface, its range falls to the distance of the surface and rises
//! again: a *valley*. Over the bearings in which the surface's nearest place is heard, the range is
//! constant: a *region of constant depth* (Leonard and Durrant-Whyte, *Directed sonar sensing for
//! mobile robot navigation*, 1992; Kuc and Siegel 1987). The surface stands square to the middle of
//! that region, and where it stands so, at its [`Foot`], is the best place that a sonar can tell.
//! All echoes of the valley come from that surface: those beside the region lie on the tangent
//! through the foot, at the range that they have.
//!
//! A valley ends where the range jumps, where echoes are missing, where the range begins to fall
//! again (a corner between two surfaces), where the head turns back, and when it is full. Its foot
//! counts only if both ends of its region were seen.
//!
//! # Not here
//!
//! What a foot says of the map and of the pose (`landmarks`). Where an echo lies of whose valley no
//! foot is known (`bearing`).

use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};

use super::Range;
use super::bearing::{self, Slope};
use super::range::Beam;

/// Echoes of one valley at most: more than a sweep of a degree a reading has over any surface.
const ECHOES: usize = 128;
/// Ranges of one region differ by no more than this, metres: readings are whole centimetres.
const CONSTANT_M: f64 = 0.015;
/// A valley's rim is higher than its bottom by this, metres.
const RIM_M: f64 = 0.04;
/// A region narrower than this is no region, radians: 15°. A surface that echoes is heard over the
/// whole width of the beam.
const NARROWEST_RAD: f64 = 0.26;
/// A region wider than this is more than one surface, radians: 100°.
const WIDEST_RAD: f64 = 1.75;
/// Bearings nearer than this to each other are the same, radians: 1°.
const SAME_RAD: f64 = 0.0174;
/// Soundings further apart than this are no sweep, radians: 20°.
const SWEEP_RAD: f64 = 0.35;
/// A valley that is not over after this is taken as it is, nanoseconds: the map should not wait.
const LONGEST_NS: i64 = 8_000_000_000;

/// An echo on its way into the map.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Echo {
    /// The instant of the reading.
    pub time_ns: i64,
    /// Where the sensor was, world frame.
    pub x_m: f64,
    /// The same.
    pub y_m: f64,
    /// The beam's direction, world frame, without a wrap.
    pub bearing_rad: f64,
    pub range_m: f64,
    /// How far off the axis it is by the slope of the ranges, where no foot says better.
    pub off_rad: f64,
}

/// Where a surface stands square to the sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Foot {
    /// Where the sensor was, in the middle of the region.
    pub x_m: f64,
    pub y_m: f64,
    /// The direction of the foot, world frame.
    pub bearing_rad: f64,
    pub distance_m: f64,
    /// Width of the region of constant depth, radians.
    pub width_rad: f64,
}

/// A valley that is over: its echoes, and its foot, if it has one.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Valley {
    pub echoes: ArrayVec<Echo, ECHOES>,
    pub foot: Option<Foot>,
}

/// The valley that is being swept.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Sweep {
    slope: Slope,
    echoes: ArrayVec<Echo, ECHOES>,
    /// Whether the valley's first side was seen: it began at a jump, a gap or a rim.
    begun: bool,
    /// Which way the head turns: −1, 0, 1.
    way: i8,
    missed: u8,
    last_rad: Option<f64>,
    /// Lowest range so far, and once it has risen by a rim, the highest since and where that is.
    lowest_m: f64,
    rim: Option<(f64, u8)>,
}

impl Sweep {
    /// Takes a sounding; returns how far off the axis its echo is as far as can be told at once,
    /// and the valley that it ended.
    pub(super) fn take(
        &mut self,
        time_ns: i64,
        beam: &Beam,
        bearing_rad: f64,
        range: Range,
        half_cone_rad: f64,
    ) -> (f64, Option<Valley>) {
        let off_rad = self.slope.off_axis_rad(beam, bearing_rad, range, half_cone_rad);
        let turned_rad = self.last_rad.replace(bearing_rad).map_or(0.0, |last| bearing_rad - last);
        let turned_back = self.turn(turned_rad);
        let Range::Echo(range_m) = range else {
            self.missed = self.missed.saturating_add(1);
            // One missing echo may be a sensor's whim; two are a gap.
            let over = (self.missed == 2 || turned_back).then(|| self.end(!turned_back));
            return (off_rad, over.flatten());
        };
        let echo = Echo { time_ns, x_m: beam.x_m, y_m: beam.y_m, bearing_rad, range_m, off_rad };
        let over = self.add(echo, turned_rad, turned_back);
        self.missed = 0;
        (off_rad, over)
    }

    /// The valley so far, for the end of a run or what else ends a sweep.
    pub(super) fn end(&mut self, seen: bool) -> Option<Valley> {
        let last = self.echoes.len();
        self.split(last, seen)
    }

    /// Moves what waits: `place` gives each place in the corrected map, `turn_rad` its turn.
    pub(super) fn correct(&mut self, place: impl Fn(f64, f64) -> [f64; 2], turn_rad: f64) {
        for echo in &mut self.echoes {
            [echo.x_m, echo.y_m] = place(echo.x_m, echo.y_m);
            echo.bearing_rad += turn_rad;
        }
        self.last_rad = self.last_rad.map(|rad| rad + turn_rad);
        self.slope.correct(place, turn_rad);
    }

    /// Notes which way the head turns; true where it turned back.
    fn turn(&mut self, turned_rad: f64) -> bool {
        if turned_rad.abs() < SAME_RAD {
            return false;
        }
        let way = if turned_rad > 0.0 { 1 } else { -1 };
        let turned_back = self.way != 0 && way != self.way;
        self.way = way;
        turned_back
    }

    fn add(&mut self, echo: Echo, turned_rad: f64, turned_back: bool) -> Option<Valley> {
        let mut over = None;
        if let Some(last) = self.echoes.last() {
            let grown_m = echo.reduced_m(last.x_m, last.y_m) - last.range_m;
            let most_m = bearing::most_grown_m(turned_rad, echo.range_m.min(last.range_m));
            let first_ns = self.echoes.first().map_or(echo.time_ns, |first| first.time_ns);
            if turned_back || turned_rad.abs() > SWEEP_RAD {
                over = self.end(false);
                self.begun = false;
            } else if grown_m.abs() > most_m || self.missed > 1 {
                over = self.end(true);
                self.begun = true;
            } else if self.echoes.is_full() || echo.time_ns.saturating_sub(first_ns) > LONGEST_NS {
                over = self.end(false);
                self.begun = false;
            }
        } else {
            self.begun = self.missed > 1 && !turned_back;
        }
        let first = self.echoes.first().copied().unwrap_or(echo);
        self.echoes.push(echo);
        let height_m = echo.reduced_m(first.x_m, first.y_m);
        if self.echoes.len() == 1 {
            (self.lowest_m, self.rim) = (height_m, None);
        }
        self.lowest_m = self.lowest_m.min(height_m);
        let newest = self.echoes.len() - 1;
        match self.rim {
            None if height_m > self.lowest_m + RIM_M => self.rim = Some((height_m, small(newest))),
            Some((rim_m, _)) if height_m >= rim_m => self.rim = Some((height_m, small(newest))),
            // Beyond the rim the next valley has begun.
            Some((rim_m, at)) if height_m < rim_m - RIM_M => {
                over = over.or_else(|| self.split(usize::from(at), true));
                self.begun = true;
            }
            _ => {}
        }
        over
    }

    /// Takes the first echoes out as a valley; the others become the next one's.
    fn split(&mut self, count: usize, end_seen: bool) -> Option<Valley> {
        let echoes: ArrayVec<Echo, ECHOES> = self.echoes.drain(..count).collect();
        let first = self.echoes.first().copied();
        let heights = first
            .map(|first| self.echoes.iter().map(move |echo| echo.reduced_m(first.x_m, first.y_m)));
        self.lowest_m = heights.map_or(0.0, |heights| heights.fold(f64::INFINITY, f64::min));
        self.rim = None;
        let foot = foot(&echoes, self.begun, end_seen);
        (!echoes.is_empty()).then_some(Valley { echoes, foot })
    }
}

impl Echo {
    /// Its range as it would be from another place of the sensor, metres.
    fn reduced_m(&self, x_m: f64, y_m: f64) -> f64 {
        let (sin, cos) = libm::sincos(self.bearing_rad);
        self.range_m + (self.x_m - x_m) * cos + (self.y_m - y_m) * sin
    }

    /// Its place as the slope of the ranges tells it.
    pub(super) fn by_slope(&self) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.bearing_rad + self.off_rad);
        [self.x_m + cos * self.range_m, self.y_m + sin * self.range_m]
    }
}

/// The foot of a valley, where its region of constant depth is wide enough and whole.
fn foot(echoes: &[Echo], begin_seen: bool, end_seen: bool) -> Option<Foot> {
    let middle = echoes.get(echoes.len() / 2)?;
    let heights = || echoes.iter().map(|echo| echo.reduced_m(middle.x_m, middle.y_m));
    let lowest_m = heights().fold(f64::INFINITY, f64::min);
    let low = |height_m: f64| height_m <= lowest_m + CONSTANT_M;
    let first = heights().position(low)?;
    let last = echoes.len() - 1 - heights().rev().position(low)?;
    let is_whole = (first > 0 || begin_seen) && (last + 1 < echoes.len() || end_seen);
    let region = echoes.get(first..=last)?;
    let (from, to) = (region.first()?, region.last()?);
    #[expect(clippy::cast_precision_loss, reason = "a count of echoes")]
    let steps = (region.len() - 1) as f64;
    // Each reading stands for the step around it.
    let between_rad = (to.bearing_rad - from.bearing_rad).abs();
    let width_rad = between_rad + if steps > 0.0 { between_rad / steps } else { 0.0 };
    if !is_whole || !(NARROWEST_RAD..WIDEST_RAD).contains(&width_rad) {
        return None;
    }
    let bearing_rad = f64::midpoint(from.bearing_rad, to.bearing_rad);
    let at = region.get(region.len() / 2)?;
    // The mean of the region's readings: they differ by the noise alone.
    let (mut sum_m, mut count) = (0.0, 0.0);
    for height_m in heights().skip(first).take(region.len()).filter(|height_m| low(*height_m)) {
        sum_m += height_m;
        count += 1.0;
    }
    let (sin, cos) = libm::sincos(bearing_rad);
    let nearer_m = (at.x_m - middle.x_m) * cos + (at.y_m - middle.y_m) * sin;
    Some(Foot {
        x_m: at.x_m,
        y_m: at.y_m,
        bearing_rad,
        distance_m: sum_m / count - nearer_m,
        width_rad,
    })
}

#[expect(clippy::cast_possible_truncation, reason = "below the count of echoes")]
fn small(index: usize) -> u8 {
    index as u8
}
