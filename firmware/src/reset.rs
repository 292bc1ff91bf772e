//! Why a board has started.

use multidrop_protocol::server::Counted;

/// Why the board has started, as it was found when it did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ResetCause {
    /// The supply was switched on.
    Power = 1,
    /// The supply fell below the brown-out level.
    BrownOut = 2,
    /// The watchdog was not fed.
    Watchdog = 3,
    /// The reset pin.
    Pin = 4,
    /// A panic, a fault of the CPU, or an interrupt that nobody handles.
    Fault = 5,
    /// None of these: a debugger, or a boot loader that has cleared what it read and told nobody.
    Other = 6,
}

impl ResetCause {
    /// The one with this number; [`ResetCause::Other`] for a number that none has.
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

    /// Its name, in lower case.
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

    /// Puts its number into the diagnostic register, which function 08, sub-function 02, tells (APP 6.8.1).
    pub fn tell<const LOG: usize>(self, counted: &Counted<LOG>) {
        counted.set_diagnostic_register(self as u16);
    }
}
