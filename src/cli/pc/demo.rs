//! `onbrick demo`: the main job on the simulated brick.

use std::path::PathBuf;

use serde::Serialize;

use super::scene::{draw, of_all, scene_of};
use crate::behavior::shipped::{MISSIONS, Shipped, find};
use crate::cli::common::{
    Progress, environment, load_mission, load_robot, load_world, method, number_within, open_run,
    stamps_ns,
};
use crate::cli::folder::RunFolder;
use crate::cli::run::verdict;
use crate::cli::terminal::stop_flags;
use crate::cli::{Context, Exit, Failure, Output};
use crate::document::nearest_or_all;
use crate::mapping::{MapPoint, Method, Pose, stats};
use crate::recording::Run;
use crate::robot::RobotConfig;
use crate::runtime::{Brick, Event, Job, NoHeartbeat, Source, execute};
use crate::sim::covered;
use crate::simulated::furnished;
use crate::units::{count, degrees, wrap_rad};

/// Let a simulated robot explore a room of cinder blocks, come home, and draw the map it makes.
///
/// Examples:
///   onbrick demo --world rooms --seed 7
///   onbrick demo --mission map --seconds 120 --method seed      as the seed's robot did it
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    /// The folder for run.mcap, map.svg, map.png, points.csv and path.csv; without it onbrick-demo,
    /// or the next free one, onbrick-demo-2.
    #[arg(long)]
    out: Option<PathBuf>,
    /// The room: a world's file, or the name of a built-in one.
    #[arg(long, default_value = "arena")]
    world: PathBuf,
    /// The robot's file, or the name of a shipped one: mapper, educator, retail. Without it the
    /// mapper.
    #[arg(long)]
    robot: Option<PathBuf>,
    /// What the robot does: a shipped mission.
    #[arg(long, default_value = "explore", value_parser = shipped)]
    mission: String,
    /// How poses are estimated and points placed: default, by odometry alone, or as the seed did.
    #[arg(long, default_value = "default", value_parser = method())]
    method: Method,
    /// How long the robot has at most, in seconds of its own time; without it, as long as the
    /// mission says.
    #[arg(long, value_parser = number_within(1.0..=36_000.0))]
    seconds: Option<f64>,
    /// The seed of all random numbers: the same seed gives the same run.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Keep step with the clock on the wall instead of running as fast as the machine allows.
    #[arg(long)]
    realtime: bool,
}

/// A point is near a wall, and a wall covered by a point, within this, metres.
const NEAR_M: f64 = 0.05;

/// How good a map is, against what only a simulation knows.
#[derive(Debug, Serialize)]
struct Quality {
    /// Without those that the rest of the run contradicts: as they are drawn.
    points: usize,
    /// Distance from the points to the nearest wall, metres; none without points or without walls.
    wall_median_m: Option<f64>,
    wall_p90_m: Option<f64>,
    /// The share of points within 5 cm of a wall; none as above.
    near_wall: Option<f64>,
    /// The share of the walls that can echo to a robot on the floor that it can reach, of which the
    /// map has a point within 5 cm; none without such walls.
    coverage: Option<f64>,
    /// The last pose against the true one.
    pose_error_m: f64,
    heading_error_deg: f64,
    /// The same, at the most on the way.
    most_pose_error_m: f64,
    most_heading_error_deg: f64,
    travelled_m: f64,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let (world, start) = load_world(&arguments.world)?;
    let robot = load_robot(arguments.robot.as_deref())?;
    let world = match arguments.robot {
        Some(_) => furnished(world, &robot.config),
        None => world,
    };
    let folder = RunFolder::of_demo(arguments.out.as_deref())?;
    let mission = Source {
        name: format!("{}.toml", arguments.mission),
        text: find(&arguments.mission).map(Shipped::whole).unwrap_or_default(),
    };
    let Arguments { seed, realtime, .. } = *arguments;
    let brick = Brick::Simulated { world: world.clone(), seed, realtime };
    let job = Job {
        start,
        set: arguments.seconds.map(|s| ("time_limit_s".to_owned(), s)).into_iter().collect(),
        stamps_ns: stamps_ns(output),
        method: arguments.method,
        ..Job::new(mission, robot.source, brick, folder.file())
    };
    let (mut limited, _) = load_mission(&job.mission, &robot.config.capabilities())?;
    for (name, value) in &job.set {
        limited.set(name, *value).context(Exit::Usage, "--seconds")?;
    }
    let flags = stop_flags()?;
    let progress = std::sync::Arc::new(Progress::new(&limited, output));
    let shown = std::sync::Arc::clone(&progress);
    let ended = environment(&job).and_then(|environment| {
        execute(&job, environment, &flags, &mut NoHeartbeat, move |event| shown.show(event))
    });
    progress.finish();
    let ended = ended.inspect_err(|_| folder.take_back())?;
    output.show(ended.to_string(), &Event::Ended(ended.clone()));
    let loaded = open_run(&job.file)?;
    let scene = scene_of(std::slice::from_ref(&loaded), None);
    draw(&folder.path, &scene)?;
    let drawn = scene.tracks.into_iter().flat_map(|track| track.points).collect::<Vec<_>>();
    let quality = quality(&loaded.run, &drawn, &world)?;
    output.show(
        format!(
            "map: {}, {}\n{}\
             pose: {:.1} cm and {:.1} degrees from the true one at the end, after {:.2} m; \
             {:.1} cm and {:.1} degrees at most\n\
             wrote run.mcap, map.svg, map.png, points.csv and path.csv to {}",
            of_all(quality.points, std::slice::from_ref(&loaded)),
            from_walls(&quality),
            covered_walls(&quality),
            quality.pose_error_m * 100.0,
            quality.heading_error_deg,
            quality.travelled_m,
            quality.most_pose_error_m * 100.0,
            quality.most_heading_error_deg,
            folder.path.display()
        ),
        &quality,
    );
    verdict(&ended.stop, &job.file, output)
}

