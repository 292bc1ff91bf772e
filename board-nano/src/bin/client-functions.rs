//! A client that asks every function once: for tests of the client against servers of other people, and of ours.
//!
//! RTU at 38400 8N1 if not built otherwise; `MULTIDROP_ASCII=1` builds it for ASCII.
//!
//! It asks unit 17 and expects the conformance map there. It begins when that unit answers. What became of each
//! step is a word, as [`outcome`] makes it: 1 for the answer expected, 2 for another answer, 0x80xx for exception
//! xx, 0x40xx for no answer (xx: 03 wrong function, 04 wrong unit, 05 damaged, 06 nothing, 07 not sent, 08 wrong length, 09 wrong
//! content). The words are written to holding registers 40 and on by function 10 at the end, in the order of
//! the table, and D13 goes on when that was answered.
//!
//! | register | function | expected |
//! |---|---|---|
//! | 40 | 06: register 10 | |
//! | 41 | 03: it is there | |
//! | 42 | 10: registers 11 to 14 | |
//! | 43 | 03: 10 to 14 | |
//! | 44 | 16: register 10 | |
//! | 45 | 17: writes 12, 13, reads 10 to 13 | |
//! | 46, 47 | 05: coil 3; 0F: coils 4 to 13 | |
//! | 48 | 01: coils 3 to 13 | |
//! | 49 | 02: discrete inputs 0 to 15 | on where the address is a multiple of 3 |
//! | 50 | 04: input registers 0 to 124 | 0x1000 + address, in the first and the last |
//! | 51 | 07 | coils 0 to 7 |
//! | 52 | 08/00: five bytes | |
//! | 53 | 08/0A | |
//! | 54 to 61 | 08/0B to 08/12 | any value |
//! | 62, 63 | 08/14, 08/02 | any value |
//! | 64 | 08/03: LF | |
//! | 65, 66 | 08/04, and 08/01, which is not answered then | 0x4006 for 66 |
//! | 67 | 08/01 again, which is | |
//! | 68, 69 | 0B, 0C | any value |
//! | 70 | 11 | begins with 0x11, 0xFF |
//! | 71, 72 | 15: file 4, record 2; 14 reads it back | 0x8001 where there are no files |
//! | 73 | 18: pointer 0x04DE | 0x01B8 0x1284 |
//! | 74, 75 | 2B/0E: code 1 from object 0; code 4, object 1 | first object `multidrop` |
//! | 76 | 41: three bytes | the same in reverse order |
//! | 77, 78 | 06 to unit 0: register 20; 03: it is there | |
//! | 79 | 03 of register 60000 | 0x8002 |
//! | 80 | 03 to unit 0 | 0x4007 |
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use board_nano::{CLOCK_HZ, Rs485Option as Rs485, bind_interrupts, options, settings};
use embassy_avr_hal::gpio::{Output, PB5};
use embassy_time::Timer;
use multidrop::protocol::client::{
    Diagnostic, FileData, FileRange, GetEventCounter, GetEventLog, MaskWrite, Raw, ReadBits,
    ReadExceptionStatus, ReadFifo, ReadFiles, ReadIdentification, ReadRegisters,
    ReadWriteRegisters, ReportServerId, Request, ReturnQueryData, WriteCoil, WriteFiles,
    WritePackedCoils, WriteRegister, WriteRegisters,
};
use multidrop::protocol::format::LineFormat;
use multidrop::{ClientConfig, ClientError, ClientPort, PortConfig};
use static_cell::StaticCell;

const PORT: PortConfig = PortConfig::new("RS4")
    .client()
    .slave_id(17)
    .baud(options::baud(38_400))
    .framing(options::framing())
    .framing(options::framing())
    .format(options::format(LineFormat::F8N1));

bind_interrupts!(struct Irqs { USART0 => Rs485; TIME => CLOCK_HZ; });

/// One task asks.
type Port = ClientPort<Rs485, 1>;

const UNIT: u8 = PORT.unit();
/// The register of the first word.
const REPORT: u16 = 40;

