//! What holds of the mapper for any inputs: from any start, in any steps, and for numbers that are
//! none.

use onbrick::mapping::{
    Estimate, Estimator, EstimatorConfig, EstimatorState, GyroReading, Inputs, Map, Method, Pose,
    RangeMount, RangeReading,
};
use proptest::prelude::*;

use super::{BOTH, Robot, config, drive};

fn pose() -> impl Strategy<Value = Pose> {
    (-3.0..3.0, -3.0..3.0, -7.0..7.0).prop_map(|(x_m, y_m, heading_rad)| Pose {
        x_m,
        y_m,
        heading_rad,
    })
}

/// Steps of at most what a robot can do in a tick: metres and radians.
fn steps() -> impl Strategy<Value = Vec<(f64, f64, f64)>> {
    prop::collection::vec((-0.004..0.004, -0.03..0.03, 0.03..2.5), 1..150)
}

fn run(config: EstimatorConfig, start: Pose, steps: &[(f64, f64, f64)]) -> (Estimate, Map) {
    let mut robot = Robot::new(true);
    let mut estimator = Estimator::new(config, start);
    let mut map = Map::new(config.geometry.range(), &start);
    let mut last = estimator.update(&robot.inputs());
    for &(forward_m, turn_rad, range_m) in steps {
        robot.move_by(forward_m, turn_rad);
        robot.see(range_m);
        last = estimator.update(&robot.inputs());
        map.add(&last);
    }
    (last, map)
}

/// Any number at all, with those that are not numbers.
fn any_reading() -> impl Strategy<Value = Option<f64>> {
    prop_oneof![
        Just(None),
        any::<f64>().prop_map(Some),
        (-10.0..10.0).prop_map(Some),
        Just(Some(f64::NAN)),
        Just(Some(f64::INFINITY)),
        Just(Some(f64::NEG_INFINITY)),
    ]
}

fn any_inputs() -> impl Strategy<Value = Inputs> {
    let times = prop_oneof![any::<i64>(), 0..10_000_000_000_i64];
    (
        times.clone(),
        times,
        any_reading(),
        any_reading(),
        any_reading(),
        any_reading(),
        any_reading(),
    )
        .prop_map(|(time_ns, changed_ns, left_rad, right_rad, gyro, head_rad, range)| Inputs {
            time_ns,
            left_rad,
            right_rad,
            gyro: gyro.map(|value_rad| GyroReading { value_rad, changed_ns }),
            head_rad,
            range: range.map(|value_m| RangeReading { value_m, changed_ns }),
        })
}

proptest! {
    #[test]
    fn turning_and_moving_the_start_turns_and_moves_everything(start in pose(), steps in steps()) {
        for method in BOTH {
            let (at_origin, map_at_origin) = run(config(method), Pose::default(), &steps);
            let (moved, map_moved) = run(config(method), start, &steps);
            let expected = start.then(&at_origin.pose);
            prop_assert!((moved.pose.x_m - expected.x_m).abs() < 1e-9, "{moved:?} {expected:?}");
            prop_assert!((moved.pose.y_m - expected.y_m).abs() < 1e-9, "{moved:?} {expected:?}");
            prop_assert!((moved.pose.heading_rad - expected.heading_rad).abs() < 1e-9);
            prop_assert_eq!(map_at_origin.points().len(), map_moved.points().len());
            for (point, there) in map_at_origin.points().iter().zip(map_moved.points()) {
                let [x_m, y_m] = start.place(point.x_m, point.y_m);
                prop_assert!(
                    (x_m - there.x_m).abs() < 1e-8 && (y_m - there.y_m).abs() < 1e-8,
                    "{point:?} {there:?}"
                );
            }
        }
    }

    #[test]
    fn an_arc_in_more_and_smaller_steps_ends_at_the_same_place(
        forward in -0.5..0.5,
        turn in -3.0..3.0,
        parts in 2_u32..6,
    ) {
        let end = |ticks| {
            let mut estimator = Estimator::new(config(Method::Default), Pose::default());
            drive(&mut Robot::new(false), &mut estimator, ticks, forward, turn).pose
        };
        let (coarse, fine) = (end(100), end(100 * parts));
        prop_assert!((coarse.x_m - fine.x_m).abs() < 1e-4, "{coarse:?} {fine:?}");
        prop_assert!((coarse.y_m - fine.y_m).abs() < 1e-4, "{coarse:?} {fine:?}");
    }

    #[test]
    fn going_on_from_a_recorded_state_gives_the_same_bits(
        steps in prop::collection::vec(any_inputs(), 2..60), cut in 0_usize..60,
        seed in any::<bool>()
    ) {
        let config = config(if seed { Method::Seed } else { Method::Default });
        let mut whole = Estimator::new(config, Pose::default());
        let mut parted = Estimator::new(config, Pose::default());
        for (index, inputs) in steps.iter().enumerate() {
            if index == cut % steps.len() {
                let state: EstimatorState = whole.state();
                parted = Estimator::new(config, Pose { x_m: 9.0, ..Pose::default() });
                parted.restore(state);
            }
            let (one, other) = (whole.update(inputs), parted.update(inputs));
            if index >= cut % steps.len() {
                prop_assert_eq!(format!("{one:?}"), format!("{other:?}"));
            }
        }
    }

    #[test]
    fn no_input_at_all_poisons_the_pose(
        steps in prop::collection::vec(any_inputs(), 1..80),
        start in any::<(f64, f64, f64)>(),
    ) {
        let start = Pose { x_m: start.0, y_m: start.1, heading_rad: start.2 };
        for method in BOTH {
            let mut estimator = Estimator::new(config(method), Pose::default());
            let mut anywhere = Estimator::new(config(method), start);
            let mut map = Map::new(&RangeMount::default(), &start);
            for inputs in &steps {
                let estimate = estimator.update(inputs);
                prop_assert!(estimate.pose.is_finite(), "{estimate:?}");
                prop_assert!(
                    estimate.covariance.iter().all(|number| number.is_finite()),
                    "{estimate:?}"
                );
                prop_assert!(
                    estimate.forward_m_s.is_finite() && estimate.turn_rad_s.is_finite(),
                    "{estimate:?}"
                );
                prop_assert!(estimate.travelled_m.is_finite());
                map.add(&anywhere.update(inputs));
            }
            let mut points = map.points().iter();
            prop_assert!(points.all(|point| point.x_m.is_finite() && point.y_m.is_finite()));
        }
    }
}
