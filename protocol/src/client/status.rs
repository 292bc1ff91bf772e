//! The status of a server: functions 07, 0B, 0C, 11.

use super::{AnswerError, Draft, Request, RequestError, counted, data, length};
use crate::function;

/// Read Exception Status (APP 6.7).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadExceptionStatus;

impl ReadExceptionStatus {
    /// The exception status: eight bits that the server's application defines.
    ///
    /// # Errors
    ///
    /// [`AnswerError`] if the length of `frame` does not fit the request.
    pub fn answer(&self, frame: &[u8]) -> Result<u8, AnswerError> {
        match data(frame) {
            [status] => Ok(*status),
            _ => Err(length(frame)),
        }
    }
}

impl Request for ReadExceptionStatus {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        draft.read(function::READ_EXCEPTION_STATUS)
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        self.answer(frame).map(|_| ())
    }
}

/// Get Comm Event Counter (APP 6.9).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GetEventCounter;

/// The answer to [`GetEventCounter`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EventCounter {
    /// Whether the server is still busy with an earlier command.
    pub busy: bool,
    /// The number of messages that were completed without an exception.
    pub events: u16,
}

impl GetEventCounter {
    /// The status and the counter.
    ///
    /// # Errors
    ///
    /// [`AnswerError`] if the length is wrong, or the status neither 0000 nor FFFF.
    pub fn answer(&self, frame: &[u8]) -> Result<EventCounter, AnswerError> {
        let [a, b, c, d] = data(frame) else {
            return Err(length(frame));
        };
        Ok(EventCounter {
            busy: busy([*a, *b])?,
            events: u16::from_be_bytes([*c, *d]),
        })
    }
}

impl Request for GetEventCounter {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        draft.read(function::GET_COMM_EVENT_COUNTER)
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        self.answer(frame).map(|_| ())
    }
}

/// Get Comm Event Log (APP 6.10).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GetEventLog;

/// The answer to [`GetEventLog`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EventLog<'a> {
    /// Whether the server is still busy with an earlier command.
    pub busy: bool,
    /// The number of messages that were completed without an exception.
    pub events: u16,
    /// The number of messages that the server has seen on the bus.
    pub messages: u16,
    /// The events, one byte each, the newest first, at most 64.
    pub log: &'a [u8],
}

impl GetEventLog {
    /// The status, the counters and the log.
    ///
    /// # Errors
    ///
    /// [`AnswerError`] if the length is wrong, or the status neither 0000 nor FFFF.
    pub fn answer<'a>(&self, frame: &'a [u8]) -> Result<EventLog<'a>, AnswerError> {
        let [a, b, c, d, e, f, log @ ..] = counted(frame)? else {
            return Err(length(frame));
        };
        if log.len() > function::EVENTS_MAX {
            return Err(length(frame));
        }
        Ok(EventLog {
            busy: busy([*a, *b])?,
            events: u16::from_be_bytes([*c, *d]),
            messages: u16::from_be_bytes([*e, *f]),
            log,
        })
    }
}

impl Request for GetEventLog {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        draft.read(function::GET_COMM_EVENT_LOG)
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        self.answer(frame).map(|_| ())
    }
}

/// Report Server ID (APP 6.13).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReportServerId;

/// The answer to [`ReportServerId`]. Its content depends on the device. In the standard the id comes first, of a
/// length that the device defines; then 0xFF for a server that runs or 0x00 for one that does not; then any other
/// data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServerId<'a> {
    bytes: &'a [u8],
}

impl<'a> ServerId<'a> {
    /// All bytes behind the byte count.
    pub const fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// The id, whether the server runs, and the other data, of a device whose id has `len` bytes; `None` if the
    /// answer is too short or the byte after the id is neither 0x00 nor 0xFF.
    pub fn with_id_len(&self, len: usize) -> Option<(&'a [u8], bool, &'a [u8])> {
        let id = self.bytes.get(..len)?;
        let (indicator, rest) = self.bytes.get(len..)?.split_first()?;
        match indicator {
            0x00 => Some((id, false, rest)),
            0xFF => Some((id, true, rest)),
            _ => None,
        }
    }
}

impl ReportServerId {
    /// The content of the answer.
    ///
    /// # Errors
    ///
    /// [`AnswerError`] if the length does not fit the byte count, or the answer is empty.
    pub fn answer<'a>(&self, frame: &'a [u8]) -> Result<ServerId<'a>, AnswerError> {
        match counted(frame)? {
            [] => Err(length(frame)),
            bytes => Ok(ServerId { bytes }),
        }
    }
}

impl Request for ReportServerId {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        draft.read(function::REPORT_SERVER_ID)
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        self.answer(frame).map(|_| ())
    }
}

fn busy(status: [u8; 2]) -> Result<bool, AnswerError> {
    match status {
        [0, 0] => Ok(false),
        [0xFF, 0xFF] => Ok(true),
        _ => Err(AnswerError::Content),
    }
}
