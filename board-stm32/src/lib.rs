//! The STM32F405 of the Olimex STM32-H405, and of every board like it: clocks, four ports, and the options
//! of a build.
//!
//! | pin | is |
//! |---|---|
//! | PA9, PA10 | AS1 (USART1): TX, RX; with PA11, PA12 CTS, RTS |
//! | PA2, PA3 | AS2 (USART2): TX, RX |
//! | PB10, PB11 | RS2 (USART3): TX, RX; with PB13, PB14 CTS, RTS |
//! | PA0, PA1, PA4 | RS4 (UART4): TX, RX, and DE of the RS-485 transceiver |
//! | PC0..PC12 | free; the demonstration unit's LEDs. PC4 of the STM32-H405 senses the USB voltage: no cable there then |
//! | PA13, PA14 | SWD |
//!
//! Give DE a pull-down of 10 kOhm: no firmware holds the pin during reset and flashing.
//!
//! TIM5 measures the silence on the lines, TIM2 is `embassy-time`'s. Everything else is the application's, but
//! for EXTI (the start-bit detectors, see [`usart`]) and, where AS1 has RTS/CTS, the pins of USB.
//!
//! One source for the chip and for QEMU: feature `hardware`, on by default, or `qemu`. Feature `defmt` logs
//! over RTT.
//!
//! "RM0090" is ST's reference manual for the STM32F405 (sections as in revision 19), "DS" its data sheet,
//! DocID 022152.
#![cfg_attr(not(test), no_std)]
// A host runs the arithmetic only.
#![cfg_attr(not(target_arch = "arm"), allow(dead_code))]

#[path = "../../board-nano/src/options.rs"]
pub mod options;
pub mod ports;
pub mod usart;

#[cfg(target_arch = "arm")]
mod board;
#[cfg(target_arch = "arm")]
mod fault;
#[cfg(target_arch = "arm")]
mod platform;

#[cfg(target_arch = "arm")]
pub use board::{Board, Closed, init, outputs, reset_cause, run};
#[cfg(all(target_arch = "arm", feature = "qemu"))]
#[doc(hidden)]
pub use board::{wrap_line_timer_in, wrap_time_in};
pub use multidrop_firmware::ResetCause;

/// The timer of the lines, in ticks per second: TIM5 behind its prescaler.
pub const TICK_HZ: u32 = if cfg!(feature = "qemu") {
    50_000_000
} else {
    42_000_000
};

/// Logs over RTT, as `defmt::info!`; nothing at all without the feature `defmt`.
#[macro_export]
macro_rules! info {
    ($($text:tt)*) => {
        #[cfg(feature = "defmt")]
        defmt::info!($($text)*)
    };
}
