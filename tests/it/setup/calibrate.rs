//! `calibrate`: from wrong numbers to within 2 % of the true ones.

use super::*;
use onbrick::commissioning::{
    ApplyError, CalibrateError, CalibrateOptions, Calibration, Straight, calibrate,
};
use onbrick::sim::{Button, Fault, Physics, Port};

use crate::support::seeds;

/// How near the true numbers calibration must come.
const NEAR: f64 = 0.02;

type Mischief = Box<dyn Fn(&Simulation)>;

/// A person with good eyes, a slow hand and a measuring tape.
pub(crate) struct Measurer {
    simulation: Simulation,
    marked: Truth,
    way: f64,
    told: Vec<String>,
    /// What the person does once when this text comes up.
    mischief: Option<(&'static str, Mischief)>,
    /// Never presses Enter.
    asleep: bool,
    /// How wrong the tape is read, in turn, metres.
    pub(crate) tape_errors_m: Vec<f64>,
}

impl Measurer {
    pub(crate) fn new(bench: &Bench) -> Self {
        Self {
            simulation: bench.simulation.clone(),
            marked: bench.truth(),
            way: 1.0,
            told: Vec::new(),
            mischief: None,
            asleep: false,
            tape_errors_m: vec![0.001, -0.001],
        }
    }

    /// How far the robot is from standing along its line after two whole turns, radians; positive
    /// where it has yet to turn on.
    fn missing_rad(&self) -> f64 {
        let turned_rad = self.way * (truth(&self.simulation).heading_rad - self.marked.heading_rad);
        4.0 * PI - turned_rad
    }

    fn hear(&mut self, text: &str) {
        self.told.push(text.to_owned());
        if self.mischief.as_ref().is_some_and(|(when, _)| text.contains(when))
            && let Some((_, mischief)) = self.mischief.take()
        {
            mischief(&self.simulation);
        }
    }
}

impl Dialogue for Measurer {
    fn say(&mut self, text: &str) {
        self.hear(text);
    }

    fn choose(
        &mut self,
        question: &str,
        choices: &[&str],
        default: usize,
    ) -> Result<usize, NoAnswer> {
        if question.contains("along a line") {
            self.way = if question.contains("left") { 1.0 } else { -1.0 };
        }
        if question.contains("Mark on the floor") || question.contains("along a line") {
            self.marked = truth(&self.simulation);
        }
        self.hear(question);
        if question.contains("Does it stand along the line") {
            let missing_rad = self.missing_rad();
            let words = match missing_rad {
                missing if missing > 0.015 => "further",
                missing if missing < -0.015 => "back",
                _ => "exactly",
            };
            return Ok(choices.iter().position(|choice| choice.contains(words)).unwrap());
        }
        Ok(default)
    }

    fn text(&mut self, question: &str, default: &str) -> Result<String, NoAnswer> {
        if question.contains("from the middle between the wheels") {
            // The bench's wall.
            let off_m = 0.6 - truth(&self.simulation).x_m + self.tape_errors_m[0];
            return Ok(format!("{off_m:.3}"));
        }
        if !question.contains("from its mark") {
            return Ok(default.to_owned());
        }
        let now = truth(&self.simulation);
        let error_m = self.tape_errors_m[0];
        self.tape_errors_m.rotate_left(1);
        let came_m = libm::hypot(now.x_m - self.marked.x_m, now.y_m - self.marked.y_m) + error_m;
        Ok(format!("{came_m:.3}"))
    }

