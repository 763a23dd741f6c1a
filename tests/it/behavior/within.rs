//! Machines within machines: what is inside sees, what is outside sees, and what is put together.

use super::*;

/// A machine whose state `hop` uses a sub-machine of three states.
const HOPS: &str = r#"
name = "hops"
[numbers]
far_m = 0.5
[variables]
hops = 0
[machine.drive]
start = "wait"
final = "end"
always = [{ when = "touch", go = "end" }]
[machine.drive.state.wait]
next = [{ when = "state_s >= 1", go = "hop" }]
[machine.drive.state.hop]
use = "hop"
with = { way_m = "far_m * 2" }
on_entry = { led = "red" }
on_exit = { led = "green" }
next = [
  { when = "state_s >= 3", go = "end" },
  { when = "done", set = { hops = "hops + hop.count" }, go = "hop" },
]
[machine.drive.state.end]

[machine.see]
final = "seen"
[machine.see.state.see]
do = { say = "{drive.state == hop} {drive.state == hop.rest} {drive.hop.way_m}" }
next = [{ when = "time_s > 100", go = "seen" }]
[machine.see.state.seen]

[submachine.hop]
start = "on"
final = "over"
[submachine.hop.variables]
way_m = 0.25
count = 0
[submachine.hop.state.on]
do = { forward_mps = "way_m" }
on_entry = { set = { count = "count + 1" } }
next = [{ when = "state_s >= 0.5", go = "rest" }]
[submachine.hop.state.rest]
next = [
  { when = "count < 2", go = "on" },
  { when = "state_s >= 0.5", go = "over" },
]
[submachine.hop.state.over]
"#;

#[test]
fn the_outer_and_the_inner_state_each_have_their_time_their_end_and_their_names() {
    let mission = load(HOPS);
    let names: Vec<&str> = mission.variables().iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["hops", "drive.hop.way_m", "drive.hop.count"]);
    let mut program = mission.start().unwrap();
    #[rustfmt::skip]
    let transcript = [
        (0_i64, "wait",     "no no 0.25", None,      [0.0, 0.25, 0.0]),
        (1_000, "hop.on",   "yes no 1",     Some(1.0), [0.0, 1.0, 1.0]),
        (1_500, "hop.rest", "yes yes 1",      None,      [0.0, 1.0, 1.0]),
        (1_520, "hop.on",   "yes no 1",     Some(1.0), [0.0, 1.0, 2.0]),
        (2_020, "hop.rest", "yes yes 1",      None,      [0.0, 1.0, 2.0]),
        (2_520, "hop.over", "yes no 1",     None,      [0.0, 1.0, 2.0]),
        // Its own time and its variables begin again.
        (2_540, "hop.on",   "yes no 1",     Some(1.0), [2.0, 1.0, 1.0]),
        (5_520, "hop.rest", "yes yes 1",      None,      [2.0, 1.0, 1.0]),
        // Three seconds in the outer state, whatever is inside.
        (5_540, "end",      "no no 1",    None,      [2.0, 1.0, 1.0]),
    ];
    for (ms, state, said, forward_m_s, variables) in transcript {
        let (demands, _) = step(&mut program, &signals(ms, &[]));
        assert_eq!(program.states().next(), Some(state), "at {ms} ms");
        assert_eq!(demands.say.as_deref(), Some(said), "at {ms} ms");
        assert_eq!(program.variables(), variables, "at {ms} ms");
        let drive = forward_m_s.map(|forward_m_s| Drive::Twist { forward_m_s, turn_rad_s: 0.0 });
        assert_eq!(demands.drive, drive, "at {ms} ms");
        let led = match ms {
            1_000 | 2_540 => Some(LightColour::Red),
            5_540 => Some(LightColour::Green),
            _ => None,
        };
        assert_eq!(demands.led, led, "at {ms} ms");
    }
}

#[test]
fn what_holds_in_all_states_of_the_machine_holds_inside_as_well_and_has_its_name() {
    let mission = load(HOPS);
    let mut program = mission.start().unwrap();
    step(&mut program, &signals(0, &[]));
    step(&mut program, &signals(1_000, &[]));
    let mut taken = Vec::new();
    let pressed = signals(1_200, &[(Signal::Sensed(Channel::Touch), 1.0)]);
    program.step(&pressed, &mut Demands::default(), |next| taken.push(next));
    let named = mission.named(taken[0]).unwrap().to_string();
    assert_eq!(named, "drive: hop.on → end (touch)");
    let taken = Taken { machine: 0, from: 2, to: 3, transition: Some(3) };
    let named = mission.named(taken).unwrap().to_string();
    assert_eq!(named, "drive: hop.on → hop.rest (state_s >= 0.5)");
}

