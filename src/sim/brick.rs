//! One robot's devices: which are registered under which names, and one step of all of them.
//!
//! Numbers only grow: a device that comes back has a new one, and `motorN` and `linearN` share
//! their counter.

mod beside;
mod class;
mod faults;
mod port;
pub(crate) mod tree;

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
use super::driver::{Context, Driver, Identity, Took, lego_uevent, line, readwriteable};
use super::fault::{DeviceFault, PortFaults, Reading};
use super::physics::{Bridge, Physics};
use super::ports::Port;
use super::simulation::Options;
use crate::ev3dev::{AttributeSpec, Hue};

/// How often the battery is looked at.
const BATTERY_NS: i64 = 10_000_000;

/// A page: no store takes more.
pub(crate) const MOST_STORED: usize = 4096;

static UEVENT: AttributeSpec = readwriteable("uevent");

#[derive(Debug)]
enum Device {
    Tacho(Box<TachoMotor>),
    Dc(DcMotor),
    Servo(ServoMotor),
    Sensor(Box<Sensor>),
    Port(Port),
    Bus(BusDevice),
    Led(Led),
    Lcd(Lcd),
    Battery(Battery),
    Board(BoardInfo),
}

/// A device that is registered.
#[derive(Debug)]
pub(crate) struct Node {
    id: u32,
    pub(crate) class: Class,
    pub(crate) name: String,
    registered_ns: i64,
    /// The port that it is plugged into.
    port: Option<Port>,
    /// What a device of LEGO's classes says of itself.
    pub(crate) identity: Option<Identity>,
    device: Device,
}

