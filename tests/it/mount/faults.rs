//! What is done on purpose, through the mount: the files `sim/faults` and `sim/orders`, and the
//! commands that write to them.

use std::process::{Command, Output};
use std::sync::Arc;

use onbrick::clock::{Clock, MILLISECOND_NS, SECOND_NS, VirtualClock};
use onbrick::ev3dev::{Button, Buttons, EV3, LocalTree, Tree};
use onbrick::sim::World;
use serde_json::{Value, json};

use super::bench::Mounted;
use crate::support::tested_program;

fn fault(mounted: &Mounted, order: &[&str]) -> Output {
    let program = tested_program();
    Command::new(program).args(["sim", "fault"]).arg(mounted.root()).args(order).output().unwrap()
}

#[test]
fn a_plug_is_pulled_and_put_back_by_the_command_and_the_file_tells_of_it() {
    let clock: Arc<dyn Clock> = Arc::new(VirtualClock::default());
    let Some(mounted) = Mounted::in_world("arena", 1, Arc::clone(&clock)) else { return };
    let root = mounted.root();
    let sensors = || std::fs::read_dir(root.join("sys/class/lego-sensor")).unwrap().count();
    let pass_s = |seconds: i64| clock.sleep_ns(seconds * SECOND_NS);
    let before = sensors();
    assert!(fault(&mounted, &["in1", "unplug"]).status.success());
    pass_s(1);
    assert_eq!(sensors(), before - 1, "the ultrasonic sensor is gone");
    let told = std::fs::read_to_string(root.join("sim/faults")).unwrap();
    assert!(told.starts_with("in1 unplug\n# ") && told.ends_with("s: in1 unplug\n"), "{told}");
    assert!(fault(&mounted, &["in1", "plug"]).status.success());
    pass_s(4);
    assert_eq!(sensors(), before, "and back");
    assert!(!std::fs::read_to_string(root.join("sim/faults")).unwrap().starts_with("in1"));
}

/// How the robot truly is, as the file says it.
fn truth(mounted: &Mounted) -> Value {
    serde_json::from_str(&std::fs::read_to_string(mounted.root().join("sim/truth")).unwrap())
        .unwrap()
}

#[test]
#[cfg_attr(target_arch = "arm", ignore = "QEMU's user mode knows no EVIOCGKEY")]
fn keys_are_pressed_by_the_command_and_by_the_file() {
    let clock: Arc<dyn Clock> = Arc::new(VirtualClock::default());
    let Some(mounted) = Mounted::in_world("arena", 1, Arc::clone(&clock)) else { return };
    let tree: Arc<dyn Tree> = Arc::new(LocalTree::new(mounted.root()));
    let mut buttons = Buttons::open(&tree, &EV3).unwrap();
    let pass_ms = |ms: i64| clock.sleep_ns(ms * MILLISECOND_NS);
    let program = tested_program();
    let press = |arguments: &[&str]| {
        let root = mounted.root();
        Command::new(program).args(["sim", "press"]).arg(root).args(arguments).output().unwrap()
    };
    for (arguments, held_ms, keys) in [
        (&["enter"] as &[&str], 200, &[Button::Enter] as &[Button]),
        (&["up", "down", "--for", "1s"], 1000, &[Button::Up, Button::Down]),
        (&["back", "--for", "50ms"], 50, &[Button::Back]),
    ] {
        let done = press(arguments);
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        assert_eq!(buttons.changes().unwrap().pressed.iter().collect::<Vec<_>>(), keys);
        pass_ms(held_ms - 10);
        assert!(buttons.changes().unwrap().released.is_empty(), "{arguments:?}");
        pass_ms(14);
        assert_eq!(buttons.changes().unwrap().released.iter().collect::<Vec<_>>(), keys);
    }
    std::fs::write(mounted.root().join("sim/orders"), "press left for 2\n").unwrap();
    assert_eq!(truth(&mounted)["pressed"], json!(["left"]));
    let told = std::fs::read_to_string(mounted.root().join("sim/orders")).unwrap();
    assert!(told.starts_with("# ") && told.ends_with("press left for 2\n"), "{told}");
    for (arguments, message) in [
        (["entre", "--for=1s"], "the buttons are back, enter"),
        (["enter", "--for=soon"], "a time is 2ms"),
    ] {
        let wrong = press(&arguments);
        let said = String::from_utf8_lossy(&wrong.stderr).into_owned();
        assert!(wrong.status.code() == Some(2) && said.contains(message), "{said}");
    }
    let nowhere = Command::new(program).args(["sim", "press", "/tmp", "enter"]).output().unwrap();
    assert_eq!(nowhere.status.code(), Some(3), "{}", String::from_utf8_lossy(&nowhere.stderr));
}

