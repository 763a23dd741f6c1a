//! One robot's devices: which are registered under which names, and one step of all of them.
//!
//! Numbers only grow: a device that comes back has a new one, and `motorN` and `linearN` share
//! their counter.

mod beside;
mod class;
mod faults;
mod port;
pub(crate) mod tree;

use std::collections::BTreeMap;
use std::sync::Mutex;

use nix::errno::Errno;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;

pub(crate) use self::class::Class;
pub use self::port::Plugged;
use self::port::{Change, PortState, Wanted};
use super::board::Board;
use super::driver::board::{Battery, BoardInfo};
use super::driver::bus::{BusDevice, POWER, read_power, store_power};
use super::driver::dc::DcMotor;
use super::driver::input::{Buttons, Speaker};
use super::driver::lcd::Lcd;
use super::driver::led::Led;
use super::driver::sensor::Sensor;
use super::driver::servo::ServoMotor;
use super::driver::tacho::TachoMotor;
use super::driver::{Context, Driver, Stored, line, readwriteable};
use super::fault::{PortFaults, Reading};
use super::physics::{Bridge, Physics};
use super::simulation::Options;
use crate::ev3dev::{AttributeSpec, Hue};
use crate::threads::lock;

/// Ports before this one are input ports.
const FIRST_OUTPUT: usize = 4;

/// How often the battery is looked at.
const BATTERY_NS: i64 = 10_000_000;

/// A page: no store takes more.
const MOST_STORED: usize = 4096;

static UEVENT: AttributeSpec = readwriteable("uevent");

#[derive(Debug)]
enum Device {
    Tacho(usize, Box<TachoMotor>),
    Dc(usize, DcMotor),
    Servo(ServoMotor),
    Sensor(usize, Box<Sensor>),
    Port(usize),
    Bus(BusDevice),
    Led(Led),
    Lcd(Lcd),
    Battery(Battery),
    Board(BoardInfo),
}

#[derive(Debug)]
struct Node {
    id: u32,
    class: Class,
    name: String,
    registered_ns: i64,
    device: Device,
}

/// How many names each counter has given out.
#[derive(Debug, Default)]
struct Counters {
    tacho: u32,
    dc: u32,
    servo: u32,
    sensor: u32,
    ids: u32,
}

/// One robot's drivers.
#[derive(Debug)]
pub(crate) struct Brick {
    robot: usize,
    options: Options,
    pub(crate) board: &'static Board,
    ports: [PortState; 8],
    nodes: Vec<Node>,
    counters: Counters,
    /// What the co-processor has counted on each output port.
    counted: [(i64, f64); 4],
    chance: ChaCha8Rng,
    faults: [PortFaults; 8],
    pub(crate) buttons: Buttons,
    pub(crate) speaker: Speaker,
}

impl Brick {
    /// A brick that was switched on with these things plugged in: all are registered, in the order
    /// of their ports.
    pub(crate) fn new(
        robot: usize,
        physics: &mut dyn Physics,
        options: Options,
        seed: u64,
    ) -> Self {
        let plug = physics.plug(robot);
        let sensors = plug.sensors.map(|sensor| sensor.map(Plugged::Sensor));
        let motors = plug.motors.map(|motor| motor.map(Plugged::Motor));
        let mut plugged = sensors.into_iter().chain(motors);
        let board = Board::of(options.platform);
        let ports = [0, 1, 2, 3, 4, 5, 6, 7].map(|index| {
            let plugged = plugged.next().flatten();
            PortState::new(address(board, index), board, index < FIRST_OUTPUT, plugged)
        });
        let mut brick = Self {
            robot,
            options,
            board,
            ports,
            nodes: Vec::new(),
            counters: Counters::default(),
            counted: [(0, 0.0); 4],
            chance: ChaCha8Rng::seed_from_u64(seed),
            faults: [0, 1, 2, 3, 4, 5, 6, 7].map(|port| PortFaults::new(seed, port)),
            buttons: Buttons::default(),
            speaker: Speaker::default(),
        };
        brick.register_fixed();
        brick.step(0, physics);
        brick
    }

