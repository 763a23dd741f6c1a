//! The kernel's words as enums: one table each, so that text and meaning cannot drift apart.
//!
//! # Not here
//!
//! The modes of each sensor are beside the sensor's type, made by the same macro.

/// A word that the kernel does not know.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{word}` is none of {known}")]
pub struct UnknownWord {
    /// The word as it was read.
    pub word: String,
    /// The legal words, separated by spaces.
    pub known: String,
}

/// Makes an enum of a table of words, with `ALL`, `WORDS`, `as_str`, `FromStr`, `Display` and its
/// place among attribute values.
macro_rules! words {
    ($(#[$doc:meta])* $name:ident {
        $($(#[$word_doc:meta])* $variant:ident = $word:literal,)+
    }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum $name { $($(#[$word_doc])* $variant,)+ }

        impl $name {
            /// Every word, in the kernel's order.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)+];

            /// Every word's text, in the kernel's order.
            pub const WORDS: &'static [&'static str] = &[$($word,)+];

            /// The word as the kernel writes it.
            #[must_use]
            pub const fn as_str(self) -> &'static str {
                match self { $(Self::$variant => $word,)+ }
            }
        }

        impl std::str::FromStr for $name {
            type Err = $crate::ev3dev::UnknownWord;

            fn from_str(word: &str) -> Result<Self, Self::Err> {
                match word {
                    $($word => Ok(Self::$variant),)+
                    _ => Err($crate::ev3dev::UnknownWord {
                        word: word.to_owned(),
                        known: Self::WORDS.join(" "),
                    }),
                }
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.pad(self.as_str())
            }
        }

        impl $crate::ev3dev::value::Value for $name {
            const LEGAL: $crate::ev3dev::Legal = $crate::ev3dev::Legal::Words(Self::WORDS);

            fn parse(text: &[u8]) -> Option<Self> {
                Self::ALL.iter().copied().find(|word| word.as_str().as_bytes() == text)
            }

            fn render(&self, line: &mut $crate::ev3dev::value::AttributeText) -> std::fmt::Result {
                std::fmt::Write::write_str(line, self.as_str())
            }
        }
    };
}

pub(super) use words;

words! {
    /// What a motor does when it stops.
    #[derive(Default)]
    StopAction {
        /// Both bridge inputs low: the motor turns freely.
        #[default]
        Coast = "coast",
        /// Windings shorted: the motor slows itself down.
        Brake = "brake",
        /// The position is held by a regulator. Motors without a position refuse it.
        Hold = "hold",
    }
}

words! {
    /// Which way counts as positive. The kernel applies it to set points and to readings; no other
    /// code may apply it again.
    Polarity {
        /// As the motor is built.
        Normal = "normal",
        /// Turned round.
        Inversed = "inversed",
    }
}

words! {
    /// What a motor with a position is told to do. A command copies all set points; later set
    /// points wait for the next one.
    TachoCommand {
        /// Regulated at `speed_sp` until another command. Nothing ends it when our program dies.
        RunForever = "run-forever",
        /// Regulated at |`speed_sp`| to `position_sp`.
        RunToAbsPos = "run-to-abs-pos",
        /// Regulated at |`speed_sp`| by `position_sp`; after another such move, from that move's
        /// target.
        RunToRelPos = "run-to-rel-pos",
        /// Regulated at `speed_sp` for `time_sp`, then the stop action: a lease, because the kernel
        /// ends it.
        RunTimed = "run-timed",
        /// Unregulated at `duty_cycle_sp`, which then acts at once.
        RunDirect = "run-direct",
        /// The stop action that is in the file now.
        Stop = "stop",
        /// Coast, and everything back to its default, the position to 0.
        Reset = "reset",
    }
}

impl TachoCommand {
    /// Whether the motor may turn or push after it.
    #[must_use]
    pub const fn drives(self) -> bool {
        !matches!(self, Self::Stop | Self::Reset)
    }
}

words! {
    /// What a motor without a position is told to do.
    #[derive(Default)]
    DcCommand {
        /// At `duty_cycle_sp` until another command.
        RunForever = "run-forever",
        /// At `duty_cycle_sp` for `time_sp`, then the stop action.
        RunTimed = "run-timed",
        /// At `duty_cycle_sp`, which then acts at once.
        RunDirect = "run-direct",
        /// The stop action.
        #[default]
        Stop = "stop",
    }
}

impl DcCommand {
    /// Whether the motor may turn after it.
    #[must_use]
    pub const fn drives(self) -> bool {
        !matches!(self, Self::Stop)
    }
}

words! {
    /// What a servo is told to do.
    ServoCommand {
        /// Go to `position_sp` and hold it.
        Run = "run",
        /// Let go.
        Float = "float",
    }
}

words! {
    /// How a port treats what is plugged in. Input ports know `auto` to `other-uart` and `raw`,
    /// output ports `auto` and `tacho-motor` to `raw`.
    PortMode {
        /// Find out by itself; every port's default.
        Auto = "auto",
        /// An NXT analog sensor.
        NxtAnalog = "nxt-analog",
        /// The NXT colour sensor, for which there is no driver.
        NxtColor = "nxt-color",
        /// An NXT I²C sensor.
        NxtI2c = "nxt-i2c",
        /// Any other I²C device.
        OtherI2c = "other-i2c",
        /// An EV3 analog sensor.
        Ev3Analog = "ev3-analog",
        /// An EV3 UART sensor.
        Ev3Uart = "ev3-uart",
        /// Any other device on a serial line.
        OtherUart = "other-uart",
        /// A motor with a position.
        TachoMotor = "tacho-motor",
        /// A motor without a position.
        DcMotor = "dc-motor",
        /// A lamp.
        Led = "led",
        /// The pins alone, for other subsystems.
        Raw = "raw",
    }
}

words! {
    /// What kind of cells the brick runs on.
    #[derive(Default)]
    Technology {
        /// Not known: AA cells, alkaline unless the user says otherwise.
        #[default]
        Unknown = "Unknown",
        /// LEGO's rechargeable pack, found by its switch.
        LiIon = "Li-ion",
        /// Rechargeable AA cells, if the user said so.
        NiMh = "NiMH",
    }
}

words! {
    /// How the bytes of `bin_data` are laid out, little-endian unless the word says `be`.
    #[derive(Default)]
    BinFormat {
        /// Unsigned bytes: what the class takes where a driver says nothing.
        #[default]
        U8 = "u8",
        /// Signed bytes.
        S8 = "s8",
        /// Unsigned 16 bits.
        U16 = "u16",
        /// Signed 16 bits.
        S16 = "s16",
        /// Signed 16 bits, big-endian.
        S16Be = "s16_be",
        /// Signed 32 bits.
        S32 = "s32",
        /// Signed 32 bits, big-endian, as the driver spells it.
        S32Be = "s32be",
        /// Signed 32 bits, big-endian, as the driver's manual spells it.
        S32BeManual = "s32_be",
        /// IEEE 754 single precision.
        Float = "float",
    }
}

impl BinFormat {
    /// Bytes of one value.
    #[must_use]
    pub const fn size(self) -> usize {
        match self {
            Self::U8 | Self::S8 => 1,
            Self::U16 | Self::S16 | Self::S16Be => 2,
            Self::S32 | Self::S32Be | Self::S32BeManual | Self::Float => 4,
        }
    }
}

words! {
    /// The drivers that this program knows by name. There are many more, and a device with any of
    /// them can be used.
    Driver {
        /// LEGO's large motor; an NXT motor says the same in the port mode `auto`.
        LargeMotor = "lego-ev3-l-motor",
        /// LEGO's medium motor.
        MediumMotor = "lego-ev3-m-motor",
        /// The NXT's motor, if the user said so.
        NxtMotor = "lego-nxt-motor",
        /// A linear actuator of 50 mm.
        Linear50 = "act-l12-ev3-50",
        /// A linear actuator of 100 mm.
        Linear100 = "act-l12-ev3-100",
        /// Any motor without a position.
        RcxMotor = "rcx-motor",
        /// The EV3's touch sensor.
        Touch = "lego-ev3-touch",
        /// The EV3's colour sensor.
        Colour = "lego-ev3-color",
        /// The EV3's ultrasonic sensor.
        Ultrasonic = "lego-ev3-us",
        /// The EV3's gyro sensor.
        Gyro = "lego-ev3-gyro",
        /// The EV3's infrared sensor.
        Infrared = "lego-ev3-ir",
        /// The NXT's touch sensor.
        NxtTouch = "lego-nxt-touch",
        /// The NXT's light sensor.
        NxtLight = "lego-nxt-light",
        /// The NXT's sound sensor, if the user said so.
        NxtSound = "lego-nxt-sound",
        /// The NXT's ultrasonic sensor.
        NxtUltrasonic = "lego-nxt-us",
        /// The NXT's temperature sensor.
        NxtTemperature = "lego-nxt-temp",
        /// Any other analog sensor of the NXT.
        NxtAnalog = "nxt-analog",
        /// An input port.
        InputPort = "ev3-input-port",
        /// An output port.
        OutputPort = "ev3-output-port",
    }
}

impl Driver {
    /// The mode of an input port for such a sensor, where the port does not find it out; `None` for
    /// what is no sensor, and for those of I²C, which are told by their bus address.
    #[must_use]
    pub const fn port_mode(self) -> Option<PortMode> {
        match self {
            Self::Touch => Some(PortMode::Ev3Analog),
            Self::Colour | Self::Ultrasonic | Self::Gyro | Self::Infrared => {
                Some(PortMode::Ev3Uart)
            }
            Self::NxtTouch | Self::NxtLight | Self::NxtSound | Self::NxtAnalog => {
                Some(PortMode::NxtAnalog)
            }
            _ => None,
        }
    }

    /// What people call the device; for those without a type of their own, the driver's name.
    #[must_use]
    pub const fn what(self) -> &'static str {
        match self {
            Self::Touch => "touch sensor",
            Self::Colour => "colour sensor",
            Self::Ultrasonic => "ultrasonic sensor",
            Self::Gyro => "gyro sensor",
            Self::Infrared => "infrared sensor",
            other => other.as_str(),
        }
    }
}
