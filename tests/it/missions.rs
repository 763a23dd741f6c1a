//! The shipped missions on the simulated brick, judged as a person beside the robot would: by what
//! it truly does, not by what it believes.

mod lines;
pub mod motions;
mod replay;
mod shipped;
mod signals;
mod ways;

use std::path::PathBuf;

use onbrick::behavior::shipped::{TEMPLATE, find};
use onbrick::mapping::Pose;
use onbrick::recording::Run;
use onbrick::runtime::{Brick, Ended, Job, Source, StopFlags, execute};
use onbrick::sim::{Truth, World};
use onbrick::simulated::{Simulated, simulated};

use crate::support::stage::Witness;

/// The shipped robot, and the same with every further role that the simulated one has sensors for.
const ROBOT: &str = include_str!("../../brick-image/robot.toml");

/// What a run left behind, and what truly happened, tick by tick.
pub struct Played {
    pub ended: Ended,
    pub truths: Vec<Truth>,
    pub tick_s: f64,
    pub bytes: Vec<u8>,
    /// Keeps the recording until the test has read it.
    pub folder: tempfile::TempDir,
}

impl Played {
    pub fn run(&self) -> Run {
        Run::read(&self.bytes).expect("a recording")
    }

    /// The tick at a time of the run, seconds.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "times of a run are short and positive"
    )]
    pub fn tick_at(&self, time_s: f64) -> usize {
        (time_s / self.tick_s).round() as usize
    }

    /// The longest time without a break in which something was so, seconds.
    pub fn longest_s(&self, so: impl Fn(&Truth) -> bool) -> f64 {
        let (mut longest, mut ticks) = (0_u32, 0_u32);
        for truth in &self.truths {
            ticks = if so(truth) { ticks + 1 } else { 0 };
            longest = longest.max(ticks);
        }
        f64::from(longest) * self.tick_s
    }

    /// The share of ticks in which something was so.
    pub fn share(&self, so: impl Fn(&Truth) -> bool) -> f64 {
        let so = self.truths.iter().filter(|truth| so(truth)).count();
        so as f64 / self.truths.len() as f64
    }
}

/// A robot with every role of the usual simulated one.
pub fn robot() -> String {
    ROBOT.to_owned()
}

/// The job of a shipped mission in a world.
pub fn job(mission: &str, robot: &str, world: (&str, &str), seed: u64, file: PathBuf) -> Job {
    let (name, text) = world;
    let parsed = World::parse(name, text.as_bytes()).expect("a world").0;
    let start = parsed.starts()[0];
    let source = |name: &str, text: &str| Source { name: name.to_owned(), text: text.to_owned() };
    let text_of_mission = match mission {
        "template" => TEMPLATE.to_owned(),
        _ => find(mission).expect("a shipped mission").whole(),
    };
    Job {
        start: Pose { x_m: start.x_m, y_m: start.y_m, heading_rad: start.heading_rad },
        ..Job::new(
            source(&format!("{mission}.toml"), &text_of_mission),
            source("robot.toml", robot),
            Brick::Simulated { world: source(name, text), seed, realtime: false },
            file,
        )
    }
}

/// Does a job in virtual time.
pub fn play(job: impl FnOnce(PathBuf) -> Job) -> Played {
    let folder = tempfile::tempdir().expect("a folder");
    let job = job(folder.path().join("run.mcap"));
    let Simulated { environment, observer, .. } = simulated(&job).expect("a simulated brick");
    let mut witness = Witness::of(observer);
    let ended = execute(&job, environment, &StopFlags::default(), &mut witness, |_| {})
        .unwrap_or_else(|refused| panic!("{}: {}", job.mission.name, refused.stop()));
    let truths = witness.truths;
    assert!(ended.stopped && ended.recording.is_none(), "{ended}");
    let bytes = std::fs::read(&job.file).expect("a recording");
    let tick_s = ended.time_s / (truths.len() - 1) as f64;
    Played { ended, truths, tick_s, bytes, folder }
}

/// A shipped mission in a built-in world, with every role.
pub fn play_in(mission: &str, world: &str, seed: u64) -> Played {
    let text = World::text(world).expect("a built-in world");
    play(|file| job(mission, &robot(), (world, text), seed, file))
}

/// The corners of the world's one line, as its file has them.
pub(crate) fn line_points(world: &str) -> Vec<[f64; 2]> {
    let line = world.split("points = [").nth(1).unwrap().split("\n]").next().unwrap();
    let points: Vec<[f64; 2]> = line
        .split(']')
        .filter_map(|point| point.split('[').nth(1))
        .map(|point| {
            let (x, y) = point.split_once(", ").unwrap();
            [x.parse().unwrap(), y.parse().unwrap()]
        })
        .collect();
    assert!(points.len() > 40 && world.contains("width_m = 0.03"), "{} points", points.len());
    points
}

/// Distance to a closed line.
pub(crate) fn to_ring_m(ring: &[[f64; 2]], [x, y]: [f64; 2]) -> f64 {
    let sides = ring.iter().zip(ring.iter().cycle().skip(1));
    sides
        .map(|([x1, y1], [x2, y2])| {
            let (dx, dy) = (x2 - x1, y2 - y1);
            let along = (((x - x1) * dx + (y - y1) * dy) / (dx * dx + dy * dy)).clamp(0.0, 1.0);
            libm::hypot(x - x1 - along * dx, y - y1 - along * dy)
        })
        .fold(f64::INFINITY, f64::min)
}
