//! Every message that a person can get about a mission, in one file to read:
//! `tests/data/mission-messages.txt`. `ONBRICK_BLESS=1 cargo test` rewrites it; read what changed.

use super::*;

/// A mission of one driving machine, with `keys` before it and `states` in it; its start is `a`,
/// its final state `b`.
fn mission(keys: &str, states: &str) -> String {
    format!("name = \"m\"\n{keys}\n[machine.drive]\nstart = \"a\"\nfinal = \"b\"\n{states}\n")
}

/// The mission whose state `a` has these lines, before an ordinary way out and a final state.
fn state(lines: &str) -> String {
    mission(
        "[numbers]\nclose_m = 0.25",
        &format!(
            "[machine.drive.state.a]\n{lines}\nnext = [{{ when = \"time_s > 5\", go = \"b\" }}]\n\
             [machine.drive.state.b]"
        ),
    )
}

/// The mission whose state `a` has these transitions.
fn next(transitions: &str) -> String {
    mission(
        "[numbers]\nclose_m = 0.25",
        &format!("[machine.drive.state.a]\nnext = [{transitions}]\n[machine.drive.state.b]"),
    )
}

/// The mission with this condition on the way from `a` to `b`.
fn when(condition: &str) -> String {
    next(&format!("{{ when = \"{condition}\", go = \"b\" }}"))
}

