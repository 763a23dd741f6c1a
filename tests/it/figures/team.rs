//! How well maps of several robots are put together, and whether maps of different rooms are.
//!
//! Starts are wrong by up to 20 cm to each side and 10°, by chance. What is wrong afterwards
//! counts the drift of both maps, too: they are moved as a whole.

use std::collections::BTreeMap;

use onbrick::mapping::{Pose, stats};
use onbrick::recording::{Grid, Run};
use onbrick::report::{Scene, Track};
use onbrick::runtime::joint_map;
use onbrick::sim::{World, covered};
use onbrick::units::{degrees, radians};

use super::explore::judge_cells;
use super::walls::worlds;
use crate::missions::{job, play, robot};

/// Within this a point is at a wall, metres.
const NEAR_M: f64 = 0.05;

/// Numbers between −1 and 1 (Knuth's MMIX generator).
fn chance(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    f64::from(u32::try_from(*state >> 33).unwrap()) / f64::from(1_u32 << 30) - 1.0
}

/// A track as a robot would have it that was put down elsewhere than it was told.
fn misplaced(track: &Track, [dx_m, dy_m, turn_rad]: [f64; 3]) -> Track {
    let mut track = track.clone();
    let start = track.path[0];
    let (sin, cos) = libm::sincos(turn_rad);
    let place = |x_m: f64, y_m: f64| {
        let (x_m, y_m) = (x_m - start.x_m, y_m - start.y_m);
        (start.x_m + dx_m + cos * x_m - sin * y_m, start.y_m + dy_m + sin * x_m + cos * y_m)
    };
    for at in &mut track.path {
        (at.x_m, at.y_m) = place(at.x_m, at.y_m);
        at.heading_rad += turn_rad;
    }
    for point in track.points.iter_mut().chain(&mut track.doubted) {
        (point.x_m, point.y_m) = place(point.x_m, point.y_m);
    }
    let (x_m, y_m) = place(0.0, 0.0);
    track.origin = Pose { x_m, y_m, heading_rad: turn_rad };
    track
}

/// Share of points under 5 cm from a wall, percent; their median, cm; share of the wall that has
/// one, percent.
fn judge(tracks: &[Track], world: &World) -> [f64; 3] {
    let all = || tracks.iter().flat_map(|track| &track.points);
    let mut distances: Vec<f64> =
        all().map(|point| world.distance_to_nearest_surface(point.x_m, point.y_m)).collect();
    let share = stats::share(&distances, |m| m < NEAR_M).unwrap();
    let start = world.starts()[0];
    let walls = world.echoing_walls(start.x_m, start.y_m, 2.0);
    let coverage = covered(&walls, all().map(|point| [point.x_m, point.y_m]), NEAR_M).unwrap();
    [share * 100.0, stats::median(&mut distances).unwrap() * 100.0, coverage * 100.0]
}

/// How far a track's start is from where it should be, cm and degrees.
fn start_error((right, track): (&Track, &Track)) -> [f64; 2] {
    let (start, now) = (right.path[0], track.path[0]);
    let way_m = libm::hypot(now.x_m - start.x_m, now.y_m - start.y_m);
    [way_m * 100.0, degrees(now.heading_rad - start.heading_rad).abs()]
}

/// How far a path is from where the robot truly was at its end and its start, in the mean, metres.
fn path_error(track: &Track) -> f64 {
    let far = |at: Option<&onbrick::report::PathPoint>, truth: Option<&[f64; 2]>| {
        let (at, truth) = (at.unwrap(), truth.unwrap());
        libm::hypot(at.x_m - truth[0], at.y_m - truth[1])
    };
    (far(track.path.first(), track.truth.first()) + far(track.path.last(), track.truth.last()))
        / 2.0
}

