//! Runs on a simulated brick: the environment in which [`execute`](crate::runtime::execute) drives
//! one.
//!
//! # Not here
//!
//! No simulation (`sim`) and no run (`runtime`): only what joins them.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::clock::{Clock, MonotonicClock, VirtualClock};
use crate::document::Document;
use crate::ev3dev::{EV3, PortAddress};
use crate::mapping::Pose;
use crate::recording::{Pace, STALL_NS};
use crate::robot::{RobotConfig, StopButton};
use crate::runtime::{Brick, Environment, Job, Refused, Source, Truth};
use crate::senses::{Channel, Mount, Role};
use crate::sim::{Observer, Port, SensorKind, Simulation, WorldPhysics};
use crate::units::wrap_rad;

/// A world whose robot is built as `robot.toml` describes it, where the world itself says nothing
/// of its robot.
#[must_use]
pub fn furnished(world: Source, robot: &RobotConfig) -> Source {
    let has_robot = Document::new(&world.name, world.text.as_bytes())
        .and_then(|document| document.read(|root| Some(root.get("robot").is_some())));
    match has_robot {
        Ok((false, _)) => Source { text: format!("{}\n{}", world.text, body(robot)), ..world },
        // What is wrong with it is told when it is read.
        Ok((true, _)) | Err(_) => world,
    }
}

/// The section `[robot]` of a world.
fn body(robot: &RobotConfig) -> String {
    // Worlds call ports as an EV3 does.
    let name = |port: &PortAddress| {
        Port::named(port.short())
            .map_or_else(|| port.short().to_owned(), |port| port.as_str().to_owned())
    };
    let [left, right] = [&robot.drive.left, &robot.drive.right];
    let mut text = format!(
        "\n# Built like the robot `{}`.\n[robot]\nwheel_circumference_m = {:?}\n\
         track_width_m = {:?}\nleft_inverted = {}\nright_inverted = {}\n",
        robot.name,
        robot.drive.wheel_circumference_m * left.ratio.abs(),
        robot.drive.track_width_m,
        left.ratio < 0.0,
        right.ratio < 0.0,
    );
    let (mut mounts, mut placed) = (String::new(), Vec::new());
    let mut ports: BTreeMap<String, &str> =
        EV3.outputs.into_iter().chain(EV3.inputs).map(|port| (port.to_owned(), "none")).collect();
    // What has no port of its own is on the first input that is free.
    let mut plug = |port: Option<&PortAddress>, what: &'static str| -> Option<String> {
        let is_free = |port: &&str| ports.get(*port) == Some(&"none");
        let free = || EV3.inputs.into_iter().find(is_free).map(str::to_owned);
        let port = port.map(name).or_else(free)?;
        ports.contains_key(&port).then(|| ports.insert(port.clone(), what))?;
        Some(port)
    };
    for (key, motor) in [("left", left), ("right", right)] {
        if let Some(port) = plug(Some(&motor.port), "large") {
            text.push_str(&format!("{key} = \"{port}\"\n"));
        }
    }
    match &robot.head {
        Some(head) => {
            if let Some(port) = plug(Some(&head.motor.port), "medium") {
                let ratio = head.motor.ratio;
                // Each number of teeth is at least 1.
                let gear = if ratio.abs() < 1.0 {
                    [ratio * 1000.0, 1000.0]
                } else {
                    [ratio.signum() * 1000.0, 1000.0 / ratio.abs()]
                };
                text.push_str(&format!("head = \"{port}\"\nhead_gear = {gear:?}\n"));
            }
        }
        None => text.push_str("head = \"none\"\n"),
    }
    if let Some(range) = &robot.range {
        text.push_str(&format!("range_ahead_m = {:?}\n", range.ahead_m));
    }
    for named in &robot.motors {
        plug(Some(&named.motor.port), "large");
    }
    for (role, port) in &robot.sensors {
        let measured = match role {
            Role::Sensor(at) => {
                robot.named_sensors.get(usize::from(*at)).map(|named| named.measures)
            }
            role => role.quantities().next().map(|quantity| quantity.channel),
        };
        let Some(measured) = measured else { continue };
        let infrared = *role == Role::Range
            && robot.range.as_ref().is_some_and(|range| range.max_m < INFRARED_M);
        let driver =
            robot.drivers.get(role).and_then(|driver| SensorKind::word_of(driver.as_str()));
        let kind = driver.unwrap_or_else(|| kind(measured, infrared));
        let mount = robot.mounts.get(role).copied().unwrap_or_default();
        if let Some((other, ..)) = placed.iter().find(|(_, placed)| *placed == (kind, mount)) {
            let (one, other) = (robot.section(*role), robot.section(*other));
            log::warn!(
                "[{one}] and [{other}] measure the same in the simulation: `at_m` and \
                 `facing_deg` in them say where each is"
            );
        }
        placed.push((*role, (kind, mount)));
        if let Some(port) = plug(port.as_ref(), kind)
            && mount != Mount::default()
        {
            mounts.push_str(&format!("[robot.sensors.{port}]\n{}", mount.to_toml()));
        }
    }
    if let Some(StopButton::Touch(port)) = &robot.stop_button {
        plug(Some(port), "touch");
    }
    text.push_str("[robot.ports]\n");
    for (port, what) in ports {
        text.push_str(&format!("{port} = \"{what}\"\n"));
    }
    text + &mounts
}

