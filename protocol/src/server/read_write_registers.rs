//! Read/Write Multiple Registers (APP 6.17): the write is executed before the read.

use super::{DataModel, check_end, read_registers, two_words};
use crate::Adu;
use crate::data::Registers;
use crate::exception::Exception;
use crate::function::{READ_REGISTERS_MAX, READ_WRITE_REGISTERS_MAX};

/// Bytes of unit id, function code, address and quantity to read, address and quantity to write, byte count; the
/// registers follow.
const HEAD: u8 = 11;

/// The address and values of the write.
fn write_part(frame: &Adu) -> (u16, Registers<'_>) {
    let end = usize::from(HEAD) + usize::from(frame[10]);
    (
        u16::from_be_bytes([frame[6], frame[7]]),
        Registers::new(frame.get(usize::from(HEAD)..end).unwrap_or(&[])),
    )
}

pub(super) fn check<M: DataModel>(model: &mut M, frame: &Adu, len: u8) -> Result<(), Exception> {
    let (first_read, read_count) = two_words(frame);
    let write_count = u16::from_be_bytes([frame[8], frame[9]]);
    // A byte count of 0 is refused, and with it a quantity of 0.
    let well_formed = len > HEAD
        && len - HEAD == frame[10]
        && write_count <= READ_WRITE_REGISTERS_MAX
        && frame[10] == write_count as u8 * 2
        && read_count != 0
        && read_count <= READ_REGISTERS_MAX;
    if !well_formed {
        return Err(Exception::IllegalDataValue);
    }
    let (first_written, values) = write_part(frame);
    check_end(first_read, read_count)?;
    check_end(first_written, write_count)?;
    model.check_holding_registers(first_read, read_count)?;
    model.check_registers(first_written, values)
}

/// Checks again before it writes, since the flag or register of a rule may have changed.
pub(super) fn execute<M: DataModel>(
    model: &mut M,
    frame: &mut Adu,
    len: u8,
) -> Result<u8, Exception> {
    check(model, frame, len)?;
    let (first, values) = write_part(frame);
    model.write_registers(first, values)?;
    let (first, count) = two_words(frame);
    read_registers::answer(model, frame, first, count, true)
}
