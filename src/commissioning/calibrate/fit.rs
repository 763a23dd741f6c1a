//! From several measurements to one number, and how sure it is.

use std::fmt;

use serde::Serialize;

use crate::units;

/// The most that the mean may be unsure by, as a share of it: what calibration is for is one or two
/// percent.
const MOST_ERROR: f64 = 0.01;

/// The most that the two directions may differ by, as a share.
const MOST_DIFFERENCE: f64 = 0.03;

/// Beyond this ratio to the old number it is no correction, but another robot.
const MOST_CHANGE: f64 = 2.0;

/// The most that an offset may be unsure by, metres; that its directions may differ by; and that it
/// may be.
const MOST_OFFSET_ERROR_M: f64 = 0.005;
const MOST_OFFSET_DIFFERENCE_M: f64 = 0.02;
const MOST_OFFSET_M: f64 = 0.15;

/// Fewer measurements have no spread worth the name.
const FEWEST: usize = 3;

/// One number, measured several times.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measured {
    /// What the robot's file had.
    pub before: f64,
    /// The mean of all measurements.
    pub after: f64,
    /// The standard error of the mean.
    pub standard_error: f64,
    /// From the smallest measurement to the largest.
    pub spread: f64,
    /// Means of the two directions: ahead and back, or anticlockwise and clockwise.
    pub directions: [f64; 2],
    /// How many measurements there were.
    pub count: usize,
    /// The share by which all measurements may be off together, which no spread shows: a gyro's own
    /// scale.
    pub unseen: f64,
    /// What kind of number it is.
    pub kind: Kind,
    /// Why the number should not be trusted, if it should not.
    pub doubt: Option<Doubt>,
}

/// What kind of number is measured; what is sure enough goes by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Metres, unsure by a share.
    Length,
    /// A number without a unit, unsure by a share.
    Ratio,
    /// Metres about 0, unsure by millimetres.
    Offset,
}

/// Why a number should not be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, thiserror::Error)]
#[non_exhaustive]
pub enum Doubt {
    /// There are not enough measurements.
    #[error(
        "only {} {were} good; {FEWEST} are needed: more space, a plainer wall, and try again",
        units::counted(*.0, "measurement"), were = if *.0 == 1 { "was" } else { "were" }
    )]
    TooFew(usize),
    /// The measurements scatter.
    #[error(
        "the measurements scatter: the mean is unsure by {percent:.1} %, at most {limit:.0} % will \
         do; a firmer floor, a plainer wall, more repeats (--pairs)",
        percent = .0 * 100.0, limit = MOST_ERROR * 100.0
    )]
    Scatter(f64),
    /// The two directions do not agree.
    #[error(
        "the two directions differ by {percent:.1} %: a wheel slips, the gyro drifts, or the \
         caster binds; look at the robot and try again",
        percent = .0 * 100.0
    )]
    Directions(f64),
    /// The number is far from the old one.
    #[error(
        "it is {0:.2} times what the file says: look at ports and gears in robot.toml first \
         (onbrick setup)"
    )]
    Far(f64),
    /// A gyro's scale that no gyro has: a person marked something else than whole turns.
    #[error(
        "the gyro would say {degrees:.0} degrees for a whole turn: mark again, and press Enter \
         only when the robot stands along the line",
        degrees = .0 * 360.0
    )]
    Marks(f64),
    /// The measurements of an offset scatter.
    #[error(
        "the measurements scatter: the mean is unsure by {mm:.0} mm, at most {limit:.0} mm will \
         do; a plainer wall, more repeats (--pairs)",
        mm = .0 * 1000.0, limit = MOST_OFFSET_ERROR_M * 1000.0
    )]
    Unsure(f64),
    /// An offset differs from one direction to the other.
    #[error(
        "the two directions differ by {mm:.0} mm: a wheel slips, or the wall is not plain",
        mm = .0 * 1000.0
    )]
    Apart(f64),
    /// An offset that no sensor has.
    #[error(
        "it reads {cm:.0} cm off: measure from the middle between the wheels, and look at ahead_m \
         in robot.toml",
        cm = .0 * 100.0
    )]
    Off(f64),
}

impl Measured {
    /// Puts the measurements of the two directions together. What is not finite does not count.
    ///
    /// The standard error is that of the mean, `s / √n` with the sample deviation `s`, which holds
    /// the difference of the directions too.
    #[must_use]
    pub fn of(before: f64, directions: [&[f64]; 2]) -> Self {
        Self::new(Kind::Length, before, directions)
    }

    /// The same of any kind.
    #[must_use]
    pub(super) fn new(kind: Kind, before: f64, directions: [&[f64]; 2]) -> Self {
        let [ahead, back] = directions.map(finite);
        let all: Vec<f64> = ahead.iter().chain(&back).copied().collect();
        let count = all.len();
        let after = mean(&all);
        let squares: f64 = all.iter().map(|value| (value - after) * (value - after)).sum();
        let standard_error = if count > 1 {
            libm::sqrt(squares / units::count(count - 1)) / libm::sqrt(units::count(count))
        } else {
            f64::INFINITY
        };
        let least = all.iter().copied().fold(f64::INFINITY, f64::min);
        let most = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let spread = if count > 0 { most - least } else { 0.0 };
        let directions = [mean(&ahead), mean(&back)];
        let mut measured = Self {
            before,
            after,
            standard_error,
            spread,
            directions,
            count,
            unseen: 0.0,
            kind,
            doubt: None,
        };
        measured.doubt = measured.doubt();
        measured
    }

