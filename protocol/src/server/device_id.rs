//! Read Device Identification (APP 6.21), the only MEI type on a serial line.

use super::{DataModel, Plan};
use crate::Adu;
use crate::data::BytesOut;
use crate::exception::Exception;
use crate::function::{PDU_MAX, READ_DEVICE_ID};

/// The objects that a device has (APP 6.21). Each can also be read individually.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Conformity {
    /// Objects 0 to 2.
    Basic = 0x81,
    /// Objects 0 to 6.
    Regular = 0x82,
    /// Objects 0 to 6, and 0x80 to 0xFF.
    Extended = 0x83,
}

/// Bytes of unit id, function code, MEI type, code, object id.
const REQUEST_LEN: u8 = 5;
/// Bytes of unit id, function code, MEI type, code, conformity, more follows, next object id, number of objects.
const ANSWER_HEAD: usize = 8;
/// The code that reads one object.
const INDIVIDUAL: u8 = 4;
/// The value of *more follows* if there are more objects.
const MORE_FOLLOWS: u8 = 0xFF;

pub(super) fn prepare<M: DataModel>(
    model: &mut M,
    frame: &mut Adu,
    len: u8,
) -> Result<Plan, Exception> {
    if len > 2 && frame[2] != READ_DEVICE_ID {
        return Err(Exception::IllegalFunction);
    }
    let code = frame[3];
    if len != REQUEST_LEN || !(1..=INDIVIDUAL).contains(&code) {
        return Err(Exception::IllegalDataValue);
    }
    let asked = frame[4];
    let (head, objects) = frame.split_at_mut(ANSWER_HEAD);
    let (objects, _) = objects.split_at_mut(1 + PDU_MAX - ANSWER_HEAD);
    let (end, more, next, count);
    if code == INDIVIDUAL {
        match object(model, asked, objects) {
            Object::Is { len } => (end, more, next, count) = (len, 0, 0, 1),
            Object::IsNot => return Err(Exception::IllegalDataAddress),
            Object::HasNoRoom => return Err(Exception::ServerDeviceFailure),
        }
    } else {
        let last_level = code.min(M::CONFORMITY as u8 & 0x03);
        let first = if has(model, asked, last_level, objects) {
            asked
        } else {
            0
        };
        let mut at = 0;
        let mut told = 0;
        let mut rest = None;
        let mut id = first;
        loop {
            if in_level(id, last_level)
                && let Some(room) = objects.get_mut(usize::from(at)..)
            {
                match object(model, id, room) {
                    Object::Is { len } => {
                        at += len;
                        told += 1;
                    }
                    Object::IsNot => {}
                    // An object that fits no answer would never be skipped.
                    Object::HasNoRoom if told == 0 => return Err(Exception::ServerDeviceFailure),
                    Object::HasNoRoom => {
                        rest = Some(id);
                        break;
                    }
                }
            }
            id = match id {
                u8::MAX => break,
                _ => id + 1,
            };
        }
        (end, count) = (at, told);
        (more, next) = match rest {
            Some(id) => (MORE_FOLLOWS, id),
            None => (0, 0),
        };
    }
    if let [_, _, _, _, answer @ ..] = head {
        answer.copy_from_slice(&[M::CONFORMITY as u8, more, next, count]);
    }
    Ok(Plan::Answer {
        len: ANSWER_HEAD as u8 + end,
    })
}

/// Whether a stream of this level (1 basic, 2 regular, 3 extended) includes this object.
fn in_level(id: u8, level: u8) -> bool {
    match id {
        0..=2 => true,
        3..=6 => level >= 2,
        0x80.. => level >= 3,
        _ => false,
    }
}

fn has<M: DataModel>(model: &mut M, id: u8, level: u8, scratch: &mut [u8]) -> bool {
    in_level(id, level) && !matches!(object(model, id, scratch), Object::IsNot)
}

enum Object {
    Is { len: u8 },
    IsNot,
    HasNoRoom,
}

/// Writes id, length and value to the start of `room`.
fn object<M: DataModel>(model: &mut M, id: u8, room: &mut [u8]) -> Object {
    // Whether the object exists must not depend on the room for its head.
    let (head, value) = match room.split_at_mut_checked(2) {
        Some(parts) => parts,
        None => (&mut [][..], &mut [][..]),
    };
    let mut out = BytesOut::new(value);
    if !model.device_object(id, &mut out) {
        return Object::IsNot;
    }
    if out.overflows() {
        return Object::HasNoRoom;
    }
    let len = out.len();
    match head {
        [place_of_id, place_of_len] => {
            *place_of_id = id;
            *place_of_len = len;
            Object::Is { len: len + 2 }
        }
        _ => Object::HasNoRoom,
    }
}
