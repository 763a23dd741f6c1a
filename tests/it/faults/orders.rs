//! Orders as text, scenario files, and when what is done.

use onbrick::clock::{Clock, SECOND_NS};
use onbrick::sim::{Act, Button, DeviceFault, FaultRecord, Order, Port, STEP_NS, Scenario};
use proptest::prelude::*;

use crate::drivers_bench::Rig;

#[test]
fn an_order_is_a_line_of_text() {
    let text = "in1 stuck\n\n# nothing\nrobot 2 outB block for 2.5  # a child's hand\nbattery 6.2\n\
                battery 8 5 60\nin4 clear\nclear\n\
                ev3-ports:outA write speed_sp 500\nin3 wrong 1.5 -20\noutD reset\n\
                in2 garbage text\n\
                press enter\nrobot 3 press back for 1.5\nrelease enter\nplace 0.5 -0.2 90\nreset\n\
                tone 440\nsay Hello  robot";
    let orders = Order::parse(0, text).unwrap();
    let shown: Vec<String> =
        orders.iter().map(|order| format!("{} {}", order.robot, order.act)).collect();
    assert_eq!(
        shown,
        [
            "0 in1 stuck",
            "1 outB block for 2.5",
            "0 battery 6.2",
            "0 battery 8 5 60",
            "0 in4 clear",
            "0 clear",
            "0 outA write speed_sp 500",
            "0 in3 wrong 1.5 -20",
            "0 outD reset",
            "0 in2 garbage text",
            "0 press enter for 0.2",
            "2 press back for 1.5",
            "0 release enter",
            "0 place 0.5 -0.2 90",
            "0 reset",
            "0 tone 440",
            "0 say Hello robot",
        ]
    );
    assert_eq!(orders[1].act, Act::Inject(Port::OutB, DeviceFault::Block, Some(5 * SECOND_NS / 2)));
    assert!(Order::parse(0, "").unwrap().is_empty());
}

#[test]
fn each_fault_reads_back_from_its_own_text() {
    let faults = DeviceFault::examples();
    assert_eq!(
        faults.len(),
        DeviceFault::words().count(),
        "each word, with `garbage text` and without `write`"
    );
    for fault in faults {
        assert_eq!(DeviceFault::parse(&fault.to_string()).unwrap(), fault);
    }
}

#[test]
fn what_is_not_an_order_says_what_is_wrong_and_the_way_out() {
    let cases = [
        (
            "in9 stuck",
            "line 1: there is no port `in9`; there are in1 to in4, outA to outD, and for the whole \
             robot `battery`, `clear`, `press`, `release`, `place` and `reset`",
        ),
        (
            "\nmotor stuck",
            "line 2: there is no port `motor`; there are in1 to in4, outA to outD, and for the \
             whole robot `battery`, `clear`, `press`, `release`, `place` and `reset`",
        ),
        ("in1 stuk", "line 1: there is no fault `stuk`; did you mean `stuck`?"),
        (
            "in1",
            "line 1: no fault is named; there are unplug, plug, off, stuck, garbage, wrong, slow, \
             delayed, intermittent, jump, enxio, eio, denied, block, endless, resync, stale, \
             write, reset",
        ),
        ("in1 delayed soon", "line 1: `soon` is not a number"),
        ("in1 delayed -5", "line 1: -5 is out of range; it can be 0 to 10000"),
        ("in1 wrong nan", "line 1: nan is out of range; it can be -100 to 100"),
        ("in1 slow 0", "line 1: 0 is out of range; it can be 1 to 100000"),
        ("in1 slow -5", "line 1: -5 is out of range; it can be 1 to 100000"),
        ("in1 jump 1.5", "line 1: `1.5` is not a whole number"),
        ("in1 jump 1000001", "line 1: 1000001 is out of range; it can be -1000000 to 1000000"),
        ("in1 stuck 5", "line 1: `5` does not belong to `stuck`"),
        ("in1 stuck for ever", "line 1: `ever` is not a number"),
        ("outA reset for 5", "line 1: `reset` is done at once; leave out `for`"),
        ("outA write speed_sp", "line 1: `write` takes an attribute and a value"),
        (
            "battery",
            "line 1: `battery` takes one number or three; `battery 6.2`, or `battery 8 5 60`: from \
             8 V to 5 V in 60 s",
        ),
        ("battery 230", "line 1: 230 is out of range; it can be 0 to 12"),
        ("press entre", "line 1: there is no button `entre`; did you mean `enter`?"),
        ("press", "line 1: `press` takes one button; `press enter`, or `press enter for 1.5`"),
        (
            "press enter left",
            "line 1: `press` takes one button; `press enter`, or `press enter for 1.5`",
        ),
        (
            "place 1 2",
            "line 1: `place 1 2` does not say it all; `release enter`, `tone 440`, `say WORDS`, or \
             `place 0.5 -0.2 90`: metres, metres and degrees",
        ),
        ("place 1 2 400", "line 1: 400 is out of range; it can be -360 to 360"),
        ("robot 0 clear", "line 1: `robot 0` is no robot; robots count from 1"),
        ("robot 1", "line 1: there is no order; write for example `in1 stuck`"),
    ];
    for (text, message) in cases {
        assert_eq!(Order::parse(0, text).unwrap_err().to_string(), message, "{text}");
    }
    let rig = Rig::recorded();
    rig.bench.simulation.control(0, "in1 stuck\nin1 stuk").unwrap_err();
    assert!(rig.bench.simulation.faults_active(0).is_empty(), "a text with a mistake is not begun");
    rig.bench.simulation.control(0, "in1 stuck\nin1 block\nin2 stuck").unwrap_err();
    assert_eq!(rig.bench.simulation.faults_active(0), [(Port::In1, DeviceFault::Stuck)]);
}