/// A hand carries the robot, and what a person would see and hear of the brick can be read.
#[test]
fn the_robot_is_carried_and_put_back_but_not_into_a_wall() {
    let Some(mounted) = Mounted::in_world("two-arenas", 2, Arc::new(VirtualClock::default()))
    else {
        return;
    };
    let root = mounted.root();
    let order = |text: &str| std::fs::write(root.join("sim/orders"), text);
    let truth = || -> Value {
        serde_json::from_str(&std::fs::read_to_string(root.join("sim/truth")).unwrap()).unwrap()
    };
    let pose = || ["x_m", "y_m", "heading_deg"].map(|key| truth()[key].as_f64().unwrap());
    let start = pose();
    order("place 0.2 -0.3 90").unwrap();
    let moved = pose();
    assert!(
        (moved[0] - 0.2).abs() + (moved[1] + 0.3).abs() + (moved[2] - 90.0).abs() < 1e-9,
        "{moved:?}"
    );
    assert!(order("place 900 0 0\n").is_ok(), "outside of all walls there is room");
    order("reset").unwrap();
    assert_eq!(pose(), start);
    // Where the other robot stands, and where there is no floor or a wall.
    let other = std::fs::read_to_string(mounted.mount().root(1).join("sim/truth")).unwrap();
    let other: Value = serde_json::from_str(&other).unwrap();
    assert!(order(&format!("place {} {} 0", other["x_m"], other["y_m"])).is_err());
    let walls = World::named("two-arenas").unwrap().outlines()[0].clone();
    assert!(order(&format!("place {} {} 0", walls[0][0], walls[0][1])).is_err());
    assert_eq!(pose(), start);
    let lights = &truth()["lights"];
    assert_eq!(
        (&lights["led0:red:brick-status"], &lights["led1:green:brick-status"]),
        (&json!(0), &json!(255))
    );
    assert_eq!((&truth()["tone_hz"], &truth()["last_tone_hz"]), (&Value::Null, &Value::Null));
}

#[test]
fn an_order_that_makes_no_sense_does_nothing_and_says_why() {
    let Some(mounted) = Mounted::in_world("arena", 1, Arc::new(VirtualClock::default())) else {
        return;
    };
    let unknown = fault(&mounted, &["in1", "stukc"]);
    assert_eq!(unknown.status.code(), Some(2), "{}", String::from_utf8_lossy(&unknown.stderr));
    let unfit = fault(&mounted, &["in2", "block"]);
    assert_eq!(unfit.status.code(), Some(1), "a sensor has no shaft to block");
    let empty = fault(&mounted, &["outC", "stuck"]);
    let said = String::from_utf8_lossy(&empty.stderr).into_owned();
    assert_eq!(empty.status.code(), Some(1), "{said}");
    assert!(said.contains("in1 lego-ev3-us") && said.contains("outB lego-ev3-l-motor"), "{said}");
    assert!(std::fs::write(mounted.root().join("sim/faults"), "in9 stuck\n").is_err());
    assert!(std::fs::write(mounted.root().join("sim/faults"), [0xff, 0xfe]).is_err());
    assert_eq!(std::fs::read_to_string(mounted.root().join("sim/faults")).unwrap(), "");
}
