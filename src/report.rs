//! Pictures and exports of finished runs; and the live page of a run or a simulation ([`live`]).
//!
//! A [`Scene`] is what there is to see of one or several runs: each robot's path and points, and
//! the room where it is known. [`plot`] draws it as SVG, PNG, PDF, or as one HTML page with pan,
//! zoom and a time slider; [`timeline`] is a run over time, which
//! [`chart`] draws; [`export`] writes it for spreadsheets, point-cloud tools, Nav2 and ROS
//! viewers.
//!
//! # Not here
//!
//! No reading of worlds: the caller knows how a world becomes outlines. No files: everything is
//! made as text or bytes.
//!
//! # What we count on
//!
//! - A place that is not finite, or further away than 100 km, is not drawn, and of a run not
//!   exported.

mod canvas;
pub mod chart;
pub mod export;
pub mod live;
mod page;
pub mod plot;
mod ruler;
pub mod timeline;

pub use canvas::PlotError;
pub(crate) use canvas::png_file;

use crate::clock::seconds;
use crate::mapping::{self, MapPoint, Method, Misfit, Pose, Sight, Testimony, Wall};
use crate::printable;
use crate::recording::{Grid, Run};
use crate::sim::Paint;

/// What there is to see of one or several runs, in one world frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scene {
    /// What stands above the picture.
    pub title: String,
    /// Each run's path and points.
    pub tracks: Vec<Track>,
    /// The walls that all points together make.
    pub walls: Vec<Wall>,
    /// Walls and obstacles as lines through points in metres; one that ends where it began is a
    /// closed shape.
    pub outlines: Vec<Vec<[f64; 2]>>,
    /// The corners of blocks, whose outlines are among the others: they are filled, so that those
    /// that touch have one outline together.
    pub blocks: Vec<Vec<[f64; 2]>>,
    /// Where the floor ends: the corners of a closed shape each.
    pub edges: Vec<Vec<[f64; 2]>>,
    /// What is drawn on the floor, the lowest first.
    pub marks: Vec<Paint>,
}

/// One run's path and points.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Track {
    /// The robot's name.
    pub name: String,
    /// Where the robot was, in order of time.
    pub path: Vec<PathPoint>,
    /// Where it truly was, metres, in order of time; empty where that is not known.
    pub truth: Vec<[f64; 2]>,
    /// What it found, in order of time, which is counted from the run's start.
    pub points: Vec<MapPoint>,
    /// What it found that does not stand: not drawn and not exported, but walls are tried by it.
    pub doubted: Vec<MapPoint>,
    /// Its occupancy grid, in the run's own frame: what is free of it is drawn as floor.
    pub grid: Option<Grid>,
    /// The estimator that placed the points.
    pub method: Method,
    /// Where the origin of the run's own frame lies in the scene's.
    pub origin: Pose,
    /// Its map fits none of the others' ([`Scene::align`]), and says nothing of their walls.
    pub is_apart: bool,
    /// What a person should know about the recording; empty for one that is whole.
    pub warnings: Vec<String>,
}

/// Where a robot was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Nanoseconds since the run's start.
    pub time_ns: i64,
    /// Metres.
    pub x_m: f64,
    /// Metres.
    pub y_m: f64,
    /// Radians, not wrapped.
    pub heading_rad: f64,
}

impl PathPoint {
    fn place(&self) -> [f64; 2] {
        [self.x_m, self.y_m]
    }
}

