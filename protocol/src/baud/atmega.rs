//! The divider of the ATmega328P's USART.
//!
//! Source: ATmega328P data sheet (DS40002061B) section 20.3.1, table 20-1: `baud = clock / (m * (UBRR + 1))` with `m` = 16, or 8
//! with `U2X`.

use super::{BaudError, error_ppm, is_within, nearest_divider, rate};

/// The largest value of the 12-bit divider register UBRR0 (DS40002061B section 20.11.5).
const MAX_UBRR: u32 = 4095;

/// Contents of UBRR0 and U2X0 for one baud rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Divisor {
    /// Value for UBRR0, 0..=4095.
    pub ubrr: u16,
    /// Whether U2X0 is set: 8 samples a bit in place of 16.
    pub u2x: bool,
}

impl Divisor {
    /// Clock cycles in one bit, 8..=65536.
    pub const fn cycles_per_bit(self) -> u32 {
        (self.ubrr as u32 + 1) * if self.u2x { 8 } else { 16 }
    }

    /// The rate that this divisor makes from `clock_hz`, in baud, rounded to the nearest.
    pub const fn baud(self, clock_hz: u32) -> u32 {
        rate(clock_hz, self.cycles_per_bit())
    }

    /// Distance between the rate made and the rate wanted, in parts per million of the rate wanted.
    pub const fn error_ppm(self, clock_hz: u32, baud: u32) -> u32 {
        error_ppm(clock_hz, self.cycles_per_bit(), baud)
    }

    /// Clock cycles by which one second of bits at `baud` is missed; free of 64-bit arithmetic, so
    /// that a Nano can afford it.
    const fn cycles_off(self, clock_hz: u32, baud: u32) -> u32 {
        clock_hz.abs_diff(baud * self.cycles_per_bit())
    }
}

/// Clock cycles in one bit at the least: a character of 10 bits then leaves 160 cycles for the receive
/// interrupt, which takes 119. The USART alone would do twice that rate.
pub const MIN_CYCLES_PER_BIT: u32 = 16;

/// Ticks that the longest frame has at most: the turns of Timer1 in it are counted in a byte.
const FRAME_TICKS_MAX: u32 = 0xFF_FFFF;

/// The slowest rate, in baud, at which Timer1, at an eighth of `clock_hz`, counts a character of `character_bits` bits, and the longest frame,
/// with one more character, that takes it: 256 of them in RTU, 513 in ASCII.
pub const fn slowest(clock_hz: u32, character_bits: u32, is_ascii: bool) -> u32 {
    let characters = if is_ascii { 2 * 257 } else { 257 };
    (character_bits * (clock_hz / 8)).div_ceil(FRAME_TICKS_MAX / characters)
}

/// Largest rate that is considered: 1/8 of the fastest clock of the chip (20 MHz). Keeps
/// `baud * cycles_per_bit` of [`divisor`] within 32 bits.
const MAX_BAUD: u32 = 2_500_000;

/// The divisor for `baud` from a clock of `clock_hz` (1 MHz..=20 MHz), rounded to the nearest.
///
/// Normal speed is preferred, since its receiver takes 16 samples a bit; double speed is chosen only
/// where it comes closer.
///
/// # Errors
/// [`BaudError`] with the nearest rate if the result is more than 2.5 % off, or faster than a sixteenth of
/// the clock.
pub const fn divisor(clock_hz: u32, baud: u32) -> Result<Divisor, BaudError> {
    if baud == 0 {
        return Err(BaudError {
            baud,
            nearest: nearest(clock_hz, 16, 1).baud(clock_hz),
        });
    }
    let wanted = if baud > MAX_BAUD { MAX_BAUD } else { baud };
    let normal = nearest(clock_hz, 16, wanted);
    let double = nearest(clock_hz, 8, wanted);
    let best = if double.cycles_off(clock_hz, wanted) < normal.cycles_off(clock_hz, wanted) {
        double
    } else {
        normal
    };
    if best.cycles_per_bit() < MIN_CYCLES_PER_BIT {
        return Err(BaudError {
            baud,
            nearest: clock_hz / MIN_CYCLES_PER_BIT,
        });
    }
    if baud > MAX_BAUD || !is_within(clock_hz, best.cycles_per_bit(), wanted) {
        return Err(BaudError {
            baud,
            nearest: best.baud(clock_hz),
        });
    }
    Ok(best)
}

