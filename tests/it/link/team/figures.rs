//! What a team costs this machine: several simulated bricks at once, each in an arena of its own.
//!
//! `ONBRICK_TEAM=12 ONBRICK_TEAM_S=60 cargo test --test it link::team::figures -- --nocapture`
//! prints the figures.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::time::{Duration, Instant};

use onbrick::recording::Run;

use super::Bricks;
use crate::support::real_time::{Pace, alone, in_real_time};

/// A number from the environment.
pub(super) fn number(name: &str) -> Option<u32> {
    std::env::var(name).ok()?.parse().ok()
}

/// Arenas in rows of four, three metres apart, with a robot and a block in each.
fn world(robots: &[(f64, f64)]) -> String {
    let mut toml = String::from("name = \"many\"\n");
    for (x, y) in robots {
        let corners =
            [(-0.9, -1.0), (1.5, -1.0), (1.5, 1.0), (-0.9, 1.0)].map(|(dx, dy)| [x + dx, y + dy]);
        writeln!(
            toml,
            "[[start]]\nat = [{x:?}, {y:?}]\n[[wall]]\npoints = {corners:?}\nclosed = true"
        )
        .unwrap();
        writeln!(
            toml,
            "[[block]]\nat = [{:?}, {:?}]\nsize_m = [0.39, 0.19]\nturn_deg = 30",
            x + 0.9,
            y + 0.4
        )
        .unwrap();
    }
    toml
}

/// Memory and processor time of a process and those that it has started.
#[derive(Debug, Clone, Copy, Default)]
struct Cost {
    service_kb: u64,
    run_kb: u64,
    ticks: u64,
}

/// A field of `/proc/PID/status` in kB.
fn kb(pid: u32, field: &str) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with(field));
    line.and_then(|line| line.split_whitespace().nth(1)?.parse().ok()).unwrap_or(0)
}

/// Its parent, and its processor time with that of its children that are gone, in ticks of a
/// hundredth of a second.
fn stat(pid: u32) -> Option<(u32, u64)> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = fields[11..15].iter().map(|field| field.parse::<u64>().unwrap()).sum();
    Some((fields[1].parse().ok()?, ticks))
}

fn costs(services: &[u32]) -> BTreeMap<u32, Cost> {
    let entries = std::fs::read_dir("/proc").unwrap().flatten();
    let pids: Vec<u32> =
        entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok()).collect();
    let known: Vec<(u32, u32, u64)> = pids
        .into_iter()
        .filter_map(|pid| stat(pid).map(|(parent, ticks)| (pid, parent, ticks)))
        .collect();
    let cost = |service: &u32| {
        let own = known.iter().find(|(pid, ..)| pid == service).map_or(0, |(.., ticks)| *ticks);
        let children: Vec<_> = known.iter().filter(|(_, parent, _)| parent == service).collect();
        let cost = Cost {
            service_kb: kb(*service, "VmHWM:"),
            run_kb: children.iter().map(|(pid, ..)| kb(*pid, "VmHWM:")).sum(),
            ticks: own + children.iter().map(|(.., ticks)| ticks).sum::<u64>(),
        };
        (*service, cost)
    };
    services.iter().map(cost).collect()
}

#[test]
fn a_team_comes_home_whole_and_what_it_costs_is_printed() {
    let (count, seconds) =
        (number("ONBRICK_TEAM").unwrap_or(3), number("ONBRICK_TEAM_S").unwrap_or(4));
    let _alone = alone();
    in_real_time("a team", |pace| play(count, seconds, pace));
}

fn play(count: u32, seconds: u32, pace: &Pace) {
    let names: Vec<String> = (1..=count).map(|number| format!("brick-{number}")).collect();
    let at = |number: u32| (3.0 * f64::from(number % 4), 3.0 * f64::from(number / 4));
    let places: Vec<(f64, f64)> = (0..count).map(at).collect();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("many.toml");
    std::fs::write(&file, world(&places)).unwrap();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let team = Bricks::watched(file.to_str().unwrap(), &names, pace);
    let poses: Vec<_> =
        names.iter().zip(&places).map(|(name, (x, y))| (*name, *x, *y, 0.0)).collect();
    team.write("map", &poses);

    let services: Vec<u32> = names.iter().map(|name| team.brick(name).process().id()).collect();
    let before = costs(&services);
    let mut most: BTreeMap<u32, Cost> = BTreeMap::new();
    let begun = Instant::now();
    let limit = format!("time_limit_s={seconds}");
    let mut child = team.start(&["--json", "team", "team.toml", "--set", &limit]);
    let out = child.stdout.take().unwrap();
    let reader = std::thread::spawn(move || std::io::read_to_string(out).unwrap());
    let mut pc_kb = 0;
    while child.try_wait().unwrap().is_none() {
        pc_kb = pc_kb.max(kb(child.id(), "VmHWM:"));
        for (service, now) in costs(&services) {
            let most = most.entry(service).or_default();
            most.service_kb = most.service_kb.max(now.service_kb);
            most.run_kb = most.run_kb.max(now.run_kb);
            most.ticks = most.ticks.max(now.ticks);
        }
        std::thread::sleep(Duration::from_millis(200));
    }
    let took_s = begun.elapsed().as_secs_f64();
    let output = child.wait_with_output().unwrap();
    let output = std::process::Output { stdout: reader.join().unwrap().into_bytes(), ..output };
    let code = output.status.code().unwrap();
    // Of more bricks than this machine can simulate some come late, which ends their runs; they
    // come home all the same.
    pace.ensure(code == 0 || count > 3, || super::text(&output.stderr));
    let lines = team.lines(&output, code);
    if !super::all_drove(&team, &lines, &names, pace) {
        return;
    }

    println!(
        "{count} bricks for {seconds} s, exit code {code}, all over after {took_s:.1} s; the PC's \
         command: {:.1} MB",
        mb(pc_kb)
    );
    println!(
        "brick      service MB  run MB  processor %  ticks  overruns  p99 ms  worst ms  points  end"
    );
    let mut punctual = 0;
    for (name, service) in names.iter().zip(&services) {
        let came = team.came(&lines, name);
        assert_eq!(came["whole"], true, "{came}");
        let run = Run::open(&team.path(came["file"].as_str().unwrap())).unwrap();
        let driven_s = run
            .senses
            .last()
            .map_or(1.0, |senses| onbrick::clock::seconds(senses.time_ns))
            .max(1.0);
        let overruns: u32 = run.statistics.iter().map(|stats| stats.overruns).sum();
        let p99_ns = run.statistics.iter().map(|stats| stats.lateness_p99_ns).max().unwrap_or(0);
        let worst_ns = run.statistics.iter().map(|stats| stats.lateness_max_ns).max().unwrap_or(0);
        let cost = most[service];
        let used = (cost.ticks - before[service].ticks) as f64 / driven_s;
        punctual += u32::from(
            came["good"] == true && overruns * 100 <= u32::try_from(run.senses.len()).unwrap(),
        );
        println!(
            "{name:9}  {:10.1}  {:6.1}  {used:11.1}  {:5}  {overruns:8}  {:6.1}  {:8.1}  {:6}  {}",
            mb(cost.service_kb),
            mb(cost.run_kb),
            run.senses.len(),
            onbrick::clock::seconds(p99_ns) * 1000.0,
            onbrick::clock::seconds(worst_ns) * 1000.0,
            run.points.len(),
            came["end"]["word"]
        );
    }
    println!(
        "{punctual} of {count} kept real time: their missions came to their ends with at most 1 % \
         of the ticks late by a period"
    );
}

fn mb(kb: u64) -> f64 {
    kb as f64 / 1024.0
}