    fn register_fixed(&mut self) {
        let (board, platform) = (self.board, self.board.platform);
        for index in 0..self.ports.len() {
            self.register(Class::Port, format!("port{index}"), 0, Device::Port(index));
        }
        for lamp in platform.lights.into_iter().flatten() {
            let is_on = matches!(lamp.hue, Hue::Green | Hue::Only);
            let brightness = if is_on { board.brightest } else { 0 };
            let led = Device::Led(Led::new(brightness, board.brightest));
            self.register(Class::Leds, lamp.led.to_owned(), 0, led);
        }
        if platform.screen.is_ok() {
            let lcd = Device::Lcd(Lcd::new(self.options.lcd));
            self.register(Class::Graphics, "fb0".to_owned(), 0, lcd);
        }
        let battery = Device::Battery(Battery::new(self.options.pack, board));
        self.register(Class::PowerSupply, platform.battery.to_owned(), 0, battery);
        for (number, says) in board.boards.iter().enumerate() {
            let described = Device::Board(BoardInfo::new(self.robot, says));
            self.register(Class::BoardInfo, format!("board{number}"), 0, described);
        }
    }

    /// What happens in one step: plugs, then every device.
    pub(crate) fn step(&mut self, now_ns: i64, physics: &mut dyn Physics) {
        for index in 0..self.ports.len() {
            self.step_port(index, now_ns, physics);
        }
        let robot = self.robot;
        self.faults.iter_mut().for_each(|faults| faults.step(now_ns));
        for node in &mut self.nodes {
            match &mut node.device {
                Device::Tacho(out, motor) => {
                    let Some(faults) = self.faults.get_mut(FIRST_OUTPUT + *out) else { continue };
                    let Some(count) = self.counted.get_mut(*out) else { continue };
                    // A port that was told so has a motor whatever is plugged in.
                    if self.ports.get(FIRST_OUTPUT + *out).is_some_and(PortState::has_motor) {
                        *count = (physics.edges(robot, *out), physics.edge_position(robot, *out));
                    }
                    if !faults.is_endless() {
                        motor.end_when_due(now_ns);
                    }
                    motor.tick(faults.count(*count, now_ns), now_ns);
                }
                Device::Dc(_, motor) => motor.tick(now_ns),
                Device::Sensor(input, sensor) => {
                    let Some(faults) = self.faults.get_mut(*input) else { continue };
                    let kind = sensor.kind;
                    // A port that was told so has a driver for what is not plugged in.
                    let is_in = self.ports.get(*input).and_then(PortState::sensor) == Some(kind);
                    sensor.suffer(faults.line(), faults.stale_ns());
                    sensor.tick(now_ns, |mode| {
                        faults
                            .frame(kind, mode, now_ns, || physics.measure(robot, *input, mode))
                            .filter(|_| is_in)
                    });
                }
                Device::Battery(battery) if now_ns % BATTERY_NS == 0 => {
                    battery.sample(physics.battery(robot))
                }
                _ => {}
            }
        }
    }

    /// What the driver of a port does before a write to it returns: it unregisters and registers.
    pub(crate) fn settle_port(&mut self, id: u32, now_ns: i64, physics: &mut dyn Physics) {
        if let Some(&Device::Port(index)) = self.node(id).map(|node| &node.device) {
            self.step_port(index, now_ns, physics);
        }
    }

    fn step_port(&mut self, index: usize, now_ns: i64, physics: &mut dyn Physics) {
        loop {
            let Some(port) = self.ports.get_mut(index) else { return };
            match port.due(now_ns) {
                Change::Nothing => return,
                Change::Unregister => {
                    let gone = [port.device.take(), port.on_bus.take()];
                    self.nodes.retain(|node| !gone.contains(&Some(node.id)));
                }
                Change::Register(wanted) => self.register_on(index, wanted, now_ns, physics),
            }
        }
    }

