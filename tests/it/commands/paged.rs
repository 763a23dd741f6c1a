//! `run --page`: the page of a run, over the wire and in a real browser.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use onbrick::clock::MonotonicClock;
use serde_json::Value;

use super::{onbrick, onbrick_in_time, run};
use crate::mount::bench::{Mounted, no_fuse, real_time};
use crate::support::browser::act;
use crate::support::real_time::in_real_time;

/// How long anything may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// A run with a page, as a program reads it.
struct Paged {
    child: Child,
    /// What it says, which is always read.
    events: Receiver<Value>,
    url: String,
}

impl Paged {
    fn start(mut child: Child) -> Self {
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let (say, events) = channel();
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                let _ = say.send(serde_json::from_str(&line).unwrap());
            }
        });
        let first: Value = events.recv_timeout(PATIENCE).unwrap();
        let url = first["page"].as_str().unwrap().to_owned();
        Self { child, events, url }
    }

    /// Reads what it says until an event of this name.
    fn until_event(&self, name: &str) -> Value {
        loop {
            let event = self.events.recv_timeout(PATIENCE).expect("it says more");
            if event["event"] == name {
                return event;
            }
        }
    }

    fn ask(&self, method: &str, path: &str, body: &str) -> (u16, String) {
        let host = self.url.trim_start_matches("http://").trim_end_matches('/');
        let mut stream = TcpStream::connect(host).unwrap();
        let length = body.len();
        let request = format!(
            "{method} {path} HTTP/1.0\r\nHost: {host}\r\nX-Onbrick: 1\r\n\
             Content-Length: {length}\r\n\r\n{body}"
        );
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        (head.split(' ').nth(1).unwrap().parse().unwrap(), body.to_owned())
    }

    fn post(&self, path: &str, body: &str) {
        assert_eq!(self.ask("POST", path, body), (200, "done\n".to_owned()), "{path} {body}");
    }

    fn refused(&self, path: &str, body: &str) -> String {
        let (status, why) = self.ask("POST", path, body);
        assert_eq!(status, 400, "{path} {body}: {why}");
        why
    }

    fn state(&self) -> Value {
        let (status, body) = self.ask("GET", "/state", "");
        assert_eq!(status, 200, "{body}");
        serde_json::from_str(&body).unwrap_or_else(|error| panic!("{error}: {body}"))
    }

    fn until_state(&self, holds: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let state = self.state();
            if holds(&state) {
                return state;
            }
            assert!(begun.elapsed() < PATIENCE, "{state}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Ctrl-C.
    fn interrupt(mut self) -> Option<i32> {
        kill(Pid::from_raw(i32::try_from(self.child.id()).unwrap()), Signal::SIGINT).unwrap();
        self.child.wait().unwrap().code()
    }
}

fn paged(folder: &Path, arguments: &[&str]) -> Paged {
    let arguments = [&["--json", "run"], arguments, &["--page"]].concat();
    let child = onbrick(folder, &arguments).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
    Paged::start(child.unwrap())
}

fn bytes(folder: &Path, run: &str) -> Vec<u8> {
    std::fs::read(folder.join(run).join("run.mcap")).unwrap()
}

/// What a map's mission also tells people, for which the page has places.
const TELLS: &str = r#"
[variables]
counted = 0
[machine.tell]
start = "count"
[machine.tell.state.count]
on_entry = { led = "orange" }
do = { tone_hz = 440, say = "counted {counted}" }
next = [{ when = "state_s > 0.5", set = { counted = "counted + 1" }, go = "again" }]
[machine.tell.state.again]
do = { tone_hz = 880 }
next = [{ when = "state_s > 0.5", go = "count" }]
"#;

#[test]
fn a_page_changes_nothing_in_a_recording_and_starts_what_the_file_says_then() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mission = folder.join("my.toml");
    let shipped = run(folder, &["new", "mission", "--from", "map", "my.toml"]);
    shipped.expect(0);
    let text = std::fs::read_to_string(&mission).unwrap();
    let common = ["my.toml", "--sim", "arena", "--set", "time_limit_s=4", "--out"];
    run(folder, &[&["run"], &common[..], &["plain", "--json"]].concat()).expect(0);

    let page = paged(folder, &[&common[..], &["paged"]].concat());
    let state = page.until_state(|state| !state["run"]["phase"].is_null());
    assert_eq!(
        (&state["run"]["phase"], &state["run"]["note"]),
        (&"preparing".into(), &"getting ready".into())
    );
    page.until_event("driving");
    let state = page.state();
    for part in ["room", "sim", "run", "pace"] {
        assert!(state.get(part).is_some(), "{part}: {state}");
    }
    assert_eq!(state["can"], serde_json::json!(["order", "pace", "stop", "again"]));
    assert_eq!(state["pace"], "1", "as a real robot");
    assert!(page.refused("/pace", "7").contains("1, 4, max"));
    page.post("/pace", "4");
    page.post("/pace", "max");
    page.until_event("ended");
    assert!(bytes(folder, "plain") == bytes(folder, "paged"), "the page changed the recording");
    let state = page.until_state(|state| state["run"]["phase"] == "ended");
    assert_eq!(state["can"], serde_json::json!(["pace", "again"]));
    assert!(page.refused("/wish", "stop").contains("cannot do that now"));
    assert!(page.refused("/order", "press enter").contains("start it again"));
    let note = state["run"]["note"].as_str().unwrap();
    assert!(note.contains("after 4.0 s") && note.contains("paged/run.mcap"), "{note}");

    std::fs::write(&mission, text.replacen("go = \"", "go = \"x", 1)).unwrap();
    page.post("/wish", "again");
    let state = page.until_state(|state| state["run"]["phase"] == "refused");
    let note = state["run"]["note"].as_str().unwrap();
    assert!(note.contains("--> my.toml:"), "{note}");
    std::fs::write(&mission, text).unwrap();
    page.post("/wish", "again");
    page.until_event("ended");
    assert_eq!(page.state()["pace"], "max", "the pace stays");
    assert!(bytes(folder, "paged-2") == bytes(folder, "paged"), "the same start, the same run");
    assert_eq!(page.interrupt(), Some(0));
}

