//! The live page and the still of a simulation, looked at in a real browser.
#![cfg(feature = "host")]

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::sync::Arc;

use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock, SECOND_NS, VirtualClock};
use onbrick::ev3dev::{StopAction, TachoCommand, TachoMotor, Tree};
use onbrick::report::live::{Board, LocalPage, PageError, Sources};
use onbrick::sim::{Button, MarkKind, Simulation, World, WorldPhysics, still};

use crate::support::browser::{act, browse, number};

/// A robot that drives to the left on its own, its head turning, in a room with blocks.
struct Driven {
    simulation: Simulation,
    clock: Arc<dyn Clock>,
    _motors: Vec<TachoMotor>,
}

fn driven(world: &str, robots: usize, clock: Arc<dyn Clock>) -> Driven {
    let physics = |seed| WorldPhysics::new(World::named(world).unwrap(), robots, seed).unwrap();
    // One with which the wall ahead answers from the start, if there is a wall.
    let seed = (1..50).find(|seed| physics(*seed).echo(0).is_some()).unwrap_or(1);
    let simulation = Simulation::new(Arc::clone(&clock), Box::new(physics(seed)), seed);
    let mut motors = Vec::new();
    for robot in 0..robots {
        let tree: Arc<dyn Tree> = simulation.brick(robot);
        for (port, speed) in [("outA", 60), ("outB", 150), ("outD", 210)] {
            let motor = TachoMotor::at(&tree, &port.parse().unwrap()).unwrap();
            motor.set_stop_action(StopAction::Coast).unwrap();
            motor.set_speed_sp(speed).unwrap();
            motor.command(TachoCommand::RunForever).unwrap();
            motors.push(motor);
        }
    }
    Driven { simulation, clock, _motors: motors }
}

impl Driven {
    fn pass_s(&self, seconds: i64) {
        for _ in 0..seconds * 10 {
            self.clock.sleep_ns(100 * MILLISECOND_NS);
            self.simulation.catch_up();
        }
    }
}

/// The page of a simulation alone, as `onbrick sim --page` has it.
fn page_of(simulation: &Simulation, port: u16) -> Result<LocalPage, PageError> {
    let (title, simulation) = ("arena".to_owned(), Some(simulation.clone()));
    let board = Board::default();
    board.show(Sources { title, simulation, ..Sources::default() });
    board.serve(port, &[], |_| ())
}