/// What a track was moved by at its start, metres and radians, or why it was not.
pub type Correction = Result<(f64, f64), Misfit>;

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
        let path = run.path_now().map(|(time_ns, pose)| PathPoint {
            time_ns: time_ns.saturating_sub(start_ns),
            x_m: pose.x_m,
            y_m: pose.y_m,
            heading_rad: pose.heading_rad,
        });
        let cloud = |mut points: Vec<MapPoint>| {
            points.retain(|point| is_near(point.x_m, point.y_m));
            for point in &mut points {
                point.time_ns = point.time_ns.saturating_sub(start_ns);
            }
            points
        };
        let (standing, doubted) = run.points_judged();
        let name = run.info.as_ref().map(|info| info.brick.clone()).filter(|name| !name.is_empty());
        Self {
            name: name.unwrap_or_else(|| printable::line(fallback).into_owned()),
            path: path.filter(|at| is_near(at.x_m, at.y_m) && at.heading_rad.is_finite()).collect(),
            truth: run
                .truth
                .iter()
                .map(|(_, pose)| [pose.x_m, pose.y_m])
                .filter(|[x_m, y_m]| is_near(*x_m, *y_m))
                .collect(),
            points: cloud(standing),
            doubted: cloud(doubted),
            grid: run.map.clone(),
            method: run.info.as_ref().map(|info| info.method).unwrap_or_default(),
            origin: Pose::default(),
            is_apart: false,
            warnings: run.warnings.clone(),
        }
    }
}

/// Whether a place may be one of a run.
fn is_near(x_m: f64, y_m: f64) -> bool {
    x_m.abs() < 1e5 && y_m.abs() < 1e5
}

impl Track {
    fn start_m(&self) -> [f64; 2] {
        self.path.first().map_or([0.0; 2], PathPoint::place)
    }

    /// Moves path and points: `by` is the pose of their frame's origin in the common one. Where the
    /// robot truly was stays.
    fn shift(&mut self, by: &Pose) {
        self.origin = by.then(&self.origin);
        for at in &mut self.path {
            [at.x_m, at.y_m] = by.place(at.x_m, at.y_m);
            at.heading_rad += by.heading_rad;
        }
        for point in self.points.iter_mut().chain(&mut self.doubted) {
            [point.x_m, point.y_m] = by.place(point.x_m, point.y_m);
        }
    }

    /// The floor that it found free, the corners of rectangles, metres.
    fn free(&self) -> impl Iterator<Item = [[f64; 2]; 4]> {
        let free = self.grid.as_ref().map(Grid::free).unwrap_or_default();
        free.into_iter().map(|[[left, low], [right, high]]| {
            [[left, low], [right, low], [right, high], [left, high]]
                .map(|[x_m, y_m]| self.origin.place(x_m, y_m))
        })
    }

    /// Points with the places that they were seen from.
    fn sights(&self, points: &[MapPoint]) -> Vec<Sight> {
        let place =
            |&PathPoint { time_ns, x_m, y_m, .. }: &PathPoint| MapPoint { time_ns, x_m, y_m };
        Sight::of(points, &self.path.iter().map(place).collect::<Vec<_>>())
    }
}

