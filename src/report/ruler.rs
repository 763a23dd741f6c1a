//! Where an axis is marked, and what its marks are called.

/// An axis: from where to where it goes, and its marks' distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ruler {
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) step: f64,
}

/// No axis has more marks.
const MOST_MARKS: usize = 100;

impl Ruler {
    /// An axis with about this many marks.
    pub(super) fn over(low: f64, high: f64, marks: f64) -> Self {
        Self { low, high, step: Self::step((high - low) / marks) }
    }

    /// The least of 1, 2 or 5 times a power of ten that is not below `wanted`.
    pub(super) fn step(wanted: f64) -> f64 {
        let ten = libm::pow(10.0, libm::floor(libm::log10(wanted)));
        let mut steps = [1.0, 2.0, 5.0].map(|times| times * ten).into_iter();
        steps.find(|step| *step >= wanted).unwrap_or(10.0 * ten)
    }

    /// The marks: multiples of the step.
    pub(super) fn marks(self) -> Vec<f64> {
        let mut at = libm::ceil(self.low / self.step);
        let last = libm::floor(self.high / self.step);
        let mut marks = Vec::new();
        while at <= last && marks.len() < MOST_MARKS {
            marks.push(at * self.step);
            at += 1.0;
        }
        marks
    }

    /// A mark's value with the digits that it needs.
    pub(super) fn label(self, value: f64) -> String {
        let mut decimals = 0;
        let mut step = self.step;
        while step < 0.999_999 && decimals < 9 {
            step *= 10.0;
            decimals += 1;
        }
        // Minus zero plus zero is zero, without the sign.
        format!("{:.decimals$}", value + 0.0)
    }
}
