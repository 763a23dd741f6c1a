//! Missions from their files: what a person can get wrong, what those that come with the program
//! do, and that the same signals always give the same demands.

use std::fmt::Write as _;

use onbrick::behavior::mission::OnLost;
use onbrick::behavior::shipped::{self, MISSIONS, TEMPLATE};
use onbrick::behavior::{
    Capabilities, Demands, Drive, Finish, Mission, MotionLimits, Program, ProgramState, Progress,
    Signal, Signals, Taken, graph, submachines,
};
use onbrick::document::Document;
use onbrick::ev3dev::{LightColour, StopAction};
use onbrick::senses::{Channel, Role};
use proptest::prelude::*;

mod bad_input;
mod messages;
mod rooms;
mod within;

fn load(text: &str) -> Mission {
    let (mission, findings) = Mission::parse("mission.toml", text.as_bytes(), &Capabilities::all())
        .unwrap_or_else(|findings| panic!("{findings}"));
    assert!(findings.is_empty(), "{findings}");
    mission
}

fn shipped(name: &str) -> Mission {
    load(&shipped::find(name).unwrap().whole())
}

fn signals(ms: i64, set: &[(Signal, f64)]) -> Signals {
    let mut signals = Signals::at(ms * 1_000_000);
    for (signal, value) in set {
        signals.set(*signal, *value);
    }
    signals
}

fn step(program: &mut Program, signals: &Signals) -> (Demands, Progress) {
    let mut demands = Demands::default();
    let progress = program.step(signals, &mut demands, |_| {});
    (demands, progress)
}

#[test]
fn every_shipped_mission_loads_without_a_finding_and_is_called_as_its_file() {
    for mission in MISSIONS {
        assert_eq!(shipped(mission.name).name(), mission.name);
    }
    assert_eq!(load(TEMPLATE).name(), "first");
    assert!(shipped::find("nothing").is_none());
}

#[test]
fn shipped_missions_need_what_their_first_lines_say() {
    for (name, senses) in [
        ("map", &[Channel::Head, Channel::Range][..]),
        ("explore", &[Channel::Head, Channel::Range][..]),
        ("bump", &[Channel::Touch]),
        ("wall", &[Channel::Head, Channel::Range][..]),
        ("line", &[Channel::Reflect]),
        ("edge", &[Channel::Reflect]),
        ("remote", &[Channel::Remote]),
        ("square", &[]),
    ] {
        assert_eq!(shipped(name).senses(), senses, "{name}");
    }
}

#[test]
fn the_mapping_mission_is_the_seeds() {
    let mission = shipped("map");
    assert_eq!(
        (mission.rate_hz(), mission.time_limit_s(), mission.finish()),
        (50, 120.0, Finish::All)
    );
    let drive = &mission.machines()[0];
    let on_stall = drive.region.on_stall.and_then(|at| drive.state(at));
    assert_eq!(
        (mission.on_lost(), on_stall.map(|state| state.name.as_str())),
        (OnLost::Stop, Some("back"))
    );
    let mut program = mission.start().unwrap();
    #[rustfmt::skip]
    let transcript = [
        // ms      range m   head deg   drive         look
        (      0,  1.00,       0.0,     "forward",    "look_right"),
        (    100,  0.24,     -20.0,     "turn_right", "look_right"),    // nearer than 0.25 m
        (    200,  0.40,     -46.0,     "turn_right", "look_left"),     // only 0.5 m end a turn
        (    300,  0.51,      44.0,     "forward",    "look_left"),
        (    400,  f64::INFINITY, 46.0, "forward",    "look_right"),
        (120_000,  0.51,       0.0,     "forward",    "look_right"),    // the time is not over yet
        (120_001,  0.20,       0.0,     "turn_right", "look_right"),    // its end is not theirs
    ];
    for (ms, range_m, head_deg, drive, look) in transcript {
        let signals = signals(
            ms,
            &[
                (Signal::Sensed(Channel::Range), range_m),
                (Signal::Sensed(Channel::Head), f64::to_radians(head_deg)),
            ],
        );
        let (demands, progress) = step(&mut program, &signals);
        assert_eq!(program.states().collect::<Vec<_>>(), [drive, look], "at {ms} ms");
        let wheels = |left: f64, right: f64| Drive::Wheels {
            left_rad_s: left.to_radians(),
            right_rad_s: right.to_radians(),
        };
        let expected = match drive {
            "forward" => wheels(60.0, 60.0),
            _ => wheels(30.0, -70.0),
        };
        assert_eq!(demands.drive, Some(expected), "at {ms} ms");
        let head = match look {
            "look_right" => Some(f64::to_radians(-80.0)),
            _ => Some(f64::to_radians(80.0)),
        };
        assert_eq!(demands.head_rad, head, "at {ms} ms");
        // Neither machine has a final state: both are finished when the time is over.
        assert_eq!((progress, program.waits_for_time()), (Progress::Running, true), "at {ms} ms");
    }
}

