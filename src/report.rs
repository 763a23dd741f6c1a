//! Pictures and exports of finished runs; and the live page of a run or a simulation ([`live`]).
//!
//! A [`Scene`] is what there is to see of one or several runs: each robot's path and points, and
//! the walls where they are known. [`plot`] draws it as SVG, PNG, or as one HTML page with pan,
//! zoom and a time slider; [`export`] writes it for spreadsheets, point-cloud tools, Nav2 and ROS
//! viewers.
//!
//! # Not here
//!
//! No reading of worlds: the caller knows how a world becomes outlines. No files: everything is
//! made as text or bytes.
//!
//! # What we count on
//!
//! - A number that is not finite is not drawn and not exported.

pub mod export;
pub mod live;
mod page;
pub mod plot;

use crate::clock::seconds;
use crate::printable;
use crate::recording::Run;

/// What there is to see of one or several runs, in one world frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scene {
    /// What stands above the picture.
    pub title: String,
    /// Each run's path and points.
    pub tracks: Vec<Track>,
    /// Walls and obstacles as lines through points in metres; one that ends where it began is a
    /// closed shape.
    pub outlines: Vec<Vec<[f64; 2]>>,
}

/// One run's path and points.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Track {
    /// The robot's name.
    pub name: String,
    /// Where the robot was, in order of time.
    pub path: Vec<PathPoint>,
    /// What it found, in order of time.
    pub points: Vec<CloudPoint>,
    /// What a person should know about the recording; empty for one that is whole.
    pub warnings: Vec<String>,
}

/// Where a robot was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Seconds since the run's start.
    pub time_s: f64,
    /// Metres.
    pub x_m: f64,
    /// Metres.
    pub y_m: f64,
    /// Radians, not wrapped.
    pub heading_rad: f64,
}

/// Something that a robot found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudPoint {
    /// Seconds since the run's start.
    pub time_s: f64,
    /// Metres.
    pub x_m: f64,
    /// Metres.
    pub y_m: f64,
}

impl Track {
    /// The track of a run; `fallback` is its name where the recording has none.
    #[must_use]
    pub fn of_run(run: &Run, fallback: &str) -> Self {
        let start_ns = run
            .info
            .as_ref()
            .map(|info| info.start_ns)
            .or(run.poses.first().map(|pose| pose.time_ns))
            .unwrap_or(0);
        let since_start_s = |time_ns: i64| seconds(time_ns.saturating_sub(start_ns));
        let path = run.poses.iter().map(|recorded| PathPoint {
            time_s: since_start_s(recorded.time_ns),
            x_m: recorded.pose.x_m,
            y_m: recorded.pose.y_m,
            heading_rad: recorded.pose.heading_rad,
        });
        let points = run.points.iter().map(|point| CloudPoint {
            time_s: since_start_s(point.time_ns),
            x_m: point.x_m,
            y_m: point.y_m,
        });
        let name = run.info.as_ref().map(|info| info.brick.clone()).filter(|name| !name.is_empty());
        Self {
            name: name.unwrap_or_else(|| printable::line(fallback).into_owned()),
            path: path
                .filter(|p| [p.x_m, p.y_m, p.heading_rad].iter().all(|v| v.is_finite()))
                .collect(),
            points: points.filter(|p| p.x_m.is_finite() && p.y_m.is_finite()).collect(),
            warnings: run.warnings.clone(),
        }
    }
}

/// A rectangle in the world, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Bounds {
    low: [f64; 2],
    high: [f64; 2],
}

impl Scene {
    /// The least rectangle around everything; a metre around the origin where there is nothing.
    fn bounds(&self) -> Bounds {
        let paths = self.tracks.iter().flat_map(|track| track.path.iter().map(|p| [p.x_m, p.y_m]));
        let points =
            self.tracks.iter().flat_map(|track| track.points.iter().map(|p| [p.x_m, p.y_m]));
        let walls = self.outlines.iter().flatten().copied();
        let mut bounds = Bounds { low: [f64::INFINITY; 2], high: [f64::NEG_INFINITY; 2] };
        for place in
            paths.chain(points).chain(walls).filter(|place| place.iter().all(|v| v.is_finite()))
        {
            for (axis, value) in place.into_iter().enumerate() {
                bounds.low[axis] = bounds.low[axis].min(value);
                bounds.high[axis] = bounds.high[axis].max(value);
            }
        }
        if bounds.low[0] > bounds.high[0] {
            Bounds { low: [-0.5; 2], high: [0.5; 2] }
        } else {
            bounds
        }
    }

