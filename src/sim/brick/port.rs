//! A port: class `lego-port`, and the detection of what is plugged into it (`ev3_ports_in.c`,
//! `ev3_ports_out.c`).

use nix::errno::Errno;

use crate::ev3dev::{LegoPort, PISTORMS};
use crate::sim::board::{Board, PortKind};
use crate::sim::driver::sensor::{HANDSHAKE_NS, MODELS, model};
use crate::sim::driver::tacho::{self, Model};
use crate::sim::driver::text::word;
use crate::sim::driver::{Attributes, Context, Driver, Identity, Took, line, list};
use crate::sim::physics::{MotorKind, SensorKind};
use crate::sim::ports::Port;

/// A plug is believed once it has been stable for 350 ms, and the pins have settled twice for 20
/// ms.
const DETECT_NS: i64 = 390_000_000;

/// A pulled plug is believed after 100 ms.
const VANISH_NS: i64 = 100_000_000;

/// What can be in a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Plugged {
    /// A motor.
    Motor(MotorKind),
    /// A sensor.
    Sensor(SensorKind),
}

/// The device that a port should have.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Wanted {
    Tacho(&'static Model),
    Dc,
    Led,
    Sensor(SensorKind),
}

/// One port.
#[derive(Debug)]
pub(crate) struct PortState {
    port: Port,
    board: &'static Board,
    mode: usize,
    plugged: Option<Plugged>,
    /// What was last put in: it is put back after a pull.
    pub(crate) home: Option<Plugged>,
    motor_driver: Option<&'static Model>,
    /// What the port was told that it has, where it does not find out.
    named: Option<SensorKind>,
    appear_ns: Option<i64>,
    vanish_ns: Option<i64>,
    /// A store has asked for the device to be registered again.
    renew: bool,
    /// The device registered on it, of a class.
    pub(crate) device: Option<u32>,
    /// What the co-processor has counted of its motor.
    pub(crate) counted: (i64, f64),
}

/// What a port asks of the registry.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Change {
    Nothing,
    Unregister,
    Register(Wanted),
}

impl PortState {
    /// A port in its first mode, with what was plugged in before the brick was switched on.
    pub(crate) fn new(port: Port, board: &'static Board, plugged: Option<Plugged>) -> Self {
        let mut port = Self {
            port,
            board,
            mode: 0,
            plugged,
            home: plugged,
            motor_driver: None,
            named: None,
            appear_ns: None,
            vanish_ns: None,
            renew: false,
            device: None,
            counted: (0, 0.0),
        };
        port.appear_ns = port.wanted().map(|_| 0);
        port
    }

    /// What the port says of itself.
    pub(crate) fn identity(&self) -> Identity {
        Identity { driver_name: self.kind().driver, address: self.board.address(self.port) }
    }

    /// The sensor that is in the port.
    pub(crate) fn sensor(&self) -> Option<SensorKind> {
        match self.plugged {
            Some(Plugged::Sensor(kind)) => Some(kind),
            _ => None,
        }
    }

    /// A motor is in the port.
    pub(crate) fn has_motor(&self) -> bool {
        matches!(self.plugged, Some(Plugged::Motor(_)))
    }

    /// Puts something in, or takes it out.
    ///
    /// # Errors
    ///
    /// EINVAL for a motor in an input port and the reverse.
    pub(crate) fn plug(&mut self, plugged: Option<Plugged>, now_ns: i64) -> Result<(), Errno> {
        if plugged
            .is_some_and(|plugged| matches!(plugged, Plugged::Motor(_)) != self.port.is_output())
        {
            return Err(Errno::EINVAL);
        }
        self.home = plugged.or(self.home);
        self.change(plugged, now_ns);
        Ok(())
    }

    /// Takes out what is in.
    pub(crate) fn pull(&mut self, now_ns: i64) {
        self.change(None, now_ns);
    }

    /// Puts back what was pulled; nothing happens where something is in.
    pub(crate) fn put_back(&mut self, now_ns: i64) {
        if self.plugged.is_none() {
            self.change(self.home, now_ns);
        }
    }

    fn change(&mut self, plugged: Option<Plugged>, now_ns: i64) {
        self.plugged = plugged;
        if self.mode_name() != "auto" {
            // A forced mode detects nothing.
            return;
        }
        if self.device.is_some() {
            self.vanish_ns = Some(now_ns + VANISH_NS);
        }
        self.appear_ns = plugged.map(|plugged| now_ns + detection_ns(plugged));
    }

    /// What has to happen now.
    pub(crate) fn due(&mut self, now_ns: i64) -> Change {
        if self.renew || self.vanish_ns.is_some_and(|due_ns| due_ns <= now_ns) {
            self.renew = false;
            self.vanish_ns = None;
            if self.device.is_some() {
                return Change::Unregister;
            }
        }
        if self.appear_ns.is_some_and(|due_ns| due_ns <= now_ns) {
            self.appear_ns = None;
            return self.wanted().map_or(Change::Nothing, Change::Register);
        }
        Change::Nothing
    }