/// A range sensor without a `driver` that is to see no farther than this is the infrared one,
/// metres.
const INFRARED_M: f64 = 0.75;

/// What worlds call the sensor that measures a quantity: of a role's sensors the preferred one.
fn kind(measured: Channel, infrared: bool) -> &'static str {
    let drivers = measured.quantity().role.drivers();
    let mut words = drivers.filter_map(|driver| SensorKind::word_of(driver.as_str()));
    let is_second = infrared && measured == Channel::Range;
    if is_second { words.nth(1) } else { words.next() }.unwrap_or("none")
}

/// A simulated brick at the beginning of its time, and what sees how things truly are.
///
/// - `near`: of a world's start poses the robot stands on the nearest to this one, so that each
///   robot of a team has its own.
/// - `clock`: a virtual one makes two minutes of the world two seconds.
///
/// # Errors
///
/// The world is not in order, or has no place for a robot.
pub fn simulation(
    world: &Source,
    seed: u64,
    near: Pose,
    clock: Arc<dyn Clock>,
) -> Result<(Simulation, Observer), Refused> {
    let (parsed, _) = world.world()?;
    let scenario = parsed.scenario().clone();
    let physics = WorldPhysics::new(parsed.with_start_near(near.x_m, near.y_m), 1, seed)
        .map_err(|error| Refused::World(error.into()))?;
    let observer = physics.observer();
    let simulation = Simulation::new(clock, Box::new(physics), seed);
    simulation.play(&scenario);
    Ok((simulation, observer))
}

/// Where a job on a simulated brick is done.
#[derive(Debug)]
pub struct Simulated {
    /// What [`execute`](crate::runtime::execute) is handed.
    pub environment: Environment,
    /// The brick and its world.
    pub simulation: Simulation,
    /// Sees how things truly are.
    pub observer: Observer,
}

/// Where a job is done whose brick is a simulated one.
///
/// # Errors
///
/// As [`simulation`]; [`Refused::NoSimulation`] where the job's brick is none.
pub fn simulated(job: &Job) -> Result<Simulated, Refused> {
    let realtime = matches!(job.brick, Brick::Simulated { realtime: true, .. });
    let clock: Arc<dyn Clock> =
        if realtime { Arc::new(MonotonicClock) } else { Arc::new(VirtualClock::default()) };
    let mut simulated = simulated_at(job, clock)?;
    if realtime {
        // A tick that is so late ends the run.
        simulated.simulation.give_up_behind_ns(STALL_NS);
        simulated.environment.pace = Pace::Real;
        simulated.environment.wall_offset_ns = None;
    }
    Ok(simulated)
}

/// As [`simulated`], in a virtual time of the caller's: with the same stamps two runs give the same
/// bytes, whatever the pace at which that time passes.
///
/// # Errors
///
/// As [`simulated`].
pub fn simulated_at(job: &Job, clock: Arc<dyn Clock>) -> Result<Simulated, Refused> {
    let Brick::Simulated { world, seed, .. } = &job.brick else {
        return Err(Refused::NoSimulation);
    };
    let (simulation, observer) = simulation(world, *seed, job.start, Arc::clone(&clock))?;
    let seen = observer.clone();
    let environment = Environment {
        pace: Pace::Virtual,
        wall_offset_ns: Some(job.stamps_ns),
        seed: Some(*seed),
        world_toml: Some(world.text.clone()),
        truth: Some(Arc::new(move || truth(&seen))),
        ..Environment::new(simulation.brick(0), clock)
    };
    Ok(Simulated { environment, simulation, observer })
}

