//! Promise 11: hours of missions with random faults, faster than real time.
//!
//! Each stint is made by its seed alone, so one that fails comes again: `ONBRICK_SOAK_SEED=17 cargo
//! test --test it promise_11`. Ten simulated minutes as a rule, 24 hours in the long form, or as
//! many as `ONBRICK_SOAK_HOURS` says.

use nix::errno::Errno;
use onbrick::clock::SECOND_NS;
use onbrick::runtime::replay;
use onbrick::sim::{DeviceFault, Order, Port, Scenario};

use crate::support::chance::Chance;
use crate::support::faulty::{Kind, Plan, Rule, Trouble};
use crate::support::is_long;
use crate::support::promised::promised;
use crate::support::stage::{Play, Played};

/// Missions with the worlds that they are for.
const STINTS: [(&str, &str); 6] = [
    ("map", "arena"),
    ("map", "rooms"),
    ("map", "cylinders"),
    ("wall", "wall"),
    ("square", "open"),
    ("map", "corridor"),
];

/// What a stint came to.
struct Stint {
    played: Played,
    orders: Vec<String>,
}

/// A mission for some minutes, during which things go wrong that the seed decides.
fn stint(seed: u64) -> Stint {
    let mut chance = Chance::new(seed);
    let (mission, world) = *chance.of(&STINTS);
    // Most stints are short, a few take ten minutes.
    let seconds = 20.0 + 580.0 * chance.share() * chance.share() * chance.share();
    let mut play = Play::of(mission, world, seed).seconds(seconds);
    play.journal = true;
    if chance.below(2) == 0 {
        let paused = play.mission_toml.replacen("on_lost = \"stop\"", "on_lost = \"pause\"", 1);
        let said = paused.contains("on_lost");
        play.mission_toml = if said { paused } else { format!("on_lost = \"pause\"\n{paused}") };
    }
    let orders = orders(&mut chance, seconds);
    let told = orders
        .iter()
        .map(|(at_ns, order)| format!("{} s: {}", at_ns / SECOND_NS, order.act))
        .collect();
    play.scenario = Scenario::new(orders);
    play.attributes = attributes(&mut chance);
    play.records = records(&mut chance);
    Stint {
        played: play.play().unwrap_or_else(|error| panic!("seed {seed}: {error}")),
        orders: told,
    }
}

/// Faults of devices, a few a minute, most of them for moments.
fn orders(chance: &mut Chance, seconds: f64) -> Vec<(i64, Order)> {
    let faults = DeviceFault::examples();
    let mut orders = Vec::new();
    let mut at_s = chance.between(1.0, 60.0);
    while at_s < seconds {
        let port = *chance.of(&[Port::OutA, Port::OutB, Port::OutD, Port::In1, Port::In4]);
        let fault = chance.of(&faults).clone();
        let lasts_s = if chance.below(4) == 0 {
            chance.between(0.5, 20.0)
        } else {
            chance.between(0.004, 0.25)
        };
        let text = if fault.is_momentary() {
            format!("{port} {fault}")
        } else {
            format!("{port} {fault} for {lasts_s:.3}")
        };
        for order in Order::parse(0, &text).unwrap() {
            orders.push((onbrick::clock::nanoseconds(at_s), order));
        }
        at_s += chance.between(1.0, 60.0);
    }
    orders
}

/// Attribute calls that fail now and then, one or a few in a row.
fn attributes(chance: &mut Chance) -> Plan {
    let plan = Plan::counting(&[Kind::Read, Kind::Write]);
    let errors =
        [Errno::EIO, Errno::ENODEV, Errno::EAGAIN, Errno::EINTR, Errno::EBUSY, Errno::ENXIO];
    let mut nth = 0;
    for _ in 0..20 {
        nth += u64::try_from(1 + chance.below(20_000)).unwrap();
        let trouble = if chance.below(4) == 0 {
            Trouble::Short(chance.below(3))
        } else {
            Trouble::Fail(*chance.of(&errors))
        };
        plan.add(Rule { nth, times: u64::try_from(1 + chance.below(20)).unwrap(), trouble });
    }
    plan
}

/// A disk that fails in one stint of eight, at any time.
fn records(chance: &mut Chance) -> Plan {
    let disk = [Kind::Write, Kind::Sync];
    if chance.below(8) > 0 {
        return Plan::counting(&disk);
    }
    let trouble = [Trouble::Fail(Errno::ENOSPC), Trouble::Fail(Errno::EIO), Trouble::Short(100)];
    // Behind the first few, which are made before the run begins.
    Plan::once(&disk, u64::try_from(4 + chance.below(300)).unwrap(), chance.of(&trouble).clone())
}