#[test]
fn a_square_has_four_sides_and_four_corners() {
    let mut program = shipped("square").start().unwrap();
    // A robot that does what it is told, in ticks of 20 ms.
    let (mut travelled_m, mut heading_rad, mut tick, mut path) = (0.0, 0.0, 0, Vec::new());
    let (mut x_m, mut y_m) = (0.0, 0.0);
    for _ in 0..10_000 {
        let signals = signals(
            tick * 20,
            &[
                (Signal::Travelled, travelled_m),
                (Signal::Heading, heading_rad),
                (Signal::X, x_m),
                (Signal::Y, y_m),
            ],
        );
        let mut demands = Demands::default();
        let progress =
            program.step(&signals, &mut demands, |taken| path.push((taken.from, taken.to)));
        if let Some(Drive::Twist { forward_m_s, turn_rad_s }) = demands.drive {
            travelled_m += 0.02 * forward_m_s;
            heading_rad += 0.02 * turn_rad_s;
            x_m += 0.02 * forward_m_s * libm::cos(heading_rad);
            y_m += 0.02 * forward_m_s * libm::sin(heading_rad);
        }
        tick += 1;
        if progress == Progress::Finished {
            break;
        }
    }
    // Side and corner four times, and the end.
    assert_eq!(path, [(0, 1), (1, 0), (0, 1), (1, 0), (0, 1), (1, 0), (0, 1), (1, 2)]);
    assert!(libm::hypot(x_m, y_m) < 0.03, "{x_m} {y_m}");
    assert_eq!(program.variables(), [4.0]);
    assert!((travelled_m - 4.0).abs() < 0.02, "{travelled_m} m");
    assert!((heading_rad.to_degrees() - 360.0).abs() < 2.0, "{} degrees", heading_rad.to_degrees());
    assert!(tick * 20 < 100_000, "{} ms", tick * 20);
}

/// One machine with what stands in `[numbers]` and in the tables of its state `a`.
fn one_state(numbers: &str, state: &str) -> Mission {
    load(&format!(
        "name = \"m\"\n[numbers]\n{numbers}\n[machine.m]\nstart = \"a\"\nfinal = \"b\"\n\
         [machine.m.state.a]\n{state}\nnext = [{{ when = \"time_s > 10\", go = \"b\" }}]\n\
         [machine.m.state.b]\n"
    ))
}

#[test]
fn every_example_of_the_reference_is_a_mission_in_order() {
    let text = include_str!("../../src/behavior/missions.md");
    let examples: Vec<&str> =
        text.split("```toml\n").skip(1).filter_map(|rest| rest.split("```").next()).collect();
    assert!(examples.len() >= 12, "{} examples", examples.len());
    for example in examples {
        let mission = load(&submachines::joined(example, |_| None));
        assert!(mission.start().is_ok(), "{example}");
        let run = ["do =", "on_entry ="].iter().any(|key| example.contains(key));
        assert!(run, "it does nothing: {example}");
    }
}

#[test]
fn demands_are_in_si_units() {
    let mission = one_state(
        "fast = 90",
        "do = { forward_mps = 0.2, turn_dps = \"fast * 2\", head_deg = 45, motor.arm = \"-fast\", \
         motor.jaw = 0, tone_hz = \"400 + 40\", led = \"yellow\", say = \"hej\" }",
    );
    assert_eq!(mission.motors(), ["arm", "jaw"]);
    let (demands, _) = step(&mut mission.start().unwrap(), &signals(0, &[]));
    assert_eq!(
        demands.drive,
        Some(Drive::Twist { forward_m_s: 0.2, turn_rad_s: f64::to_radians(180.0) })
    );
    assert_eq!(demands.head_rad, Some(f64::to_radians(45.0)));
    assert_eq!(demands.motors, [Some(f64::to_radians(-90.0)), Some(0.0), None, None]);
    assert_eq!((demands.led, demands.tone_hz), (Some(LightColour::Yellow), Some(440.0)));
    assert_eq!(demands.say.as_deref(), Some("hej"));
}

