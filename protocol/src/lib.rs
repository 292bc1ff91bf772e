//! Modbus on a serial line, without I/O.
//!
//! The crate knows no pins, no tasks and no clock. It is compiled for an ATmega328P with 2 KB of RAM as well as for a
//! PC, so it allocates nothing, keeps no table in RAM on AVR, formats no text and does no 64-bit arithmetic.
//!
//! | module | content |
//! |---|---|
//! | [`crc`] | the CRC of an RTU frame, byte by byte |
//! | [`format`](mod@format) | data bits, parity and stop bits of a character |
//! | [`timing`] | character time, t1.5 and t3.5 in the caller's ticks |
//! | [`frame`] | limits of a frame, and the errors of one |
//! | [`rtu`], [`ascii`] | encoding and decoding of frames, byte by byte or whole |
//! | [`function`], [`exception`] | codes and limits of the standard |
//! | [`data`] | blocks of coils and registers as they are encoded in a frame |
//! | [`server`] | handling of requests: request and answer in one buffer |
//! | [`sniffer`] | pairing of observed requests and answers, lines of text |
//! | [`client`] | requests, and the check of their answers |
//! | [`number`] | wider numbers and text across registers |
//! | [`registers`] | banks of registers and coils for a data model, rules on what may be written |
//! | [`port_registers`] | the register set of a port, `MB_xxx` |
//! | [`baud`] | dividers for a baud rate, and how far off they are |
//! | [`message`] | text of build errors |
//!
//! # Sources
//!
//! `APP` is the *MODBUS Application Protocol Specification V1.1b3*, `SER` the *MODBUS over Serial Line Specification and
//! Implementation Guide V1.02*, both of modbus.org.
#![no_std]
#![forbid(unsafe_code)]

pub mod ascii;
pub mod baud;
pub mod client;
pub mod crc;
pub mod data;
pub mod exception;
pub mod format;
pub mod frame;
pub mod function;
pub mod line;
pub mod message;
pub mod number;
pub mod port_registers;
pub mod registers;
pub mod rtu;
pub mod server;
pub mod sniffer;
pub mod timing;

/// The unit id of a broadcast, which every server executes and none answers (SER 2.2).
pub const BROADCAST: u8 = 0;

/// The lowest unit id of a server (SER 2.2).
pub const UNIT_MIN: u8 = 1;
/// The highest unit id of a server; 248..=255 are reserved (SER 2.2).
pub const UNIT_MAX: u8 = 247;

/// The buffer of a frame, from the first byte received to the last byte sent: the size of the longest RTU frame (SER
/// 2.5.1).
///
/// A `u8` indexes this size without a bounds check.
pub type Adu = [u8; 256];

/// Compiles and runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
