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
//! A surface is heard over the width of the beam. What is heard over a few degrees alone, with a
//! jump or a gap on both sides, is mostly sound that went round, and is left out of the map: in
//! real scans 3 % of the echoes, of which five in six lay more than 5 cm from every wall.
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
use super::pose::Correction;
use super::range::Beam;
use crate::units::count;

/// Echoes of one valley at most: more than a sweep of a degree a reading has over any surface.
const ECHOES: usize = 128;
/// Ranges of one region differ by no more than this, metres: readings are whole centimetres.
const CONSTANT_M: f64 = 0.015;
/// A valley's rim is higher than its bottom by this, metres.
const RIM_M: f64 = 0.04;
/// A region narrower than this is no region, radians: 15°. A surface that echoes is heard over the
/// whole width of the beam.
const NARROWEST_RAD: f64 = 0.26;
/// A whole valley narrower than this is no surface's, radians: 5°.
const STRAY_RAD: f64 = 0.087;
/// A sensor that has moved by less stood, metres: one that is driven past a surface need not turn.
const STOOD_M: f64 = 0.05;
/// A region wider than this is more than one surface, radians: 100°.
const WIDEST_RAD: f64 = 1.75;
/// Bearings nearer than this to each other are the same, radians: 1°.
const SAME_RAD: f64 = 0.0174;
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
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
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
    /// Whether it is narrower than any surface can be heard: sound that went round.
    pub stray: bool,
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
        let turned_rad = self.last_rad.replace(bearing_rad).map_or(0.0, |last| bearing_rad - last);
        let turned_back = self.turn(turned_rad);
        let Range::Echo(range_m) = range else {
            self.missed = self.missed.saturating_add(1);
            // One missing echo may be a sensor's whim; two are a gap.
            let over = (self.missed == 2 || turned_back).then(|| self.end(!turned_back));
            return (0.0, over.flatten());
        };
        if self.missed > 1 || turned_rad.abs() > bearing::SWEEP_RAD {
            self.slope = Slope::default();
        }
        let off_rad =
            self.slope.off_axis_rad(beam, bearing_rad, range_m, turned_rad, half_cone_rad);
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

    /// Moves what waits with the map.
    pub(super) fn correct(&mut self, correction: &Correction) {
        self.echoes.iter_mut().for_each(|echo| echo.correct(correction));
        self.last_rad.iter_mut().for_each(|last_rad| correction.turn(last_rad));
        self.slope.correct(correction);
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
            if turned_back || turned_rad.abs() > bearing::SWEEP_RAD {
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
        let echoes: ArrayVec<Echo, ECHOES> =
            self.echoes.drain(..count.min(self.echoes.len())).collect();
        let first = self.echoes.first().copied();
        let heights = first
            .map(|first| self.echoes.iter().map(move |echo| echo.reduced_m(first.x_m, first.y_m)));
        self.lowest_m = heights.map_or(0.0, |heights| heights.fold(f64::INFINITY, f64::min));
        self.rim = None;
        let foot = foot(&echoes, self.begun, end_seen);
        let stray = self.begun && end_seen && is_narrow(&echoes);
        (!echoes.is_empty()).then_some(Valley { echoes, foot, stray })
    }
}