#[test]
fn a_program_goes_on_inside_a_sub_machine_from_a_checkpoint() {
    let mission = load(HOPS);
    let mut program = mission.start().unwrap();
    for ms in [0, 1_000, 1_500, 1_520] {
        step(&mut program, &signals(ms, &[]));
    }
    let mut other = mission.start().unwrap();
    assert!(other.restore(&program.state()));
    for ms in [1_700, 2_020, 2_540, 2_560, 5_600] {
        let signals = signals(ms, &[]);
        assert_eq!(step(&mut other, &signals), step(&mut program, &signals), "at {ms} ms");
        assert_eq!(other.state(), program.state(), "at {ms} ms");
    }
}

#[test]
fn a_sub_machine_sets_its_own_variables_and_those_around_it_and_no_others() {
    let set = |more: &str| HOPS.replace("\"count + 1\" }", &format!("\"count + 1\", {more} }}"));
    let read = Mission::parse("m.toml", set("far = 7").as_bytes(), &Capabilities::all());
    let error = read.unwrap_err().to_string();
    assert!(error.contains("there is no variable `far`"), "{error}");
    let mut program = load(&set("hops = 7")).start().unwrap();
    step(&mut program, &signals(0, &[]));
    step(&mut program, &signals(1_000, &[]));
    assert_eq!(program.variables()[0], 7.0);
}

#[test]
fn a_stall_inside_a_sub_machine_leads_to_a_state_of_the_machine() {
    let on_stall =
        |state: &str| HOPS.replacen("[numbers]", &format!("on_stall = \"{state}\"\n[numbers]"), 1);
    let stalled = |state: &str, times: &[i64]| {
        let mut program = load(&on_stall(state)).start().unwrap();
        for ms in times {
            step(&mut program, &signals(*ms, &[]));
        }
        assert!(program.stall());
        step(&mut program, &signals(times.last().unwrap() + 10, &[]));
        program
    };
    assert_eq!(stalled("wait", &[0, 1_000]).states().next(), Some("wait"));
    // One that is inside the state already stays where it is.
    let program = stalled("hop", &[0, 1_000, 1_500]);
    assert_eq!((program.states().next(), program.variables()[2]), (Some("hop.on"), 2.0));
}

#[test]
fn a_state_whose_wheels_are_blocked_is_left_by_its_stall() {
    const INNER: &str = "[submachine.s.state.x]\ndo = { turn_dps = 5 }\n";
    let read = |what: &str| {
        let text = format!(
            "name = \"m\"\non_stall = \"off\"\n[machine.d]\nfinal = \"end\"\n\
             [machine.d.state.ahead]\n{what}\n[machine.d.state.off]\ndo = {{ drive_m = -0.1 }}\n\
             next = [{{ when = \"done\", go = \"end\" }}]\n[machine.d.state.end]\n\
             {}",
            if what.starts_with("use") { INNER } else { "" }
        );
        let read = Mission::parse("m.toml", text.as_bytes(), &Capabilities::all());
        read.map(|(_, warnings)| assert!(warnings.is_empty(), "{warnings:?}"))
            .map_err(|findings| findings.to_string())
    };
    for leaves in
        ["do = { forward_mps = 0.15 }", "use = \"s\"", "do = { left_dps = 9, right_dps = 9 }"]
    {
        assert_eq!(read(leaves), Ok(()), "{leaves}");
    }
    for stays in ["do = { say = \"here\" }", "do = { goto = { x_m = 1, y_m = 0, keep_m = 0.15 } }"]
    {
        let error = read(stays).unwrap_err();
        assert!(error.contains("`ahead` cannot be left, and it is not final"), "{stays}: {error}");
    }
}

