//! Which sensor has which role: mostly its kind says it.

use std::sync::Arc;

use crate::clock::Clock;
use crate::commissioning::{Dialogue, NoAnswer};
use crate::ev3dev::{Class, Driver, Identity, Platform, Tree, devices};
use crate::robot::equip_port;
use crate::senses::Role;

use super::{Draft, SetupError};

/// Asks what is on each input port of a board that does not find out, and tells the ports.
pub(super) fn declare(
    tree: &Arc<dyn Tree>,
    platform: &Platform,
    clock: &dyn Clock,
    dialogue: &mut dyn Dialogue,
) -> Result<(), SetupError> {
    dialogue.say(&format!("A {} does not find out which sensors are plugged in.", platform.what));
    let drivers =
        [Driver::Touch, Driver::Colour, Driver::Ultrasonic, Driver::Gyro, Driver::Infrared];
    let mut words = vec!["nothing"];
    words.extend(drivers.map(Driver::what));
    for name in platform.inputs {
        let Ok(port) = format!("{}:{name}", platform.parent).parse() else { continue };
        let default = devices(tree, Class::LegoSensor)?
            .iter()
            .filter(|sensor| sensor.address == port)
            .find_map(|sensor| drivers.into_iter().position(|it| sensor.known_driver() == Some(it)))
            .map_or(0, |place| place + 1);
        let answer = dialogue.choose(&format!("What is plugged into {name}?"), &words, default)?;
        if let Some(driver) = answer.checked_sub(1).and_then(|place| drivers.get(place)) {
            equip_port(tree, &port, *driver, clock)?;
        }
    }
    Ok(())
}

/// Offers a touch sensor as stop button, where the board has none; it is no bumper then.
pub(super) fn stop_button(
    dialogue: &mut dyn Dialogue,
    platform: &Platform,
    draft: &mut Draft,
) -> Result<(), NoAnswer> {
    let Some(port) = draft.sensors.get(&Role::Touch).cloned() else {
        dialogue.say(&format!(
            "A {} has no buttons, and a run needs one: a touch sensor as [stop_button] of \
             robot.toml, or --no-button each time.",
            platform.what
        ));
        return Ok(());
    };
    let question = format!(
        "A {} has no buttons. Does the touch sensor on {port} stop the robot, instead of being its \
         bumper?",
        platform.what
    );
    if dialogue.confirm(&question)? {
        draft.sensors.remove(&Role::Touch);
        draft.stop_button = Some(port);
    }
    Ok(())
}

/// Gives each sensor the role of its kind; asks only where there is a choice.
pub(super) fn assign(
    dialogue: &mut dyn Dialogue,
    sensors: &[Identity],
    draft: &mut Draft,
) -> Result<(), NoAnswer> {
    let mut port = |driver: Driver, role: &str| one_of(dialogue, sensors, driver, role);
    for role in Role::SENSORS {
        // The infrared sensor can have two roles: a question of its own.
        if let Some(driver) = role.drivers().next().filter(|driver| *driver != Driver::Infrared) {
            draft.sensors.extend(port(driver, role.purpose())?.map(|port| (role, port)));
        }
    }
    let infrared = port(Driver::Infrared, "is used")?;
    if let Some(port) = infrared {
        infrared_role(dialogue, port, draft)?;
    }
    tell(dialogue, sensors, draft);
    Ok(())
}

/// The port of the one sensor of a kind; the person says which where there are several.
fn one_of(
    dialogue: &mut dyn Dialogue,
    sensors: &[Identity],
    driver: Driver,
    role: &str,
) -> Result<Option<String>, NoAnswer> {
    let ports: Vec<&str> = sensors
        .iter()
        .filter(|identity| identity.known_driver() == Some(driver))
        .map(|identity| identity.address.short())
        .collect();
    let chosen = match ports.len() {
        0 | 1 => 0,
        _ => {
            dialogue.choose(&format!("There are several {driver}. Which one {role}?"), &ports, 0)?
        }
    };
    Ok(ports.get(chosen).map(|port| (*port).to_owned()))
}

/// The infrared sensor does one thing at a time: it measures the range, or it listens to the
/// remote.
fn infrared_role(
    dialogue: &mut dyn Dialogue,
    port: String,
    draft: &mut Draft,
) -> Result<(), NoAnswer> {
    let uses =
        ["the remote control", "the range (coarser than with the ultrasonic sensor)", "nothing"];
    let default = usize::from(!draft.sensors.contains_key(&Role::Range));
    let question = format!("What is the infrared sensor on {port} for?");
    match dialogue.choose(&question, &uses, default)? {
        0 => {
            draft.sensors.insert(Role::Remote, port);
        }
        1 => {
            draft.sensors.insert(Role::Range, port);
            draft.range_driver = Some(Driver::Infrared);
            draft.range_max_m = 0.7;
            draft.range_half_cone_deg = 6.0;
        }
        _ => {}
    }
    Ok(())
}

fn tell(dialogue: &mut dyn Dialogue, sensors: &[Identity], draft: &Draft) {
    for (role, port) in &draft.sensors {
        dialogue.say(&format!("{}: the sensor on {port}", role.section()));
    }
    for identity in sensors {
        let port = identity.address.short();
        if !draft.sensors.values().any(|used| used == port) {
            dialogue.say(&format!(
                "The {} on {port} has no role; missions cannot see it.",
                identity.driver
            ));
        }
    }
}
