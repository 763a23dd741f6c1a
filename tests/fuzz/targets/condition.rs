//! Any text as a condition and as a number in `do`: read or refused; what is read gives the same
//! again and never panics.
#![no_main]

use libfuzzer_sys::fuzz_target;
use onbrick::behavior::Mission;
use onbrick::robot::{DEFAULT_ROBOT, RobotConfig};

fuzz_target!(|text: &str| {
    let Ok((robot, _)) = RobotConfig::load("robot.toml", DEFAULT_ROBOT.as_bytes()) else {
        unreachable!()
    };
    // As a person writes it: an expression in quotes, inside a mission.
    let escaped: String =
        text.chars().map(|letter| format!("\\U{:08X}", u32::from(letter))).collect();
    let mission = format!(
        "name = \"f\"\ntime_limit_s = 9\nnear_m = 0.3\n[machine.drive]\nstart = \"on\"\n\
         final = \"halt\"\n[machine.drive.state.on]\n\
         do = {{ left_dps = \"{escaped}\", right_dps = 60 }}\n\
         next = [{{ when = \"{escaped}\", go = \"halt\" }}, {{ when = \"time_s > 5\", go = \
         \"halt\" }}]\n\
         [machine.drive.state.halt]\n"
    );
    let read = Mission::parse("mission.toml", mission.as_bytes(), &robot.capabilities());
    let again = Mission::parse("mission.toml", mission.as_bytes(), &robot.capabilities());
    match (read, again) {
        (Ok(_), Ok(_)) => {}
        (Err(one), Err(other)) => assert_eq!(one.to_string(), other.to_string()),
        _ => panic!("once read and once refused"),
    }
});