impl Scene {
    /// True where a picture has nothing but its axes.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        let Self { title: _, tracks, walls, outlines, blocks, edges, marks } = self;
        let is_bare = |track: &Track| {
            track.path.is_empty() && track.truth.is_empty() && track.points.is_empty()
        };
        tracks.iter().all(is_bare)
            && [outlines, blocks, edges].iter().all(|lines| lines.is_empty())
            && (walls.is_empty() && marks.is_empty())
    }

    /// Finds the walls that the points of all tracks make, in the frame that the tracks are in;
    /// those of a track that is apart by themselves.
    pub fn find_walls(&mut self) {
        let all =
            |track: &Track| [&track.points, &track.doubted].map(|points| track.sights(points));
        let (apart, together): (Vec<&Track>, Vec<&Track>) =
            self.tracks.iter().partition(|track| track.is_apart);
        let together: Vec<Sight> = together.into_iter().flat_map(all).flatten().collect();
        let apart = apart.into_iter().map(|track| all(track).concat());
        self.walls =
            [together].into_iter().chain(apart).flat_map(|all| mapping::walls(&all)).collect();
    }

    /// Turns the points of all tracks about where they were heard from to where several sides agree
    /// ([`mapping::crossings()`]): of those that fit together, those of a track that is apart by
    /// themselves. Where the seed's estimator placed points they stay. Walls are found before, by
    /// the points as they were placed.
    pub fn turn_points(&mut self) {
        let turns = |track: &&mut Track| track.method != Method::Seed && !track.path.is_empty();
        let (apart, together): (Vec<&mut Track>, Vec<&mut Track>) =
            self.tracks.iter_mut().filter(turns).partition(|track| track.is_apart);
        let apart = apart.into_iter().map(|track| vec![track]);
        for tracks in apart.chain([together]) {
            let all: Vec<Sight> =
                tracks.iter().flat_map(|track| track.sights(&track.points)).collect();
            let points = tracks.into_iter().flat_map(|track| &mut track.points);
            for (point, [x_m, y_m]) in points.zip(mapping::crossings(&all)) {
                (point.x_m, point.y_m) = (x_m, y_m);
            }
        }
    }

    /// Corrects the tracks' start poses against each other: the first whose map has points enough
    /// stays, and each of the others is moved as a whole where its map fits the map of one that is
    /// in its place; one that fits none is apart. Points of those that fit are left out where
    /// another of them has seen through them. Gives for each track but the one that stays what it
    /// was moved by, metres at its start and radians, or why it was not: the last of the reasons.
    pub fn align(&mut self) -> Vec<(usize, Correction)> {
        let sights = |track: &Track| track.sights(&track.points);
        let has_enough = |track: &Track| mapping::has_enough(&sights(track), track.start_m());
        let first = self.tracks.iter().position(has_enough).unwrap_or(0);
        let mut outcomes = Vec::new();
        let mut placed: Vec<Vec<Sight>> =
            self.tracks.iter().skip(first).take(1).map(sights).collect();
        let mut fit = vec![first];
        let mut waiting: Vec<usize> =
            (0..self.tracks.len()).filter(|place| *place != first).collect();
        // One that fits none may fit one that is placed after it.
        while !waiting.is_empty() {
            let before = waiting.len();
            let mut refused = Vec::new();
            waiting.retain(|&place| {
                let Some(track) = self.tracks.get_mut(place) else { return false };
                let (own, start_m) = (sights(track), track.start_m());
                let mut outcome = Err(Misfit::Few { points: 0 });
                for reference in placed.iter().rev() {
                    outcome = mapping::align(reference, &own, start_m);
                    if outcome.is_ok() {
                        break;
                    }
                }
                track.is_apart = outcome.is_err();
                match outcome {
                    Ok(by) => {
                        track.shift(&by);
                        let [x_m, y_m] = track.start_m();
                        let moved_m = libm::hypot(x_m - start_m[0], y_m - start_m[1]);
                        outcomes.push((place, Ok((moved_m, by.heading_rad))));
                        placed.push(sights(track));
                        fit.push(place);
                        false
                    }
                    Err(misfit) => {
                        refused.push((place, Err(misfit)));
                        true
                    }
                }
            });
            if waiting.len() == before {
                outcomes.append(&mut refused);
                break;
            }
        }
        outcomes.sort_by_key(|(place, _)| *place);
        if fit.len() > 1 {
            self.leave_out_what_moves(&fit, &placed);
        }
        outcomes
    }

    /// Leaves out the points of tracks that fit, given with their sights, that the sights of the
    /// others among them refute: robots that see each other are no walls.
    fn leave_out_what_moves(&mut self, fit: &[usize], sights: &[Vec<Sight>]) {
        for (place, said) in fit.iter().zip(mapping::testimonies(sights)) {
            let Some(track) = self.tracks.get_mut(*place) else { continue };
            let mut said = said.into_iter();
            let (stand, refuted): (Vec<MapPoint>, Vec<MapPoint>) =
                track.points.iter().partition(|_| said.next() != Some(Testimony::Refuted));
            track.points = stand;
            track.doubted.extend(refuted);
        }
    }

    /// The least rectangle around everything; a metre around the origin where there is nothing.
    fn bounds(&self) -> [[f64; 2]; 2] {
        let paths = self.tracks.iter().flat_map(|track| track.path.iter().map(PathPoint::place));
        let points =
            self.tracks.iter().flat_map(|track| track.points.iter().map(|p| [p.x_m, p.y_m]));
        let walls = self.outlines.iter().chain(&self.edges).flatten().copied();
        let marks = self.marks.iter().flat_map(|mark| mark.points.iter().copied());
        let truth = self.tracks.iter().flat_map(|track| track.truth.iter().copied());
        let free = self.tracks.iter().flat_map(Track::free).flatten();
        let places = paths.chain(points).chain(walls).chain(marks).chain(truth).chain(free);
        let [low, high] = crate::units::bounds(places.filter(|[x_m, y_m]| is_near(*x_m, *y_m)));
        if low[0] > high[0] { [[-0.5; 2], [0.5; 2]] } else { [low, high] }
    }

    /// Seconds from the start to the last thing that happened.
    fn duration_s(&self) -> f64 {
        let paths = self.tracks.iter().filter_map(|track| track.path.last().map(|p| p.time_ns));
        let points = self.tracks.iter().filter_map(|track| track.points.last().map(|p| p.time_ns));
        seconds(paths.chain(points).fold(0, i64::max))
    }
}

