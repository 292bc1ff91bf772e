//! A dense bank of coils.

use crate::data::{Coils, CoilsOut};
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
    /// A bank of `count` coils that are off.
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
        assert!(count != 0, "bank of no coils");
        assert!(
            (count - 1) as usize / 8 < BYTES,
            "more coils than there are bits"
        );
        assert!(count - 1 <= u16::MAX - base, "bank runs past address 65535");
        CoilBank { base, count, bytes }
    }

    /// The address of the first coil.
    #[inline]
    pub const fn base(&self) -> u16 {
        self.base
    }

    /// How many coils there are.
    #[inline]
    pub const fn count(&self) -> u16 {
        self.count
    }

    /// All coils, eight to a byte. Bits behind the last coil mean nothing.
    #[inline]
    pub const fn bytes(&self) -> &[u8; BYTES] {
        &self.bytes
    }

    /// All coils, eight to a byte, to be changed.
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

    /// Whether the bank has the coils from `first` on, `count` of them.
    #[inline]
    pub fn contains(&self, first: u16, count: u16) -> bool {
        self.block(first, count).is_some()
    }

    /// Answers [`DataModel::coils`](crate::server::DataModel::coils) or `discrete_inputs`.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the bank has all of them.
    pub fn read(&self, first: u16, mut out: CoilsOut<'_>) -> Result<(), Exception> {
        let offset = self
            .block(first, out.len())
            .ok_or(Exception::IllegalDataAddress)?;
        let shift = offset as u8 & 7;
        let bytes = self.bytes.get(usize::from(offset >> 3)..).unwrap_or(&[]);
        let mut following = bytes.iter();
        let mut low = following.next().copied().unwrap_or(0);
        for byte in out.bytes_mut() {
            let high = following.next().copied().unwrap_or(0);
            *byte = (u16::from_le_bytes([low, high]) >> shift) as u8;
            low = high;
        }
        Ok(())
    }

    /// Answers [`DataModel::check_coils`](crate::server::DataModel::check_coils).
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

    /// Answers [`DataModel::write_coils`](crate::server::DataModel::write_coils). Does not fail after
    /// [`check`](CoilBank::check) has passed.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the bank has all of them; nothing is changed then.
    pub fn write(&mut self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        let offset = self
            .block(first, values.len())
            .ok_or(Exception::IllegalDataAddress)?;
        let shift = offset as u8 & 7;
        let mut left = values.len();
        let mut cells = self
            .bytes
            .get_mut(usize::from(offset >> 3)..)
            .unwrap_or(&mut [])
            .iter_mut();
        let Some(mut cell) = cells.next() else {
            return Ok(());
        };
        for &byte in values.bytes() {
            let used: u8 = if left >= 8 { 0xFF } else { (1 << left) - 1 };
            let [mask_low, mask_high] = (u16::from(used) << shift).to_le_bytes();
            let [low, high] = (u16::from(byte) << shift).to_le_bytes();
            *cell = *cell & !mask_low | low & mask_low;
            left = left.saturating_sub(8);
            let Some(next) = cells.next() else { break };
            cell = next;
            *cell = *cell & !mask_high | high & mask_high;
        }
        Ok(())
    }

    /// Where the block begins in the bank, `None` unless the bank has all of it.
    #[inline]
    fn block(&self, first: u16, count: u16) -> Option<u16> {
        let offset = first.checked_sub(self.base)?;
        (offset < self.count && count <= self.count - offset).then_some(offset)
    }
}
