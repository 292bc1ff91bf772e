//! A dense bank of registers.

use super::items::{Items, set_cell};
use crate::data::{Registers, RegistersOut};
use crate::exception::Exception;

/// `N` registers at the addresses from `base` on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bank<const N: usize> {
    base: u16,
    cells: [u16; N],
}

impl<const N: usize> Bank<N> {
    /// A bank with all registers 0.
    ///
    /// # Panics
    ///
    /// If the bank runs past address 65535; in a `const` that is a build error.
    pub const fn new(base: u16) -> Bank<N> {
        Bank::from_cells(base, [0; N])
    }

    /// A bank of registers with these values.
    ///
    /// # Panics
    ///
    /// If the bank runs past address 65535; in a `const` that is a build error.
    pub const fn from_cells(base: u16, cells: [u16; N]) -> Bank<N> {
        assert!(
            N == 0 || N - 1 <= (u16::MAX - base) as usize,
            "bank runs past address 65535"
        );
        Bank { base, cells }
    }

    /// The address of the first register.
    #[inline]
    pub const fn base(&self) -> u16 {
        self.base
    }

    /// All registers in the order of their addresses.
    #[inline]
    pub const fn cells(&self) -> &[u16; N] {
        &self.cells
    }

    /// All registers in the order of their addresses, mutable.
    #[inline]
    pub const fn cells_mut(&mut self) -> &mut [u16; N] {
        &mut self.cells
    }

    /// The register at this address, `None` outside the bank.
    #[inline]
    pub fn get(&self, address: u16) -> Option<u16> {
        self.cells.get(self.offset(address)?).copied()
    }

    /// Sets the register at this address; `false` outside the bank.
    #[inline]
    pub fn set(&mut self, address: u16, value: u16) -> bool {
        match self
            .offset(address)
            .and_then(|offset| self.cells.get_mut(offset))
        {
            Some(cell) => {
                *cell = value;
                true
            }
            None => false,
        }
    }

    /// Whether the bank has all `count` registers from `first` on.
    #[inline]
    pub fn contains(&self, first: u16, count: usize) -> bool {
        self.block(first, count).is_some()
    }

    /// Reads registers, for [`DataModel::holding_registers`](crate::server::DataModel::holding_registers) and
    /// `input_registers`.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the bank has all of them.
    pub fn read(&self, first: u16, mut out: RegistersOut<'_>) -> Result<(), Exception> {
        let cells = self
            .block(first, out.len())
            .ok_or(Exception::IllegalDataAddress)?;
        out.copy_from(cells);
        Ok(())
    }

    /// Checks registers, for [`DataModel::check_registers`](crate::server::DataModel::check_registers).
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the bank has all of them.
    pub fn check(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        if self.contains(first, values.len()) {
            Ok(())
        } else {
            Err(Exception::IllegalDataAddress)
        }
    }

    /// Writes registers, for [`DataModel::write_registers`](crate::server::DataModel::write_registers). Does not fail
    /// after [`check`](Bank::check) has passed.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the bank has all of them; then nothing is changed.
    pub fn write(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        let cells = self
            .offset(first)
            .and_then(|offset| self.cells.get_mut(offset..))
            .and_then(|cells| cells.get_mut(..values.len()))
            .ok_or(Exception::IllegalDataAddress)?;
        values.copy_to(cells);
        Ok(())
    }

    #[inline]
    fn offset(&self, address: u16) -> Option<usize> {
        address.checked_sub(self.base).map(usize::from)
    }

    #[inline]
    fn block(&self, first: u16, count: usize) -> Option<&[u16]> {
        self.cells.get(self.offset(first)?..)?.get(..count)
    }
}

impl<const N: usize> Items for Bank<N> {
    type Item = u16;
    const SPARSE: bool = false;

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
        if usize::from(index) < N {
            self.base.checked_add(index)
        } else {
            None
        }
    }

    fn index_of(&self, address: u16) -> Option<u16> {
        address
            .checked_sub(self.base)
            .filter(|index| usize::from(*index) < N)
    }

    fn rebase(&mut self, base: u16) -> bool {
        let fits = N == 0 || N - 1 <= usize::from(u16::MAX - base);
        if fits {
            self.base = base;
        }
        fits
    }
}
