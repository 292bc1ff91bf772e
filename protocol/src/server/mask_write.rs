//! Mask Write Register (APP 6.16).

use super::{DataModel, two_words};
use crate::Adu;
use crate::data::{Registers, RegistersOut};
use crate::exception::Exception;

/// Bytes of unit id, function code, address, AND mask, OR mask, in request and answer.
const REQUEST_LEN: u8 = 8;

/// Checks the new value of the register, high byte first.
///
/// Rules apply to the new value, not to the masks.
pub(super) fn check<M: DataModel>(
    model: &mut M,
    frame: &Adu,
    len: u8,
) -> Result<[u8; 2], Exception> {
    if len != REQUEST_LEN {
        return Err(Exception::IllegalDataValue);
    }
    let (address, and_mask) = two_words(frame);
    let or_mask = u16::from_be_bytes([frame[6], frame[7]]);
    let mut cell = [0; 2];
    model.holding_registers(address, RegistersOut::new(&mut cell))?;
    let value = u16::from_be_bytes(cell) & and_mask | or_mask & !and_mask;
    let cell = value.to_be_bytes();
    model.check_registers(address, Registers::new(&cell))?;
    Ok(cell)
}

/// Checks again before it writes, since the register may have changed.
pub(super) fn execute<M: DataModel>(model: &mut M, frame: &Adu, len: u8) -> Result<u8, Exception> {
    let cell = check(model, frame, len)?;
    model.write_registers(two_words(frame).0, Registers::new(&cell))?;
    Ok(REQUEST_LEN)
}
