//! What a port is set to, and what its settings may be.

use super::value::*;
use super::{Reason, Register};
use crate::format::{Framing, LineFormat};

macro_rules! settings {
    (
        typed {
            port { $(
                $(#[$doc:meta])*
                $number:literal $NAME:ident $register:ident: $type:ident
                    $(in $low:literal ..= $high:literal)? $(of $choices:literal)? => $field:ident = $default:expr;
            )* }
            line { $(
                $(#[$line_doc:meta])*
                $line_number:literal $LINE_NAME:ident $line_register:ident: $line_type:ident
                    $(in $line_low:literal ..= $line_high:literal)? $(of $line_choices:literal)?
                    => $line_field:ident = $line_default:expr;
            )* }
            $($others:tt)*
        }
        untyped $untyped:tt
    ) => {
        /// The line of a port.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub struct LineSettings {
            $( $(#[$line_doc])* pub $line_field: $line_type, )*
        }

        /// The settings with which the registers of a port begin.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub struct PortSettings {
            $( $(#[$doc])* pub $field: $type, )*
            /// The settings of the line.
            pub line: LineSettings,
        }

        impl PortSettings {
            /// A slave with id 1 at 19200 baud 8E1, the standard's default (SER 2.5.1); as a master a timeout of one second, no
            /// retries, and 100 ms after a broadcast (SER 2.4.1).
            pub const DEFAULT: PortSettings = PortSettings {
                $( $field: $default, )*
                line: LineSettings { $( $line_field: $line_default, )* },
            };

            /// Sets what this register is to a number in its range; `false` where only a few are values and it is none of them, or
            /// where the register is no setting.
            #[inline(always)]
            fn set(&mut self, register: Register, number: u32) -> bool {
                match register {
                    $( Register::$register => assign(&mut self.$field, number), )*
                    $( Register::$line_register => assign(&mut self.line.$line_field, number), )*
                    _ => false,
                }
            }

            /// Reads a register that is a setting; 0 for others.
            #[inline(never)]
            pub(super) fn read(&self, register: Register) -> u32 {
                match register {
                    $( Register::$register => self.$field.number(), )*
                    $( Register::$line_register => self.line.$line_field.number(), )*
                    _ => 0,
                }
            }
        }

        impl Register {
            /// Whether it is a setting of the line.
            pub(super) const fn is_of_line(self) -> bool {
                matches!(self, $( Register::$line_register )|*)
            }
        }
    };
}

port_registers!(settings);

/// SLAVEID of a slave: 0 is for broadcasts (SER 2.2).
const SLAVES: (u32, u32) = (1, Register::SlaveId.highest());

fn assign<T: Number>(place: &mut T, number: u32) -> bool {
    match T::from_number(number) {
        Some(value) => {
            *place = value;
            true
        }
        None => false,
    }
}

impl PortSettings {
    /// The lowest and the highest number that a register takes as all else is set; `None` for one that takes none, or one of a few.
    pub const fn range(&self, register: Register) -> Option<(u32, u32)> {
        match register {
            Register::SlaveId if matches!(self.mode, Mode::Slave) => Some(SLAVES),
            _ => register.range(),
        }
    }

    /// What of all this cannot be together; `None` if it can.
    pub const fn conflict(&self) -> Option<Reason> {
        let line = &self.line;
        if self.mode.talks() && matches!(line.framing, Framing::Text) {
            Some(Reason::Text)
        } else if matches!(self.mode, Mode::Slave) && self.slave_id == 0 {
            Some(Reason::SlaveZero)
        } else if matches!(line.framing, Framing::Rtu) && line.format.data_bits() != 8 {
            Some(Reason::SevenBits)
        } else {
            None
        }
    }

    /// What is wrong with a number that a register does not take.
    pub(super) fn wrong(&self, register: Register) -> Reason {
        if register == Register::SlaveId && self.mode == Mode::Slave {
            Reason::Range(SLAVES.0, SLAVES.1)
        } else {
            Reason::Value
        }
    }

    /// Loads a register that is a setting, with a number in its range; `line` says whether the chip can do what concerns the line.
    ///
    /// # Errors
    ///
    /// Why it keeps its value.
    #[inline(never)]
    pub(super) fn load(
        &mut self,
        register: Register,
        number: u32,
        line: &dyn Fn(&LineSettings) -> Result<(), Reason>,
    ) -> Result<(), Reason> {
        let mut new = *self;
        if !new.set(register, number) {
            return Err(match (register, number) {
                (Register::Mode, 4) => Reason::NotYet,
                _ => Reason::Value,
            });
        }
        match new.conflict() {
            Some(Reason::SlaveZero) if register == Register::SlaveId => {
                return Err(self.wrong(register));
            }
            Some(reason) => return Err(reason),
            None => {}
        }
        if register.is_of_line() {
            line(&new.line)?;
        }
        *self = new;
        Ok(())
    }
}

/// STATUS: how the transaction under way stands, or how the last one ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Status {
    /// None is under way; the last one ended well, or with an exception: see ERROR.
    Idle = 0,
    /// The request is being sent, or waits for a silence.
    Transmitting = 1,
    /// The answer is being waited for.
    Receiving = 2,
    /// An answer with another function code was the last thing heard before the timeout.
    WrongFunction = 3,
    /// An answer from another slave was.
    WrongSlave = 4,
    /// A damaged frame was.
    WrongCrc = 5,
    /// Nothing of the kind was heard.
    Timeout = 6,
    /// The request cannot be made: a read from slave id 0.
    InvalidRequest = 7,
}
