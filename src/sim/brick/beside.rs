//! What is done to a brick from outside, and seen of it: plugging, frames and serial lines of
//! sensors, servos, lights, the screen.

use nix::errno::Errno;

use super::{Brick, Class, Device, Identity, Lcd, Node, Plugged, Port, ServoMotor, next};

impl Brick {
    /// Puts something into a port, or takes it out; detection takes its time.
    ///
    /// # Errors
    ///
    /// EINVAL for a motor in an input port and the reverse.
    pub(crate) fn plug(&mut self, port: Port, plugged: Option<Plugged>) -> Result<(), Errno> {
        self.ports[port.index()].plug(plugged, self.now_ns)
    }

    /// Adds an output of a servo controller; returns its name.
    pub(crate) fn add_servo(&mut self, address: &str, has_rate: bool) -> String {
        let name = format!("motor{}", next(&mut self.counters.servo));
        let servo = Device::Servo(ServoMotor::new(has_rate));
        let identity = Identity { driver_name: "servo-motor", address: address.to_owned() };
        let node = Node::new(Class::ServoMotor, name.clone(), servo);
        self.register(Node { registered_ns: self.now_ns, identity: Some(identity), ..node });
        name
    }

    /// The pulse of a servo, in microseconds; none while it floats, or without such a servo.
    pub(crate) fn servo_pulse_us(&self, name: &str) -> Option<i32> {
        match self.device(Class::ServoMotor, name)? {
            Device::Servo(servo) => servo.pulse_us(),
            _ => None,
        }
    }

    /// A light's brightness and trigger.
    pub(crate) fn led(&self, name: &str) -> Option<(u32, &'static str)> {
        match self.device(Class::Leds, name)? {
            Device::Led(led) => Some((led.brightness, led.trigger())),
            _ => None,
        }
    }

    fn device(&self, class: Class, name: &str) -> Option<&Device> {
        Some(&self.node(self.find(class.as_str(), name)?)?.device)
    }

    /// The screen, if the board has one.
    pub(crate) fn lcd(&self) -> Option<&Lcd> {
        self.nodes.iter().find_map(|node| match &node.device {
            Device::Lcd(lcd) => Some(lcd),
            _ => None,
        })
    }

    /// The picture on the screen.
    pub(crate) fn lcd_bytes(&self) -> &[u8] {
        self.lcd().map_or(&[], |lcd| &lcd.bytes)
    }

    /// Draws on the screen; returns how many bytes there was room for.
    ///
    /// # Errors
    ///
    /// ENOSPC at the picture's end.
    pub(crate) fn draw(&mut self, offset: usize, bytes: &[u8]) -> Result<usize, Errno> {
        let lcd = self.nodes.iter_mut().find_map(|node| match &mut node.device {
            Device::Lcd(lcd) => Some(lcd),
            _ => None,
        });
        lcd.ok_or(Errno::ENODEV)?.write(offset, bytes)
    }

    /// Puts a frame into the sensor on an input port, or lets it measure again.
    ///
    /// # Errors
    ///
    /// ENODEV where no sensor is registered.
    pub(crate) fn feed(&mut self, port: Port, frame: Option<&[u8]>) -> Result<(), Errno> {
        let sensor = self.nodes.iter_mut().find_map(|node| match &mut node.device {
            Device::Sensor(sensor) if node.port == Some(port) => Some(sensor),
            _ => None,
        });
        sensor.ok_or(Errno::ENODEV)?.feed(frame);
        Ok(())
    }
}