#[test]
fn a_run_that_is_stopped_while_it_gets_ready_can_be_started_again() {
    let folder = tempfile::tempdir().unwrap();
    let page = paged(folder.path(), &["map", "--sim", "arena", "--out", "out"]);
    page.until_state(|state| state["run"]["phase"] == "preparing");
    page.post("/wish", "stop");
    let state = page.until_state(|state| state["run"]["phase"] == "refused");
    let note = state["run"]["note"].as_str().unwrap();
    assert!(note.contains("stopped on the page"), "{note}");
    page.post("/wish", "again");
    page.until_state(|state| state["run"]["phase"] == "preparing");
    page.post("/wish", "again");
    page.until_event("driving");
    assert_eq!(page.interrupt(), None);
}

#[test]
fn ctrl_c_ends_run_and_page() {
    let folder = tempfile::tempdir().unwrap();
    let page = paged(folder.path(), &["square", "--sim", "open", "--out", "out"]);
    page.until_event("driving");
    assert_eq!(page.interrupt(), None, "it dies of Ctrl-C, as a shell expects it");
    let recorded = onbrick::recording::Run::read(&bytes(folder.path(), "out")).unwrap();
    let reason = recorded.ending.unwrap().stop.reason;
    assert_eq!(reason, onbrick::runtime::StopReason::Signal);
}