const SCENARIO: &str = r#"
[[fault]]
at_s = 2.0
until_s = 3.5
port = "in4"
kind = "unplug"

[[fault]]
at_s = 1.0
port = "outB"
kind = "write speed_sp 120"

[[fault]]
at_s = 1.0
robot = 1
port = "in1"
kind = "delayed 150"

[[battery]]
at_s = 0
from_v = 7.0

[[press]]
at_s = 4
button = "enter"
for_s = 0.5

[[press]]
at_s = 4.4
button = "enter"
"#;

#[test]
fn a_scenario_is_followed_to_the_step_however_the_clock_leaps() {
    let (scenario, findings) = Scenario::parse("loose.toml", SCENARIO.as_bytes()).unwrap();
    assert!(findings.is_empty(), "{findings}");
    let done = |leap_ms: i64| {
        let rig = Rig::recorded();
        rig.pass_ms(500);
        rig.bench.simulation.play(&scenario);
        while rig.bench.clock.now_ns() < 6 * SECOND_NS {
            rig.pass_ms(leap_ms);
        }
        assert_eq!(rig.number("outB", "speed_sp"), 120);
        assert_eq!(rig.bench.simulation.pressed(0), [], "let go, however long the leap");
        rig.bench.simulation.faults_done()
    };
    let record = |time_ms: i64, what: &str| FaultRecord {
        time_ns: time_ms * SECOND_NS / 1000,
        robot: 0,
        what: what.to_owned(),
    };
    let expected = [
        record(500, "battery 7"),
        record(1500, "outB write speed_sp 120"),
        record(1500, "in1 delayed 150"),
        record(2500, "in4 unplug for 1.5"),
        record(4000, "in4 unplug is over"),
        record(4500, "press enter for 0.5"),
        record(4900, "press enter for 0.2"),
    ];
    for leap_ms in [2, 7, 6000] {
        assert_eq!(done(leap_ms), expected, "in leaps of {leap_ms} ms");
    }
    assert_eq!(500_000_000 % STEP_NS, 0);
}

#[test]
fn a_button_is_down_for_as_long_as_the_last_press_says() {
    let rig = Rig::recorded();
    let order = |text: &str| rig.bench.simulation.control(0, text).unwrap();
    let pressed = || rig.bench.simulation.pressed(0);
    order("press enter for 0.5\npress left");
    rig.pass_ms(190);
    assert_eq!(pressed(), [Button::Enter, Button::Left]);
    rig.pass_ms(20);
    assert_eq!(pressed(), [Button::Enter]);
    order("press enter for 1");
    rig.pass_ms(990);
    assert_eq!(pressed(), [Button::Enter]);
    order("release enter");
    assert_eq!(pressed(), []);
    order("press enter for 1\nclear");
    assert_eq!(pressed(), []);
}

