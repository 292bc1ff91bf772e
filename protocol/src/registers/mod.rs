//! Banks: application memory behind Modbus addresses.
//!
//! A data model holds banks and hands each call on to the one it is for, in one line. Addresses outside a bank are answered
//! with [`Exception::IllegalDataAddress`](crate::exception::Exception::IllegalDataAddress). The application reaches the same
//! cells by `get` and `set`.

mod bank;
mod coil_bank;

pub use bank::Bank;
pub use coil_bank::CoilBank;