/// How far the points are from the walls, as far as there are both.
fn from_walls(quality: &Quality) -> String {
    match (quality.wall_median_m, quality.wall_p90_m) {
        (Some(median_m), Some(p90_m)) => {
            let [median_cm, p90_cm] = [median_m, p90_m].map(|metres| metres * 100.0);
            format!(
                "to the nearest wall {median_cm:.1} cm (median), {p90_cm:.1} cm (90th \
                 percentile), {:.0} % under 5 cm",
                quality.near_wall.unwrap_or_default() * 100.0
            )
        }
        _ if quality.points == 0 => "the robot heard no echo".to_owned(),
        _ => "there is no wall in this world to compare them with".to_owned(),
    }
}

/// How much of the walls is in the map, as far as there are walls.
fn covered_walls(quality: &Quality) -> String {
    let Some(coverage) = quality.coverage else { return String::new() };
    format!(
        "coverage: {:.0} % of the walls that the robot can hear have a point within 5 cm\n",
        coverage * 100.0
    )
}

fn shipped(text: &str) -> Result<String, String> {
    if find(text).is_some() {
        return Ok(text.to_owned());
    }
    if text.ends_with(".toml") {
        return Err("onbrick run FILE --sim WORLD runs a mission of yours".to_owned());
    }
    Err(nearest_or_all(text, "it can be", MISSIONS.iter().map(|mission| mission.name)))
}

fn quality(run: &Run, points: &[MapPoint], world: &Source) -> Result<Quality, Failure> {
    let (world, _) = world.world()?;
    let mut distances: Vec<f64> = points
        .iter()
        .map(|point| world.distance_to_nearest_surface(point.x_m, point.y_m))
        .collect();
    // A world without walls has no nearest one.
    distances.retain(|distance_m| distance_m.is_finite());
    let near = distances.iter().filter(|distance_m| **distance_m < NEAR_M).count();
    let near_wall = (!distances.is_empty()).then(|| count(near) / count(distances.len()));
    let start = run.info.as_ref().map(|info| info.start_pose).unwrap_or_default();
    let walls = world.echoing_walls(start.x_m, start.y_m, reach_m(run));
    let coverage = covered(&walls, points.iter().map(|point| [point.x_m, point.y_m]), NEAR_M);
    let believed = run.poses.last().map(|pose| pose.pose).unwrap_or_default();
    let truth = run.ending.as_ref().and_then(|ending| ending.truth).unwrap_or(believed);
    let [pose_error_m, heading_error_deg] = errors(&believed, &truth);
    let mut poses = run.poses.iter();
    let errors_on_the_way = run.truth.iter().filter_map(|(time_ns, truth)| {
        poses.find(|pose| pose.time_ns >= *time_ns).map(|pose| errors(&pose.pose, truth))
    });
    let [most_pose_error_m, most_heading_error_deg] = errors_on_the_way
        .fold([pose_error_m, heading_error_deg], |[most_m, most_deg], [metres, degrees]| {
            [most_m.max(metres), most_deg.max(degrees)]
        });
    Ok(Quality {
        points: points.len(),
        near_wall,
        coverage,
        wall_median_m: stats::quantile(&mut distances, 0.5),
        wall_p90_m: stats::quantile(&mut distances, 0.9),
        pose_error_m,
        heading_error_deg,
        most_pose_error_m,
        most_heading_error_deg,
        travelled_m: run.poses.last().map_or(0.0, |pose| pose.travelled_m),
    })
}

/// How far a pose is from the true one, metres and degrees.
fn errors(believed: &Pose, truth: &Pose) -> [f64; 2] {
    let way_m = libm::hypot(believed.x_m - truth.x_m, believed.y_m - truth.y_m);
    [way_m, degrees(wrap_rad(believed.heading_rad - truth.heading_rad)).abs()]
}

/// How far a reading makes a point, metres.
fn reach_m(run: &Run) -> f64 {
    let robot = run.robot_toml.as_ref();
    let robot = robot.and_then(|text| RobotConfig::load("robot.toml", text.as_bytes()).ok());
    robot.and_then(|(robot, _)| robot.range).map_or(0.0, |range| range.max_m)
}