impl Echo {
    fn correct(&mut self, correction: &Correction) {
        correction.apply(&mut self.x_m, &mut self.y_m, &mut self.bearing_rad);
    }

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

impl Foot {
    /// Moves it with the map.
    pub(super) fn correct(&mut self, correction: &Correction) {
        correction.apply(&mut self.x_m, &mut self.y_m, &mut self.bearing_rad);
    }
}

impl Valley {
    /// Moves it with the map.
    pub(super) fn correct(&mut self, correction: &Correction) {
        self.echoes.iter_mut().for_each(|echo| echo.correct(correction));
        self.foot.iter_mut().for_each(|foot| foot.correct(correction));
    }
}

/// Whether the head alone passed what echoed, within [`STRAY_RAD`].
fn is_narrow(echoes: &[Echo]) -> bool {
    let (Some(first), Some(last)) = (echoes.first(), echoes.last()) else { return false };
    (last.bearing_rad - first.bearing_rad).abs() < STRAY_RAD
        && (last.x_m - first.x_m).abs() + (last.y_m - first.y_m).abs() < STOOD_M
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
    let steps = count(region.len() - 1);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::{degrees, radians};

    const HALF_RAD: f64 = 14.0 * std::f64::consts::PI / 180.0;
    const STEP_NS: i64 = 50_000_000;

    /// What a sensor at the origin hears of a wall at a distance in front of it, whose cone has 14°
    /// and which echoes up to an incidence of 32°.
    fn wall(distance_m: f64, aside_deg: f64) -> Range {
        let nearest_deg = (aside_deg.abs() - 14.0).max(0.0);
        if nearest_deg > 32.0 {
            Range::NoEcho
        } else {
            Range::Echo(distance_m / libm::cos(radians(nearest_deg)))
        }
    }

    /// The valleys of a sweep over these bearings, the last one at its end.
    fn sweep(bearings_deg: &[f64], hear: impl Fn(f64) -> Range) -> Vec<Valley> {
        let mut sweep = Sweep::default();
        let mut valleys = Vec::new();
        for (at, bearing_deg) in (0..).zip(bearings_deg) {
            let bearing_rad = radians(*bearing_deg);
            let (sin, cos) = libm::sincos(bearing_rad);
            let beam = Beam { x_m: 0.0, y_m: 0.0, cos, sin };
            let range = hear(*bearing_deg);
            valleys.extend(sweep.take(at * STEP_NS, &beam, bearing_rad, range, HALF_RAD).1);
        }
        valleys.extend(sweep.end(false));
        valleys
    }

    fn bearings(from_deg: f64, step_deg: f64, count: u32) -> Vec<f64> {
        (0..count).map(|step| f64::from(step) * step_deg + from_deg).collect()
    }

    #[test]
    fn a_wall_swept_past_has_its_foot_where_it_stands_square() {
        for (step_deg, count) in [(1.0_f64, 180), (4.3, 42), (-4.3, 42)] {
            let from_deg = -90.0 * step_deg.signum();
            let valleys = sweep(&bearings(from_deg, step_deg, count), |deg| wall(0.8, deg - 10.0));
            assert_eq!(valleys.len(), 1, "steps of {step_deg} degrees");
            let foot = valleys[0].foot.expect("a foot");
            let off_deg = degrees(foot.bearing_rad) - 10.0;
            assert!(off_deg.abs() < 2.5, "off by {off_deg} degrees in steps of {step_deg}");
            assert!((foot.distance_m - 0.8).abs() < 0.01, "{foot:?}");
            // The cone, and what a reading of 1.5 cm more lies beside it.
            assert!((28.0..52.0).contains(&degrees(foot.width_rad)), "{foot:?}");
        }
    }

    #[test]
    fn a_corner_between_two_walls_is_two_feet() {
        let nearer = |deg: f64| match (wall(0.8, deg), wall(0.9, deg - 90.0)) {
            (Range::Echo(one), Range::Echo(other)) => Range::Echo(one.min(other)),
            (Range::Echo(one), _) | (_, Range::Echo(one)) => Range::Echo(one),
            _ => Range::NoEcho,
        };
        let valleys = sweep(&bearings(-80.0, 4.3, 60), nearer);
        let feet: Vec<f64> =
            valleys.iter().filter_map(|valley| Some(degrees(valley.foot?.bearing_rad))).collect();
        assert_eq!(feet.len(), 2, "{feet:?}");
        assert!(feet[0].abs() < 3.0 && (feet[1] - 90.0).abs() < 3.0, "{feet:?}");
    }

    #[test]
    fn a_jump_ends_a_valley_and_its_region_with_it() {
        // A narrow thing in front of a wall: its region is the cone.
        let valleys = sweep(&bearings(-60.0, 4.3, 28), |deg| match deg {
            -14.0..14.0 => Range::Echo(0.4),
            _ => wall(1.0, deg),
        });
        let feet: Vec<Foot> = valleys.iter().filter_map(|valley| valley.foot).collect();
        assert_eq!(feet.len(), 1, "{valleys:?}");
        assert!(
            (feet[0].distance_m - 0.4).abs() < 1e-9 && degrees(feet[0].bearing_rad).abs() < 3.0
        );
        assert_eq!(valleys.len(), 3, "{valleys:?}");
    }

    #[test]
    fn one_missing_echo_is_a_whim_and_two_are_a_gap() {
        for (missing, valleys) in [(vec![20], 1), (vec![20, 21], 2)] {
            let bearings = bearings(-80.0, 4.3, 40);
            let gone: Vec<f64> = missing.iter().map(|at: &usize| bearings[*at]).collect();
            let hear = |deg| if gone.contains(&deg) { Range::NoEcho } else { wall(0.8, deg) };
            assert_eq!(sweep(&bearings, hear).len(), valleys, "{missing:?}");
        }
    }

    #[test]
    fn an_echo_with_nothing_on_both_sides_is_a_stray_unless_the_sensor_was_driven_there() {
        for (driven_m, stray) in [(0.0, true), (0.1, false)] {
            let mut sweep = Sweep::default();
            let mut over = Vec::new();
            for (at, heard) in (0_i64..).zip([false, false, true, true, false, false]) {
                let range = if heard { Range::Echo(0.8) } else { Range::NoEcho };
                let y_m = if at > 2 { driven_m } else { 0.0 };
                let beam = Beam { x_m: 0.0, y_m, cos: 1.0, sin: 0.0 };
                let bearing_rad = radians(2.0 * at as f64);
                over.extend(sweep.take(at * STEP_NS, &beam, bearing_rad, range, HALF_RAD).1);
            }
            assert_eq!(over.len(), 1);
            assert_eq!(over[0].stray, stray, "{driven_m} m");
        }
    }

    #[test]
    fn a_head_that_turns_back_has_not_seen_the_end() {
        let mut to_and_fro = bearings(-80.0, 4.3, 20);
        to_and_fro.extend(bearings(1.0, -4.3, 20));
        let valleys = sweep(&to_and_fro, |deg| wall(0.8, deg));
        assert_eq!(valleys.len(), 2);
        assert!(valleys[0].foot.is_none(), "{:?}", valleys[0].foot);
    }

    proptest::proptest! {
        /// Whatever is heard, each echo comes out once and in order, and feet are finite.
        #[test]
        fn every_echo_comes_out_once(
            heard in proptest::collection::vec((-40.0..40.0, 0.0..3.0, 0..4), 1..400)
        ) {
            let mut sweep = Sweep::default();
            let (mut bearing_rad, mut valleys, mut echoes) = (0.0, Vec::new(), Vec::new());
            for (at, (turned_deg, range_m, missed)) in (0_i64..).zip(heard) {
                bearing_rad += radians(turned_deg);
                let (sin, cos) = libm::sincos(bearing_rad);
                let beam = Beam { x_m: range_m, y_m: -range_m, cos, sin };
                let range = if missed == 0 { Range::NoEcho } else { Range::Echo(range_m) };
                let time_ns = at * STEP_NS;
                if missed != 0 {
                    echoes.push(time_ns);
                }
                let (off_rad, over) = sweep.take(time_ns, &beam, bearing_rad, range, HALF_RAD);
                proptest::prop_assert!(off_rad.abs() <= HALF_RAD);
                valleys.extend(over);
            }
            valleys.extend(sweep.end(false));
            let out: Vec<i64> = valleys
                .iter()
                .flat_map(|valley| valley.echoes.iter().map(|echo| echo.time_ns))
                .collect();
            proptest::prop_assert_eq!(out, echoes);
            for foot in valleys.iter().filter_map(|valley| valley.foot) {
                let numbers = [foot.x_m, foot.y_m, foot.bearing_rad, foot.distance_m];
                proptest::prop_assert!(numbers.iter().all(|number| number.is_finite()));
                proptest::prop_assert!((NARROWEST_RAD..WIDEST_RAD).contains(&foot.width_rad));
            }
        }
    }
}