/// What a track is drawn in: red, green, blue of its path and of its points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Colours {
    path: [u8; 3],
    points: [u8; 3],
}

/// The colours of Okabe and Ito, which people who see red and green alike tell apart: blue, orange,
/// green, purple, sky blue, vermilion, yellow.
const OKABE_ITO: [[u8; 3]; 7] = [
    [0x00, 0x72, 0xb2],
    [0xe6, 0x9f, 0x00],
    [0x00, 0x9e, 0x73],
    [0xcc, 0x79, 0xa7],
    [0x56, 0xb4, 0xe9],
    [0xd5, 0x5e, 0x00],
    [0xf0, 0xe4, 0x42],
];

/// A single robot's: a blue path among vermilion points.
const SINGLE: Colours = Colours { path: OKABE_ITO[0], points: OKABE_ITO[5] };

/// The colours of one of this many tracks: a robot's path is darker than its points. From the
/// eighth on both are lighter than those of the first seven.
fn colours(place: usize, tracks: usize) -> Colours {
    if tracks <= 1 {
        return SINGLE;
    }
    let own = OKABE_ITO[place % OKABE_ITO.len()];
    if (place / OKABE_ITO.len()).is_multiple_of(2) {
        Colours { path: own.map(|part| part / 2 + part / 16), points: own }
    } else {
        Colours { path: own, points: own.map(|part| 255 - (255 - part) / 2) }
    }
}

/// Whether a track's colours stand for its robot, as they do where there are several.
fn is_single(scene: &Scene) -> bool {
    scene.tracks.len() <= 1
}

/// No path is drawn finer, metres.
const LEAST_STEP_M: f64 = 0.004;