fn cases() -> Vec<(&'static str, String)> {
    let second = |name: &str, lines: &str| {
        format!(
            "{}[machine.{name}]\nstart = \"a\"\nfinal = \"a\"\n[machine.{name}.state.a]\n{lines}\n",
            state("do = { left_dps = 1, right_dps = 1, head_deg = 0, motor.arm = 5 }")
        )
    };
    let machines = |count: u8| {
        let machine = |at| {
            format!("[machine.m{at}]\nstart = \"a\"\nfinal = \"a\"\n[machine.m{at}.state.a]\n")
        };
        format!("name = \"m\"\n{}", (0..count).map(machine).collect::<String>())
    };
    let many = vec!["{ when = \"touch\", go = \"b\" }"; 33].join(",\n");
    vec![
        ("nothing in it", String::new()),
        ("a sub-machine that is unknown", state("use = \"look\"")),
        ("exploring, and the head besides", state("do = { explore_m = 3, head_deg = 20 }")),
        (
            "exploring, too far and too near",
            state("do = { explore_m = 30, keep_m = 2, face_deg = 1 }"),
        ),
        (
            "a motion whose end is not asked for",
            when("touch").replace("next =", "do = { drive_m = 1 }\nnext ="),
        ),
        ("a distance to keep where no way is found", state("do = { drive_m = 1, keep_m = 0.2 }")),
        (
            "sub-machines, used wrongly",
            format!(
                "{}{}",
                state("use = \"hop\"\nwith = { way = 1, far_m = \"rangem\" }"),
                "[submachine.hop]\nstart = \"on\"\n[submachine.hop.variables]\nway_m = 1\n\
                 range_m = 2\n[submachine.hop.state.on]\ndo = { drive_m = \"way_m\" }\n\
                 next = [{ when = \"done\", go = \"b\" }]\n[submachine.other]\n"
            ),
        ),
        (
            "a sub-machine that uses itself",
            format!(
                "{}[submachine.one.state.x]\nuse = \"two\"\n[submachine.two.state.x]\n\
                 use = \"one\"\n",
                state("use = \"one\"")
            ),
        ),
        (
            "levels of sub-machines",
            format!(
                "{}[submachine.one.state.x]\nuse = \"two\"\n[submachine.two.state.x]\n\
                 use = \"three\"\n[submachine.three.state.x]\n",
                state("use = \"one\"")
            ),
        ),
        (
            "use and with, where they cannot be",
            format!(
                "{}\nuse = \"one\"\n[machine.two.state.x]\nwith = {{ x = 1 }}\n\
                 [submachine.one.state.x]\n",
                state("do = { stop = \"hold\" }\nuse = \"one\"")
            ),
        ),
        (
            "a number that is worked out and out of range",
            state("do = { drive_m = \"2 * 80 / min(0, 4)\" }").replace("time_s > 5", "done"),
        ),
        (
            "a way that is refused ends all the same",
            state("do = { drive_m = \"foo(x_m > 2)\" }").replace("time_s > 5", "done"),
        ),
        (
            "done of a sub-machine without an end",
            format!(
                "{}[submachine.one.state.x]\n",
                state("use = \"one\"").replace("time_s > 5", "done")
            ),
        ),
        (
            "states of a sub-machine that are not connected",
            format!(
                "{}[submachine.one]\nstart = \"x\"\nfinal = \"z\"\n\
                 [submachine.one.state.x]\nnext = [{{ when = \"touch\", go = \"y\" }}]\n\
                 [submachine.one.state.y]\n[submachine.one.state.z]\n",
                state("use = \"one\"")
            ),
        ),
        (
            "a stall inside a sub-machine without a state for it",
            format!(
                "{}[submachine.one]\non_stall = \"bakc\"\n[submachine.one.state.back]\n\
                 do = {{ drive_m = -0.1 }}\n",
                state("use = \"one\"")
            ),
        ),
        (
            "variables that begin with what is not there",
            "name = \"m\"\n[variables]\nfar_m = \"home_x + 1\"\nhome_x = \"x_n\"\n\
             is_near = \"range_m < 1\"\n[machine.m.state.a]\n"
                .to_owned(),
        ),
        (
            "a machine whose first state is the final one",
            mission(
                "",
                "[machine.drive.state.b]\n[machine.drive.state.a]\n\
                 next = [{ when = \"touch\", go = \"b\" }]",
            )
            .replace("start = \"a\"\n", ""),
        ),
        ("not TOML", "name = \"m\n".to_owned()),
        ("a key twice", "name = \"m\"\nname = \"n\"\n".to_owned()),
        (
            "unknown keys",
            mission(
                "tiem_limit_s = 5\ncolour = 1",
                "start_ = 1\n[machine.drive.state.a]\nnetx = []\n[machine.drive.state.b]",
            ),
        ),
        (
            "wrong kinds of value",
            "name = 5\nrate_hz = \"fast\"\ntime_limit_s = true\nfinish = 1\nmachine = 3\n"
                .to_owned(),
        ),
        (
            "values out of range",
            mission(
                "rate_hz = 500\ntime_limit_s = 0",
                "[machine.drive.state.a]\ndo = { head_deg = 5000, tone_hz = 5, motor.arm = nan, \
                 motor_deg.arm = 40000 }\n\
                 next = [{ when = \"touch\", go = \"b\" }]\n[machine.drive.state.b]",
            ),
        ),
        (
            "unknown words",
            mission(
                "finish = \"both\"\non_lost = \"wait\"",
                "[machine.drive.state.a]\ndo = { stop = \"break\", led = \"blue\" }\n\
                 next = [{ when = \"touch\", go = \"b\" }]\n[machine.drive.state.b]",
            ),
        ),
        (
            "a name that is none",
            mission(
                "",
                "[machine.drive.state.a]\nnext = [{ when = \"touch\", go = \"b\" }]\n\
                 [machine.drive.state.b]",
            )
            .replace("\"m\"", "\"\""),
        ),
        (
            "numbers that cannot be named so",
            mission(
                "[numbers]\nrange_m = 1\n\"far away\" = 2\ntime_limit_s = 3\nok = \"5\"",
                "[machine.drive.state.a]\nnext = [{ when = \"touch\", go = \"b\" }]\n\
                 [machine.drive.state.b]",
            ),
        ),
        (
            "a number that cannot be read, and is used",
            when("range_m < close_m").replace("0.25", "\"near\""),
        ),
        ("no machine", "name = \"m\"\n[machine]\n".to_owned()),
        ("nine machines", machines(9)),
        ("eleven machines", machines(11)),
        ("a machine without states", "name = \"m\"\n[machine.drive]\n".to_owned()),
        ("too many transitions", next(&many)),
        (
            "unknown states",
            mission(
                "",
                "[machine.drive.state.a]\nnext = [{ when = \"touch\", go = \"forwrd\" }]\n\
                 [machine.drive.state.forward]",
            )
            .replace("start = \"a\"", "start = \"strat\""),
        ),
        (
            "a transition without condition or destination",
            next("{ when = \"touch\" }, { go = \"b\" }, { when = true, go = \"b\" }, {}"),
        ),
        ("one wheel", state("do = { left_dps = 10 }")),
        (
            "two ways to say what the wheels do",
            state("do = { left_dps = 10, right_dps = 10, stop = \"brake\" }"),
        ),
        (
            "actions that belong elsewhere",
            state(
                "on_entry = { left_dps = 10, right_dps = 10 }\non_exit = { sya = \"x\" }\n\
                 do = { forward = 1 }",
            ),
        ),
        ("no action, and no other key, on entry", state("on_entry = { xyz = 1 }")),
        ("a way over the map for what stops", state("do = { stop = \"brake\", keep_m = 0.2 }")),
        (
            "too long a line for the screen",
            state(&format!("do = {{ say = \"{}\" }}", "far too long ".repeat(11))),
        ),
        ("five lines for the screen", state("do = { say = \"a\\nb\\nc\\nd\\ne\" }")),
        ("a brace that is not closed", state("do = { say = \"x is {x_m\" }")),
        ("a mistake inside a text", state("do = { say = \"it is {rangem} m away\" }")),
        ("no note", state("do = { tune = \"C4/4 H4/4\" }")),
        ("two sounds", state("do = { tune = \"C4/4\", tone_hz = 440 }")),
        ("a tempo without a tune", state("do = { tempo_bpm = 90 }")),
        ("a motion and a speed", state("do = { drive_m = 1, forward_mps = 0.1 }")),
        ("a speed without a motion", state("do = { turn_dps = 20, speed_mps = 0.1 }")),
        ("a place of three numbers", state("do = { goto = [1, 2, 3] }")),
        ("several places", state("do = { goto = [[1, 2], [3, 4]] }")),
        ("an arc without a radius", state("do = { arc = { turn_deg = 90 } }")),
        ("what remembers in a motion", state("do = { drive_m = \"pid(x_m, 1, 0, 0)\" }")),
        ("motions on entry", state("on_entry = { drive_m = 1 }")),
        ("a variable that is a number", state("on_entry = { set = { close_m = 1 } }")),
        ("a speed with a unit", "name = \"m\"\ntime_limit_s = \"10s\"\n".to_owned()),
        ("a time with a unit", when("state_s > 10s")),
        ("centimetres", when("range_m < 25")),
        (
            "centimetres in a number",
            when("touch or close_m > range_m").replace("close_m = 0.25", "close_m = 25"),
        ),
        ("millivolts", when("battery_v < 7200")),
        ("more than all", when("touch and reflect_pct < 150")),
        ("more than all, which is never so", when("reflect_pct > 150")),
        ("a time beyond the mission's", when("touch or state_s > 2000")),
        ("a time beyond the mission's that no other condition holds", when("time_s > 2000")),
        (
            "a count of ticks",
            next(
                "{ when = \"touch and hits < 9\", set = { hits = \"hits + 1\" }, go = \"a\" }, \
                 { when = \"hits == 9\", go = \"b\" }",
            )
            .replace("[machine.drive]", "[variables]\nhits = 0\n[machine.drive]"),
        ),
        ("what a state does not do", state("do = { wait_s = 2, set = { hits = 1 }, wiat = 3 }")),
        ("a turn in radians", state("do = { turn_deg = -1.57 }")),
        ("exactly what is measured", when("heading_deg == 90")),
        (
            "a variable that nothing sets",
            when("touch and laps > 4")
                .replace("[machine.drive]", "[variables]\nlaps = 0\n[machine.drive]"),
        ),
        (
            "a time in milliseconds",
            when("state_s > 2000").replace("[numbers]", "time_limit_s = 60000\n[numbers]"),
        ),
        ("a direction beyond half a turn", when("heading_deg > 270")),
        ("colours by size", when("colour > red")),
        ("a world", onbrick::sim::World::text("line").unwrap().to_owned()),
        ("a robot", onbrick::robot::DEFAULT_ROBOT.to_owned()),
        ("a text without quotes", "name = m\n".to_owned()),
        ("an expression without quotes", state("do = { turn_dps = min(1,2) }")),
        ("a decimal comma", state("do = { forward_mps = 0,25 }")),
        ("a brace that is missing", state("do = { forward_mps = 0.1")),
        ("a state twice", state("") + "[machine.drive.state.a]\n"),
        ("a variable that is none", state("on_entry = { set = { foud = 1 } }")),
        ("a variable that the language has", state("on_entry = { set = { range_m = 1 } }")),
        ("a truth for a number", mission("[variables]\nseen = false", "")),
        ("a number without its nought", state("do = { forward_mps = -.25 }")),
        ("a number of too many digits", state("do = { drive_m = 99999999999999999999 }")),
        (
            "a transition that is no list, and one in a table of its own",
            mission(
                "",
                "[machine.drive.state.a]\nnext = { when = \"touch\", go = \"b\" }\n\
                 [machine.drive.state.b]\n[machine.drive.state.b.next]\nwhen = \"touch\"\n",
            ),
        ),
        ("a slip in `state`", "name = \"m\"\n[machine.drive.stat.a]\n".to_owned()),
        (
            "a final state that moves, and has a way on",
            state("do = { forward_mps = 0.1 }")
                + "do = { drive_m = 1 }\nnext = [{ when = \"done\", go = \"a\" }]\n",
        ),
        (
            "an expression where it does not fit",
            state("do = { forward_mps = \"range_m < 1\", turn_dps = \"touch\" }"),
        ),
        ("an empty condition", when("")),
        ("a condition that is a number", when("range_m")),
        ("unknown names", when("rangem < close_n or tuch")),
        ("a condition that breaks off", when("range_m <")),
        ("operands side by side", when("range_m close_m")),
        (
            "parentheses",
            next(
                "{ when = \"(range_m < 1\", go = \"b\" }, { when = \"range_m < 1)\", go = \"b\" }, \
                 { when = \"(touch echo)\", go = \"b\" }",
            ),
        ),
        ("a chain of comparisons", when("0 < range_m < 1")),
        (
            "signs of other languages",
            next(
                "{ when = \"touch && echo\", go = \"b\" }, { when = \"range_m = 1\", go = \"b\" }, \
                 { when = \"!touch\", go = \"b\" }, { when = \"range_m ≤ 1\", go = \"b\" }, { when \
                 = \"x_m^2 > 1\", go = \"b\" }, { when = \"colour == 'red'\", go = \"b\" }",
            ),
        ),
        (
            "numbers that are none",
            next(
                "{ when = \"range_m < 25cm\", go = \"b\" }, { when = \"range_m < 1.2.3\", go = \
                 \"b\" }, { when = \"range_m < 1e999\", go = \"b\" }",
            ),
        ),
        (
            "numbers and truths mixed",
            next(
                "{ when = \"touch < 1\", go = \"b\" }, { when = \"touch == 1\", go = \"b\" }, { \
                 when = \"not range_m\", go = \"b\" }, { when = \"-echo > 0\", go = \"b\" }, { \
                 when = \"range_m and touch\", go = \"b\" }",
            ),
        ),
        ("nested too deeply", when(&"(".repeat(70))),
        ("too long an expression", when(&"1 + ".repeat(1500))),
        ("too many motors", when("motor.a + motor.b + motor.c + motor.d + motor.e > 0")),
        (
            "a state that cannot be reached",
            mission(
                "",
                "[machine.drive.state.a]\nnext = [{ when = \"touch\", go = \"b\" }]\n\
                 [machine.drive.state.b]\n[machine.drive.state.c]\n\
                 next = [{ when = \"touch\", go = \"b\" }]",
            ),
        ),
        (
            "states that cannot be left",
            mission(
                "",
                "[machine.drive.state.a]\nnext = [{ when = \"touch\", go = \"c\" }, { when = \
                 \"echo\", go = \"d\" }, { when = \"time_s > 9\", go = \"b\" }]\n\
                 [machine.drive.state.b]\n[machine.drive.state.c]\n[machine.drive.state.d]\n\
                 next = [{ when = \"touch\", go = \"d\" }]",
            ),
        ),
        (
            "no way to the end",
            mission(
                "",
                "[machine.drive.state.a]\nnext = [{ when = \"touch\", go = \"b\" }, { when = \
                 \"echo\", go = \"c\" }]\n[machine.drive.state.b]\n[machine.drive.state.c]\n\
                 next = [{ when = \"touch\", go = \"d\" }]\n[machine.drive.state.d]\n\
                 next = [{ when = \"touch\", go = \"c\" }]",
            ),
        ),
        (
            "a transition that comes too late",
            next(
                "{ when = \"range_m < 0.5\", go = \"b\" }, { when = \"range_m < close_m and \
                 touch\", go = \"b\" }",
            ),
        ),
        (
            "conditions that never or always hold",
            next(
                "{ when = \"range_m < 0\", go = \"b\" }, { when = \"heading_deg > 180 or colour == \
                 8\", go = \"b\" }, { when = \"range_m >= 0\", go = \"b\" }, { when = \"range_m \
                 < 25 and 190 < heading_deg\", go = \"b\" }",
            ),
        ),
        (
            "a machine that the others wait for until the time is over",
            state("do = { stop = \"brake\" }")
                + "[machine.lights.state.a]\ndo = { led = \"red\" }\n",
        ),
        (
            "two machines that move the same",
            second("other", "do = { stop = \"coast\", head_deg = 3, motor.arm = 1 }"),
        ),
        ("two modes of one sensor", when("colour == 5 or reflect_pct < 10")),
        (
            "a stall without a state for it",
            format!(
                "on_stall = \"bakc\"\n{}",
                state("do = { stop = \"brake\" }")
                    .replace("state.b]", "state.b]\n[machine.drive.state.back]")
            ),
        ),
        (
            "a stall in a mission that drives no wheels",
            format!("on_stall = \"a\"\n{}", state("do = { head_deg = 5 }")),
        ),
    ]
}

