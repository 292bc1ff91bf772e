//! Read Coils and Read Discrete Inputs (APP 6.1, 6.2).

use super::{DataModel, Plan, read_block};
use crate::Adu;
use crate::data::CoilsOut;
use crate::exception::Exception;
use crate::function::{READ_BITS_MAX, READ_COILS};

pub(super) fn prepare<M: DataModel>(
    model: &mut M,
    frame: &mut Adu,
    len: u8,
) -> Result<Plan, Exception> {
    let (first, count) = read_block(frame, len, READ_BITS_MAX)?;
    let byte_count = ((count + 7) >> 3) as u8;
    frame[2] = byte_count;
    let code = frame[1];
    let [_, _, _, bytes @ ..] = frame;
    let Some(bytes) = bytes.get_mut(..usize::from(byte_count)) else {
        return Err(Exception::IllegalDataValue);
    };
    bytes.fill(0);
    let out = CoilsOut::of(bytes, count);
    if code == READ_COILS {
        model.coils(first, out)?;
    } else {
        model.discrete_inputs(first, out)?;
    }
    clear_padding(bytes, count);
    Ok(Plan::Answer {
        len: byte_count + 3,
    })
}

/// Clears the bits behind the last coil: a model may set whole bytes.
fn clear_padding(bytes: &mut [u8], count: u16) {
    let used = count as u8 & 7;
    if used != 0
        && let Some(last) = bytes.last_mut()
    {
        *last &= (1 << used) - 1;
    }
}