/// Where the robot really is.
fn truth(observer: &Observer) -> Option<Truth> {
    let truth = observer.truth(0)?;
    let heading_rad = wrap_rad(truth.heading_rad);
    let pose = Pose { x_m: truth.x_m, y_m: truth.y_m, heading_rad };
    Some(Truth { pose, fallen: truth.fallen })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::{MILLISECOND_NS, SECOND_NS};
    use crate::robot::{DEFAULT_ROBOT, ROBOTS};
    use crate::sim::World;

    fn job(realtime: bool) -> Job {
        let source =
            |name: &str, text: &str| Source { name: name.to_owned(), text: text.to_owned() };
        let world = source("arena", World::text("arena").unwrap());
        let brick = Brick::Simulated { world, seed: 1, realtime };
        let (mission, robot) = (source("mission.toml", ""), source("robot.toml", ""));
        Job::new(mission, robot, brick, "run.mcap".into())
    }

    /// The time that a simulated brick has given up for lost, `pause_ns` after it was made.
    fn lost_ns(realtime: bool, pause_ns: i64) -> i64 {
        let job = job(realtime);
        let Simulated { environment, simulation, .. } = simulated(&job).unwrap();
        environment.clock.sleep_ns(pause_ns);
        simulation.catch_up();
        simulation.lost_ns()
    }

    fn bodied(text: &str, robot: &str) -> crate::sim::RobotModel {
        let (config, _) = RobotConfig::load("robot.toml", robot.as_bytes()).unwrap();
        let world = Source { name: "w.toml".to_owned(), text: text.to_owned() };
        let world = furnished(world, &config);
        let (parsed, findings) = World::parse(&world.name, world.text.as_bytes())
            .unwrap_or_else(|findings| panic!("{findings}"));
        assert!(findings.is_empty(), "{findings}");
        parsed.robot().clone()
    }

    #[test]
    fn a_simulated_robot_is_built_as_its_file_says_and_as_its_world_says_before_that() {
        let seed = crate::sim::RobotModel::default();
        assert_eq!(bodied("name = \"w\"", DEFAULT_ROBOT), seed);
        let own = bodied("name = \"w\"\n[robot]\nfront_m = 0.12\n", ROBOTS[1].text);
        assert_eq!(own, crate::sim::RobotModel { front_m: 0.12, ..seed.clone() });
        let educator = bodied("name = \"w\"", ROBOTS[1].text);
        assert_eq!((educator.drive, educator.head, educator.track_width_m), ([1, 2], None, 0.104));
        let geared = DEFAULT_ROBOT
            .replace("{ port = \"outB\" }", "{ port = \"outC\", gear = [-12, 24] }")
            .replace("[touch] ", "[sensor.eye]\nmeasures = \"ambient_pct\"\n\n[touch] ");
        let geared = bodied("name = \"w\"", &geared);
        assert_eq!((geared.drive, geared.drive_inverted), ([2, 3], [true, false]));
        assert!((geared.wheel_circumference_m - 0.094_488).abs() < 1e-9);
        // Which of the two range sensors it is says the driver, and else how far it sees; of one
        // with a name, the driver alone.
        let range_of = |from: &str, to: &str| {
            let eye = "[sensor.eye]\nmeasures = \"range_m\"\n# ";
            let text = DEFAULT_ROBOT.replace("[touch] ", eye).replacen(from, to, 1);
            let sensors = bodied("name = \"w\"", &text).plug.sensors;
            [sensors[0], sensors[1]]
        };
        use crate::sim::SensorKind::{Infrared, Ultrasonic};
        let far = "max_m = 2.0";
        assert_eq!(range_of(far, far), [Some(Ultrasonic); 2]);
        let [range, eye] = [Some(Infrared), Some(Ultrasonic)];
        assert_eq!(range_of(far, "max_m = 0.6"), [range, eye]);
        let driven = format!("{far}\ndriver = \"lego-ev3-ir\"");
        assert_eq!(range_of(far, &driven), [range, eye]);
    }

    #[test]
    fn the_true_heading_is_wrapped_as_all_that_is_recorded() {
        let mut job = job(false);
        let text = "name = \"w\"\n[[start]]\nat = [0, 0]\nheading_deg = 270\n".to_owned();
        let world = Source { name: "w.toml".to_owned(), text };
        job.brick = Brick::Simulated { world, seed: 1, realtime: false };
        let Simulated { environment, .. } = simulated(&job).unwrap();
        let heading_rad = environment.truth.unwrap()().unwrap().pose.heading_rad;
        assert!((heading_rad + std::f64::consts::FRAC_PI_2).abs() < 1e-9, "{heading_rad} rad");
    }

    #[test]
    fn a_simulation_in_real_time_gives_up_what_it_is_far_behind_and_one_in_virtual_time_nothing() {
        assert_eq!(lost_ns(false, 10 * SECOND_NS), 0);
        assert!(lost_ns(true, STALL_NS + 100 * MILLISECOND_NS) >= 100 * MILLISECOND_NS);
    }
}
