//! Promise 5: commands out of range cannot be given.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use nix::errno::Errno;
use onbrick::behavior::{Demands, Drive};
use onbrick::clock::MILLISECOND_NS;
use onbrick::ev3dev::{Access, AttributeFile, LightColour, StopAction, Tree};
use onbrick::robot::{LEASE_MS, Robot, RobotConfig};
use onbrick::senses::Channel;

use crate::support::brick::{FakeTree, rotary_tables};
use crate::support::chance::Chance;
use crate::support::is_long;
use crate::support::promised::promised;

/// What was written, and what of it should never have been.
#[derive(Debug, Default)]
struct Judge {
    /// The most that a motor's `speed_sp` may be, counts per second, by its folder.
    most: BTreeMap<String, f64>,
    written: u64,
    speeds: u64,
    fastest: BTreeMap<String, i64>,
    wrong: Vec<String>,
}

impl Judge {
    fn write(&mut self, path: &str, value: &[u8]) {
        self.written += 1;
        let text = std::str::from_utf8(value).unwrap_or("?");
        let line = text.strip_suffix('\n').unwrap_or(text);
        let (folder, name) = path.rsplit_once('/').unwrap();
        let legal = match name {
            "speed_sp" => {
                self.speeds += 1;
                let speed: Option<i64> = line.parse().ok();
                let fastest = self.fastest.entry(folder.to_owned()).or_default();
                *fastest = (*fastest).max(speed.unwrap_or(0).abs());
                speed.is_some_and(|speed| speed.abs() as f64 <= self.most[folder])
            }
            "time_sp" => line == LEASE_MS.to_string(),
            "command" => ["run-timed", "stop", "reset"].contains(&line),
            "stop_action" => ["coast", "brake", "hold"].contains(&line),
            "brightness" => line.parse::<i64>().is_ok_and(|level| (0..=255).contains(&level)),
            "trigger" => line == "none",
            _ => false,
        };
        if !legal && self.wrong.len() < 20 {
            self.wrong.push(format!("{path} = {text:?}"));
        }
    }
}

/// Files whose writes are judged.
#[derive(Debug, Clone)]
struct Judged {
    fake: Arc<dyn Tree>,
    judge: Arc<Mutex<Judge>>,
}

impl Tree for Judged {
    fn list(&self, folder: &str) -> Result<Vec<String>, Errno> {
        self.fake.list(folder)
    }

    fn open(&self, path: &str, access: Access) -> Result<Box<dyn AttributeFile>, Errno> {
        let file = self.fake.open(path, access)?;
        Ok(Box::new(JudgedFile { file, path: path.to_owned(), judge: Arc::clone(&self.judge) }))
    }

    fn root(&self) -> &Path {
        self.fake.root()
    }
}

#[derive(Debug)]
struct JudgedFile {
    file: Box<dyn AttributeFile>,
    path: String,
    judge: Arc<Mutex<Judge>>,
}

impl AttributeFile for JudgedFile {
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Errno> {
        self.file.read(buffer)
    }

    fn write(&self, value: &[u8]) -> Result<usize, Errno> {
        self.judge.lock().unwrap().write(&self.path, value);
        self.file.write(value)
    }

    fn wait_changed(&self, timeout: Duration) -> Result<bool, Errno> {
        self.file.wait_changed(timeout)
    }
}

const PORTS: [&str; 4] = ["outA", "outB", "outC", "outD"];

fn folder(port: &str) -> String {
    format!("sys/class/tacho-motor/motor{}", PORTS.iter().position(|known| *known == port).unwrap())
}

/// A motor on a port, with any gear; what its section of the file says.
fn motor(
    chance: &mut Chance,
    judge: &mut Judge,
    fake: &FakeTree,
    port: &str,
    max_dps: f64,
) -> String {
    let [mine, driven] = [1 + chance.below(1000), 1 + chance.below(1000)];
    let minus = *chance.of(&["", "-"]);
    let (driver, top) = *chance.of(&[("lego-ev3-l-motor\n", 1050), ("lego-ev3-m-motor\n", 1560)]);
    let address = format!("ev3-ports:{port}\n");
    let max_speed = format!("{top}\n");
    let texts = [
        ("address", address.as_str()),
        ("driver_name", driver),
        ("max_speed", max_speed.as_str()),
        ("count_per_rot", "360\n"),
        // Nothing updates the state here, and a motor that stands still would contradict each
        // command.
        ("state", "unknown\n"),
    ];
    fake.plug(&folder(port), &rotary_tables(), &texts);
    // A count of these motors is a degree. The nearest whole number may be half a count beyond the
    // limit.
    let counts = max_dps * driven as f64 / mine as f64;
    judge.most.insert(folder(port), counts.min(f64::from(top)) + 0.5);
    format!(
        "port = \"{port}\"|gear = [{minus}{mine}, {driven}]|inverted = {}",
        chance.below(2) == 0
    )
}

