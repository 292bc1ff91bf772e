//! The UART without interrupts.

use embedded_io::{ErrorType, Read, ReadReady, Write, WriteReady};

use super::{Config, ERRORS, Error};
use crate::gpio::{PD0, PD1};
use crate::pac::USART0;
use crate::usart0::{DOR, RXC, RXEN, TXC, TXEN, UDRE, Usart};

/// USART0 on RXD and TXD, asked and waited for.
pub struct Uart {
    tx: UartTx,
    rx: UartRx,
}

/// The transmitter of a [`Uart`].
pub struct UartTx {
    u2x: u8,
    /// Whether a character was written: TXC is not set before (DS 20.11.2).
    has_sent: bool,
}

/// The receiver of a [`Uart`].
pub struct UartRx {
    /// The character whose overrun was told.
    kept: Option<u8>,
}

impl Uart {
    /// Sets the UART up. The peripherals are taken so that nobody else has them.
    pub fn new(_: USART0, _: PD0, _: PD1, config: Config) -> Self {
        config.apply();
        Usart::control(RXEN | TXEN);
        Self {
            tx: UartTx {
                u2x: config.u2x(),
                has_sent: false,
            },
            rx: UartRx { kept: None },
        }
    }

    /// Transmitter and receiver apart.
    pub fn split(self) -> (UartTx, UartRx) {
        (self.tx, self.rx)
    }
}

both!(Uart);

impl ErrorType for UartTx {
    type Error = Error;
}

impl ErrorType for UartRx {
    type Error = Error;
}

/// Blocks until the first byte has come, and takes what is there: two characters at most.
impl Read for UartRx {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Error> {
        let mut count = 0;
        for byte in bytes {
            if count > 0 && !self.read_ready()? {
                break;
            }
            if let Some(kept) = self.kept.take() {
                *byte = kept;
                count += 1;
                continue;
            }
            let status = loop {
                let status = Usart::status();
                if status & RXC != 0 {
                    break status;
                }
            };
            if count > 0 && status & ERRORS != 0 {
                // It is told by the next call: reading would take it from the chip.
                break;
            }
            let character = Usart::take();
            if let Some(error) = Error::of(status & ERRORS) {
                // An overrun is told with the character behind the gap (DS 20.7.4), which is good if it has no other error.
                if status & ERRORS == DOR {
                    self.kept = Some(character);
                }
                return Err(error);
            }
            *byte = character;
            count += 1;
        }
        Ok(count)
    }
}

impl ReadReady for UartRx {
    fn read_ready(&mut self) -> Result<bool, Error> {
        Ok(self.kept.is_some() || Usart::status() & RXC != 0)
    }
}

/// Blocks until one byte has room in the chip, and writes as many as have.
impl Write for UartTx {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        let mut count = 0;
        for &byte in bytes {
            if count > 0 && !self.write_ready()? {
                break;
            }
            while !self.write_ready()? {}
            critical_section::with(|_| {
                // Behind the character, so that the end of the one before is cleared too; at once, so that its own is not.
                Usart::put(byte);
                Usart::clear_sent(self.u2x);
            });
            self.has_sent = true;
            count += 1;
        }
        Ok(count)
    }

    /// Blocks until the last stop bit has left.
    fn flush(&mut self) -> Result<(), Error> {
        while self.has_sent && Usart::status() & TXC == 0 {}
        Ok(())
    }
}

impl WriteReady for UartTx {
    fn write_ready(&mut self) -> Result<bool, Error> {
        Ok(Usart::status() & UDRE != 0)
    }
}
