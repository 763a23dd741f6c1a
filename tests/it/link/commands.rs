//! The commands of a PC against the real service with a simulated brick, in processes of their own.

use std::io::Write as _;
use std::os::unix::process::CommandExt as _;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use onbrick::clock::MonotonicClock;
use onbrick::link::{KeyPair, KnownBrick, KnownBricks};
use onbrick::recording::Run;
use serde_json::Value;

use super::bench::{LONG, Service, halves, onbrick, text, until};
use crate::foreign::bench::{no_namespaces, unshare};
use crate::mount::bench::Mounted;
use crate::support::real_time::{beside_others, patiently};
use crate::support::{OTHER_USER, pass_over, tested_program};

/// A mission that is over in two seconds.
pub const SHORT: &str = r#"
name = "short"
time_limit_s = 60
[machine.drive]
start = "forward"
final = "halt"
[machine.drive.state.forward]
do = { left_dps = 90, right_dps = 90 }
next = [{ when = "time_s > 2", go = "halt" }]
[machine.drive.state.halt]
do = { stop = "brake" }
"#;

/// The newest run's identifier.
pub fn newest(service: &Service) -> String {
    let said = service.done(&["runs", "sim", "--json"]);
    let runs: Value = serde_json::from_str(said.lines().next().unwrap()).unwrap();
    runs["runs"][0]["run"].as_str().unwrap().to_owned()
}

#[test]
fn a_person_pairs_starts_watches_stops_and_brings_the_map_home() {
    let _machine = beside_others();
    patiently("a person's way from pairing to the map", from_pairing_to_the_map);
}

