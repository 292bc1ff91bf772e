//! One request of a client, answered by this project's server and by rmodbus: the same bytes in, the same bytes out.
//!
//! The work is the same on both sides: the bytes arrive in a buffer, the CRC of the request is checked, and the answer is
//! framed with its own. Both have 16 holding registers or more in plain memory.

use multidrop_protocol::data::{Registers, RegistersOut};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::registers::Bank;
use multidrop_protocol::server::{DataModel, Server};
use multidrop_protocol::{Adu, rtu};
use rmodbus::server::ModbusFrame;
use rmodbus::server::context::ModbusContext;
use rmodbus::server::storage::ModbusStorage;
use rmodbus::{ModbusFrameBuf, ModbusProto};

/// The unit id of both.
const UNIT: u8 = 17;
/// Registers of a request.
const COUNT: u8 = 16;

/// A request that is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// FC 03, 16 registers.
    Read,
    /// FC 10, 16 registers.
    Write,
}

impl Request {
    /// Both kinds of requests.
    pub const ALL: [Request; 2] = [Request::Read, Request::Write];

    /// As in the other figures.
    pub const fn name(self) -> &'static str {
        match self {
            Request::Read => "03x16",
            Request::Write => "10x16",
        }
    }

    /// The frame as it comes in.
    pub fn frame(self) -> Vec<u8> {
        let mut body = match self {
            Request::Read => vec![UNIT, 0x03, 0, 0, 0, COUNT],
            Request::Write => vec![UNIT, 0x10, 0, 0, 0, COUNT, 2 * COUNT],
        };
        if self == Request::Write {
            body.extend((0..COUNT).flat_map(|n| [n, 0xA5]));
        }
        let mut out = [0; rtu::ADU_MAX];
        let frame = rtu::encode(&body, &mut out).expect("it fits a frame");
        frame.to_vec()
    }
}

/// A server that answers frames.
pub trait Answers {
    /// The whole frame that answers a whole frame; empty for none.
    fn answer(&mut self, request: &[u8]) -> &[u8];
}

/// This project's server over a bank.
pub struct Ours {
    server: Server,
    model: Model,
    adu: Adu,
    out: [u8; rtu::ADU_MAX],
}

struct Model(Bank<128>);

impl DataModel for Model {
    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.0.read(first, out)
    }

    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.0.check(first, values)
    }

    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.0.write(first, values)
    }
}

impl Ours {
    /// All registers 0.
    pub fn new() -> Ours {
        Ours {
            server: Server::new(UNIT),
            model: Model(Bank::new(0)),
            adu: [0; 256],
            out: [0; rtu::ADU_MAX],
        }
    }
}

impl Default for Ours {
    fn default() -> Ours {
        Ours::new()
    }
}

impl Answers for Ours {
    fn answer(&mut self, request: &[u8]) -> &[u8] {
        let Some(buffer) = self.adu.get_mut(..request.len()) else {
            return &[];
        };
        buffer.copy_from_slice(request);
        let Ok(body) = rtu::decode(buffer) else {
            return &[];
        };
        // At most 254.
        let len = body.len() as u8;
        let plan = self.server.prepare(&mut self.model, &mut self.adu, len);
        let len = self
            .server
            .commit(&mut self.model, &mut self.adu, len, plan);
        rtu::encode(&self.adu[..len.into()], &mut self.out).unwrap_or(&[])
    }
}

/// rmodbus's server over its own storage.
pub struct Rmodbus {
    storage: ModbusStorage<128, 128, 128, 128>,
    frame: ModbusFrameBuf,
    out: Vec<u8>,
}

impl Rmodbus {
    /// All registers 0.
    pub fn new() -> Rmodbus {
        Rmodbus {
            storage: ModbusStorage::default(),
            frame: [0; 256],
            // Not in the time that is measured.
            out: Vec::with_capacity(rtu::ADU_MAX),
        }
    }

    fn process(&mut self) -> Result<(), rmodbus::ErrorKind> {
        self.out.clear();
        let mut frame = ModbusFrame::new(UNIT, &self.frame, ModbusProto::Rtu, &mut self.out);
        frame.parse()?;
        if frame.processing_required {
            if frame.readonly {
                frame.process_read(&self.storage)?;
            } else {
                frame.process_write(&mut self.storage)?;
            }
        }
        if frame.response_required {
            frame.finalize_response()?;
        }
        Ok(())
    }
}

impl Default for Rmodbus {
    fn default() -> Rmodbus {
        Rmodbus::new()
    }
}

impl Answers for Rmodbus {
    fn answer(&mut self, request: &[u8]) -> &[u8] {
        let Some(buffer) = self.frame.get_mut(..request.len()) else {
            return &[];
        };
        buffer.copy_from_slice(request);
        match self.process() {
            Ok(()) => &self.out,
            Err(_) => &[],
        }
    }
}

/// Whether both answer every request with the same bytes, and have the registers of a write afterwards.
pub fn agree() -> bool {
    let (mut ours, mut theirs) = (Ours::new(), Rmodbus::new());
    let both = [Request::Read, Request::Write, Request::Read];
    let same = both.into_iter().all(|request| {
        let request = request.frame();
        let answer = ours.answer(&request);
        answer.len() > 5 && answer == theirs.answer(&request)
    });
    same && theirs.storage.get_holding(1) == Ok(0x01A5)
}
