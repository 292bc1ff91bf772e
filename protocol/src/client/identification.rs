//! Read Device Identification: function 2B, MEI type 0E.

use super::{AnswerError, Draft, Request, RequestError, data, length};
use crate::function::{self, READ_DEVICE_ID as MEI};

/// The code that reads one object.
const SPECIFIC: u8 = 4;

/// Read Device Identification (APP 6.21).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadIdentification {
    /// 1 reads basic, 2 regular, 3 extended objects, from `object` on; 4 reads `object` alone.
    pub code: u8,
    /// The first object, 0 in the first request, then [`Identification::next`].
    pub object: u8,
}

/// The answer to [`ReadIdentification`].
#[derive(Clone, Copy, Debug)]
pub struct Identification<'a> {
    /// The conformity level of the device: 01, 02, 03 for basic, regular, extended objects as a stream; 81, 82, 83 if
    /// objects can also be read one by one.
    pub conformity: u8,
    /// The first object of the next request, if there are more than fit in one answer.
    pub next: Option<u8>,
    /// The objects in this answer.
    pub objects: Objects<'a>,
}

/// The objects of an [`Identification`], as id and value.
#[derive(Clone, Copy, Debug)]
pub struct Objects<'a> {
    bytes: &'a [u8],
}

impl<'a> Iterator for Objects<'a> {
    type Item = (u8, &'a [u8]);

    fn next(&mut self) -> Option<(u8, &'a [u8])> {
        let [id, len, rest @ ..] = self.bytes else {
            return None;
        };
        let (value, rest) = rest.split_at_checked(usize::from(*len))?;
        self.bytes = rest;
        Some((*id, value))
    }
}

impl ReadIdentification {
    /// The content of the answer.
    ///
    /// # Errors
    ///
    /// [`AnswerError`] if the frame does not consist of the objects that it announces, or they do not fit the
    /// request.
    pub fn answer<'a>(&self, frame: &'a [u8]) -> Result<Identification<'a>, AnswerError> {
        let [mei, code, conformity, more, next, count, bytes @ ..] = data(frame) else {
            return Err(length(frame));
        };
        if *mei != MEI || *code != self.code || !matches!(conformity, 0x01..=0x03 | 0x81..=0x83) {
            return Err(AnswerError::Content);
        }
        let next = match more {
            0x00 => None,
            0xFF => Some(*next),
            _ => return Err(AnswerError::Content),
        };
        let objects = Objects { bytes };
        let mut rest = objects;
        let mut found = 0;
        for (id, _) in &mut rest {
            if self.code == SPECIFIC && id != self.object {
                return Err(AnswerError::Content);
            }
            found += 1;
        }
        if found != usize::from(*count) || !rest.bytes.is_empty() {
            return Err(length(frame));
        }
        if self.code == SPECIFIC && found != 1 {
            return Err(AnswerError::Content);
        }
        Ok(Identification {
            conformity: *conformity,
            next,
            objects,
        })
    }
}

impl Request for ReadIdentification {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        draft.read(function::ENCAPSULATED_INTERFACE)?;
        if !(1..=SPECIFIC).contains(&self.code) {
            return Err(RequestError::Code { code: self.code });
        }
        draft.byte(MEI);
        draft.byte(self.code);
        draft.byte(self.object);
        Ok(())
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        self.answer(frame).map(|_| ())
    }
}