#[test]
fn a_number_that_is_not_finite_or_not_known_stops_its_actuator_and_no_other() {
    let mission = one_state(
        "[variables]\nzero = 0",
        "do = { left_dps = \"1 / zero\", right_dps = 50, head_deg = \"range_m\", motor.arm = \
         \"x_m\", motor.jaw = 9 }",
    );
    for range_m in [f64::INFINITY, f64::NAN] {
        let (demands, _) = step(
            &mut mission.start().unwrap(),
            &signals(0, &[(Signal::Sensed(Channel::Range), range_m)]),
        );
        assert_eq!(demands.drive, Some(Drive::Stop(StopAction::Brake)));
        assert_eq!(demands.head_rad, None);
        assert_eq!(demands.motors, [Some(0.0), Some(f64::to_radians(9.0)), None, None]);
    }
}

#[test]
fn what_is_done_on_entry_and_on_exit_is_done_once() {
    let mission = one_state(
        "",
        "on_entry = { led = \"green\", say = \"in\" }\non_exit = { say = \"out\", tone_hz = 500 }",
    );
    let mut program = mission.start().unwrap();
    let said: Vec<_> = [0, 20, 10_020, 10_040]
        .map(|ms| step(&mut program, &signals(ms, &[])).0)
        .map(|demands| (demands.led, demands.say.map(|line| line.to_string()), demands.tone_hz))
        .into();
    let nothing = (None, None, None);
    let entry = (Some(LightColour::Green), Some("in".to_owned()), None);
    assert_eq!(
        said,
        [entry, nothing, (None, Some("out".to_owned()), Some(500.0)), (None, None, Some(500.0))],
        "a tone lasts for a moment"
    );
    let (demands, progress) = step(&mut program, &signals(10_240, &[]));
    assert_eq!((demands.tone_hz, progress), (None, Progress::Finished));
}

#[test]
fn a_motor_turns_to_an_angle_that_is_taken_once_and_is_done_there() {
    let mission = load(
        "name = \"m\"\n[machine.m]\nfinal = \"end\"\n[machine.m.state.on]\n\
         do = { motor.arm = -50, motor_deg.arm = \"motor.arm + 90\" }\n\
         next = [{ when = \"done\", go = \"back\" }]\n[machine.m.state.back]\n\
         do = { motor_deg.arm = 0 }\nnext = [{ when = \"done\", go = \"end\" }]\n\
         [machine.m.state.end]\n",
    );
    let mut program = mission.start().unwrap();
    let turn = |program: &mut Program, ms, arm_deg: f64| {
        let arm = (Signal::Sensed(Channel::Motor0), arm_deg.to_radians());
        let (demands, progress) = step(program, &signals(ms, &[arm]));
        assert_eq!(demands.motors[1..], [None; 3]);
        (demands.motors[0].map(|rad_s| rad_s.to_degrees().round()), progress)
    };
    assert_eq!(turn(&mut program, 0, 10.0), (Some(50.0), Progress::Running));
    // One that is continued from here has the same end, and not one 90 degrees further.
    let state = program.state();
    program = mission.start().unwrap();
    assert!(program.restore(&state));
    assert_eq!(turn(&mut program, 20, 60.0).0, Some(50.0));
    assert_eq!(turn(&mut program, 40, 97.0).0, Some(30.0), "it slows down");
    assert_eq!(turn(&mut program, 60, 110.0).0, Some(-50.0), "and comes back");
    assert_eq!(step(&mut program, &signals(80, &[])).0.motors[0], Some(0.0), "where is it?");
    assert_eq!(turn(&mut program, 100, 99.5).0, Some(0.0));
    assert_eq!(turn(&mut program, 120, 99.5).0, Some(-995.0), "as fast as the robot allows");
    assert_eq!(turn(&mut program, 140, 1.5).0, Some(-15.0));
    assert_eq!(turn(&mut program, 160, 1.5), (None, Progress::Finished));
}

