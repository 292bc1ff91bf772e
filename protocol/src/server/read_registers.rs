//! Read Holding Registers and Read Input Registers (APP 6.3, 6.4).

use super::{DataModel, Plan, read_block};
use crate::Adu;
use crate::data::RegistersOut;
use crate::exception::Exception;
use crate::function::{READ_HOLDING_REGISTERS, READ_REGISTERS_MAX};

pub(super) fn prepare<M: DataModel>(
    model: &mut M,
    frame: &mut Adu,
    len: u8,
) -> Result<Plan, Exception> {
    let (first, count) = read_block(frame, len, READ_REGISTERS_MAX)?;
    let holding = frame[1] == READ_HOLDING_REGISTERS;
    answer(model, frame, first, count, holding).map(|len| Plan::Answer { len })
}

/// Reads a block of up to 125 registers into the answer; returns its length.
pub(super) fn answer<M: DataModel>(
    model: &mut M,
    frame: &mut Adu,
    first: u16,
    count: u16,
    holding: bool,
) -> Result<u8, Exception> {
    let byte_count = count as u8 * 2;
    frame[2] = byte_count;
    let [_, _, _, bytes @ ..] = frame;
    let Some(bytes) = bytes.get_mut(..usize::from(byte_count)) else {
        return Err(Exception::IllegalDataValue);
    };
    bytes.fill(0);
    let out = RegistersOut::new(bytes);
    if holding {
        model.holding_registers(first, out)?;
    } else {
        model.input_registers(first, out)?;
    }
    Ok(byte_count + 3)
}
