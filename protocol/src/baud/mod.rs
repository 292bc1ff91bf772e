//! Baud rates that a divider makes of a clock: the nearest to a wanted rate, and how far off it is.
//!
//! A bit of a USART takes a whole number of clock cycles, which the divider sets in steps. What the divider
//! of each chip can have is in [`atmega`] and [`stm32`]; all else is equal and stands here. All of it is `const` and in `u32`
//! but for `error_ppm`.

pub mod atmega;
pub mod stm32;

/// The largest deviation from the wanted rate that is accepted, in parts per million: 2.5 %.
///
/// 115200 baud from 16 MHz is 2.1 % off and in use everywhere. The receiver of the ATmega tolerates for ten bits 3.8 % at normal
/// and 4.4 % at double speed (DS40002061B tables 20-2 and 20-3, maximum), that of the STM32 3 % with 16 samples a bit
/// (RM0090 30.3.5).
pub const MAX_ERROR_PPM: u32 = 25_000;

/// A baud rate that the clock cannot make within [`MAX_ERROR_PPM`], or that is faster than the CPU can follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BaudError {
    /// The rate that was asked for.
    pub baud: u32,
    /// The nearest rate that can be had.
    pub nearest: u32,
}

/// The divider whose bit, `step` cycles times the divider, is nearest to a bit of `baud`. At most 2^32 / `baud` may be `step`.
///
/// # Panics
/// If `step` or `baud` is 0.
const fn nearest_divider(clock_hz: u32, step: u32, baud: u32) -> u32 {
    let per_tick = step * baud;
    (clock_hz + per_tick / 2) / per_tick
}

/// The rate whose bits have `cycles` of `clock_hz`, in baud, rounded to the nearest.
const fn rate(clock_hz: u32, cycles: u32) -> u32 {
    (clock_hz + cycles / 2) / cycles
}

/// Whether bits of `cycles` are within [`MAX_ERROR_PPM`] of `baud`, the product of which must fit in 32 bits.
const fn is_within(clock_hz: u32, cycles: u32, baud: u32) -> bool {
    let made = cycles * baud;
    clock_hz.abs_diff(made) <= made / (1_000_000 / MAX_ERROR_PPM)
}

/// Distance between the rate made by bits of `cycles` and the rate wanted, in parts per million of the rate wanted.
const fn error_ppm(clock_hz: u32, cycles: u32, baud: u32) -> u32 {
    let wanted = baud as u64 * cycles as u64;
    ((clock_hz as u64).abs_diff(wanted) * 1_000_000 / wanted) as u32
}