    /// The same number times a factor that is itself unsure by a share: relative errors add in
    /// squares.
    #[must_use]
    pub(super) fn scaled(mut self, factor: f64, relative_error: f64) -> Self {
        let own = self.standard_error / self.after;
        self.after *= factor;
        self.spread *= factor;
        self.directions = self.directions.map(|mean| mean * factor);
        self.standard_error = self.after * libm::sqrt(own * own + relative_error * relative_error);
        self.doubt = self.doubt();
        self
    }

    fn offset_doubt(&self) -> Option<Doubt> {
        let [ahead, back] = self.directions;
        let difference_m = (ahead - back).abs();
        if self.after.abs() > MOST_OFFSET_M {
            Some(Doubt::Off(self.after))
        } else if difference_m > MOST_OFFSET_DIFFERENCE_M {
            Some(Doubt::Apart(difference_m))
        } else if self.standard_error > MOST_OFFSET_ERROR_M {
            Some(Doubt::Unsure(self.standard_error))
        } else {
            None
        }
    }

    fn doubt(&self) -> Option<Doubt> {
        if self.count < FEWEST {
            return Some(Doubt::TooFew(self.count));
        }
        if self.kind == Kind::Offset {
            return self.offset_doubt();
        }
        let change = self.after / self.before;
        let error = self.standard_error / self.after.abs();
        let [ahead, back] = self.directions;
        let difference = ((ahead - back) / self.after).abs();
        if !(1.0 / MOST_CHANGE..=MOST_CHANGE).contains(&change) {
            Some(Doubt::Far(change))
        } else if difference > MOST_DIFFERENCE {
            Some(Doubt::Directions(difference))
        } else if error > MOST_ERROR {
            Some(Doubt::Scatter(error))
        } else {
            None
        }
    }
}

impl fmt::Display for Measured {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = if self.kind == Kind::Ratio { "" } else { " m" };
        write!(
            f,
            "{:.4}{unit} ± {:.4} (was {:.4}; {}, {:.4} from the smallest to the \
             largest, {:.4} and {:.4} in the two directions)",
            self.after,
            self.standard_error,
            self.before,
            units::counted(self.count, "measurement"),
            self.spread,
            self.directions[0],
            self.directions[1]
        )?;
        if self.unseen > 0.0 {
            let percent = units::rounded_to(self.unseen * 100.0, 10.0);
            write!(f, "; all of them may be off together by {percent} %")?;
        }
        Ok(())
    }
}

/// The slope of `y` over `x` by least squares, after points far off the line were left out: a wrong
/// echo must not tilt it.
///
/// Three rounds; each leaves out what is farther from the line than three deviations, taken as
/// 1.4826 times the median distance (the usual robust estimate, Rousseeuw and Croux 1993), but
/// never what is within `noise`. `None` for fewer than `fewest` points that are left, or where x
/// does not vary.
#[must_use]
pub(super) fn slope(points: &[[f64; 2]], noise: f64, fewest: usize) -> Option<f64> {
    const DEVIATIONS: f64 = 3.0 * 1.4826;
    let mut kept: Vec<[f64; 2]> =
        points.iter().copied().filter(|[x, y]| x.is_finite() && y.is_finite()).collect();
    let mut line = median_line(&kept)?;
    for _ in 0..3 {
        let distance = |&[x, y]: &[f64; 2]| (y - line.0 - line.1 * x).abs();
        let limit = (DEVIATIONS * median(kept.iter().map(distance).collect())?).max(noise);
        kept.retain(|point| distance(point) <= limit);
        if kept.len() < fewest.max(2) {
            return None;
        }
        line = least_squares(&kept)?;
    }
    Some(line.1)
}

/// Intercept and slope by least squares.
fn least_squares(points: &[[f64; 2]]) -> Option<(f64, f64)> {
    let number = units::count(points.len());
    let middle_x = points.iter().map(|[x, _]| x).sum::<f64>() / number;
    let middle_y = points.iter().map(|[_, y]| y).sum::<f64>() / number;
    let across: f64 = points.iter().map(|[x, y]| (x - middle_x) * (y - middle_y)).sum();
    let along: f64 = points.iter().map(|[x, _]| (x - middle_x) * (x - middle_x)).sum();
    let slope = across / along;
    (along > 0.0 && slope.is_finite()).then_some((middle_y - slope * middle_x, slope))
}