    fn is_pressed(&mut self) -> bool {
        // A hand is a fifth of a second late: at 12 degrees a second, 2.4 degrees.
        !self.asleep && self.missing_rad() < -0.04
    }
}

/// The shipped robot with both measures wrong by a share, and without the gyro where asked.
pub(crate) fn wrong(circumference: f64, track: f64, gyro: bool) -> Source {
    let text = DEFAULT_ROBOT
        .replacen("0.188976", &format!("{:.6}", 0.188_976 * circumference), 1)
        .replacen("0.1143", &format!("{:.6}", 0.1143 * track), 1);
    let text = if gyro { text } else { text.replacen("[gyro]\nport = \"in4\"\n", "", 1) };
    Source { name: "robot.toml".to_owned(), text }
}

fn measure(
    bench: &Bench,
    robot: &Source,
    options: &CalibrateOptions,
) -> Result<Calibration, CalibrateError> {
    let mut person = Measurer::new(bench);
    measure_with(bench, robot, options, &mut person)
}

pub(crate) fn measure_with(
    bench: &Bench,
    robot: &Source,
    options: &CalibrateOptions,
    person: &mut Measurer,
) -> Result<Calibration, CalibrateError> {
    let measured =
        calibrate(&bench.tree, &*bench.clock, &bench.flags, person, &load(robot), options);
    bench.assert_still();
    measured
}

/// The file that comes out has both numbers within [`NEAR`] of the true ones.
pub(crate) fn assert_near(what: &str, bench: &Bench, robot: &Source, calibration: &Calibration) {
    let text =
        calibration.apply(robot).unwrap_or_else(|error| panic!("{what}: {error}\n{calibration:?}"));
    let after = load(&Source { name: "robot.toml".to_owned(), text });
    let numbers = [
        ("circumference", after.drive.wheel_circumference_m, bench.model.wheel_circumference_m),
        ("track", after.drive.track_width_m, bench.model.track_width_m),
    ];
    for (name, found, truth) in numbers {
        let off = found / truth - 1.0;
        println!("{what}: {name} {found:.5} m, truly {truth:.5} m, off by {:+.2} %", off * 100.0);
        assert!(off.abs() < NEAR, "{what}: {name} is {found} m instead of {truth} m");
    }
}

/// Wrong both ways, and both too large.
const WRONG: [(f64, f64); 3] = [(0.9, 1.1), (1.1, 0.9), (1.1, 1.1)];

#[test]
fn wrong_numbers_end_near_the_true_ones_at_a_wall_and_by_gyro_and_marks() {
    for seed in seeds(5) {
        for (circumference, track) in WRONG {
            let robot = wrong(circumference, track, true);
            for mark in [Some(true), Some(false), None] {
                let bench = Bench::new("", seed);
                let options = CalibrateOptions { mark, ..CalibrateOptions::default() };
                let calibration = measure(&bench, &robot, &options).unwrap();
                let what = format!("wall, gyro, marks {mark:?}, seed {seed}");
                assert_near(&what, &bench, &robot, &calibration);
            }
        }
    }
}

#[test]
fn the_gyro_alone_does_as_well_as_the_gyro_itself() {
    for seed in seeds(5) {
        for track in [0.9, 1.1] {
            // Nothing on a robot without ears sees the gyro's own scale, so this one counts truly.
            let bench = Bench::new("[robot.errors]\ngyro_scale_sd = 0.0\n", seed);
            let robot = wrong(1.0, track, true);
            let robot = Source { text: cut(&robot.text, "[range]"), ..robot };
            let no_marks =
                CalibrateOptions { mark: Some(false), straight: None, ..Default::default() };
            let calibration = measure(&bench, &robot, &no_marks).unwrap();
            assert_near(&format!("gyro, seed {seed}"), &bench, &robot, &calibration);
            let track = calibration.track_width_m.unwrap();
            assert!(track.to_string().contains("off together by 2 %"), "{track}");
        }
    }
}

#[test]
fn what_the_range_sensor_hears_again_takes_out_what_the_gyro_counts_too_much() {
    for seed in seeds(5) {
        for off in [-0.04, 0.0, 0.03] {
            let errors = format!("[robot.errors]\ngyro_scale_sd = 0.0\ngyro_scale = {off:.2}\n");
            let bench = Bench::new(&errors, seed);
            let robot = wrong(1.0, 1.1, true);
            let mut person = Measurer::new(&bench);
            let options = CalibrateOptions { straight: None, ..CalibrateOptions::default() };
            let calibration = measure_with(&bench, &robot, &options, &mut person).unwrap();
            let scale = calibration.gyro_scale.unwrap();
            assert!((scale - 1.0 - off).abs() < 0.005, "{scale} where the gyro is off by {off}");
            let track = calibration.track_width_m.unwrap();
            let error = track.after / bench.model.track_width_m - 1.0;
            assert!(error.abs() < 0.01 && track.unseen == 0.0, "seed {seed}, {off}: {track}");
            assert!(!person.told.iter().any(|told| told.contains("line on the floor")));
        }
    }
}

#[test]
fn a_robot_that_was_put_aslant_turns_square_to_the_wall() {
    for seed in seeds(5) {
        for aslant_deg in [-30.0_f64, -15.0, 8.0, 22.0] {
            let bench = Bench::new("", seed);
            bench.simulation.inspect(|world: &mut WorldPhysics| {
                let heading_rad = aslant_deg.to_radians();
                world.carry(0, onbrick::sim::StartPose { x_m: 0.0, y_m: 0.0, heading_rad });
            });
            let options = CalibrateOptions { track: false, ..CalibrateOptions::default() };
            let measured = measure(&bench, &wrong(1.1, 0.9, seed % 2 == 0), &options).unwrap();
            let square_deg = bench.truth().heading_rad.to_degrees();
            let circumference = measured.wheel_circumference_m.unwrap();
            let off = circumference.after / bench.model.wheel_circumference_m - 1.0;
            println!("{aslant_deg}°, seed {seed}: {square_deg:.1}° at the end, off by {off:+.4}");
            assert!(square_deg.abs() < 10.0 && off.abs() < 0.006, "{circumference}");
            assert_eq!(circumference.doubt, None);
        }
    }
}

/// Room for a metre between the robot and the wall.
pub(crate) fn make_room(bench: &Bench) {
    bench.simulation.inspect(|world: &mut WorldPhysics| {
        world.carry(0, onbrick::sim::StartPose { x_m: -1.5, y_m: 0.0, heading_rad: 0.0 });
    });
}

#[test]
fn wrong_numbers_end_near_the_true_ones_with_a_tape_and_marked_turns() {
    for seed in seeds(3) {
        for (circumference, track) in [(0.9, 1.1), (1.1, 0.9)] {
            let bench = Bench::new("", seed);
            make_room(&bench);
            let robot = wrong(circumference, track, false);
            let options =
                CalibrateOptions { straight: Some(Straight::Metre), ..CalibrateOptions::default() };
            let calibration = measure(&bench, &robot, &options).unwrap();
            assert_near(&format!("tape, marks, seed {seed}"), &bench, &robot, &calibration);
            assert_eq!(calibration.gyro_scale, None);
        }
    }
}

#[test]
fn a_marked_turn_takes_out_what_the_gyro_counts_too_much() {
    let bench = Bench::new("[robot.errors]\ngyro_scale = 0.04\n", 4);
    let robot = wrong(1.0, 1.1, true);
    let options = CalibrateOptions { mark: Some(true), ..CalibrateOptions::default() };
    let calibration = measure(&bench, &robot, &options).unwrap();
    assert_near("gyro 4 % off, marked", &bench, &robot, &calibration);
    let scale = calibration.gyro_scale.unwrap();
    assert!((1.02..1.06).contains(&scale), "the gyro counts {scale} times what is turned");
    let text = calibration.apply(&robot).unwrap();
    let after = load(&Source { name: "robot.toml".to_owned(), text });
    assert!((after.gyro_scale - scale).abs() < 1e-6, "written: {}", after.gyro_scale);
    // Measured by the gyro alone, the track width goes by that scale.
    let unmarked = CalibrateOptions { straight: None, mark: Some(false), ..options };
    let bench = Bench::new("[robot.errors]\ngyro_scale = 0.04\n", 4);
    let robot = Source { name: "robot.toml".to_owned(), text: calibration.apply(&robot).unwrap() };
    let again = measure(&bench, &robot, &unmarked).unwrap();
    assert_near("gyro 4 % off, known", &bench, &robot, &again);
}

#[test]
fn the_wheels_alone_or_the_track_alone_leaves_the_other_number() {
    let bench = Bench::new("", 2);
    let robot = wrong(0.9, 1.1, true);
    let track = CalibrateOptions { straight: None, ..CalibrateOptions::default() };
    let calibration = measure(&bench, &robot, &track).unwrap();
    assert!(calibration.wheel_circumference_m.is_none());
    // What the heading needs is the ratio, and that is right though the circumference is not.
    let text = calibration.apply(&robot).unwrap();
    let after = load(&Source { name: "robot.toml".to_owned(), text });
    let ratio = after.drive.track_width_m / after.drive.wheel_circumference_m;
    let truth = bench.model.track_width_m / bench.model.wheel_circumference_m;
    assert!((ratio / truth - 1.0).abs() < NEAR, "{ratio} instead of {truth}");
    assert!((after.drive.wheel_circumference_m - 0.188_976 * 0.9).abs() < 1e-6);
}

#[test]
fn a_person_who_reads_the_tape_badly_is_told_and_nothing_is_written() {
    let bench = Bench::new("", 1);
    let mut person = Measurer::new(&bench);
    person.tape_errors_m = vec![0.08, -0.08, 0.0];
    let options = CalibrateOptions {
        straight: Some(Straight::Metre),
        track: false,
        ..CalibrateOptions::default()
    };
    bench.simulation.inspect(|world: &mut WorldPhysics| {
        world.carry(0, onbrick::sim::StartPose { x_m: -1.5, y_m: 0.0, heading_rad: 0.0 });
    });
    let robot = wrong(1.0, 1.0, true);
    let calibration = measure_with(&bench, &robot, &options, &mut person).unwrap();
    let error = calibration.apply(&robot).unwrap_err();
    assert!(
        matches!(error, ApplyError::Unsure { key: "drive.wheel_circumference_m", .. }),
        "{error}"
    );
    assert!(person.told.iter().any(|text| text.contains("not sure enough")), "{:?}", person.told);
}

#[test]
fn every_motion_is_a_lease() {
    let bench = Bench::new("", 1);
    bench.simulation.record_writes(true);
    measure(&bench, &wrong(1.0, 1.0, true), &CalibrateOptions::default()).unwrap();
    for write in
        bench.simulation.take_writes().iter().filter(|write| write.path.ends_with("/command"))
    {
        let command = String::from_utf8_lossy(&write.value).into_owned();
        assert!(
            ["reset", "run-timed", "stop"].contains(&command.trim()),
            "{} got {command}",
            write.path
        );
    }
}

/// What a person does just before a motion begins, and what calibration says to it.
fn ends_with(
    robot: &str,
    when: &'static str,
    mischief: impl Fn(&Simulation) + 'static,
) -> CalibrateError {
    let bench = Bench::new(robot, 1);
    let mut person = Measurer::new(&bench);
    person.mischief = Some((when, Box::new(mischief)));
    measure_with(&bench, &wrong(1.0, 1.0, true), &CalibrateOptions::default(), &mut person)
        .unwrap_err()
}

#[test]
fn whatever_goes_wrong_on_the_way_is_said_and_the_robot_stands() {
    let blocked = ends_with("", "spin on the spot", |simulation| {
        simulation.inspect(|world: &mut WorldPhysics| {
            world.fail(0, Fault::BlockedMotor(1));
            world.fail(0, Fault::BlockedMotor(3));
        });
    });
    assert!(matches!(blocked, CalibrateError::Blocked), "{blocked}");
    let one_blocked = ends_with("", "spin on the spot", |simulation| {
        simulation.inspect(|world: &mut WorldPhysics| world.fail(0, Fault::BlockedMotor(3)));
    });
    assert!(matches!(one_blocked, CalibrateError::Blocked), "{one_blocked}");
    let silent = ends_with("[robot.errors]\nrange_dropout = 1.0\n", "never", |_| ());
    assert!(silent.to_string().contains("no wall within 1.5 m ahead: put the robot"), "{silent}");
    let drifts = ends_with("[robot.errors]\ngyro_drift_dps = 3.0\n", "never", |_| ());
    assert!(drifts.to_string().contains("not ready"), "{drifts}");
    let pulled =
        ends_with("", "spin on the spot", |simulation| simulation.unplug(0, Port::In4).unwrap());
    assert!(matches!(pulled, CalibrateError::Lost { .. }), "{pulled}");
    let away = ends_with("", "before a plain wall", |simulation| {
        simulation.inspect(|world: &mut WorldPhysics| {
            world.carry(0, onbrick::sim::StartPose { x_m: 0.0, y_m: 0.0, heading_rad: PI });
        });
    });
    assert!(matches!(away, CalibrateError::NoWall(_)), "{away}");
    let flat = ends_with("[robot.errors]\nbattery_v = 5.2\n", "never", |_| ());
    assert!(flat.to_string().contains("not ready"), "{flat}");
    let unplugged = ends_with("[robot.ports]\nin4 = \"none\"\n", "never", |_| ());
    assert!(matches!(unplugged, CalibrateError::Bind(_)), "{unplugged}");
}

#[test]
fn wheels_that_are_exchanged_or_turn_the_wrong_way_are_named() {
    const LEFT: &str = "{ port = \"outB\" }";
    const RIGHT: &str = "{ port = \"outD\" }";
    let inverted = |robot: &str, wheel: &str| {
        robot.replacen(wheel, &wheel.replace(" }", ", inverted = true }"), 1)
    };
    let robot = wrong(1.0, 1.0, true).text;
    let exchanged = robot.replacen(LEFT, "-", 1).replacen(RIGHT, LEFT, 1).replacen("-", RIGHT, 1);
    let one = inverted(&robot, LEFT);
    let both = inverted(&one, RIGHT);
    for (text, straight, what) in [
        (&exchanged, Straight::Wall, "the gyro turns the other way than the wheels"),
        (&one, Straight::Wall, "the robot does not turn where it is to turn"),
        (&one, Straight::Metre, "the robot turns where it is to drive straight"),
        (&both, Straight::Wall, "the robot drives the other way than it is told"),
    ] {
        let bench = Bench::new("", 1);
        let robot = Source { name: "robot.toml".to_owned(), text: text.clone() };
        let options = CalibrateOptions { straight: Some(straight), ..Default::default() };
        let error = measure(&bench, &robot, &options).unwrap_err();
        assert!(matches!(error, CalibrateError::Exchanged(_)), "{straight:?}: {error}");
        assert!(error.to_string().starts_with(what), "{straight:?}: {error}");
    }
}

#[test]
fn a_wall_that_is_lost_on_the_way_is_no_wall_that_was_never_there() {
    let bench = Bench::new("", 1);
    let error = ends_after(&bench, bench.clock.now_ns() + 23 * SECOND_NS, |simulation, _| {
        simulation.inspect(|world: &mut WorldPhysics| {
            let away = onbrick::sim::StartPose { x_m: 0.0, y_m: 0.0, heading_rad: PI };
            world.carry(0, away);
        });
    });
    assert!(matches!(error, CalibrateError::WallLost), "{error}");
    bench.assert_still();
}

/// A robot's file without one of its sections.
fn cut(robot: &str, section: &str) -> String {
    let start = robot.find(section).unwrap();
    let length = robot[start + 1..].find("\n[").unwrap();
    [&robot[..start], &robot[start + 1 + length..]].concat()
}

#[test]
fn a_robot_without_the_sensor_is_refused_by_its_name_and_no_plug_is_blamed() {
    let no_marks = CalibrateOptions { mark: Some(false), straight: None, ..Default::default() };
    let own_echoes = CalibrateOptions { own_echoes: true, ..CalibrateOptions::NOTHING };
    for (section, options) in [("[gyro]", no_marks), ("[range]", own_echoes)] {
        let bench = Bench::new("", 1);
        let mut person = Measurer::new(&bench);
        let text = cut(DEFAULT_ROBOT, section);
        let robot = load(&Source { name: "robot.toml".to_owned(), text });
        let error =
            calibrate(&bench.tree, &*bench.clock, &bench.flags, &mut person, &robot, &options)
                .unwrap_err();
        let said = error.to_string();
        assert!(said.ends_with(&format!("the robot has no {section}")), "{said}");
        assert_eq!(person.told, ["Getting ready: leave the robot still."], "nothing was asked");
    }
}

#[test]
fn marks_that_are_no_whole_turns_are_doubted_and_nothing_is_written() {
    let calibration = Calibration { gyro_scale: Some(0.7625), ..Calibration::default() };
    let source = Source { name: "robot.toml".to_owned(), text: DEFAULT_ROBOT.to_owned() };
    let error = calibration.apply(&source).unwrap_err().to_string();
    assert!(
        error.starts_with("gyro.scale is not written: the gyro would say 274 degrees"),
        "{error}"
    );
}

#[test]
fn a_person_who_never_presses_enter_does_not_keep_the_robot_spinning() {
    let bench = Bench::new("", 1);
    let mut person = Measurer::new(&bench);
    person.asleep = true;
    let options = CalibrateOptions { straight: None, ..CalibrateOptions::default() };
    let robot = wrong(1.0, 1.0, false);
    let error = measure_with(&bench, &robot, &options, &mut person).unwrap_err();
    assert!(error.to_string().contains("Enter was not pressed"), "{error}");
    let turned = (bench.truth().heading_rad - person.marked.heading_rad).abs() / (2.0 * PI);
    assert!((2.8..3.2).contains(&turned), "{turned} turns; one and a half times two are the most");
}

/// Stops when the robot has driven for a while, as a hand on the brick or Ctrl-C would.
#[derive(Debug)]
struct StopsAt {
    clock: Arc<VirtualClock>,
    at_ns: i64,
    act: fn(&Simulation, &StopFlags),
    simulation: Simulation,
    flags: StopFlags,
    done: std::sync::atomic::AtomicBool,
}

impl Clock for StopsAt {
    fn now_ns(&self) -> i64 {
        self.clock.now_ns()
    }

