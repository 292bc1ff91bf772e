//! The data model of the application `registers` on every board: `COUNT` items of each table from address 0.

use multidrop::protocol::data::{Coils, CoilsOut, Registers, RegistersOut};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::registers::{Bank, CoilBank, within};
use multidrop::protocol::server::DataModel;

// ANCHOR: bank
/// Holding registers and coils are stored; inputs follow from their address.
pub struct Yardstick<const COUNT: usize, const BYTES: usize> {
    registers: Bank<COUNT>,
    coils: CoilBank<BYTES>,
}
// ANCHOR_END: bank

impl<const COUNT: usize, const BYTES: usize> Yardstick<COUNT, BYTES> {
    /// A model with all registers 0 and all coils off.
    ///
    /// # Panics
    /// Unless `BYTES` is the number of bytes that `COUNT` coils take.
    pub const fn new() -> Self {
        const {
            assert!(
                BYTES == COUNT.div_ceil(8),
                "BYTES must be one byte for each eight coils"
            )
        };
        Self {
            registers: Bank::new(0),
            coils: CoilBank::new(0, COUNT as u16),
        }
    }
}

impl<const COUNT: usize, const BYTES: usize> Default for Yardstick<COUNT, BYTES> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const COUNT: usize, const BYTES: usize> DataModel for Yardstick<COUNT, BYTES> {
    const WRITES_MAY_FAIL: bool = false;

    fn coils(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        self.coils.read(first, out)
    }

    fn discrete_inputs(&mut self, first: u16, mut out: CoilsOut<'_>) -> Result<(), Exception> {
        within(first, out.len(), COUNT as u16)?;
        out.fill_from((first..).map(|address| address % 3 == 0));
        Ok(())
    }

    // ANCHOR: read
    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.registers.read(first, out)
    }
    // ANCHOR_END: read

    fn input_registers(&mut self, first: u16, mut out: RegistersOut<'_>) -> Result<(), Exception> {
        within(first, out.len() as u16, COUNT as u16)?;
        out.fill_from((first..).map(|address| 0x1000 + address));
        Ok(())
    }

    fn check_coils(&self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        self.coils.check(first, values)
    }

    // ANCHOR: handed_on
    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.registers.check(first, values)
    }
    // ANCHOR_END: handed_on

    fn write_coils(&mut self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        self.coils.write(first, values)
    }

    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.registers.write(first, values)
    }
}
