//! What a bad network costs: our robots and the seed's under the same losses, and how fast a
//! recording comes home.
//!
//! ```sh
//! ONBRICK_NETWORK=1 cargo test --release --test it link::figures -- --nocapture --test-threads=1
//! ```
//!
//! prints the tables, in a quarter of an hour, and wants a machine that does nothing else;
//! `ONBRICK_NETWORK="50 %"` takes only the cases whose names begin so. Without the variable the
//! same is done for a few seconds a case, and only what does not depend on the machine's speed is
//! judged.
//!
//! Each case is a pair of bricks side by side, one whose network is as bad as the case says and one
//! whose network is left alone, so that whatever else this machine does comes to both; in the first
//! case both are left alone, and what differs there is noise. Beside them the seed's robot drives,
//! its loop on the PC, over a third network that is treated as the first. Each has a PC that
//! follows it.

use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use onbrick::link::KeyPair;
use onbrick::recording::Run;
use serde_json::Value;

use super::bench::{LONG, text, until};
use super::chapter::Apart;
use crate::foreign::bench::example;
use crate::mount::bench::no_fuse;
use crate::support::network::{BRICK, Network};
use crate::support::pass_over;
use crate::support::real_time::{Pace, alone, patiently};
use crate::support::tested_program;
use crate::support::turning_brick::await_that;

/// Poses of a path that are farther apart have a hole between them, metres; as the seed's program
/// counts them.
const HOLE_M: f64 = 0.02;

/// The seed's server, as then.
const SEEDS_PORT: u16 = 5555;

/// The variable's value, where the long form is wanted.
fn long() -> Option<String> {
    std::env::var("ONBRICK_NETWORK").ok()
}

/// What is done to a network, for how long.
#[derive(Debug, Clone)]
enum Trouble {
    Nothing,
    Losing(u32),
    /// The cable is pulled out at a second of the mission, for this many seconds.
    Outages(Vec<(f64, f64)>),
    Flood,
}

impl Trouble {
    fn name(&self) -> String {
        match self {
            Self::Nothing => "quiet".to_owned(),
            Self::Losing(percent) => format!("{percent} % lost"),
            Self::Outages(times) => {
                let times: Vec<String> =
                    times.iter().map(|(_, seconds)| format!("{seconds:.0}")).collect();
                format!("outages {} s", times.join(", "))
            }
            Self::Flood => "flood".to_owned(),
        }
    }

    /// Does it until the mission is over; what is to be said of it.
    fn make(&self, ours: &Apart, seeds: &Network, seconds: f64) -> String {
        let begun = Instant::now();
        let at = |second: f64| {
            std::thread::sleep(Duration::from_secs_f64(second).saturating_sub(begun.elapsed()));
        };
        let said = match self {
            Self::Nothing => String::new(),
            Self::Losing(percent) => {
                for network in [&ours.network, seeds] {
                    assert!(network.losing(*percent), "it was there a moment ago");
                }
                String::new()
            }
            Self::Outages(times) => {
                for (second, lasts) in times {
                    at(*second);
                    ours.network.pull();
                    seeds.pull();
                    at(second + lasts);
                    ours.network.plug();
                    seeds.plug();
                }
                String::new()
            }
            Self::Flood => {
                let key = KeyPair::load(&ours.folder.path().join("brick/keys"))
                    .unwrap()
                    .public()
                    .to_string();
                let flood = |network: &Network, port: u16| {
                    let mut command = network.pc(figures().unwrap().to_str().unwrap());
                    command.args(["flood", &format!("{BRICK}:{port}"), &key, &seconds.to_string()]);
                    command.stdout(Stdio::piped()).spawn().unwrap()
                };
                let (at_ours, at_seeds) = (flood(&ours.network, 5670), flood(seeds, SEEDS_PORT));
                let said = text(&at_ours.wait_with_output().unwrap().stdout);
                at_seeds.wait_with_output().unwrap();
                said.trim().to_owned()
            }
        };
        at(seconds);
        for network in [&ours.network, seeds] {
            if matches!(self, Self::Losing(_)) {
                assert!(network.losing(0));
            }
        }
        said
    }
}

/// What runs inside the namespaces.
fn figures() -> Option<PathBuf> {
    example("link-figures")
}

