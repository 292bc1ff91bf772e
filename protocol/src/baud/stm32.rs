//! The divider of the STM32F405's USARTs.
//!
//! Source: RM0090 30.3.4, `baud = clock / (8 * (2 - OVER8) * USARTDIV)`. USARTDIV has four fractional bits, or three with OVER8:
//! either way the divider counts whole clock cycles per bit.

use super::{BaudError, MAX_ERROR_PPM, error_ppm, is_within, nearest_divider, rate};

/// The fastest rate: a character of 10 bits then leaves 840 cycles at 168 MHz for the interrupts of four
/// ports, and one takes some 100. The USARTs alone would do 10.5 and 5.25 Mbaud.
pub const MAX_BAUD: u32 = 2_000_000;

/// The largest value of the 16-bit divider register BRR (RM0090 30.6.3).
const MAX_CYCLES: u32 = 0xFFFF;

/// The fewest clock cycles per bit: with OVER8, USARTDIV 1 (RM0090 30.3.4).
const MIN_CYCLES: u32 = 8;

/// Contents of BRR and OVER8 for one baud rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Divisor {
    /// Value for BRR.
    pub brr: u16,
    /// Whether OVER8 is set: 8 samples a bit in place of 16.
    pub over8: bool,
}

impl Divisor {
    const fn new(cycles: u32) -> Self {
        if cycles >= 16 {
            Self {
                brr: cycles as u16,
                over8: false,
            }
        } else {
            // Bit 3 stays clear with OVER8 (RM0090 30.6.3).
            Self {
                brr: ((cycles & !7) << 1 | (cycles & 7)) as u16,
                over8: true,
            }
        }
    }

    /// Clock cycles in one bit, 8..=65535.
    pub const fn cycles_per_bit(self) -> u32 {
        let brr = self.brr as u32;
        if self.over8 {
            (brr & !0xF) >> 1 | (brr & 7)
        } else {
            brr
        }
    }

    /// Distance between the rate made and the rate wanted, in parts per million of the rate wanted.
    pub const fn error_ppm(self, clock_hz: u32, baud: u32) -> u32 {
        error_ppm(clock_hz, self.cycles_per_bit(), baud)
    }

    /// Whether the rate is within [`MAX_ERROR_PPM`] if the clock itself may be off by `clock_ppm`.
    ///
    /// # Errors
    /// [`BaudError`] with the nearest rate that the divider makes exactly.
    pub const fn check(self, clock_hz: u32, baud: u32, clock_ppm: u32) -> Result<(), BaudError> {
        if self.error_ppm(clock_hz, baud) + clock_ppm <= MAX_ERROR_PPM {
            return Ok(());
        }
        Err(BaudError {
            baud,
            nearest: rate(clock_hz, self.cycles_per_bit()),
        })
    }
}

/// The divisor for `baud` from a USART's clock of `clock_hz` (up to 100 MHz), rounded to the nearest.
///
/// Sixteen samples a bit where the clock has them, since that receiver tolerates more; eight where it has
/// not.
///
/// # Errors
/// [`BaudError`] with the nearest rate if the result is more than 2.5 % off, or over [`MAX_BAUD`].
pub const fn divisor(clock_hz: u32, baud: u32) -> Result<Divisor, BaudError> {
    let slowest = clock_hz.div_ceil(MAX_CYCLES);
    let fastest = if clock_hz / MIN_CYCLES < MAX_BAUD {
        clock_hz / MIN_CYCLES
    } else {
        MAX_BAUD
    };
    if baud > fastest {
        return Err(BaudError {
            baud,
            nearest: fastest,
        });
    }
    if baud < slowest {
        return Err(BaudError {
            baud,
            nearest: slowest,
        });
    }
    let cycles = nearest_divider(clock_hz, 1, baud);
    if !is_within(clock_hz, cycles, baud) {
        return Err(BaudError {
            baud,
            nearest: rate(clock_hz, cycles),
        });
    }
    Ok(Divisor::new(cycles))
}