#[test]
fn a_motion_without_a_number_is_told_of_until_it_has_one() {
    let mission = one_state("far = 1", "do = { drive_m = \"range_m - 0.3\" }");
    let mut program = mission.start().unwrap();
    for (ms, range_m, lacks) in [(0, f64::INFINITY, true), (20, 0.8, false), (40, 0.7, false)] {
        let at = [
            (Signal::Sensed(Channel::Range), range_m),
            (Signal::X, 0.0),
            (Signal::Y, 0.0),
            (Signal::Heading, 0.0),
        ];
        let (demands, _) = step(&mut program, &signals(ms, &at));
        assert_eq!(program.lacks_number(), lacks, "at {ms} ms");
        assert_eq!(demands.drive == Some(Drive::Stop(StopAction::Brake)), lacks, "at {ms} ms");
    }
}

#[test]
fn nothing_moves_while_the_last_sound_of_a_mission_is_heard() {
    let mission = load(
        "name = \"m\"\nfinish = \"any\"\n[machine.drive.state.on]\n\
         do = { forward_mps = 0.1, head_deg = 20, motor.arm = 50 }\n\
         [machine.look]\nstart = \"a\"\nfinal = \"b\"\n\
         [machine.look.state.a]\nnext = [{ when = \"time_s > 1\", go = \"b\" }]\n\
         [machine.look.state.b]\non_entry = { tone_hz = 500, tone_s = 2, say = \"found\" }\n",
    );
    let mut program = mission.start().unwrap();
    let moves = |demands: &Demands| {
        (demands.drive, demands.head_rad.is_some(), demands.motors[0].is_some(), demands.tone_hz)
    };
    let ahead = Some(Drive::Twist { forward_m_s: 0.1, turn_rad_s: 0.0 });
    let (demands, progress) = step(&mut program, &signals(900, &[]));
    assert_eq!((moves(&demands), progress), ((ahead, true, true, None), Progress::Running));
    let still = Some(Drive::Stop(StopAction::Brake));
    for ms in [1_020, 2_000, 3_000] {
        let (demands, progress) = step(&mut program, &signals(ms, &[]));
        let expected = ((still, false, false, Some(500.0)), Progress::Running);
        assert_eq!((moves(&demands), progress), expected, "at {ms} ms");
    }
    assert_eq!(step(&mut program, &signals(3_020, &[])).1, Progress::Finished);
}

#[test]
fn the_last_machine_in_the_file_has_the_lights() {
    let text = "name = \"m\"\n[machine.z]\nstart = \"a\"\nfinal = \"a\"\n[machine.z.state.a]\n\
        do = { led = \"red\", tone_hz = 100 }\n\
        [machine.a]\nstart = \"a\"\nfinal = \"a\"\n[machine.a.state.a]\ndo = { led = \"green\" }\n";
    let mission = load(text);
    assert_eq!(
        mission.machines().iter().map(|machine| machine.name.as_str()).collect::<Vec<_>>(),
        ["z", "a"]
    );
    let (demands, _) = step(&mut mission.start().unwrap(), &signals(0, &[]));
    assert_eq!((demands.led, demands.tone_hz), (Some(LightColour::Green), Some(100.0)));
}

#[test]
fn a_stall_leads_to_the_state_that_the_mission_names_and_nowhere_without_one() {
    let mut program = shipped("bump").start().unwrap();
    let free = |ms| {
        signals(
            ms,
            &[
                (Signal::Sensed(Channel::Touch), 0.0),
                (Signal::Travelled, 0.0),
                (Signal::Heading, 0.0),
            ],
        )
    };
    step(&mut program, &free(0));
    assert!(program.stall());
    let mut taken = Vec::new();
    program.step(&free(20), &mut Demands::default(), |transition| taken.push(transition));
    assert_eq!(taken, [Taken { machine: 0, from: 0, to: 1, transition: None }]);
    assert_eq!(program.states().collect::<Vec<_>>(), ["back"]);
    let mission = shipped("bump");
    assert_eq!(
        mission.named(taken[0]).unwrap().to_string(),
        "drive: forward → back (wheels blocked)"
    );
    let pressed = Taken { transition: Some(0), ..taken[0] };
    assert_eq!(mission.named(pressed).unwrap().to_string(), "drive: forward → back (touch)");
    assert_eq!(mission.named(Taken { machine: 7, ..pressed }), None);
    // The wheels still do not turn: the state stays, and its time keeps counting.
    assert!(program.stall());
    taken.clear();
    program.step(&free(40), &mut Demands::default(), |transition| taken.push(transition));
    assert_eq!(taken, []);
    program.step(&free(3021), &mut Demands::default(), |transition| taken.push(transition));
    assert_eq!(
        taken,
        [Taken { machine: 0, from: 1, to: 2, transition: Some(0) }],
        "3 s since the first"
    );
    assert!(!shipped("square").start().unwrap().stall(), "the square asks to be stopped");
}

