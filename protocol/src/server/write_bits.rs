//! Write Single Coil and Write Multiple Coils (APP 6.5, 6.11).

use super::{DataModel, Plan, WRITE_ANSWER_LEN, check_end, two_words};
use crate::Adu;
use crate::data::Coils;
use crate::exception::Exception;
use crate::function::{COIL_OFF, COIL_ON, WRITE_COILS_MAX, WRITE_SINGLE_COIL};

/// Bytes of unit id, function code, address, value.
const SINGLE_LEN: u8 = 6;
/// Bytes of unit id, function code, address, quantity, byte count; the coils follow.
const MULTIPLE_HEAD: u8 = 7;

pub(super) fn prepare<M: DataModel>(model: &M, frame: &Adu, len: u8) -> Result<Plan, Exception> {
    let (first, word) = two_words(frame);
    // A byte count of 0 is refused, and with it a quantity of 0.
    let well_formed = if frame[1] == WRITE_SINGLE_COIL {
        len == SINGLE_LEN && (word == COIL_ON || word == COIL_OFF)
    } else {
        len > MULTIPLE_HEAD
            && len - MULTIPLE_HEAD == frame[6]
            && word <= WRITE_COILS_MAX
            && frame[6] == ((word + 7) >> 3) as u8
    };
    if !well_formed {
        return Err(Exception::IllegalDataValue);
    }
    let values = values(frame);
    check_end(first, values.len())?;
    model.check_coils(first, values)?;
    Ok(Plan::Write {
        len: WRITE_ANSWER_LEN,
    })
}

pub(super) fn commit<M: DataModel>(model: &mut M, frame: &Adu) -> Result<(), Exception> {
    model.write_coils(two_words(frame).0, values(frame))
}

/// The coils of a well-formed request.
fn values(frame: &Adu) -> Coils<'_> {
    if frame[1] == WRITE_SINGLE_COIL {
        // The high byte of 0xFF00 or 0x0000 is the coil, in its lowest bit as in every byte of coils.
        Coils::of(&frame[4..5], 1)
    } else {
        let end = usize::from(MULTIPLE_HEAD) + usize::from(frame[6]);
        Coils::of(
            frame.get(usize::from(MULTIPLE_HEAD)..end).unwrap_or(&[]),
            two_words(frame).1,
        )
    }
}
