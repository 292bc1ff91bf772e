//! A line without hardware: a USART and a timer in ticks around the state machine, the two tasks of a port, and a plain
//! reading of the standard to judge what they did.
//!
//! [`script::run`] puts characters on the wire as a script says, lets the simulated unit hear and answer them, and hands
//! everything to [`judge`], which shares no code with the crate under test. Used by the tests of `multidrop-protocol` and by the fuzz
//! targets.
#![allow(
    missing_docs,
    reason = "names of fields, variants and constants that tell all there is to tell"
)]

pub mod ascii;
pub mod book;
pub mod bus;
pub mod judge;
pub mod memory;
pub mod ports;
pub mod random;
pub mod script;
pub mod unit;
