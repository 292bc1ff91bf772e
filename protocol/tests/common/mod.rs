//! A server over plain tables, and the way a port drives it, for the tests of this crate.
#![allow(dead_code)]

use multidrop_protocol::Adu;
use multidrop_protocol::data::{Coils, CoilsOut, Registers, RegistersOut};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::rtu::{Reception, Transmission};
use multidrop_protocol::server::{DataModel, Diagnostics, Plan, Server};

pub const UNIT: u8 = 17;

/// Registers and coils exist at 0..=2999 and 65000..=65535.
pub fn exists(address: u32) -> bool {
    address < 3000 || (65_000..65_536).contains(&address)
}

/// A register that takes values up to 200 only.
pub const LIMITED: u16 = 100;
/// A coil that cannot be written at the moment.
pub const LOCKED: u16 = 50;

#[derive(Clone, PartialEq)]
pub struct Tables {
    pub coils: Vec<bool>,
    pub discrete_inputs: Vec<bool>,
    pub holding: Vec<u16>,
    pub input: Vec<u16>,
    /// The operation itself fails.
    pub broken: bool,
}

impl Tables {
    pub fn new() -> Tables {
        Tables {
            coils: vec![false; 65_536],
            discrete_inputs: (0..65_536).map(|address| address % 3 == 0).collect(),
            holding: (0..=65_535).collect(),
            input: (0..=65_535u16)
                .map(|address| address.wrapping_add(0x1000))
                .collect(),
            broken: false,
        }
    }
}

fn block(first: u16, count: usize) -> Result<std::ops::Range<usize>, Exception> {
    let first = usize::from(first);
    assert!(
        count >= 1 && first + count <= 65_536,
        "the server let a block past the end through"
    );
    if (first..first + count).all(|address| exists(address as u32)) {
        Ok(first..first + count)
    } else {
        Err(Exception::IllegalDataAddress)
    }
}

impl DataModel for Tables {
    fn coils(&mut self, first: u16, mut out: CoilsOut<'_>) -> Result<(), Exception> {
        let block = block(first, out.len().into())?;
        // Bits behind the last coil are the server's to clear.
        out.bytes_mut().fill(0xFF);
        out.fill_from(self.coils[block].iter().copied());
        Ok(())
    }

    fn discrete_inputs(&mut self, first: u16, mut out: CoilsOut<'_>) -> Result<(), Exception> {
        for (index, address) in block(first, out.len().into())?.enumerate() {
            out.set(index as u16, self.discrete_inputs[address]);
        }
        Ok(())
    }

    fn holding_registers(
        &mut self,
        first: u16,
        mut out: RegistersOut<'_>,
    ) -> Result<(), Exception> {
        out.copy_from(&self.holding[block(first, out.len())?]);
        Ok(())
    }

    fn input_registers(&mut self, first: u16, mut out: RegistersOut<'_>) -> Result<(), Exception> {
        for (index, address) in block(first, out.len())?.enumerate() {
            out.set(index, self.input[address]);
        }
        Ok(())
    }

    fn check_coils(&self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        if block(first, values.len().into())?.contains(&LOCKED.into()) {
            return Err(Exception::NegativeAcknowledge);
        }
        Ok(())
    }

    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        for (address, value) in block(first, values.len())?.zip(values.iter()) {
            if address == LIMITED.into() && value > 200 {
                return Err(Exception::IllegalDataValue);
            }
        }
        Ok(())
    }

    fn write_coils(&mut self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        if self.broken {
            return Err(Exception::ServerDeviceFailure);
        }
        for (address, value) in block(first, values.len().into())?.zip(values.iter()) {
            self.coils[address] = value;
        }
        Ok(())
    }

    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        if self.broken {
            return Err(Exception::ServerDeviceFailure);
        }
        values.copy_to(&mut self.holding[block(first, values.len())?]);
        Ok(())
    }
}

pub fn server() -> Server {
    Server::new(UNIT)
}

/// Both phases over unit id and PDU: the answer without CRC, if there is one. Fails when the first phase changes the model.
pub fn ask_server<D: Diagnostics, M: DataModel + Clone + PartialEq>(
    server: &Server<D>,
    tables: &mut M,
    request: &[u8],
) -> Option<Vec<u8>> {
    // What an earlier frame left in the buffer must not show.
    let mut frame: Adu = [0xA5; 256];
    frame[..request.len()].copy_from_slice(request);
    let len = request.len() as u8;
    let before = tables.clone();
    let plan = server.prepare(tables, &mut frame, len);
    assert!(
        *tables == before,
        "prepare changed the model: {request:02X?}"
    );
    if matches!(
        plan,
        Plan::Write { .. } | Plan::Diagnose { .. } | Plan::Call
    ) {
        assert_eq!(
            &frame[..request.len()],
            request,
            "the request has to stand until it is committed"
        );
    }
    let answer = server.commit(tables, &mut frame, len, plan);
    (answer != 0).then(|| frame[..answer.into()].to_vec())
}

pub fn ask(tables: &mut Tables, request: &[u8]) -> Option<Vec<u8>> {
    ask_server(&server(), tables, request)
}

/// What a port does with the bytes of one frame: CRC and all, byte by byte.
pub fn ask_on_line(tables: &mut Tables, adu: &[u8]) -> Option<Vec<u8>> {
    let server = server();
    let mut frame: Adu = [0; 256];
    let mut reception = Reception::new();
    for &byte in adu {
        reception.push(&mut frame, byte);
    }
    let heard = reception.finish();
    if !heard.errors.is_empty() {
        return None;
    }
    let plan = server.prepare(tables, &mut frame, heard.len);
    match server.commit(tables, &mut frame, heard.len, plan) {
        0 => None,
        len => Some(send(&frame, len)),
    }
}

pub fn send(frame: &Adu, len: u8) -> Vec<u8> {
    let mut transmission = Transmission::new();
    transmission.start(len);
    let mut sent = Vec::new();
    while let Some(byte) = transmission.next(frame) {
        sent.push(byte);
    }
    assert!(transmission.is_over());
    sent
}

pub fn refused(request: &[u8], exception: Exception) -> Option<Vec<u8>> {
    Some(vec![request[0], request[1] | 0x80, exception.code()])
}

/// A request for a block: unit id, function, two words.
pub fn words(unit: u8, function: u8, first: u16, second: u16) -> Vec<u8> {
    let mut request = vec![unit, function];
    request.extend(first.to_be_bytes());
    request.extend(second.to_be_bytes());
    request
}

/// A write request: as [`words`], with byte count and data.
pub fn with_data(unit: u8, function: u8, first: u16, count: u16, data: &[u8]) -> Vec<u8> {
    let mut request = words(unit, function, first, count);
    request.push(data.len() as u8);
    request.extend(data);
    request
}
