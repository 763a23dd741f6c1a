//! Two robots that explore one room at once: they see each other as walls, and with crosstalk each
//! hears the other's sensor. What of that is left in their maps.

use std::sync::{Arc, Mutex};

use onbrick::clock::{Clock, SECOND_NS};
use onbrick::mapping::{MapPoint, Pose, points_now, stats};
use onbrick::recording::{Pace, Run};
use onbrick::report::{Scene, Track};
use onbrick::runtime::{Environment, Heartbeat, Job, StopFlags, execute};
use onbrick::sim::{Observer, Simulation, Truth, World, WorldPhysics, covered};

use super::explore::SLANTED;
use crate::missions::{job, robot};
use crate::support::turns::Turns;

/// Within this a point is at a wall, metres.
const NEAR_M: f64 = 0.05;
/// No part of a robot is further from its middle, metres.
const BODY_M: f64 = 0.22;

/// A robot's run, and where it truly was.
struct Explored {
    run: Run,
    truths: Vec<(i64, Truth)>,
}

/// Notes where a robot truly is.
#[derive(Debug)]
struct Witness {
    observer: Observer,
    robot: usize,
    seen: Arc<Mutex<Vec<(i64, Truth)>>>,
}

impl Heartbeat for Witness {
    fn beat(&mut self, now_ns: i64) {
        let truth = self.observer.truth(self.robot).expect("a robot");
        self.seen.lock().unwrap().push((now_ns, truth));
    }
}

/// Mission `explore` on each start pose of a world at once.
fn explored_together(name: &str, text: &str, seed: u64) -> Vec<Explored> {
    let world = World::parse(name, text.as_bytes()).unwrap().0;
    let starts = world.starts().to_vec();
    let physics = WorldPhysics::new(world, starts.len(), seed).expect("start poses");
    let observer = physics.observer();
    let turns = Arc::new(Turns::new(starts.len()));
    let clock: Arc<dyn Clock> = turns.clone();
    let simulation = Simulation::new(Arc::clone(&clock), Box::new(physics), seed);
    let folder = tempfile::tempdir().expect("a folder");
    let explore = |place: usize| {
        let start = starts[place];
        let job = Job {
            start: Pose { x_m: start.x_m, y_m: start.y_m, heading_rad: start.heading_rad },
            set: vec![("time_limit_s".to_owned(), 300.0)],
            ..job("explore", &robot(), (name, text), seed, folder.path().join(place.to_string()))
        };
        let environment = Environment {
            pace: Pace::Virtual,
            wall_offset_ns: Some(SECOND_NS),
            ..Environment::new(simulation.brick(place), Arc::clone(&clock))
        };
        let seen = Arc::new(Mutex::new(Vec::new()));
        let mut witness =
            Witness { observer: observer.clone(), robot: place, seen: Arc::clone(&seen) };
        let flags = StopFlags::default();
        let ended = turns.play(place, || {
            execute(&job, environment, &flags, &mut witness, |_| {}).expect("a run")
        });
        assert!(ended.stopped, "{ended}");
        let run = Run::read(&std::fs::read(&job.file).expect("a recording")).expect("a run");
        let truths = std::mem::take(&mut *seen.lock().unwrap());
        Explored { run, truths }
    };
    std::thread::scope(|scope| {
        let explore = &explore;
        let threads: Vec<_> =
            (0..starts.len()).map(|place| scope.spawn(move || explore(place))).collect();
        threads.into_iter().map(|thread| thread.join().expect("a run")).collect()
    })
}

