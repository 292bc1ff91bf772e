//! Banks: application memory behind Modbus addresses.
//!
//! A data model holds banks and hands each call on to the one it is for, in one line. Addresses outside a bank are answered
//! with [`Exception::IllegalDataAddress`]. The application reaches the same
//! cells by `get` and `set`. [`rules!`](crate::rules!) declares which registers a master may write, and what.
//!
//! | shape | dense | with a table of addresses |
//! |---|---|---|
//! | registers | [`Bank`] | [`SparseBank`], [`ScanList`] |
//! | coils | [`CoilBank`] | [`SparseCoilBank`] |
//!
//! All of them are [`Items`], which is what a master's port works with.

mod bank;
mod coil_bank;
pub mod items;
mod rules;
#[doc(hidden)]
pub mod rules_check;
mod scan_list;
mod sparse;

pub use bank::Bank;
pub use coil_bank::CoilBank;
pub use items::{Items, NoCoils, Run, ScanEntry};
#[doc(hidden)]
pub use rules::Block;
pub use rules::{NoRules, RuleList, Rules, Span};
pub use scan_list::ScanList;
pub use sparse::{Sparse, SparseBank, SparseCoilBank};

use crate::exception::Exception;

/// Whether `count` items from address `first` on are among those that exist, 0 to `size` - 1: for tables that are computed
/// rather than kept.
///
/// # Errors
///
/// [`Exception::IllegalDataAddress`] unless all of them are.
#[inline]
pub const fn within(first: u16, count: u16, size: u16) -> Result<(), Exception> {
    match first.checked_add(count) {
        Some(end) if end <= size => Ok(()),
        _ => Err(Exception::IllegalDataAddress),
    }
}
