//! A method for each function.
//!
//! What a read fills is the caller's, who has lent it and looks at it only when the method has returned; so it
//! is filled at t1.5 already, where there is time. After an error its content means nothing.

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
    /// Function 01: coils from address `first` on, 1..=2000, as many as `into` has.
    pub async fn read_coils(
        &self,
        unit: u8,
        first: u16,
        into: &mut [bool],
    ) -> Result<(), ClientError> {
        let request = ReadBits::coils(first, count(into.len()));
        self.read_bits(unit, request, into).await
    }

    /// Function 02: discrete inputs from address `first` on, 1..=2000, as many as `into` has.
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
        self.ask(unit, &request, Destination::Bits(into)).await
    }

    /// Function 01: `count` coils from address `first` on, 1..=2000, eight to a byte, the first in the lowest
    /// bit of the first byte. `into` has a byte for each eight begun, or more.
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

    /// Function 02: `count` discrete inputs from address `first` on, as
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
        room(into.len(), usize::from(count).div_ceil(8))?;
        self.ask(unit, &request, Destination::Packed(into)).await
    }

    /// Function 03: holding registers from address `first` on, 1..=125, as many as `into` has.
    pub async fn read_holding_registers(
        &self,
        unit: u8,
        first: u16,
        into: &mut [u16],
    ) -> Result<(), ClientError> {
        let request = ReadRegisters::holding(first, count(into.len()));
        self.read_registers(unit, request, into).await
    }

    /// Function 04: input registers from address `first` on, 1..=125, as many as `into` has.
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
        self.ask(unit, &request, Destination::Registers(into)).await
    }

    /// Function 05: a coil on or off.
    pub async fn write_coil(&self, unit: u8, address: u16, on: bool) -> Result<(), ClientError> {
        self.tell(unit, &WriteCoil { address, on }).await
    }

    /// Function 06: a holding register.
    pub async fn write_register(
        &self,
        unit: u8,
        address: u16,
        value: u16,
    ) -> Result<(), ClientError> {
        self.tell(unit, &WriteRegister { address, value }).await
    }

    /// Function 07: eight bits that the server's application defines.
    pub async fn read_exception_status(&self, unit: u8) -> Result<u8, ClientError> {
        let request = ReadExceptionStatus;
        self.look(unit, &request, |frame| Ok(request.answer(frame)?))
            .await
    }

    /// Function 08, all sub-functions but 0000: the counter or register asked for; of the others, the data
    /// that was sent, 0 if it is not answered.
    pub async fn diagnose(&self, unit: u8, request: Diagnostic) -> Result<u16, ClientError> {
        match self.transact(unit, &request).await? {
            Some(reply) => Ok(request.answer(reply.bytes())?),
            // A broadcast, or Force Listen Only Mode.
            None => Ok(0),
        }
    }

    /// Function 08, sub-function 0000: sends 0..=250 bytes and takes nothing but the same back.
    pub async fn return_query_data(&self, unit: u8, data: &[u8]) -> Result<(), ClientError> {
        self.tell(unit, &ReturnQueryData { data }).await
    }

    /// Function 0B: the event counter.
    pub async fn event_counter(&self, unit: u8) -> Result<EventCounter, ClientError> {
        let request = GetEventCounter;
        self.look(unit, &request, |frame| Ok(request.answer(frame)?))
            .await
    }

    /// Function 0C: what `read` makes of the event log.
    pub async fn event_log<R>(
        &self,
        unit: u8,
        read: impl FnOnce(EventLog<'_>) -> R,
    ) -> Result<R, ClientError> {
        let request = GetEventLog;
        self.look(unit, &request, |frame| Ok(read(request.answer(frame)?)))
            .await
    }

    /// Function 0F: coils from address `first` on, 1..=1968.
    pub async fn write_coils(
        &self,
        unit: u8,
        first: u16,
        values: &[bool],
    ) -> Result<(), ClientError> {
        self.tell(unit, &WriteCoils { first, values }).await
    }

    /// Function 0F: `count` coils from address `first` on, 1..=1968, eight to a byte, the first in the lowest
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
        self.tell(unit, &request).await
    }

    /// Function 10: holding registers from address `first` on, 1..=123.
    pub async fn write_registers(
        &self,
        unit: u8,
        first: u16,
        values: &[u16],
    ) -> Result<(), ClientError> {
        self.tell(unit, &WriteRegisters { first, values }).await
    }

    /// Function 11: what `read` makes of the server's id.
    pub async fn report_server_id<R>(
        &self,
        unit: u8,
        read: impl FnOnce(ServerId<'_>) -> R,
    ) -> Result<R, ClientError> {
        let request = ReportServerId;
        self.look(unit, &request, |frame| Ok(read(request.answer(frame)?)))
            .await
    }

    /// Function 14: what `read` makes of the records, group by group.
    pub async fn read_files<R>(
        &self,
        unit: u8,
        groups: &[FileRange],
        read: impl FnOnce(FileRecords<'_>) -> R,
    ) -> Result<R, ClientError> {
        let request = ReadFiles { groups };
        self.look(unit, &request, |frame| Ok(read(request.answer(frame)?)))
            .await
    }

    /// Function 15: records of files, all groups or none.
    pub async fn write_files(&self, unit: u8, groups: &[FileData<'_>]) -> Result<(), ClientError> {
        self.tell(unit, &WriteFiles { groups }).await
    }

    /// Function 16: `new = (current & and) | (or & !and)`.
    pub async fn mask_write_register(
        &self,
        unit: u8,
        address: u16,
        and: u16,
        or: u16,
    ) -> Result<(), ClientError> {
        self.tell(unit, &MaskWrite { address, and, or }).await
    }

    /// Function 17: writes 1..=121 registers from `write_first` on, then reads 1..=125 from `first` on, as
    /// many as `into` has. Not to unit 0, since it reads.
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
        self.ask(unit, &request, Destination::Registers(into)).await
    }

    /// Function 18: what `read` makes of the queue, at most 31 registers.
    pub async fn read_fifo<R>(
        &self,
        unit: u8,
        pointer: u16,
        read: impl FnOnce(Registers<'_>) -> R,
    ) -> Result<R, ClientError> {
        let request = ReadFifo { pointer };
        self.look(unit, &request, |frame| Ok(read(request.answer(frame)?)))
            .await
    }

    /// Function 2B, MEI type 0E: what `read` makes of the objects. `code` 1 basic, 2 regular, 3 extended,
    /// from `object` on; 4 `object` alone.
    pub async fn read_identification<R>(
        &self,
        unit: u8,
        code: u8,
        object: u8,
        read: impl FnOnce(Identification<'_>) -> R,
    ) -> Result<R, ClientError> {
        let request = ReadIdentification { code, object };
        self.look(unit, &request, |frame| Ok(read(request.answer(frame)?)))
            .await
    }

    /// Any function with any data: what `read` makes of the answer's data; `None` after a broadcast.
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

    /// A request that reads.
    async fn ask(
        &self,
        unit: u8,
        request: &dyn Request,
        mut into: Destination<'_>,
    ) -> Result<(), ClientError> {
        self.run(unit, request, Some(&mut into)).await.map(drop)
    }

    /// A request whose answer says nothing new.
    async fn tell(&self, unit: u8, request: &dyn Request) -> Result<(), ClientError> {
        self.transact(unit, request).await.map(drop)
    }

    /// A request that reads, whose answer is looked at when it stands.
    async fn look<R>(
        &self,
        unit: u8,
        request: &dyn Request,
        look: impl FnOnce(&[u8]) -> Result<R, ClientError>,
    ) -> Result<R, ClientError> {
        match self.transact(unit, request).await? {
            Some(reply) => look(reply.bytes()),
            // Requests that read are always answered.
            None => Err(ClientError::Timeout),
        }
    }
}

/// What a request asks for; what is too much for it is refused there.
fn count(len: usize) -> u16 {
    len.min(usize::from(u16::MAX)) as u16
}

/// Refuses memory that is too small for the answer.
fn room(room: usize, needed: usize) -> Result<(), RequestError> {
    if room < needed {
        return Err(RequestError::Room {
            room: count(room),
            needed: count(needed),
        });
    }
    Ok(())
}
