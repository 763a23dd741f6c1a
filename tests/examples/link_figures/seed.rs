//! The seed's way, beside which ours is measured: the loop is on the PC, and every attribute is
//! read and written by a request over the network.
//!
//! Server and messages are the seed's: those of `onbrick sim --node`. So is the robot: its devices,
//! its speeds, its two machines, and what it reads and writes in a turn. One thing is not: it makes
//! at most fifty turns a second, as many as our tick, because on a cable without delay it would
//! take a whole processor for thousands.

use std::time::{Duration, Instant};

use onbrick::link::Node;
use onbrick::mapping::Pose;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// The shortest turn.
const TURN: Duration = Duration::from_millis(20);

/// Metres of a wheel's way for one count of its motor, of which 360 are a revolution.
const METRES_PER_COUNT: f64 = 0.188_976 / 360.0;

/// So far apart may two poses of the path be without a hole between them, metres: the robot drives
/// 3 cm a second.
const HOLE_M: f64 = 0.02;

/// Serves the files below a brick's root.
pub(crate) fn serve(brick: &str, address: &str) -> Outcome<()> {
    let _node = Node::serve(brick.as_ref(), address)?;
    println!("listening");
    loop {
        std::thread::park();
    }
}

/// The way to a brick.
struct Remote {
    socket: zmq::Socket,
    until: Instant,
}

/// Why the drive is over.
#[derive(Debug)]
enum Over {
    /// The time was over before an answer came.
    Time,
    /// The brick cannot do it.
    Refused(String),
}

impl From<zmq::Error> for Over {
    fn from(error: zmq::Error) -> Self {
        if error == zmq::Error::EAGAIN { Self::Time } else { Self::Refused(error.to_string()) }
    }
}

impl Remote {
    fn ask(&self, request: &str) -> Result<String, Over> {
        let left = self.until.saturating_duration_since(Instant::now()).as_millis();
        let left = i32::try_from(left).ok().filter(|left| *left > 0).ok_or(Over::Time)?;
        self.socket.set_sndtimeo(left)?;
        self.socket.set_rcvtimeo(left)?;
        self.socket.send(request, 0)?;
        let answer = String::from_utf8_lossy(&self.socket.recv_bytes(0)?).into_owned();
        if answer == "error" { Err(Over::Refused(request.to_owned())) } else { Ok(answer) }
    }

    fn read(&self, path: &str) -> Result<f64, Over> {
        let text = self.ask(&format!("r:{path}"))?;
        text.parse().map_err(|_| Over::Refused(format!("{path}: {text}")))
    }

    fn write(&self, path: &str, value: &str) -> Result<(), Over> {
        self.ask(&format!("w:{value}:{path}")).map(drop)
    }

    /// The folder of the device at a port.
    fn find(&self, class: &str, port: &str) -> Result<String, Over> {
        let class = format!("sys/class/{class}");
        for name in self.ask(&format!("l:{class}"))?.split(' ') {
            let folder = format!("{class}/{name}");
            if self.ask(&format!("r:{folder}/address"))?.ends_with(port) {
                return Ok(folder);
            }
        }
        Err(Over::Refused(format!("nothing at {port}")))
    }
}

/// Drives for so long, and says how that went.
pub(crate) fn drive(address: &str, seconds: f64) -> Outcome<()> {
    let context = zmq::Context::new();
    let socket = context.socket(zmq::REQ)?;
    socket.set_linger(0)?;
    socket.connect(&format!("tcp://{address}"))?;
    let begun = Instant::now();
    let remote = Remote { socket, until: begun + Duration::from_secs_f64(seconds) };
    let mut told = Told::default();
    match told.whole_drive(remote) {
        Over::Time => told.look_back(),
        Over::Refused(why) => return Err(why.into()),
    }
    println!("{}", told.line(begun.elapsed().as_secs_f64()));
    Ok(())
}

/// The seed's mapping robot.
struct Robot {
    remote: Remote,
    left: String,
    right: String,
    head: String,
    range: String,
    gyro: String,
    is_turning: bool,
    looks_left: bool,
    pose: Pose,
    driven_m: f64,
}

