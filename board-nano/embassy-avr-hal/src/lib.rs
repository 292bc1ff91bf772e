//! Embassy on the ATmega328P.
//!
//! | module | content |
//! |---|---|
//! | [`executor`] | an executor that truly sleeps when idle and loses no wake-up |
//! | [`interrupts`] | the token of what is bound, by [`bind_interrupts!`] |
//! | [`usart`] | the USART as the [`Chip`](multidrop_protocol::line::Chip) of a line: frames by silence, DE, no task woken per byte; with the feature `modbus` |
//! | [`uart`] | the USART as a plain UART: bytes, with the traits of `embedded-io` and `embedded-io-async` |
//! | [`time`] | a driver for `embassy-time`, linked only where it is bound |
//! | [`gpio`] | pins with the `embedded-hal` 1.0 traits |
//! | [`edge`] | edges of port D's pins to wait for, with the trait of `embedded-hal-async` |
//! | [`eeprom`] | the 1024 bytes of EEPROM, written in the background |
//! | [`fault`] | the handling of panics, and the cause of the last reset |
//! | [`watchdog`] | the watchdog |
//! | [`stack`] | the depth of the stack, and a guard at its end |
//! | [`baud`] | divider and error of a baud rate |
//!
//! Timer1 belongs to this crate: it runs freely at an eighth of the clock, compare B measures the silence on the
//! line, compare A is the alarm of `embassy-time`. Timer0 and Timer2 are free for the application, and so is
//! everything else except GPIOR0 (flags of the executor), GPIOR1 and GPIOR2 (of the line) and bit 0 of PCMSK2 (the
//! start-bit detector, see [`usart`]). Use [`edge`] for pin-change interrupts on port D.
//!
//! "DS" is the ATmega328P data sheet, Microchip DS40002061B.
#![no_std]
#![cfg_attr(target_arch = "avr", feature(asm_experimental_arch))]

pub mod edge;
pub mod eeprom;
pub mod executor;
#[cfg(not(feature = "bare"))]
pub mod fault;
pub mod gpio;
pub mod interrupts;
#[cfg(not(feature = "bare"))]
pub mod stack;
pub mod time;
pub mod uart;
#[cfg(feature = "modbus")]
pub mod usart;
pub mod watchdog;

#[cfg(target_arch = "avr")]
mod mem;
mod timer1;
mod usart0;

pub use avr_device::atmega328p as pac;
pub use multidrop_protocol::baud::atmega as baud;
