//! How good the maps of `demo`'s mission are, against what only a simulation knows: ten seeds in
//! the world that the estimator was tuned in and in three that it was not.
//!
//! Both ways of estimating get the senses of the same runs. The default has one point a reading,
//! the seed one a tick.

use onbrick::behavior::{Demands, Mission};
use onbrick::mapping::{Method, stats};
use onbrick::recording::Run;
use onbrick::robot::RobotConfig;
use onbrick::runtime::Pilot;
use onbrick::sim::World;
use onbrick::units::{degrees, wrap_rad};

use crate::missions::play_in;

/// One run's figures.
#[derive(Debug, Clone, Copy, Default)]
struct Figures {
    points: f64,
    median_m: f64,
    p90_m: f64,
    pose_m: f64,
    heading_deg: f64,
    travelled_m: f64,
}

impl Figures {
    fn all(&self) -> [f64; 6] {
        let Self { points, median_m, p90_m, pose_m, heading_deg, travelled_m } = *self;
        [points, median_m * 100.0, p90_m * 100.0, pose_m * 100.0, heading_deg, travelled_m]
    }
}

/// A run's senses through an estimator and a map once more.
fn judge(run: &Run, world: &World, method: Method) -> Figures {
    let robot =
        RobotConfig::load("robot.toml", run.robot_toml.as_ref().unwrap().as_bytes()).unwrap().0;
    let mission = run.mission_toml.as_ref().unwrap().as_bytes();
    let mission = Mission::parse("mission.toml", mission, &robot.capabilities()).unwrap().0;
    let start = run.info.as_ref().unwrap().start_pose;
    let mut pilot = Pilot::new(&robot, &mission, method, start).unwrap();
    let mut demands = Demands::default();
    let mut distances = Vec::new();
    let mut last = None;
    for senses in &run.senses {
        let step = pilot.step(senses, &mut demands, |_| {});
        distances.extend(
            step.point.map(|point| world.distance_to_nearest_surface(point.x_m, point.y_m)),
        );
        last = Some(step.estimate);
    }
    let last = last.expect("there are ticks");
    let truth = run.ending.as_ref().unwrap().truth.expect("it is simulated");
    Figures {
        points: distances.len() as f64,
        median_m: stats::median(&mut distances).unwrap(),
        p90_m: stats::quantile(&mut distances, 0.9).unwrap(),
        pose_m: libm::hypot(last.pose.x_m - truth.x_m, last.pose.y_m - truth.y_m),
        heading_deg: degrees(wrap_rad(last.pose.heading_rad - truth.heading_rad)).abs(),
        travelled_m: last.travelled_m,
    }
}

/// The median of ten seeds for each figure, and the worst.
fn over(figures: &[Figures]) -> [[f64; 6]; 2] {
    let column = |at: usize| figures.iter().map(|figures| figures.all()[at]).collect::<Vec<_>>();
    let median = std::array::from_fn(|at| stats::median(&mut column(at)).unwrap());
    let worst = std::array::from_fn(|at| column(at).into_iter().fold(0.0, f64::max));
    [median, worst]
}

fn print(name: &str, [points, median, p90, pose, heading, travelled]: [f64; 6]) {
    println!(
        "  {name:22} {points:6.0} {median:7.1} {p90:6.1} {pose:8.1} {heading:8.1} {travelled:6.2}"
    );
}

#[test]
#[cfg_attr(
    target_arch = "arm",
    ignore = "forty long runs, the same bits as on a PC: a quarter of an hour where floats are \
              software"
)]
fn maps_of_ten_seeds_in_four_worlds() {
    println!(
        "demo's mission, 120 s: points; point to wall, cm: median, p90; final pose: cm, degrees; \
         metres driven"
    );
    // Bounds of the default's median and p90 over all points of a run, in cm: of the median seed.
    for (name, median_cm, p90_cm) in [
        ("arena", 3.0, 9.0),
        ("rooms", 4.0, 12.0),
        ("cylinders", 5.0, 14.0),
        ("corridor", 4.0, 12.0),
    ] {
        let world = World::named(name).unwrap();
        let runs: Vec<Run> = (1..=10).map(|seed| play_in("map", name, seed).run()).collect();
        let [seeds, default] = [Method::Seed, Method::Default]
            .map(|method| runs.iter().map(|run| judge(run, &world, method)).collect::<Vec<_>>());
        println!("{name}:");
        for (seed, figures) in (1..).zip(&default) {
            print(&format!("default, seed {seed}"), figures.all());
        }
        let ([seeds_typical, seeds_worst], [typical, worst]) = (over(&seeds), over(&default));
        print("default, median", typical);
        print("default, worst", worst);
        print("the seed's, median", seeds_typical);
        print("the seed's, worst", seeds_worst);
        assert!(typical[1] < median_cm && typical[2] < p90_cm, "{name}: {typical:?}");
        assert!(
            typical[1] < seeds_typical[1] && typical[2] < seeds_typical[2],
            "{name}: no better than the seed's"
        );
        assert!(worst[3] < 12.0 && worst[4] < 9.0, "{name}: final pose {worst:?}");
    }
}
