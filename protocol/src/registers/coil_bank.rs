//! A dense bank of coils.

use super::Items;
use crate::data::{Coils, CoilsOut, bytes_for};
use crate::exception::Exception;

/// Up to `8 * BYTES` coils or discrete inputs at the addresses from `base` on, packed eight to a byte, the first in the
/// lowest bit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CoilBank<const BYTES: usize> {
    base: u16,
    count: u16,
    bytes: [u8; BYTES],
}

impl<const BYTES: usize> CoilBank<BYTES> {
    /// A bank with all `count` coils off.
    ///
    /// # Panics
    ///
    /// If `count` is 0 or does not fit in `BYTES`, or the bank runs past address 65535; in a `const` that is a build error.
    pub const fn new(base: u16, count: u16) -> CoilBank<BYTES> {
        CoilBank::from_bytes(base, count, [0; BYTES])
    }

    /// A bank of `count` coils with these values.
    ///
    /// # Panics
    ///
    /// If `count` is 0 or does not fit in `BYTES`, or the bank runs past address 65535; in a `const` that is a build error.
    pub const fn from_bytes(base: u16, count: u16, bytes: [u8; BYTES]) -> CoilBank<BYTES> {
        assert!(count != 0, "a coil bank must have at least one coil");
        assert!(
            (count - 1) as usize / 8 < BYTES,
            "a coil bank must have a bit for each coil"
        );
        assert!(count - 1 <= u16::MAX - base, "bank runs past address 65535");
        CoilBank { base, count, bytes }
    }

    /// The address of the first coil.
    #[inline]
    pub const fn base(&self) -> u16 {
        self.base
    }

    /// The number of coils.
    #[inline]
    pub const fn count(&self) -> u16 {
        self.count
    }

    /// All coils, eight to a byte. Bits behind the last coil have no meaning.
    #[inline]
    pub const fn bytes(&self) -> &[u8; BYTES] {
        &self.bytes
    }

    /// All coils, eight to a byte, mutable.
    #[inline]
    pub const fn bytes_mut(&mut self) -> &mut [u8; BYTES] {
        &mut self.bytes
    }

    /// The coil at this address, `None` outside the bank.
    #[inline]
    pub fn get(&self, address: u16) -> Option<bool> {
        let offset = self.block(address, 1)?;
        self.bytes
            .get(usize::from(offset >> 3))
            .map(|byte| byte >> (offset & 7) & 1 != 0)
    }

    /// Sets the coil at this address; `false` outside the bank.
    #[inline]
    pub fn set(&mut self, address: u16, on: bool) -> bool {
        self.write(address, Coils::new(&[on as u8], 1)).is_ok()
    }

    /// Whether the bank has all `count` coils from `first` on.
    #[inline]
    pub fn contains(&self, first: u16, count: u16) -> bool {
        self.block(first, count).is_some()
    }

    /// Reads coils, for [`DataModel::coils`](crate::server::DataModel::coils) and `discrete_inputs`.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the bank has all of them.
    pub fn read(&self, first: u16, mut out: CoilsOut<'_>) -> Result<(), Exception> {
        let offset = self
            .block(first, out.len())
            .ok_or(Exception::IllegalDataAddress)?;
        let out = out.bytes_mut();
        let source = self.bytes.get(usize::from(offset >> 3)..).unwrap_or(&[]);
        // The last byte of the answer may have bits of one more byte of the bank.
        let factor = doubled(8 - (offset as u8 & 7));
        let mut from_next = match source.get(out.len()) {
            Some(&cell) => cell.wrapping_mul(factor),
            None => 0,
        };
        for (byte, &cell) in out.iter_mut().zip(source).rev() {
            // A byte shifted left by eight is the high byte as it is, but the factor for that does not fit.
            let own = if factor == 0 {
                cell
            } else {
                high_of_product(cell, factor)
            };
            *byte = own | from_next;
            from_next = cell.wrapping_mul(factor);
        }
        Ok(())
    }

