//! `setup`: a person says what they see, and the file is right.

use super::*;
use onbrick::commissioning::{SetupError, setup};
use onbrick::senses::Role;
use onbrick::sim::Written;

/// Sees what truly moves, and answers so; everything else is left at its default.
pub(super) struct Onlooker {
    simulation: Simulation,
    model: RobotModel,
    before: Truth,
    wheel_rad: f64,
    told: Vec<String>,
    asked: Vec<String>,
    /// How many questions are answered before the person goes away.
    patience: usize,
}

impl Onlooker {
    pub(super) fn new(bench: &Bench) -> Self {
        Self {
            simulation: bench.simulation.clone(),
            model: bench.model.clone(),
            before: bench.truth(),
            wheel_rad: 0.0,
            told: Vec::new(),
            asked: Vec::new(),
            patience: usize::MAX,
        }
    }

    fn answer(&mut self, question: &str) -> Result<(), NoAnswer> {
        self.asked.push(question.to_owned());
        if self.asked.len() > self.patience { Err(NoAnswer::Closed) } else { Ok(()) }
    }

    /// How the wheels and the head have turned since the motor was announced, as one sees it:
    /// forwards, and to the left, positive.
    fn seen(&self) -> [f64; 3] {
        let now = truth(&self.simulation);
        let wheel = |side: usize| {
            let turned_rad = now.wheels_rad[side] - self.before.wheels_rad[side];
            if self.model.drive_inverted[side] { -turned_rad } else { turned_rad }
        };
        [wheel(0), wheel(1), now.head_rad - self.before.head_rad]
    }
}

impl Dialogue for Onlooker {
    fn say(&mut self, text: &str) {
        if text.contains("turns now") {
            self.before = truth(&self.simulation);
        }
        self.told.push(text.to_owned());
    }

    fn choose(
        &mut self,
        question: &str,
        choices: &[&str],
        default: usize,
    ) -> Result<usize, NoAnswer> {
        self.answer(question)?;
        let [left, right, head] = self.seen();
        let place = |words: &str| choices.iter().position(|choice| choice.contains(words));
        let seen = if question.starts_with("What did the motor") {
            // The other wheel may be dragged along a little: what turned most is what the motor
            // moved.
            let parts = [("left wheel", left), ("right wheel", right), ("head", head)];
            let most = parts.into_iter().max_by(|(_, a), (_, b)| a.abs().total_cmp(&b.abs()));
            self.wheel_rad = if left.abs() > right.abs() { left } else { right };
            place(
                most.filter(|(_, turned)| turned.abs() > 0.1)
                    .map_or("leave this motor out", |(part, _)| part),
            )
        } else if question.contains("this wheel turn") {
            place(if self.wheel_rad > 0.0 { "forwards" } else { "backwards" })
        } else if question.contains("head turn") {
            place(if head > 0.0 { "anticlockwise" } else { "right (clockwise" })
        } else {
            Some(default)
        };
        Ok(seen.unwrap_or_else(|| panic!("`{question}` has no answer among {choices:?}")))
    }

    fn text(&mut self, question: &str, default: &str) -> Result<String, NoAnswer> {
        self.answer(question)?;
        Ok(default.to_owned())
    }

    fn is_pressed(&mut self) -> bool {
        false
    }
}

fn set_up(bench: &Bench) -> (RobotConfig, Onlooker) {
    let mut person = Onlooker::new(bench);
    let text = setup(&bench.tree, &*bench.clock, &bench.flags, &mut person).unwrap();
    bench.assert_still();
    (load(&Source { name: "robot.toml".to_owned(), text }), person)
}

#[test]
fn the_seeds_robot_is_set_up_as_the_shipped_file_has_it() {
    let bench = Bench::new("", 1);
    let (robot, person) = set_up(&bench);
    let mut shipped = RobotConfig::load("robot.toml", DEFAULT_ROBOT.as_bytes()).unwrap().0;
    // The simulated robot also has a bumper and looks at the floor.
    for role in [Role::Touch, Role::Colour] {
        shipped.sensors.insert(role, robot.sensors[&role].clone());
    }
    assert_eq!(robot, shipped);
    assert!(
        person.asked.len() < 20,
        "{} questions are too many: {:?}",
        person.asked.len(),
        person.asked
    );
}