const fn nearest(clock_hz: u32, samples: u32, baud: u32) -> Divisor {
    let ubrr = match nearest_divider(clock_hz, samples, baud) {
        0 => 0,
        n if n > MAX_UBRR + 1 => MAX_UBRR,
        n => n - 1,
    };
    Divisor {
        ubrr: ubrr as u16,
        u2x: samples == 8,
    }
}

#[cfg(test)]
mod tests {
    use super::super::MAX_ERROR_PPM;
    use super::*;

    #[test]
    fn usual_rates_at_16_mhz_are_those_of_the_data_sheet() {
        // DS40002061B table 20-6.
        let expected = [
            (2_400, 416, false),
            (9_600, 103, false),
            (19_200, 51, false),
            (38_400, 25, false),
            (115_200, 16, true),
            (250_000, 3, false),
            (500_000, 1, false),
            (1_000_000, 0, false),
        ];
        for (baud, ubrr, u2x) in expected {
            let made = divisor(16_000_000, baud);
            // 2400 baud: 832 at double speed is nearer than 416 at normal speed.
            let wanted = if baud == 2_400 {
                Divisor {
                    ubrr: 832,
                    u2x: true,
                }
            } else {
                Divisor { ubrr, u2x }
            };
            assert_eq!(made, Ok(wanted), "{baud} baud");
        }
    }

    #[test]
    fn a_rate_off_by_more_than_two_and_a_half_percent_is_refused_with_the_nearest() {
        assert_eq!(
            divisor(16_000_000, 921_600),
            Err(BaudError {
                baud: 921_600,
                nearest: 1_000_000
            })
        );
        assert_eq!(divisor(16_000_000, 0).unwrap_err().baud, 0);
        assert_eq!(
            divisor(16_000_000, 3_000_000),
            Err(BaudError {
                baud: 3_000_000,
                nearest: 1_000_000
            })
        );
        assert_eq!(divisor(16_000_000, 100).unwrap_err().nearest, 244);
    }

    #[test]
    fn the_timer_counts_1200_baud_in_every_format_and_slower_ones_where_its_clock_is_slow() {
        for clock_hz in [8_000_000, 11_059_200, 16_000_000, 20_000_000] {
            for is_ascii in [false, true] {
                assert!(slowest(clock_hz, 11, is_ascii) <= 1_200);
            }
            assert!(slowest(clock_hz, 11, false) <= 600);
        }
        assert!(slowest(8_000_000, 11, false) <= 300);
        assert!(slowest(16_000_000, 10, false) > 300);
        // 10 * 2 MHz / 65280.
        assert_eq!(slowest(16_000_000, 10, false), 307);
    }

    #[test]
    fn a_crystal_for_serial_rates_is_exact() {
        let made = divisor(11_059_200, 115_200).unwrap();
        assert_eq!(
            (made.ubrr, made.u2x, made.error_ppm(11_059_200, 115_200)),
            (5, false, 0)
        );
        let late = divisor(16_000_000, 115_200).unwrap();
        assert_eq!(late.error_ppm(16_000_000, 115_200), 21_241);
    }

    #[test]
    fn every_rate_that_is_accepted_is_within_the_limit() {
        for clock_hz in [8_000_000, 11_059_200, 16_000_000, 20_000_000] {
            for baud in (300..=2_500_000).step_by(37) {
                if let Ok(made) = divisor(clock_hz, baud) {
                    assert!(
                        made.error_ppm(clock_hz, baud) <= MAX_ERROR_PPM,
                        "{clock_hz} {baud}"
                    );
                }
            }
        }
    }
}
