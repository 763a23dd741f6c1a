//! Programs as people write them with python-ev3dev2, after those of its own repository, run
//! unmodified: a table of them.

use std::fs;

use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock, SECOND_NS};
use serde_json::json;

use super::bench::{Foreign, Simulator, no_namespaces, no_python, script};
use super::{TRACK_M, WHEEL_M};
use crate::mount::bench::real_time;
use crate::support::real_time::{Pace, in_real_time};

/// What a demo is run for: its world, and what is done and looked at while it runs and after it.
type Demo = (&'static str, &'static str, fn(&Pace, &Simulator, Foreign));

const DEMOS: [Demo; 13] = [
    ("demo_motors", "demo-educator", motors),
    ("demo_tank", "demo-educator", tank),
    ("demo_square", "demo-educator", square),
    ("demo_square_gyro", "demo-educator", square),
    ("demo_colour", "demo-educator", colour),
    ("demo_touch", "demo-educator", touch),
    ("demo_ultrasonic", "demo-educator", ultrasonic),
    ("demo_remote", "demo-explor3r", remote),
    ("demo_auto_drive", "demo-explor3r", auto_drive),
    ("demo_buttons", "demo-educator", buttons),
    ("demo_leds", "demo-educator", leds),
    ("demo_display", "demo-educator", display),
    ("demo_sound", "demo-educator", sound),
];

#[test]
fn demo_programs_of_python_ev3dev2_run_unmodified() {
    if no_namespaces() || no_python() {
        return;
    }
    let _alone = real_time();
    // A few at a time: each starts a python, and all of them at once would starve a small machine.
    for demos in DEMOS.chunks(5) {
        std::thread::scope(|scope| {
            for (name, world, check) in demos {
                scope.spawn(move || {
                    in_real_time(name, |pace| {
                        let simulator = Simulator::start(pace, world);
                        let root = simulator.root();
                        let program =
                            Foreign::start(pace, name, &root, &["python3", &script(name)]);
                        check(pace, &simulator, program);
                    });
                });
            }
        });
    }
}

/// Waits for the end of a program that says so; false, with a complaint, if it does not end well.
fn done(pace: &Pace, program: Foreign) -> bool {
    program
        .end(pace)
        .is_some_and(|said| said.lines().last().is_some_and(|last| last.starts_with("done")))
}

/// Looks until something is so, for half a minute at most.
fn until(mut is_so: impl FnMut() -> bool) -> bool {
    let deadline_ns = MonotonicClock.now_ns() + 30 * SECOND_NS;
    while !is_so() {
        if MonotonicClock.now_ns() > deadline_ns {
            return false;
        }
        MonotonicClock.sleep_ns(20 * MILLISECOND_NS);
    }
    true
}

fn motors(pace: &Pace, simulator: &Simulator, program: Foreign) {
    assert!(done(pace, program));
    pace.near("nothing drove", simulator.truth().travelled_m, 0.0, 1e-9);
}

/// One and a half turns ahead, an arc on which the right wheel turns half as far as the left, a
/// second back.
fn tank(pace: &Pace, simulator: &Simulator, program: Foreign) {
    assert!(done(pace, program));
    let truth = simulator.truth();
    let arc_deg = -(0.5 * WHEEL_M / TRACK_M).to_degrees();
    pace.near("heading", truth.heading_deg, arc_deg, 8.0);
    pace.near("way", truth.travelled_m, (1.5 + 0.75) * WHEEL_M + 210.0 / 360.0 * WHEEL_M, 0.08);
}

/// All the way round, and back to about where it started.
fn square(pace: &Pace, simulator: &Simulator, program: Foreign) {
    assert!(done(pace, program));
    let truth = simulator.truth();
    pace.near("heading", truth.heading_deg, 360.0, 30.0);
    pace.near("x", truth.x_m, 0.0, 0.12);
    pace.near("y", truth.y_m, 0.0, 0.12);
    pace.ensure(truth.travelled_m > 0.4, || format!("{truth:?}"));
}

/// It sees red, and says it until it is ended, by a signal to the command that runs it.
fn colour(_pace: &Pace, simulator: &Simulator, program: Foreign) {
    let said = || fs::read_to_string(simulator.root().join("sim/orders")).unwrap();
    assert!(until(|| said().matches("say Red").count() >= 2), "{}", said());
    assert!(
        said().matches(": say ").count() <= said().matches("say Red").count() + 1,
        "{}",
        said()
    );
    assert!(until(|| simulator.truth().last_tone_hz.is_some()), "speech sounds");
    assert_eq!(program.interrupt().code(), Some(128 + 15));
}

