//! Coils and discrete inputs: functions 01, 02, 05, 0F.

use super::{AnswerError, Draft, Request, RequestError, block, counted_exactly, echo};
use crate::data::{Coils, bytes_for};
use crate::function;

/// Read Coils (APP 6.1) or Read Discrete Inputs (APP 6.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadBits {
    function: u8,
    first: u16,
    count: u16,
}

impl ReadBits {
    /// Reads `count` coils from `first` on, 1..=2000.
    pub const fn coils(first: u16, count: u16) -> ReadBits {
        ReadBits {
            function: function::READ_COILS,
            first,
            count,
        }
    }

    /// Reads `count` discrete inputs from `first` on, 1..=2000.
    pub const fn discrete_inputs(first: u16, count: u16) -> ReadBits {
        ReadBits {
            function: function::READ_DISCRETE_INPUTS,
            first,
            count,
        }
    }

    /// The values in the answer. Bits behind the last value are ignored.
    ///
    /// # Errors
    ///
    /// [`AnswerError`] if the length of `frame` does not fit the request.
    #[inline(never)]
    pub fn answer<'a>(&self, frame: &'a [u8]) -> Result<Coils<'a>, AnswerError> {
        let bytes = counted_exactly(frame, bytes_for(self.count))?;
        Ok(Coils::of(bytes, self.count))
    }
}

impl Request for ReadBits {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        draft.read_block(
            self.function,
            self.first,
            self.count,
            function::READ_BITS_MAX,
        )
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        self.answer(frame).map(|_| ())
    }
}

/// Write Single Coil (APP 6.5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteCoil {
    /// The address of the coil.
    pub address: u16,
    /// Whether the coil is switched on.
    pub on: bool,
}

impl WriteCoil {
    const fn value(&self) -> u16 {
        if self.on {
            function::COIL_ON
        } else {
            function::COIL_OFF
        }
    }
}

impl Request for WriteCoil {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        draft.byte(function::WRITE_SINGLE_COIL);
        draft.word(self.address);
        draft.word(self.value());
        Ok(())
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        echo(frame, self.address, self.value())
    }
}

/// Write Multiple Coils (APP 6.11), with one `bool` for each coil.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteCoils<'a> {
    /// The address of the first coil.
    pub first: u16,
    /// The new values, 1..=1968.
    pub values: &'a [bool],
}

impl Request for WriteCoils<'_> {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        head(draft, self.first, self.values.len())?;
        for eight in self.values.chunks(8) {
            let mut byte = 0;
            for &on in eight.iter().rev() {
                byte = byte << 1 | u8::from(on);
            }
            draft.byte(byte);
        }
        Ok(())
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        echo(frame, self.first, self.values.len() as u16)
    }
}

/// Write Multiple Coils (APP 6.11), with eight coils to a byte, the first in the lowest bit of the first byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WritePackedCoils<'a> {
    /// The address of the first coil.
    pub first: u16,
    /// The number of coils, 1..=1968.
    pub count: u16,
    /// The new values: a byte for each eight coils begun. Bits behind the last coil are not sent.
    pub bytes: &'a [u8],
}

impl Request for WritePackedCoils<'_> {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        head(draft, self.first, self.count.into())?;
        let needed = bytes_for(self.count);
        if self.bytes.len() != needed {
            return Err(RequestError::Packed {
                len: self.bytes.len().min(usize::from(u16::MAX)) as u16,
                needed: needed as u16,
            });
        }
        let behind = (8 - self.count % 8) % 8;
        for (left, &byte) in (0..needed).rev().zip(self.bytes) {
            let mask = if left == 0 { 0xFF >> behind } else { 0xFF };
            draft.byte(byte & mask);
        }
        Ok(())
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        echo(frame, self.first, self.count)
    }
}

/// Writes function code, first address, count and byte count.
fn head(draft: &mut Draft<'_>, first: u16, count: usize) -> Result<(), RequestError> {
    block(first, count, function::WRITE_COILS_MAX)?;
    let count = count as u16;
    draft.byte(function::WRITE_MULTIPLE_COILS);
    draft.word(first);
    draft.word(count);
    draft.byte(bytes_for(count) as u8);
    Ok(())
}