    fn mode_name(&self) -> &'static str {
        self.modes().get(self.mode).copied().unwrap_or_default()
    }

    fn kind(&self) -> &'static PortKind {
        if self.port.is_output() { &self.board.outputs } else { &self.board.inputs }
    }

    fn modes(&self) -> &'static [&'static str] {
        self.kind().modes
    }

    fn wanted(&self) -> Option<Wanted> {
        let detects = self.board.platform.detects;
        match (self.mode_name(), self.plugged) {
            ("auto", Some(Plugged::Motor(kind))) => {
                Some(Model::of(kind).map_or(Wanted::Dc, Wanted::Tacho))
            }
            ("tacho-motor", _) => {
                Some(Wanted::Tacho(self.motor_driver.unwrap_or(Model::usual(detects))))
            }
            ("dc-motor", _) => Some(Wanted::Dc),
            ("led", _) => Some(Wanted::Led),
            ("ev3-analog" | "ev3-uart", _) if self.named.is_some() => {
                self.named.map(Wanted::Sensor)
            }
            ("ev3-analog", _) if !detects => Some(Wanted::Sensor(SensorKind::Touch)),
            // The controllers of BrickPi and BrickPi3 do not ask a serial sensor what it is.
            ("ev3-uart", _) if !detects && self.board.platform != &PISTORMS => None,
            (mode, Some(Plugged::Sensor(kind)))
                if mode == "auto" || mode == model(kind).port_mode() =>
            {
                Some(Wanted::Sensor(kind))
            }
            _ => None,
        }
    }

    fn status(&self) -> &'static str {
        match (self.port.is_output(), self.mode, self.plugged) {
            _ if !self.board.platform.detects => self.mode_name(),
            (false, _, None) => "no-sensor",
            (false, _, Some(Plugged::Sensor(kind))) => model(kind).port_mode(),
            (false, _, Some(Plugged::Motor(_))) => "error",
            (true, 0, None) => "no-motor",
            (true, 0, Some(Plugged::Motor(MotorKind::Rcx))) => "dc-motor",
            (true, 0, Some(_)) => "tacho-motor",
            (true, _, _) => self.mode_name(),
        }
    }

    fn set_mode(&mut self, mode: usize, now_ns: i64) {
        self.mode = mode;
        self.motor_driver = None;
        self.named = None;
        self.register_again(now_ns);
    }

    /// What a port that does not find out is told to have, in the mode for it.
    fn name_sensor(&mut self, bytes: &[u8], context: &Context<'_>) -> Result<(), Errno> {
        if self.port.is_output() || self.mode == 0 {
            return Err(Errno::EOPNOTSUPP);
        }
        let fitting = MODELS.iter().filter(|model| model.port_mode() == self.mode_name());
        let kinds: Vec<_> = fitting.map(|model| (model.driver_name, model.kind)).collect();
        let place = word(bytes, kinds.iter().map(|(name, _)| *name))?;
        self.named = kinds.get(place).map(|(_, kind)| *kind);
        self.register_again(context.now_ns);
        Ok(())
    }

    fn register_again(&mut self, now_ns: i64) {
        self.renew = true;
        self.vanish_ns = None;
        let delay_ns = match (self.mode, self.plugged) {
            _ if !self.board.platform.detects => 0,
            (0, Some(plugged)) => detection_ns(plugged),
            (_, Some(Plugged::Sensor(kind))) if model(kind).uart => HANDSHAKE_NS,
            _ => 0,
        };
        self.appear_ns = Some(now_ns + delay_ns);
    }
}

fn detection_ns(plugged: Plugged) -> i64 {
    match plugged {
        Plugged::Sensor(kind) if model(kind).uart => DETECT_NS + HANDSHAKE_NS,
        Plugged::Motor(_) | Plugged::Sensor(_) => DETECT_NS,
    }
}

impl Driver for PortState {
    fn attributes(&self) -> Attributes {
        [LegoPort::ATTRIBUTES, &[]]
    }

    fn read(&self, attribute: &str, out: &mut Vec<u8>) -> Result<(), Errno> {
        match attribute {
            "mode" => line(out, self.mode_name()),
            "modes" => list(out, self.modes().iter().copied()),
            "status" => line(out, self.status()),
            _ => return Err(Errno::ENODEV),
        }
        Ok(())
    }

    fn store(&mut self, attribute: &str, bytes: &[u8], context: &mut Context<'_>) -> Took {
        match attribute {
            "mode" => {
                let mode = word(bytes, self.modes().iter().copied())?;
                self.set_mode(mode, context.now_ns);
            }
            "set_device" if !self.board.platform.detects => self.name_sensor(bytes, context)?,
            "set_device" if self.mode_name() == "tacho-motor" => {
                let names = tacho::MODELS.iter().map(|model| model.driver_name);
                self.motor_driver = tacho::MODELS.get(word(bytes, names)?);
                self.register_again(context.now_ns);
            }
            "set_device" if self.mode_name() == "nxt-analog" => {
                // No NXT sensor is simulated, so no driver of one can be bound.
                return Err(Errno::EINVAL);
            }
            _ => return Err(Errno::EOPNOTSUPP),
        }
        Ok(None)
    }

    fn uevent(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(b"DEVTYPE=");
        line(out, self.kind().driver);
    }
}