impl Node {
    /// A device on no port, that was there from the start.
    fn new(class: Class, name: String, device: Device) -> Self {
        Self { id: 0, class, name, registered_ns: 0, port: None, identity: None, device }
    }
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
    /// Time since the simulation began.
    pub(crate) now_ns: i64,
    ports: [PortState; 8],
    nodes: Vec<Node>,
    counters: Counters,
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
        let ports = Port::ALL.map(|port| PortState::new(port, board, plugged.next().flatten()));
        let mut brick = Self {
            robot,
            options,
            board,
            now_ns: 0,
            ports,
            nodes: Vec::new(),
            counters: Counters::default(),
            chance: ChaCha8Rng::seed_from_u64(seed),
            faults: Port::ALL.map(|port| PortFaults::new(seed, port as u64)),
            buttons: Buttons::default(),
            speaker: Speaker::default(),
        };
        brick.register_fixed();
        brick.step(physics);
        brick
    }

    fn register_fixed(&mut self) {
        let (board, platform) = (self.board, self.board.platform);
        for port in Port::ALL {
            let name = format!("port{}", port.index());
            let identity = Some(self.ports[port.index()].identity());
            let node = Node::new(Class::Port, name, Device::Port(port));
            self.register(Node { identity, ..node });
        }
        for lamp in platform.lights.into_iter().flatten() {
            let is_on = matches!(lamp.hue, Hue::Green | Hue::Only);
            let brightness = if is_on { board.brightest } else { 0 };
            let led = Device::Led(Led::new(brightness, board.brightest));
            self.register(Node::new(Class::Leds, lamp.led.to_owned(), led));
        }
        if platform.screen.is_ok() {
            let lcd = Device::Lcd(Lcd::new(self.options.lcd));
            self.register(Node::new(Class::Graphics, "fb0".to_owned(), lcd));
        }
        let battery = Device::Battery(Battery::new(self.options.cells, board));
        self.register(Node::new(Class::PowerSupply, platform.battery.to_owned(), battery));
        for (number, says) in board.boards.iter().enumerate() {
            let described = Device::Board(BoardInfo::new(self.robot, says));
            self.register(Node::new(Class::BoardInfo, format!("board{number}"), described));
        }
    }

    /// What happens in one step: plugs, then every device.
    pub(crate) fn step(&mut self, physics: &mut dyn Physics) {
        for port in Port::ALL {
            self.step_port(port, physics);
        }
        let (robot, now_ns) = (self.robot, self.now_ns);
        self.faults.iter_mut().for_each(|faults| faults.step(now_ns));
        for node in &mut self.nodes {
            if let Device::Battery(battery) = &mut node.device
                && now_ns % BATTERY_NS == 0
            {
                battery.sample(physics.battery(robot));
            }
            let Some(port) = node.port else { continue };
            let (plugged, place) = (&mut self.ports[port.index()], port.place());
            let faults = &mut self.faults[port.index()];
            match &mut node.device {
                Device::Tacho(motor) => {
                    // A port that was told so has a motor whatever is plugged in.
                    if plugged.has_motor() {
                        plugged.counted =
                            (physics.edges(robot, place), physics.edge_position(robot, place));
                    }
                    if !faults.has(&DeviceFault::Endless) {
                        motor.end_when_due(now_ns);
                    }
                    motor.tick(faults.count(plugged.counted, now_ns), now_ns);
                }
                Device::Dc(motor) => motor.tick(now_ns),
                Device::Sensor(sensor) => {
                    let kind = sensor.kind;
                    // A port that was told so has a driver for what is not plugged in.
                    let is_in = plugged.sensor() == Some(kind);
                    sensor.suffer(faults.line(), faults.stale_ns());
                    sensor.tick(now_ns, |mode| {
                        faults
                            .frame(kind, mode, now_ns, || physics.measure(robot, place, mode))
                            .filter(|_| is_in)
                    });
                }
                _ => {}
            }
        }
    }

    /// What the driver of a port does before a write to it returns: it unregisters and registers.
    pub(crate) fn settle_port(&mut self, id: u32, physics: &mut dyn Physics) {
        if let Some(&Device::Port(port)) = self.node(id).map(|node| &node.device) {
            self.step_port(port, physics);
        }
    }

    fn step_port(&mut self, port: Port, physics: &mut dyn Physics) {
        loop {
            match self.ports[port.index()].due(self.now_ns) {
                Change::Nothing => return,
                Change::Unregister => {
                    self.ports[port.index()].device = None;
                    self.nodes.retain(|node| node.port != Some(port));
                }
                Change::Register(wanted) => self.register_on(port, wanted, physics),
            }
        }
    }

    fn register_on(&mut self, port: Port, wanted: Wanted, physics: &mut dyn Physics) {
        let (board, robot, place) = (self.board, self.robot, port.place());
        let now_ns = self.now_ns;
        let address = board.address(port);
        let [analog, serial, motor_driver] = board.bus;
        let (class, name, bus_driver, driver_name, device) = match wanted {
            Wanted::Tacho(model) => {
                let count = (physics.edges(robot, place), physics.edge_position(robot, place));
                let motor = TachoMotor::new(model, &board.motors, count, now_ns);
                let kind = if motor.is_linear() { "linear" } else { "motor" };
                let name = format!("{kind}{}", next(&mut self.counters.tacho));
                let motor = Device::Tacho(Box::new(motor));
                (Class::TachoMotor, name, motor_driver, model.driver_name, motor)
            }
            Wanted::Dc => {
                let name = format!("motor{}", next(&mut self.counters.dc));
                let motor = Device::Dc(DcMotor::default());
                (Class::DcMotor, name, "rcx-motor", "rcx-motor", motor)
            }
            Wanted::Led => {
                let name = format!("{address}::brick-status");
                (Class::Leds, name, "rcx-led", "led", Device::Led(Led::new(0, 100)))
            }
            Wanted::Sensor(kind) => {
                let name = format!("sensor{}", next(&mut self.counters.sensor));
                let sensor = Sensor::new(kind, self.options.gyro, board.polls_ns(), now_ns);
                let bus_driver = if sensor.model.uart { serial } else { analog };
                let driver_name = sensor.model.driver_name;
                (Class::Sensor, name, bus_driver, driver_name, Device::Sensor(Box::new(sensor)))
            }
        };
        let bus_name = format!("{address}:{driver_name}");
        let identity = Identity { driver_name, address };
        let bound = BusDevice { driver: bus_driver, identity: identity.clone() };
        let on_port = |class, name, device| {
            let node = Node::new(class, name, device);
            Node { registered_ns: now_ns, port: Some(port), ..node }
        };
        // A lamp is an LED as any other to programs.
        let identity = Some(identity).filter(|_| class != Class::Leds);
        let id = self.register(Node { identity, ..on_port(class, name, device) });
        self.register(on_port(Class::LegoBus, bus_name, Device::Bus(bound)));
        self.ports[port.index()].device = Some(id);
    }

    fn register(&mut self, node: Node) -> u32 {
        let id = next(&mut self.counters.ids);
        self.nodes.push(Node { id, ..node });
        id
    }

    /// What the bridges of the output ports do now.
    pub(crate) fn bridges(&self) -> [Bridge; 4] {
        let mut bridges = [Bridge::Coast; 4];
        for node in &self.nodes {
            let bridge = match &node.device {
                Device::Tacho(motor) => motor.bridge(),
                Device::Dc(motor) => motor.bridge,
                _ => continue,
            };
            let Some(port) = node.port else { continue };
            let off = self.faults[port.index()].has(&DeviceFault::Off);
            if self.ports[port.index()].has_motor() && !off {
                bridges[port.place()] = bridge;
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

    /// A device, unless it is gone.
    pub(crate) fn node(&self, id: u32) -> Option<&Node> {
        self.nodes.iter().find(|node| node.id == id)
    }

    fn driver(&self, id: u32) -> Option<&dyn Driver> {
        Some(match &self.node(id)?.device {
            Device::Tacho(motor) => &**motor,
            Device::Dc(motor) => motor,
            Device::Servo(servo) => servo,
            Device::Sensor(sensor) => &**sensor,
            Device::Port(port) => &self.ports[port.index()],
            Device::Bus(device) => device,
            Device::Led(led) => led,
            Device::Lcd(lcd) => lcd,
            Device::Battery(battery) => battery,
            Device::Board(board) => board,
        })
    }

    /// True while a device's files cannot be opened for writing.
    pub(crate) fn is_denied(&self, id: u32) -> bool {
        let age_ns = self.now_ns - self.node(id).map_or(0, |node| node.registered_ns);
        age_ns < self.options.access_delay_ns
            || self.faults_of(id).is_some_and(|faults| faults.has(&DeviceFault::Denied))
    }

    /// The row of an attribute; none if the device has none of that name now.
    pub(crate) fn attribute(&self, id: u32, name: &str) -> Option<&'static AttributeSpec> {
        let own = self.driver(id)?.attributes().into_iter().flatten();
        own.chain(&POWER).chain([&UEVENT]).find(|spec| spec.name == name)
    }

    /// Appends an attribute's text.
    ///
    /// # Errors
    ///
    /// ENODEV for a device that is gone; else the driver's.
    pub(crate) fn read(&self, id: u32, attribute: &str, out: &mut Vec<u8>) -> Result<(), Errno> {
        let driver = self.driver(id).ok_or(Errno::ENODEV)?;
        let identity = self.node(id).and_then(|node| node.identity.as_ref());
        match self.faults_of(id).and_then(|faults| faults.reading(attribute, self.now_ns)) {
            Some(Reading::Fails(errno)) => return Err(errno),
            Some(Reading::Reads(text)) => {
                out.extend(text);
                return Ok(());
            }
            None => {}
        }
        if attribute == UEVENT.name {
            driver.uevent(out);
            identity.into_iter().for_each(|identity| lego_uevent(out, identity));
            return Ok(());
        }
        if POWER.iter().any(|spec| spec.name == attribute) {
            return read_power(attribute, out);
        }
        match (attribute, identity) {
            ("driver_name", Some(identity)) => line(out, identity.driver_name),
            ("address", Some(identity)) => line(out, &identity.address),
            _ => driver.read(attribute, out)?,
        }
        Ok(())
    }

    /// Stores what one `write` brought. An empty one does not reach the driver.
    ///
    /// # Errors
    ///
    /// ENODEV for a device that is gone; else the driver's.
    pub(crate) fn store(&mut self, id: u32, attribute: &str, bytes: &[u8]) -> Took {
        let refusal =
            self.faults_of(id).filter(|_| attribute != UEVENT.name).and_then(PortFaults::refusal);
        let node = self.nodes.iter_mut().find(|node| node.id == id).ok_or(Errno::ENODEV)?;
        refusal.map_or(Ok(()), Err)?;
        let driver: &mut dyn Driver = match &mut node.device {
            Device::Tacho(motor) => &mut **motor,
            Device::Dc(motor) => motor,
            Device::Servo(servo) => servo,
            Device::Sensor(sensor) => &mut **sensor,
            Device::Port(port) => &mut self.ports[port.index()],
            Device::Bus(device) => device,
            Device::Led(led) => led,
            Device::Lcd(lcd) => lcd,
            Device::Battery(battery) => battery,
            Device::Board(board) => board,
        };
        let bytes = bytes.get(..MOST_STORED).unwrap_or(bytes);
        if bytes.is_empty() {
            return Ok(None);
        }
        if attribute == UEVENT.name {
            let actions =
                ["add", "remove", "change", "move", "online", "offline", "bind", "unbind"];
            return super::driver::text::word(bytes, actions).map(|_| None);
        }
        if POWER.iter().any(|spec| spec.name == attribute) {
            return store_power(attribute, bytes).map(|()| None);
        }
        driver.store(
            attribute,
            bytes,
            &mut Context { now_ns: self.now_ns, chance: &mut self.chance },
        )
    }

    /// Changes whenever the pollers of this attribute are woken; `None` for attributes that never
    /// wake one.
    pub(crate) fn notices(&self, id: u32, attribute: &str) -> Option<u32> {
        match (&self.node(id)?.device, attribute) {
            (Device::Tacho(motor), "state") => Some(motor.notices),
            (Device::Sensor(sensor), "value0") => Some(sensor.notices),
            _ => None,
        }
    }
}

fn next(counter: &mut u32) -> u32 {
    let number = *counter;
    *counter += 1;
    number
}