/// A pupil's hand, on a phone in the dark: faster, carries the robot, presses a button, stops, and
/// starts again.
#[test]
fn a_browser_shows_a_run_and_a_hand_steers_the_simulation() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), &["new", "mission", "--from", "map", "my.toml"]).expect(0);
    let mission = folder.path().join("my.toml");
    let text = std::fs::read_to_string(&mission).unwrap() + TELLS;
    std::fs::write(&mission, text).unwrap();
    let page = paged(folder.path(), &["my.toml", "--sim", "arena", "--set", "time_limit_s=60"]);
    let seen = act(
        &page.url,
        (390, 844),
        &["--blink-settings=preferredColorScheme=0"],
        "const one = (selector) => document.querySelector(selector); \
         await until(() => news.run.phase === 'driving' && time() > 0.3); \
         const seen = { \
             wide: document.documentElement.scrollWidth <= innerWidth, width: innerWidth, \
             dark: getComputedStyle(document.body).backgroundColor, \
             state: one('.state').textContent, \
             screen: (await until(() => one('.brick img').naturalWidth)), \
             lights: (await until(() => one('[data-lights*=amber]'))).dataset.lights, \
             tone: (await until(() => one('.tone.sounds'))).textContent, \
             said: (await until(() => one('.said'))).textContent, \
             variable: (await until(() => one('#variables table'))).textContent, \
             units: one('#robots table').textContent, \
             title: one('h1').textContent, walls: canvas.dataset.walls }; \
         click('[data-pace=\"4\"]'); \
         await until(() => news.pace === '4'); \
         const [from_s, from_ms] = [time(), performance.now()]; \
         await until(() => performance.now() - from_ms > 2000); \
         seen.rate = (time() - from_s) / (performance.now() - from_ms) * 1000; \
         await until(() => kept.points.length && kept.path.length && kept.history.look?.length); \
         const box = canvas.getBoundingClientRect(); \
         const robot = news.sim.robots[0]; \
         const go = (kind, [x, y]) => pointer(kind, canvas, box.left + x, box.top + y); \
         const to = [robot.x_m, robot.y_m - 0.4]; \
         go('pointerdown', px([robot.x_m, robot.y_m])); \
         go('pointermove', px([to[0], to[1] + 0.2])); \
         go('pointermove', px(to)); \
         go('pointerup', px(to)); \
         await until(() => news.sim.done.some((what) => what.includes('place'))); \
         seen.off = news.sim.robots[0].y_m - news.run.status.y_m; \
         pointer('pointerdown', one('[data-button=left]'), 0, 0); \
         await until(() => one('[data-button=left].down')); \
         pointer('pointerup', window, 0, 0); \
         await until(() => !one('.keys .down')); \
         click('#stop'); \
         await until(() => news.run.phase === 'ended'); \
         seen.ended = document.getElementById('note').textContent; \
         seen.hidden = document.getElementById('stop').hidden; \
         click('#again'); \
         await until(() => news.session === 2 && news.run.phase === 'driving'); \
         seen.again = news.sim.robots[0].y_m; \
         seen.fresh = time() < 5 && !kept.history.look?.[20]; \
         click('[data-pace=max]'); \
         await until(() => news.run.phase === 'ended'); \
         await until(() => time() > 59 && +canvas.dataset.points > 100); \
         seen.time = time(); \
         seen.points = +canvas.dataset.points; \
         report(seen);",
    );
    let code = page.interrupt();
    let Some(seen) = seen else { return };
    println!("{seen:#}");
    assert_eq!(code, Some(0));
    assert_eq!((&seen["wide"], &seen["width"]), (&true.into(), &390.into()), "fits a phone");
    assert_eq!(seen["dark"], "rgb(20, 23, 27)");
    assert_eq!((&seen["title"], &seen["screen"]), (&"my in arena".into(), &178.into()));
    assert!(["forward", "look_left"].contains(&seen["state"].as_str().unwrap()), "{seen}");
    let units = seen["units"].as_str().unwrap();
    assert!(units.contains("°/s") && units.contains("range_m") && !units.contains("US-DIST"));
    assert_eq!(seen["lights"], "amber amber");
    assert!(["♪ 440 Hz", "♪ 880 Hz"].contains(&seen["tone"].as_str().unwrap()), "{seen}");
    assert!(seen["said"].as_str().unwrap().starts_with("counted "));
    assert!(seen["variable"].as_str().unwrap().starts_with("counted"), "{seen}");
    let number = |name: &str| seen[name].as_f64().unwrap();
    assert!((1.5..6.0).contains(&number("rate")), "{} times as fast", number("rate"));
    assert!(number("off") < -0.3, "the robot does not know that it was carried");
    let ended = seen["ended"].as_str().unwrap();
    assert!(ended.contains("stopped on the page") && ended.contains("my-1/run.mcap"), "{ended}");
    assert_eq!((&seen["hidden"], &seen["fresh"]), (&true.into(), &true.into()));
    assert!(number("again").abs() < 0.1, "it starts where it started");
    assert!(number("time") > 59.0 && number("points") > 100.0);
    assert!(bytes(folder.path(), "onbrick-runs/my-2").len() > 1000);
}

/// Of a brick the page shows what its recording has; nothing there can be steered, but it can stop.
#[test]
fn a_run_on_a_mounted_brick_is_shown_and_can_be_stopped() {
    if no_fuse() {
        return;
    }
    let _alone = real_time();
    in_real_time("a run with a page on a mounted brick", |pace| {
        let mounted = Mounted::in_world("arena", 1, Arc::new(MonotonicClock)).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let root = mounted.root();
        let root = root.to_str().unwrap();
        let arguments = ["--json", "run", "map", "--brick", root, "--out", "out", "--page"];
        let child = onbrick_in_time(folder.path(), &arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        pace.watch(&child);
        let page = Paged::start(child);
        let is_over = |state: &Value| {
            ["ended", "failed", "refused"].iter().any(|phase| state["run"]["phase"] == **phase)
        };
        let state = page.until_state(|state| {
            is_over(state) || state["run"]["points"].as_array().is_some_and(|all| !all.is_empty())
        });
        pace.ensure(state["run"]["phase"] == "driving", || format!("{}", state["run"]["note"]));
        if !is_over(&state) {
            assert_eq!(state["can"], serde_json::json!(["stop"]));
            for part in ["room", "sim", "pace"] {
                assert!(state.get(part).is_none(), "a brick cannot give its {part}: {state}");
            }
            assert!(!state["run"]["path"].as_array().unwrap().is_empty(), "{state}");
            assert!(page.refused("/order", "press enter").contains("no simulation"));
            page.post("/wish", "stop");
            let state = page.until_state(is_over);
            let note = state["run"]["note"].as_str().unwrap();
            pace.ensure(note.contains("stopped on the page"), || note.to_owned());
            assert_eq!(state["can"], serde_json::json!([]));
        }
        let code = page.interrupt();
        pace.ensure(code.is_none(), || format!("exit code {code:?}"));
    });
}