fn from_pairing_to_the_map() {
    let service = Service::new();
    assert!(service.log().contains("drives as the shipped robot"), "{}", service.log());
    // On the brick a person opens the window and says yes; on the PC too.
    std::fs::write(service.path("yes"), "yes\n").unwrap();
    let mut there = onbrick()
        .args(["pair", "--config"])
        .arg(service.folder.path())
        .arg("--answers")
        .arg(service.path("yes"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let yes = service.path("yes").display().to_string();
    let said = service.done(&[
        "pair",
        &service.address,
        "--name",
        "anna",
        "--answers",
        &yes,
        "--timeout",
        "60",
    ]);
    assert!(said.starts_with("sim is known from now on"), "{said}");
    assert!(there.wait().unwrap().success());

    service.says(&["bricks"], &service.address);
    assert!(service.says(&["status"], "ready").starts_with("sim  ready  "));
    service.says(&["missions", "sim"], "sim  map  120 s");
    service.says(&["identify", "sim"], "beeps");
    assert_eq!(service.done(&["runs", "sim"]).trim_end(), "sim: no run is there yet");
    assert!(service.says(&["start", "map", "sim"], "started").starts_with("sim: started map-"));
    let status = service.until_it_drives();
    assert!(status.contains("started by anna"), "{status}");
    let again = service.pc(&["start", "map", "sim"]);
    let (said, error) = (text(&again.stdout), text(&again.stderr));
    assert_eq!(again.status.code(), Some(3), "one run at a time: {said}{error}{}", service.log());

    assert!(service.says(&["stop"], "stopped").starts_with("sim: stopped map-"));
    until("it has stopped", || service.done(&["status", "sim"]).contains("stopped").then_some(()));
    service.says(&["stop"], "nothing was running");
    let status = service.says(&["status"], "): stopped over the network");
    assert!(!status.contains("remote"), "the same twice: {status}");
    let run = newest(&service);
    let fetched = service.done(&["fetch", "sim"]);
    assert!(fetched.contains(&format!("{run}.mcap")), "{fetched}");
    let file = service.path("out").join(format!("{run}.mcap"));
    let recording = Run::open(&file).unwrap();
    assert_eq!(recording.info.unwrap().mission, "map");
    service.says(&["fetch", "sim"], "was there already");
    let followed = service.says(&["fetch", "sim", "--follow"], "was there already");
    assert!(followed.contains(&format!("{run} is over")), "{followed}");
    assert!(!followed.contains("http://"), "a page that is gone at once: {followed}");
    service.says(&["runs", "sim"], "fetched");
    service.done(&["plot", &file.display().to_string(), "-o", "map.svg"]);
}

#[test]
fn a_brick_that_is_away_keeps_none_waiting_for_the_word_that_another_stands() {
    let service = Service::new();
    // In the file, it comes first.
    let folder = service.path("pc");
    KeyPair::load_or_make(&folder).unwrap();
    let key = KeyPair::generate().unwrap().public();
    let away = KnownBrick { name: "away".to_owned(), address: "127.0.0.1:9".to_owned(), key };
    KnownBricks::load(&folder).unwrap().put(&away, None).unwrap();
    service.introduce();
    let said = service.pc(&["stop", "--timeout", "2"]);
    let out = text(&said.stdout);
    let names: Vec<&str> = out.lines().filter_map(|line| line.split(':').next()).collect();
    assert_eq!((&names[..], said.status.code()), (&["sim", "away"][..], Some(5)), "{out}");
}

#[test]
fn a_stop_ends_what_another_user_drives_without_the_service_too() {
    let _machine = beside_others();
    let Some(brick) = Mounted::in_world("arena", 1, Arc::new(MonotonicClock)) else { return };
    let root = brick.root();
    let place = ["--brick", root.to_str().unwrap()];
    let Some(service) = Service::of_another_user("sim", &place) else {
        return pass_over("root, to serve as another user");
    };
    service.introduce();
    let command = |arguments: &[&str]| {
        let mut command = onbrick();
        command.args(arguments).arg("--brick").arg(&root).current_dir(service.path(""));
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        command.spawn().unwrap()
    };
    let is_turning = || {
        let motors = std::fs::read_dir(root.join("sys/class/tacho-motor")).unwrap();
        let mut states =
            motors.map(|motor| std::fs::read_to_string(motor.unwrap().path().join("state")));
        states.any(|state| state.unwrap().contains("running"))
    };
    let turns = || until("a motor turns", || is_turning().then_some(()));
    let stays_still = |what: &str| {
        for _ in 0..10 {
            assert!(!is_turning(), "{what}");
            std::thread::sleep(Duration::from_millis(100));
        }
    };

    // A run of a shell's.
    std::fs::write(service.path("short.toml"), SHORT.replace("> 2", "> 50")).unwrap();
    let mut run = command(&["run", "./short.toml", "--out", "o"]);
    turns();
    service.says(&["status"], "the motors belong to mission short (process ");
    assert!(text(&service.pc(&["start", "map", "sim"]).stderr).contains("mission short"));
    service.says(&["stop"], "sim: stopped mission short (process ");
    stays_still("after a stop of the run");
    assert_eq!(run.wait().unwrap().code(), Some(6));
    let ending = Run::open(&service.path("o/run.mcap")).unwrap().ending.unwrap();
    assert_eq!(ending.stop.to_string(), "stopped over the network");

    // A calibration at the menu, which stays.
    std::fs::write(service.path("robot.toml"), onbrick::robot::DEFAULT_ROBOT).unwrap();
    let mut menu = command(&["menu", "--config", ".", "--frames", "frames"]);
    let mut keys = menu.stdin.take().unwrap();
    let mut press = |pressed: &str| keys.write_all(pressed.as_bytes()).unwrap();
    let page = || std::fs::read_to_string(service.path("frames/page.txt")).unwrap_or_default();
    let shows = |words: &str| until(words, || page().contains(words).then_some(()));
    shows("[Missions]");
    press("rrrddd");
    shows("> Find own echoes");
    press("e");
    shows("> yes");
    press("e");
    turns();
    service.says(&["stop"], "sim: stopped calibrating at the menu (process ");
    stays_still("after a stop of the calibration");
    shows("stopped; nothing was written");
    press("e");
    shows("[Set up]");
    service.says(&["stop"], "sim: nothing was running");
    assert!(menu.try_wait().unwrap().is_none(), "the menu is still there");
    menu.kill().unwrap();
    menu.wait().unwrap();

    // Who may not send it a signal.
    let mut run = command(&["run", "./short.toml", "--out", "p"]);
    turns();
    let mut halt = Command::new(service.path("onbrick"));
    halt.uid(OTHER_USER).gid(OTHER_USER).args(["halt", "--brick"]).arg(&root);
    let said = halt.output().unwrap();
    assert!(text(&said.stdout).starts_with("stopped mission short (process "), "{said:?}");
    assert_eq!((said.status.code(), run.wait().unwrap().code()), (Some(0), Some(6)));
    stays_still("after a halt");
}

#[test]
fn refusals_and_silence_have_exit_codes_and_a_way_out() {
    let mut service = Service::new();
    let refused = |output: std::process::Output, code: i32, words: &str| {
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{error}");
        assert!(error.contains(words) && error.contains("try: "), "{error}");
    };
    refused(service.pc(&["status"]), 3, "no brick is known yet");
    service.introduce();
    refused(service.pc(&["status", "simm"]), 3, "did you mean");
    refused(service.pc(&["start", "mapp", "sim"]), 3, "mapp");
    let said = text(&service.pc(&["start", "map", "sim", "--set", "foo=1"]).stderr);
    assert!(said.contains("--set foo=1: the mission has no number `foo`"), "{said}");
    std::fs::create_dir_all(service.path("out")).unwrap();
    std::fs::write(service.path("out").join("broken.toml"), "name = \"x\"\nrate = 3\n").unwrap();
    refused(service.pc(&["start", "broken.toml", "sim"]), 3, "unknown key");
    std::fs::write(service.path("out").join("long.toml"), "# ".repeat(40_000)).unwrap();
    refused(service.pc(&["start", "long.toml", "sim"]), 3, "over the network");
    refused(service.pc(&["fetch", "-o", "/proc/none"]), 3, "cannot make /proc/none");
    service.done(&["start", "map", "sim"]);
    service.until_it_drives();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    refused(service.pc(&["fetch", "--follow", "--page", &port]), 3, "another port for --page");
    service.done(&["stop"]);
    let key = KeyPair::load(&service.path("pc")).unwrap().public().to_string();
    let keys = service.path("keys").display().to_string();
    service.says(&["key", "list", "--keys", &keys], "anna");
    service.says(&["key", "revoke", "anna", "--keys", &keys], "turned away");
    refused(service.pc(&["stop", "sim"]), 3, "not, or no longer, authorised");
    service.done(&["key", "authorise", &key, "--name", "anna", "--keys", &keys]);
    service.done(&["status", "sim"]);
    service.kill();
    refused(service.pc(&["status", "--timeout", "1"]), 4, "no answer from");
    refused(service.pc(&["stop", "--timeout", "1"]), 4, "`onbrick halt` there, over ssh");
    refused(service.pc(&["pair", &service.address, "--timeout", "1"]), 4, "was not introduced");
    refused(service.pc(&["pair", &service.address, "--timeout", "1"]), 4, "HOST:PORT");
    let of_requests = format!("{}:5670", service.address);
    let asked = service.pc(&["pair", &of_requests, "--timeout", "1"]);
    refused(asked, 4, "the brick's `pairing_port`, and not its `port`?");
    service.says(&["pair", "--help"], "HOST[:PAIRING_PORT]");
}

#[test]
fn a_mission_of_the_pcs_runs_and_its_text_is_kept_with_the_run() {
    patiently("a_mission_of_the_pcs_runs_and_its_text_is_kept_with_the_run", || {
        let service = Service::new();
        service.introduce();
        std::fs::create_dir_all(service.path("out")).unwrap();
        std::fs::write(
            service.path("out").join("mine.toml"),
            SHORT.replace("\"short\"", "\"mine\""),
        )
        .unwrap();
        service.done(&["start", "./mine.toml", "sim"]);
        // The fetch follows the run to its end.
        let fetched = service.done(&["fetch", "sim"]);
        let file = fetched.split(' ').nth(1).unwrap().trim_end_matches(',').to_owned();
        let recording =
            Run::open(&service.path("out").join(file.trim_start_matches("./"))).unwrap();
        assert_eq!(recording.info.as_ref().unwrap().mission, "mine");
        assert_eq!(recording.ending.unwrap().stop.to_string(), "the mission is finished");
        assert!(
            !service.done(&["missions", "sim"]).contains("mine"),
            "kept with the run, and nowhere else"
        );
    });
}

#[test]
#[cfg_attr(
    target_arch = "arm",
    ignore = "the page is a PC's, and beside a browser QEMU's user mode is late, which ends the \
              run as it should"
)]
fn a_run_is_followed_on_a_page_that_grows() {
    let _machine = beside_others();
    patiently("a run on a page that grows", a_page_that_grows);
}