/// Of points: the share at walls, the share on another robot, and how much of the walls they cover.
fn judge<'p>(
    points: impl Iterator<Item = (usize, &'p MapPoint)>,
    robots: &[Explored],
    world: &World,
) -> [f64; 3] {
    let is_on = |robot: usize, point: &MapPoint| {
        let others = robots.iter().enumerate().filter(|(place, _)| *place != robot);
        others.map(|(_, other)| &other.truths).any(|truths| {
            let after = truths.partition_point(|(time_ns, _)| *time_ns <= point.time_ns);
            truths.get(after.saturating_sub(1)).is_some_and(|(_, truth)| {
                libm::hypot(truth.x_m - point.x_m, truth.y_m - point.y_m) < BODY_M
            })
        })
    };
    let (mut far_m, mut on, mut places) = (Vec::new(), 0.0, Vec::new());
    for (robot, point) in points {
        let wall_m = world.distance_to_nearest_surface(point.x_m, point.y_m);
        on += f64::from(u8::from(wall_m > NEAR_M && is_on(robot, point)));
        far_m.push(wall_m);
        places.push([point.x_m, point.y_m]);
    }
    let start = world.starts()[0];
    let walls = world.echoing_walls(start.x_m, start.y_m, 2.0);
    let coverage = covered(&walls, places.into_iter(), NEAR_M).expect("walls");
    let near = stats::share(&far_m, |m| m < NEAR_M).expect("points");
    [near, on / far_m.len() as f64, coverage].map(|share| share * 100.0)
}

#[test]
#[cfg_attr(target_arch = "arm", ignore = "long runs, the same bits as on a PC")]
fn what_two_robots_in_one_room_take_for_walls() {
    println!(
        "two robots explore at once, 300 s: points under 5 cm, on the other robot, %, of each as \
         moved and without what does not stand; of both together: the same, and coverage, %"
    );
    let arena = World::text("arena").unwrap();
    let mut sums = [[0.0; 3]; 3];
    for (name, text, crosstalk) in
        [("arena", arena, 0.0), ("slanted", SLANTED, 0.0), ("arena", arena, 0.1)]
    {
        let text = format!(
            "{text}\n[[start]]\nat = [0.6, -0.5]\nheading_deg = 180\n\
             [robot.errors]\nrange_crosstalk = {crosstalk:?}\n"
        );
        let world = World::parse(name, text.as_bytes()).unwrap().0;
        for seed in crate::support::seeds(4) {
            let robots = explored_together(name, &text, seed);
            let mut scene = Scene {
                tracks: robots.iter().map(|one| Track::of_run(&one.run, name)).collect(),
                ..Scene::default()
            };
            scene.align();
            let moved: Vec<Vec<MapPoint>> = robots
                .iter()
                .map(|Explored { run, .. }| points_now(&run.keyframes, &run.points))
                .collect();
            let standing: Vec<Vec<MapPoint>> =
                robots.iter().map(|one| one.run.points_now()).collect();
            let together: Vec<Vec<MapPoint>> =
                robots.iter().zip(&scene.tracks).map(points_of).collect();
            let figures = [&moved, &standing, &together].map(|points| {
                let points = points.iter().enumerate();
                let points = points.flat_map(|(robot, all)| all.iter().map(move |p| (robot, p)));
                judge(points, &robots, &world)
            });
            let [[near, on, _], [near_now, on_now, _], [near_all, on_all, coverage]] = figures;
            println!(
                "  {name:8} crosstalk {crosstalk:.1}, seed {seed}: {near:3.0} {on:4.1}, \
                 {near_now:3.0} {on_now:4.1}; {near_all:3.0} {on_all:4.1} {coverage:3.0}"
            );
            for (sum, figures) in sums.iter_mut().flatten().zip(figures.iter().flatten()) {
                *sum += figures;
            }
        }
    }
    let [[near, on, before], [near_now, on_now, _], [near_all, on_all, after]] = sums;
    assert!(near_now > near && near_all > near_now, "at walls: {sums:?}, sums over all runs");
    assert!(on > 0.0 && on_now < on && on_all < on_now, "on robots: {sums:?}, sums over all runs");
    assert!(after > before - 6.0 * 1.5, "coverage: {before} to {after}, sums over all runs");
}

/// A track's points as the map has them.
fn points_of((robot, track): (&Explored, &Track)) -> Vec<MapPoint> {
    let start_ns = robot.run.info.as_ref().expect("a beginning").start_ns;
    let point = |point: &MapPoint| MapPoint { time_ns: start_ns + point.time_ns, ..*point };
    track.points.iter().map(point).collect()
}