    /// Seconds from the start to the last thing that happened.
    fn duration_s(&self) -> f64 {
        let paths = self.tracks.iter().filter_map(|track| track.path.last().map(|p| p.time_s));
        let points = self.tracks.iter().filter_map(|track| track.points.last().map(|p| p.time_s));
        paths.chain(points).fold(0.0, f64::max)
    }
}

/// What a track is drawn in: red, green, blue of its path and of its points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Colours {
    path: [u8; 3],
    points: [u8; 3],
}

/// A single robot's: a green path among red points.
const SINGLE: Colours = Colours { path: [0x1a, 0x93, 0x4a], points: [0xd6, 0x2a, 0x2f] };

/// Several robots', in their order; told apart by people who see red and green alike.
const SEVERAL: [Colours; 12] = [
    Colours { path: [0x0b, 0x57, 0xa4], points: [0x4f, 0x9b, 0xe6] },
    Colours { path: [0xb3, 0x50, 0x00], points: [0xf0, 0x9a, 0x3e] },
    Colours { path: [0x00, 0x6d, 0x5b], points: [0x2f, 0xb8, 0x9d] },
    Colours { path: [0x8e, 0x2a, 0x6f], points: [0xd5, 0x79, 0xb7] },
    Colours { path: [0x5a, 0x46, 0x9e], points: [0x9d, 0x8c, 0xdb] },
    Colours { path: [0x6b, 0x5a, 0x00], points: [0xc2, 0xa8, 0x2b] },
    Colours { path: [0x9e, 0x1f, 0x2c], points: [0xe8, 0x7a, 0x80] },
    Colours { path: [0x1d, 0x6b, 0x1f], points: [0x7c, 0xbf, 0x5a] },
    Colours { path: [0x00, 0x60, 0x80], points: [0x45, 0xbc, 0xdc] },
    Colours { path: [0x6e, 0x45, 0x2a], points: [0xb9, 0x8d, 0x6c] },
    Colours { path: [0x9a, 0x00, 0x9a], points: [0xe5, 0x5c, 0xe5] },
    Colours { path: [0x4a, 0x50, 0x58], points: [0x98, 0xa1, 0xab] },
];

/// The colours of one of this many tracks.
fn colours(place: usize, tracks: usize) -> Colours {
    if tracks <= 1 { SINGLE } else { SEVERAL[place % SEVERAL.len()] }
}

/// Whether a track's colours stand for its robot, as they do where there are several.
fn is_single(scene: &Scene) -> bool {
    scene.tracks.len() <= 1
}

/// Leaves out what is nearer than `least_m` to the last that was kept; the first and the last stay.
fn thinned(path: &[PathPoint], least_m: f64) -> Vec<PathPoint> {
    let mut kept: Vec<PathPoint> = Vec::new();
    for point in path {
        let far =
            |last: &PathPoint| libm::hypot(point.x_m - last.x_m, point.y_m - last.y_m) >= least_m;
        if kept.last().is_none_or(far) {
            kept.push(*point);
        }
    }
    if let (Some(end), Some(last)) = (path.last(), kept.last())
        && end != last
    {
        kept.push(*end);
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x_m: f64) -> PathPoint {
        PathPoint { time_s: x_m, x_m, y_m: 0.0, heading_rad: 0.0 }
    }

    #[test]
    fn thinning_keeps_the_ends() {
        let path: Vec<PathPoint> = (0..=1000).map(|step| at(f64::from(step) * 0.001)).collect();
        let kept = thinned(&path, 0.1);
        assert_eq!((kept.first(), kept.last()), (path.first(), path.last()));
        assert!(kept.len() <= 12, "{}", kept.len());
        assert_eq!(thinned(&[], 0.1), []);
        assert_eq!(thinned(&[at(1.0)], 0.1), [at(1.0)]);
    }

    #[test]
    fn nothing_to_draw_is_a_metre_around_the_origin() {
        let scene = Scene { outlines: vec![vec![[f64::NAN, 0.0]]], ..Scene::default() };
        assert_eq!(scene.bounds(), Bounds { low: [-0.5; 2], high: [0.5; 2] });
        assert!(scene.duration_s().abs() < 1e-12);
    }
}
