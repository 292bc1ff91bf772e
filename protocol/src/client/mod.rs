//! The client's half of a transaction: encoding requests, and checking answers.
//!
//! There is one type per function, which implements [`Request`]. [`encode`] checks a request against the limits of
//! the standard and writes it to a frame. [`judge`] checks whether a received frame is the answer: its unit id, its
//! function code, its length and its echo. The `answer` method of the request's type then reads the data from the
//! frame without a copy.
//!
//! A request has no unit id, so one may be sent to many units. [`Asking`] is the course of one request: what ends its
//! wait and when it is sent again. [`LateAnswers`] are the answers that a line still expects, which must not be taken
//! for others. Both have no clock: time is an argument.
//!
//! # Example
//!
//! ```
//! use multidrop_protocol::client::{self, AnswerError, ReadRegisters};
//!
//! let request = ReadRegisters::holding(107, 3);
//! let mut frame = [0; 256];
//! let encoded = client::encode(&request, 17, &mut frame).unwrap();
//! assert_eq!(frame[..encoded.len.into()], [17, 0x03, 0x00, 0x6B, 0x00, 0x03]);
//!
//! let answer = [17, 0x03, 0x06, 0xAE, 0x41, 0x56, 0x52, 0x43, 0x40];
//! assert_eq!(client::judge(&request, 17, 0x03, &answer), Ok(()));
//! assert_eq!(request.answer(&answer).unwrap().get(1), Some(0x5652));
//!
//! // Another unit's answer, and an answer that is cut off.
//! assert_eq!(client::judge(&request, 18, 0x03, &answer), Err(AnswerError::Unit(17)));
//! assert_eq!(client::judge(&request, 17, 0x03, &answer[..7]), Err(AnswerError::Length(7)));
//! ```

mod asking;
mod bits;
mod diagnostics;
mod error;
mod fifo;
mod files;
mod identification;
mod late_answers;
mod raw;
mod registers;
mod status;

pub use asking::{Asking, Event, Failure, Moment, Next};
pub use bits::{ReadBits, WriteCoil, WriteCoils, WritePackedCoils};
pub use diagnostics::{Diagnostic, ReturnQueryData};
pub use error::{AnswerError, RequestError};
pub use fifo::ReadFifo;
pub use files::{FileData, FileRange, FileRecords, ReadFiles, WriteFiles};
pub use identification::{Identification, Objects, ReadIdentification};
pub use late_answers::LateAnswers;
pub use raw::Raw;
pub use registers::{MaskWrite, ReadRegisters, ReadWriteRegisters, WriteRegister, WriteRegisters};
pub use status::{
    EventCounter, EventLog, GetEventCounter, GetEventLog, ReadExceptionStatus, ReportServerId,
    ServerId,
};

use crate::exception::Exception;
use crate::frame::{LEN_MAX, LEN_MIN};
use crate::function::EXCEPTION_BIT;
use crate::{Adu, BROADCAST, UNIT_MAX};

/// One request of a client.
///
/// It is used as `&dyn Request`, so that all functions share the code that sends and waits.
pub trait Request {
    /// Writes function code and data.
    ///
    /// # Errors
    ///
    /// [`RequestError`] for a field outside the limits of the function.
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError>;

    /// Checks whether `frame`, an answer from the right unit with the right function code, fits this request: its
    /// length, its byte count, its echo. `frame` has at least two bytes.
    ///
    /// # Errors
    ///
    /// [`AnswerError::Length`] or [`AnswerError::Content`].
    fn check(&self, frame: &[u8]) -> Result<(), AnswerError>;
}

/// A request that is being encoded, unit id first.
#[derive(Debug)]
pub struct Draft<'a> {
    adu: &'a mut Adu,
    len: u8,
    answered: bool,
}

impl Draft<'_> {
    /// Appends a byte.
    #[inline]
    pub fn byte(&mut self, byte: u8) {
        self.adu[usize::from(self.len)] = byte;
        // 255 is too long, and stays so.
        self.len = self.len.saturating_add(1);
    }

    /// Appends a word, high byte first (APP 4.2).
    #[inline(never)]
    pub fn word(&mut self, word: u16) {
        let [high, low] = word.to_be_bytes();
        self.byte(high);
        self.byte(low);
    }

    /// Appends words, as in a block of registers.
    #[inline(never)]
    pub fn words(&mut self, words: &[u16]) {
        let from = usize::from(self.len);
        let room = self.adu[from..].as_chunks_mut().0;
        for (place, word) in room.iter_mut().zip(words) {
            *place = word.to_be_bytes();
        }
        let bytes = words.len().saturating_mul(2).min(255) as u8;
        self.len = self.len.saturating_add(bytes);
    }

    /// Appends the function code of a request that needs an answer.
    ///
    /// # Errors
    ///
    /// [`RequestError::Broadcast`] if the request is for unit 0, which has no answer (SER 2.2).
    pub fn read(&mut self, function: u8) -> Result<(), RequestError> {
        if self.adu[0] == BROADCAST {
            return Err(RequestError::Broadcast { function });
        }
        self.byte(function);
        Ok(())
    }

    /// Function code, first address and count of a request that reads a block of 1..=`max` items.
    ///
    /// # Errors
    ///
    /// [`RequestError`] if the block has no items, or too many, or runs past address 65535, and as [`read`](Draft::read).
    fn read_block(
        &mut self,
        function: u8,
        first: u16,
        count: u16,
        max: u16,
    ) -> Result<(), RequestError> {
        self.read(function)?;
        block(first, count.into(), max)?;
        self.word(first);
        self.word(count);
        Ok(())
    }

    /// Marks the request as one without an answer, even from a single unit.
    pub fn silence(&mut self) {
        self.answered = false;
    }
}

