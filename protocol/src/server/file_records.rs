//! Read File Record and Write File Record (APP 6.14, 6.15): groups of records of several files in one request.

use super::{DataModel, Plan};
use crate::Adu;
use crate::data::{Registers, RegistersOut};
use crate::exception::Exception;
use crate::function::{RECORD_MAX, REFERENCE_TYPE};

/// Bytes of unit id, function code, byte count; the groups follow.
const HEAD: u8 = 3;
/// Bytes of reference type, file, record, length.
const GROUP: usize = 7;
/// Byte counts of a read request: one group to 35 groups.
const READ_BYTES: core::ops::RangeInclusive<u8> = 0x07..=0xF5;
/// Byte counts of a write request: from one group of one register on.
const WRITE_BYTES: core::ops::RangeInclusive<u8> = 0x09..=0xFB;
/// The largest number of bytes of groups in the answer to a read.
const ANSWER_MAX: u16 = 0xF5;

/// One group with values that the standard allows; the model decides whether the file exists.
struct Group {
    file: u16,
    record: u16,
    /// The number of registers, at least 1.
    count: u16,
}

impl Group {
    fn of(bytes: &[u8; GROUP]) -> Group {
        let [_, f1, f0, r1, r0, c1, c0] = *bytes;
        Group {
            file: u16::from_be_bytes([f1, f0]),
            record: u16::from_be_bytes([r1, r0]),
            count: u16::from_be_bytes([c1, c0]),
        }
    }

    fn check(&self, bytes: &[u8; GROUP]) -> Result<(), Exception> {
        let last = self.record.checked_add(self.count - 1);
        let exists = bytes[0] == REFERENCE_TYPE
            && self.file != 0
            && last.is_some_and(|last| last <= RECORD_MAX);
        if exists {
            Ok(())
        } else {
            Err(Exception::IllegalDataAddress)
        }
    }
}

/// The bytes after the byte count, if their number is equal to it.
fn data(frame: &Adu, len: u8, bytes: core::ops::RangeInclusive<u8>) -> Result<&[u8], Exception> {
    let byte_count = frame[2];
    if len <= HEAD || len - HEAD != byte_count || !bytes.contains(&byte_count) {
        return Err(Exception::IllegalDataValue);
    }
    frame
        .get(usize::from(HEAD)..usize::from(len))
        .ok_or(Exception::IllegalDataValue)
}

/// Needs about 250 bytes of stack, since answers are longer than the groups of the request.
pub(super) fn prepare_read<M: DataModel>(
    model: &mut M,
    frame: &mut Adu,
    len: u8,
) -> Result<Plan, Exception> {
    let mut copy = [[0; GROUP]; *READ_BYTES.end() as usize / GROUP];
    let (groups, rest) = data(frame, len, READ_BYTES)?.as_chunks::<GROUP>();
    if !rest.is_empty() {
        return Err(Exception::IllegalDataValue);
    }
    let copies = copy.get_mut(..groups.len());
    let copies = copies.ok_or(Exception::IllegalDataValue)?;
    copies.copy_from_slice(groups);
    let mut answer_bytes: u16 = 0;
    for bytes in &*copies {
        let count = Group::of(bytes).count;
        // A count that is too large is refused before the sum can overflow.
        if count == 0 || count > ANSWER_MAX / 2 {
            return Err(Exception::IllegalDataValue);
        }
        answer_bytes += 2 + 2 * count;
        if answer_bytes > ANSWER_MAX {
            return Err(Exception::IllegalDataValue);
        }
    }
    for bytes in &*copies {
        Group::of(bytes).check(bytes)?;
    }
    let mut at = usize::from(HEAD);
    for bytes in &*copies {
        let group = Group::of(bytes);
        let end = at + 2 + 2 * usize::from(group.count);
        let Some([len, reference, values @ ..]) = frame.get_mut(at..end) else {
            return Err(Exception::IllegalDataValue);
        };
        *len = 1 + 2 * group.count as u8;
        *reference = REFERENCE_TYPE;
        values.fill(0);
        model.file_records(group.file, group.record, RegistersOut::new(values))?;
        at = end;
    }
    frame[2] = answer_bytes as u8;
    Ok(Plan::Answer {
        len: answer_bytes as u8 + HEAD,
    })
}

/// Calls `f` with each group in order, and with the bytes behind its head.
///
/// # Errors
///
/// [`Exception::IllegalDataValue`] if the groups do not add up to `data`, or the exception of `f`.
fn each_written(
    data: &[u8],
    mut f: impl FnMut(Group, &[u8; GROUP], Registers<'_>) -> Result<(), Exception>,
) -> Result<(), Exception> {
    let mut rest = data;
    while !rest.is_empty() {
        let (head, behind) = rest
            .split_first_chunk::<GROUP>()
            .ok_or(Exception::IllegalDataValue)?;
        let group = Group::of(head);
        let bytes = usize::from(group.count.min(u16::from(u8::MAX))) * 2;
        let (values, next) = behind
            .split_at_checked(bytes)
            .ok_or(Exception::IllegalDataValue)?;
        if group.count == 0 {
            return Err(Exception::IllegalDataValue);
        }
        f(group, head, Registers::new(values))?;
        rest = next;
    }
    Ok(())
}

pub(super) fn prepare_write<M: DataModel>(
    model: &M,
    frame: &Adu,
    len: u8,
) -> Result<Plan, Exception> {
    let data = data(frame, len, WRITE_BYTES)?;
    each_written(data, |_, _, _| Ok(()))?;
    each_written(data, |group, head, _| group.check(head))?;
    each_written(data, |group, _, values| {
        model.check_file_records(group.file, group.record, values)
    })?;
    Ok(Plan::Write { len })
}

/// Executes a prepared write: the groups in order, so that a later one wins if two hold the same record.
pub(super) fn write<M: DataModel>(model: &mut M, frame: &Adu) -> Result<(), Exception> {
    let data = data(frame, frame[2].saturating_add(HEAD), WRITE_BYTES)?;
    each_written(data, |group, _, values| {
        model.write_file_records(group.file, group.record, values)
    })
}