    fn register_on(
        &mut self,
        index: usize,
        wanted: Wanted,
        now_ns: i64,
        physics: &mut dyn Physics,
    ) {
        let board = self.board;
        let address = address(board, index);
        let out = index.saturating_sub(FIRST_OUTPUT);
        let [analog, serial, motor_driver] = board.bus;
        let (class, name, bus_driver, device) = match wanted {
            Wanted::Tacho(model) => {
                let count =
                    (physics.edges(self.robot, out), physics.edge_position(self.robot, out));
                let motor = TachoMotor::new(model, &board.motors, address, count, now_ns);
                let kind = if motor.is_linear() { "linear" } else { "motor" };
                let name = format!("{kind}{}", next(&mut self.counters.tacho));
                (Class::TachoMotor, name, motor_driver, Device::Tacho(out, Box::new(motor)))
            }
            Wanted::Dc => {
                let name = format!("motor{}", next(&mut self.counters.dc));
                (Class::DcMotor, name, "rcx-motor", Device::Dc(out, DcMotor::new(address)))
            }
            Wanted::Led => {
                let name = format!("{address}::brick-status");
                (Class::Leds, name, "rcx-led", Device::Led(Led::new(0, 100)))
            }
            Wanted::Sensor(kind) => {
                let name = format!("sensor{}", next(&mut self.counters.sensor));
                let sensor =
                    Sensor::new(kind, address, self.options.gyro, board.polls_ns(), now_ns);
                let bus_driver = if sensor.model.uart { serial } else { analog };
                (Class::Sensor, name, bus_driver, Device::Sensor(index, Box::new(sensor)))
            }
        };
        let id = self.register(class, name, now_ns, device);
        let driver_name = self.driver_name(id).unwrap_or_default();
        let bound = Device::Bus(BusDevice::new(bus_driver, driver_name, address));
        let on_bus =
            self.register(Class::LegoBus, format!("{address}:{driver_name}"), now_ns, bound);
        if let Some(port) = self.ports.get_mut(index) {
            port.device = Some(id);
            port.on_bus = Some(on_bus);
        }
    }

    fn register(&mut self, class: Class, name: String, registered_ns: i64, device: Device) -> u32 {
        let id = next(&mut self.counters.ids);
        self.nodes.push(Node { id, class, name, registered_ns, device });
        id
    }

    /// What the bridges of the output ports do now.
    pub(crate) fn bridges(&self) -> [Bridge; 4] {
        let mut bridges = [Bridge::Coast; 4];
        for node in &self.nodes {
            let (out, bridge) = match &node.device {
                Device::Tacho(out, motor) => (*out, motor.bridge()),
                Device::Dc(out, motor) => (*out, motor.bridge),
                _ => continue,
            };
            let off = self.faults.get(FIRST_OUTPUT + out).is_some_and(PortFaults::is_off);
            let is_in = self.ports.get(FIRST_OUTPUT + out).is_some_and(PortState::has_motor);
            if let Some(entry) = bridges.get_mut(out).filter(|_| is_in && !off) {
                *entry = bridge;
            }
        }
        bridges
    }

    /// The names of a class.
    pub(crate) fn names(&self, class: Class) -> impl Iterator<Item = &str> {
        self.nodes.iter().filter(move |node| node.class == class).map(|node| node.name.as_str())
    }

    /// The device with a name.
    pub(crate) fn find(&self, class: &str, name: &str) -> Option<u32> {
        let found =
            self.nodes.iter().find(|node| node.class.as_str() == class && node.name == name);
        found.map(|node| node.id)
    }

    fn node(&self, id: u32) -> Option<&Node> {
        self.nodes.iter().find(|node| node.id == id)
    }

    fn driver(&self, id: u32) -> Option<&dyn Driver> {
        Some(match &self.node(id)?.device {
            Device::Tacho(_, motor) => &**motor,
            Device::Dc(_, motor) => motor,
            Device::Servo(servo) => servo,
            Device::Sensor(_, sensor) => &**sensor,
            Device::Port(index) => self.ports.get(*index)?,
            Device::Bus(device) => device,
            Device::Led(led) => led,
            Device::Lcd(lcd) => lcd,
            Device::Battery(battery) => battery,
            Device::Board(board) => board,
        })
    }

    /// True while a device's files cannot be opened for writing.
    pub(crate) fn is_denied(&self, id: u32, now_ns: i64) -> bool {
        let age_ns = now_ns - self.registered_ns(id).unwrap_or_default();
        age_ns < self.options.access_delay_ns
            || self.faults_of(id).is_some_and(PortFaults::is_denied)
    }