/// The seed's robot: a mounted simulated brick, its server beside it, its loop at a PC.
struct Seeds {
    network: Network,
    folder: tempfile::TempDir,
    processes: Vec<Child>,
}

impl Seeds {
    fn new() -> Option<Self> {
        let network = Network::new()?;
        let folder = tempfile::tempdir().unwrap();
        let brick = folder.path().join("brick");
        std::fs::create_dir(&brick).unwrap();
        let mut mounted = Pace::command(tested_program());
        let mounted = mounted.arg("sim").arg(&brick).stdout(Stdio::null()).spawn().unwrap();
        let mut seeds = Self { network, folder, processes: vec![mounted] };
        until("the brick is mounted", || brick.join("sim/truth").exists().then_some(()));
        seeds.network.congestion();
        let mut server = seeds.network.brick(figures()?.to_str()?);
        server.arg("seed-server").arg(&brick).arg(format!("{BRICK}:{SEEDS_PORT}"));
        seeds.processes.push(listening(&mut server));
        Some(seeds)
    }

    fn drive(&self, seconds: f64) -> Child {
        let mut command = self.network.pc(figures().unwrap().to_str().unwrap());
        command.args(["seed-loop", &format!("{BRICK}:{SEEDS_PORT}"), &seconds.to_string()]);
        command.stdout(Stdio::piped()).spawn().unwrap()
    }
}

impl Drop for Seeds {
    fn drop(&mut self) {
        for child in self.processes.iter_mut().rev() {
            // The mounted brick takes its mount away with it.
            let process = nix::unistd::Pid::from_raw(i32::try_from(child.id()).unwrap());
            let _ = nix::sys::signal::kill(process, nix::sys::signal::Signal::SIGTERM);
            let _ = child.wait();
        }
        let _ = &self.folder;
    }
}

/// Starts something that says when it listens.
fn listening(command: &mut Command) -> Child {
    let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
    let said = BufReader::new(child.stdout.take().unwrap()).lines().next();
    assert_eq!(said.map(Result::unwrap).as_deref(), Some("listening"));
    child
}

/// A brick of ours that drives, and a PC that follows it.
struct Driving {
    apart: Apart,
    follow: Child,
}

impl Driving {
    fn new(seconds: f64) -> Option<Self> {
        let apart = Apart::new()?;
        apart.network.congestion();
        apart.pair();
        apart.done(&format!("start map blue --set time_limit_s={seconds}"));
        // What happens to the network happens to a robot that drives: before that, its gyro is
        // watched.
        await_that("the robot drives", || apart.drives());
        let follow = apart.pc("fetch blue --timeout 600").stdout(Stdio::null()).spawn().unwrap();
        Some(Self { apart, follow })
    }

    /// Waits for the run's end and for the copy; the run, and whether the copy is the same.
    fn come_home(mut self) -> (Run, bool) {
        let file = self.apart.recording();
        assert!(self.follow.wait().unwrap().success(), "{}", self.apart.log());
        let home = std::fs::read_dir(self.apart.folder.path().join("pc"))
            .unwrap()
            .next()
            .unwrap()
            .unwrap();
        let bytes = std::fs::read(file).unwrap();
        (Run::read(&bytes).unwrap(), std::fs::read(home.path()).unwrap() == bytes)
    }
}

/// One line of the table for a brick of ours.
fn ours(name: &str, (run, is_same): &(Run, bool)) -> String {
    let mut p50: Vec<i64> =
        run.statistics.iter().map(|of_second| of_second.lateness_p50_ns).collect();
    let mut p99: Vec<i64> =
        run.statistics.iter().map(|of_second| of_second.lateness_p99_ns).collect();
    p50.sort_unstable();
    p99.sort_unstable();
    let middle = |all: &[i64]| all.get(all.len() / 2).copied().unwrap_or(0);
    let max = run.statistics.iter().map(|of_second| of_second.lateness_max_ns).max().unwrap_or(0);
    let lost = lost(run);
    let steps = || run.poses.windows(2).map(|two| (&two[0], &two[1]));
    let gap = steps().map(|(a, b)| b.time_ns - a.time_ns).max().unwrap_or(0);
    let hole = |(a, b): (&onbrick::recording::RecordedPose, &onbrick::recording::RecordedPose)| {
        libm::hypot(b.pose.x_m - a.pose.x_m, b.pose.y_m - a.pose.y_m)
    };
    let largest = steps().map(hole).fold(0.0, f64::max);
    let holes = steps().map(hole).filter(|hole| *hole > HOLE_M).count();
    let ended =
        run.ending.as_ref().map_or_else(|| "cut off".to_owned(), |ending| ending.stop.to_string());
    let ms = |ns: i64| onbrick::clock::seconds(ns) * 1000.0;
    let seconds = onbrick::clock::seconds(run.senses.last().map_or(1, |last| last.time_ns));
    let hz = f64::from(u32::try_from(run.senses.len()).unwrap()) / seconds;
    format!(
        "| {name} | {} | {:.3} | {:.3} | {:.2} | {lost} | {} | {hz:.1} | {:.2} | {largest:.3} | \
         {holes} | {ended} |",
        run.senses.len(),
        ms(middle(&p50)),
        ms(middle(&p99)),
        ms(max),
        if *is_same { "the same" } else { "NOT THE SAME" },
        onbrick::clock::seconds(gap),
    )
}

