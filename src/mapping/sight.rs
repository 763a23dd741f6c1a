//! A point of the map with the place that it was seen from.
//!
//! # Not here
//!
//! The reading that it is of (`sounding`).

use super::{MapPoint, Pose};

/// Something that was found, and from where; world frame, metres.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sight {
    /// The point.
    pub at_m: [f64; 2],
    /// Where the robot was.
    pub from_m: [f64; 2],
}

impl Sight {
    /// The same in the frame in which its own frame's origin has the pose `by`.
    pub(super) fn moved(&self, by: &Pose) -> Self {
        let [at_m, from_m] = [self.at_m, self.from_m].map(|[x_m, y_m]| by.place(x_m, y_m));
        Self { at_m, from_m }
    }

    /// The points of a map with the places that they were seen from.
    ///
    /// - `path`: where the robot was, in the order of time; a point was seen from the last place
    ///   that is not later than it. Without a path there are no sights.
    #[must_use]
    pub fn of(points: &[MapPoint], path: &[MapPoint]) -> Vec<Self> {
        let from = |time_ns: i64| {
            let after = path.partition_point(|place| place.time_ns <= time_ns);
            path.get(after.saturating_sub(1))
        };
        points
            .iter()
            .filter_map(|point| {
                let from = from(point.time_ns)?;
                Some(Self { at_m: [point.x_m, point.y_m], from_m: [from.x_m, from.y_m] })
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_seen_from_the_last_place_before_them() {
        let at = |time_ns: i64, x_m: f64| MapPoint { time_ns, x_m, y_m: 0.0 };
        let seen = Sight::of(&[at(0, 9.0), at(15, 9.0)], &[at(5, 1.0), at(10, 2.0), at(20, 3.0)]);
        let sights = [1.0, 2.0].map(|x_m| Sight { at_m: [9.0, 0.0], from_m: [x_m, 0.0] });
        assert_eq!(seen, sights);
        assert_eq!(Sight::of(&[at(0, 9.0)], &[]), []);
    }
}