fn a_page_that_grows() {
    let service = Service::new();
    service.introduce();
    // It drives until it is stopped: a browser takes its time on a busy machine.
    service.done(&["start", "map", "sim"]);
    // A run that is stopped before it drives is none, and leaves nothing to bring home.
    service.until_it_drives();
    let mut follow = onbrick()
        .env("ONBRICK_KEYS", service.path("pc"))
        .args(["--json", "fetch", "sim", "--follow", "--out"])
        .arg(service.path("followed"))
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = std::io::BufRead::lines(std::io::BufReader::new(follow.stdout.take().unwrap()));
    let mut next = || serde_json::from_str::<Value>(&lines.next().unwrap().unwrap()).unwrap();
    let page = next()["page"].as_str().unwrap().to_owned();
    let seen = browser(&page, || {
        let over = follow.try_wait().unwrap();
        assert!(over.is_none(), "over before the page had grown: {}", service.log());
    });
    if seen.is_none() {
        pass_over("chromium");
    }
    service.done(&["stop"]);
    let last = loop {
        let line = next();
        if line["file"].is_string() {
            break line;
        }
        assert!(line["bytes"].is_u64() && line["how"].is_string(), "{line}");
    };
    assert!(follow.wait().unwrap().success(), "{last}");
    assert!(last["bytes"].as_u64().unwrap() > 1000, "{last}");
}