/// The word for what became of a request; `Ok` has whether the answer was the one expected.
fn outcome(result: Result<bool, ClientError>) -> u16 {
    match result {
        Ok(true) => 1,
        Ok(false) => 2,
        Err(ClientError::Exception(exception)) => 0x8000 | u16::from(exception.code()),
        Err(ClientError::UnknownException(code)) => 0x8000 | u16::from(code),
        Err(ClientError::WrongFunction(_)) => 0x4003,
        Err(ClientError::WrongUnit(_)) => 0x4004,
        Err(ClientError::Damaged(_)) => 0x4005,
        Err(ClientError::Timeout) => 0x4006,
        Err(
            ClientError::Request(_)
            | ClientError::QueueFull
            | ClientError::NotMaster
            | ClientError::NoSilence
            | ClientError::CutOff,
        ) => 0x4007,
        Err(ClientError::WrongLength(_)) => 0x4008,
        Err(ClientError::WrongContent) => 0x4009,
    }
}

/// A request, the unit it is for, and whether its answer is the one expected.
type Step = (u8, &'static (dyn Request + Sync), fn(&[u8]) -> bool);

const BOTH: ReadWriteRegisters = ReadWriteRegisters {
    first: 10,
    count: 4,
    write_first: 12,
    values: &[7, 8],
};
const COILS: ReadBits = ReadBits::coils(3, 11);
const INPUTS: ReadBits = ReadBits::discrete_inputs(0, 16);
const REGISTERS: ReadRegisters = ReadRegisters::holding(10, 5);
const INPUT_REGISTERS: ReadRegisters = ReadRegisters::input(0, 125);
const FILES: ReadFiles = ReadFiles {
    groups: &[FileRange {
        file: 4,
        record: 2,
        count: 2,
    }],
};
const FIFO: ReadFifo = ReadFifo { pointer: 0x04DE };
const BASIC: ReadIdentification = ReadIdentification { code: 1, object: 0 };
const ONE: ReadIdentification = ReadIdentification { code: 4, object: 1 };
const REVERSE: Raw = Raw {
    function: 0x41,
    data: &[1, 2, 3],
};

static STEPS: [Step; 41] = [
    (
        UNIT,
        &WriteRegister {
            address: 10,
            value: 0x1234,
        },
        any,
    ),
    (UNIT, &ReadRegisters::holding(10, 1), |frame| {
        frame[3..] == [0x12, 0x34]
    }),
    (
        UNIT,
        &WriteRegisters {
            first: 11,
            values: &[0xA1B2, 0, 0xFFFF, 42],
        },
        any,
    ),
    (UNIT, &REGISTERS, |frame| {
        let registers = REGISTERS.answer(frame);
        registers.is_ok_and(|registers| registers.iter().eq([0x1234, 0xA1B2, 0, 0xFFFF, 42]))
    }),
    (
        UNIT,
        &MaskWrite {
            address: 10,
            and: 0x00F2,
            or: 0x0025,
        },
        any,
    ),
    (UNIT, &BOTH, |frame| {
        let registers = BOTH.answer(frame);
        // (0x1234 & 0x00F2) | (0x0025 & !0x00F2)
        registers.is_ok_and(|registers| registers.iter().eq([0x0035, 0xA1B2, 7, 8]))
    }),
    (
        UNIT,
        &WriteCoil {
            address: 3,
            on: true,
        },
        any,
    ),
    (
        UNIT,
        &WritePackedCoils {
            first: 4,
            count: 10,
            bytes: &[0b1100_1101, 0b01],
        },
        any,
    ),
    (UNIT, &COILS, |frame| {
        let coils = COILS.answer(frame);
        coils.is_ok_and(|coils| coils.bytes() == [0b1001_1011, 0b011])
    }),
    (UNIT, &INPUTS, |frame| {
        let inputs = INPUTS.answer(frame);
        inputs.is_ok_and(|inputs| inputs.bytes() == [0b0100_1001, 0b1001_0010])
    }),
    (UNIT, &INPUT_REGISTERS, |frame| {
        let inputs = INPUT_REGISTERS.answer(frame);
        // Comparing them all would take longer than there is before the next request.
        inputs.is_ok_and(|inputs| inputs.get(0) == Some(0x1000) && inputs.get(124) == Some(0x107C))
    }),
    // Coil 3, and those of coils 4 to 7 that are on.
    (UNIT, &ReadExceptionStatus, |frame| {
        ReadExceptionStatus.answer(frame) == Ok(0b1101_1000)
    }),
    (
        UNIT,
        &ReturnQueryData {
            data: &[1, 2, 3, 4, 5],
        },
        any,
    ),
    (UNIT, &Diagnostic::Clear, any),
    (UNIT, &Diagnostic::BusMessages, any),
    (UNIT, &Diagnostic::BusErrors, any),
    (UNIT, &Diagnostic::Exceptions, any),
    (UNIT, &Diagnostic::ServerMessages, any),
    (UNIT, &Diagnostic::NoResponses, any),
    (UNIT, &Diagnostic::Naks, any),
    (UNIT, &Diagnostic::Busy, any),
    (UNIT, &Diagnostic::Overruns, any),
    (UNIT, &Diagnostic::ClearOverruns, any),
    (UNIT, &Diagnostic::Register, any),
    (UNIT, &Diagnostic::Delimiter(b'\n'), any),
    (UNIT, &Diagnostic::ListenOnly, any),
    (UNIT, &Diagnostic::Restart { clear_log: false }, any),
    (UNIT, &Diagnostic::Restart { clear_log: true }, any),
    (UNIT, &GetEventCounter, any),
    (UNIT, &GetEventLog, any),
    (UNIT, &ReportServerId, |frame| {
        let id = ReportServerId.answer(frame);
        id.is_ok_and(|id| matches!(id.with_id_len(1), Some(([UNIT], true, _))))
    }),
    (
        UNIT,
        &WriteFiles {
            groups: &[FileData {
                file: 4,
                record: 2,
                values: &[0x0BAD, 0xCAFE],
            }],
        },
        any,
    ),
    (UNIT, &FILES, |frame| {
        let records = FILES.answer(frame).ok();
        let first = records.and_then(|mut groups| groups.next());
        first.is_some_and(|records| records.iter().eq([0x0BAD, 0xCAFE]))
    }),
    (UNIT, &FIFO, |frame| {
        let queue = FIFO.answer(frame);
        queue.is_ok_and(|queue| queue.iter().eq([0x01B8, 0x1284]))
    }),
    (UNIT, &BASIC, |frame| first_object(&BASIC, frame, b'm')),
    (UNIT, &ONE, |frame| first_object(&ONE, frame, b'n')),
    (UNIT, &REVERSE, |frame| REVERSE.answer(frame) == [3, 2, 1]),
    (
        0,
        &WriteRegister {
            address: 20,
            value: 0x5AA5,
        },
        any,
    ),
    (UNIT, &ReadRegisters::holding(20, 1), |frame| {
        frame[3..] == [0x5A, 0xA5]
    }),
    (UNIT, &ReadRegisters::holding(60_000, 1), |_| false),
    (0, &ReadRegisters::holding(20, 1), |_| false),
];

/// An answer that was found right already.
fn any(_: &[u8]) -> bool {
    true
}

/// Whether the first object is the one asked for and begins with this letter.
fn first_object(request: &ReadIdentification, frame: &[u8], letter: u8) -> bool {
    let objects = request.answer(frame).map(|device| device.objects);
    let first = objects.ok().and_then(|mut objects| objects.next());
    matches!(first, Some((id, [begin, ..])) if id == request.object && *begin == letter)
}

multidrop::tasks! {
    /// The task that asks comes to an end.
    static ROLL: Roll<Irqs>;

    fn receive(port: &'static Port) = multidrop::client_receive(port);
}

#[embassy_executor::task]
async fn ask(port: &'static Port, mut led: Output<PB5>) {
    let client = port.client(ClientConfig::new().timeout_ms(500));
    while client.write_register(UNIT, 10, 0).await.is_err() {
        Timer::after_millis(200).await;
    }
    let mut words = [0; STEPS.len()];
    for (word, &(unit, request, expected)) in words.iter_mut().zip(&STEPS) {
        *word = match client.transact(unit, request).await {
            Ok(Some(reply)) => outcome(Ok(expected(reply.bytes()))),
            Ok(None) => outcome(Ok(true)),
            Err(error) => outcome(Err(error)),
        };
    }
    let client = client.with(ClientConfig::new().retries(3));
    let written = client.write_registers(UNIT, REPORT, &words).await;
    if written.is_ok() {
        led.high();
    }
}

#[avr_device::entry]
fn main() -> ! {
    let board = board_nano::init(Irqs);
    let line = board.rs4.open(Irqs, const { settings(&PORT) });

    static PORT_CELL: StaticCell<Port> = StaticCell::new();
    let port = PORT_CELL.init(Port::new(line));
    let led = Output::new(board.pins.PB5, false);
    board_nano::run(&ROLL, |spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(ask(port, led).unwrap());
    })
}
