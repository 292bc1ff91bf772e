//! The settings of the STM32's line, whose tests stand beside them: the board's own crate is for the chip, and a host runs no
//! tests of it.
#![allow(dead_code, reason = "the board uses the rest")]

#[path = "../../board-stm32/src/usart/baud.rs"]
pub mod baud;
#[path = "../../board-stm32/src/usart/settings.rs"]
mod settings;
