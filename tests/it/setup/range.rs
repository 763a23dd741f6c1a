//! `calibrate --only range` and `--only own-echoes`: what the sensor reads too far, and where it
//! hears the robot.

use super::calibrate::{Measurer, measure_with};
use super::*;
use onbrick::commissioning::{ApplyError, CalibrateError, CalibrateOptions};
use onbrick::sim::StartPose;

const RANGE: CalibrateOptions = CalibrateOptions { range: true, ..CalibrateOptions::NOTHING };
const OWN: CalibrateOptions = CalibrateOptions { own_echoes: true, ..CalibrateOptions::NOTHING };

fn shipped() -> Source {
    Source { name: "robot.toml".to_owned(), text: DEFAULT_ROBOT.to_owned() }
}

#[test]
fn bias_and_scale_come_out_near_the_true_ones_in_every_echo_model() {
    for (echo, bias_m, scale) in
        [("lobe", -0.014, 0.0), ("lobe", 0.03, 0.02), ("lobe", -0.05, -0.03), ("cone", 0.002, 0.01)]
    {
        for seed in crate::support::seeds(3) {
            let robot = format!(
                "[robot]\necho = \"{echo}\"\n[robot.errors]\nrange_bias_m = {bias_m}\n\
                 range_scale = {scale}\nrange_walls_sd_db = 0.0\n"
            );
            let bench = Bench::new(&robot, seed);
            let mut person = Measurer::new(&bench);
            let calibration = measure_with(&bench, &shipped(), &RANGE, &mut person).unwrap();
            let text = calibration.apply(&shipped()).unwrap_or_else(|error| panic!("{error}"));
            let range = load(&Source { name: "robot.toml".to_owned(), text }).range.unwrap();
            println!(
                "{echo}, seed {seed}: bias {:.4} m, truly {bias_m}; scale {:.4}, truly {:.4}",
                range.bias_m,
                range.scale,
                1.0 + scale
            );
            // The ruler is two wheels, whose size is known to 0.2 %.
            assert!((range.scale - 1.0 - scale).abs() < 0.01, "scale {}", range.scale);
            assert!((range.bias_m - bias_m).abs() < 0.006, "bias {} m", range.bias_m);
        }
    }
}

#[test]
fn a_tape_that_is_read_from_the_bumper_is_noticed_and_nothing_is_written() {
    let bench = Bench::new("", 1);
    let mut person = Measurer::new(&bench);
    person.tape_errors_m = vec![0.25];
    let calibration = measure_with(&bench, &shipped(), &RANGE, &mut person).unwrap();
    let error = calibration.apply(&shipped()).unwrap_err();
    assert!(matches!(error, ApplyError::Unsure { key: "range.bias_m", .. }), "{error}");
    assert!(error.to_string().contains("from the middle between the wheels"), "{error}");
}

#[test]
fn a_wall_that_is_heard_at_random_is_not_enough() {
    let bench = Bench::new("[robot.errors]\nrange_sd_m = 0.08\nrange_walls_sd_db = 0.0\n", 2);
    let mut person = Measurer::new(&bench);
    let refused = match measure_with(&bench, &shipped(), &RANGE, &mut person) {
        Ok(calibration) => calibration.apply(&shipped()).map_err(|error| error.to_string()),
        Err(error) => Err(error.to_string()),
    };
    assert!(refused.is_err(), "{refused:?}");
}

/// Without anything near, the head's sweeps tell what is the robot's.
#[test]
fn own_echoes_are_found_at_standstill_and_left_out_of_the_map() {
    let own = "[robot]\nown_echoes = [[-62, -48, 0.2], [70, 90, 0.215]]\n";
    for (robot, places) in [(own, 2), ("", 0)] {
        let bench = Bench::new(robot, 3);
        make_room(&bench);
        let mut person = Measurer::new(&bench);
        let calibration = measure_with(&bench, &shipped(), &OWN, &mut person).unwrap();
        let found = calibration.own_echoes.clone().unwrap();
        assert_eq!(found.len(), places, "{found:?}");
        let text = calibration.apply(&shipped()).unwrap();
        let echoes =
            load(&Source { name: "robot.toml".to_owned(), text }).range.unwrap().own_echoes;
        for (deg, range_m, is_own) in
            [(-55.0, 0.186, true), (80.0, 0.201, true), (0.0, 0.2, false), (-55.0, 0.4, false)]
        {
            let rad = onbrick::units::radians(deg);
            assert_eq!(echoes.has(rad, range_m), is_own && places > 0, "{deg} degrees: {found:?}");
        }
    }
}

#[test]
fn own_echoes_are_not_looked_for_between_walls_or_without_a_head() {
    let near = "[[wall]]\npoints = [[-0.24, -0.25], [0.25, -0.25], [0.25, 0.25], [-0.24, 0.25]]\n\
                closed = true\n[robot.errors]\nrange_walls_sd_db = 0.0\nrange_late_m = 0.0\n";
    let bench = Bench::new(near, 1);
    let error = measure_with(&bench, &shipped(), &OWN, &mut Measurer::new(&bench)).unwrap_err();
    assert!(matches!(error, CalibrateError::NoRoom { .. }), "{error}");
    let bench = Bench::new("", 1);
    let text = DEFAULT_ROBOT.replacen("[head]\n", "[motor.neck]\n", 1);
    let text = text.replacen("speed_dps = 43.3\n", "", 1);
    let headless: String = text
        .lines()
        .filter(|line| !line.starts_with("limit_deg"))
        .flat_map(|l| [l, "\n"])
        .collect();
    let robot = Source { name: "robot.toml".to_owned(), text: headless };
    let error = measure_with(&bench, &robot, &OWN, &mut Measurer::new(&bench)).unwrap_err();
    assert!(matches!(error, CalibrateError::NoHead), "{error}");
}

/// Room all round.
fn make_room(bench: &Bench) {
    bench.simulation.inspect(|world: &mut WorldPhysics| {
        world.carry(0, StartPose { x_m: -1.0, y_m: 0.0, heading_rad: 0.0 });
    });
}
