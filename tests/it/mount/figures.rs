//! What the mount costs, printed in one run.

use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use nix::sys::resource::{UsageWho, getrusage};
use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock, SECOND_NS, seconds};
use onbrick::sim::World;

use super::bench::{Mounted, no_fuse, real_time};
use crate::support::real_time::{Pace, in_real_time};

/// A room with this many robots in it.
fn room(robots: usize) -> World {
    let mut text =
        "name = \"hall\"\n[[wall]]\npoints = [[-1.0, -1.0], [13.0, -1.0], [13.0, 13.0], [-1.0, \
         13.0]]\nclosed = true\n"
            .to_owned();
    for robot in 0..robots {
        text.push_str(&format!(
            "[[start]]\nat = [{}.0, {}.0]\nheading_deg = {}\n",
            robot % 13,
            robot / 13,
            40 * robot % 360
        ));
    }
    World::parse("hall.toml", text.as_bytes()).unwrap().0
}

/// Processor time of this process, seconds.
fn used_s() -> f64 {
    let usage = getrusage(UsageWho::RUSAGE_SELF).unwrap();
    let s = |time: nix::sys::time::TimeVal| time.tv_sec() as f64 + time.tv_usec() as f64 / 1e6;
    s(usage.user_time()) + s(usage.system_time())
}

fn reads_per_s(file: &File) -> f64 {
    let mut buffer = [0; 64];
    let started_ns = MonotonicClock.now_ns();
    let mut reads = 0_u32;
    while MonotonicClock.now_ns() - started_ns < SECOND_NS / 2 {
        for _ in 0..100 {
            file.read_at(&mut buffer, 0).unwrap();
        }
        reads += 100;
    }
    f64::from(reads) / seconds(MonotonicClock.now_ns() - started_ns)
}

fn drive(root: &Path) {
    for motor in ["motor1", "motor2"] {
        let write = |attribute: &str, value: &str| {
            std::fs::write(root.join("sys/class/tacho-motor").join(motor).join(attribute), value)
                .unwrap();
        };
        write("speed_sp", "200");
        write("command", "run-forever");
    }
}

/// Reads what a control loop reads, 100 times a second, until told to stop; the number of rounds.
fn read_at_100_hz(root: &Path, stop: &AtomicBool) -> u32 {
    let open =
        |path: &str| OpenOptions::new().read(true).open(root.join("sys/class").join(path)).unwrap();
    let files = [
        open("tacho-motor/motor0/position"),
        open("tacho-motor/motor1/position"),
        open("tacho-motor/motor2/position"),
        open("lego-sensor/sensor0/value0"),
        open("lego-sensor/sensor3/value0"),
    ];
    let mut buffer = [0; 64];
    let mut due_ns = MonotonicClock.now_ns();
    let mut rounds = 0;
    while !stop.load(Ordering::Relaxed) {
        for file in &files {
            file.read_at(&mut buffer, 0).unwrap();
        }
        rounds += 1;
        due_ns += 10 * MILLISECOND_NS;
        MonotonicClock.sleep_until_ns(due_ns);
    }
    rounds
}

/// What a load came to.
struct Load {
    /// Of one processor.
    share: f64,
    /// The furthest that simulated time was behind, milliseconds.
    worst_lag_ms: f64,
    /// Rounds of readings a second and robot.
    rounds_per_s: f64,
}

fn load(robots: usize, drives: bool, reads: bool, for_s: f64) -> Option<Load> {
    let mounted = Mounted::among(room(robots), robots, Arc::new(MonotonicClock))?;
    let roots: Vec<_> = (0..robots).map(|robot| mounted.mount().root(robot)).collect();
    if drives {
        roots.iter().for_each(|root| drive(root));
    }
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let readers: Vec<_> = roots
            .iter()
            .filter(|_| reads)
            .map(|root| scope.spawn(|| read_at_100_hz(root, &stop)))
            .collect();
        let (started_ns, before_s) = (MonotonicClock.now_ns(), used_s());
        let offset_ns = started_ns - mounted.simulation.now_ns();
        let mut worst_lag_ns = 0;
        while seconds(MonotonicClock.now_ns() - started_ns) < for_s {
            MonotonicClock.sleep_ns(20 * MILLISECOND_NS);
            let simulated_ns = mounted.simulation.now_ns();
            worst_lag_ns = worst_lag_ns.max(MonotonicClock.now_ns() - offset_ns - simulated_ns);
        }
        let passed_s = seconds(MonotonicClock.now_ns() - started_ns);
        let share = (used_s() - before_s) / passed_s;
        stop.store(true, Ordering::Relaxed);
        let rounds: u32 = readers.into_iter().map(|reader| reader.join().unwrap()).sum();
        let rounds_per_s = f64::from(rounds) / passed_s / robots as f64;
        Some(Load { share, worst_lag_ms: seconds(worst_lag_ns) * 1000.0, rounds_per_s })
    })
}

/// Alone on the machine: `cargo test --test it mount::figures -- --nocapture --test-threads=1`.
#[test]
fn figures_of_the_mounted_simulation() {
    if no_fuse() {
        return;
    }
    let _alone = real_time();
    in_real_time("figures", figures);
}

fn figures(pace: &Pace) {
    let mounted = Mounted::in_world("arena", 1, Arc::new(MonotonicClock)).unwrap();
    let attribute = File::open(mounted.path("sys/class/tacho-motor/motor1/position")).unwrap();
    let folder =
        tempfile::Builder::new().tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap();
    std::fs::write(folder.path().join("plain"), "0\n").unwrap();
    let plain = File::open(folder.path().join("plain")).unwrap();
    let (through_mount, on_tmpfs) = (reads_per_s(&attribute), reads_per_s(&plain));
    println!(
        "reads a second of one attribute: {through_mount:.0} through the mount, {on_tmpfs:.0} of a \
         plain file on tmpfs"
    );
    drop((attribute, mounted));

    let idle = load(1, false, false, 1.0).unwrap();
    let driving = load(1, true, true, 1.0).unwrap();
    println!(
        "share of one processor: idle {:.1} %, driving and read at {:.0} Hz {:.1} % (readers \
         included)",
        idle.share * 100.0,
        driving.rounds_per_s,
        driving.share * 100.0
    );
    let mut kept = 1;
    for robots in [2, 5, 10, 20, 40, 80, 160] {
        let load = load(robots, true, true, 1.0).unwrap();
        println!(
            "{robots} robots driving, each read at 100 Hz: {:.0} Hz came, simulated time at most \
             {:.1} ms behind, {:.0} % of one processor",
            load.rounds_per_s,
            load.worst_lag_ms,
            load.share * 100.0
        );
        if robots == 10 {
            pace.ensure(load.worst_lag_ms < 250.0, || {
                format!("10 robots: simulated time was {} ms behind", load.worst_lag_ms)
            });
        }
        if load.worst_lag_ms > 100.0 || load.rounds_per_s < 90.0 {
            break;
        }
        kept = robots;
    }
    println!("real time was kept with {kept} robots");
}
