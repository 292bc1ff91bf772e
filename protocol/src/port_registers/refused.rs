//! Why a register keeps its value.

use core::fmt;

use super::register::Register;
use crate::UNIT_MAX;
use crate::format::Framing;

/// A value that a register does not accept; nothing was changed. The message names the register, the value and the values that are
/// accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Refused {
    /// The register with the wrong value; for START the register that prevents it.
    pub register: Register,
    /// The value that was refused.
    pub value: u32,
    /// The reason of the refusal.
    pub reason: Reason,
}

/// The reason of a refusal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Reason {
    /// The register does not accept the value: see [`Register::range`] and [`Register::choices`].
    Value,
    /// With the other settings, the value must be in this range, both ends included.
    Range(u32, u32),
    /// The mode is not in this version.
    NotYet,
    /// The register is read only.
    ReadOnly,
    /// The array, or the list of rules, has this number of elements.
    Index(u32),
    /// The array has this number of items, which must fit between the first address and 65535.
    Base(u32),
    /// For this function the value must be 1 to this number.
    Count(u8, u16),
    /// The number of items in the request, and the number in the array, which is smaller.
    Beyond(u16, u32),
    /// The last address would be above 65535 with this BASE and this number of items.
    Address(u16, u16),
    /// The port has no coils for this function.
    NoCoils,
    /// A slave cannot have slave id 0.
    SlaveZero,
    /// Seven data bits are for ASCII.
    SevenBits,
    /// Framing text is for a sniffer.
    Text,
    /// The clock does not make this rate within 2.5 %; the nearest it does make.
    Baud(u32),
    /// The chip does not have it.
    Chip,
    /// The line was built without a sniffer.
    NoSniffer,
    /// The line was built without this framing.
    Framing(Framing),
    /// t3.5, or the gap that ends a frame, would be longer than the line was built to count.
    Silence,
    /// It is not how the port is wired.
    Wiring,
    /// A transaction is under way.
    Running,
    /// Only a master starts transactions.
    NotMaster,
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Refused {
            register, value, ..
        } = *self;
        match self.reason {
            Reason::Index(0) => return write!(f, "{register} does not exist, there is none"),
            Reason::Index(len) => {
                let (name, last) = (register.name(), len - 1);
                return write!(f, "{register} does not exist, must be {name}.0..={last}");
            }
            Reason::ReadOnly => return write!(f, "{register} is read only"),
            Reason::Running => {
                return write!(f, "{register} is 1, must wait: a transaction is under way");
            }
            _ => write!(f, "{register} is {value}, ")?,
        }
        match self.reason {
            Reason::Value => match register.choices() {
                Some(choices) => write!(f, "must be {choices}"),
                None => {
                    let (low, high) = register.range().unwrap_or_default();
                    write!(f, "must be {low}..={high}")
                }
            },
            Reason::Range(low, high) => write!(f, "must be {low}..={high}"),
            Reason::NotYet => write!(
                f,
                "which is not in this version, must be {}",
                register.choices().unwrap_or_default()
            ),
            Reason::Base(len) => write!(
                f,
                "must be 0..={}: there are {len} items behind it",
                65_536 - len
            ),
            Reason::Count(function, 1) => write!(f, "must be 1 with FUNC {function}"),
            Reason::Count(function, max) => write!(f, "must be 1..={max} with FUNC {function}"),
            Reason::Beyond(count, len) => match len.checked_sub(count.into()) {
                Some(last) => write!(
                    f,
                    "must be 0..={last} for {count} items: the array has {len}"
                ),
                None => write!(
                    f,
                    "which with {count} items is too much: the array has {len}"
                ),
            },
            Reason::Address(base, count) => write!(
                f,
                "must be 0..={} with BASE {base} and {count} items",
                (65_536 - u32::from(count)).saturating_sub(base.into())
            ),
            Reason::NoCoils => write!(f, "must be 3, 4, 6, 16 or 23: the port has no coils"),
            Reason::SlaveZero => match register {
                Register::Mode => write!(f, "but SLAVEID is 0, must be 1..={UNIT_MAX} first"),
                _ => write!(f, "must be 1..={UNIT_MAX} for a slave"),
            },
            Reason::SevenBits => match register {
                Register::Framing => write!(f, "but FORMAT has 7 data bits, must have 8 for RTU"),
                _ => write!(f, "must be 8N1 (0), 8E1 (1), 8O1 (2) or 8N2 (3) for RTU"),
            },
            Reason::Text => match register {
                Register::Mode => {
                    write!(
                        f,
                        "but FRAMING is 2 (text), must be 0 (RTU) or 1 (ASCII) first"
                    )
                }
                _ => write!(f, "must be 0 (RTU) or 1 (ASCII) for a master or a slave"),
            },
            Reason::Baud(nearest) => write!(
                f,
                "the clock does not make it within 2.5 %, nearest is {nearest}"
            ),
            Reason::Chip => write!(f, "the chip does not have it"),
            Reason::Framing(Framing::Rtu) => write!(f, "the line was built without RTU"),
            Reason::Framing(Framing::Ascii) => write!(f, "the line was built without ASCII"),
            Reason::NoSniffer => write!(f, "the line was built without a sniffer"),
            Reason::Framing(Framing::Text) => write!(f, "the line was built without text"),
            Reason::Silence => write!(f, "the line was built without silences of that length"),
            Reason::Wiring => write!(f, "must be {}: the port is wired so", 1 - value.min(1)),
            Reason::NotMaster => write!(f, "must be 0 (master) for START"),
            Reason::Index(_) | Reason::ReadOnly | Reason::Running => Ok(()),
        }
    }
}

impl core::error::Error for Refused {}