impl Robot {
    fn find(remote: Remote) -> Result<Self, Over> {
        let (motor, sensor) = ("tacho-motor", "lego-sensor");
        let mut robot = Self {
            left: remote.find(motor, "outB")?,
            right: remote.find(motor, "outD")?,
            head: remote.find(motor, "outA")?,
            range: remote.find(sensor, "in1")?,
            gyro: remote.find(sensor, "in4")?,
            is_turning: false,
            looks_left: false,
            pose: Pose::default(),
            driven_m: 0.0,
            remote,
        };
        robot.remote.write(&format!("{}/mode", robot.range), "US-DIST-CM")?;
        robot.remote.write(&format!("{}/mode", robot.gyro), "GYRO-ANG")?;
        robot.remote.write(&format!("{}/speed_sp", robot.head), "130")?;
        for motor in [&robot.left, &robot.right, &robot.head] {
            robot.remote.write(&format!("{motor}/command"), "stop")?;
            robot.remote.write(&format!("{motor}/position"), "0")?;
        }
        robot.pose.heading_rad =
            -robot.remote.read(&format!("{}/value0", robot.gyro))?.to_radians();
        Ok(robot)
    }

    /// One turn of the loop: read, update the pose, take transitions, act.
    fn turn(&mut self) -> Result<Pose, Over> {
        let read = |folder: &str, name: &str| self.remote.read(&format!("{folder}/{name}"));
        let heading_rad = -read(&self.gyro, "value0")?.to_radians();
        let range_m = read(&self.range, "value0")? / 1000.0;
        let driven_m = (read(&self.left, "position")? + read(&self.right, "position")?) / 2.0
            * METRES_PER_COUNT;
        let head_deg = -read(&self.head, "position")? * 12.0 / 36.0;
        let turned = Pose { heading_rad: heading_rad - self.pose.heading_rad, ..Pose::default() };
        let ahead = Pose { x_m: driven_m - self.driven_m, ..Pose::default() };
        (self.pose, self.driven_m) = (self.pose.then(&turned).then(&ahead), driven_m);
        self.is_turning = if self.is_turning { range_m <= 0.5 } else { range_m < 0.25 };
        self.looks_left = if self.looks_left { head_deg <= 45.0 } else { head_deg < -45.0 };
        self.act()?;
        Ok(self.pose)
    }

    fn act(&self) -> Result<(), Over> {
        let (left, right) = if self.is_turning { ("30", "-70") } else { ("60", "60") };
        let head = if self.looks_left { "-240" } else { "240" };
        for (motor, name, value, command) in [
            (&self.left, "speed_sp", left, "run-forever"),
            (&self.right, "speed_sp", right, "run-forever"),
            (&self.head, "position_sp", head, "run-to-abs-pos"),
        ] {
            self.remote.write(&format!("{motor}/{name}"), value)?;
            self.remote.write(&format!("{motor}/command"), command)?;
        }
        Ok(())
    }
}

/// What is told of a drive.
struct Told {
    turns: u32,
    acted: Instant,
    longest_s: f64,
    last: Option<Pose>,
    largest_m: f64,
    holes: u32,
}

impl Default for Told {
    fn default() -> Self {
        Self {
            turns: 0,
            acted: Instant::now(),
            longest_s: 0.0,
            last: None,
            largest_m: 0.0,
            holes: 0,
        }
    }
}

impl Told {
    /// Drives until it is over.
    fn whole_drive(&mut self, remote: Remote) -> Over {
        let mut robot = match Robot::find(remote) {
            Ok(robot) => robot,
            Err(over) => return over,
        };
        loop {
            let began = Instant::now();
            match robot.turn() {
                Ok(pose) => self.turn(pose),
                Err(over) => return over,
            }
            std::thread::sleep(TURN.saturating_sub(began.elapsed()));
        }
    }

    fn turn(&mut self, pose: Pose) {
        self.turns += 1;
        self.look_back();
        self.acted = Instant::now();
        if let Some(last) = self.last {
            let gap_m = libm::hypot(pose.x_m - last.x_m, pose.y_m - last.y_m);
            self.largest_m = self.largest_m.max(gap_m);
            self.holes += u32::from(gap_m > HOLE_M);
        }
        self.last = Some(pose);
    }

    /// Nothing has been commanded since the last turn.
    fn look_back(&mut self) {
        self.longest_s = self.longest_s.max(self.acted.elapsed().as_secs_f64());
    }

    fn line(&self, seconds: f64) -> serde_json::Value {
        serde_json::json!({
            "turns": self.turns,
            "hz": f64::from(self.turns) / seconds,
            "longest_loss_s": self.longest_s,
            "largest_hole_m": self.largest_m,
            "holes": self.holes,
        })
    }
}
