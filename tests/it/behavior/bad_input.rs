//! Files that no person would write, and some that they would: never a panic, always a place and a
//! way out.

use std::time::Instant;

use super::*;

fn refusal(text: &[u8]) -> String {
    match Mission::parse("mission.toml", text, &Capabilities::all()) {
        Ok(_) => panic!("{} was taken", String::from_utf8_lossy(&text[..text.len().min(200)])),
        Err(findings) => {
            let text = findings.to_string();
            assert!(text.contains("--> mission.toml:"), "{text}");
            text
        }
    }
}

#[test]
fn files_that_are_no_missions_are_refused_with_a_place() {
    for (bytes, expected) in [
        (&b""[..], "`name` is missing"),
        (b"\n\n", "`machine` is missing"),
        (b"\x7fELF\x01\x01\x01\x00\xff\xfe", "not UTF-8"),
        (b"\0\0\0\0", "error"),
        (b"name = \"m\"\nname = \"n\"\n", "is there twice"),
        (b"{\"name\": \"m\"}", "error"),
        (b"name = 5\nmachine = 5\n", "`machine` must be a table, not a number"),
        (b"name = \"m\"\nmachine = []\n", "must be a table"),
        (b"name = \"m\"\n[[machine]]\n", "must be a table"),
        (b"name = \"m\"\n[machine.a.state.b]\nnext = [5]\n", "must be a table"),
        (b"name = \"m\"\n[machine.a]\nstate = { b = 1 }\nstart = \"b\"", "must be a table"),
        (b"name = \"m\"\nrate_hz = 1e9\n[machine]\n", "must be a whole number"),
        (b"name = \"m\"\nrate_hz = -5\n[machine]\n", "`rate_hz` is -5; it can be 10 to 100"),
        (b"name = \"m\"\ntime_limit_s = nan\n[machine]\n", "`time_limit_s` is NaN"),
        (b"name = \"m\"\ntime_limit_s = inf\n[machine]\n", "`time_limit_s` is inf"),
        (b"name = \"m\"\n[numbers]\nx = -inf\n[machine]\n", "`numbers.x` is -inf"),
        (b"name = \"m\"\n[numbers]\nx = 99999999999999999999\n[machine]\n", "numbers.x"),
    ] {
        let text = refusal(bytes);
        assert!(text.contains(expected), "{text}\ndoes not have: {expected}");
    }
}

#[test]
fn a_file_cut_anywhere_is_read_or_refused() {
    for mission in MISSIONS {
        for end in 0..mission.text.len() {
            let cut = &mission.text.as_bytes()[..end];
            if let Err(findings) = Mission::parse("cut.toml", cut, &Capabilities::all()) {
                assert!(findings.has_errors(), "{}", mission.name);
                assert!(findings.to_string().contains("--> cut.toml:"), "{findings}");
            }
        }
    }
}

#[test]
fn a_named_sensor_has_the_hints_of_what_it_measures() {
    let sensors = [
        ("back", Channel::Range),
        ("eye", Channel::Reflect),
        ("tail", Channel::Touch),
        ("floor", Channel::Colour),
    ];
    let sensors = sensors.map(|(name, measures)| (name.to_owned(), measures));
    let robot = Capabilities { sensors: Some(sensors.to_vec()), ..Capabilities::all() };
    for (when, told) in [
        ("sensor.back < 25", "`sensor.back` is in metres, from 0 to 2.55, and 25 is beyond"),
        ("sensor.back < 25", "25 cm are 0.25"),
        ("sensor.eye > 101", "this condition can never hold"),
        ("sensor.eye > 101", "`sensor.eye` is in percent, from 0 to 100"),
        ("not sensor.tail and sensor.tail", "this condition can never hold"),
        ("sensor.floor > red", "`sensor.floor` is one of several things"),
        ("touch or blue >= colour", "`colour` is one of several things"),
        ("touch or blue >= colour", "write `colour == blue` or `colour != blue`"),
        ("remote > 0", "write `remote == none` or `remote != none`"),
    ] {
        let text = format!(
            "name = \"m\"\n[machine.m]\nstart = \"a\"\n[machine.m.state.a]\nnext = [{{ when = \
             \"{when}\", go = \"b\" }}, {{ when = \"state_s > 1\", go = \"b\" }}]\n\
             [machine.m.state.b]\nnext = [{{ when = \"true\", go = \"a\" }}]\n"
        );
        let found = match Mission::parse("mission.toml", text.as_bytes(), &robot) {
            Ok((_, findings)) | Err(findings) => findings.to_string(),
        };
        assert!(found.contains(told), "{found}\ndoes not have: {told}");
    }
}

