//! Every message of setting a robot up, printed for a person to read (`--nocapture`), and held to
//! the house's style.

use std::error::Error;

use onbrick::commissioning::{ApplyError, CalibrateError, Doubt, EditError, NoAnswer, SetupError};
use onbrick::document::save::SaveError;
use onbrick::runtime::NotReady;
use onbrick::senses::Channel;

#[test]
fn every_message_says_what_is_wrong_in_one_style() {
    let doubts = [
        Doubt::TooFew(2),
        Doubt::Scatter(0.023),
        Doubt::Directions(0.051),
        Doubt::Far(3.2),
        Doubt::Marks(0.76),
    ];
    let mut messages: Vec<Box<dyn Error>> = vec![
        Box::new(NoAnswer::Closed),
        Box::new(NoAnswer::Stopped),
        Box::new(NoAnswer::Declined),
        Box::new(NoAnswer::Unclear),
        Box::new(SetupError::TooFewMotors { found: "one is" }),
        Box::new(SetupError::NoWheel("left")),
        Box::new(SetupError::Stopped),
        Box::new(CalibrateError::NotReady(NotReady::Battery {
            volts: 5.1,
            least_v: 5.5,
            most_v: 10.0,
        })),
        Box::new(CalibrateError::Stopped),
        Box::new(CalibrateError::Lost { channel: Channel::Gyro, trouble: "no reading".to_owned() }),
        Box::new(CalibrateError::Blocked),
        Box::new(CalibrateError::WallLost),
        Box::new(CalibrateError::NoGyro),
        Box::new(CalibrateError::NoRange),
        Box::new(EditError::Missing {
            file: "robot.toml".to_owned(),
            key: "drive.track_width_m".to_owned(),
        }),
        Box::new(SaveError::Exists("robot.toml".into())),
        Box::new(SaveError::Io {
            path: "robot.toml".into(),
            source: std::io::ErrorKind::StorageFull.into(),
        }),
    ];
    for doubt in doubts {
        messages.push(Box::new(ApplyError::Unsure { key: "drive.track_width_m", doubt }));
    }
    for message in messages {
        let text = message.to_string();
        println!(
            "{text}{}",
            message.source().map(|cause| format!(": {cause}")).unwrap_or_default()
        );
        assert!(!text.ends_with('.'), "a full stop: {text}");
        assert!(text.starts_with(|first: char| !first.is_uppercase()), "a capital: {text}");
        assert!(text.len() < 200, "{} bytes are too many for a screen: {text}", text.len());
        let cause = message.source().map(ToString::to_string).unwrap_or_default();
        assert!(cause.is_empty() || !text.contains(&cause), "the cause comes twice: {text}");
    }
}
