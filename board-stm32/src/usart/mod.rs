//! The USARTs as lines: frames out of silence, answers at t3.5, DE.
//!
//! A port's interrupt stores byte and CRC and sets the port's alarm to the end of the silence that would
//! complete the frame; no task is woken per byte. The alarm completes the frame at t1.5, judges it when 23/24
//! of t3.5 are over, and at t3.5 starts an answer that is ready by then from within the interrupt.
//!
//! RXNE comes near the end of a character, so by itself it shows only a whole character late that the character began within t1.5.
//! The pending bit that EXTI sets on a falling edge of RXD serves as a start-bit detector: it is polled when the alarm goes off,
//! and never interrupts.
//!
//! An application must leave EXTI to the ports. So the feature `exti` of embassy-stm32, whose interrupt handler takes and masks the
//! pending bits of all lines, is not for an image with this crate. The application gives its own interrupts priority P8 or lower:
//! higher ones delay characters.

pub(crate) mod settings;

#[cfg(target_arch = "arm")]
mod chip;
#[cfg(target_arch = "arm")]
pub(crate) mod registers;
#[cfg(target_arch = "arm")]
mod state;

#[cfg(target_arch = "arm")]
pub(crate) use chip::{INTERRUPTS, no_frame_is_stuck, on_alarm, open};
#[cfg(target_arch = "arm")]
pub use chip::{Usart, UsartChip};
pub use multidrop::protocol::baud::stm32 as baud;
pub use settings::Settings;
