//! The cause of a board's last reset, for the diagnostic register.

use super::Counted;

/// Why the board was reset, as it found at the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ResetCause {
    /// The supply was switched on.
    Power = 1,
    /// The supply fell below the brown-out level.
    BrownOut = 2,
    /// The watchdog was not fed.
    Watchdog = 3,
    /// The reset pin was pulled low.
    Pin = 4,
    /// A panic, a fault of the CPU, or an interrupt without a handler.
    Fault = 5,
    /// Another cause, such as a debugger, or a boot loader that has cleared the flags and passed on nothing.
    Other = 6,
}

impl ResetCause {
    /// The cause with this number; [`ResetCause::Other`] for any other number.
    pub const fn from_number(number: u8) -> Self {
        match number {
            1 => Self::Power,
            2 => Self::BrownOut,
            3 => Self::Watchdog,
            4 => Self::Pin,
            5 => Self::Fault,
            _ => Self::Other,
        }
    }

    /// The name of the cause, in lower case.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Power => "power",
            Self::BrownOut => "brown-out",
            Self::Watchdog => "watchdog",
            Self::Pin => "pin",
            Self::Fault => "fault",
            Self::Other => "other",
        }
    }

    /// Puts the number of the cause into the diagnostic register, which function 08, sub-function 02 returns (APP
    /// 6.8.1).
    pub fn report<const LOG: usize>(self, counted: &Counted<LOG>) {
        counted.set_diagnostic_register(self as u16);
    }
}