/// A line that up to a fourth of wrong points cannot tilt, to begin with: the median of the slopes
/// between points half the list apart.
fn median_line(points: &[[f64; 2]]) -> Option<(f64, f64)> {
    let mut ordered = points.to_vec();
    ordered.sort_by(|[a, _], [b, _]| a.total_cmp(b));
    let (low, high) = ordered.split_at(ordered.len() / 2);
    let slopes = low.iter().zip(high).filter(|([x, _], [far, _])| far > x);
    let slope = median(slopes.map(|([x, y], [far, off])| (off - y) / (far - x)).collect())?;
    let intercept = median(ordered.iter().map(|[x, y]| y - slope * x).collect())?;
    Some((intercept, slope))
}

pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / units::count(values.len())
}

fn finite(values: &[f64]) -> Vec<f64> {
    values.iter().copied().filter(|value| value.is_finite()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn good_measurements_have_a_mean_and_no_doubt() {
        let measured = Measured::of(0.11, [&[0.120, 0.121, 0.119], &[0.1205, 0.1195, 0.120]]);
        assert!((measured.after - 0.12).abs() < 1e-9, "{measured}");
        // By hand: squares 0, 1, 1, 0.25, 0.25, 0 (in 1e-6), s = sqrt(2.5e-6 / 5), over sqrt(6).
        assert!(
            (measured.standard_error - libm::sqrt(2.5e-6 / 5.0 / 6.0)).abs() < 1e-9,
            "{measured}"
        );
        assert!((measured.spread - 0.002).abs() < 1e-9, "{measured}");
        assert_eq!(measured.doubt, None);
    }

    #[test]
    fn what_is_unsure_says_why() {
        let few = Measured::of(0.1, [&[0.1], &[0.1, f64::NAN]]);
        assert_eq!(few.doubt, Some(Doubt::TooFew(2)));
        let scattered = Measured::of(0.1, [&[0.10, 0.13, 0.07], &[0.10, 0.13, 0.07]]);
        assert!(matches!(scattered.doubt, Some(Doubt::Scatter(_))), "{scattered:?}");
        let slipping = Measured::of(0.1, [&[0.10, 0.10, 0.10], &[0.11, 0.11, 0.11]]);
        assert!(matches!(slipping.doubt, Some(Doubt::Directions(_))), "{slipping:?}");
        let other = Measured::of(0.1, [&[0.3, 0.3], &[0.3, 0.3]]);
        assert!(matches!(other.doubt, Some(Doubt::Far(_))), "{other:?}");
        let none = Measured::of(0.1, [&[], &[]]);
        assert_eq!(none.doubt, Some(Doubt::TooFew(0)));
    }

    #[test]
    fn an_offset_is_unsure_by_millimetres_and_not_by_a_share_of_itself() {
        let of =
            |ahead: &[f64], back: &[f64]| Measured::new(Kind::Offset, 0.0, [ahead, back]).doubt;
        assert_eq!(of(&[0.001, -0.002, 0.001], &[0.0, 0.002, -0.001]), None);
        assert!(matches!(of(&[0.03, -0.03], &[0.03, -0.03]), Some(Doubt::Unsure(_))));
        assert!(matches!(of(&[0.02, 0.02], &[-0.02, -0.02]), Some(Doubt::Apart(_))));
        assert!(matches!(of(&[0.2, 0.2], &[0.2, 0.2]), Some(Doubt::Off(_))));
        assert_eq!(of(&[0.01], &[f64::NAN]), Some(Doubt::TooFew(1)));
    }

    #[test]
    fn a_factor_that_is_unsure_makes_the_number_unsure() {
        let measured = Measured::of(0.1, [&[0.1, 0.1], &[0.1, 0.1]]);
        let scaled = measured.clone().scaled(1.02, 0.003);
        assert!(
            (scaled.after - 0.102).abs() < 1e-12
                && (scaled.standard_error - 0.102 * 0.003).abs() < 1e-9
        );
        assert!(matches!(measured.scaled(1.0, 0.05).doubt, Some(Doubt::Scatter(_))));
    }

    #[test]
    fn no_points_and_no_way_have_no_slope() {
        assert_eq!(slope(&[], 0.01, 3), None);
        assert_eq!(slope(&[[1.0, 2.0]; 9], 0.01, 3), None);
        assert_eq!(slope(&[[0.0, 1.0], [1.0, 2.0]], 0.01, 3), None);
        assert_eq!(slope(&[[f64::NAN, 1.0]; 9], 0.01, 3), None);
    }

    proptest! {
        #[test]
        fn the_slope_is_found_among_wrong_echoes(
            truth in -0.05..-0.01_f64,
            start in 0.3..1.5_f64,
            noise in proptest::collection::vec(-0.003..0.003_f64, 60),
            wrong in proptest::collection::vec((0..60_usize, 0.0..2.5_f64), 0..8),
        ) {
            let mut points: Vec<[f64; 2]> =
                noise.iter().zip(0_u32..).map(|(noise, step)| {
                    let x = f64::from(step) / 4.0;
                    [x, start + truth * x + noise]
                }).collect();
            for (place, range_m) in wrong {
                points[place][1] = range_m;
            }
            let found = slope(&points, 0.01, 10).unwrap();
            prop_assert!((found - truth).abs() < 0.0006, "{} instead of {}", found, truth);
        }
    }
}
