//! The tests' own brick, made of the bindings' tables: in memory, where it counts calls, answers
//! errors on demand and has its cables pulled, or written out as plain files, in which nothing
//! moves and every write is kept.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use nix::errno::Errno;
use onbrick::ev3dev::{
    Access, AttributeFile, AttributeSpec, Battery, Direction, Legal, Linear, LinearActuator,
    LocalTree, MotorKind, Rotary, Sensor, TachoMotor, Tree,
};

/// Calls that reached the fake kernel.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Calls {
    pub opens: u32,
    pub reads: u32,
    pub writes: u32,
}

#[derive(Debug)]
struct FakeFile {
    text: Vec<u8>,
    direction: Direction,
    read_error: Option<Errno>,
    write_error: Option<Errno>,
}

#[derive(Debug, Default)]
struct State {
    files: BTreeMap<String, FakeFile>,
    calls: Calls,
    /// What was written, in order, with its path.
    log: Vec<(String, String)>,
}

#[derive(Debug, Clone, Default)]
pub struct FakeTree(Arc<Mutex<State>>);

impl FakeTree {
    pub fn tree(&self) -> Arc<dyn Tree> {
        Arc::new(self.clone())
    }

    /// Makes a device's files of its tables, each with some legal text, and puts `texts` into those
    /// that they name.
    pub fn plug(&self, folder: &str, tables: &[&[AttributeSpec]], texts: &[(&str, &str)]) {
        for spec in tables.iter().copied().flatten() {
            self.file(folder, spec.name, spec.direction, &some_text(spec));
        }
        for (name, text) in texts {
            self.put(folder, name, text.as_bytes());
        }
    }

    pub fn file(&self, folder: &str, name: &str, direction: Direction, text: &str) {
        let file = FakeFile {
            text: text.as_bytes().to_vec(),
            direction,
            read_error: None,
            write_error: None,
        };
        self.0.lock().unwrap().files.insert(format!("{folder}/{name}"), file);
    }

    pub fn put(&self, folder: &str, name: &str, text: &[u8]) {
        let mut state = self.0.lock().unwrap();
        let file = state.files.get_mut(&format!("{folder}/{name}")).expect("a file of the table");
        file.text = text.to_vec();
    }

    pub fn fail(&self, folder: &str, name: &str, read: Option<Errno>, write: Option<Errno>) {
        let mut state = self.0.lock().unwrap();
        let file = state.files.get_mut(&format!("{folder}/{name}")).expect("a file of the table");
        (file.read_error, file.write_error) = (read, write);
    }

    pub fn pull(&self, folder: &str) {
        self.0.lock().unwrap().files.retain(|path, _| !path.starts_with(&format!("{folder}/")));
    }

    pub fn remove(&self, folder: &str, name: &str) {
        self.0.lock().unwrap().files.remove(&format!("{folder}/{name}"));
    }

    /// Writes every file below a folder.
    pub fn write(&self, folder: &Path) -> Arc<dyn Tree> {
        for (path, file) in &self.0.lock().unwrap().files {
            let path = folder.join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, &file.text).unwrap();
        }
        Arc::new(LocalTree::new(folder))
    }

    pub fn calls(&self) -> Calls {
        self.0.lock().unwrap().calls
    }

    /// What was written to a file, in order.
    pub fn written(&self, folder: &str, name: &str) -> Vec<String> {
        let path = format!("{folder}/{name}");
        let state = self.0.lock().unwrap();
        state
            .log
            .iter()
            .filter(|(written, _)| *written == path)
            .map(|(_, text)| text.clone())
            .collect()
    }
}

impl Tree for FakeTree {
    fn list(&self, folder: &str) -> Result<Vec<String>, Errno> {
        let state = self.0.lock().unwrap();
        let below =
            state.files.keys().filter_map(|path| path.strip_prefix(folder)?.strip_prefix('/'));
        let mut names: Vec<String> =
            below.filter_map(|rest| rest.split('/').next()).map(str::to_owned).collect();
        names.dedup();
        // Any order will do for a kernel, so give the least convenient one.
        names.reverse();
        if names.is_empty() { Err(Errno::ENOENT) } else { Ok(names) }
    }

    fn open(&self, path: &str, access: Access) -> Result<Box<dyn AttributeFile>, Errno> {
        let mut state = self.0.lock().unwrap();
        state.calls.opens += 1;
        let file = state.files.get(path).ok_or(Errno::ENOENT)?;
        match (file.direction, access) {
            (Direction::Readable, Access::Write | Access::ReadWrite)
            | (Direction::Writeable, Access::Read | Access::ReadWrite) => Err(Errno::EACCES),
            _ => Ok(Box::new(OpenFile { tree: self.clone(), path: path.to_owned() })),
        }
    }

    fn root(&self) -> &Path {
        Path::new("fake")
    }
}

#[derive(Debug)]
struct OpenFile {
    tree: FakeTree,
    path: String,
}