/// The answer to a request as it comes over the wire.
fn ask(page: &LocalPage, request: &str) -> String {
    let url = page.url();
    let address = url.trim_start_matches("http://").trim_end_matches('/');
    let mut stream = TcpStream::connect(address).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

fn get(page: &LocalPage, path: &str) -> String {
    ask(page, &format!("GET {path} HTTP/1.1\r\nHost: localhost:1\r\nConnection: close\r\n\r\n"))
}

#[test]
fn a_page_takes_orders_from_itself_alone() {
    let driven = driven("arena", 1, Arc::new(VirtualClock::default()));
    let page = page_of(&driven.simulation, 0).unwrap();
    let post = |header: &str, path: &str, body: &str| {
        let length = body.len();
        let head = format!(
            "POST {path} HTTP/1.1\r\nHost: localhost:1\r\n{header}Content-Length: {length}"
        );
        let answer = ask(&page, &format!("{head}\r\nConnection: close\r\n\r\n{body}"));
        answer.split(' ').nth(1).unwrap().parse::<u16>().unwrap()
    };
    const OWN: &str = "X-Onbrick: 1\r\n";
    for (header, path, body, status) in [
        ("", "/order", "press enter", 405),
        ("Origin: http://evil.example\r\n", "/order", "press enter", 403),
        (OWN, "/state", "press enter", 405),
        (OWN, "/order", "press entre", 400),
        (OWN, "/order", &"#".repeat(5000), 500),
    ] {
        assert_eq!(
            post(header, path, body),
            status,
            "{header}{path} {}",
            &body[..body.len().min(20)]
        );
    }
    assert_eq!(driven.simulation.pressed(0), []);
    assert_eq!(post(OWN, "/order", "robot 1 press enter for 60"), 200);
    assert_eq!(driven.simulation.pressed(0), [Button::Enter]);
    assert!(get(&page, "/state").contains("\"pressed\":[\"enter\"]"));
    assert_eq!(post(OWN, "/order", "robot 1 release enter"), 200);
    assert_eq!(driven.simulation.pressed(0), []);
}

#[test]
fn a_page_is_for_this_machine_and_changes_nothing_else() {
    let driven = driven("arena", 1, Arc::new(VirtualClock::default()));
    let page = page_of(&driven.simulation, 0).unwrap();
    assert!(page.url().starts_with("http://127.0.0.1:"), "{}", page.url());
    assert!(get(&page, "/").starts_with("HTTP/1.1 200"));
    let state = get(&page, "/state");
    assert!(
        state.contains("\"name\":\"arena\"") && state.contains("\"can\":[\"order\"]"),
        "{state}"
    );
    for part in ["\"run\"", "\"pace\""] {
        assert!(!state.contains(part), "what a simulation alone cannot give is left out: {part}");
    }
    for (request, status) in [
        ("GET /../etc HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", "404"),
        (
            "POST /state HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n\
             Connection: close\r\n\r\n",
            "405",
        ),
        ("GET /state HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n", "403"),
        ("GET / HTTP/1.1\r\nConnection: close\r\n\r\n", "403"),
        (
            "GET /state?since=banana HTTP/1.1\r\nHost: 127.0.0.1:80\r\nConnection: close\r\n\r\n",
            "200",
        ),
    ] {
        let answer = ask(&page, request);
        assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{request}: {answer}");
    }
    let port: u16 = page.url().trim_end_matches('/').rsplit(':').next().unwrap().parse().unwrap();
    let taken = page_of(&driven.simulation, port).unwrap_err();
    assert!(matches!(taken, PageError::Bind { port: found, .. } if found == port), "{taken}");
    let url = page.url().to_owned();
    drop(page);
    let address = url.trim_start_matches("http://").trim_end_matches('/');
    // The server's own thread lets the port go a moment after it was told.
    let is_closed = || {
        MonotonicClock.sleep_ns(10 * MILLISECOND_NS);
        TcpStream::connect(address).is_err()
    };
    assert!((0..200).any(|_| is_closed()), "a dropped page is not served any more");
}

#[test]
fn a_view_has_the_truth_and_marks_come_once() {
    let driven = driven("rooms", 1, Arc::new(VirtualClock::default()));
    driven.simulation.watch();
    driven.pass_s(5);
    let view = driven.simulation.view(0).unwrap();
    let truth =
        driven.simulation.inspect(|world: &mut WorldPhysics| world.truth(0)).unwrap().unwrap();
    assert_eq!((view.robots[0].x_m, view.robots[0].y_m), (truth.x_m, truth.y_m));
    assert!(
        (view.time_s - 5.0).abs() < 0.01 && truth.travelled_m > 0.2,
        "{} s, {truth:?}",
        view.time_s
    );
    let ports: Vec<&str> = view.robots[0].devices.iter().map(|device| device.port).collect();
    assert_eq!(ports, ["in1", "in2", "in3", "in4", "outA", "outB", "outD"]);
    // Echoes lie on the wall that the robot faces squarely: the sensor was at its true place when
    // it measured them.
    let world = World::named("rooms").unwrap();
    let mut distances: Vec<f64> = view
        .marks
        .iter()
        .filter(|mark| mark.kind == MarkKind::Echo)
        .map(|mark| world.distance_to_nearest_surface(mark.x_m, mark.y_m))
        .collect();
    distances.sort_by(f64::total_cmp);
    assert!(distances.len() > 20, "{} echoes", distances.len());
    assert!(distances[distances.len() / 2] < 0.1, "median {} m", distances[distances.len() / 2]);
    assert!(driven.simulation.view(view.next).unwrap().marks.is_empty(), "no mark twice");
    driven.pass_s(1);
    assert!(!driven.simulation.view(view.next).unwrap().marks.is_empty());
    // A lying sensor shows: its echoes leave the walls.
    driven.simulation.control(0, "in1 wrong 0.5\noutB block").unwrap();
    let since = driven.simulation.view(0).unwrap().next;
    driven.pass_s(2);
    let view = driven.simulation.view(since).unwrap();
    assert_eq!(view.robots[0].faults, ["in1 wrong 0.5 0", "outB block"]);
    assert!(view.done[0].ends_with(" s: in1 wrong 0.5 0"), "{:?}", view.done);
}

#[test]
fn a_still_shows_walls_path_echoes_robots_and_faults() {
    let driven = driven("two-arenas", 2, Arc::new(VirtualClock::default()));
    driven.simulation.watch();
    driven.pass_s(8);
    driven.simulation.control(0, "in4 unplug\nrobot 2 outB block").unwrap();
    driven.pass_s(2);
    let svg = still(&driven.simulation);
    keep("still.svg", svg.as_bytes());
    let walls = World::named("two-arenas").unwrap().outlines().len();
    let count = |class: &str| svg.matches(&format!("class=\"{class}\"")).count();
    assert_eq!((count("wall"), count("robot"), count("path"), count("beam")), (walls, 2, 2, 2));
    assert!(svg.matches("h0").count() > 50, "{} echoes", svg.matches("h0").count());
    for text in
        ["two-arenas, after 10.0 s", "faults: in4 unplug", "faults: outB block", "robot 2: x "]
    {
        assert!(svg.contains(text), "{text} is not in the picture");
    }
    assert_eq!(svg, still(&driven.simulation), "the same moment gives the same picture");
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
    for world in World::names() {
        let empty = still(&self::driven(world, 1, Arc::new(VirtualClock::default())).simulation);
        assert!(
            empty.ends_with("</svg>\n") && !empty.contains("NaN") && !empty.contains("inf"),
            "{world}"
        );
    }
}

/// Where a picture is kept to be looked at, if `ONBRICK_PICTURES` names a folder.
fn keep(name: &str, bytes: &[u8]) {
    if let Some(folder) = std::env::var_os("ONBRICK_PICTURES") {
        std::fs::write(Path::new(&folder).join(name), bytes).unwrap();
    }
}

#[test]
fn a_browser_sees_the_room_and_the_robot_drive_through_it() {
    // The wall's own clock: only the page lets time pass.
    let driven = driven("arena", 1, Arc::new(MonotonicClock));
    let page = page_of(&driven.simulation, 0).unwrap();
    driven.simulation.control(0, "in4 stuck").unwrap();
    let Some(dom) = browse(page.url(), &["--dump-dom"]) else { return };
    let walls = World::named("arena").unwrap().outlines().len();
    assert_eq!(number(&dom, "walls"), f64::from(u32::try_from(walls).unwrap()));
    assert_eq!(number(&dom, "robots"), 1.0);
    let (moved, waited, time) =
        (number(&dom, "moved"), number(&dom, "waited"), number(&dom, "time"));
    println!(
        "the page saw {moved} m in {waited} s, until {time} s; {} echoes",
        number(&dom, "echoes")
    );
    assert!(moved > 0.001 && waited > 0.01, "{moved} m in {waited} s");
    assert!(number(&dom, "echoes") >= 1.0);
    let shown = libm::hypot(number(&dom, "x"), number(&dom, "y"));
    assert!(shown > 0.01, "the robot is {shown} m from its start");
    assert!(dom.contains("data-faults=\"in4 stuck\"") && dom.contains("<h1>arena</h1>"));
    assert!(dom.contains("outB") && dom.contains("running"), "the motors' states are told");
    assert!(dom.contains("data-lost=\"false\""), "the simulation has not ended");
    assert!(dom.contains("°/s</td>") && dom.contains("m</td>"), "values have units: {dom}");
}

/// A key is down for as long as it is held on the page.
#[test]
fn a_browser_presses_a_key_of_the_brick() {
    let driven = driven("arena", 1, Arc::new(MonotonicClock));
    let page = page_of(&driven.simulation, 0).unwrap();
    let seen = act(
        page.url(),
        (800, 640),
        &[],
        "const key = await until(() => document.querySelector('[data-button=enter]')); \
         pointer('pointerdown', key, 0, 0); \
         await until(() => news.sim.robots[0].pressed.length); \
         const down = [...document.querySelectorAll('.keys .down')].map((key) => key.textContent); \
         pointer('pointerup', window, 0, 0); \
         await until(() => !news.sim.robots[0].pressed.length); \
         report({ down, keys: [...document.querySelectorAll('.keys button')].length });",
    );
    let Some(seen) = seen else { return };
    assert_eq!(seen, serde_json::json!({ "down": ["enter"], "keys": 6 }));
    let done: Vec<String> =
        driven.simulation.faults_done().into_iter().map(|record| record.what).collect();
    assert_eq!(done, ["press enter for 60", "release enter"]);
    assert_eq!(driven.simulation.pressed(0), []);
}

#[test]
fn a_browser_shows_a_simulation_in_virtual_time() {
    let driven = driven("arena", 1, Arc::new(VirtualClock::default()));
    let page = page_of(&driven.simulation, 0).unwrap();
    driven.pass_s(12);
    driven.simulation.control(0, "in2 garbage\nbattery 5.6").unwrap();
    driven.pass_s(1);
    assert_eq!(driven.clock.now_ns(), 13 * SECOND_NS);
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("page.png");
    let Some(_) = browse(page.url(), &[&format!("--screenshot={}", picture.display())]) else {
        return;
    };
    keep("page.png", &std::fs::read(&picture).unwrap());
    let Some(dom) = browse(page.url(), &["--dump-dom"]) else { return };
    assert!((number(&dom, "time") - 13.0).abs() < 0.01);
    let view = driven.simulation.view(0).unwrap();
    let echoes = view.marks.iter().filter(|mark| mark.kind == MarkKind::Echo).count();
    assert_eq!(number(&dom, "echoes"), f64::from(u32::try_from(echoes).unwrap()));
    assert!((number(&dom, "x") - view.robots[0].x_m).abs() < 1e-3);
}
