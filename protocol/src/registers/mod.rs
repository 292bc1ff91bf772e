//! Banks: the memory of an application at Modbus addresses.
//!
//! A data model holds banks and passes each call to one of them in one line. Addresses outside a bank are answered
//! with [`Exception::IllegalDataAddress`]. The application reaches the cells by `get` and `set`.
//! [`rules!`](crate::rules!) declares which registers a master may write, and with which values.
//!
//! | shape | dense | with a table of addresses |
//! |---|---|---|
//! | registers | [`Bank`] | [`SparseBank`], [`ScanList`] |
//! | coils | [`CoilBank`] | [`SparseCoilBank`] |
//!
//! All of them implement [`Items`], which a master's port uses.

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

/// Checks whether the `count` items from address `first` on are below `size`: for tables whose values are computed
/// rather than stored.
///
/// # Errors
///
/// [`Exception::IllegalDataAddress`] if one of them is not.
#[inline]
pub const fn within(first: u16, count: u16, size: u16) -> Result<(), Exception> {
    match first.checked_add(count) {
        Some(end) if end <= size => Ok(()),
        _ => Err(Exception::IllegalDataAddress),
    }
}