fn touch(pace: &Pace, simulator: &Simulator, program: Foreign) {
    assert!(done(pace, program));
    let truth = simulator.truth();
    // The wall is at 1.4 m, the robot's front 0.09 m ahead of its axle; a second back is 0.11 m.
    pace.near("x after the wall", truth.x_m, 1.4 - 0.09 - 0.11, 0.04);
}

fn ultrasonic(pace: &Pace, simulator: &Simulator, program: Foreign) {
    assert!(done(pace, program));
    let truth = simulator.truth();
    pace.near("metres to the wall", truth.echo_m.unwrap(), 0.37, 0.06);
}

/// The remote's left button is held up from the beginning: the left wheel turns, and its light is
/// green.
fn remote(pace: &Pace, simulator: &Simulator, mut program: Foreign) {
    assert_eq!(program.line(), "ready");
    assert!(until(|| simulator.truth().left_deg > 100.0), "{:?}", simulator.truth());
    let truth = simulator.truth();
    assert_eq!(
        (truth.light("led0:green"), truth.light("led0:red"), truth.light("led1:green")),
        (255, 0, 0),
        "{truth:?}"
    );
    pace.near("the right wheel", truth.right_deg, 0.0, 5.0);
    simulator.order("press enter for 0.5");
    assert!(done(pace, program));
    assert!(until(|| simulator.truth().speed_mps.abs() < 1e-3));
}

fn auto_drive(pace: &Pace, simulator: &Simulator, mut program: Foreign) {
    assert_eq!(program.line(), "backed", "it bumped into the wall");
    let truth = simulator.truth();
    assert_eq!((truth.light("led0:red"), truth.light("led1:green")), (255, 0), "{truth:?}");
    assert_eq!(truth.last_tone_hz, Some(1000));
    simulator.order("press left for 3");
    assert!(done(pace, program));
}

fn buttons(pace: &Pace, simulator: &Simulator, mut program: Foreign) {
    assert_eq!(program.line(), "ready");
    // It may not have got as far as to wait: a bump that it misses is tried again.
    let mut bumps = 0;
    simulator.order("press enter for 0.2");
    let bump = || {
        simulator.order("press enter for 0.2");
        MonotonicClock.sleep_ns(600 * MILLISECOND_NS);
    };
    while bumps < 5 {
        bump();
        bumps += 1;
    }
    assert_eq!(program.line(), "bump True");
    simulator.order("press up for 0.3");
    MonotonicClock.sleep_ns(600 * MILLISECOND_NS);
    simulator.order("press back for 0.3");
    let Some(said) = program.end(pace) else { return };
    for change in ["('up', True)", "('up', False)", "('backspace', True)"] {
        assert!(said.contains(change), "{change}: {said}");
    }
}

fn leds(pace: &Pace, simulator: &Simulator, program: Foreign) {
    assert!(done(pace, program));
    let truth = simulator.truth();
    let lights = ["led0:red", "led0:green", "led1:red", "led1:green"].map(|name| truth.light(name));
    assert_eq!(lights, [255, 0, 127, 63], "{truth:?}");
}

/// What is drawn through a memory map is on the brick's screen while the program runs.
fn display(pace: &Pace, simulator: &Simulator, mut program: Foreign) {
    assert_eq!(program.line(), "ready 178 128");
    let picture = || fs::read(simulator.root().join("dev/fb0")).unwrap();
    let white = |x: usize, y: usize| picture()[(y * 178 + x) * 4 + 1] == 255;
    assert!(until(|| white(2, 2)), "the screen is white");
    assert!(!white(11, 21) && !white(58, 38), "the bar is black");
    assert!(white(9, 21) && white(61, 38), "beside it is nothing");
    let words = (80..130)
        .flat_map(|x| (58..75).map(move |y| (x, y)))
        .filter(|(x, y)| !white(*x, *y))
        .count();
    assert!(words > 20, "{words} dots of the words");
    simulator.order("press enter for 1");
    assert!(done(pace, program));
    assert!(white(11, 21), "what was drawn last is shown");
}

fn sound(pace: &Pace, simulator: &Simulator, program: Foreign) {
    let heard = std::cell::RefCell::new(std::collections::BTreeSet::new());
    let listen = || {
        heard.borrow_mut().extend(simulator.truth().tone_hz);
        [294, 392, 800]
            .iter()
            .all(|hz| heard.borrow().iter().any(|tone: &u32| tone.abs_diff(*hz) <= hz / 20))
    };
    pace.ensure(until(listen), || format!("{:?} were heard", heard.borrow()));
    assert!(done(pace, program));
    let told = fs::read_to_string(simulator.root().join("sim/orders")).unwrap();
    assert!(told.contains("say I am a robot"), "{told}");
    assert_eq!(json!(simulator.truth().tone_hz), json!(null), "it is silent again");
}
