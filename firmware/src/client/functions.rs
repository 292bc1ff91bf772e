//! A method for each function.
//!
//! The caller lends the memory that a read fills, and gets it back when the method returns. Therefore it is filled at
//! t1.5 already, when there is time. After an error its content is undefined.

use multidrop_protocol::client::{
    Diagnostic, EventCounter, EventLog, FileData, FileRange, FileRecords, GetEventCounter,
    GetEventLog, Identification, MaskWrite, Raw, ReadBits, ReadExceptionStatus, ReadFifo,
    ReadFiles, ReadIdentification, ReadRegisters, ReadWriteRegisters, ReportServerId, Request,
    RequestError, ReturnQueryData, ServerId, WriteCoil, WriteCoils, WriteFiles, WritePackedCoils,
    WriteRegister, WriteRegisters,
};
use multidrop_protocol::data::Registers;

use super::destination::Destination;
use super::{Client, ClientError};
use crate::line::Line;

impl<L: Line + 'static, const N: usize> Client<L, N> {
    /// Function 01: reads coils from address `first` on, 1..=2000, the length of `into`.
    pub async fn read_coils(
        &self,
        unit: u8,
        first: u16,
        into: &mut [bool],
    ) -> Result<(), ClientError> {
        let request = ReadBits::coils(first, count(into.len()));
        self.read_bits(unit, request, into).await
    }

    /// Function 02: reads discrete inputs from address `first` on, 1..=2000, the length of `into`.
    pub async fn read_discrete_inputs(
        &self,
        unit: u8,
        first: u16,
        into: &mut [bool],
    ) -> Result<(), ClientError> {
        let request = ReadBits::discrete_inputs(first, count(into.len()));
        self.read_bits(unit, request, into).await
    }

    async fn read_bits(
        &self,
        unit: u8,
        request: ReadBits,
        into: &mut [bool],
    ) -> Result<(), ClientError> {
        self.read_into(unit, &request, Destination::Bits(into))
            .await
    }

    /// Function 01: reads `count` coils from address `first` on, 1..=2000, eight to a byte, the first in the lowest
    /// bit of the first byte. `into` must have a byte for each eight coils begun.
    pub async fn read_packed_coils(
        &self,
        unit: u8,
        first: u16,
        count: u16,
        into: &mut [u8],
    ) -> Result<(), ClientError> {
        self.read_packed(unit, ReadBits::coils(first, count), count, into)
            .await
    }

    /// Function 02: reads `count` discrete inputs from address `first` on, 1..=2000, packed as by
    /// [`read_packed_coils`](Self::read_packed_coils).
    pub async fn read_packed_discrete_inputs(
        &self,
        unit: u8,
        first: u16,
        count: u16,
        into: &mut [u8],
    ) -> Result<(), ClientError> {
        self.read_packed(unit, ReadBits::discrete_inputs(first, count), count, into)
            .await
    }

    async fn read_packed(
        &self,
        unit: u8,
        request: ReadBits,
        count: u16,
        into: &mut [u8],
    ) -> Result<(), ClientError> {
        check_room(into.len(), usize::from(count).div_ceil(8))?;
        self.read_into(unit, &request, Destination::Packed(into))
            .await
    }

    /// Function 03: reads holding registers from address `first` on, 1..=125, the length of `into`.
    pub async fn read_holding_registers(
        &self,
        unit: u8,
        first: u16,
        into: &mut [u16],
    ) -> Result<(), ClientError> {
        let request = ReadRegisters::holding(first, count(into.len()));
        self.read_registers(unit, request, into).await
    }

    /// Function 04: reads input registers from address `first` on, 1..=125, the length of `into`.
    pub async fn read_input_registers(
        &self,
        unit: u8,
        first: u16,
        into: &mut [u16],
    ) -> Result<(), ClientError> {
        let request = ReadRegisters::input(first, count(into.len()));
        self.read_registers(unit, request, into).await
    }

    async fn read_registers(
        &self,
        unit: u8,
        request: ReadRegisters,
        into: &mut [u16],
    ) -> Result<(), ClientError> {
        self.read_into(unit, &request, Destination::Registers(into))
            .await
    }

    /// Function 05: switches a coil on or off.
    pub async fn write_coil(&self, unit: u8, address: u16, on: bool) -> Result<(), ClientError> {
        self.write(unit, &WriteCoil { address, on }).await
    }

    /// Function 06: writes a holding register.
    pub async fn write_register(
        &self,
        unit: u8,
        address: u16,
        value: u16,
    ) -> Result<(), ClientError> {
        self.write(unit, &WriteRegister { address, value }).await
    }

    /// Function 07: reads the exception status, eight bits that the server's application defines.
    pub async fn read_exception_status(&self, unit: u8) -> Result<u8, ClientError> {
        let request = ReadExceptionStatus;
        self.read_with(unit, &request, |frame| Ok(request.answer(frame)?))
            .await
    }

    /// Function 08 except sub-function 0000. Returns the counter or register that was requested, or the echoed data;
    /// 0 if there is no answer.
    pub async fn diagnose(&self, unit: u8, request: Diagnostic) -> Result<u16, ClientError> {
        match self.transact(unit, &request).await? {
            Some(reply) => Ok(request.answer(reply.bytes())?),
            // After a broadcast or Force Listen Only Mode there is no answer.
            None => Ok(0),
        }
    }

    /// Function 08, sub-function 0000: sends 0..=250 bytes and accepts only their echo.
    pub async fn return_query_data(&self, unit: u8, data: &[u8]) -> Result<(), ClientError> {
        self.write(unit, &ReturnQueryData { data }).await
    }

    /// Function 0B: reads the event counter.
    pub async fn event_counter(&self, unit: u8) -> Result<EventCounter, ClientError> {
        let request = GetEventCounter;
        self.read_with(unit, &request, |frame| Ok(request.answer(frame)?))
            .await
    }

    /// Function 0C: reads the event log, and returns the result of `read`.
    pub async fn event_log<R>(
        &self,
        unit: u8,
        read: impl FnOnce(EventLog<'_>) -> R,
    ) -> Result<R, ClientError> {
        let request = GetEventLog;
        self.read_with(unit, &request, |frame| Ok(read(request.answer(frame)?)))
            .await
    }

    /// Function 0F: writes coils from address `first` on, 1..=1968.
    pub async fn write_coils(
        &self,
        unit: u8,
        first: u16,
        values: &[bool],
    ) -> Result<(), ClientError> {
        self.write(unit, &WriteCoils { first, values }).await
    }

    /// Function 0F: writes `count` coils from address `first` on, 1..=1968, eight to a byte, the first in the lowest
    /// bit of the first byte.
    pub async fn write_packed_coils(
        &self,
        unit: u8,
        first: u16,
        count: u16,
        bytes: &[u8],
    ) -> Result<(), ClientError> {
        let request = WritePackedCoils {
            first,
            count,
            bytes,
        };
        self.write(unit, &request).await
    }

    /// Function 10: writes holding registers from address `first` on, 1..=123.
    pub async fn write_registers(
        &self,
        unit: u8,
        first: u16,
        values: &[u16],
    ) -> Result<(), ClientError> {
        self.write(unit, &WriteRegisters { first, values }).await
    }

    /// Function 11: reads the server's id, and returns the result of `read`.
    pub async fn report_server_id<R>(
        &self,
        unit: u8,
        read: impl FnOnce(ServerId<'_>) -> R,
    ) -> Result<R, ClientError> {
        let request = ReportServerId;
        self.read_with(unit, &request, |frame| Ok(read(request.answer(frame)?)))
            .await
    }

    /// Function 14: reads file records, and returns the result of `read`, which gets them group by group.
    pub async fn read_files<R>(
        &self,
        unit: u8,
        groups: &[FileRange],
        read: impl FnOnce(FileRecords<'_>) -> R,
    ) -> Result<R, ClientError> {
        let request = ReadFiles { groups };
        self.read_with(unit, &request, |frame| Ok(read(request.answer(frame)?)))
            .await
    }

    /// Function 15: writes file records, all groups or none.
    pub async fn write_files(&self, unit: u8, groups: &[FileData<'_>]) -> Result<(), ClientError> {
        self.write(unit, &WriteFiles { groups }).await
    }

    /// Function 16: sets a register to `(current & and) | (or & !and)`.
    pub async fn mask_write_register(
        &self,
        unit: u8,
        address: u16,
        and: u16,
        or: u16,
    ) -> Result<(), ClientError> {
        self.write(unit, &MaskWrite { address, and, or }).await
    }

    /// Function 17: writes 1..=121 registers from `write_first` on, then reads 1..=125 registers from `first` on, the
    /// length of `into`. Unit 0 is refused, since a broadcast has no answer.
    pub async fn read_write_registers(
        &self,
        unit: u8,
        first: u16,
        into: &mut [u16],
        write_first: u16,
        values: &[u16],
    ) -> Result<(), ClientError> {
        let request = ReadWriteRegisters {
            first,
            count: count(into.len()),
            write_first,
            values,
        };
        self.read_into(unit, &request, Destination::Registers(into))
            .await
    }

    /// Function 18: reads a FIFO queue of at most 31 registers, and returns the result of `read`.
    pub async fn read_fifo<R>(
        &self,
        unit: u8,
        pointer: u16,
        read: impl FnOnce(Registers<'_>) -> R,
    ) -> Result<R, ClientError> {
        let request = ReadFifo { pointer };
        self.read_with(unit, &request, |frame| Ok(read(request.answer(frame)?)))
            .await
    }

    /// Function 2B, MEI type 0E: reads device identification objects, and returns the result of `read`. `code` is 1
    /// (basic), 2 (regular) or 3 (extended) for the objects from `object` on, or 4 for `object` alone.
    pub async fn read_identification<R>(
        &self,
        unit: u8,
        code: u8,
        object: u8,
        read: impl FnOnce(Identification<'_>) -> R,
    ) -> Result<R, ClientError> {
        let request = ReadIdentification { code, object };
        self.read_with(unit, &request, |frame| Ok(read(request.answer(frame)?)))
            .await
    }

    /// Sends any function with any data, and returns the result of `read`, which gets the answer's data; `None` after
    /// a broadcast.
    pub async fn call<R>(
        &self,
        unit: u8,
        function: u8,
        data: &[u8],
        read: impl FnOnce(&[u8]) -> R,
    ) -> Result<Option<R>, ClientError> {
        let request = Raw { function, data };
        let reply = self.transact(unit, &request).await?;
        Ok(reply.map(|reply| read(request.answer(reply.bytes()))))
    }

    /// Sends a request that reads into `into` at t1.5.
    async fn read_into(
        &self,
        unit: u8,
        request: &dyn Request,
        mut into: Destination<'_>,
    ) -> Result<(), ClientError> {
        self.run(unit, request, Some(&mut into)).await.map(drop)
    }

    /// Sends a request whose answer holds no data of interest.
    async fn write(&self, unit: u8, request: &dyn Request) -> Result<(), ClientError> {
        self.transact(unit, request).await.map(drop)
    }

    /// Sends a request that reads, and calls `read` with the answer when it stands.
    async fn read_with<R>(
        &self,
        unit: u8,
        request: &dyn Request,
        read: impl FnOnce(&[u8]) -> Result<R, ClientError>,
    ) -> Result<R, ClientError> {
        match self.transact(unit, request).await? {
            Some(reply) => read(reply.bytes()),
            // A request that reads has an answer, unless it was sent as a broadcast.
            None => Err(ClientError::Timeout),
        }
    }
}

/// The number of items as 16 bits. A larger number becomes one that the request refuses.
fn count(len: usize) -> u16 {
    len.min(usize::from(u16::MAX)) as u16
}

/// Checks that `room` is enough for the answer.
fn check_room(room: usize, needed: usize) -> Result<(), RequestError> {
    if room < needed {
        return Err(RequestError::Room {
            room: count(room),
            needed: count(needed),
        });
    }
    Ok(())
}
