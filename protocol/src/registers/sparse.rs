//! Items at arbitrary addresses: the array of two rows, addresses and data.

use super::items::{self, Items, set_cell};
use crate::data::{Coils, CoilsOut, Registers, RegistersOut};
use crate::exception::Exception;
use crate::message::Message;

/// Registers at the addresses of a table, which are the only addresses of the bank.
pub type SparseBank<const N: usize> = Sparse<u16, N>;

/// Coils at the addresses of a table, which are the only addresses of the bank. Each coil has an element of its own;
/// they are packed only on the wire.
pub type SparseCoilBank<const N: usize> = Sparse<bool, N>;

/// Registers or coils at the addresses of a table, which are the only addresses of the bank.
///
/// ```
/// use multidrop_protocol::registers::SparseBank;
///
/// const REGS: SparseBank<10> =
///     SparseBank::new([4, 5, 6, 7, 9, 1000, 1001, 30_000, 30_004, 63_023]);
/// assert_eq!(REGS.addresses()[6], 1001);
/// ```
///
/// ```compile_fail,E0080
/// # use multidrop_protocol::registers::SparseBank;
/// // sparse bank: address 2 is 5, must be above the one before, which is 5
/// const REGS: SparseBank<3> = SparseBank::new([4, 5, 5]);
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sparse<T, const N: usize> {
    addresses: [u16; N],
    cells: [T; N],
}

impl<const N: usize> SparseBank<N> {
    /// A bank with all registers 0, at these addresses in ascending order.
    ///
    /// # Panics
    ///
    /// If an address is not above the one before it; in a `const` that is a build error.
    pub const fn new(addresses: [u16; N]) -> SparseBank<N> {
        Sparse::from_cells(addresses, [0; N])
    }

    /// Reads registers, for [`DataModel::holding_registers`](crate::server::DataModel::holding_registers) and
    /// `input_registers`.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the bank has all of them.
    pub fn read(&self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        items::read_registers(self, first, out)
    }

    /// Checks registers, for [`DataModel::check_registers`](crate::server::DataModel::check_registers).
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the bank has all of them.
    pub fn check(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        items::check(self, first, values.len() as u16)
    }

    /// Writes registers, for [`DataModel::write_registers`](crate::server::DataModel::write_registers). Does not fail
    /// after [`check`](Self::check) has passed.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the bank has all of them; then nothing is changed.
    pub fn write(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        items::write_registers(self, first, values)
    }
}

impl<const N: usize> SparseCoilBank<N> {
    /// A bank with all coils off, at these addresses in ascending order.
    ///
    /// # Panics
    ///
    /// If an address is not above the one before; in a `const` that is a build error.
    pub const fn new(addresses: [u16; N]) -> SparseCoilBank<N> {
        Sparse::from_cells(addresses, [false; N])
    }

    /// Reads coils, for [`DataModel::coils`](crate::server::DataModel::coils) and `discrete_inputs`.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the bank has all of them.
    pub fn read(&self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        items::read_coils(self, first, out)
    }

    /// Checks coils, for [`DataModel::check_coils`](crate::server::DataModel::check_coils).
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the bank has all of them.
    pub fn check(&self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        items::check(self, first, values.len())
    }

    /// Writes coils, for [`DataModel::write_coils`](crate::server::DataModel::write_coils). Does not fail after
    /// [`check`](Self::check) has passed.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the bank has all of them; then nothing is changed.
    pub fn write(&mut self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        items::write_coils(self, first, values)
    }
}

impl<T: Copy + Default, const N: usize> Sparse<T, N> {
    /// A bank with these values at these addresses in ascending order.
    ///
    /// # Panics
    ///
    /// If an address is not above the one before; in a `const` that is a build error.
    pub const fn from_cells(addresses: [u16; N], cells: [T; N]) -> Sparse<T, N> {
        assert!(
            N as u32 <= 65_536,
            "sparse bank: the number of items must be at most 65536"
        );
        let mut i = 1;
        while i < N {
            if addresses[i] <= addresses[i - 1] {
                Message::new()
                    .text("sparse bank: address ")
                    .number(i as u32)
                    .text(" is ")
                    .number(addresses[i] as u32)
                    .text(", must be above the one before, which is ")
                    .number(addresses[i - 1] as u32)
                    .fail();
            }
            i += 1;
        }
        Sparse { addresses, cells }
    }

    /// The addresses of all items, in ascending order.
    #[inline]
    pub const fn addresses(&self) -> &[u16; N] {
        &self.addresses
    }

    /// The values of all items, in the order of the addresses.
    #[inline]
    pub const fn cells(&self) -> &[T; N] {
        &self.cells
    }

    /// The values of all items, mutable.
    #[inline]
    pub const fn cells_mut(&mut self) -> &mut [T; N] {
        &mut self.cells
    }
}

impl<T: Copy + Default, const N: usize> Items for Sparse<T, N> {
    type Item = T;
    const SPARSE: bool = true;

    fn len(&self) -> usize {
        N
    }

    fn item(&self, index: u16) -> Option<T> {
        self.cells.get(usize::from(index)).copied()
    }

    fn set_item(&mut self, index: u16, value: T) -> bool {
        set_cell(&mut self.cells, index, value)
    }

    fn address_of(&self, index: u16) -> Option<u16> {
        self.addresses.get(usize::from(index)).copied()
    }

    fn index_of(&self, address: u16) -> Option<u16> {
        let index = self.addresses.binary_search(&address).ok()?;
        Some(index as u16)
    }

    fn rebase(&mut self, _: u16) -> bool {
        true
    }
}
