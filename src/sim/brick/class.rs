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
    pub(crate) const ALL: [Self; 9] = [
        Self::BoardInfo,
        Self::DcMotor,
        Self::Graphics,
        Self::Leds,
        Self::Port,
        Self::Sensor,
        Self::PowerSupply,
        Self::ServoMotor,
        Self::TachoMotor,
    ];

    /// The name of its folder in `sys/class`, or in `sys/bus`.
    pub(crate) fn as_str(self) -> &'static str {
        match self {
            Self::BoardInfo => "board-info",
            Self::LegoBus => "lego",
            Self::DcMotor => "dc-motor",
            Self::Graphics => "graphics",
            Self::Leds => "leds",
            Self::Port => "lego-port",
            Self::Sensor => "lego-sensor",
            Self::PowerSupply => "power_supply",
            Self::ServoMotor => "servo-motor",
            Self::TachoMotor => "tacho-motor",
        }
    }
}
