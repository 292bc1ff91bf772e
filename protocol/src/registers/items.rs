//! The arrays of the port registers REGS and COILS: items by index, each at an address on the wire.

use crate::data::{Coils, CoilsOut, Registers, RegistersOut};
use crate::exception::Exception;

/// An array of registers (`u16`) or coils (`bool`), with one element for each item.
///
/// The server finds an item by its address, the master and the application by its index.
pub trait Items {
    /// The type of an item: `u16` for a register, `bool` for a coil.
    type Item: Copy + Default;

    /// Whether each item has an address of its own, so that indices in sequence may have gaps in their addresses.
    const SPARSE: bool;

    /// Whether the array is always empty, so that code for its items is left out of the image.
    const NONE: bool = false;

    /// The number of items, up to 65536.
    fn len(&self) -> usize;

    /// Whether there are no items.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The item at this index, `None` behind the last item.
    fn item(&self, index: u16) -> Option<Self::Item>;

    /// Sets the item at this index; returns `false` behind the last item.
    fn set_item(&mut self, index: u16, value: Self::Item) -> bool;

    /// The address of the item at this index, `None` behind the last item.
    fn address_of(&self, index: u16) -> Option<u16>;

    /// The index of the item at this address, `None` if there is none.
    fn index_of(&self, address: u16) -> Option<u16>;

    /// Moves the first item to the address `base`, and the others with it. Returns `false` and moves nothing if the
    /// last item would be past address 65535. Addresses of a table do not change.
    fn rebase(&mut self, base: u16) -> bool;

    /// The entry at this place of a scan list; `None` behind the last entry, and for all other arrays.
    fn entry(&self, place: u16) -> Option<ScanEntry> {
        let _ = place;
        None
    }

    /// Whether the array is a scan list.
    const SCANS: bool = false;
}

/// An entry of a scan list, which describes one transaction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScanEntry {
    /// The unit id of the slave, 0..=247.
    pub unit: u8,
    /// The index of the item, which is its register offset.
    pub index: u16,
}

/// Items that one transaction can carry: their addresses follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// The index of the first item.
    pub index: u16,
    /// The address of the first item.
    pub first: u16,
    /// The number of items.
    pub count: u16,
}

/// The longest run that begins at `index` and has at most `count` items; `None` if there is no such item, or `count`
/// is 0.
///
/// Repeated calls split a block into the fewest runs, in order.
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

/// Checks whether there is an item at each of the `count` addresses from `first` on.
///
/// # Errors
///
/// [`Exception::IllegalDataAddress`] if there is not.
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

/// Reads registers, for [`DataModel::holding_registers`](crate::server::DataModel::holding_registers) and
/// `input_registers`.
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

/// Writes registers, for [`DataModel::write_registers`](crate::server::DataModel::write_registers).
///
/// # Errors
///
/// [`Exception::IllegalDataAddress`] unless all of them exist; then nothing is changed.
pub fn write_registers<I: Items<Item = u16>>(
    items: &mut I,
    first: u16,
    values: Registers<'_>,
) -> Result<(), Exception> {
    check(items, first, values.len() as u16)?;
    put(items, first, values.iter());
    Ok(())
}

/// Reads coils, for [`DataModel::coils`](crate::server::DataModel::coils) and `discrete_inputs`.
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

/// Writes coils, for [`DataModel::write_coils`](crate::server::DataModel::write_coils).
///
/// # Errors
///
/// [`Exception::IllegalDataAddress`] unless all of them exist; then nothing is changed.
pub fn write_coils<I: Items<Item = bool>>(
    items: &mut I,
    first: u16,
    values: Coils<'_>,
) -> Result<(), Exception> {
    check(items, first, values.len())?;
    put(items, first, values.iter());
    Ok(())
}

/// The item at `offset` in a block that was checked and begins at `first`.
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

/// Sets the cell at this index; `false` behind the last.
#[inline(always)]
pub(super) fn set_cell<T>(cells: &mut [T], index: u16, value: T) -> bool {
    let cell = cells.get_mut(usize::from(index));
    cell.map(|cell| *cell = value).is_some()
}

/// An empty array of coils, for a port that has only registers.
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