/// `count` states in a ring, each with what `state` gives for its number.
fn ring(count: usize, state: impl Fn(usize) -> String) -> String {
    let mut text = "name = \"ring\"\n[machine.m]\nstart = \"s0\"\n".to_owned();
    for at in 0..count {
        writeln!(text, "[machine.m.state.s{at}]\n{}", state(at)).unwrap();
    }
    text
}

#[test]
fn ten_thousand_states_are_read_and_one_more_is_refused() {
    let next = |count: usize| {
        move |at: usize| {
            format!("next = [{{ when = \"x_m < {at}\", go = \"s{}\" }}]", (at + 1) % count)
        }
    };
    let started = Instant::now();
    let mission = load(&ring(10_000, |at| {
        if at == 0 {
            "next = [{ when = \"touch\", go = \"s1\" }]".to_owned()
        } else {
            next(10_000)(at)
        }
    }));
    let loaded = started.elapsed();
    let mut program = mission.start().unwrap();
    for tick in 0..20_000 {
        step(
            &mut program,
            &signals(tick, &[(Signal::X, -1.0), (Signal::Sensed(Channel::Touch), 1.0)]),
        );
    }
    println!(
        "ten thousand states: {loaded:?} to read, {:?} to read and take 20000 steps",
        started.elapsed()
    );
    assert_eq!(program.states().collect::<Vec<_>>(), ["s0"], "twice round");
    assert!(refusal(ring(10_001, next(10_001)).as_bytes()).contains("more than 10000 states"));
}

#[test]
fn ten_thousand_states_with_a_mistake_in_each_are_refused_in_bounded_time() {
    let started = Instant::now();
    for state in [
        "nxet = 1",
        "do = { leftdps = 1 }",
        "next = [{ when = \"foo < 1\", go = \"nowhere\" }]",
        "",
    ] {
        let text = refusal(ring(10_000, |_| state.to_owned()).as_bytes());
        assert!(text.contains("and 180 more"), "{}", &text[..300]);
    }
    println!("ten thousand mistakes, four times: {:?}", started.elapsed());
}

#[test]
fn enormous_parts_are_refused() {
    let when = |condition: &str| {
        format!(
            "name = \"m\"\n[machine.m]\nstart = \"a\"\n[machine.m.state.a]\n\
             next = [{{ when = \"{condition}\", go = \"a\" }}]\n"
        )
    };
    let started = Instant::now();
    for (text, expected) in [
        (when(&"1 + ".repeat(250_000)), "at most 4096 are read"),
        (when(&"(".repeat(1_000_000)), "at most 4096 are read"),
        (when(&"(".repeat(4000)), "nested too deeply"),
        (when(&"x".repeat(4000)), "unknown name"),
        (when(&"9".repeat(4000)), "is not a number that can be used"),
        (format!("name = \"{}\"\n", "n".repeat(1_000_000)), "a name has 1 to 40 characters"),
        (format!("x = {}", "[".repeat(1_000_000)), "error"),
        (format!("{}y = 1", "x.".repeat(100_000)), "error"),
        ("x = 1\n".repeat(500_000), "is there twice"),
        ("#".repeat(Document::MAX_BYTES + 1), "at most"),
        (
            "[machine.m.state.a]\nnext = [".to_owned()
                + &"{when=\"touch\",go=\"a\"},".repeat(100_000)
                + "]",
            "100000 transitions are too many",
        ),
    ] {
        let refused = refusal(text.as_bytes());
        assert!(
            refused.contains(expected),
            "{}\ndoes not have: {expected}",
            &refused[..refused.len().min(500)]
        );
        assert!(refused.len() < 20_000, "a message of {} bytes", refused.len());
    }
    println!("enormous parts: {:?}", started.elapsed());
}

