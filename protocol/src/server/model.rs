//! The data model of a server.

use super::{ApplicationFunction, Conformity, Function, FunctionSet};
use crate::data::{BytesOut, Coils, CoilsOut, Registers, RegistersOut};
use crate::exception::Exception;

/// The four tables of a server (APP 4.3), which are read and written in blocks, and the data of its other functions.
///
/// A block never runs past address 65535 and has at least one item; it exists if all of its items do. A table that is
/// not implemented does not exist: its methods return [`Exception::IllegalDataAddress`] by default.
///
/// A read may be for a request that becomes void, so it must have no side effect. A write is called only after its
/// check has passed, with no other call in between.
#[allow(unused_variables)]
pub trait DataModel: Sized + 'static {
    /// The standard's functions of the server. Others take no flash.
    const FUNCTIONS: FunctionSet = FunctionSet::EIGHT;

    /// Functions of the application, by function code.
    ///
    /// Function codes 00 and 80..=FF are always answered with exception 01 (APP 4.1).
    const APPLICATION: &'static [ApplicationFunction<Self>] = &[];

    /// The function that is called for every function code that is neither the server's nor in
    /// [`APPLICATION`](DataModel::APPLICATION), in place of exception 01. It is not executed as a broadcast.
    const DEFAULT: Option<Function<Self>> = None;

    /// The conformity level of Read Device Identification.
    const CONFORMITY: Conformity = Conformity::Basic;

    /// Whether a write can fail after its check has passed.
    ///
    /// If it is `false`, the answer may be sent while the write is being executed, and a failure is not reported to
    /// the client.
    const WRITES_MAY_FAIL: bool = true;

    /// Reads coils from address `first` on, 1..=2000.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless all of them exist.
    fn coils(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Reads discrete inputs from address `first` on, 1..=2000.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless all of them exist.
    fn discrete_inputs(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Reads holding registers from address `first` on, 1..=125.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless all of them exist.
    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Reads input registers from address `first` on, 1..=125.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless all of them exist.
    fn input_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Checks whether these values may be written to the coils from address `first` on, 1..=1968.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless all of them exist.
    fn check_coils(&self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Checks whether these values may be written to the holding registers from address `first` on, 1..=123.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless all of them exist, [`Exception::IllegalDataValue`] for a value that
    /// is not allowed.
    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Writes coils that were checked before.
    ///
    /// # Errors
    ///
    /// [`Exception::ServerDeviceFailure`] if the operation failed; then nothing may have changed.
    fn write_coils(&mut self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Writes holding registers that were checked before.
    ///
    /// # Errors
    ///
    /// [`Exception::ServerDeviceFailure`] if the operation failed; then nothing may have changed.
    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Checks whether the holding registers from address `first` on can be read, for Read/Write Multiple Registers,
    /// which writes before it reads. By default the registers are read, a few at a time.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless all of them exist.
    fn check_holding_registers(&mut self, first: u16, count: u16) -> Result<(), Exception> {
        let mut cells = [0; 16];
        let (mut first, mut left) = (first, count);
        while left > 0 {
            let some = left.min(8);
            let (bytes, _) = cells.split_at_mut(usize::from(some) * 2);
            self.holding_registers(first, RegistersOut::new(bytes))?;
            first = first.wrapping_add(some);
            left -= some;
        }
        Ok(())
    }

    /// The eight bits of Read Exception Status (APP 6.7).
    fn exception_status(&mut self) -> u8 {
        0
    }

    /// Whether an earlier request is still being executed: the status of Get Comm Event Counter and Log (APP 6.9).
    fn is_busy(&mut self) -> bool {
        false
    }

    /// Writes the data of Report Server ID (APP 6.13): the id, the run indicator (0x00 or 0xFF), and additional data.
    /// Bytes after the first 251 are dropped.
    fn server_id(&mut self, out: &mut BytesOut<'_>) {}

    /// Copies the queue at this pointer to `out`, which has room for 31 registers, and returns their number. They
    /// stay in the queue (APP 6.18).
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] if there is no such queue. The server refuses a queue with over 31
    /// registers.
    fn fifo_queue(&mut self, pointer: u16, out: RegistersOut<'_>) -> Result<u16, Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Writes an object of the device identification to `out`; returns `false` if there is no such object. 0 is the
    /// vendor, 1 the product code, 2 the revision; 3 to 6 are optional, 0x80 to 0xFF are for the application (APP
    /// 6.21). Up to 244 bytes.
    fn device_object(&mut self, id: u8, out: &mut BytesOut<'_>) -> bool {
        false
    }

    /// Reads registers of a record file, at least 1: `file` is 1..=65535, the records begin at `record` and end at
    /// 9999 at most (APP 6.14).
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the file and all records exist.
    fn file_records(
        &mut self,
        file: u16,
        record: u16,
        out: RegistersOut<'_>,
    ) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Checks whether these values may be written to the records (APP 6.15).
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless the file and all records exist, [`Exception::IllegalDataValue`] for a
    /// value that is not allowed.
    fn check_file_records(
        &self,
        file: u16,
        record: u16,
        values: Registers<'_>,
    ) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Writes records that were checked before.
    ///
    /// # Errors
    ///
    /// [`Exception::ServerDeviceFailure`] if the operation failed; then nothing may have changed.
    fn write_file_records(
        &mut self,
        file: u16,
        record: u16,
        values: Registers<'_>,
    ) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }
}