/// Ticks that are not in the record, whether it says so itself or not.
fn lost(run: &Run) -> u64 {
    let missing: u64 = run.senses.windows(2).map(|two| two[1].tick - two[0].tick - 1).sum();
    missing + run.gaps.iter().map(|gap| u64::from(gap.entries)).sum::<u64>()
}

fn seeds(output: &str) -> String {
    let told: Value =
        serde_json::from_str(output.trim()).unwrap_or_else(|error| panic!("{error}: {output}"));
    format!(
        "| the seed's way | {} | | | | | | {:.1} | {:.2} | {:.3} | {} | |",
        told["turns"],
        told["hz"].as_f64().unwrap(),
        told["longest_loss_s"].as_f64().unwrap(),
        told["largest_hole_m"].as_f64().unwrap(),
        told["holes"],
    )
}

#[test]
fn control_does_not_notice_the_network_and_the_seeds_way_does() {
    if no_fuse() || figures().is_none() {
        return;
    }
    let Some(probe) = Network::new() else { return };
    if !probe.losing(50) {
        return;
    }
    let _alone = alone();
    let (seconds, troubles) = if let Some(which) = long() {
        let outages = vec![(10.0, 1.0), (20.0, 3.0), (32.0, 10.0), (60.0, 30.0)];
        let losses = [10, 50, 90].map(Trouble::Losing);
        let rest = [Trouble::Outages(outages), Trouble::Flood];
        let all = [Trouble::Nothing].into_iter().chain(losses).chain(rest);
        (120.0, all.filter(|trouble| which == "1" || trouble.name().starts_with(&which)).collect())
    } else {
        (4.0, vec![Trouble::Losing(50), Trouble::Outages(vec![(1.0, 2.0)])])
    };
    let tables = || {
        println!(
            "congestion control {}, missions of {seconds} s, late: of a second's ticks, in the \
             median second",
            probe.congestion()
        );
        println!(
            "| network | ticks | late p50, ms | p99, ms | max, ms | records lost | copy | turns/s \
             | longest without control, s | largest hole, m | holes | ended |"
        );
        println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
        troubles.iter().for_each(|trouble| case(trouble, seconds));
    };
    // In the long form the reader judges how busy the machine was.
    if long().is_some() { tables() } else { patiently("a bad network", tables) }
}

fn case(trouble: &Trouble, seconds: f64) {
    let (Some(hostile), Some(quiet), Some(seed)) =
        (Driving::new(seconds), Driving::new(seconds), Seeds::new())
    else {
        return pass_over("network namespaces, of which there were some a moment ago");
    };
    let seed_drives = seed.drive(seconds);
    let said = trouble.make(&hostile.apart, &seed.network, seconds);
    let seed_told = text(&seed_drives.wait_with_output().unwrap().stdout);
    let (hostile, quiet) = (hostile.come_home(), quiet.come_home());
    println!("{}", ours(&format!("**{}**", trouble.name()), &hostile));
    println!("{}", ours("beside it, quiet", &quiet));
    println!("{}", seeds(&seed_told));
    if !said.is_empty() {
        println!("({said})");
    }
    for (run, is_same) in [&hostile, &quiet] {
        assert!(*is_same, "the copy is not what is on the brick");
        assert_eq!((lost(run), run.warnings.as_slice()), (0, &[][..]), "records are lost");
        assert!(run.senses.len() > 10, "{} ticks", run.senses.len());
    }
    if let Trouble::Outages(times) = trouble {
        // The cable was out, so this is no matter of the machine's speed.
        let longest = times.iter().fold(0.0_f64, |longest, (_, lasts)| longest.max(*lasts));
        let told: Value = serde_json::from_str(&seed_told).unwrap();
        assert!(told["longest_loss_s"].as_f64().unwrap() > longest * 0.9, "{told}");
    }
}

