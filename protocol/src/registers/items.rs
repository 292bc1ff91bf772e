//! What the port registers REGS and COILS are made of: items by index, each at an address on the wire.

use crate::data::{Coils, CoilsOut, Registers, RegistersOut};
use crate::exception::Exception;

/// An array of registers (`u16`) or coils (`bool`), one element for each item.
///
/// The server finds an item by its address, the master and the application by its index.
pub trait Items {
    /// A register or a coil.
    type Item: Copy + Default;

    /// Whether the items are at addresses of their own, so that a run of indices may have gaps on the wire.
    const SPARSE: bool;

    /// Whether there never are any: what is for them is left out of the image.
    const NONE: bool = false;

    /// How many items there are, up to 65536.
    fn len(&self) -> usize;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The item at this index, `None` behind the last.
    fn item(&self, index: u16) -> Option<Self::Item>;

    /// Sets the item at this index; `false` behind the last.
    fn set_item(&mut self, index: u16, value: Self::Item) -> bool;

    /// The address of the item at this index, `None` behind the last.
    fn address_of(&self, index: u16) -> Option<u16>;

    /// The index of the item at this address, `None` if there is none.
    fn index_of(&self, address: u16) -> Option<u16>;

    /// Moves the first item to the address `base`, and the others with it. `false`, and nothing is moved, if the last would be
    /// behind 65535. Addresses of a table stay what they are.
    fn rebase(&mut self, base: u16) -> bool;

    /// Of a scan list: what is at this place in it, `None` behind the last and in all other arrays.
    fn entry(&self, place: u16) -> Option<ScanEntry> {
        let _ = place;
        None
    }

    /// Whether the array is a scan list.
    const SCANS: bool = false;
}

/// What a scan list says of one transaction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScanEntry {
    /// The slave, 0..=247.
    pub unit: u8,
    /// The index of the item, its register offset.
    pub index: u16,
}

/// Items that one transaction can carry: at addresses that follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// Index of the first.
    pub index: u16,
    /// Its address.
    pub first: u16,
    /// How many.
    pub count: u16,
}

/// The longest run that begins at `index` and has at most `count` items; `None` if there is no such item, or none is asked for.
///
/// Taking the longest again and again splits a block into the fewest runs, in order.
pub fn run<I: Items>(items: &I, index: u16, count: u16) -> Option<Run> {
    let first = items.address_of(index).filter(|_| count != 0)?;
    let mut found = 1;
    while found < count {
        let next = index
            .checked_add(found)
            .and_then(|index| items.address_of(index));
        if next.is_none() || next != first.checked_add(found) {
            break;
        }
        found += 1;
    }
    Some(Run {
        index,
        first,
        count: found,
    })
}

/// Whether there is an item at each of the `count` addresses from `first` on.
///
/// # Errors
///
/// [`Exception::IllegalDataAddress`] unless there is.
pub fn check<I: Items>(items: &I, first: u16, count: u16) -> Result<(), Exception> {
    let exists = |offset| {
        first
            .checked_add(offset)
            .and_then(|address| items.index_of(address))
            .is_some()
    };
    if (0..count).all(exists) {
        Ok(())
    } else {
        Err(Exception::IllegalDataAddress)
    }
}

/// Answers [`DataModel::holding_registers`](crate::server::DataModel::holding_registers) or `input_registers`.
///
/// # Errors
///
/// [`Exception::IllegalDataAddress`] unless all of them exist.
pub fn read_registers<I: Items<Item = u16>>(
    items: &I,
    first: u16,
    mut out: RegistersOut<'_>,
) -> Result<(), Exception> {
    let count = out.len() as u16;
    check(items, first, count)?;
    out.fill_from((0..count).map(|offset| at(items, first, offset)));
    Ok(())
}

/// Answers [`DataModel::write_registers`](crate::server::DataModel::write_registers).
///
/// # Errors
///
/// [`Exception::IllegalDataAddress`] unless all of them exist; nothing is changed then.
pub fn write_registers<I: Items<Item = u16>>(
    items: &mut I,
    first: u16,
    values: Registers<'_>,
) -> Result<(), Exception> {
    check(items, first, values.len() as u16)?;
    put(items, first, values.iter());
    Ok(())
}

/// Answers [`DataModel::coils`](crate::server::DataModel::coils) or `discrete_inputs`.
///
/// # Errors
///
/// [`Exception::IllegalDataAddress`] unless all of them exist.
pub fn read_coils<I: Items<Item = bool>>(
    items: &I,
    first: u16,
    mut out: CoilsOut<'_>,
) -> Result<(), Exception> {
    let count = out.len();
    check(items, first, count)?;
    out.fill_from((0..count).map(|offset| at(items, first, offset)));
    Ok(())
}

/// Answers [`DataModel::write_coils`](crate::server::DataModel::write_coils).
///
/// # Errors
///
/// [`Exception::IllegalDataAddress`] unless all of them exist; nothing is changed then.
pub fn write_coils<I: Items<Item = bool>>(
    items: &mut I,
    first: u16,
    values: Coils<'_>,
) -> Result<(), Exception> {
    check(items, first, values.len())?;
    put(items, first, values.iter());
    Ok(())
}

/// The item behind `first` of a block that was checked.
fn at<I: Items>(items: &I, first: u16, offset: u16) -> I::Item {
    let address = first.wrapping_add(offset);
    items
        .index_of(address)
        .and_then(|index| items.item(index))
        .unwrap_or_default()
}

/// Sets the items of a block that was checked.
fn put<I: Items>(items: &mut I, first: u16, values: impl Iterator<Item = I::Item>) {
    let mut address = first;
    for value in values {
        if let Some(index) = items.index_of(address) {
            items.set_item(index, value);
        }
        address = address.wrapping_add(1);
    }
}

/// No coils: for a port that has registers only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NoCoils;

impl Items for NoCoils {
    type Item = bool;
    const SPARSE: bool = false;
    const NONE: bool = true;

    fn len(&self) -> usize {
        0
    }

    fn item(&self, _: u16) -> Option<bool> {
        None
    }

    fn set_item(&mut self, _: u16, _: bool) -> bool {
        false
    }

    fn address_of(&self, _: u16) -> Option<u16> {
        None
    }

    fn index_of(&self, _: u16) -> Option<u16> {
        None
    }

    fn rebase(&mut self, _: u16) -> bool {
        true
    }
}
