//! What a server tells of itself: functions 07, 0B, 0C, 11.

use super::{AnswerError, Draft, Request, RequestError, counted, data, length};
use crate::function;

/// Read Exception Status (APP 6.7).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadExceptionStatus;

impl ReadExceptionStatus {
    /// Eight bits that the server's application defines.
    ///
    /// # Errors
    ///
    /// [`AnswerError`] if `frame` has not the length for it.
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
    /// Whether the server is still busy with a command from before.
    pub busy: bool,
    /// Messages completed without exception.
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
    /// Whether the server is still busy with a command from before.
    pub busy: bool,
    /// Messages completed without exception.
    pub events: u16,
    /// Messages the server has seen on the bus.
    pub messages: u16,
    /// One byte for each event, the newest first, at most 64.
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

/// The answer to [`ReportServerId`]: what is in it, and where, depends on the device. The standard has the id first, of a
/// length of the device's own, then 0xFF for a server that runs and 0x00 for one that does not, then anything.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServerId<'a> {
    bytes: &'a [u8],
}

impl<'a> ServerId<'a> {
    /// All of it.
    pub const fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Id, whether it runs, and what follows, of a device whose id has this many bytes; `None` if the answer is too short
    /// or the byte behind the id is neither 0x00 nor 0xFF.
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
    /// What the server says.
    ///
    /// # Errors
    ///
    /// [`AnswerError`] if the length is not what the byte count says, or it says nothing.
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