impl AttributeFile for OpenFile {
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Errno> {
        let mut state = self.tree.0.lock().unwrap();
        state.calls.reads += 1;
        let file = state.files.get(&self.path).ok_or(Errno::ENODEV)?;
        if let Some(errno) = file.read_error {
            return Err(errno);
        }
        let length = file.text.len().min(buffer.len());
        buffer[..length].copy_from_slice(&file.text[..length]);
        Ok(length)
    }

    fn write(&self, value: &[u8]) -> Result<usize, Errno> {
        let mut state = self.tree.0.lock().unwrap();
        state.calls.writes += 1;
        let file = state.files.get_mut(&self.path).ok_or(Errno::ENODEV)?;
        if let Some(errno) = file.write_error {
            return Err(errno);
        }
        file.text = value.to_vec();
        let text = String::from_utf8_lossy(value).into_owned();
        state.log.push((self.path.clone(), text));
        Ok(value.len())
    }

    fn wait_changed(&self, _timeout: Duration) -> Result<bool, Errno> {
        Ok(true)
    }
}

/// Some legal text for an attribute.
pub fn some_text(spec: &AttributeSpec) -> String {
    match &spec.legal {
        Legal::Number => "0\n".to_owned(),
        Legal::Range(first, last) => format!("{}\n", 0.clamp(*first, *last)),
        Legal::Words(words) => format!("{}\n", words[0]),
        _ => "\n".to_owned(),
    }
}

pub const MOTOR: &str = "sys/class/tacho-motor/motor0";
pub const LINEAR: &str = "sys/class/tacho-motor/linear1";
pub const SENSOR: &str = "sys/class/lego-sensor/sensor0";

pub fn rotary_tables() -> [&'static [AttributeSpec]; 2] {
    [TachoMotor::ATTRIBUTES, Rotary::OWN_ATTRIBUTES]
}

pub fn linear_tables() -> [&'static [AttributeSpec]; 2] {
    [LinearActuator::ATTRIBUTES, Linear::OWN_ATTRIBUTES]
}

pub fn sensor_tables() -> [&'static [AttributeSpec]; 2] {
    [Sensor::ATTRIBUTES, Sensor::BINARY_ATTRIBUTES]
}

pub fn plug_large_motor(fake: &FakeTree, folder: &str, address: &str) {
    let texts = [
        ("address", address),
        ("driver_name", "lego-ev3-l-motor\n"),
        ("max_speed", "1050\n"),
        ("count_per_rot", "360\n"),
    ];
    fake.plug(folder, &rotary_tables(), &texts);
}

/// A sensor whose modes are those that its real driver lists, in its first.
pub fn plug_sensor(fake: &FakeTree, folder: &str, address: &str, driver: &str, modes: &str) {
    let first = modes.split(' ').next().unwrap();
    let texts = [
        ("address", address),
        ("driver_name", driver),
        ("modes", modes),
        ("mode", first),
        ("num_values", "1\n"),
    ];
    fake.plug(folder, &sensor_tables(), &texts);
}

/// Folders of the shipped robot's devices; the motors are on outA, outB and outD, the sensors on
/// in1 and in4.
pub const MOTORS: [&str; 3] = [
    "sys/class/tacho-motor/motor0",
    "sys/class/tacho-motor/motor1",
    "sys/class/tacho-motor/motor2",
];
pub const SENSORS: [&str; 2] = ["sys/class/lego-sensor/sensor0", "sys/class/lego-sensor/sensor1"];
pub const BATTERY: &str = "sys/class/power_supply/lego-ev3-battery";

/// As the kernel's driver lists them (`tests/data/kernel-transcript.txt`).
const COMMANDS: &str =
    "run-forever run-to-abs-pos run-to-rel-pos run-timed run-direct stop reset\n";

/// The shipped robot at rest: three motors, an ultrasonic sensor that sees a wall at 1 m, a gyro, a
/// battery of 7.5 V.
pub fn shipped_brick() -> FakeTree {
    let fake = FakeTree::default();
    for (folder, port) in MOTORS.iter().zip(["outA", "outB", "outD"]) {
        plug_large_motor(&fake, folder, &format!("ev3-ports:{port}\n"));
        // None is kept here, and one that stands still would contradict each command.
        fake.put(folder, "state", b"unknown\n");
        fake.put(folder, "command", b"reset\n");
        fake.put(folder, "commands", COMMANDS.as_bytes());
    }
    fake.put(MOTORS[0], "driver_name", b"lego-ev3-m-motor\n");
    plug_sensor(
        &fake,
        SENSORS[0],
        "ev3-ports:in1\n",
        "lego-ev3-us\n",
        "US-DIST-CM US-DIST-IN US-LISTEN\n",
    );
    fake.put(SENSORS[0], "value0", b"1000\n");
    plug_sensor(&fake, SENSORS[1], "ev3-ports:in4\n", "lego-ev3-gyro\n", "GYRO-ANG GYRO-RATE\n");
    fake.plug(BATTERY, &[Battery::ATTRIBUTES], &[("voltage_now", "7500000\n")]);
    fake
}
