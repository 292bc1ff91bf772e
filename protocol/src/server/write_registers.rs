//! Write Single Register and Write Multiple Registers (APP 6.6, 6.12).

use super::{DataModel, Plan, WRITE_ANSWER_LEN, check_end, two_words};
use crate::Adu;
use crate::data::Registers;
use crate::exception::Exception;
use crate::function::{WRITE_REGISTERS_MAX, WRITE_SINGLE_REGISTER};

/// Bytes of unit id, function code, address, value.
const SINGLE_LEN: u8 = 6;
/// Bytes of unit id, function code, address, quantity, byte count; the registers follow.
const MULTIPLE_HEAD: u8 = 7;

pub(super) fn prepare<M: DataModel>(model: &M, frame: &Adu, len: u8) -> Result<Plan, Exception> {
    let (first, word) = two_words(frame);
    // A byte count of 0 is refused, and with it a quantity of 0.
    let well_formed = if frame[1] == WRITE_SINGLE_REGISTER {
        len == SINGLE_LEN
    } else {
        len > MULTIPLE_HEAD
            && len - MULTIPLE_HEAD == frame[6]
            && word <= WRITE_REGISTERS_MAX
            && frame[6] == word as u8 * 2
    };
    if !well_formed {
        return Err(Exception::IllegalDataValue);
    }
    let values = values(frame);
    check_end(first, values.len() as u16)?;
    model.check_registers(first, values)?;
    Ok(Plan::Write {
        len: WRITE_ANSWER_LEN,
    })
}

pub(super) fn commit<M: DataModel>(model: &mut M, frame: &Adu) -> Result<(), Exception> {
    model.write_registers(two_words(frame).0, values(frame))
}

/// The registers of a well-formed request.
fn values(frame: &Adu) -> Registers<'_> {
    let (from, len) = if frame[1] == WRITE_SINGLE_REGISTER {
        (4, 2)
    } else {
        (7, usize::from(frame[6]))
    };
    Registers::new(frame.get(from..from + len).unwrap_or(&[]))
}
