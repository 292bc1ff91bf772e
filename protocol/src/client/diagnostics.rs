//! Diagnostics: function 08 with its sub-functions.

use super::{AnswerError, Draft, Request, RequestError, data, echo, length};
use crate::function;

/// Diagnostics (APP 6.8) with one word of data: every sub-function except Return Query Data, which is
/// [`ReturnQueryData`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Diagnostic {
    /// Restart Communications Option: clears the counters and ends listen-only mode. A server in listen-only mode
    /// does not answer it.
    Restart {
        /// Whether the event log is cleared too.
        clear_log: bool,
    },
    /// Return Diagnostic Register.
    Register,
    /// Change ASCII Input Delimiter: this character in place of LF.
    Delimiter(u8),
    /// Force Listen Only Mode, which has no answer: the request ends when it has been sent.
    ListenOnly,
    /// Clear Counters and Diagnostic Register.
    Clear,
    /// Return Bus Message Count.
    BusMessages,
    /// Return Bus Communication Error Count.
    BusErrors,
    /// Return Bus Exception Error Count.
    Exceptions,
    /// Return Server Message Count.
    ServerMessages,
    /// Return Server No Response Count.
    NoResponses,
    /// Return Server NAK Count.
    Naks,
    /// Return Server Busy Count.
    Busy,
    /// Return Bus Character Overrun Count.
    Overruns,
    /// Clear Overrun Counter and Flag.
    ClearOverruns,
}

impl Diagnostic {
    /// The sub-function and data of the request.
    const fn words(self) -> (u16, u16) {
        match self {
            Diagnostic::Restart { clear_log: false } => (0x0001, 0x0000),
            Diagnostic::Restart { clear_log: true } => (0x0001, 0xFF00),
            Diagnostic::Register => (0x0002, 0),
            Diagnostic::Delimiter(character) => (0x0003, (character as u16) << 8),
            Diagnostic::ListenOnly => (0x0004, 0),
            Diagnostic::Clear => (0x000A, 0),
            Diagnostic::BusMessages => (0x000B, 0),
            Diagnostic::BusErrors => (0x000C, 0),
            Diagnostic::Exceptions => (0x000D, 0),
            Diagnostic::ServerMessages => (0x000E, 0),
            Diagnostic::NoResponses => (0x000F, 0),
            Diagnostic::Naks => (0x0010, 0),
            Diagnostic::Busy => (0x0011, 0),
            Diagnostic::Overruns => (0x0012, 0),
            Diagnostic::ClearOverruns => (0x0014, 0),
        }
    }

    /// Whether the answer holds a value rather than the data of the request.
    const fn reads(self) -> bool {
        matches!(self.words().0, 0x0002 | 0x000B..=0x0012)
    }

    /// The register or counter that was requested; for other sub-functions the data of the request.
    ///
    /// # Errors
    ///
    /// [`AnswerError`] for a wrong length, sub-function or echo.
    pub fn answer(&self, frame: &[u8]) -> Result<u16, AnswerError> {
        let (sub, word) = self.words();
        let value = match data(frame) {
            [_, _, high, low] if self.reads() => u16::from_be_bytes([*high, *low]),
            _ => word,
        };
        echo(frame, sub, value)?;
        Ok(value)
    }
}

impl Request for Diagnostic {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        if self.reads() {
            draft.read(function::DIAGNOSTICS)?;
        } else {
            draft.byte(function::DIAGNOSTICS);
        }
        if matches!(self, Diagnostic::ListenOnly) {
            draft.silence();
        }
        let (sub, word) = self.words();
        draft.word(sub);
        draft.word(word);
        Ok(())
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        self.answer(frame).map(|_| ())
    }
}

/// Diagnostics, sub-function Return Query Data (APP 6.8): the server returns the data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReturnQueryData<'a> {
    /// Any data, 0..=250 bytes.
    pub data: &'a [u8],
}

/// Bytes of data behind function code and sub-function.
const QUERY_MAX: usize = 250;

impl Request for ReturnQueryData<'_> {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        draft.read(function::DIAGNOSTICS)?;
        if self.data.len() > QUERY_MAX {
            return Err(RequestError::Data {
                len: self.data.len().min(usize::from(u16::MAX)) as u16,
                max: QUERY_MAX as u16,
            });
        }
        draft.word(0x0000);
        for &byte in self.data {
            draft.byte(byte);
        }
        Ok(())
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        match data(frame) {
            [0, 0, back @ ..] if back == self.data => Ok(()),
            [_, _, back @ ..] if back.len() == self.data.len() => Err(AnswerError::Content),
            _ => Err(length(frame)),
        }
    }
}