#[cfg(test)]
mod tests {
    use super::*;

    const APB1: u32 = 42_000_000;
    const APB2: u32 = 84_000_000;

    #[test]
    fn an_oscillator_of_1_percent_leaves_1_5_for_the_divider() {
        // 42 MHz / 22 is 2.1 % off 1.95 Mbaud, / 25 is 1.5 % off 1.655 Mbaud, / 1094 next to nothing off 38400.
        for (baud, with_internal) in [(1_950_000, false), (1_655_200, true), (38_400, true)] {
            let divisor = divisor(42_000_000, baud).unwrap();
            assert_eq!(divisor.check(42_000_000, baud, 0), Ok(()));
            let checked = divisor.check(42_000_000, baud, 10_000);
            assert_eq!(checked.is_ok(), with_internal, "{baud}");
        }
        let nearest = divisor(42_000_000, 1_950_000).unwrap();
        let refused = nearest.check(42_000_000, 1_950_000, 10_000);
        assert_eq!(
            refused,
            Err(BaudError {
                baud: 1_950_000,
                nearest: 1_909_091
            })
        );
    }

    #[test]
    fn usual_rates_are_those_of_the_reference_manual() {
        // RM0090 30.3.4, the tables for fPCLK 42 and 84 MHz, USARTDIV times 16; 2 Mbaud are worked by hand.
        let expected = [
            (APB1, 2_400, 17_500),
            (APB1, 9_600, 4_375),
            (APB1, 19_200, 2_188),
            (APB1, 38_400, 1_094),
            (APB1, 115_200, 365),
            (APB1, 2_000_000, 21),
            (APB2, 9_600, 8_750),
            (APB2, 38_400, 2_188),
            (APB2, 115_200, 729),
            (APB2, 2_000_000, 42),
        ];
        for (clock_hz, baud, brr) in expected {
            let made = Divisor { brr, over8: false };
            assert_eq!(divisor(clock_hz, baud), Ok(made), "{baud} baud");
        }
    }

    #[test]
    fn eight_samples_where_there_are_no_sixteen_cycles() {
        let made = divisor(16_000_000, 1_200_000).unwrap_err();
        assert_eq!(made.nearest, 1_230_769);
        // 13 cycles: USARTDIV 1.625, mantissa 1, fraction 5.
        let made = divisor(16_000_000, 1_230_769).unwrap();
        assert_eq!((made.brr, made.over8), (0x15, true));
        assert_eq!(made.cycles_per_bit(), 13);
        let made = divisor(16_000_000, 2_000_000).unwrap();
        assert_eq!((made.brr, made.over8), (0x10, true));
    }

    #[test]
    fn rates_out_of_reach_are_refused_with_the_nearest() {
        let nearest = |clock_hz, baud| divisor(clock_hz, baud).unwrap_err().nearest;
        assert_eq!(nearest(APB2, 0), 1_282);
        assert_eq!(nearest(APB2, 1_281), 1_282);
        assert_eq!(nearest(APB1, 300), 641);
        assert_eq!(nearest(APB1, 2_000_001), 2_000_000);
        assert_eq!(nearest(8_000_000, u32::MAX), 1_000_000);
        assert_eq!(divisor(APB2, 1_282).map(|made| made.brr), Ok(65_523));
    }

    #[test]
    fn every_rate_that_is_accepted_is_within_the_limit() {
        for clock_hz in [8_000_000, 16_000_000, APB1, APB2, 100_000_000] {
            for baud in (100..=MAX_BAUD).step_by(37) {
                match divisor(clock_hz, baud) {
                    Ok(made) => {
                        assert!(made.error_ppm(clock_hz, baud) <= MAX_ERROR_PPM);
                        assert_eq!(made.over8, made.cycles_per_bit() < 16);
                    }
                    Err(error) => {
                        assert!(
                            divisor(clock_hz, error.nearest).is_ok(),
                            "{clock_hz} {baud}"
                        )
                    }
                }
            }
        }
    }
}
