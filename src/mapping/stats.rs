//! A few statistics of errors: for scoring maps, not for the tick.

use crate::units::count;

/// The value below which a share `q` (0 to 1) of the values lies, linear between neighbours
/// (Hyndman and Fan's type 7, as in NumPy); sorts them. `None` if there are none.
#[must_use]
pub fn quantile(values: &mut [f64], q: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    let place = q.clamp(0.0, 1.0) * count(last);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "between 0 and the last index"
    )]
    let below = libm::floor(place) as usize;
    let low = *values.get(below)?;
    let high = *values.get((below + 1).min(last))?;
    Some(low + (high - low) * (place - libm::floor(place)))
}

/// The middle value; sorts them. `None` if there are none.
#[must_use]
pub fn median(values: &mut [f64]) -> Option<f64> {
    quantile(values, 0.5)
}

/// The mean. `None` if there are none.
#[must_use]
pub fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / count(values.len()))
}

/// The root of the mean square. `None` if there are none.
#[must_use]
pub fn rms(values: &[f64]) -> Option<f64> {
    let squares: Vec<f64> = values.iter().map(|value| value * value).collect();
    mean(&squares).map(libm::sqrt)
}

/// The share, 0 to 1, of the values for which `holds`. `None` if there are none.
#[must_use]
pub fn share(values: &[f64], holds: impl Fn(f64) -> bool) -> Option<f64> {
    let held = values.iter().filter(|&&value| holds(value)).count();
    (!values.is_empty()).then(|| count(held) / count(values.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_has_no_statistics() {
        assert_eq!(median(&mut []), None);
        assert_eq!(mean(&[]), None);
        assert_eq!(rms(&[]), None);
        assert_eq!(share(&[], |_| true), None);
    }

    #[test]
    fn quantiles_are_those_of_numpy() {
        let mut values = [4.0, 1.0, 3.0, 2.0];
        assert_eq!(median(&mut values), Some(2.5));
        assert!((quantile(&mut values, 0.9).unwrap() - 3.7).abs() < 1e-12);
        assert_eq!(quantile(&mut values, 1.0), Some(4.0));
        assert_eq!(quantile(&mut values, 0.0), Some(1.0));
        assert_eq!(quantile(&mut [7.0], 0.9), Some(7.0));
    }

    #[test]
    fn mean_rms_and_share_of_three_and_four() {
        assert_eq!(mean(&[3.0, 4.0]), Some(3.5));
        assert!((rms(&[3.0, 4.0]).unwrap() - libm::sqrt(12.5)).abs() < 1e-12);
        assert_eq!(share(&[3.0, 4.0], |value| value < 3.5), Some(0.5));
    }
}