/// A recording of this many bytes on the brick, as if a run had written it.
fn plant(apart: &mut Apart, bytes: usize) -> PathBuf {
    apart.done("start map blue --set time_limit_s=1");
    apart.done("fetch blue --timeout 60");
    apart.stop();
    let runs = apart.folder.path().join("blue/runs");
    let of = apart.recording().parent().unwrap().to_owned();
    let record: Value =
        serde_json::from_slice(&std::fs::read(of.join("run.json")).unwrap()).unwrap();
    let mut record = record.as_object().unwrap().clone();
    record.insert("run".to_owned(), "large".into());
    record.insert("number".to_owned(), 2.into());
    record.insert("sha256".to_owned(), Value::Null);
    let large = runs.join("large");
    std::fs::create_dir(&large).unwrap();
    std::fs::write(large.join("run.json"), serde_json::to_vec(&record).unwrap()).unwrap();
    let file = large.join("run.mcap");
    let one = std::fs::read(of.join("run.mcap")).unwrap();
    let bytes: Vec<u8> = one.iter().copied().cycle().take(bytes).collect();
    std::fs::write(&file, bytes).unwrap();
    apart.serve();
    file
}

#[test]
fn a_recording_comes_over_a_slow_cable_nearly_as_fast_as_a_plain_copy() {
    let Some(program) = figures() else { return };
    let Some(mut apart) = Apart::new() else { return };
    let congestion = apart.network.congestion();
    apart.pair();
    let (bytes, times) = if long().is_some() { (25_000_000, 3) } else { (500_000, 1) };
    let file = plant(&mut apart, bytes);
    if !apart.network.shaped(20) {
        return;
    }
    println!("{bytes} bytes over 20 Mbit/s, congestion control {congestion}");
    println!("| | seconds | Mbit/s |");
    println!("|---|---|---|");
    let line = |name: &str, seconds: f64| {
        let mbit = f64::from(u32::try_from(bytes).unwrap()) * 8e-6 / seconds;
        println!("| {name} | {seconds:.2} | {mbit:.2} |");
    };
    let (mut copying, mut fetching) = (Vec::new(), Vec::new());
    for _ in 0..times {
        let seconds = plain_copy(&apart, &program, &file);
        line("plain TCP", seconds);
        copying.push(seconds);
        let begun = Instant::now();
        apart.done("fetch blue --run large --timeout 60");
        fetching.push(begun.elapsed().as_secs_f64());
        line("onbrick fetch", begun.elapsed().as_secs_f64());
        let home = apart.folder.path().join("pc/large.mcap");
        assert!(
            std::fs::read(&home).unwrap() == std::fs::read(&file).unwrap(),
            "not the same bytes"
        );
        std::fs::remove_file(home).unwrap();
    }
    let best = |all: &[f64]| all.iter().copied().fold(f64::INFINITY, f64::min);
    let share = best(&copying) / best(&fetching);
    println!("{share:.2} of a plain copy's speed");
    if long().is_some() {
        assert!(share >= 0.8, "{share}");
    }
}

/// Seconds that a plain copy takes.
fn plain_copy(apart: &Apart, program: &Path, file: &Path) -> f64 {
    let address = format!("{BRICK}:7000");
    let mut send = apart.network.brick(program.to_str().unwrap());
    let mut send = listening(send.arg("send").arg(file).arg(&address));
    let mut receive = apart.network.pc(program.to_str().unwrap());
    let output = receive.args(["receive", &address]).output().unwrap();
    assert!(send.wait().unwrap().success());
    let told: Value = serde_json::from_str(&text(&output.stdout)).unwrap();
    assert_eq!(told["bytes"].as_u64(), Some(std::fs::metadata(file).unwrap().len()));
    let seconds = told["seconds"].as_f64().unwrap();
    assert!(seconds < LONG.as_secs_f64(), "{seconds}");
    seconds
}