/// What a robot with two wheels, an infrared range sensor and one named motor says.
fn robot_cases() -> Vec<(&'static str, String)> {
    vec![
        (
            "parts that the robot lacks",
            next("{ when = \"touch or head_deg > 5 or reflect_pct > 5\", go = \"b\" }")
                .replace("next =", "do = { head_deg = 5 }\nnext ="),
        ),
        ("faster than the wheels", state("do = { forward_mps = 10 }")),
        (
            "a way in centimetres",
            state("do = { drive_m = 40 }").replace("[numbers]", "time_limit_s = 30\n[numbers]"),
        ),
        (
            "a number that is a way in centimetres",
            state("do = { drive_m = \"2 * way\" }").replace("[numbers]", "[numbers]\nway = 20"),
        ),
        (
            "a number beyond what it is for",
            state("do = { drive_m = \"way\" }").replace("[numbers]", "[numbers]\nway = 200"),
        ),
        ("an arc that is too long", state("do = { arc = { radius_m = 30, turn_deg = 360 } }")),
        ("a place in centimetres", state("do = { goto = [80, -20], speed_mps = 0.19 }")),
        ("wheels faster than they may", state("do = { left_dps = 540, right_dps = -720 }")),
        ("one wheel faster", state("do = { left_dps = \"90 * range_m\", right_dps = 720 }")),
        (
            "motors that the robot lacks",
            when("motor.griper > 0").replace("next =", "do = { motor.leg = 5 }\nnext ="),
        ),
        (
            "a motor that is asked for more than it may do",
            when("state_s > 1").replace("next =", "do = { motor.gripper = 900 }\nnext ="),
        ),
    ]
}