/// A robot that the file's reader takes, however odd: gears of 1 to 1000 teeth, limits from 1 to
/// 15600 degrees a second.
fn robot(chance: &mut Chance, judge: &mut Judge) -> (RobotConfig, Arc<dyn Tree>) {
    let fake = FakeTree::default();
    let [wheels, head, arm] = [(); 3].map(|()| match chance.below(4) {
        0 => 1.0,
        _ => chance.between(1.0, 15_600.0),
    });
    let mut section = |port, max_dps, between: &str| {
        motor(chance, judge, &fake, port, max_dps).replace('|', between)
    };
    let text = format!(
        "name = \"odd\"\n[drive]\nleft = {{ {} }}\nright = {{ {} }}\nwheel_circumference_m = 0.2\n\
         track_width_m = 0.1\n\
         max_dps = {wheels}\n[head]\n{}\nspeed_dps = {head}\n[motor.arm]\n{}\nmax_dps = {arm}\n",
        section("outB", wheels, ", "),
        section("outD", wheels, ", "),
        section("outA", head, "\n"),
        section("outC", arm, "\n"),
    );
    for (at, side) in ["red", "green"].into_iter().flat_map(|colour| [(0, colour), (1, colour)]) {
        let led = format!("sys/class/leds/led{at}:{side}:brick-status");
        for (name, text) in
            [("brightness", "0\n"), ("max_brightness", "255\n"), ("trigger", "[none] timer\n")]
        {
            fake.file(&led, name, onbrick::ev3dev::Direction::Readwriteable, text);
        }
    }
    let (config, _) =
        RobotConfig::load("robot.toml", text.as_bytes()).unwrap_or_else(|error| panic!("{error}"));
    (config, fake.tree())
}

/// Anything that can be demanded, and how many numbers are in it.
fn demands(chance: &mut Chance) -> (Demands, u64) {
    let (drive, count) = match chance.below(8) {
        0 => (None, 0),
        1 => (
            Some(Drive::Stop(*chance.of(&[
                StopAction::Coast,
                StopAction::Brake,
                StopAction::Hold,
            ]))),
            0,
        ),
        2..5 => (Some(Drive::Twist { forward_m_s: chance.float(), turn_rad_s: chance.float() }), 2),
        _ => (Some(Drive::Wheels { left_rad_s: chance.float(), right_rad_s: chance.float() }), 2),
    };
    let mut demands = Demands { drive, head_rad: Some(chance.float()), ..Demands::default() };
    demands.motors[0] = Some(chance.float());
    demands.tone_hz = Some(chance.float());
    demands.led = Some(*chance.of(LightColour::ALL));
    (demands, count + 3)
}

#[test]
fn promise_5_nothing_outside_the_limits_reaches_a_file() {
    let wanted = if is_long() { 20_000_000 } else { 1_000_000 };
    let (mut demanded, mut robots, mut written, mut speeds) = (0_u64, 0_u64, 0, 0);
    let mut at_the_limit = 0;
    while demanded < wanted {
        robots += 1;
        let mut chance = Chance::new(robots);
        let mut judge = Judge::default();
        let (config, fake) = robot(&mut chance, &mut judge);
        let judge = Arc::new(Mutex::new(judge));
        let tree: Arc<dyn Tree> = Arc::new(Judged { fake, judge: Arc::clone(&judge) });
        let mut robot = Robot::bind(&tree, &config, &[Channel::Head, Channel::Motor0]).unwrap();
        let mut senses = onbrick::senses::Senses::default();
        robot.sense(&mut senses);
        let mut now_ns = 0;
        for _ in 0..5_000 {
            now_ns += 20 * MILLISECOND_NS * i64::try_from(1 + chance.below(10)).unwrap();
            let (demands, count) = demands(&mut chance);
            robot.act(&demands, now_ns);
            demanded += count;
        }
        drop(robot);
        let judge = judge.lock().unwrap();
        assert!(judge.wrong.is_empty(), "robot {robots}: {config:#?} {:#?}", judge.wrong);
        written += judge.written;
        speeds += judge.speeds;
        at_the_limit += judge
            .fastest
            .iter()
            .filter(|(folder, fastest)| **fastest as f64 >= judge.most[*folder] - 1.0)
            .count();
    }
    // The judge has seen the limits themselves, so they are not merely never approached.
    assert!(
        at_the_limit > 3 * usize::try_from(robots).unwrap(),
        "{at_the_limit} motors at their limit"
    );
    promised(&format!(
        "{demanded} demands to {robots} robots, NaN and infinities among them: {written} writes, \
         {speeds} of them speeds, 0 outside the limits"
    ));
}