#[test]
#[cfg_attr(target_arch = "arm", ignore = "long runs, the same bits as on a PC")]
fn figures_of_maps_put_together() {
    let is_long = crate::support::is_long();
    let mut worlds = worlds().to_vec();
    worlds.push(("two-arenas", World::text("two-arenas").unwrap()));
    let seeds = 4..=if is_long { 7 } else { 5 };
    let mut tracks: BTreeMap<&str, Vec<Track>> = BTreeMap::new();
    let mut runs: BTreeMap<&str, Vec<Run>> = BTreeMap::new();
    for (name, text) in worlds.iter().copied() {
        for seed in seeds.clone().chain((name == "rooms").then_some(6)) {
            let run: Run = play(|file| job("explore", &robot(), (name, text), seed, file)).run();
            tracks.entry(name).or_default().push(Track::of_run(&run, name));
            runs.entry(name).or_default().push(run);
        }
    }
    let mut state = 7;
    let mut error = || {
        let mut part = |most: f64| most * chance(&mut state);
        [part(0.2), part(0.2), part(radians(10.0))]
    };
    println!(
        "the same room, robots: starts wrong by, cm, degrees; corrected, wrong by; paths, cm, \
         before, after; points < 5 cm, %, median, cm, wall with a point, %: of the best robot, \
         of all by starts, of all corrected, of these as drawn; occupied cells < 5 cm, wall with \
         one, free cells behind walls, floor that is free, %: of the best robot, of all corrected"
    );
    let (mut fits, mut within, mut pairs) = (0, 0, 0);
    let (mut more_near, mut cells_more) = (0.0, [0.0; 2]);
    for (name, text) in worlds.iter().copied() {
        let world = World::parse(name, text.as_bytes()).unwrap().0;
        let all = &tracks[name];
        for right in all.windows(2).chain((all.len() > 2).then_some(&all[..])) {
            let wrong: Vec<[f64; 3]> = right[1..].iter().map(|_| error()).collect();
            let others = right[1..].iter().zip(&wrong).map(|(track, by)| misplaced(track, *by));
            let put: Vec<Track> = [right[0].clone()].into_iter().chain(others).collect();
            let mut scene = Scene { tracks: put.clone(), ..Scene::default() };
            let outcomes = scene.align();
            let left: Vec<[f64; 2]> = right.iter().zip(&scene.tracks).map(start_error).collect();
            let most = |axis: usize| left.iter().map(|left| left[axis]).fold(0.0, f64::max);
            let paths = |tracks: &[Track]| {
                tracks[1..].iter().map(path_error).sum::<f64>() / (tracks.len() - 1) as f64 * 100.0
            };
            let [before_cm, after_cm] = [paths(&put), paths(&scene.tracks)];
            let single = right.iter().map(|track| judge(std::slice::from_ref(track), &world));
            let best = single.fold([0.0; 3], |best, one| if one[0] > best[0] { one } else { best });
            let refused = outcomes.iter().find_map(|(_, outcome)| outcome.err());
            print!(
                "  {name:12} {} {:3.0} {:4.1}   {:4.1} {:4.1}   {before_cm:3.0} {after_cm:4.1} ",
                right.len(),
                wrong.iter().map(|by| libm::hypot(by[0], by[1]) * 100.0).fold(0.0, f64::max),
                wrong.iter().map(|by| degrees(by[2]).abs()).fold(0.0, f64::max),
                most(0),
                most(1),
            );
            let mut drawn = scene.clone();
            drawn.turn_points();
            let [corrected, turned] = [&scene, &drawn].map(|scene| judge(&scene.tracks, &world));
            for [near, median_cm, coverage] in [best, judge(&put, &world), corrected, turned] {
                print!("  {near:3.0} {median_cm:3.1} {coverage:3.0}");
            }
            more_near += turned[0] - corrected[0];
            let used = || runs[name].iter().take(right.len());
            let cells = |grid: &Grid| judge_cells(grid, &world);
            let single = used().map(|run| cells(run.map.as_ref().expect("a map")));
            let best = single.fold([0.0; 4], |best, one| if one[1] > best[1] { one } else { best });
            let placed: Vec<_> =
                used().zip(scene.tracks.iter().map(|track| track.origin)).collect();
            let joint = cells(&joint_map(&placed).expect("runs that can be replayed"));
            for [at_wall, wall, behind, floor] in
                [best, joint].map(|all| all.map(|share| share * 100.0))
            {
                print!("  {at_wall:3.0} {wall:3.0} {behind:3.1} {floor:3.0}");
            }
            if refused.is_none() {
                for (sum, part) in cells_more.iter_mut().zip([joint[0], joint[1] - best[1]]) {
                    *sum += part;
                }
            }
            println!(
                "   {}",
                refused.map_or_else(|| "fits".to_owned(), |misfit| misfit.to_string())
            );
            pairs += 1;
            if refused.is_none() {
                fits += 1;
                within += u32::from(most(0) < 5.0 && most(1) < 2.0);
            }
            for (place, outcome) in outcomes {
                if outcome.is_ok() {
                    // A start may be off by as much as the map has drifted; the whole path may not.
                    let [before, after] = [&put, &scene.tracks].map(|all| path_error(&all[place]));
                    assert!(left[place][0] < 15.0 || after < 0.6 * before, "{name}: a false fit");
                    assert!(left[place][1] < 7.0, "{name}: a false fit");
                } else {
                    let stands =
                        scene.tracks[place] == Track { is_apart: true, ..put[place].clone() };
                    assert!(stands, "{name}: refused, and moved");
                }
            }
        }
    }
    let more_near = more_near / f64::from(pairs);
    println!(
        "{fits} of {pairs} sets fit; {within} within 5 cm and 2 degrees; {more_near:.1} % more of \
         the points are at walls as they are drawn"
    );
    assert!(2 * fits >= pairs, "{fits} of {pairs}");
    let [at_wall, more_wall] = cells_more.map(|sum| sum / f64::from(fits));
    println!(
        "grids of those that fit: {:.0} % of the occupied cells at walls, {:.1} % more of the wall \
         than the best robot's",
        at_wall * 100.0,
        more_wall * 100.0
    );
    assert!(at_wall > 0.75 && more_wall > 0.0, "{cells_more:?}, sums over {fits} sets");
    assert!(more_near > 1.5, "{more_near} % more are at walls");

    let mut wrong_pairs = 0;
    for (place, (one, _)) in worlds.iter().enumerate() {
        for (other, _) in &worlds[place + 1..] {
            // The first of the two arenas is built like the arena.
            if wrong_pairs == 30 || (*one, *other) == ("arena", "two-arenas") {
                continue;
            }
            wrong_pairs += 1;
            let moved = misplaced(&tracks[other][0], error());
            let mut scene =
                Scene { tracks: vec![tracks[one][0].clone(), moved], ..Scene::default() };
            let outcome = scene.align().remove(0).1;
            println!(
                "  {one}, {other}: {}",
                outcome.map_or_else(|m| m.to_string(), |_| "FITS".into())
            );
            assert!(outcome.is_err(), "{one} and {other} are different rooms");
        }
    }
    assert_eq!(wrong_pairs, 30);
}