/// An encoded request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoded {
    /// Bytes of unit id and PDU, 2..=254.
    pub len: u8,
    /// Whether the request has an answer: not after a broadcast (SER 2.2), and not after Force Listen Only Mode (APP
    /// 6.8).
    pub answered: bool,
}

/// Encodes a request to `unit` (1..=247, or 0 for a broadcast) in `adu`, without its CRC.
///
/// # Errors
///
/// [`RequestError`]; the content of `adu` must then not be sent.
#[inline(never)]
pub fn encode(request: &dyn Request, unit: u8, adu: &mut Adu) -> Result<Encoded, RequestError> {
    if unit > UNIT_MAX {
        return Err(RequestError::Unit { unit });
    }
    adu[0] = unit;
    let mut draft = Draft {
        adu,
        len: 1,
        answered: unit != BROADCAST,
    };
    request.encode(&mut draft)?;
    if draft.len > LEN_MAX {
        return Err(RequestError::Data { len: 254, max: 253 });
    }
    Ok(Encoded {
        len: draft.len,
        answered: draft.answered,
    })
}

/// Checks `frame`, unit id and PDU of a good frame, against the request that was sent to `unit` with `function`.
///
/// # Errors
///
/// [`AnswerError`]: an exception, which is an answer as well, or a frame that does not answer the request.
#[inline(never)]
pub fn judge(
    request: &dyn Request,
    unit: u8,
    function: u8,
    frame: &[u8],
) -> Result<(), AnswerError> {
    let [heard_unit, heard_function, data @ ..] = frame else {
        return Err(AnswerError::Length(frame.len() as u8));
    };
    if *heard_unit != unit {
        return Err(AnswerError::Unit(*heard_unit));
    }
    if *heard_function == function | EXCEPTION_BIT {
        return Err(match data {
            [code] => match Exception::from_code(*code) {
                Some(exception) => AnswerError::Exception(exception),
                None => AnswerError::UnknownException(*code),
            },
            _ => AnswerError::Length(frame.len() as u8),
        });
    }
    if *heard_function != function {
        return Err(AnswerError::Function(*heard_function));
    }
    request.check(frame)
}

/// The data of an answer, after unit id and function code.
fn data(frame: &[u8]) -> &[u8] {
    frame.get(LEN_MIN.into()..).unwrap_or(&[])
}

/// The error for a frame of a wrong length.
#[inline(never)]
fn length(frame: &[u8]) -> AnswerError {
    AnswerError::Length(frame.len().min(255) as u8)
}

/// The bytes after a byte count, which must be right.
#[inline(never)]
fn counted(frame: &[u8]) -> Result<&[u8], AnswerError> {
    match data(frame) {
        [count, rest @ ..] if rest.len() == usize::from(*count) => Ok(rest),
        _ => Err(length(frame)),
    }
}

/// The bytes after a byte count, which must be right and equal to `count`.
#[inline(never)]
fn counted_exactly(frame: &[u8], count: usize) -> Result<&[u8], AnswerError> {
    let bytes = counted(frame)?;
    if bytes.len() == count {
        Ok(bytes)
    } else {
        Err(length(frame))
    }
}

/// Checks that the answer consists of these two words.
#[inline(never)]
fn echo(frame: &[u8], first: u16, second: u16) -> Result<(), AnswerError> {
    let Ok(heard) = <[u8; 4]>::try_from(data(frame)) else {
        return Err(length(frame));
    };
    let [a, b] = first.to_be_bytes();
    let [c, d] = second.to_be_bytes();
    if heard == [a, b, c, d] {
        Ok(())
    } else {
        Err(AnswerError::Content)
    }
}

/// Refuses a block of 0 items, of more than `max`, or one that runs past address 65535.
#[inline(never)]
fn block(first: u16, count: usize, max: u16) -> Result<(), RequestError> {
    if count == 0 || count > usize::from(max) {
        let count = count.min(usize::from(u16::MAX)) as u16;
        return Err(RequestError::Count { count, max });
    }
    let count = count as u16;
    match first.checked_add(count - 1) {
        Some(_) => Ok(()),
        None => Err(RequestError::End { first, count }),
    }
}
