//! Tests of the language: examples, and properties against a reference evaluator.

use proptest::prelude::*;

use super::super::blackboard::{Blackboard, Since};
use super::super::signals::{Capabilities, Signal, Signals, words};
use super::*;
use crate::clock::SECOND_NS;
use crate::senses::Channel;

fn vocabulary(capabilities: &Capabilities) -> Vocabulary<'_> {
    let mut vocabulary = Vocabulary::new(capabilities);
    vocabulary.numbers.insert("close_m".to_owned(), 0.25);
    vocabulary.numbers.insert("time_limit_s".to_owned(), 120.0);
    vocabulary.variables.push(("found".to_owned(), 0.0));
    let states = ["ahead", "turn"].map(str::to_owned).into_iter();
    let states = states.zip((0_u16..).map(|at| at..=at)).collect();
    vocabulary.machines.push(("drive".to_owned(), states));
    vocabulary
}

fn parse(text: &str, kind: Kind) -> Result<Expression, Vec<Misreading>> {
    Expression::parse(text, kind, &mut vocabulary(&Capabilities::all()))
}

fn condition(text: &str) -> Expression {
    parse(text, Kind::Truth).unwrap_or_else(|misreadings| panic!("{text}: {misreadings:?}"))
}

fn signals(set: &[(Signal, f64)]) -> Signals {
    let mut signals = Signals::at(3 * SECOND_NS);
    for (signal, value) in set {
        signals.set(*signal, *value);
    }
    signals
}

fn value(text: &str, set: &[(Signal, f64)]) -> Option<f64> {
    let kind = if parse(text, Kind::Number).is_ok() { Kind::Number } else { Kind::Truth };
    let expression =
        parse(text, kind).unwrap_or_else(|misreadings| panic!("{text}: {misreadings:?}"));
    expression.evaluate(board(signals(set)).seen_by(0, 0))
}

fn board(signals: Signals) -> Blackboard {
    Blackboard::of(signals, Since::default())
}

#[test]
fn operators_bind_as_documented() {
    for (text, understood) in [
        ("range_m < 0.25", "(range_m < 0.25)"),
        ("touch or echo and not touch", "(touch or (echo and (not touch)))"),
        ("not range_m < 1 and echo", "((not (range_m < 1)) and echo)"),
        ("x_m + 2 * y_m - -3 / 4 > 0", "(((x_m + (2 * y_m)) - ((-3) / 4)) > 0)"),
        ("(x_m + 2) * y_m != 1e-9", "(((x_m + 2) * y_m) != 1e-9)"),
        ("8 - 4 - 2 == 2", "(((8 - 4) - 2) == 2)"),
        ("echo == (touch != true)", "(echo == (touch != true))"),
        ("motor.arm > close_m", "(motor.arm > close_m)"),
        ("max(x_m, 2, -y_m) > 1", "(max(x_m, max(2, (-y_m))) > 1)"),
        ("not drive.state != turn", "(not (not (drive.state == turn)))"),
        ("colour == red and found < random(1, 6)", "((colour == red) and (found < random(1, 6)))"),
    ] {
        assert_eq!(condition(text).to_string(), understood, "{text}");
    }
}

#[test]
fn signals_are_read_in_the_units_of_their_names() {
    let since = Since {
        entered_ns: SECOND_NS,
        entered_m: 1.5,
        entered_heading_rad: 1.0,
        ..Since::default()
    };
    let mut signals = signals(&[
        (Signal::Sensed(Channel::Head), 0.5),
        (Signal::Travelled, 2.0),
        (Signal::Sensed(Channel::Motor0), -1.0),
    ]);
    signals.set(Signal::Heading, 1.0 + std::f64::consts::TAU);
    for (text, expected) in [
        ("head_deg", 0.5_f64.to_degrees()),
        ("time_s", 3.0),
        ("state_s", 2.0),
        ("state_m", 0.5),
        ("state_turn_deg", 360.0),
        ("heading_deg", 1.0_f64.to_degrees()),
        ("motor.arm", -1.0_f64.to_degrees()),
        ("close_m", 0.25),
    ] {
        let expression = parse(text, Kind::Number).unwrap();
        let board = Blackboard::of(signals, since);
        let value = expression.evaluate(board.seen_by(0, 0)).unwrap();
        assert!((value - expected).abs() < 1e-9, "{text} is {value}, not {expected}");
    }
}