#[test]
fn a_missions_numbers_can_be_set_within_bounds() {
    let mut mission = shipped("map");
    mission.set("near_m", 0.4).unwrap();
    mission.set("time_limit_s", 30.0).unwrap();
    assert_eq!((mission.time_limit_s(), mission.numbers()["near_m"]), (30.0, 0.4));
    let mut program = mission.start().unwrap();
    step(
        &mut program,
        &signals(
            0,
            &[(Signal::Sensed(Channel::Range), 0.39), (Signal::Sensed(Channel::Head), 0.0)],
        ),
    );
    assert_eq!(program.states().next(), Some("turn_right"));
    let mut square = shipped("square");
    assert_eq!(
        square.set("sides", 1.0).unwrap_err().to_string(),
        "`sides` is a variable, which the mission itself changes; [numbers] can be set"
    );
}

#[test]
fn variables_begin_with_what_is_known_at_the_first_step_those_above_included() {
    let mut mission = load(
        "name = \"m\"\n[numbers]\nmore_m = 1\n[variables]\nhome_m = \"x_m\"\ncount = 3\n\
         far_m = \"home_m + more_m + count\"\nunknown = \"range_m\"\n\
         [machine.m.state.a]\nnext = [{ when = \"touch\", go = \"a\" }]\n",
    );
    mission.set("more_m", 10.0).unwrap();
    let mut program = mission.start().unwrap();
    assert_eq!(program.variables(), [0.0, 3.0, 0.0, 0.0], "before the first step");
    for (ms, x_m) in [(0, 0.5), (20, 0.7)] {
        let set = [(Signal::X, x_m), (Signal::Sensed(Channel::Touch), 1.0)];
        step(&mut program, &signals(ms, &set));
        assert_eq!(program.variables(), [0.5, 3.0, 13.5, 0.0], "at {ms} ms");
    }
    let mut again = mission.start().unwrap();
    assert!(again.restore(&program.state()));
    step(&mut again, &signals(40, &[(Signal::X, 0.9)]));
    assert_eq!(again.variables(), program.variables());
}

#[test]
fn a_machine_begins_in_its_first_state_unless_it_names_another() {
    let begins = |start: &str| {
        let text = format!(
            "name = \"m\"\n[machine.m]\n{start}\n[machine.m.state.z]\n\
             next = [{{ when = \"touch\", go = \"a\" }}]\n[machine.m.state.a]\n\
             next = [{{ when = \"touch\", go = \"z\" }}]\n"
        );
        let mut program = load(&text).start().unwrap();
        step(&mut program, &signals(0, &[]));
        program.states().next().unwrap().to_owned()
    };
    assert_eq!((begins(""), begins("start = \"a\"")), ("z".to_owned(), "a".to_owned()));
}

/// A robot that does at once what it is told.
#[derive(Clone, Default)]
struct Obedient {
    x_m: f64,
    y_m: f64,
    heading_rad: f64,
}

impl Obedient {
    fn follow(&mut self, demands: &Demands) {
        if let Some(Drive::Twist { forward_m_s, turn_rad_s }) = demands.drive {
            self.x_m += 0.02 * forward_m_s * libm::cos(self.heading_rad);
            self.y_m += 0.02 * forward_m_s * libm::sin(self.heading_rad);
            self.heading_rad += 0.02 * turn_rad_s;
        }
    }
}