#[test]
fn ports_and_directions_come_out_right_however_the_robot_is_built() {
    let cases = [
        ("outA", "outD", false, true, "outB", "[12, 36]"),
        ("outD", "outB", true, true, "outC", "[-12, 36]"),
        ("outC", "outA", true, false, "outD", "[-12, 36]"),
    ];
    for (left, right, left_inverted, right_inverted, head, gear) in cases {
        let motor = |port: &str| match port {
            port if port == left || port == right => "large",
            port if port == head => "medium",
            _ => "none",
        };
        let motors: String = ["outA", "outB", "outC", "outD"]
            .map(|port| format!("{port} = \"{}\"\n", motor(port)))
            .concat();
        let built = format!(
            "[robot]\nleft = \"{left}\"\nright = \"{right}\"\nleft_inverted = {left_inverted}\n\
             right_inverted = {right_inverted}\nhead = \"{head}\"\nhead_gear = {gear}\n\
             [robot.ports]\n{motors}\
             in1 = \"gyro\"\nin2 = \"ultrasonic\"\nin3 = \"none\"\nin4 = \"infrared\"\n"
        );
        let bench = Bench::new(&built, 7);
        let (robot, _) = set_up(&bench);
        let port =
            |port: &Option<onbrick::ev3dev::PortAddress>| port.as_ref().map(ToString::to_string);
        assert_eq!(
            [robot.drive.left.port.to_string(), robot.drive.right.port.to_string()],
            [left, right]
        );
        assert_eq!(
            (robot.drive.left.ratio < 0.0, robot.drive.right.ratio < 0.0),
            (left_inverted, right_inverted)
        );
        let found = robot.head.unwrap();
        assert_eq!(found.motor.port.to_string(), head);
        assert!((found.motor.ratio - bench.model.head_ratio).abs() < 1e-9, "{}", found.motor.ratio);
        assert_eq!(port(&robot.sensors[&Role::Gyro]), Some("in1".to_owned()));
        assert_eq!(port(&robot.sensors[&Role::Range]), Some("in2".to_owned()));
        assert_eq!(port(&robot.sensors[&Role::Remote]), Some("in4".to_owned()));
    }
}

#[test]
fn every_motion_is_a_lease_and_small() {
    let bench = Bench::new("", 3);
    let start = bench.truth();
    bench.simulation.record_writes(true);
    set_up(&bench);
    let writes = bench.simulation.take_writes();
    let commands: Vec<&Written> =
        writes.iter().filter(|write| write.path.ends_with("/command")).collect();
    assert!(commands.len() > 9, "{} commands for three motors", commands.len());
    for write in commands {
        let command = String::from_utf8_lossy(&write.value);
        assert!(
            ["reset", "run-timed", "stop"].contains(&command.trim()),
            "{} got {command}",
            write.path
        );
    }
    let end = bench.truth();
    let moved_m = libm::hypot(end.x_m - start.x_m, end.y_m - start.y_m);
    assert!(moved_m < 0.08, "the robot moved {moved_m} m");
}

#[test]
fn whoever_goes_away_or_stops_leaves_a_still_robot() {
    let bench = Bench::new("", 1);
    for patience in 0..8 {
        let mut person = Onlooker::new(&bench);
        person.patience = patience;
        let error = setup(&bench.tree, &*bench.clock, &bench.flags, &mut person).unwrap_err();
        assert!(
            matches!(error, SetupError::NoAnswer(NoAnswer::Closed)),
            "after {patience} answers: {error}"
        );
        bench.assert_still();
    }
    bench.flags.signal.store(true, Ordering::Relaxed);
    let error =
        setup(&bench.tree, &*bench.clock, &bench.flags, &mut Onlooker::new(&bench)).unwrap_err();
    assert!(matches!(error, SetupError::Stopped), "{error}");
    bench.assert_still();
}

#[test]
fn too_few_motors_are_said_before_anything_is_asked() {
    let bench = Bench::new("[robot.ports]\noutA = \"none\"\noutB = \"none\"\n", 1);
    let mut person = Onlooker::new(&bench);
    let error = setup(&bench.tree, &*bench.clock, &bench.flags, &mut person).unwrap_err();
    assert!(error.to_string().contains("one is plugged in"), "{error}");
    assert!(person.asked.is_empty(), "{:?}", person.asked);
}
