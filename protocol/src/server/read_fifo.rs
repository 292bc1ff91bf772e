//! Read FIFO Queue (APP 6.18).

use super::{DataModel, Plan, REQUEST_HEAD, two_words};
use crate::Adu;
use crate::data::RegistersOut;
use crate::exception::Exception;
use crate::function::FIFO_MAX;

/// Bytes of unit id, function code, byte count, number of registers; the registers follow.
const ANSWER_HEAD: u8 = 6;

pub(super) fn prepare<M: DataModel>(
    model: &mut M,
    frame: &mut Adu,
    len: u8,
) -> Result<Plan, Exception> {
    if len != REQUEST_HEAD {
        return Err(Exception::IllegalDataValue);
    }
    let (pointer, _) = two_words(frame);
    let [_, _, _, _, _, _, registers @ ..] = frame;
    let (registers, _) = registers.split_at_mut(usize::from(FIFO_MAX) * 2);
    registers.fill(0);
    let count = model.fifo_queue(pointer, RegistersOut::new(registers))?;
    if count > FIFO_MAX {
        return Err(Exception::IllegalDataValue);
    }
    let bytes = count as u8 * 2;
    [frame[2], frame[3], frame[4], frame[5]] = [0, bytes + 2, 0, count as u8];
    Ok(Plan::Answer {
        len: ANSWER_HEAD + bytes,
    })
}
