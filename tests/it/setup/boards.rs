//! Setting up a robot on boards that do not find out what is plugged in, and have no buttons.

use onbrick::commissioning::{Patient, Verdict, examine, setup};
use onbrick::ev3dev::{BRICKPI, BRICKPI3, EV3, EVB, PISTORMS};
use onbrick::robot::{RobotConfig, StopButton};
use onbrick::senses::Role;

use super::teach::Onlooker;
use super::*;

/// An onlooker who knows what the arena's robot has plugged in.
struct Owner {
    onlooker: Onlooker,
    clock: Arc<VirtualClock>,
    /// Port by port, as questions about them come.
    inputs: Vec<&'static str>,
}

impl Dialogue for Owner {
    fn say(&mut self, text: &str) {
        self.onlooker.say(text);
    }

    fn choose(
        &mut self,
        question: &str,
        choices: &[&str],
        default: usize,
    ) -> Result<usize, NoAnswer> {
        if !question.starts_with("What is plugged into") {
            let seen = self.onlooker.choose(question, choices, default);
            // A wheel that a driver can only hold swings back a little.
            self.clock.sleep_ns(SECOND_NS);
            return seen;
        }
        let sensor = self.inputs.remove(0);
        Ok(choices.iter().position(|choice| choice.contains(sensor)).unwrap())
    }

    fn confirm(&mut self, question: &str) -> Result<bool, NoAnswer> {
        if question.contains("stop the robot") { Ok(true) } else { self.onlooker.confirm(question) }
    }

    fn text(&mut self, question: &str, default: &str) -> Result<String, NoAnswer> {
        self.onlooker.text(question, default)
    }

    fn is_pressed(&mut self) -> bool {
        false
    }
}

fn failures(bench: &Bench, text: String) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let diagnosis = examine(&Patient {
        tree: &bench.tree,
        clock: &*bench.clock,
        flags: &bench.flags,
        robot: Ok(&Source { name: "robot.toml".to_owned(), text }),
        root: None,
        recordings: folder.path(),
        missions: None,
        wall_ns: 1_790_000_000 * SECOND_NS,
    });
    let failed = diagnosis.checks.iter().filter(|checked| checked.verdict == Verdict::Failed);
    failed.map(ToString::to_string).collect()
}

#[test]
fn each_board_is_set_up_by_answers_and_doctor_finds_nothing_wrong_then() {
    for platform in [&BRICKPI3, &BRICKPI, &PISTORMS, &EVB] {
        let name = platform.name;
        let bench = Bench::on(platform, "", 1);
        let mut person = Owner {
            onlooker: Onlooker::new(&bench),
            clock: Arc::clone(&bench.clock),
            inputs: vec!["ultrasonic", "touch", "colour", "gyro"],
        };
        let text = setup(&bench.tree, &*bench.clock, &bench.flags, &mut person).unwrap();
        bench.assert_still();
        assert_eq!(person.inputs.is_empty(), !platform.detects, "{name}");
        let robot: RobotConfig =
            load(&Source { name: "robot.toml".to_owned(), text: text.clone() });
        let port = |role: Role| robot.sensors[&role].as_ref().unwrap().short().to_owned();
        let inputs = platform.inputs;
        assert_eq!([port(Role::Range), port(Role::Gyro)], [inputs[0], inputs[3]], "{name}");
        assert_eq!(robot.drive.left.port.short(), platform.outputs[1], "{name}");
        let stop = robot.stop_button.as_ref().map(|button| match button {
            StopButton::Touch(port) => port.short().to_owned(),
            StopButton::Device(device) => device.display().to_string(),
        });
        let wanted = platform.buttons.is_none().then(|| inputs[1].to_owned());
        assert_eq!(stop, wanted, "{name}");
        let failed = failures(&bench, text);
        assert!(failed.is_empty(), "{name}: {failed:#?}");
    }
}

#[test]
fn doctor_says_that_a_board_has_no_buttons_and_the_shipped_file_is_right_in_all_else() {
    for platform in [&EV3, &BRICKPI3, &BRICKPI, &PISTORMS, &EVB] {
        let failed = failures(&Bench::on(platform, "", 1), DEFAULT_ROBOT.to_owned());
        let expected = usize::from(platform.buttons.is_none());
        assert_eq!(failed.len(), expected, "{}: {failed:#?}", platform.name);
        let said = failed.iter().all(|line| {
            line.contains("buttons")
                && line.contains("[stop_button]")
                && line.contains("--no-button")
        });
        assert!(said, "{failed:#?}");
    }
}