/// Looks at the page in a real browser until it has grown there, and has points; before each look
/// `goes_on` is asked whether it still can. `None` where this machine has no browser.
fn browser(page: &str, mut goes_on: impl FnMut()) -> Option<()> {
    let begun = Instant::now();
    loop {
        goes_on();
        let profile = tempfile::tempdir().unwrap();
        let output = Command::new("chromium")
            .args([
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--dump-dom",
                "--virtual-time-budget=4000",
            ])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg(page)
            .output()
            .ok()?;
        let dom = text(&output.stdout);
        let number = |name: &str| -> Option<u32> {
            let behind = dom.split(&format!("data-{name}=\"")).nth(1)?;
            Some(behind.split('"').next()?.parse().unwrap())
        };
        // The browser's seconds pass faster than the run's, in which points come with each sync.
        if number("grown") >= Some(2) && number("points") >= Some(1) {
            assert!(dom.contains("data-phase=\"driving\""), "{}", &dom[dom.len() - 3000..]);
            return Some(());
        }
        // Now and then it ends without a word where the machine is busy.
        let said = text(&output.stderr);
        assert!(begun.elapsed() < LONG, "{}{said}", &dom[..dom.len().min(3000)]);
    }
}

#[test]
fn a_run_comes_home_although_the_service_dies_and_comes_back() {
    let mut service = Service::new();
    service.introduce();
    service.mission("short", &SHORT.replace("time_s > 2", "time_s > 6"));
    service.done(&["start", "short", "sim"]);
    let run = newest(&service);
    let mut fetch = onbrick()
        .env("ONBRICK_KEYS", service.path("pc"))
        .args(["fetch", "sim", "--timeout", "60", "--out"])
        .arg(service.path("home"))
        .spawn()
        .unwrap();
    until("something has come", || {
        let part = std::fs::metadata(service.path("home").join(format!("{run}.mcap.part"))).ok()?;
        (part.len() > 0).then_some(())
    });
    service.kill();
    std::thread::sleep(Duration::from_millis(300));
    service.start();
    assert!(fetch.wait().unwrap().success());
    let home = std::fs::read(service.path("home").join(format!("{run}.mcap"))).unwrap();
    let brick = service.path("runs").join(&run).join("run.mcap");
    assert!(home == std::fs::read(&brick).unwrap(), "not the same bytes as {}", brick.display());
}

#[test]
fn a_full_disk_of_the_pcs_ends_the_fetch_and_with_room_it_goes_on_from_there() {
    if no_namespaces() {
        return;
    }
    let service = Service::new();
    service.introduce();
    service.mission("short", SHORT);
    service.done(&["start", "short", "sim"]);
    let run = newest(&service);
    service.done(&["fetch", "sim"]);
    let whole = std::fs::read(service.path("out").join(format!("{run}.mcap"))).unwrap();
    assert!(whole.len() > 8192, "{} bytes", whole.len());
    std::fs::remove_file(service.path("out").join(format!("{run}.mcap"))).unwrap();
    // A file system of one page, then the same with room; what came of both is brought out of the
    // namespace.
    let script = r#"mount -t tmpfs -o size=4k tmpfs small && cd small
        "$0" fetch sim; echo "code $?"; ls
        mount -o remount,size=16m . && "$0" fetch sim && cp *.mcap .."#;
    std::fs::create_dir_all(service.path("out/small")).unwrap();
    let output = unshare()
        .args(["sh", "-c", script, tested_program()])
        .env("ONBRICK_KEYS", service.path("pc"))
        .current_dir(service.path("out"))
        .output()
        .unwrap();
    let (said, error) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{said}{error}");
    assert!(
        said.contains("code 1\n") && said.contains(&format!("{run}.mcap.part")),
        "{said}{error}"
    );
    assert!(error.contains("No space left on device") && error.contains(".mcap.part"), "{error}");
    let again = std::fs::read(service.path("out").join(format!("{run}.mcap"))).unwrap();
    assert!(again == whole, "{} bytes of {}", again.len(), whole.len());
    service.done(&["status", "sim"]);
}

