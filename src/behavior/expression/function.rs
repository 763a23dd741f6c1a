//! The functions of the language: one table.

use crate::behavior::blackboard::Scope;
use crate::behavior::signals::Signal;
use crate::units::{degrees, radians};

/// A function of the language.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Function {
    Abs,
    Sqrt,
    Round,
    Floor,
    Sign,
    Min,
    Max,
    Clamp,
    Sin,
    Cos,
    Atan2,
    WrapDeg,
    DistanceM,
    BearingDeg,
    Random,
    Pid,
}

/// Each function, how it is written, and how many arguments it takes; a `pid` without `most` is one
/// with an infinite one.
#[rustfmt::skip]
pub(super) const FUNCTIONS: [(Function, &str, usize); 16] = {
    use Function as F;
    [
        (F::Abs,        "abs(a)",                 1),
        (F::Sqrt,       "sqrt(a)",                1),
        (F::Round,      "round(a)",               1),
        (F::Floor,      "floor(a)",               1),
        (F::Sign,       "sign(a)",                1),
        (F::Min,        "min(a, b)",              2),
        (F::Max,        "max(a, b)",              2),
        (F::Clamp,      "clamp(a, low, high)",    3),
        (F::Sin,        "sin(deg)",               1),
        (F::Cos,        "cos(deg)",               1),
        (F::Atan2,      "atan2(y, x)",            2),
        (F::WrapDeg,    "wrap_deg(deg)",          1),
        (F::DistanceM,  "distance_m(x, y)",       2),
        (F::BearingDeg, "bearing_deg(x, y)",      2),
        (F::Random,     "random(a, b)",           2),
        (F::Pid,        "pid(error, kp, ki, kd, most)", 5),
    ]
};

/// The most arguments that a function takes.
const MOST: usize = 5;

impl Function {
    /// The function of a name.
    pub(super) fn named(name: &str) -> Option<Self> {
        FUNCTIONS.iter().map(|row| row.0).find(|function| function.name() == name)
    }

    pub(super) fn name(self) -> &'static str {
        let usage = self.usage();
        usage.split_once('(').map_or(usage, |(name, _)| name)
    }

    /// How it is written.
    pub(super) fn usage(self) -> &'static str {
        FUNCTIONS[self as usize].1
    }

    /// How many arguments it takes; `min` and `max` of more are made of those of two.
    pub(super) fn takes(self) -> usize {
        FUNCTIONS[self as usize].2
    }

    /// Whether it takes any number of arguments from two on.
    pub(super) fn is_open(self) -> bool {
        matches!(self, Self::Min | Self::Max)
    }

    /// Whether the same arguments always give the same.
    pub(super) fn is_pure(self) -> bool {
        !matches!(self, Self::DistanceM | Self::BearingDeg | Self::Random | Self::Pid)
    }

    /// The value; `None` where an argument or the robot's place is not known.
    pub(super) fn of(self, arguments: &[Option<f64>], slot: u32, scope: Scope<'_>) -> Option<f64> {
        let mut known = [0.0; MOST];
        for (known, argument) in known.iter_mut().zip(arguments) {
            *known = (*argument)?;
        }
        let [a, b, c, d, e] = known;
        Some(match self {
            Self::Abs => a.abs(),
            Self::Sqrt => libm::sqrt(a),
            Self::Round => libm::round(a),
            Self::Floor => libm::floor(a),
            Self::Sign => sign(a),
            Self::Min => least(a, b),
            Self::Max => -least(-a, -b),
            Self::Clamp => -least(-least(a, c), -b),
            Self::Sin => libm::sin(radians(a)),
            Self::Cos => libm::cos(radians(a)),
            Self::Atan2 => degrees(libm::atan2(a, b)),
            Self::WrapDeg => wrap_deg(a),
            Self::DistanceM => {
                // `hypot` guards against squares that overflow, which takes five times as long.
                let [x_m, y_m] = way([a, b], scope)?;
                libm::sqrt(x_m * x_m + y_m * y_m)
            }
            Self::BearingDeg => {
                let [x_m, y_m] = way([a, b], scope)?;
                let heading_rad = scope.board.signals.get(Signal::Heading)?;
                wrap_deg(degrees(libm::atan2(y_m, x_m) - heading_rad))
            }
            Self::Random => a + (b - a) * scope.random(slot),
            Self::Pid => scope.pid(slot, a, [b, c, d], e),
        })
    }
}

/// From the robot to a place, along the world's x and y.
fn way([x_m, y_m]: [f64; 2], scope: Scope<'_>) -> Option<[f64; 2]> {
    let signals = &scope.board.signals;
    Some([x_m - signals.get(Signal::X)?, y_m - signals.get(Signal::Y)?])
}

/// The lesser of two; NaN where one of them is.
fn least(a: f64, b: f64) -> f64 {
    if a.is_nan() || a < b { a } else { b }
}

fn sign(a: f64) -> f64 {
    if a > 0.0 {
        1.0
    } else if a < 0.0 {
        -1.0
    } else {
        // 0 and NaN.
        a
    }
}

fn wrap_deg(deg: f64) -> f64 {
    // Most are wrapped already, and dividing is slow on the brick.
    if (-180.0..180.0).contains(&deg) {
        return deg;
    }
    deg - 360.0 * libm::floor((deg + 180.0) / 360.0)
}