#[test]
fn what_a_scenario_orders_in_vain_is_recorded_with_the_reason() {
    let text = "[[fault]]\nat_s = 0\nport = \"outB\"\nkind = \"write a 1\"\n[[fault]]\nat_s = 0\n\
                robot = 3\nport = \"in1\"\nkind = \"stuck\"\n";
    let rig = Rig::recorded();
    rig.bench.simulation.play(&Scenario::parse("vain.toml", text.as_bytes()).unwrap().0);
    let done: Vec<String> =
        rig.bench.simulation.faults_done().into_iter().map(|record| record.what).collect();
    assert_eq!(done.len(), 2, "{done:?}");
    assert!(
        done[0].starts_with("outB write a 1: `write a 1` on outB was refused (ENOENT"),
        "{done:?}"
    );
    assert_eq!(done[1], "in1 stuck: there is no robot 3; there are 1");
}

#[test]
fn every_mistake_in_a_scenario_has_its_place() {
    let text = "[[fault]]\nat_s = -1\nport = \"in7\"\nkind = \"stuk\"\n\n[[fault]]\nat_s = 5\n\
                until_s = 4\nprot = 1\nport = \"in1\"\nkind = \"stuck\"\n\n\
                [[fault]]\nat_s = 1\nuntil_s = 2\nport = \"outA\"\nkind = \"reset\"\n\n\
                [[battery]]\nat_s = 0\nfrom_v = 99\nrobot = 0\n\n[[press]]\nat_s = 0\n\
                button = \"entre\"\nfor_s = 0\n\n[wind]\n";
    let found = Scenario::parse("loose.toml", text.as_bytes()).unwrap_err().to_string();
    for expected in [
        "error: `fault[0].at_s` is -1; it can be 0 to 86400\n  --> loose.toml:2:8",
        "error: there is no port `in7`\n  --> loose.toml:3:8",
        "there are in1 to in4, outA to outD",
        "error: there is no fault `stuk`\n  --> loose.toml:4:8",
        "did you mean `stuck`?",
        "error: `until_s` is 4, which is not after `at_s`, 5\n  --> loose.toml:8:11",
        "error: unknown key `prot`",
        "error: `reset` is done at once\n  --> loose.toml:15:1",
        "error: `battery[0].from_v` is 99",
        "error: `battery[0].robot` is 0",
        "error: there is no button `entre`",
        "did you mean `enter`?",
        "error: `press[0].for_s` is 0",
        "error: unknown key `wind`",
    ] {
        assert!(found.contains(expected), "{expected:?} is not in\n{found}");
    }
    assert_eq!(found.matches("error: ").count(), 11, "{found}");
}

proptest! {
    #[test]
    fn any_text_is_an_order_or_a_message(
        text in "([a-z0-9.# -]|in1|outB|stuck|write|for|battery|robot|\n){0,60}",
    ) {
        if let Err(error) = Order::parse(0, &text) {
            prop_assert!(!error.to_string().is_empty());
        }
        let _ = Scenario::parse("any.toml", text.as_bytes());
    }

    #[test]
    fn any_bytes_are_a_scenario_or_a_message(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = Scenario::parse("any.toml", &bytes);
    }

    #[test]
    fn any_numbers_read_back(
        scale in -100.0..100.0_f64,
        offset in -1_000_000..1_000_000_i32,
        ms in 0..60_000_000_i64,
    ) {
        for fault in [
            DeviceFault::Wrong { scale, offset },
            DeviceFault::Jump { by: offset },
            DeviceFault::Stale { for_ns: ms * 1000 },
            DeviceFault::Write { attribute: "speed_sp".to_owned(), value: offset.to_string() },
        ] {
            prop_assert_eq!(DeviceFault::parse(&fault.to_string()).unwrap(), fault);
        }
    }
}
