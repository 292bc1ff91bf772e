//! The data of the image `conformance`: all functions over a fixed map, the same on every board, for tests that
//! do not know the board.
//!
//! | table | addresses | content |
//! |---|---|---|
//! | holding registers | 0..=127 | at start, the address; 100..=109 take 100..=200, 110 and 111 take 1, 2, 3; 120..=125 refused while coil 120 is on |
//! | input registers | 0..=127 | 0x1000 + address |
//! | coils | 0..=127, 1000..=2999 | off at start, coil 120 on |
//! | discrete inputs | 0..=127, 1000..=2999 | on where the address is a multiple of 3 |
//! | FIFO queue | 0x04DE | 0x01B8, 0x1284 |
//! | file 4 | records 0 to `RECORDS` - 1 | at start, the record number |
//!
//! FC 07 returns coils 0..=7 as a byte, FC 41 returns the request's data bytes in reverse order.

use multidrop::protocol::data::{BytesOut, Coils, CoilsOut, Registers, RegistersOut};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::registers::{Bank, CoilBank, Rules, within};
use multidrop::protocol::rules;
use multidrop::protocol::server::{ApplicationFunction, Conformity, DataModel, FunctionSet};

/// The unit id of the image.
pub const UNIT: u32 = 17;
/// Events that the log keeps: as many as one answer can hold.
pub const EVENTS: usize = 64;

const COUNT: u16 = 128;
const HIGH_FIRST: u16 = 1000;
const HIGH_COUNT: u16 = 2000;
const FIFO_POINTER: u16 = 0x04DE;
const FILE: u16 = 4;
/// The coil that is the flag of the DISABLE bank.
const FLAG: u16 = 120;

rules! {
    struct Limits: "RS4";
    VALID_DATA {
        100..=109 => range(100..=200),
        110..=111 => list(1, 2, 3),
    }
    DISABLE_REG { 120..=125 }
}

/// The conformance map. With `RECORDS` 0 there are no files, and functions 14 and 15 are answered with exception 01.
pub struct Conformance<const RECORDS: usize> {
    product: &'static str,
    registers: Bank<{ COUNT as usize }>,
    coils: CoilBank<16>,
    high_coils: CoilBank<250>,
    records: [u16; RECORDS],
}

impl<const RECORDS: usize> Conformance<RECORDS> {
    /// The map with its values at boot. `product` is the name of the board.
    pub const fn new(product: &'static str) -> Self {
        let mut cells = [0; COUNT as usize];
        let mut address = 0;
        while address < cells.len() {
            cells[address] = address as u16;
            address += 1;
        }
        let mut records = [0; RECORDS];
        let mut record = 0;
        while record < RECORDS {
            records[record] = record as u16;
            record += 1;
        }
        let mut coils = [0; 16];
        coils[(FLAG / 8) as usize] = 1 << (FLAG % 8);
        Self {
            product,
            registers: Bank::from_cells(0, cells),
            coils: CoilBank::from_bytes(0, COUNT, coils),
            high_coils: CoilBank::new(HIGH_FIRST, HIGH_COUNT),
            records,
        }
    }

    fn reverse(&mut self, pdu: &mut [u8], len: usize) -> Result<usize, Exception> {
        if let Some([_, data @ ..]) = pdu.get_mut(..len) {
            data.reverse();
        }
        Ok(len)
    }

    /// The place of these records in the file, or exception 02.
    fn records(file: u16, record: u16, count: usize) -> Result<core::ops::Range<usize>, Exception> {
        let first = usize::from(record);
        if file == FILE && first + count <= RECORDS {
            Ok(first..first + count)
        } else {
            Err(Exception::IllegalDataAddress)
        }
    }
}

