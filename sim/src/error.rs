//! What can go wrong when a bus is put together.

use std::path::PathBuf;

/// Why a node could not be put on the bus or a symbol was not found.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BusError {
    /// The firmware image cannot be read.
    #[error("cannot read the firmware image {path}: {source}")]
    Read {
        /// The image asked for.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not an ELF image.
    #[error("{path} is not an ELF image: {reason}")]
    NotElf {
        /// The image asked for.
        path: PathBuf,
        /// What the ELF reader said.
        reason: String,
    },
    /// The image is for another processor.
    #[error("{path} is not for the ATmega328P: {found}")]
    WrongMcu {
        /// The image asked for.
        path: PathBuf,
        /// What it is for.
        found: String,
    },
    /// The image does not fit.
    #[error("{path} does not fit the ATmega328P: it reaches {end:#x} in {memory}")]
    TooLarge {
        /// The image asked for.
        path: PathBuf,
        /// `flash` or `EEPROM`.
        memory: &'static str,
        /// One past its last byte.
        end: u64,
    },
    /// simavr does not know the ATmega328P (it was built without that core).
    #[error("this simavr was built without the ATmega328P")]
    NoCore,
    /// The clock is outside 1 Hz ..= 20 MHz.
    #[error("a clock of {0} Hz is outside 1 Hz ..= 20 MHz")]
    Clock(u32),
    /// An STM32 does not start.
    #[error("the STM32 does not start: {reason}")]
    Machine {
        /// What went wrong.
        reason: String,
    },
    /// A machine has stopped while the bus ran: its process has died, or hangs.
    #[error("the STM32 has stopped: {reason}")]
    Stopped {
        /// What went wrong.
        reason: String,
    },
    /// No such symbol in the image.
    #[error("the image has no symbol {0}")]
    NoSymbol(String),
}
