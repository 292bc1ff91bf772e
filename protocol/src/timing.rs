//! Times on the line, in ticks of whatever timer the caller has, rounded up.
//!
//! All of it is `const` and in `u32`: a fixed port costs nothing at run time, and a port that is configured at run time costs
//! one 32-bit division per value. For no value to overflow, `tick_hz` is at most [`TICK_HZ_MAX`].

use crate::format::LineFormat;

/// The fastest timer these functions can count in: 55 MHz, where 3.5 characters of 11 bits just fit in 32 bits.
pub const TICK_HZ_MAX: u32 = 55_000_000;

/// Above this rate the silences are fixed instead of a multiple of the character time (SER 2.5.1.1).
pub const FIXED_SILENCE_ABOVE_BAUD: u32 = 19_200;

/// [`margin`] is this part of t3.5: two clocks that are off by 1 % each, in opposite directions, differ by half as much.
const MARGIN_PART: u32 = 24;

/// By how much before t3.5 a frame is judged: t3.5 is measured by two clocks (SER 2.5.1.1 leaves open by which). A character that
/// begins in this last part of it begins a new frame, as it may have waited for t3.5 by its sender's clock; the frame before
/// stands, and its answer is withdrawn. An answer starts at t3.5 all the same.
pub const fn margin(t3_5: u32) -> u32 {
    t3_5 / MARGIN_PART
}

/// A silence of so many ms that ends a frame in place of t3.5, for peers that pause inside frames.
pub const fn gap(ms: u8, tick_hz: u32) -> u32 {
    ms as u32 * tick_hz.div_ceil(1000)
}

/// The time of one character of this format.
///
/// # Panics
///
/// If `baud` is 0.
pub const fn character(format: LineFormat, baud: u32, tick_hz: u32) -> u32 {
    (format.character_bits() as u32 * tick_hz).div_ceil(baud)
}

/// The longest silence allowed inside a frame: 1.5 characters, or 750 us above 19200 baud (SER 2.5.1.1).
///
/// # Panics
///
/// If `baud` is 0.
pub const fn t1_5(format: LineFormat, baud: u32, tick_hz: u32) -> u32 {
    half_characters(3, format, baud, tick_hz)
}

/// The silence that ends a frame: 3.5 characters, or 1750 us above 19200 baud (SER 2.5.1.1).
///
/// # Panics
///
/// If `baud` is 0.
pub const fn t3_5(format: LineFormat, baud: u32, tick_hz: u32) -> u32 {
    half_characters(7, format, baud, tick_hz)
}

const fn half_characters(halves: u32, format: LineFormat, baud: u32, tick_hz: u32) -> u32 {
    if baud > FIXED_SILENCE_ABOVE_BAUD {
        // 750 us and 1750 us are three and seven times 250 us.
        (halves * tick_hz).div_ceil(4000)
    } else {
        (halves * format.character_bits() as u32 * tick_hz).div_ceil(2 * baud)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn worked_by_hand() {
        // 11 bits at 9600 baud are 1145.83 us.
        assert_eq!(character(LineFormat::F8E1, 9600, 1_000_000), 1146);
        assert_eq!(t1_5(LineFormat::F8E1, 9600, 1_000_000), 1719);
        assert_eq!(t3_5(LineFormat::F8E1, 9600, 1_000_000), 4011);
        // 10 bits at 19200 baud are 520.83 us: still a multiple of the character.
        assert_eq!(t1_5(LineFormat::F8N1, 19200, 2_000_000), 1563);
        assert_eq!(t3_5(LineFormat::F8N1, 19200, 2_000_000), 3646);
        assert_eq!(t1_5(LineFormat::F8N1, 19201, 2_000_000), 1500);
        assert_eq!(t3_5(LineFormat::F8N1, 38400, 2_000_000), 3500);
        // 11.0592 MHz / 8.
        assert_eq!(t3_5(LineFormat::F8N1, 38400, 1_382_400), 2420);
        assert_eq!(t1_5(LineFormat::F8N1, 115200, 1_382_400), 1037);
    }

    #[test]
    fn a_gap_of_95_percent_of_t3_5_is_still_one() {
        for baud in [1200, 9600, 38_400] {
            for tick_hz in [1_000_000, 2_500_000, 42_000_000] {
                let t3_5 = t3_5(LineFormat::F8N1, baud, tick_hz);
                let judged = t3_5 - margin(t3_5);
                assert!(100 * judged > 95 * t3_5);
                // Two clocks that are 1 % off, one each way, and as much again.
                assert!(100 * judged < 96 * t3_5);
            }
        }
    }

    #[test]
    fn exact_at_the_ends_of_the_range() {
        for format in LineFormat::ALL {
            for baud in [300, 2400, 9600, 19_200, 38_400, 115_200, 1_000_000] {
                for tick_hz in [1_000, 1_000_000, 2_500_000, TICK_HZ_MAX] {
                    let bits = u64::from(format.character_bits());
                    let exact = |halves: u64| {
                        let (over, under) = if baud > 19_200 {
                            (halves * 250 * u64::from(tick_hz), 1_000_000)
                        } else {
                            (halves * bits * u64::from(tick_hz), 2 * u64::from(baud))
                        };
                        over.div_ceil(under)
                    };
                    assert_eq!(u64::from(t1_5(format, baud, tick_hz)), exact(3));
                    assert_eq!(u64::from(t3_5(format, baud, tick_hz)), exact(7));
                    let one = (bits * u64::from(tick_hz)).div_ceil(u64::from(baud));
                    assert_eq!(u64::from(character(format, baud, tick_hz)), one);
                }
            }
        }
    }
}
