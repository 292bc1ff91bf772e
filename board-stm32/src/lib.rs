//! The STM32F405 of the Olimex STM32-H405, and of every board like it: clocks, four ports, and the options
//! of a build.
//!
//! | pin | is |
//! |---|---|
//! | PA9, PA10 | AS1 (USART1): TX, RX; with PA11, PA12 CTS, RTS |
//! | PA2, PA3 | AS2 (USART2): TX, RX |
//! | PB10, PB11 | RS2 (USART3): TX, RX; with PB13, PB14 CTS, RTS |
//! | PA0, PA1, PA4 | RS4 (UART4): TX, RX, and DE of the RS-485 transceiver |
//! | PC0..PC12 | free; the demonstration unit's LEDs. PC4 of the STM32-H405 senses the USB voltage: no USB cable with these LEDs |
//! | PA13, PA14 | SWD |
//!
//! Give DE a pull-down of 10 kOhm: no firmware holds the pin during reset and flashing.
//!
//! TIM5 measures the silence on the lines, TIM2 is the timer of `embassy-time`. An application may use everything else, except EXTI
//! (the start-bit detectors, see [`usart`]) and, where AS1 has RTS/CTS, the pins of USB.
//!
//! The clock is the crystal of 8 MHz. If the crystal does not swing within 100 ms, the chip's own oscillator takes its place,
//! [`clock`] reports this, and a port whose rate is then off by more than 2.5 % stays off until it is configured for another rate.
//! That oscillator is off by 1 % at 25 degrees C, by 4 % from -10 to 85, by -8 to +4.5 % from -40 to 105 (DS, HSI oscillator
//! characteristics): enough to reach a port, not enough for a bus in the cold.
//!
//! The option bytes set brown-out reset, which is off as the chip is delivered (RM0090 3.6.1, BOR_LEV): level 3, below 2.7 V, fits
//! a board of 3.3 V. The firmware does not change the option bytes.
//!
//! The chip and QEMU have one source: feature `hardware`, on by default, or `qemu`. Feature `defmt` logs over
//! RTT.
//!
//! "RM0090" is ST's reference manual for the STM32F405 (sections as in revision 19), "DS" its data sheet,
//! DocID 022152.
#![cfg_attr(not(test), no_std)]
// A host runs the arithmetic only.
#![cfg_attr(not(target_arch = "arm"), allow(dead_code))]

pub mod ports;
pub mod usart;
mod watchdog;

#[cfg(target_arch = "arm")]
mod board;
#[cfg(target_arch = "arm")]
mod fault;
#[cfg(target_arch = "arm")]
mod platform;
#[cfg(target_arch = "arm")]
mod stack;

#[cfg(target_arch = "arm")]
pub use stack::stack;

#[cfg(target_arch = "arm")]
pub use board::{Board, Closed, Free, clock, init, outputs, reset_cause, run};
#[cfg(all(target_arch = "arm", feature = "qemu"))]
#[doc(hidden)]
pub use board::{wrap_line_timer_in, wrap_time_in};
pub use multidrop::ResetCause;
pub use multidrop_apps::options;
pub use ports::PortSetup;
#[cfg(target_arch = "arm")]
pub use usart::Usart;
pub use watchdog::Watchdog;
#[cfg(target_arch = "arm")]
pub use watchdog::{Dog, Roll};

/// The source of the clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// The external crystal (HSE).
    Crystal,
    /// The chip's own oscillator, since the crystal did not swing within 100 ms.
    Internal,
}

impl Clock {
    /// By how much the clock may be off, beside the error of a divider, in parts per million: 1 % at 25 degrees C for the chip's
    /// own oscillator (DS, HSI oscillator characteristics). The error of a crystal is far less.
    pub const fn error_ppm(self) -> u32 {
        match self {
            Clock::Crystal => 0,
            Clock::Internal => 10_000,
        }
    }
}

/// The rate of the lines' timer, in ticks per second: TIM5 with its prescaler.
pub const TICK_HZ: u32 = if cfg!(feature = "qemu") {
    50_000_000
} else {
    42_000_000
};

/// Logs over RTT, as `defmt::info!` does. Without the feature `defmt` it does nothing.
#[macro_export]
macro_rules! info {
    ($($text:tt)*) => {
        #[cfg(feature = "defmt")]
        defmt::info!($($text)*)
    };
}