#[test]
fn a_sub_machine_may_say_itself_where_a_stall_leads() {
    let hops = HOPS.replacen("final = \"over\"", "final = \"over\"\non_stall = \"rest\"", 1);
    let stalled = |mission: &str, times: &[i64]| {
        let mut program = load(mission).start().unwrap();
        for ms in times {
            step(&mut program, &signals(*ms, &[]));
        }
        let goes_on = program.stall();
        step(&mut program, &signals(times.last().unwrap() + 10, &[]));
        (goes_on, program.states().next().unwrap().to_owned())
    };
    let of_all = hops.replacen("[numbers]", "on_stall = \"wait\"\n[numbers]", 1);
    for (mission, outside) in [(&hops, false), (&of_all, true)] {
        assert_eq!(stalled(mission, &[0, 1_000]), (true, "hop.rest".to_owned()));
        assert_eq!(stalled(mission, &[0]), (outside, "wait".to_owned()));
    }
    // Without wheels there is no stall, and its state has no other way to it.
    let still = "name = \"m\"\n[machine.m.state.a]\nuse = \"s\"\n[submachine.s]\n\
        on_stall = \"y\"\n[submachine.s.state.x]\ndo = { DO }\n[submachine.s.state.y]\n";
    let read = |what: &str| {
        let text = still.replace("DO", what);
        let read = Mission::parse("m.toml", text.as_bytes(), &Capabilities::all());
        read.map(|_| ()).map_err(|findings| findings.to_string())
    };
    assert_eq!(read("drive_m = 1"), Ok(()));
    let error = read("head_deg = 1").unwrap_err();
    assert!(error.contains("state `a.y` cannot be reached from `a.x`"), "{error}");
}

#[test]
fn variables_of_a_sub_machine_begin_with_expressions_each_time() {
    let mut program = load(
        "name = \"m\"\n[machine.m.state.a]\nuse = \"s\"\n\
         next = [{ when = \"touch\", go = \"a\" }]\n[submachine.s]\n\
         variables = { from_m = \"x_m\", way_m = 2 }\n[submachine.s.state.x]\n\
         do = { drive_m = \"from_m + way_m\" }\n",
    )
    .start()
    .unwrap();
    assert_eq!(program.variables(), [0.0, 2.0], "before the first step");
    for (ms, x_m, touch, from_m) in [(0, 5.0, 0.0, 5.0), (20, 6.0, 0.0, 5.0), (40, 7.0, 1.0, 7.0)] {
        let set = [(Signal::X, x_m), (Signal::Sensed(Channel::Touch), touch)];
        step(&mut program, &signals(ms, &set));
        assert_eq!(program.variables(), [from_m, 2.0], "at {ms} ms");
    }
}

#[test]
fn sub_machines_count_against_the_bounds_at_each_use() {
    let part = |name: &str, inner: &str, uses: usize| {
        let state = |at: usize| {
            let next = (at + 1) % uses;
            format!(
                "[submachine.{name}.state.s{at}]\n{inner}\n\
                 next = [{{ when = \"touch\", go = \"s{next}\" }}]\n"
            )
        };
        let states: String = (0..uses).map(state).collect();
        format!("[submachine.{name}]\nstart = \"s0\"\nvariables = {{ v = 0 }}\n{states}")
    };
    let mission = |uses: usize| {
        let parts = [("one", "use = \"two\""), ("two", "")];
        let parts: String = parts.map(|(name, inner)| part(name, inner, uses)).concat();
        format!("name = \"m\"\n[machine.m.state.a]\nuse = \"one\"\n{parts}")
    };
    let read = |text: &str| {
        let read = Mission::parse("m.toml", text.as_bytes(), &Capabilities::all());
        read.map(|_| ()).map_err(|findings| findings.to_string())
    };
    assert_eq!(read(&mission(60)), Ok(()), "3661 states, 61 variables");
    let error = read(&mission(70)).unwrap_err();
    assert!(error.contains("more than 64 variables"), "{error}");
    let begun = std::time::Instant::now();
    let error = read(&mission(101).replace("variables = { v = 0 }\n", "")).unwrap_err();
    assert!(error.contains("more than 10000 states"), "{error}");
    assert!(begun.elapsed().as_secs_f64() < 5.0, "{:?}", begun.elapsed());
}

#[test]
fn a_graph_draws_a_sub_machine_inside_its_state() {
    let text = "name = \"m\"\n[machine.m.state.a]\nuse = \"s\"\n[submachine.s]\nstart = \"x\"\n\
        final = \"y\"\nalways = [{ when = \"touch\", go = \"y\" }]\n[submachine.s.state.x]\n\
        next = [{ when = \"time_s > 1\", go = \"y\" }]\n[submachine.s.state.y]\n";
    let expected = "stateDiagram-v2
    state \"m\" as m0 {
        state \"a\" as m0s0 {
            state \"x\" as m0s1
            state \"y\" as m0s2
            [*] --> m0s1
            m0s1 --> m0s2 : time_s #62; 1
            state \"(always)\" as m0s0always
            m0s0always --> m0s2 : touch
            m0s2 --> [*]
        }
        [*] --> m0s0
    }
";
    assert_eq!(graph::mermaid(&load(text)), expected);
}