impl<const RECORDS: usize> DataModel for Conformance<RECORDS> {
    const WRITES_MAY_FAIL: bool = false;
    const FUNCTIONS: FunctionSet = if RECORDS == 0 {
        FunctionSet::WITHOUT_FILES
    } else {
        FunctionSet::ALL
    };
    const APPLICATION: &'static [ApplicationFunction<Self>] = &[ApplicationFunction {
        code: 0x41,
        broadcast: false,
        run: Self::reverse,
    }];
    const CONFORMITY: Conformity = Conformity::Regular;

    fn coils(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        if first < HIGH_FIRST {
            self.coils.read(first, out)
        } else {
            self.high_coils.read(first, out)
        }
    }

    fn discrete_inputs(&mut self, first: u16, mut out: CoilsOut<'_>) -> Result<(), Exception> {
        if first < HIGH_FIRST {
            within(first, out.len(), COUNT)?;
        } else {
            within(first - HIGH_FIRST, out.len(), HIGH_COUNT)?;
        }
        // Byte by byte: 2000 one by one would take longer than there is before t3.5.
        let mut phase = first % 3;
        for byte in out.bytes_mut() {
            (*byte, phase) = match phase {
                0 => (0b0100_1001, 2),
                1 => (0b0010_0100, 0),
                _ => (0b1001_0010, 1),
            };
        }
        Ok(())
    }

    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.registers.read(first, out)
    }

    fn input_registers(&mut self, first: u16, mut out: RegistersOut<'_>) -> Result<(), Exception> {
        within(first, out.len() as u16, COUNT)?;
        out.fill_from((first..).map(|address| 0x1000 + address));
        Ok(())
    }

    fn check_coils(&self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        if first < HIGH_FIRST {
            self.coils.check(first, values)
        } else {
            self.high_coils.check(first, values)
        }
    }

    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.registers.check(first, values)?;
        let flags = self.coils.get(FLAG).unwrap_or(false);
        Limits::check_write(first, values, flags.into())
    }

    fn write_coils(&mut self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        if first < HIGH_FIRST {
            self.coils.write(first, values)
        } else {
            self.high_coils.write(first, values)
        }
    }

    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.registers.write(first, values)
    }

    fn check_holding_registers(&mut self, first: u16, count: u16) -> Result<(), Exception> {
        within(first, count, COUNT)
    }

    fn exception_status(&mut self) -> u8 {
        self.coils.bytes()[0]
    }

    fn server_id(&mut self, out: &mut BytesOut<'_>) {
        out.push(UNIT as u8);
        // Running.
        out.push(0xFF);
        out.extend(b"multidrop");
    }

    fn fifo_queue(&mut self, pointer: u16, mut out: RegistersOut<'_>) -> Result<u16, Exception> {
        if pointer != FIFO_POINTER {
            return Err(Exception::IllegalDataAddress);
        }
        out.set(0, 0x01B8);
        out.set(1, 0x1284);
        Ok(2)
    }

    fn device_object(&mut self, id: u8, out: &mut BytesOut<'_>) -> bool {
        out.extend(match id {
            0 => b"multidrop",
            1 => self.product.as_bytes(),
            2 => env!("CARGO_PKG_VERSION").as_bytes(),
            6 => b"conformance",
            _ => return false,
        });
        true
    }

    fn file_records(
        &mut self,
        file: u16,
        record: u16,
        mut out: RegistersOut<'_>,
    ) -> Result<(), Exception> {
        let records = Self::records(file, record, out.len())?;
        out.copy_from(self.records.get(records).unwrap_or(&[]));
        Ok(())
    }

    fn check_file_records(
        &self,
        file: u16,
        record: u16,
        values: Registers<'_>,
    ) -> Result<(), Exception> {
        Self::records(file, record, values.len()).map(|_| ())
    }

    fn write_file_records(
        &mut self,
        file: u16,
        record: u16,
        values: Registers<'_>,
    ) -> Result<(), Exception> {
        let records = Self::records(file, record, values.len())?;
        values.copy_to(self.records.get_mut(records).unwrap_or(&mut []));
        Ok(())
    }
}
