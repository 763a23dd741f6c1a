//! Any bytes as a mission file: loaded or refused; what loads can be drawn and driven, and asks for
//! nothing that is not finite.
#![no_main]

use libfuzzer_sys::fuzz_target;
use onbrick::behavior::{Demands, Drive, Mission, Signal, Signals};
use onbrick::robot::{DEFAULT_ROBOT, RobotConfig};
use onbrick::senses::Channel;

/// Some of what a mission can look at.
const SIGNALS: [Signal; 9] = [
    Signal::Sensed(Channel::Range),
    Signal::Echo,
    Signal::Heading,
    Signal::Sensed(Channel::Head),
    Signal::X,
    Signal::Travelled,
    Signal::Sensed(Channel::Left),
    Signal::Sensed(Channel::Battery),
    Signal::Y,
];

/// How a line begins that names the file of those after it.
const MARK: &[u8] = b"\n# onbrick: from ";

fuzz_target!(|bytes: &[u8]| {
    let Ok((robot, _)) = RobotConfig::load("robot.toml", DEFAULT_ROBOT.as_bytes()) else {
        unreachable!()
    };
    let mission = match Mission::parse("mission.toml", bytes, &robot.capabilities()) {
        Ok((mission, _)) => mission,
        Err(findings) => {
            let told = findings.to_string();
            // A text may say that a part of it is of another file, whose name it is then.
            let has_parts = bytes.windows(MARK.len()).any(|words| words == MARK);
            assert!(has_parts || told.contains("mission.toml"), "no place: {told}");
            return;
        }
    };
    let _ = onbrick::behavior::mermaid(&mission);
    let mut program = mission.start().expect("a mission that loads can be started");
    let mut demands = Demands::default();
    for tick in 0..50_i64 {
        let mut signals = Signals::at(tick * 20_000_000);
        for (place, signal) in SIGNALS.into_iter().enumerate() {
            // Each comes and goes, with numbers that are odd now and then.
            match (tick + i64::try_from(place).unwrap_or(0)) % 5 {
                0 => signals.set(signal, None),
                1 => signals.set(signal, f64::INFINITY),
                2 => signals.set(signal, -1e300),
                _ => signals.set(signal, tick as f64 * 0.1),
            }
        }
        program.step(&signals, &mut demands, |_| {});
        let speeds = match demands.drive {
            Some(Drive::Wheels { left_rad_s, right_rad_s }) => [left_rad_s, right_rad_s],
            Some(Drive::Twist { forward_m_s, turn_rad_s }) => [forward_m_s, turn_rad_s],
            Some(Drive::Stop(_)) | None => [0.0; 2],
        };
        assert!(speeds.iter().all(|speed| speed.is_finite()), "{demands:?}");
    }
});