#[test]
fn involved_conditions_are_read_in_bounded_time() {
    type Form = (&'static str, fn(usize) -> String, usize, &'static str);
    // As many long conditions in each state as are read, in a file as long as is read.
    let wide = |at: usize, term: fn(usize) -> String, count: usize, word: &str| {
        (0..count).map(|part| term(at * count + part)).collect::<Vec<_>>().join(word)
    };
    let forms: [Form; 3] = [
        ("few cases", |n| format!("range_m < {n} and x_m > {n}"), 8, " or "),
        ("many cases", |n| format!("x_m > {n}"), 250, " or "),
        ("products", |n| format!("(x_m > {n} or y_m < {n})"), 100, " and "),
    ];
    for (name, term, count, word) in forms {
        let condition = |at| wide(at, term, count, word);
        let transitions: Vec<_> =
            (0..32).map(|at| format!("{{ when = \"{}\", go = \"s0\" }}", condition(at))).collect();
        let state = format!("next = [{}]", transitions.join(",\n"));
        let text = ring(Document::MAX_BYTES / (state.len() + 40), |_| state.clone());
        let started = Instant::now();
        let read = Mission::parse("involved.toml", text.as_bytes(), &Capabilities::all());
        println!("{name}, {} bytes: {:?}", text.len(), started.elapsed());
        assert!(read.is_err(), "states that only lead to the first one cannot be reached");
    }
}

/// Changes to a text: each takes away some bytes and puts others there.
fn changes() -> impl Strategy<Value = Vec<(prop::sample::Index, usize, String)>> {
    let scraps = prop::sample::select(vec![
        "",
        "",
        "\"",
        "{",
        "}",
        "[",
        "]",
        "=",
        "\n",
        "-",
        "0",
        "1e999",
        "nan",
        "inf",
        "true",
        "range_m",
        "< 0.1",
        "and",
        "not ",
        "(",
        ")",
        "forward",
        "halt",
        "go",
        "when",
        "do",
        "stop",
        "led",
        "\u{0}",
        "ä",
        "[machine.drive]\n",
        "[numbers]\n",
        "next = []\n",
        "motor.x = 1",
        ".",
        ",",
    ]);
    prop::collection::vec(
        (any::<prop::sample::Index>(), 0..12_usize, scraps.prop_map(str::to_owned)),
        1..6,
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn a_mission_changed_at_random_is_refused_or_runs(
        mission in prop::sample::select(MISSIONS.to_vec()),
        changes in changes(),
    ) {
        let mut text = mission.text.as_bytes().to_vec();
        for (at, taken, put) in changes {
            let at = at.index(text.len().max(1)).min(text.len());
            let end = (at + taken).min(text.len());
            text.splice(at..end, put.into_bytes());
        }
        match Mission::parse("changed.toml", &text, &Capabilities::all()) {
            Err(findings) => {
                prop_assert!(findings.has_errors() && !findings.to_string().is_empty());
            }
            Ok((mission, _)) => {
                let mut program = mission.start().unwrap();
                for tick in 0..200 {
                    let (demands, _) = step(&mut program, &eventful(tick, &Obedient::default()));
                    prop_assert!(is_finite(&demands), "{demands:?}");
                }
                prop_assert!(graph::mermaid(&mission).starts_with("stateDiagram-v2\n"));
            }
        }
    }
}

fn is_finite(demands: &Demands) -> bool {
    let drive = match demands.drive {
        Some(
            Drive::Wheels { left_rad_s: a, right_rad_s: b }
            | Drive::Twist { forward_m_s: a, turn_rad_s: b },
        ) => [a, b],
        Some(Drive::Stop(_)) | None => [0.0; 2],
    };
    let others = [demands.head_rad, demands.tone_hz].into_iter().chain(demands.motors).flatten();
    drive.into_iter().chain(others).all(f64::is_finite)
}