#[test]
fn a_text_of_a_gigabyte_does_not_come_into_the_services_memory() {
    let service = Service::new();
    service.introduce();
    let key = KeyPair::load(&service.path("keys")).unwrap().public();
    let (public, secret) = halves(&KeyPair::load(&service.path("pc")).unwrap());
    let context = zmq::Context::new();
    let socket = context.socket(zmq::DEALER).unwrap();
    socket.set_curve_serverkey(key.as_bytes()).unwrap();
    socket.set_curve_publickey(&public).unwrap();
    socket.set_curve_secretkey(&secret).unwrap();
    socket.set_linger(0).unwrap();
    socket.set_rcvtimeo(200).unwrap();
    socket.set_sndtimeo(30_000).unwrap();
    socket.connect(&format!("tcp://{}:5670", service.address)).unwrap();
    // 64 MB at a time, sixteen times, so that this machine has room for it; the door closes at each
    // before it is read.
    let mut text = Vec::new();
    text.write_all(br#"{"version":1,"id":1,"op":"start","run":"r","mission":{"text":""#).unwrap();
    text.resize(64 << 20, b'x');
    for _ in 0..16 {
        socket.send(text.as_slice(), 0).unwrap();
        assert!(socket.recv_bytes(0).is_err(), "it is not answered");
    }
    service.done(&["status", "sim"]);
    let peak = service.peak_kb();
    println!("the service's peak is {peak} kB");
    assert!(peak < 64 << 10, "{peak} kB");
}

#[test]
fn a_run_that_is_fetched_twice_at_once_or_has_anothers_name_is_never_spoilt() {
    patiently("a run that is fetched twice at once", || {
        let service = Service::new();
        service.introduce();
        service.mission("short", SHORT);
        service.done(&["start", "short", "sim"]);
        let run = newest(&service);
        service.done(&["fetch", "sim", "-o", "first"]);
        let whole = std::fs::read(service.path("out/first").join(format!("{run}.mcap"))).unwrap();
        let brick = service.path("runs").join(&run).join("run.mcap");
        assert!(whole == std::fs::read(brick).unwrap(), "not the same bytes");
        service.says(&["runs", "sim"], "fetched");
        for round in 0..4 {
            let folder = format!("both-{round}");
            let fetch = || {
                onbrick()
                    .env("ONBRICK_KEYS", service.path("pc"))
                    .current_dir(service.path("out"))
                    .args(["fetch", "sim", "--run", &run, "-o", &folder])
                    .stdout(Stdio::piped())
                    .stderr(Stdio::piped())
                    .spawn()
                    .unwrap()
            };
            let both = [fetch(), fetch()].map(|one| one.wait_with_output().unwrap());
            let exits = both.each_ref().map(|one| one.status.code());
            let said = both.each_ref().map(|one| text(&one.stdout) + &text(&one.stderr)).concat();
            assert!(exits.contains(&Some(0)), "{said}");
            let is_clear = |exit: &Option<i32>| {
                *exit == Some(0)
                    || *exit == Some(3) && said.contains("another fetch") && said.contains("try: ")
            };
            assert!(exits.iter().all(is_clear), "{exits:?}: {said}");
            let came = std::fs::read(service.path("out").join(&folder).join(format!("{run}.mcap")))
                .unwrap();
            assert!(came == whole, "round {round}: not the same bytes: {said}");
        }
        // Another brick's run of the same name.
        std::fs::create_dir_all(service.path("out/other")).unwrap();
        let other = service.path("out/other").join(format!("{run}.mcap"));
        std::fs::write(&other, "another recording").unwrap();
        for which in [&["--run", &run][..], &["--all"]] {
            let output = service.pc(&[&["fetch", "sim", "-o", "other"], which].concat());
            let said = text(&output.stderr);
            assert_eq!(output.status.code(), Some(3), "{said}{}", text(&output.stdout));
            assert!(said.contains("is not this recording") && said.contains("try: -o"), "{said}");
            assert_eq!(std::fs::read(&other).unwrap(), b"another recording");
        }
        // A limit.
        let output = service.pc(&["fetch", "sim", "--most-mb", "0", "-o", "none"]);
        let said = text(&output.stderr);
        assert!(output.status.code() == Some(3) && said.contains("at most 0 are taken"), "{said}");
    });
}
