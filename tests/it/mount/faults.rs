//! Faults on demand, through the mount: the file `sim/faults`, and the command that writes to it.

use std::process::{Command, Output};
use std::sync::Arc;

use onbrick::clock::{Clock, SECOND_NS, VirtualClock};

use super::bench::Mounted;

fn fault(mounted: &Mounted, order: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_onbrick");
    Command::new(program).args(["sim", "fault"]).arg(mounted.root()).args(order).output().unwrap()
}

#[test]
fn a_plug_is_pulled_and_put_back_by_the_command_and_the_file_tells_of_it() {
    let clock: Arc<dyn Clock> = Arc::new(VirtualClock::default());
    let Some(mounted) = Mounted::in_world("arena", 1, Arc::clone(&clock)) else { return };
    let root = mounted.root();
    let sensors = || std::fs::read_dir(root.join("sys/class/lego-sensor")).unwrap().count();
    let pass_s = |seconds: i64| clock.sleep_until_ns(clock.now_ns() + seconds * SECOND_NS);
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

#[test]
fn an_order_that_makes_no_sense_does_nothing_and_says_why() {
    let Some(mounted) = Mounted::in_world("arena", 1, Arc::new(VirtualClock::default())) else { return };
    let unknown = fault(&mounted, &["in1", "stukc"]);
    assert_eq!(unknown.status.code(), Some(2), "{}", String::from_utf8_lossy(&unknown.stderr));
    let unfit = fault(&mounted, &["in2", "block"]);
    assert_eq!(unfit.status.code(), Some(1), "a sensor has no shaft to block");
    assert!(std::fs::write(mounted.root().join("sim/faults"), "in9 stuck\n").is_err());
    assert!(std::fs::write(mounted.root().join("sim/faults"), [0xff, 0xfe]).is_err());
    assert_eq!(std::fs::read_to_string(mounted.root().join("sim/faults")).unwrap(), "");
}
