//! Time on the bus, in picoseconds, and exact conversion to and from the cycles of a clock.
//!
//! A picosecond divides no clock period exactly (1 / 11.0592 MHz is not a whole number of
//! anything), so a node counts its own cycles and every conversion starts again from the cycle
//! count: the error is below one picosecond at any time and never adds up.

use std::fmt;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, Sub};
use std::time::Duration;

/// An instant on the bus (since it was made) or a span of bus time, in picoseconds.
///
/// `u64` picoseconds last for 213 days.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Time(u64);

impl Time {
    /// The start of the bus; a span of nothing.
    pub const ZERO: Time = Time(0);
    /// Later than anything.
    pub const NEVER: Time = Time(u64::MAX);

    /// A time in picoseconds.
    pub const fn from_ps(ps: u64) -> Self {
        Time(ps)
    }

    /// A time in nanoseconds.
    pub const fn from_ns(ns: u64) -> Self {
        Time(ns * 1_000)
    }

    /// A time in microseconds.
    pub const fn from_us(us: u64) -> Self {
        Time(us * 1_000_000)
    }

    /// A time in milliseconds.
    pub const fn from_ms(ms: u64) -> Self {
        Time(ms * 1_000_000_000)
    }

    /// A time in seconds.
    pub const fn from_s(s: u64) -> Self {
        Time(s * 1_000_000_000_000)
    }

    /// The time in picoseconds.
    pub const fn ps(self) -> u64 {
        self.0
    }

    /// In microseconds, for people.
    pub fn us(self) -> f64 {
        self.0 as f64 / 1e6
    }

    /// `self - other`, or zero where that would be before the start.
    pub const fn saturating_sub(self, other: Time) -> Time {
        Time(self.0.saturating_sub(other.0))
    }

    /// `self + other`, at most [`Time::NEVER`].
    pub const fn saturating_add(self, other: Time) -> Time {
        Time(self.0.saturating_add(other.0))
    }

    /// As a [`Duration`], cut to nanoseconds.
    pub const fn to_duration(self) -> Duration {
        Duration::from_nanos(self.0 / 1_000)
    }
}

impl From<Duration> for Time {
    fn from(duration: Duration) -> Self {
        Time(u64::try_from(duration.as_nanos().saturating_mul(1_000)).unwrap_or(u64::MAX))
    }
}

impl Add for Time {
    type Output = Time;
    fn add(self, other: Time) -> Time {
        Time(self.0 + other.0)
    }
}

impl AddAssign for Time {
    fn add_assign(&mut self, other: Time) {
        self.0 += other.0;
    }
}

impl Sub for Time {
    type Output = Time;
    fn sub(self, other: Time) -> Time {
        Time(self.0 - other.0)
    }
}

impl Mul<u64> for Time {
    type Output = Time;
    fn mul(self, factor: u64) -> Time {
        Time(self.0 * factor)
    }
}

impl Div<u64> for Time {
    type Output = Time;
    fn div(self, divisor: u64) -> Time {
        Time(self.0 / divisor)
    }
}

impl Sum for Time {
    fn sum<I: Iterator<Item = Time>>(iter: I) -> Time {
        iter.fold(Time::ZERO, Add::add)
    }
}

impl fmt::Display for Time {
    /// Microseconds with three decimals, as in `1750.250 us`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ns = self.0 / 1_000;
        write!(f, "{}.{:03} us", ns / 1_000, ns % 1_000)
    }
}

/// A clock: a nominal frequency and its error. Used for a node's crystal and, at the baud rate,
/// for a host's bit clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clock {
    /// Millionths of a hertz, so that an error in ppm stays a whole number.
    microhertz: u64,
}

const PS_PER_S_MICRO: u128 = 1_000_000_000_000 * 1_000_000;

impl Clock {
    /// A clock of `hz` hertz that is wrong by `ppm` parts per million (positive: too fast).
    /// `hz` is at least 1 and `ppm` at least -999 999; a smaller value counts as that.
    pub fn new(hz: u32, ppm: i32) -> Self {
        let factor = (1_000_000 + i64::from(ppm)).max(1) as u64;
        Clock {
            microhertz: u64::from(hz.max(1)) * factor,
        }
    }

    /// When `ticks` ticks have passed since time zero, cut to a picosecond.
    pub fn time(self, ticks: u64) -> Time {
        Time((u128::from(ticks) * PS_PER_S_MICRO / u128::from(self.microhertz)) as u64)
    }

    /// The first tick at or after `time`.
    pub fn tick_at_or_after(self, time: Time) -> u64 {
        let product = u128::from(time.0) * u128::from(self.microhertz);
        product.div_ceil(PS_PER_S_MICRO) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conversion_is_exact_both_ways() {
        for clock in [
            Clock::new(16_000_000, 0),
            Clock::new(11_059_200, 0),
            Clock::new(20_000_000, -20_000),
            Clock::new(38_400, 30_000),
        ] {
            for ticks in [0, 1, 2, 3, 999_999_937, 123_456_789_012] {
                assert_eq!(clock.tick_at_or_after(clock.time(ticks)), ticks);
            }
        }
    }

    #[test]
    fn one_tick_at_16_mhz_is_62500_ps() {
        assert_eq!(Clock::new(16_000_000, 0).time(1), Time::from_ps(62_500));
        // 1 / 11 059 200 Hz = 90 422.453.. ps
        assert_eq!(Clock::new(11_059_200, 0).time(1), Time::from_ps(90_422));
    }
}