#[test]
fn unknown_never_fires_and_what_does_not_depend_on_it_does() {
    for (text, expected) in [
        ("range_m < 1", None),
        ("not range_m < 1", None),
        ("range_m < 1 or range_m >= 1", None),
        ("range_m < 1 or time_s > 2", Some(1.0)),
        ("range_m < 1 and time_s > 2", None),
        ("range_m < 1 and time_s > 9", Some(0.0)),
        ("0 * range_m", None),
        ("echo == touch", None),
    ] {
        assert_eq!(value(text, &[]), expected, "{text}");
        assert_eq!(
            parse(text, Kind::Truth).is_ok_and(|e| { e.holds(board(signals(&[])).seen_by(0, 0)) }),
            expected == Some(1.0)
        );
    }
}

#[test]
fn arithmetic_is_that_of_ieee_754() {
    let no_echo = [(Signal::Sensed(Channel::Range), f64::INFINITY)];
    for (text, expected) in [
        ("1 / 0 > 1e300", 1.0),
        ("-1 / 0 < 0", 1.0),
        ("0 / 0 == 0 / 0", 0.0),
        ("0 / 0 != 0 / 0", 1.0),
        ("range_m - range_m < 1", 0.0),
        ("range_m > 1e300", 1.0),
        ("not (0 / 0 < 1)", 1.0),
    ] {
        assert_eq!(value(text, &no_echo), Some(expected), "{text}");
    }
}

#[test]
fn functions_give_what_they_say() {
    let here = [(Signal::X, 1.0), (Signal::Y, 2.0), (Signal::Heading, std::f64::consts::FRAC_PI_2)];
    for (text, expected) in [
        ("abs(-2)", 2.0),
        ("sqrt(9)", 3.0),
        ("round(2.5)", 3.0),
        ("floor(-0.5)", -1.0),
        ("sign(-0.1) + sign(0) + sign(7)", 0.0),
        ("min(3, 1, 2)", 1.0),
        ("max(3, 1, 2)", 3.0),
        ("clamp(5, -1, 1)", 1.0),
        ("clamp(-5, -1, 1)", -1.0),
        ("clamp(0.5, -1, 1)", 0.5),
        ("sin(30)", 0.5),
        ("cos(180)", -1.0),
        ("atan2(1, -1)", 135.0),
        ("wrap_deg(190)", -170.0),
        ("wrap_deg(-180)", -180.0),
        ("wrap_deg(180)", -180.0),
        ("distance_m(4, 6)", 5.0),
        ("bearing_deg(1, 3)", 0.0),
        ("bearing_deg(2, 2)", -90.0),
        ("bearing_deg(0, 2)", 90.0),
        ("found + 1", 1.0),
        ("white", 6.0),
    ] {
        let value = value(text, &here).unwrap_or_else(|| panic!("{text} is unknown"));
        assert!((value - expected).abs() < 1e-9, "{text} is {value}, not {expected}");
    }
    for text in ["sqrt(-1)", "min(0 / 0, 1)", "max(1, 0 / 0)", "clamp(0 / 0, 0, 1)", "sign(0 / 0)"]
    {
        assert!(value(text, &here).unwrap().is_nan(), "{text}");
    }
    for text in ["distance_m(0, 0)", "bearing_deg(0, 0)", "abs(range_m)", "max(1, range_m)"] {
        assert_eq!(value(text, &[]), None, "{text}: what it needs is not known");
    }
}

#[test]
fn machines_are_asked_where_they_are() {
    let mut board = board(signals(&[]));
    for (state, text, expected) in [
        (0, "drive.state == ahead", 1.0),
        (0, "drive.state != ahead", 0.0),
        (1, "drive.state == ahead or found > 5", 0.0),
        (1, "drive.state == turn and drive.state != ahead", 1.0),
    ] {
        board.machines[0].state = state;
        assert_eq!(condition(text).evaluate(board.seen_by(0, 0)), Some(expected), "{text}");
    }
}

#[test]
fn chance_is_drawn_when_a_state_is_entered_and_evenly() {
    let dice = parse("random(-1, 3)", Kind::Number).unwrap();
    let two = parse("random(0, 1) - random(0, 1)", Kind::Number).unwrap();
    let mut board = board(signals(&[]));
    let mut drawn = Vec::new();
    for entered in 0..4000 {
        board.machines[0].since[0].entered_ns = 20_000_000 * entered;
        let value = dice.evaluate(board.seen_by(0, 0)).unwrap();
        board.signals.set_time_ns(20_000_000 * entered + 7);
        assert_eq!(
            dice.evaluate(board.seen_by(0, 0)),
            Some(value),
            "it stays until the next state"
        );
        assert_ne!(two.evaluate(board.seen_by(0, 0)), Some(0.0), "each draws its own");
        drawn.push(value);
    }
    assert!(drawn.iter().all(|value| (-1.0..3.0).contains(value)));
    let mean = drawn.iter().sum::<f64>() / 4000.0;
    assert!((mean - 1.0).abs() < 0.06, "{mean}");
    for quarter in [-1.0, 0.0, 1.0, 2.0] {
        let inside = drawn.iter().filter(|value| (quarter..quarter + 1.0).contains(*value)).count();
        assert!((900..1100).contains(&inside), "{inside} from {quarter}");
    }
    board.seed = 1;
    board.machines[0].since[0].entered_ns = 0;
    assert_ne!(dice.evaluate(board.seen_by(0, 0)), Some(drawn[0]), "another seed");
}

