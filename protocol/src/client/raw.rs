//! Requests with any function code, such as those of an application.

use super::{AnswerError, Draft, Request, RequestError, data};

/// Bytes of data behind the function code (APP 4.1).
const DATA_MAX: usize = 252;

/// A request with any function code and any data. The caller checks the answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Raw<'a> {
    /// The function code, 1..=127.
    pub function: u8,
    /// The data after the function code, 0..=252 bytes.
    pub data: &'a [u8],
}

impl Raw<'_> {
    /// The data of the answer.
    pub fn answer<'a>(&self, frame: &'a [u8]) -> &'a [u8] {
        data(frame)
    }
}

impl Request for Raw<'_> {
    /// Unit 0 is allowed: the caller knows whether the function makes sense as a broadcast.
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        if !(1..=127).contains(&self.function) {
            return Err(RequestError::Function {
                function: self.function,
            });
        }
        if self.data.len() > DATA_MAX {
            return Err(RequestError::Data {
                len: self.data.len().min(usize::from(u16::MAX)) as u16,
                max: DATA_MAX as u16,
            });
        }
        draft.byte(self.function);
        for &byte in self.data {
            draft.byte(byte);
        }
        Ok(())
    }

    fn check(&self, _frame: &[u8]) -> Result<(), AnswerError> {
        Ok(())
    }
}
