//! What a server reads and writes.

use crate::data::{Coils, CoilsOut, Registers, RegistersOut};
use crate::exception::Exception;

/// The four tables of a server (APP 4.3), asked block by block.
///
/// A block never runs past address 65535 and holds at least one item. What is not implemented does not exist: its default
/// answers [`Exception::IllegalDataAddress`].
///
/// A read may be asked for a request that turns out void, so it must have no effect of its own. A write is called only after
/// its check passed, with no other call in between.
#[allow(unused_variables)]
pub trait DataModel {
    /// Whether a write can still fail after its check passed.
    ///
    /// `false` is a promise; in return the answer may start while the write is being executed, and a failure then is not
    /// told to anybody.
    const WRITES_MAY_FAIL: bool = true;

    /// Reads coils from address `first` on, 1..=2000 of them.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless all of them exist.
    fn coils(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Reads discrete inputs from address `first` on, 1..=2000 of them.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless all of them exist.
    fn discrete_inputs(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Reads holding registers from address `first` on, 1..=125 of them.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless all of them exist.
    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Reads input registers from address `first` on, 1..=125 of them.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless all of them exist.
    fn input_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Whether all these coils, from address `first` on, may be written so. 1..=1968 of them.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless all of them exist.
    fn check_coils(&self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Whether all these holding registers, from address `first` on, may be written so. 1..=123 of them.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless all of them exist, [`Exception::IllegalDataValue`] for a value that is not
    /// allowed.
    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Writes coils that were checked.
    ///
    /// # Errors
    ///
    /// [`Exception::ServerDeviceFailure`] if the operation failed; nothing may have changed then.
    fn write_coils(&mut self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Writes holding registers that were checked.
    ///
    /// # Errors
    ///
    /// [`Exception::ServerDeviceFailure`] if the operation failed; nothing may have changed then.
    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }
}