#[test]
fn names_of_machines_and_states_may_have_hyphens() {
    let all = Capabilities::all();
    let mut vocabulary = vocabulary(&all);
    let states = ["go-there", "turn-2", "go"].map(str::to_owned).into_iter();
    let states = states.zip((0_u16..).map(|at| at..=at)).collect();
    vocabulary.machines.push(("my-drive".to_owned(), states));
    vocabulary.variables.push(("my-drive.go-there.nearest_m".to_owned(), 0.0));
    vocabulary.variables.push(("go".to_owned(), 3.0));
    for (text, names) in [
        ("my-drive.state == go-there", &["my-drive.state == go-there"][..]),
        ("my-drive.state != turn-2 and found-go > 1", &["my-drive.state == turn-2", "found", "go"]),
        ("my-drive.go-there.nearest_m-go < 1", &["my-drive.go-there.nearest_m", "go"]),
        ("my-drive.state == go", &["my-drive.state == go"]),
    ] {
        let read = Expression::parse(text, Kind::Truth, &mut vocabulary)
            .unwrap_or_else(|misreadings| panic!("{text}: {misreadings:?}"));
        assert_eq!(*read.names, names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
    }
    let there = Expression::parse("my-drive.state == there", Kind::Truth, &mut vocabulary);
    assert!(there.unwrap_err()[0].mistake.to_string().contains("has no state `there`"));
}

/// What a `pid` answers to errors 20 ms apart.
fn answers(text: &str, errors: &[f64]) -> Vec<f64> {
    let all = Capabilities::all();
    let mut vocabulary = vocabulary(&all);
    vocabulary.pids = Some(0);
    let pid = Expression::parse(text, Kind::Number, &mut vocabulary).unwrap();
    let mut board = board(signals(&[]));
    board.enter(0, 0, 0);
    let mut time_ns = 0;
    let mut answer = |error: &f64| {
        time_ns += 20_000_000;
        board.signals.set_time_ns(time_ns);
        board.signals.set(Signal::Sensed(Channel::Range), *error);
        pid.evaluate(board.seen_by(0, 0)).unwrap()
    };
    errors.iter().map(&mut answer).collect()
}

#[test]
fn a_pid_outlives_an_error_that_is_infinite() {
    let far = f64::INFINITY;
    for (text, expected) in [
        ("pid(range_m, 2, 0, 0)", [2.0, far, 2.0, 2.0]),
        ("pid(range_m, 0, 1, 0)", [0.0, 0.0, 0.0, 0.02]),
        ("pid(range_m, 2, 0, 1, 3)", [2.0, 3.0, 2.0, 2.0]),
        ("pid(range_m, -2, 0, 0, -3)", [-2.0, -3.0, -2.0, -2.0]),
    ] {
        let said = answers(text, &[1.0, far, 1.0, 1.0]);
        let both_far = |one: f64, other: f64| one.is_infinite() && other.is_infinite();
        let is_near =
            |(one, other): (&f64, &f64)| both_far(*one, *other) || (one - other).abs() < 1e-9;
        assert!(said.iter().zip(&expected).all(is_near), "{text}: {said:?}");
    }
}

#[test]
fn the_sum_of_a_pid_does_not_wind_up_at_its_bound() {
    let far_then_near: Vec<f64> = [vec![5.0; 500], vec![-0.05; 2]].concat();
    let bounded = answers("pid(range_m, 1, 1, 0, 0.1)", &far_then_near);
    assert!(bounded.iter().all(|answer| answer.abs() <= 0.1), "{bounded:?}");
    assert!(bounded[501] < 0.0, "it turns round at once: {}", bounded[501]);
    let unbounded = answers("pid(range_m, 1, 1, 0)", &far_then_near);
    assert!(unbounded[501] > 40.0, "{}", unbounded[501]);
}

#[test]
fn a_pid_sums_and_differentiates_from_when_its_state_was_entered() {
    let all = Capabilities::all();
    let mut vocabulary = vocabulary(&all);
    vocabulary.pids = Some(0);
    let text = "pid(x_m, 2, 10, 0.5)";
    let pid = Expression::parse(text, Kind::Number, &mut vocabulary).unwrap();
    let mut board = board(signals(&[]));
    let mut step = |ms: i64, x_m: f64, enter: bool| {
        board.signals.set_time_ns(ms * 1_000_000);
        board.signals.set(Signal::X, x_m);
        if enter {
            board.enter(0, 0, 0);
        }
        pid.evaluate(board.seen_by(0, 0)).unwrap()
    };
    for (ms, x_m, enter, expected) in [
        (0, 1.0, true, 2.0),
        (20, 1.0, false, 2.0 + 10.0 * 0.02),
        (40, 2.0, false, 4.0 + 10.0 * (0.02 + 0.04) + 0.5 * 50.0),
        // A minute's pause counts for a tenth of a second.
        (60_040, 2.0, false, 4.0 + 10.0 * (0.06 + 0.2)),
        (60_060, 1.0, true, 2.0),
    ] {
        let value = step(ms, x_m, enter);
        assert!((value - expected).abs() < 1e-9, "{ms} ms: {value}, not {expected}");
    }
    for _ in 0..3 {
        Expression::parse(text, Kind::Number, &mut vocabulary).unwrap();
    }
    let fifth = Expression::parse(text, Kind::Number, &mut vocabulary).unwrap_err();
    assert_eq!(fifth[0].mistake, Mistake::TooManyPids);
}

#[test]
fn mistakes_have_a_place_and_a_way_out() {
    for (text, place, message, hint) in [
        ("", "", "the expression is empty", ""),
        ("  ", "", "the expression is empty", ""),
        ("rangem < 1", "rangem", "unknown name `rangem`", "did you mean `range_m`?"),
        ("range_m <", "", "a number, a name or `(` should stand here, not the end", ""),
        ("range_m 5", "5", "an operator should stand here, not a number", ""),
        ("(range_m < 5", "(", "this `(` is not closed", ""),
        ("range_m < 5)", ")", "this `)` closes nothing", ""),
        ("0 < range_m < 5", "<", "comparisons cannot be chained", "write `a < b and b < c`"),
        ("touch && echo", "&&", "`&&` has no meaning in an expression", "write `and`"),
        ("range_m = 5", "=", "`=` has no meaning in an expression", "write `==`"),
        ("touch AND echo", "AND", "`AND` has no meaning in an expression", "write `and`"),
        ("NOT touch", "NOT", "`NOT` has no meaning in an expression", "write `not`"),
        ("colour <> red", "<>", "`<>` has no meaning in an expression", "write `!=`"),
        ("colour == 'red'", "'", "`'` has no meaning in an expression", "without quotes"),
        ("x_m % 2 < 1", "%", "`%` has no meaning in an expression", "a - b * floor(a / b)"),
        ("x_m ** 2 < 1", "**", "`**` has no meaning in an expression", "a * a"),
        ("touch ? 1 : 2", "?", "`?` has no meaning in an expression", "a transition for each"),
        ("1 if touch", "if", "`if` has no meaning in an expression", "a transition for each"),
        ("range_m ≤ 5", "≤", "`≤` has no meaning in an expression", "write `<=`"),
        (
            "range_m < 5cm",
            "5cm",
            "`5cm` is not a number that can be used",
            "a unit is part of a name, as in `range_m < 0.25`",
        ),
        ("range_m < 5 cm", "cm", "an operator should stand here, not `cm`", "a unit is part of"),
        ("heading_deg > 90°", "°", "`°` has no meaning in an expression", "a unit is part of"),
        (
            "range_m < 1e999",
            "1e999",
            "`1e999` is not a number that can be used",
            "write it as `0.25` or `2.5e-1`",
        ),
        (
            "range_m < 1.2.3",
            "1.2.3",
            "`1.2.3` is not a number that can be used",
            "write it as `0.25` or `2.5e-1`",
        ),
        ("touch < 1", "touch", "`<` takes a number, and this is true or false", ""),
        ("not range_m", "range_m", "`not` takes true or false, and this is a number", ""),
        ("touch == 1", "touch == 1", "`==` compares a number with true or false", ""),
        (
            "range_m",
            "range_m",
            "this must be true or false, and it is a number",
            "compare it with something, as in `… > 0`",
        ),
        ("$", "$", "`$` has no meaning in an expression", ""),
        ("range_m < 0,25", ",", "an operator should stand here, not `,`", "as in `0.25`"),
        ("abs(0,25) < 1", "abs(0,25)", "`abs` takes one number, and this is 2", "has a point"),
        ("abs() < 1", "abs()", "`abs` takes one number, and this is 0", "write `abs(a)`"),
        ("abs < 1", "abs", "`abs` is a function: its arguments", "write `abs(a)`"),
        ("abs(1 + 2", "(", "this `(` is not closed", ""),
        ("roud(1) < 1", "roud", "there is no function `roud`", "did you mean `round`?"),
        ("min(echo, 2) < 1", "echo", "`min` takes a number, and this is true or false", ""),
        ("min(1, 2,) < 1", ")", "a number, a name or `(` should stand here, not `)`", ""),
        ("pid(x_m, 1, 0, 0) > 1", "pid", "`pid` remembers from tick to tick", ""),
        ("drvie.state == turn", "drvie.state", "the mission has no machine `drvie`", "`drive`"),
        ("drive.state == trun", "trun", "machine `drive` has no state `trun`", "`turn`"),
        ("drive.state > 1", "drive.state", "is compared with the name of a state", "drive.state"),
        ("colour == yelow", "yelow", "unknown name `yelow`", "did you mean `yellow`?"),
        // Not the nearest of all names, `range_m`.
        ("colour == orange", "orange", "unknown name `orange`", "`colour` is one of none, black,"),
        ("remote != red_up", "red_up", "unknown name `red_up`", "`remote` is one of none, left_up"),
        ("range_m < rang", "rang", "unknown name `rang`", "did you mean `range_m`?"),
        ("button_back", "button_back", "unknown name `button_back`", "Enter and Back stop the run"),
    ] {
        let misreadings = parse(text, Kind::Truth).unwrap_err();
        let first = &misreadings[0];
        assert!(first.to_string().contains(message), "{text}: {first}");
        assert_eq!(&text[first.place.clone()], place, "{text}");
        assert!(
            first.hint.as_deref().unwrap_or_default().contains(hint),
            "{text}: {:?}",
            first.hint
        );
    }
}

#[test]
fn several_unknown_names_are_found_in_one_go() {
    let misreadings = parse("rangem < 1 and tuch or foo", Kind::Truth).unwrap_err();
    assert_eq!(misreadings.len(), 3, "{misreadings:?}");
}

#[test]
fn signals_and_motors_that_the_robot_lacks_are_refused() {
    let bare =
        Capabilities { motors: Some(vec![("gripper".to_owned(), 3.5)]), ..Capabilities::default() };
    let robot = |text| Expression::parse(text, Kind::Truth, &mut Vocabulary::new(&bare));
    assert!(robot("motor.gripper > 0 and heading_deg > 5").is_ok());
    assert_eq!(
        robot("touch").unwrap_err()[0].to_string(),
        "`touch` takes a touch sensor, which the robot does not have"
    );
    let misreadings = robot("motor.griper > 0").unwrap_err();
    assert_eq!(misreadings[0].to_string(), "the robot has no motor named `griper`");
    assert_eq!(misreadings[0].hint.as_deref(), Some("did you mean `gripper`?"));
    let many = "motor.a + motor.b + motor.c + motor.d + motor.e > 0";
    let misreadings = parse(many, Kind::Truth).unwrap_err();
    assert_eq!(misreadings[0].to_string(), "more than 4 named motors");
}

#[test]
fn hostile_texts_are_refused_at_once() {
    let deep = "(".repeat(2000);
    let nots = "not ".repeat(1000);
    let powers = format!("1 {} > 0", "- (1 ".repeat(300));
    for text in [deep.as_str(), &nots, &powers] {
        let misreadings = parse(text, Kind::Truth).unwrap_err();
        assert_eq!(misreadings[0].mistake, Mistake::TooDeep, "{}", &text[..20]);
    }
    let long = "1 + ".repeat(300_000);
    assert_eq!(parse(&long, Kind::Number).unwrap_err()[0].mistake, Mistake::TooLong(1_200_000));
    let chain = format!("{}1 > 0", "1 + ".repeat(1000));
    assert_eq!(value(&chain, &[]), Some(1.0), "a long chain is not a deep one");
}

#[test]
fn the_deepest_expression_that_is_read_is_evaluated() {
    let levels = (1..=Expression::MAX_NESTING).find(|levels| {
        let text = format!("{}1{} == 0", "1 - (".repeat(*levels), ")".repeat(*levels));
        parse(&text, Kind::Truth).is_err()
    });
    let deepest = levels.unwrap() - 1;
    let text = format!("{}1{}", "1 - (".repeat(deepest), ")".repeat(deepest));
    let expected = if deepest % 2 == 0 { 1.0 } else { 0.0 };
    assert_eq!(value(&text, &[]), Some(expected), "{deepest} levels");
}

#[test]
fn what_a_condition_claims_is_found() {
    for (earlier, later, shadowed) in [
        ("range_m < 0.5", "range_m < 0.25", true),
        ("range_m < 0.25", "range_m < 0.5", false),
        ("range_m <= 0.25", "range_m < 0.25", true),
        ("range_m < 0.25", "range_m <= 0.25", false),
        ("range_m < 0.25", "range_m < 0.25", true),
        ("0.5 > range_m", "range_m < 0.25 and touch", true),
        ("range_m < 0.5 and touch", "range_m < 0.25", false),
        ("range_m < 0.5 and touch", "touch and range_m < 0.25", true),
        ("range_m < 0.5 or touch", "touch", true),
        ("range_m < 0.5", "range_m < 0.25 or touch", false),
        ("range_m < 0.5 or touch", "range_m < 0.25 or touch and echo", true),
        ("not range_m >= 0.5", "range_m < 0.25", true),
        ("range_m < close_m", "range_m < 0.2", true),
        ("range_m < 0.1 + max(close_m, 0.1)", "range_m < 0.25", true),
        ("2 * range_m < 1", "2 * range_m < 0.5 and touch", true),
        // No algebra.
        ("2 * range_m < 1", "range_m < 0.25", false),
        ("range_m != 1", "range_m == 2", true),
        ("range_m != 1", "range_m == 1", false),
        ("range_m != 1", "range_m > 1", true),
        ("colour == 5", "colour == 5 and echo", true),
        ("not touch", "touch", false),
        ("true", "touch", true),
        ("1 < 2", "touch", true),
        ("time_s >= 0", "touch", true),
        // A lost range must not be read as one that is there.
        ("range_m >= 0", "touch", false),
        ("x_m * x_m + y_m * y_m < 4", "x_m * x_m + y_m * y_m < 1", true),
        ("x_m * x_m < 1", "x_m * y_m < 1", false),
        ("not (x_m / y_m < 4)", "x_m / y_m >= 4", true),
        // Where both are 0 neither comparison holds.
        ("x_m / y_m >= 4", "not (x_m / y_m < 4)", false),
        ("drive.state == turn", "touch and drive.state == turn", true),
        ("sensor.eye < 0.5", "sensor.eye < 0.25 and touch", true),
        ("x_m < y_m", "x_m < y_m and touch", true),
    ] {
        let (first, second) = (Claims::of(&condition(earlier)), Claims::of(&condition(later)));
        assert_eq!(second.implies(&first), shadowed, "`{earlier}` before `{later}`");
    }
}

#[test]
fn conditions_that_cannot_hold_or_cannot_fail_are_found() {
    for (text, never, always) in [
        ("range_m < 0", true, false),
        ("range_m >= 0", false, true),
        ("heading_deg > 200", true, false),
        ("range_m < 1 and range_m > 2", true, false),
        ("range_m < 1 or range_m >= 1", false, true),
        ("touch and not touch", true, false),
        ("colour == 8", true, false),
        ("false", true, false),
        ("time_s > -1", false, true),
        ("range_m < 1", false, false),
        ("state_turn_deg > 400", false, false),
        ("time_limit_s < 1", true, false),
        // Of an unknown robot, whose sensor may be a touch sensor.
        ("time_s > 3 and sensor.eye", false, false),
    ] {
        let claims = Claims::of(&condition(text));
        assert_eq!((claims.is_never(), claims.is_always()), (never, always), "{text}");
    }
}

/// Bounds on one signal in every form that is understood, held against all values that matter: a
/// claim is true, and where both are plain comparisons none is missed.
#[test]
fn claims_about_bounds_are_true_and_none_is_missed() {
    let mut conditions = Vec::new();
    for sign in ["<", "<=", ">", ">=", "==", "!="] {
        for bound in [0.5, 1.0, 2.0] {
            conditions.push((true, format!("range_m {sign} {bound}")));
            conditions.push((true, format!("not ({bound} {sign} range_m)")));
            conditions.push((false, format!("3 * range_m - 1 {sign} {}", 3.0 * bound - 1.0)));
            conditions.push((false, format!("1 - range_m / 2 {sign} {}", 1.0 - bound / 2.0)));
        }
    }
    let values = [0.0, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 2.5, f64::INFINITY];
    let known: Vec<_> = conditions
        .iter()
        .map(|(plain, text)| {
            let condition = condition(text);
            let holds = values.map(|range| {
                condition
                    .holds(board(signals(&[(Signal::Sensed(Channel::Range), range)])).seen_by(0, 0))
            });
            (*plain, text, Claims::of(&condition), holds)
        })
        .collect();
    for (plain, text, claims, holds) in &known {
        for (other_plain, other, wider, others) in &known {
            let implied = holds.iter().zip(others).all(|(holds, other)| !holds || *other);
            let claimed = claims.implies(wider);
            assert!(!claimed || implied, "`{text}` does not imply `{other}`");
            assert!(claimed || !implied || !plain || !other_plain, "`{text}` implies `{other}`");
        }
    }
}

/// An expression as a tree, with an evaluator of its own to hold the other against.
#[derive(Debug, Clone)]
enum Tree {
    Number(f64),
    Truth(bool),
    Name(&'static str, Signal, f64),
    Prefix(&'static str, Box<Tree>),
    Infix(&'static str, Box<Tree>, Box<Tree>),
}

impl Tree {
    fn render(&self) -> String {
        match self {
            Self::Number(number) => literal(*number),
            Self::Truth(truth) => truth.to_string(),
            Self::Name(name, ..) => (*name).to_owned(),
            Self::Prefix(word, inner) => format!("{word} ({})", inner.render()),
            Self::Infix(word, left, right) => {
                format!("({}) {word} ({})", left.render(), right.render())
            }
        }
    }

    fn value(&self, signals: &Signals) -> Option<f64> {
        match self {
            Self::Number(number) => Some(*number),
            Self::Truth(truth) => Some(f64::from(*truth)),
            Self::Name(_, signal, unit) => signals.get(*signal).map(|value| value * unit),
            Self::Prefix(word, inner) => {
                let inner = inner.value(signals)?;
                Some(if *word == "-" { -inner } else { f64::from(inner == 0.0) })
            }
            Self::Infix(word, left, right) => {
                let (left, right) = (left.value(signals), right.value(signals));
                match *word {
                    "and" if left == Some(0.0) || right == Some(0.0) => return Some(0.0),
                    "or" if left.is_some_and(|l| l != 0.0) || right.is_some_and(|r| r != 0.0) => {
                        return Some(1.0);
                    }
                    _ => {}
                }
                let (left, right) = (left?, right?);
                Some(match *word {
                    "and" => f64::from(left != 0.0 && right != 0.0),
                    "or" => f64::from(left != 0.0 || right != 0.0),
                    "<" => f64::from(left < right),
                    "<=" => f64::from(left <= right),
                    ">" => f64::from(left > right),
                    ">=" => f64::from(left >= right),
                    "==" => f64::from(left.partial_cmp(&right) == Some(std::cmp::Ordering::Equal)),
                    "!=" => f64::from(left.partial_cmp(&right) != Some(std::cmp::Ordering::Equal)),
                    "+" => left + right,
                    "-" => left - right,
                    "*" => left * right,
                    _ => left / right,
                })
            }
        }
    }
}

fn number() -> impl Strategy<Value = Tree> {
    let leaf = prop_oneof![
        (0.0..100.0_f64).prop_map(Tree::Number),
        (0..4_u8).prop_map(|whole| Tree::Number(f64::from(whole))),
        Just(Tree::Name("range_m", Signal::Sensed(Channel::Range), 1.0)),
        Just(Tree::Name("x_m", Signal::X, 1.0)),
        Just(Tree::Name("head_deg", Signal::Sensed(Channel::Head), 180.0 / std::f64::consts::PI)),
    ];
    leaf.prop_recursive(4, 16, 2, |inner| {
        let word = prop::sample::select(vec!["+", "-", "*", "/"]);
        prop_oneof![
            inner.clone().prop_map(|tree| Tree::Prefix("-", Box::new(tree))),
            (word, inner.clone(), inner).prop_map(|(word, a, b)| Tree::Infix(
                word,
                Box::new(a),
                Box::new(b)
            )),
        ]
    })
}

fn truth() -> impl Strategy<Value = Tree> {
    let comparison = prop::sample::select(vec!["<", "<=", ">", ">=", "==", "!="]);
    let leaf = prop_oneof![
        any::<bool>().prop_map(Tree::Truth),
        Just(Tree::Name("touch", Signal::Sensed(Channel::Touch), 1.0)),
        Just(Tree::Name("echo", Signal::Echo, 1.0)),
        (comparison, number(), number()).prop_map(|(word, a, b)| Tree::Infix(
            word,
            Box::new(a),
            Box::new(b)
        )),
    ];
    leaf.prop_recursive(4, 16, 2, |inner| {
        let word = prop::sample::select(vec!["and", "or", "==", "!="]);
        prop_oneof![
            inner.clone().prop_map(|tree| Tree::Prefix("not", Box::new(tree))),
            (word, inner.clone(), inner).prop_map(|(word, a, b)| Tree::Infix(
                word,
                Box::new(a),
                Box::new(b)
            )),
        ]
    })
}

/// Signals of which any may be lost; few values, so that comparisons come out both ways.
fn some_signals() -> impl Strategy<Value = Signals> {
    let value =
        || prop::option::of(prop::sample::select(vec![0.0, 0.5, 1.0, 2.0, 3.0, f64::INFINITY]));
    let flag = || prop::option::of(prop::sample::select(vec![0.0, 1.0]));
    (value(), value(), value(), flag(), flag()).prop_map(|(range, x, head, touch, echo)| {
        let mut signals = Signals::at(0);
        for (signal, value) in [
            (Signal::Sensed(Channel::Range), range),
            (Signal::X, x),
            (Signal::Sensed(Channel::Head), head),
            (Signal::Sensed(Channel::Touch), touch),
            (Signal::Echo, echo),
        ] {
            if let Some(value) = value {
                signals.set(signal, value);
            }
        }
        signals
    })
}

fn same(left: Option<f64>, right: Option<f64>) -> bool {
    match (left, right) {
        (Some(left), Some(right)) => {
            left.to_bits() == right.to_bits() || left.is_nan() && right.is_nan()
        }
        (left, right) => left == right,
    }
}

proptest! {
    #[test]
    fn evaluation_agrees_with_the_reference(tree in number(), signals in some_signals()) {
        let expression = parse(&tree.render(), Kind::Number).unwrap();
        let (value, expected) =
            (expression.evaluate(board(signals).seen_by(0, 0)), tree.value(&signals));
        prop_assert!(same(value, expected), "{} is {value:?}, not {expected:?}", tree.render());
    }

    #[test]
    fn conditions_agree_with_the_reference(tree in truth(), signals in some_signals()) {
        let expression = condition(&tree.render());
        let (value, expected) =
            (expression.evaluate(board(signals).seen_by(0, 0)), tree.value(&signals));
        prop_assert!(same(value, expected), "{} is {value:?}, not {expected:?}", tree.render());
    }

    #[test]
    fn what_was_understood_reads_back_as_the_same(tree in truth()) {
        let expression = condition(&tree.render());
        let again = condition(&expression.to_string());
        prop_assert_eq!(&expression.ops, &again.ops, "{}", expression);
    }

    #[test]
    fn claims_are_never_false(
        earlier in truth(),
        later in truth(),
        all_signals in prop::collection::vec(some_signals(), 40),
    ) {
        let (earlier, later) = (condition(&earlier.render()), condition(&later.render()));
        let (first, second) = (Claims::of(&earlier), Claims::of(&later));
            for signals in &all_signals {
            let holds = {
                let board = board(*signals);
                (earlier.evaluate(board.seen_by(0, 0)), later.evaluate(board.seen_by(0, 0)))
            };
            prop_assert!(
                !second.implies(&first) || holds.1 != Some(1.0) || holds.0 == Some(1.0),
                "{earlier} / {later}"
            );
            prop_assert!(!second.is_never() || holds.1 != Some(1.0), "{later} is not never");
            prop_assert!(!second.is_always() || holds.1 != Some(0.0), "{later} is not always");
        }
    }

    #[test]
    fn any_text_is_read_or_refused_within_its_bounds(text in "\\PC{0,80}") {
        if let Err(misreadings) = parse(&text, Kind::Truth) {
            prop_assert!(!misreadings.is_empty());
            for misreading in misreadings {
                prop_assert!(text.get(misreading.place.clone()).is_some(), "{misreading:?}");
            }
        }
    }

    #[test]
    fn any_words_are_read_or_refused(
        words in prop::collection::vec(
            prop::sample::select(
                words().map(|word| word.name)
                    .chain([
                        "and", "or", "not", "true", "(", ")", "+", "-", "*", "/", "<", "==", "1",
                        "0.5", "motor.arm", "foo",
                    ])
                    .collect::<Vec<_>>()
            ),
            0..20,
        )
    ) {
        if let Ok(expression) = parse(&words.join(" "), Kind::Truth) {
            let again = condition(&expression.to_string());
            prop_assert_eq!(&expression.ops, &again.ops);
        }
    }
}
