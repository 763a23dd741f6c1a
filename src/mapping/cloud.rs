//! Points and paths in a fixed amount of memory.
//!
//! A list that is full drops every second entry and from then on takes every second of what is
//! offered: a mission of hours is kept as evenly as one of minutes, only more coarsely.

use super::{MapPoint, Pose, room};

/// A list with a limit.
#[derive(Debug, Clone)]
pub(super) struct Thinned<T> {
    kept: Vec<T>,
    limit: usize,
    /// One of this many offered points is kept.
    stride: u64,
    offered: u64,
}

impl<T: Copy + Default> Thinned<T> {
    /// An empty list with room for `limit` entries (two at least), taken at once.
    pub(super) fn new(limit: usize) -> Self {
        Self::with_tail(limit, 0)
    }

    /// The same with room for what stands behind the list.
    fn with_tail(limit: usize, tail: usize) -> Self {
        let limit = limit.max(2);
        Self { kept: room::reserved(limit + tail), limit, stride: 1, offered: 0 }
    }

    pub(super) fn offer(&mut self, entry: T) {
        self.insert(entry, self.kept.len());
    }

    /// Offers an entry to the list's first `count`; what stands behind stays behind.
    fn insert(&mut self, entry: T, mut count: usize) {
        let due = |list: &Self| list.offered.is_multiple_of(list.stride);
        if due(self) && count == self.limit {
            let mut index = 0;
            self.kept.retain(|_| {
                index += 1;
                index % 2 == 1 || index > count
            });
            count = count.div_ceil(2);
            self.stride = self.stride.saturating_mul(2);
        }
        if due(self) {
            self.kept.insert(count, entry);
        }
        self.offered = self.offered.wrapping_add(1);
    }

    pub(super) fn kept(&self) -> &[T] {
        &self.kept
    }

    pub(super) fn stride(&self) -> u64 {
        self.stride
    }
}

/// The points of a map: those that have their place, thinned, and behind them those that wait for
/// theirs, where they are taken to be so far.
#[derive(Debug, Clone)]
pub(super) struct Cloud {
    points: Thinned<MapPoint>,
    waiting: usize,
}

/// Points that wait at most; the oldest is then as good as placed.
const WAITING: usize = 512;

impl Cloud {
    pub(super) fn new(limit: usize) -> Self {
        Self { points: Thinned::with_tail(limit, WAITING), waiting: 0 }
    }

    /// A point that waits.
    pub(super) fn expect(&mut self, point: MapPoint) {
        if self.waiting == WAITING {
            let first = self.points.kept.remove(self.points.kept.len() - self.waiting);
            self.waiting -= 1;
            self.keep(first);
        }
        self.points.kept.push(point);
        self.waiting += 1;
    }

    /// A point that has its place; what waited before it is gone.
    pub(super) fn place(&mut self, point: MapPoint) {
        let first = self.points.kept.len() - self.waiting;
        let passed = |waiting: &MapPoint| waiting.time_ns <= point.time_ns;
        let count = self.points.kept.iter().skip(first).take_while(|point| passed(point)).count();
        self.points.kept.drain(first..first + count);
        self.waiting -= count;
        self.keep(point);
    }

    /// Gives up what still waits.
    pub(super) fn finish(&mut self) {
        self.points.kept.truncate(self.points.kept.len() - self.waiting);
        self.waiting = 0;
    }

    fn keep(&mut self, point: MapPoint) {
        let tail = self.points.kept.len() - self.waiting;
        self.points.insert(point, tail);
    }

    pub(super) fn all(&self) -> &[MapPoint] {
        self.points.kept()
    }

    pub(super) fn stride(&self) -> u64 {
        self.points.stride()
    }
}

/// The way a robot took: places at least a centimetre apart.
#[derive(Debug, Clone)]
pub(super) struct Path {
    places: Thinned<MapPoint>,
    last: Option<MapPoint>,
}

/// The least distance between places, metres.
const SPACING_M: f64 = 0.01;

impl Path {
    pub(super) fn new(limit: usize) -> Self {
        Self { places: Thinned::new(limit), last: None }
    }

    pub(super) fn offer(&mut self, time_ns: i64, pose: &Pose) {
        let (x_m, y_m) = (pose.x_m, pose.y_m);
        let moved = self.last.is_none_or(|last| {
            let (dx_m, dy_m) = (x_m - last.x_m, y_m - last.y_m);
            dx_m * dx_m + dy_m * dy_m >= SPACING_M * SPACING_M
        });
        if moved {
            let place = MapPoint { time_ns, x_m, y_m };
            self.last = Some(place);
            self.places.offer(place);
        }
    }

    pub(super) fn places(&self) -> &[MapPoint] {
        self.places.kept()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_list_keeps_entries_evenly_from_first_to_last() {
        let mut list = Thinned::new(8);
        for entry in 0..1000 {
            list.offer(entry);
        }
        let kept = list.kept();
        assert!(kept.len() <= 8 && kept.len() >= 4, "{kept:?}");
        assert_eq!(list.stride(), 128);
        let even: Vec<i32> = (0..).step_by(128).take(kept.len()).collect();
        assert_eq!(kept, even);
    }

    #[test]
    fn a_list_asked_to_hold_nothing_still_works() {
        let mut list = Thinned::new(0);
        for entry in 0..100 {
            list.offer(entry);
        }
        assert!(!list.kept().is_empty() && list.kept().len() <= 2, "{:?}", list.kept());
    }

    #[test]
    fn a_robot_that_turns_in_place_leaves_one_place() {
        let mut path = Path::new(100);
        for tick in 0..50 {
            path.offer(tick, &Pose { x_m: 0.001, ..Pose::default() });
        }
        path.offer(50, &Pose { x_m: 0.02, ..Pose::default() });
        assert_eq!(path.places().len(), 2, "{:?}", path.places());
    }
}
