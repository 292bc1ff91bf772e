//! FIFO queues: function 18.

use super::{AnswerError, Draft, Request, RequestError, data, length};
use crate::data::Registers;
use crate::function;

/// Read FIFO Queue (APP 6.18). Reading does not empty the queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadFifo {
    /// The FIFO pointer address.
    pub pointer: u16,
}

impl ReadFifo {
    /// The values in the queue, 0 to 31.
    ///
    /// # Errors
    ///
    /// [`AnswerError`] if the frame's length and its two counts do not agree.
    pub fn answer<'a>(&self, frame: &'a [u8]) -> Result<Registers<'a>, AnswerError> {
        let [bytes_high, bytes_low, count_high, count_low, values @ ..] = data(frame) else {
            return Err(length(frame));
        };
        let bytes = usize::from(u16::from_be_bytes([*bytes_high, *bytes_low]));
        let count = usize::from(u16::from_be_bytes([*count_high, *count_low]));
        // The first count covers the bytes behind it.
        if bytes != 2 + values.len() {
            return Err(length(frame));
        }
        if count > usize::from(function::FIFO_MAX) || values.len() != 2 * count {
            return Err(AnswerError::Content);
        }
        Ok(Registers::new(values))
    }
}

impl Request for ReadFifo {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        draft.read(function::READ_FIFO_QUEUE)?;
        draft.word(self.pointer);
        Ok(())
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        self.answer(frame).map(|_| ())
    }
}
