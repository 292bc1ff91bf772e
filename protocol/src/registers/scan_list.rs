//! The scan list, an array of four rows: addresses, data, slave ids, register offsets.

use super::items::{Items, ScanEntry, set_cell};
use crate::UNIT_MAX;
use crate::message::Message;

/// Registers of many slaves, which a master reads or writes one by one.
///
/// Entry n of the list is a transaction with slave `units[n]` and the item of index `offsets[n]`: the register at
/// `addresses[offsets[n]]`, with its value in `cells[offsets[n]]`. An address may occur more than once, for different
/// slaves.
///
/// ```
/// use multidrop_protocol::registers::{ScanEntry, Items, ScanList};
///
/// /// Registers 4 and 1000 of slave 1, and 4 of slave 2.
/// const LIST: ScanList<3> = ScanList::new([4, 1000, 4], [1, 1, 2]);
/// assert_eq!(LIST.entry(2), Some(ScanEntry { unit: 2, index: 2 }));
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ScanList<const N: usize> {
    addresses: [u16; N],
    cells: [u16; N],
    units: [u8; N],
    offsets: [u16; N],
}

impl<const N: usize> ScanList<N> {
    /// A scan list whose entry n is for the item of index n; values are 0.
    ///
    /// # Panics
    ///
    /// If a slave id is not 0..=247; in a `const` that is a build error.
    pub const fn new(addresses: [u16; N], units: [u8; N]) -> ScanList<N> {
        let mut offsets = [0; N];
        let mut i = 0;
        while i < N && i <= u16::MAX as usize {
            offsets[i] = i as u16;
            i += 1;
        }
        ScanList::from_rows(addresses, [0; N], units, offsets)
    }

    /// A scan list with all four rows.
    ///
    /// # Panics
    ///
    /// If a slave id is not 0..=247, or an offset is not below `N`; in a `const` that is a build error.
    pub const fn from_rows(
        addresses: [u16; N],
        cells: [u16; N],
        units: [u8; N],
        offsets: [u16; N],
    ) -> ScanList<N> {
        assert!(
            N >= 1 && N as u32 <= 65_536,
            "scan list: the number of items must be 1..=65536"
        );
        let mut i = 0;
        while i < N {
            let place = Message::new().text("scan list: place ").number(i as u32);
            if units[i] > UNIT_MAX {
                place
                    .text(": slave id is ")
                    .number(units[i] as u32)
                    .text(", must be 0..=247")
                    .fail();
            }
            if offsets[i] as usize >= N {
                place
                    .text(": register offset is ")
                    .number(offsets[i] as u32)
                    .text(", must be 0..=")
                    .number(N as u32 - 1)
                    .fail();
            }
            i += 1;
        }
        ScanList {
            addresses,
            cells,
            units,
            offsets,
        }
    }

    /// The values of all items.
    #[inline]
    pub const fn cells(&self) -> &[u16; N] {
        &self.cells
    }

    /// The values of all items, mutable.
    #[inline]
    pub const fn cells_mut(&mut self) -> &mut [u16; N] {
        &mut self.cells
    }
}

impl<const N: usize> Items for ScanList<N> {
    type Item = u16;
    const SPARSE: bool = true;
    const SCANS: bool = true;

    fn len(&self) -> usize {
        N
    }

    fn item(&self, index: u16) -> Option<u16> {
        self.cells.get(usize::from(index)).copied()
    }

    fn set_item(&mut self, index: u16, value: u16) -> bool {
        set_cell(&mut self.cells, index, value)
    }

    fn address_of(&self, index: u16) -> Option<u16> {
        self.addresses.get(usize::from(index)).copied()
    }

    /// Returns the first index if several slaves have the address.
    fn index_of(&self, address: u16) -> Option<u16> {
        let index = self.addresses.iter().position(|own| *own == address)?;
        Some(index as u16)
    }

    fn rebase(&mut self, _: u16) -> bool {
        true
    }

    fn entry(&self, place: u16) -> Option<ScanEntry> {
        let place = usize::from(place);
        Some(ScanEntry {
            unit: *self.units.get(place)?,
            index: *self.offsets.get(place)?,
        })
    }
}
