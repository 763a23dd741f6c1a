//! Which sensor has which role: mostly its kind says it.

use crate::commissioning::{Dialogue, NoAnswer};
use crate::ev3dev::Identity;

use super::{Draft, DraftRange};

/// Gives each sensor the role of its kind; asks only where there is a choice.
pub(super) fn assign(
    dialogue: &mut dyn Dialogue,
    sensors: &[Identity],
    draft: &mut Draft,
) -> Result<(), NoAnswer> {
    let mut port = |driver: &str, role: &str| one_of(dialogue, sensors, driver, role);
    let ultrasonic = port("lego-ev3-us", "measures the range")?;
    draft.gyro = port("lego-ev3-gyro", "measures the heading")?;
    draft.touch = port("lego-ev3-touch", "is the bumper")?;
    draft.colour = port("lego-ev3-color", "looks at the floor")?;
    let infrared = port("lego-ev3-ir", "is used")?;
    draft.range = ultrasonic.map(|port| DraftRange { port, ..DraftRange::default() });
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
    driver: &str,
    role: &str,
) -> Result<Option<String>, NoAnswer> {
    let ports: Vec<&str> = sensors
        .iter()
        .filter(|identity| identity.driver.as_str() == driver)
        .map(|identity| identity.address.short())
        .collect();
    let chosen = match ports.len() {
        0 | 1 => 0,
        _ => dialogue.choose(&format!("There are several {driver}. Which one {role}?"), &ports, 0)?,
    };
    Ok(ports.get(chosen).map(|port| (*port).to_owned()))
}

/// The infrared sensor does one thing at a time: it measures the range, or it listens to the remote.
fn infrared_role(dialogue: &mut dyn Dialogue, port: String, draft: &mut Draft) -> Result<(), NoAnswer> {
    let uses = ["the remote control", "the range (coarser than with the ultrasonic sensor)", "nothing"];
    let default = usize::from(draft.range.is_none());
    let question = format!("What is the infrared sensor on {port} for?");
    match dialogue.choose(&question, &uses, default)? {
        0 => draft.remote = Some(port),
        1 => draft.range = Some(DraftRange { port, max_m: 0.7, ..DraftRange::default() }),
        _ => {}
    }
    Ok(())
}

fn tell(dialogue: &mut dyn Dialogue, sensors: &[Identity], draft: &Draft) {
    let roles = [
        ("range", draft.range.as_ref().map(|range| range.port.as_str())),
        ("gyro", draft.gyro.as_deref()),
        ("touch", draft.touch.as_deref()),
        ("colour", draft.colour.as_deref()),
        ("remote", draft.remote.as_deref()),
    ];
    for (role, port) in roles {
        if let Some(port) = port {
            dialogue.say(&format!("{role}: the sensor on {port}"));
        }
    }
    for identity in sensors {
        let port = identity.address.short();
        if !roles.iter().any(|(_, used)| *used == Some(port)) {
            dialogue.say(&format!("The {} on {port} has no role; missions cannot see it.", identity.driver));
        }
    }
}
