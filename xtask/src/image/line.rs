//! The baud rates and formats for which a board can be built.

use super::{Board, Format, NANO_HZ, Options, STM32_USART_HZ, word};
use crate::error::Error;
use multidrop_protocol::baud::{atmega, stm32};

/// The slowest rate that some board's clock makes and its timer counts, and the fastest rate of the Nano's receive
/// interrupt. The build checks whether the Nano's timer counts a rate below 600.
const BAUD_MIN: u32 = 300;
const NANO_BAUD_MAX: u32 = 1_000_000;

/// The baud rate of the applications by default.
pub const DEFAULT_BAUD: u32 = 38_400;

pub(super) fn check_baud(board: Board, options: &Options) -> Result<(), Error> {
    let baud = options.baud.unwrap_or(DEFAULT_BAUD);
    let (clock_hz, max) = match board {
        Board::Nano => (options.clock.unwrap_or(NANO_HZ), NANO_BAUD_MAX),
        Board::Stm32 => (STM32_USART_HZ, stm32::MAX_BAUD),
    };
    if !(BAUD_MIN..=max).contains(&baud) {
        return Err(Error::usage(format!(
            "--baud {baud}: must be {BAUD_MIN}..={max}"
        )));
    }
    let nearest = match board {
        Board::Nano => atmega::divisor(clock_hz, baud)
            .err()
            .map(|error| error.nearest),
        Board::Stm32 => stm32::divisor(clock_hz, baud)
            .err()
            .map(|error| error.nearest),
    };
    if board == Board::Nano {
        let bits = match options.format {
            Some(Format::Bits8Even1 | Format::Bits8Odd1 | Format::Bits8None2) => 11,
            _ => 10,
        };
        let slowest = atmega::slowest(clock_hz, bits, options.ascii);
        if baud < slowest {
            return Err(Error::usage(format!(
                "--baud {baud}: a character is too long for Timer1 at {clock_hz} Hz; the slowest rate is {slowest}"
            )));
        }
    }
    match nearest {
        None => Ok(()),
        Some(nearest) => Err(Error::usage(format!(
            "--baud {baud}: a clock of {clock_hz} Hz cannot make it within 2.5 %; the nearest rate \
             it makes is {nearest}"
        ))),
    }
}

pub(super) fn check_rtu_format(format: Format, has_ascii: bool) -> Result<(), Error> {
    match format {
        Format::Bits8None1 | Format::Bits8Even1 | Format::Bits8Odd1 | Format::Bits8None2 => Ok(()),
        Format::Bits7Even1 | Format::Bits7Odd1 | Format::Bits7None2 => Err(Error::usage(format!(
            "--format {}: RTU sends bytes and needs 8 data bits, 7 are for ASCII{}. The formats for \
             RTU are: 8N1, 8E1, 8O1, 8N2",
            word(format),
            if has_ascii { ", --ascii" } else { "" }
        ))),
    }
}
