//! The types of values, and the numbers that they are on the wire.

use super::Register;
use crate::format::{Framing, LineFormat};

/// What a port does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Mode {
    /// It asks: client.
    Master = 0,
    /// It answers: server.
    Slave = 1,
    /// It does neither, and leaves the bus alone.
    Off = 2,
    /// It listens to others, or with framing text prints what another port hears; it never asks or answers.
    Sniffer = 3,
}

/// How the wires of a port are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Duplex {
    /// One pair for both directions: the driver is enabled (DE) only while the port talks. RS-485.
    Half = 0,
    /// A pair for each direction, and no driver to enable. RS-232, RS-422.
    Full = 1,
}

/// Hardware flow control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Flow {
    /// No flow control.
    None = 0,
    /// RTS and CTS.
    RtsCts = 1,
}

/// What ends an RTU frame, and which gaps it may have inside (SER 2.5.1.1). ASCII has a rule of its own: up to a second
/// between characters (SER 2.5.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InterCharacter {
    /// The standard: a silence of t3.5 ends a frame; one with a gap of more than t1.5 is dropped and counted.
    Strict,
    /// A silence of t3.5, less [the margin for two clocks](crate::timing::margin), ends a frame, and shorter gaps do no harm.
    Off,
    /// A silence of this number of ms ends a frame, 2..=50, and shorter gaps do no harm: for peers behind USB adapters,
    /// which pause for 16 ms inside frames. Where t3.5 is longer, t3.5 ends it.
    Gap(u8),
}

impl InterCharacter {
    /// Bounds of [`Gap`](Self::Gap) in ms, both ends included.
    pub const GAP: (u32, u32) = (2, Register::InterCharacter.highest());
}

impl Mode {
    /// Whether it takes part in transactions, for which [`Framing::Text`] is of no use.
    pub const fn talks(self) -> bool {
        matches!(self, Mode::Master | Mode::Slave)
    }
}

macro_rules! values {
    (
        typed { $($section:ident { $(
            $(#[$doc:meta])*
            $number:literal $NAME:ident $register:ident $([$index:ident: $index_type:ident])?: $type:ident
                $(in $low:literal ..= $high:literal)? $(of $choices:literal)? $(=> $field:ident = $default:expr)?;
        )* })* }
        untyped $untyped:tt
    ) => {
        /// A register and a value of its type, to be loaded: `port.load(Value::Format(LineFormat::F8E1))`. Arrays have an index
        /// before it: `Value::Regs(3, 1234)`.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Value {
            $($( $(#[$doc])* $register($($index_type,)? $type), )*)*
        }

        impl Value {
            /// The register of the value.
            #[inline(always)]
            pub fn register(self) -> Register {
                match self {
                    $($( Value::$register($($index,)? _) => Register::$register $(($index))?, )*)*
                }
            }

            /// The number of the value on the wire.
            #[inline(always)]
            pub fn number(self) -> u32 {
                match self {
                    $($( Value::$register(.., value) => value.number(), )*)*
                }
            }
        }
    };
}

port_registers!(values);

/// The number of a register's value.
pub(super) trait Number: Sized {
    /// The value of a number in the register's range; `None` if the number stands for no value.
    fn from_number(number: u32) -> Option<Self>;

    /// The number of the value.
    fn number(self) -> u32;
}

macro_rules! integers {
    ($($type:ident)*) => { $(
        impl Number for $type {
            fn from_number(number: u32) -> Option<Self> {
                Some(number as $type)
            }

            fn number(self) -> u32 {
                self.into()
            }
        }
    )* };
}

integers! { u8 u16 u32 }

/// Enums, by the numbers of their variants.
macro_rules! choices {
    ($($type:ident { $($variant:ident)* })*) => { $(
        impl Number for $type {
            fn from_number(number: u32) -> Option<Self> {
                $( if number == $type::$variant as u32 {
                    return Some($type::$variant);
                } )*
                None
            }

            fn number(self) -> u32 {
                self as u32
            }
        }
    )* };
}

choices! {
    Mode { Master Slave Off Sniffer }
    Framing { Rtu Ascii Text }
    LineFormat { F8N1 F8E1 F8O1 F8N2 F7E1 F7O1 F7N2 }
    Duplex { Half Full }
    Flow { None RtsCts }
}

impl Number for bool {
    fn from_number(number: u32) -> Option<Self> {
        match number {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }

    fn number(self) -> u32 {
        self.into()
    }
}

impl Number for InterCharacter {
    fn from_number(number: u32) -> Option<Self> {
        Some(match number {
            0 => InterCharacter::Strict,
            1 => InterCharacter::Off,
            ms => InterCharacter::Gap(ms as u8),
        })
    }

    fn number(self) -> u32 {
        match self {
            InterCharacter::Strict => 0,
            InterCharacter::Off => 1,
            // Those are taken: a gap of 0 or 1 ms is refused, and not another rule.
            InterCharacter::Gap(0 | 1) => u32::MAX,
            InterCharacter::Gap(ms) => ms.into(),
        }
    }
}