/// Leaves out what is nearer than [`LEAST_STEP_M`] to the last that was kept; the first and the
/// last stay. `place` says where each is.
fn thinned<P: PartialEq>(
    path: impl IntoIterator<Item = P>,
    place: impl Fn(&P) -> [f64; 2],
) -> Vec<P> {
    let mut kept: Vec<P> = Vec::new();
    let mut end = None;
    for point in path {
        let is_far = |last: &P| {
            let ([x_m, y_m], [from_x_m, from_y_m]) = (place(&point), place(last));
            libm::hypot(x_m - from_x_m, y_m - from_y_m) >= LEAST_STEP_M
        };
        if kept.last().is_none_or(is_far) {
            kept.push(point);
            end = None;
        } else {
            end = Some(point);
        }
    }
    kept.extend(end.filter(|end| kept.last() != Some(end)));
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x_m: f64) -> PathPoint {
        PathPoint { time_ns: 0, x_m, y_m: 0.0, heading_rad: 0.0 }
    }

    #[test]
    fn thinning_keeps_the_ends() {
        let path: Vec<PathPoint> = (0..=1000).map(|step| at(f64::from(step) * 4e-5)).collect();
        let kept = thinned(path.clone(), PathPoint::place);
        assert_eq!((kept.first(), kept.last()), (path.first(), path.last()));
        assert!(kept.len() <= 12, "{}", kept.len());
        assert_eq!(thinned([], PathPoint::place), []);
        assert_eq!(thinned([at(1.0)], PathPoint::place), [at(1.0)]);
    }

    /// A track whose points are every 2 cm, twice, on a rectangle's sides around the origin, where
    /// the robot stands.
    fn rectangle(half_m: [f64; 2]) -> Track {
        let side = |step: i32| f64::from(step) * 0.02;
        let points = (0..2).flat_map(|axis| {
            let steps = whole(half_m[1 - axis] / 0.02);
            (-steps..=steps).flat_map(move |step| {
                [-1.0, 1.0].map(|sign| {
                    let mut at_m = [side(step); 2];
                    at_m[axis] = sign * half_m[axis];
                    at_m
                })
            })
        });
        let points = points.flat_map(|[x_m, y_m]| [MapPoint { time_ns: 0, x_m, y_m }; 2]);
        Track { path: vec![at(0.0)], points: points.collect(), ..Track::default() }
    }

    #[expect(clippy::cast_possible_truncation, reason = "some dozens")]
    fn whole(value: f64) -> i32 {
        value as i32
    }

    #[test]
    fn maps_that_do_not_fit_have_their_walls_each_and_one_without_points_hinders_none() {
        let (room, other) = (rectangle([1.0, 0.8]), rectangle([1.9, 1.6]));
        let lost = Track { points: room.points[..20].to_vec(), ..room.clone() };
        let mut scene = Scene { tracks: vec![lost, room.clone(), other, room], ..Scene::default() };
        let outcomes = scene.align();
        let fit: Vec<bool> = outcomes.iter().map(|(_, outcome)| outcome.is_ok()).collect();
        assert_eq!(fit, [false, false, true], "{outcomes:?}");
        let said = outcomes[0].1.unwrap_err().to_string();
        assert!(said.contains("its map has ") && said.contains("60 are the fewest"), "{said}");
        assert_eq!(outcomes.iter().map(|(place, _)| *place).collect::<Vec<_>>(), [0, 2, 3]);
        let apart: Vec<bool> = scene.tracks.iter().map(|track| track.is_apart).collect();
        assert_eq!(apart, [true, false, true, false]);
        scene.find_walls();
        assert_eq!(scene.walls.len(), 8, "{:?}", scene.walls);
    }

    #[test]
    fn points_of_all_that_fit_are_turned_together_and_the_seeds_stay() {
        // A post that each of four robots heard from its side, on a tangent.
        let track = |direction: i32, method: Method| {
            let (sin, cos) = libm::sincos(f64::from(direction) * std::f64::consts::FRAC_PI_2);
            let at = PathPoint { time_ns: 0, x_m: cos, y_m: sin, heading_rad: 0.0 };
            let beside = |step: i32| {
                let aside_m = 0.01 * f64::from(step);
                MapPoint { time_ns: 1, x_m: -aside_m * sin, y_m: aside_m * cos }
            };
            let points = (-12..=12).map(beside).collect();
            Track { path: vec![at], points, method, ..Track::default() }
        };
        let far_m = |track: &Track| {
            let far = track.points.iter().map(|point| libm::hypot(point.x_m, point.y_m));
            far.sum::<f64>() / 25.0
        };
        let tracks: Vec<Track> = (0..4).map(|side| track(side, Method::Default)).collect();
        let seed = track(0, Method::Seed);
        let lone = Track { is_apart: true, ..track(0, Method::Default) };
        let all = tracks.iter().chain([&seed, &lone]).cloned().collect();
        let mut scene = Scene { tracks: all, ..Scene::default() };
        scene.turn_points();
        for (before, after) in tracks.iter().zip(&scene.tracks) {
            assert!(far_m(after) < 0.5 * far_m(before), "{}", far_m(after));
        }
        assert_eq!(scene.tracks[4..], [seed, lone]);
    }

    #[test]
    fn nothing_to_draw_is_a_metre_around_the_origin() {
        let scene = Scene { outlines: vec![vec![[f64::NAN, 0.0]]], ..Scene::default() };
        assert_eq!(scene.bounds(), [[-0.5; 2], [0.5; 2]]);
        assert!(scene.duration_s().abs() < 1e-12);
    }
}