    fn sleep_until_ns(&self, deadline_ns: i64) {
        self.clock.sleep_until_ns(deadline_ns);
        if self.clock.now_ns() >= self.at_ns && !self.done.swap(true, Ordering::Relaxed) {
            (self.act)(&self.simulation, &self.flags);
        }
    }
}

/// How it ends where something happens at a time.
fn ends_after(bench: &Bench, at_ns: i64, act: fn(&Simulation, &StopFlags)) -> CalibrateError {
    let clock = StopsAt {
        clock: Arc::clone(&bench.clock),
        at_ns,
        act,
        simulation: bench.simulation.clone(),
        flags: bench.flags.clone(),
        done: false.into(),
    };
    let mut person = Measurer::new(bench);
    let robot = load(&wrong(1.0, 1.0, true));
    let options = CalibrateOptions::default();
    calibrate(&bench.tree, &clock, &bench.flags, &mut person, &robot, &options).unwrap_err()
}

#[test]
fn a_button_and_a_signal_stop_it_within_a_tenth_of_a_second() {
    let acts: [fn(&Simulation, &StopFlags); 3] = [
        |simulation, _| simulation.press(0, Button::Back).unwrap(),
        |simulation, _| simulation.press(0, Button::Enter).unwrap(),
        |_, flags| flags.signal.store(true, Ordering::Relaxed),
    ];
    for act in acts {
        let bench = Bench::new("", 1);
        let at_ns = bench.clock.now_ns() + 12 * SECOND_NS;
        let error = ends_after(&bench, at_ns, act);
        let late_ns = bench.clock.now_ns() - at_ns;
        assert!(matches!(error, CalibrateError::Stopped), "{error}");
        assert!(late_ns < SECOND_NS / 10, "{late_ns} ns after it was asked to stop");
        bench.assert_still();
    }
}