fn collect() -> String {
    let bare = Capabilities {
        limits: Some(MotionLimits::default()),
        roles: [Role::Range, Role::Remote].into(),
        motors: Some(vec![("gripper".to_owned(), 3.5)]),
        sensors: Some(Vec::new()),
    };
    let all = Capabilities::all();
    let on_any = cases().into_iter().map(|(title, text)| (title, text, &all));
    let on_bare = robot_cases().into_iter().map(|(title, text)| (title, text, &bare));
    let mut out = String::new();
    for (title, text, capabilities) in on_any.chain(on_bare) {
        let findings = match Mission::parse("mission.toml", text.as_bytes(), capabilities) {
            Ok((_, warnings)) => warnings,
            Err(findings) => findings,
        };
        assert!(!findings.is_empty(), "{title}: nothing was found in\n{text}");
        writeln!(out, "## {title}\n\n{findings}").unwrap();
    }
    let mut map = shipped("map");
    writeln!(out, "## numbers that cannot be set\n").unwrap();
    for (name, value) in
        [("naer_m", 1.0), ("xyz", 1.0), ("near_m", f64::NAN), ("time_limit_s", 1e9)]
    {
        writeln!(out, "{}", map.set(name, value).unwrap_err()).unwrap();
    }
    out
}

#[test]
fn every_message_is_as_a_person_read_it_last() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/mission-messages.txt");
    let now = collect();
    if std::env::var_os("ONBRICK_BLESS").is_some() {
        std::fs::write(path, &now).unwrap();
    }
    let read = std::fs::read_to_string(path).unwrap();
    for (at, (now, read)) in now.lines().zip(read.lines()).enumerate() {
        assert_eq!(now, read, "line {} of {path}; ONBRICK_BLESS=1 rewrites it", at + 1);
    }
    assert_eq!(now.lines().count(), read.lines().count(), "{path}");
}

#[test]
fn numbers_that_a_signal_can_be_are_not_remarked_upon() {
    for condition in [
        "x_m > 150 or y_m < -150 or state_m > 100 or state_turn_deg > 720",
        "range_m < 2.55 or reflect_pct < 100 or battery_v < 7.2 or heading_deg > 179",
        "range_m * 100 < 25 or range_m - 5 < 0 or colour != 7",
    ] {
        let text = when(condition);
        let (_, warnings) =
            Mission::parse("mission.toml", text.as_bytes(), &Capabilities::all()).unwrap();
        assert!(warnings.is_empty(), "{condition}:\n{warnings}");
    }
}
