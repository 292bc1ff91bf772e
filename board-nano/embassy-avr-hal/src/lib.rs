//! Embassy on the ATmega328P.
//!
//! | module | gives |
//! |---|---|
//! | [`executor`] | an executor that truly sleeps when idle and loses no wake-up |
//! | [`interrupts`] | the token of what is bound, by [`bind_interrupts!`] |
//! | [`usart`] | the USART as the [`Chip`](multidrop_protocol::line::Chip) of a line: frames by silence, DE, no task woken per byte |
//! | [`time`] | a driver for `embassy-time`, linked only where it is bound |
//! | [`gpio`] | pins with the `embedded-hal` 1.0 traits |
//! | [`edge`] | edges of port D's pins to wait for, with the trait of `embedded-hal-async` |
//! | [`eeprom`] | the 1024 bytes of EEPROM, written in the background |
//! | [`fault`] | what becomes of a panic, and why the chip has started |
//! | [`watchdog`] | the watchdog |
//! | [`stack`] | how deep the stack has been, and a guard at its end |
//! | [`baud`] | divider and error of a baud rate |
//!
//! Timer1 belongs to this crate: it runs free at an eighth of the clock, compare B measures the
//! silence on the line, compare A is the alarm of `embassy-time`. Timer0 and Timer2 are the user's.
//! So is everything else, but for GPIOR0 (flags of the executor), GPIOR1 and GPIOR2 (the line's) and bit 0 of PCMSK2
//! (the start-bit detector, see [`usart`]). Pin-change interrupts on port D are to be had from [`edge`] only.
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
pub mod usart;
pub mod watchdog;

#[cfg(target_arch = "avr")]
mod mem;
mod timer1;

pub use avr_device::atmega328p as pac;
pub use multidrop_protocol::baud::atmega as baud;