    /// The row of an attribute; none if the device has none of that name now.
    pub(crate) fn attribute(&self, id: u32, name: &str) -> Option<&'static AttributeSpec> {
        let own = self.driver(id)?.attributes().into_iter().flatten();
        own.chain(&POWER).chain([&UEVENT]).find(|spec| spec.name == name)
    }

    /// When a device was registered.
    pub(crate) fn registered_ns(&self, id: u32) -> Option<i64> {
        self.node(id).map(|node| node.registered_ns)
    }

    /// Appends an attribute's text.
    ///
    /// # Errors
    ///
    /// ENODEV for a device that is gone; else the driver's.
    pub(crate) fn read(
        &self,
        id: u32,
        attribute: &str,
        now_ns: i64,
        out: &mut Vec<u8>,
    ) -> Result<(), Errno> {
        let driver = self.driver(id).ok_or(Errno::ENODEV)?;
        match self.faults_of(id).and_then(|faults| faults.reading(attribute, now_ns)) {
            Some(Reading::Fails(errno)) => return Err(errno),
            Some(Reading::Reads(text)) => {
                out.extend(text);
                return Ok(());
            }
            None => {}
        }
        if attribute == UEVENT.name {
            driver.uevent(out);
            return Ok(());
        }
        if POWER.iter().any(|spec| spec.name == attribute) {
            return read_power(attribute, out);
        }
        let of_all = driver.identity().and_then(|(driver_name, address)| match attribute {
            "driver_name" => Some(driver_name),
            "address" => Some(address),
            _ => None,
        });
        match of_all {
            Some(text) => line(out, text),
            None => driver.read(attribute, out)?,
        }
        Ok(())
    }

    /// Stores what one `write` brought. An empty one does not reach the driver.
    ///
    /// # Errors
    ///
    /// ENODEV for a device that is gone; else the driver's.
    pub(crate) fn store(
        &mut self,
        id: u32,
        attribute: &str,
        bytes: &[u8],
        now_ns: i64,
    ) -> Result<Stored, Errno> {
        let refusal =
            self.faults_of(id).filter(|_| attribute != UEVENT.name).and_then(PortFaults::refusal);
        let node = self.nodes.iter_mut().find(|node| node.id == id).ok_or(Errno::ENODEV)?;
        refusal.map_or(Ok(()), Err)?;
        let driver: &mut dyn Driver = match &mut node.device {
            Device::Tacho(_, motor) => &mut **motor,
            Device::Dc(_, motor) => motor,
            Device::Servo(servo) => servo,
            Device::Sensor(_, sensor) => &mut **sensor,
            Device::Port(index) => self.ports.get_mut(*index).ok_or(Errno::ENODEV)?,
            Device::Bus(device) => device,
            Device::Led(led) => led,
            Device::Lcd(lcd) => lcd,
            Device::Battery(battery) => battery,
            Device::Board(board) => board,
        };
        let bytes = bytes.get(..MOST_STORED).unwrap_or(bytes);
        let taken = bytes.len();
        if taken == 0 {
            return Ok(Stored { taken, wait: None });
        }
        if attribute == UEVENT.name {
            let actions =
                ["add", "remove", "change", "move", "online", "offline", "bind", "unbind"];
            super::driver::text::word(bytes, actions)?;
            return Ok(Stored { taken, wait: None });
        }
        if POWER.iter().any(|spec| spec.name == attribute) {
            store_power(attribute, bytes)?;
            return Ok(Stored { taken, wait: None });
        }
        let mut context = Context { now_ns, chance: &mut self.chance };
        let wait = driver.store(attribute, bytes, &mut context)?;
        Ok(Stored { taken, wait })
    }

    /// Changes whenever the pollers of this attribute are woken; `None` for attributes that never
    /// wake one.
    pub(crate) fn notices(&self, id: u32, attribute: &str) -> Option<u32> {
        match (&self.node(id)?.device, attribute) {
            (Device::Tacho(_, motor), "state") => Some(motor.notices),
            (Device::Sensor(_, sensor), "value0") => Some(sensor.notices),
            _ => None,
        }
    }
}

/// The address of a board's port. It lives as long as the program: a simulation has few bricks, and
/// each board's addresses are made once.
fn address(board: &'static Board, index: usize) -> &'static str {
    static MADE: Mutex<BTreeMap<String, &'static str>> = Mutex::new(BTreeMap::new());
    let address = board.address(index).unwrap_or_default();
    let mut made = lock(&MADE);
    made.entry(address).or_insert_with_key(|address| String::leak(address.clone()))
}

fn next(counter: &mut u32) -> u32 {
    let number = *counter;
    *counter += 1;
    number
}
