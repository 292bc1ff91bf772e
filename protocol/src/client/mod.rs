//! The client's half of a transaction: a request made in the buffer it is sent from, an answer held against its request.
//!
//! There is one type per function, each a [`Request`]. [`encode`] checks it against the limits of the standard and puts it
//! into a frame; nothing that is wrong gets that far. [`judge`] tells whether a frame that was heard is the answer: from the
//! unit that was asked, with its function, of exactly the length that the request demands, with its echo. What is in the
//! answer is then read from the frame, without a copy, by the `answer` of the request's type.
//!
//! A request says nothing of who is asked: the same may be sent to many units. [`Asking`] is the course of one: what ends
//! the wait, what is tried again; [`LateAnswers`] are the answers that a line still owes, which must not be taken for others. Both
//! are without a clock: time comes in as an argument.
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
//! // Another unit's answer, and one that is cut off.
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
use crate::function::EXCEPTION_BIT;
use crate::{Adu, BROADCAST, UNIT_MAX};

/// Unit id and function code: the least a frame can be.
const LEN_MIN: usize = 2;
/// Unit id and the longest PDU.
const LEN_MAX: u8 = 254;

/// One request of one function.
///
/// It is used as `&dyn Request`, so that all functions share the code that sends and waits.
pub trait Request {
    /// Writes function code and data.
    ///
    /// # Errors
    ///
    /// [`RequestError`] for what is outside the limits of the function.
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError>;

    /// Whether `frame`, an answer from the right unit with the right function code, is one to this request: its length, its
    /// byte count, its echo. At least two bytes, any content.
    ///
    /// # Errors
    ///
    /// [`AnswerError::Length`] or [`AnswerError::Content`].
    fn check(&self, frame: &[u8]) -> Result<(), AnswerError>;
}

/// A request as it is written, unit id first.
#[derive(Debug)]
pub struct Draft<'a> {
    adu: &'a mut Adu,
    len: u8,
    answered: bool,
}

impl Draft<'_> {
    /// One more byte.
    #[inline]
    pub fn byte(&mut self, byte: u8) {
        self.adu[usize::from(self.len)] = byte;
        // At 255 it is too long, and stays so.
        self.len = self.len.saturating_add(1);
    }

    /// One more word, high byte first (APP 4.2).
    #[inline(never)]
    pub fn word(&mut self, word: u16) {
        let [high, low] = word.to_be_bytes();
        self.byte(high);
        self.byte(low);
    }

    /// Words one behind the other, as they stand in a block of registers.
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

    /// The function code of a request that is good for nothing without an answer.
    ///
    /// # Errors
    ///
    /// [`RequestError::Broadcast`] if it goes to unit 0, which nobody answers (SER 2.2).
    pub fn read(&mut self, function: u8) -> Result<(), RequestError> {
        if self.adu[0] == BROADCAST {
            return Err(RequestError::Broadcast { function });
        }
        self.byte(function);
        Ok(())
    }

    /// The request is not answered even if it goes to one unit.
    pub fn silence(&mut self) {
        self.answered = false;
    }
}

/// A request in its frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoded {
    /// Bytes of unit id and PDU, 2..=254.
    pub len: u8,
    /// Whether an answer is to be waited for: not after a broadcast (SER 2.2) and not after Force Listen Only Mode (APP 6.8).
    pub answered: bool,
}

/// Puts a request to `unit` (1..=247, or 0 for a broadcast) into `adu`, without its CRC.
///
/// # Errors
///
/// [`RequestError`]; what is in `adu` then is not to be sent.
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

/// Holds `frame`, unit id and PDU of a good frame that was heard, against the request that was sent to `unit` with
/// `function`.
///
/// # Errors
///
/// [`AnswerError`]: an exception, which answers the request as well; everything else is no answer to it.
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

/// The data of an answer, behind unit id and function code.
fn data(frame: &[u8]) -> &[u8] {
    frame.get(LEN_MIN..).unwrap_or(&[])
}

/// The error for a frame that is too long or too short.
#[inline(never)]
fn length(frame: &[u8]) -> AnswerError {
    AnswerError::Length(frame.len().min(255) as u8)
}

/// The bytes behind a byte count that has to be right.
#[inline(never)]
fn counted(frame: &[u8]) -> Result<&[u8], AnswerError> {
    match data(frame) {
        [count, rest @ ..] if rest.len() == usize::from(*count) => Ok(rest),
        _ => Err(length(frame)),
    }
}

/// The bytes behind a byte count that has to be right, and this.
#[inline(never)]
fn counted_exactly(frame: &[u8], count: usize) -> Result<&[u8], AnswerError> {
    let bytes = counted(frame)?;
    if bytes.len() == count {
        Ok(bytes)
    } else {
        Err(length(frame))
    }
}

/// Whether the answer is these two words and no more.
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

/// Refuses a block of no items, of more than `max`, or one that runs past address 65535.
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
