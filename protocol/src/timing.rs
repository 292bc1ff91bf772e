//! Times on the line, in ticks of the caller's timer, rounded up.
//!
//! All functions are `const` and use `u32`: a fixed port costs nothing at run time, and a port that is configured at
//! run time costs one 32-bit division per value. Values do not overflow if `tick_hz` is at most [`TICK_HZ_MAX`].

use crate::format::{Framing, LineFormat};
use crate::line::{LineConfig, Role};
use crate::port_registers::InterCharacter;

/// The highest tick rate of a timer: 55 MHz, at which 3.5 characters of 11 bits just fit in 32 bits.
pub const TICK_HZ_MAX: u32 = 55_000_000;

/// Above this rate the silences are fixed instead of a multiple of the character time (SER 2.5.1.1).
pub const FIXED_SILENCE_ABOVE_BAUD: u32 = 19_200;

/// [`margin`] is t3.5 divided by this: about twice the difference between two clocks that are off by 1 % in opposite
/// directions.
const MARGIN_PART: u32 = 24;

/// The time before t3.5 at which a frame is judged, because sender and receiver measure t3.5 by different clocks (SER
/// 2.5.1.1 does not say which one counts). A character that begins in this last part of t3.5 begins a new frame,
/// since its sender may have waited for t3.5 by its own clock. The frame before it stands, and its answer is
/// withdrawn. An answer still starts at t3.5.
pub const fn margin(t3_5: u32) -> u32 {
    t3_5 / MARGIN_PART
}

/// A silence of `ms` milliseconds, which ends a frame in place of t3.5 for peers that pause inside frames.
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

/// How a chip's receiver and its interrupts see the end of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sight {
    /// Ticks per second of the timer that measures silence: at most [`TICK_HZ_MAX`].
    pub tick_hz: u32,
    /// The most that is left of a character when its interrupt comes, in sixteenths of a bit: 0..=48. This rest is added, rounded
    /// up, so that no interval is cut short.
    pub rest: u32,
    /// The least ticks that pass in two interrupts together: before the timer is read for a character, and before the start-bit
    /// detector is read for an alarm. These ticks are subtracted.
    pub latency: u32,
    /// A client judges a frame before t3.5 by this part of the time from t1.5 to t3.5: 2 means half of it. The client makes its
    /// next request in that time.
    pub client_part: u32,
}

/// The intervals of a line, in ticks of the timer that measures its silence. A driver makes the
/// [`Interval`](crate::line::Interval)s of the machine from them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Intervals {
    /// From the moment in which a character is taken from the USART to the end of the silence that completes its frame: t1.5,
    /// or the moment of judgement where gaps over t1.5 are allowed. In ASCII a fortieth of a second.
    pub to_complete: u32,
    /// From the judgement of a frame to t3.5.
    pub to_start: u32,
    /// The time of one character.
    pub character: u32,
    /// t3.5, or the gap that ends a frame in its place, from the moment in which a character is taken.
    pub t3_5: u32,
}

impl Intervals {
    /// The intervals of a line that is not set up yet.
    pub const NONE: Intervals = Intervals {
        to_complete: 0,
        to_start: 0,
        character: 0,
        t3_5: 0,
    };

    /// The intervals of a line with these settings, for a baud rate that the chip makes.
    ///
    /// # Panics
    /// If `baud` is 0.
    pub const fn new(config: &LineConfig, sight: &Sight) -> Intervals {
        let (baud, format, tick_hz) = (config.baud, config.format, sight.tick_hz);
        let rest = (sight.rest * tick_hz).div_ceil(16 * baud);
        let mut silence = t3_5(format, baud, tick_hz);
        if let InterCharacter::Gap(ms) = config.inter_character {
            let gap = gap(ms, tick_hz);
            if gap > silence {
                silence = gap;
            }
        }
        let t1_5 = rest + t1_5(format, baud, tick_hz) - sight.latency;
        let t3_5 = rest + silence - sight.latency;
        let to_start = match (config.role, config.inter_character) {
            (Role::Client, InterCharacter::Strict) => (t3_5 - t1_5) / sight.client_part,
            _ => margin(silence),
        };
        let to_complete = match (config.framing, config.inter_character) {
            (Framing::Ascii, _) => tick_hz.div_ceil(40),
            (_, InterCharacter::Strict) => t1_5,
            (_, InterCharacter::Off | InterCharacter::Gap(_)) => t3_5 - to_start,
        };
        Intervals {
            to_complete,
            to_start,
            character: character(format, baud, tick_hz),
            t3_5,
        }
    }

    /// From the moment that completes an RTU frame to its judgement; 0 where both are the same moment.
    #[inline(always)]
    pub const fn to_stand(&self) -> u32 {
        self.t3_5 - self.to_start - self.to_complete
    }
}

/// Ticks of each further part. A timer of 16 bits counts a long interval in parts: a [first part](first_part) and [further
/// parts](further_parts). After a part, the part that is left is never shorter than this, so that there is time to set it.
pub const PART: u16 = 0x8000;

/// Ticks of the first part: the whole interval if it fits into 16 bits, else the ticks that whole [`PART`]s leave over.
pub const fn first_part(ticks: u32) -> u16 {
    (ticks - further_parts(ticks) as u32 * PART as u32) as u16
}

/// The number of [`PART`]s after the first part.
pub const fn further_parts(ticks: u32) -> u8 {
    (ticks / PART as u32).saturating_sub(1) as u8
}

/// The interval that these parts make up.
pub const fn whole(first: u16, further: u8) -> u32 {
    first as u32 + further as u32 * PART as u32
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
                // Two clocks that are off by 1 % in opposite directions, and as much again.
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
