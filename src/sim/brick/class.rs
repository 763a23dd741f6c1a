//! The classes under which programs find devices.

/// The classes of devices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Class {
    BoardInfo,
    /// No class, but the bus of what is plugged into ports.
    LegoBus,
    DcMotor,
    Graphics,
    Leds,
    Port,
    Sensor,
    PowerSupply,
    ServoMotor,
    TachoMotor,
}

impl Class {
    /// All of them by the names of their folders, those in `sys/class` first.
    const NAMES: [(Self, &'static str); 10] = [
        (Self::BoardInfo, "board-info"),
        (Self::DcMotor, "dc-motor"),
        (Self::Graphics, "graphics"),
        (Self::Leds, "leds"),
        (Self::Port, "lego-port"),
        (Self::Sensor, "lego-sensor"),
        (Self::PowerSupply, "power_supply"),
        (Self::ServoMotor, "servo-motor"),
        (Self::TachoMotor, "tacho-motor"),
        (Self::LegoBus, "lego"),
    ];

    /// Those in `sys/class`.
    pub(crate) fn in_sys_class() -> impl Iterator<Item = Self> {
        Self::NAMES.into_iter().map(|(class, _)| class).filter(|class| *class != Self::LegoBus)
    }

    /// The name of its folder in `sys/class`, or in `sys/bus`.
    pub(crate) fn as_str(self) -> &'static str {
        Self::NAMES.iter().find(|(class, _)| *class == self).map_or("", |(_, name)| name)
    }
}
