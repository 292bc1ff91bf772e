//! USART0 as a plain UART: bytes out and bytes in, with the traits of `embedded-io` and `embedded-io-async`.
//!
//! | type | waits by | reads and writes |
//! |---|---|---|
//! | [`Uart`], [`UartTx`], [`UartRx`] | asking the chip, awake, no interrupt | `embedded_io`: two characters have room in the chip (DS 20.7) |
//! | [`BufferedUart`], [`BufferedUartTx`], [`BufferedUartRx`] | interrupts, asleep | `embedded_io_async` and `embedded_io`: buffers of 1 to 255 bytes in each direction |
//!
//! The buffered one takes the token of [`bind_interrupts!`](crate::bind_interrupts) with `UART;`, which binds the interrupts that the
//! Modbus line has otherwise: a binary with both does not compile. It is woken through [`executor::run`](crate::executor::run()), which has
//! to be the one that runs its tasks. Its receive interrupt has to come within the time of two characters, 174 us at 115200 baud: what
//! keeps interrupts off for longer loses characters, which is told as [`Error::Overrun`].
//!
//! # Errors
//! [`Error`]s are told where they are in the stream of bytes: what came before is read first, then the error once, then what came
//! behind it. Errors that come before the first one is told are told with it. A damaged character is not given out.
//!
//! # Full duplex
//! There is no DE: both directions run at a time. [`flush`](embedded_io::Write::flush) returns when the last stop bit has left.

/// Implements the traits of `embedded-io` for a UART by its parts `tx` and `rx`.
macro_rules! both {
    ($name:ident) => {
        impl embedded_io::ErrorType for $name {
            type Error = Error;
        }

        impl embedded_io::Read for $name {
            fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Error> {
                embedded_io::Read::read(&mut self.rx, bytes)
            }
        }

        impl embedded_io::ReadReady for $name {
            fn read_ready(&mut self) -> Result<bool, Error> {
                self.rx.read_ready()
            }
        }

        impl embedded_io::Write for $name {
            fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
                embedded_io::Write::write(&mut self.tx, bytes)
            }

            fn flush(&mut self) -> Result<(), Error> {
                embedded_io::Write::flush(&mut self.tx)
            }
        }

        impl embedded_io::WriteReady for $name {
            fn write_ready(&mut self) -> Result<bool, Error> {
                self.tx.write_ready()
            }
        }
    };
}

mod blocking;
mod buffered;
mod ring;

pub use blocking::{Uart, UartRx, UartTx};
pub use buffered::{Bound, BufferedUart, BufferedUartRx, BufferedUartTx, Interrupts};
pub use multidrop_protocol::baud::BaudError;
pub use multidrop_protocol::format::LineFormat;

use crate::baud::{Divisor, divisor};
use crate::gpio::hold_rxd_high;
use crate::usart0::{DOR, FE, U2X, UPE, Usart, ucsrc};

/// An error of reception. The peer or the wire is to blame, but for [`Overrun`](Self::Overrun), where the reader is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error {
    /// Characters were lost: they were read too late.
    Overrun,
    /// A character had no stop bit where it should be: another rate or format, a break, or damage.
    Framing,
    /// A character had the wrong parity bit.
    Parity,
}

impl core::fmt::Display for Error {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Error::Overrun => "characters were lost",
            Error::Framing => "no stop bit",
            Error::Parity => "wrong parity",
        })
    }
}

impl core::error::Error for Error {}

/// A damaged character is [`InvalidData`](embedded_io::ErrorKind::InvalidData), a lost one [`Other`](embedded_io::ErrorKind::Other).
impl embedded_io::Error for Error {
    fn kind(&self) -> embedded_io::ErrorKind {
        match self {
            Error::Overrun => embedded_io::ErrorKind::Other,
            Error::Framing | Error::Parity => embedded_io::ErrorKind::InvalidData,
        }
    }
}

/// The error bits of UCSR0A (DS 20.11.2).
const ERRORS: u8 = FE | DOR | UPE;

impl Error {
    /// Returns the gravest error among these bits: an overrun, else a framing error, else a parity error.
    fn of(bits: u8) -> Option<Self> {
        if bits & DOR != 0 {
            Some(Error::Overrun)
        } else if bits & FE != 0 {
            Some(Error::Framing)
        } else if bits & UPE != 0 {
            Some(Error::Parity)
        } else {
            None
        }
    }
}

/// Baud rate and format, as register contents. Made in a `const`, a rate that the clock does not make stops the build.
///
/// ```text
/// const CONFIG: Config = Config::fixed(16_000_000, 115_200, LineFormat::F8N1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    divisor: Divisor,
    ucsrc: u8,
}

impl Config {
    /// `baud` from a CPU clock of `clock_hz` (1 to 20 MHz), with this format.
    ///
    /// # Errors
    /// [`BaudError`], with the nearest rate, for one that is off by more than 2.5 % or faster than a sixteenth of the clock.
    pub const fn new(clock_hz: u32, baud: u32, format: LineFormat) -> Result<Self, BaudError> {
        match divisor(clock_hz, baud) {
            Ok(divisor) => Ok(Self {
                divisor,
                ucsrc: ucsrc(format),
            }),
            Err(error) => Err(error),
        }
    }

    /// [`new`](Self::new) for a `const`.
    ///
    /// # Panics
    /// At compile time, with both rates, where `new` has an error.
    pub const fn fixed(clock_hz: u32, baud: u32, format: LineFormat) -> Self {
        match Self::new(clock_hz, baud, format) {
            Ok(config) => config,
            Err(error) => multidrop_protocol::message::Message::new()
                .text("baud is ")
                .number(error.baud)
                .text(", the clock does not make it within 2.5 %, nearest is ")
                .number(error.nearest)
                .fail(),
        }
    }

    /// U2X, or 0: what UCSR0A keeps.
    const fn u2x(&self) -> u8 {
        if self.divisor.u2x { U2X } else { 0 }
    }

    /// Baud rate and format; the order is that of DS 20.5. RXD gets its pull-up, which stays the port's with RXEN on (DS 14.3.3, RXD).
    fn apply(&self) {
        hold_rxd_high();
        // SAFETY: `divisor` makes 12 bits, `ucsrc` what is not reserved.
        unsafe {
            Usart::block().ubrr0().write(|w| w.bits(self.divisor.ubrr));
            Usart::block().ucsr0a().write(|w| w.bits(self.u2x()));
            Usart::block().ucsr0c().write(|w| w.bits(self.ucsrc));
        }
    }
}