/// Signals of a robot that meets this and that, the same each time.
fn eventful(tick: i64, robot: &Obedient) -> Signals {
    let phase = (tick % 97) as f64 / 97.0;
    let mut signals = signals(
        tick * 20,
        &[
            (Signal::Sensed(Channel::Range), if tick % 13 == 0 { f64::INFINITY } else { phase }),
            (Signal::Echo, f64::from(tick % 13 != 0)),
            (Signal::Sensed(Channel::Touch), f64::from(tick % 41 == 0)),
            (Signal::Sensed(Channel::Head), libm::sin(phase * 6.0) * 1.5),
            (Signal::Sensed(Channel::Reflect), phase * 100.0),
            (Signal::Sensed(Channel::Remote), (tick / 30 % 9) as f64),
            (Signal::Travelled, tick as f64 * 0.002),
            (Signal::X, robot.x_m),
            (Signal::Y, robot.y_m),
            (Signal::Heading, robot.heading_rad),
        ],
    );
    if tick % 29 == 0 {
        signals.set(Signal::Sensed(Channel::Range), None);
    }
    signals
}

#[test]
fn a_mission_goes_on_from_a_checkpoint_as_if_it_had_not_been_interrupted() {
    for mission in MISSIONS {
        let mission = load(&mission.whole());
        let run = |program: &mut Program, robot: &mut Obedient, ticks: std::ops::Range<i64>| {
            let mut record = Vec::new();
            for tick in ticks {
                let (mut demands, mut all) = (Demands::default(), Vec::new());
                let signals = eventful(tick, robot);
                let progress = program.step(&signals, &mut demands, |taken| all.push(taken));
                robot.follow(&demands);
                record.push((demands, all, progress));
            }
            record
        };
        let mut program = mission.start().unwrap();
        let mut robot = Obedient::default();
        run(&mut program, &mut robot, 0..500);
        let (checkpoint, mut same) = (program.state(), robot.clone());
        let first = run(&mut program, &mut robot, 500..3000);
        let mut again = mission.start().unwrap();
        assert!(again.restore(&checkpoint), "{}", mission.name());
        assert_eq!(again.state(), checkpoint);
        assert_eq!(run(&mut again, &mut same, 500..3000), first, "{}", mission.name());
        // What waits for a plan stands still here.
        assert!(
            mission.navigates() || first.iter().any(|(_, taken, _)| !taken.is_empty()),
            "{} stood still",
            mission.name()
        );
        let mut foreign = checkpoint;
        foreign.machines[0].state = 999;
        assert!(!again.restore(&foreign), "there is no state 999");
        assert!(!again.restore(&ProgramState::default()), "a checkpoint has every machine");
    }
}

#[test]
fn every_shipped_mission_has_a_graph_that_mermaid_reads() {
    for shipped in MISSIONS {
        let mission = load(&shipped.whole());
        let diagram = graph::mermaid(&mission);
        let mut lines = diagram.lines();
        assert_eq!(lines.next(), Some("stateDiagram-v2"));
        let (mut depth, mut declared, mut edges) = (0, Vec::new(), 0);
        for line in lines.map(str::trim) {
            match line.split_whitespace().collect::<Vec<_>>().as_slice() {
                ["state", .., "as", id, "{"] => {
                    depth += 1;
                    declared.push((*id).to_owned());
                }
                ["state", .., "as", id] => declared.push((*id).to_owned()),
                ["[*]", "-->", id] | [id, "-->", "[*]"] => {
                    assert!(declared.contains(&(*id).to_owned()), "{line}")
                }
                [from, "-->", to, ":", when @ ..] => {
                    for id in [from, to] {
                        assert!(declared.contains(&(*id).to_owned()), "{line}");
                    }
                    let text = when.join(" ");
                    assert!(
                        !text.is_empty() && !text.contains(['<', '>', '"', '{', '}', ':']),
                        "{line}"
                    );
                    edges += usize::from(text != "on_stall");
                }
                ["}"] => depth -= 1,
                _ => panic!("{line}"),
            }
        }
        let transitions: usize = mission
            .machines()
            .iter()
            .map(|machine| {
                let states = machine.states.iter().map(|state| state.next.len());
                machine.region.always.len() + states.sum::<usize>()
            })
            .sum();
        assert_eq!((depth, edges), (0, transitions), "{diagram}");
    }
}
