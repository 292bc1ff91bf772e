//! What a server reads and writes.

use super::{ApplicationFunction, Conformity, Function, FunctionSet};
use crate::data::{BytesOut, Coils, CoilsOut, Registers, RegistersOut};
use crate::exception::Exception;

/// The four tables of a server (APP 4.3), asked block by block, and what its other functions tell.
///
/// A block never runs past address 65535 and holds at least one item; it exists if each of its items does. What is not
/// implemented does not exist: its default answers [`Exception::IllegalDataAddress`].
///
/// A read may be asked for a request that turns out void, so it must have no effect of its own. A write is called only after
/// its check passed, with no other call in between.
#[allow(unused_variables)]
pub trait DataModel: Sized + 'static {
    /// The standard's functions that the server has. One that is not among them takes no flash.
    const FUNCTIONS: FunctionSet = FunctionSet::EIGHT;

    /// Functions of the application.
    ///
    /// Function codes 00 and 80..=FF are always answered with exception 01 (APP 4.1).
    const APPLICATION: &'static [ApplicationFunction<Self>] = &[];

    /// What is called for every function code that is neither the server's nor in [`APPLICATION`](DataModel::APPLICATION), in
    /// place of exception 01. It is not executed when broadcast.
    const DEFAULT: Option<Function<Self>> = None;

    /// How much Read Device Identification tells.
    const CONFORMITY: Conformity = Conformity::Basic;

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

    /// Whether these holding registers, from address `first` on, can be read: for Read/Write Multiple Registers, which writes
    /// before it reads and must know before. By default they are read, a few at a time.
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

    /// Whether an earlier request is still being worked on: the status of Get Comm Event Counter and Log (APP 6.9).
    fn is_busy(&mut self) -> bool {
        false
    }

    /// What Report Server ID tells (APP 6.13): the id, the run indicator (0x00 or 0xFF), and what else there is to say. Up to
    /// 251 bytes; what does not fit is left out.
    fn server_id(&mut self, out: &mut BytesOut<'_>) {}

    /// Copies the queue at this pointer to `out`, which has room for 31, and returns how many are queued. They stay queued
    /// (APP 6.18).
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] if there is no such queue. One with over 31 registers is refused by the server.
    fn fifo_queue(&mut self, pointer: u16, out: RegistersOut<'_>) -> Result<u16, Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Writes an object of the device identification to `out`; `false` if there is no such object. 0 is the vendor, 1 the
    /// product code, 2 the revision, 3 to 6 are optional, 0x80 to 0xFF the application's (APP 6.21). Up to 244 bytes.
    fn device_object(&mut self, id: u8, out: &mut BytesOut<'_>) -> bool {
        false
    }

    /// Reads registers of a record file, at least 1: `file` 1..=65535, records from `record` on, the last one at most 9999
    /// (APP 6.14).
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless file and records exist.
    fn file_records(
        &mut self,
        file: u16,
        record: u16,
        out: RegistersOut<'_>,
    ) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Whether these records may be written so (APP 6.15).
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] unless file and records exist, [`Exception::IllegalDataValue`] for a value that is
    /// not allowed.
    fn check_file_records(
        &self,
        file: u16,
        record: u16,
        values: Registers<'_>,
    ) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }

    /// Writes records that were checked.
    ///
    /// # Errors
    ///
    /// [`Exception::ServerDeviceFailure`] if the operation failed; nothing may have changed then.
    fn write_file_records(
        &mut self,
        file: u16,
        record: u16,
        values: Registers<'_>,
    ) -> Result<(), Exception> {
        Err(Exception::IllegalDataAddress)
    }
}