/// What holds however a stint went.
fn judge(seed: u64, stint: &Stint) {
    let what = format!(
        "ONBRICK_SOAK_SEED={seed}: {} ({:?}; {:?})",
        stint.played.reason, stint.orders, stint.played.faults
    );
    let played = &stint.played;
    // A coasting wheel or one that a fault turned off may roll on for a while, but nothing drives
    // it.
    assert!(
        played.truth.speed_mps.abs() < 0.05,
        "{what}: {} m/s a second after the end",
        played.truth.speed_mps
    );
    for write in &played.writes {
        let text = String::from_utf8_lossy(&write.value);
        let speed = write
            .path
            .ends_with("/speed_sp")
            .then(|| text.trim().parse::<i64>().unwrap_or(i64::MAX));
        // `write` and `reset` of a fault are another program's and not in the journal.
        assert!(speed.is_none_or(|speed| speed.abs() <= 1560), "{what}: {} = {text}", write.path);
        let command = write.path.ends_with("/command").then(|| text.trim().to_owned());
        let known = |command: &str| ["run-timed", "stop", "reset"].contains(&command);
        assert!(command.as_deref().is_none_or(known), "{what}: {command:?}");
    }
    let run = played.run();
    assert!(run.integrity.damaged.is_empty(), "{what}: {:?}", run.integrity);
    assert_eq!(run.senses.len() as u64, played.ended.ticks.min(run.senses.len() as u64), "{what}");
    let replayed = replay(&run).unwrap();
    assert!(replayed.is_same(), "{what}: {replayed}");
    if played.ended.recording.is_none() {
        assert_eq!(replayed.ticks, played.ended.ticks, "{what}: {replayed}");
    }
}

/// This process' memory in use, kB, and its open descriptors.
fn used() -> (u64, usize) {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let kilobytes = status
        .lines()
        .find_map(|line| line.strip_prefix("VmRSS:")?.split_whitespace().next()?.parse().ok());
    (kilobytes.unwrap(), std::fs::read_dir("/proc/self/fd").unwrap().count())
}

#[test]
fn promise_11_missions_with_random_faults_for_hours_leave_nothing_driving_and_nothing_behind() {
    if let Some(seed) = std::env::var("ONBRICK_SOAK_SEED").ok().and_then(|seed| seed.parse().ok()) {
        let stint = stint(seed);
        println!(
            "{} after {:.1} s; {:#?}",
            stint.played.reason, stint.played.drove_s, stint.orders
        );
        return judge(seed, &stint);
    }
    let hours =
        std::env::var("ONBRICK_SOAK_HOURS").ok().and_then(|hours| hours.parse::<f64>().ok());
    let wanted_s = 3600.0 * hours.unwrap_or(if is_long() { 24.0 } else { 1.0 / 6.0 });
    let started = std::time::Instant::now();
    let (mut drove_s, mut metres, mut stints, mut faults) = (0.0, 0.0, 0_u64, 0);
    let mut ends = std::collections::BTreeMap::<String, u32>::new();
    let mut first = None;
    while drove_s < wanted_s {
        stints += 1;
        let stint = stint(stints);
        judge(stints, &stint);
        drove_s += stint.played.drove_s;
        metres += stint.played.ended.travelled_m;
        faults += stint.played.faults.len();
        *ends.entry(stint.played.reason.word()).or_default() += 1;
        // Whatever is made once is made by then.
        if first.is_none() && drove_s > 0.1 * wanted_s {
            first = Some(used());
        }
    }
    let (before, after) = (first.unwrap_or_else(used), used());
    if is_long() {
        // Alone in its process: other tests open files of their own.
        assert_eq!(before.1, after.1, "descriptors");
        assert!(after.0 < before.0 + 50_000, "memory: {} kB, then {} kB", before.0, after.0);
    }
    promised(&format!(
        "{:.2} simulated hours in {:.0} s: {stints} runs, {metres:.0} m, {faults} faults of \
         devices; ended {ends:?}; memory {} then {} kB, descriptors {} then {}",
        drove_s / 3600.0,
        started.elapsed().as_secs_f64(),
        before.0,
        after.0,
        before.1,
        after.1
    ));
}

#[test]
fn promise_11_a_stint_comes_again_by_its_seed() {
    let [one, again] = [3, 3].map(stint);
    assert_eq!(one.played.disk.bytes(), again.played.disk.bytes());
    assert_eq!(one.played.faults, again.played.faults);
    promised("the same seed gave the same recording, byte for byte");
}