    /// Checks coils, for [`DataModel::check_coils`](crate::server::DataModel::check_coils).
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the bank has all of them.
    pub fn check(&self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        if self.contains(first, values.len()) {
            Ok(())
        } else {
            Err(Exception::IllegalDataAddress)
        }
    }

    /// Writes coils, for [`DataModel::write_coils`](crate::server::DataModel::write_coils). Does not fail after
    /// [`check`](CoilBank::check) has passed.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the bank has all of them; then nothing is changed.
    pub fn write(&mut self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        let offset = self
            .block(first, values.len())
            .ok_or(Exception::IllegalDataAddress)?;
        let shift = offset as u8 & 7;
        let start = usize::from(offset >> 3);
        let count = bytes_for(values.len() + u16::from(shift));
        let cells = self
            .bytes
            .get_mut(start..)
            .and_then(|cells| cells.get_mut(..count));
        let Some(cells) = cells else {
            return Err(Exception::IllegalDataAddress);
        };
        let (Some(&first_before), Some(&last_before)) = (cells.first(), cells.last()) else {
            return Ok(());
        };

        let factor = doubled(shift);
        let mut from_previous = 0;
        for (cell, &byte) in cells.iter_mut().zip(values.bytes()) {
            *cell = byte.wrapping_mul(factor) | from_previous;
            from_previous = high_of_product(byte, factor);
        }
        if let Some(cell) = cells.get_mut(values.bytes().len()) {
            *cell = from_previous;
        }

        // The neighbours of the block in its first and last byte are restored.
        let before_block = factor - 1;
        if let Some(cell) = cells.first_mut() {
            *cell = (*cell & !before_block) | (first_before & before_block);
        }
        let end = shift.wrapping_add(values.len() as u8) & 7;
        if end != 0
            && let Some(cell) = cells.last_mut()
        {
            let in_block = (1 << end) - 1;
            *cell = (*cell & in_block) | (last_before & !in_block);
        }
        Ok(())
    }

    /// The place of the block in the bank, `None` unless the bank has all of it.
    #[inline]
    fn block(&self, first: u16, count: u16) -> Option<u16> {
        let offset = first.checked_sub(self.base)?;
        (offset < self.count && count <= self.count - offset).then_some(offset)
    }
}

impl<const BYTES: usize> Items for CoilBank<BYTES> {
    type Item = bool;
    const SPARSE: bool = false;

    fn len(&self) -> usize {
        self.count.into()
    }

    fn item(&self, index: u16) -> Option<bool> {
        CoilBank::get(self, self.address_of(index)?)
    }

    fn set_item(&mut self, index: u16, value: bool) -> bool {
        match self.address_of(index) {
            Some(address) => CoilBank::set(self, address, value),
            None => false,
        }
    }

    fn address_of(&self, index: u16) -> Option<u16> {
        if index < self.count {
            self.base.checked_add(index)
        } else {
            None
        }
    }

    fn index_of(&self, address: u16) -> Option<u16> {
        self.block(address, 1)
    }

    fn rebase(&mut self, base: u16) -> bool {
        let fits = self.count - 1 <= u16::MAX - base;
        if fits {
            self.base = base;
        }
        fits
    }
}

/// The factor that shifts left by `times` bits; 0 for eight.
///
/// AVR shifts by one bit at a time, but multiplies two bytes in two cycles. This is a loop because the compiler would
/// turn a product with `1 << times` into a shift.
#[inline(always)]
fn doubled(times: u8) -> u8 {
    let mut factor: u8 = 1;
    let mut left = times;
    while left != 0 {
        factor = factor.wrapping_add(factor);
        left -= 1;
    }
    factor
}

/// The high byte of the product.
#[inline(always)]
fn high_of_product(byte: u8, factor: u8) -> u8 {
    ((u16::from(byte) * u16::from(factor)) >> 8) as u8
}
