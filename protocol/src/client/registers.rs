//! Holding and input registers: functions 03, 04, 06, 10, 16, 17.

use super::{
    AnswerError, Draft, Request, RequestError, block, counted_exactly, data, echo, length,
};
use crate::data::Registers;
use crate::function;

/// Read Holding Registers (APP 6.3) or Read Input Registers (APP 6.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadRegisters {
    function: u8,
    first: u16,
    count: u16,
}

impl ReadRegisters {
    /// Reads `count` holding registers from `first` on, 1..=125.
    pub const fn holding(first: u16, count: u16) -> ReadRegisters {
        ReadRegisters {
            function: function::READ_HOLDING_REGISTERS,
            first,
            count,
        }
    }

    /// Reads `count` input registers from `first` on, 1..=125.
    pub const fn input(first: u16, count: u16) -> ReadRegisters {
        ReadRegisters {
            function: function::READ_INPUT_REGISTERS,
            first,
            count,
        }
    }

    /// The values in the answer.
    ///
    /// # Errors
    ///
    /// [`AnswerError`] if the length of `frame` does not fit the request.
    #[inline(never)]
    pub fn answer<'a>(&self, frame: &'a [u8]) -> Result<Registers<'a>, AnswerError> {
        registers(frame, self.count)
    }
}

impl Request for ReadRegisters {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        draft.read_block(
            self.function,
            self.first,
            self.count,
            function::READ_REGISTERS_MAX,
        )
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        self.answer(frame).map(|_| ())
    }
}

/// Write Single Register (APP 6.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteRegister {
    /// The address of the register.
    pub address: u16,
    /// The new value.
    pub value: u16,
}

impl Request for WriteRegister {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        draft.byte(function::WRITE_SINGLE_REGISTER);
        draft.word(self.address);
        draft.word(self.value);
        Ok(())
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        echo(frame, self.address, self.value)
    }
}

/// Write Multiple Registers (APP 6.12).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteRegisters<'a> {
    /// The address of the first register.
    pub first: u16,
    /// The new values, 1..=123.
    pub values: &'a [u16],
}

impl Request for WriteRegisters<'_> {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        let limit = function::WRITE_REGISTERS_MAX;
        block(self.first, self.values.len(), limit)?;
        draft.byte(function::WRITE_MULTIPLE_REGISTERS);
        block_of_values(draft, self.first, self.values);
        Ok(())
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        echo(frame, self.first, self.values.len() as u16)
    }
}

/// Mask Write Register (APP 6.16): the new value is `(current & and) | (or & !and)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MaskWrite {
    /// The address of the register.
    pub address: u16,
    /// A mask of the bits that keep their value.
    pub and: u16,
    /// The value of the other bits.
    pub or: u16,
}

impl Request for MaskWrite {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        draft.byte(function::MASK_WRITE_REGISTER);
        draft.word(self.address);
        draft.word(self.and);
        draft.word(self.or);
        Ok(())
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        let words = data(frame);
        if words.len() != 6 {
            return Err(length(frame));
        }
        let expected = [self.address, self.and, self.or];
        if Registers::new(words).iter().eq(expected) {
            Ok(())
        } else {
            Err(AnswerError::Content)
        }
    }
}

/// Read/Write Multiple Registers (APP 6.17): the write is done before the read. Unit 0 is refused, since it reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadWriteRegisters<'a> {
    /// The address of the first register to read.
    pub first: u16,
    /// The number of registers to read, 1..=125.
    pub count: u16,
    /// The address of the first register to write.
    pub write_first: u16,
    /// The new values, 1..=121.
    pub values: &'a [u16],
}

impl ReadWriteRegisters<'_> {
    /// The values that were read.
    ///
    /// # Errors
    ///
    /// [`AnswerError`] if the length of `frame` does not fit the request.
    pub fn answer<'a>(&self, frame: &'a [u8]) -> Result<Registers<'a>, AnswerError> {
        registers(frame, self.count)
    }
}

impl Request for ReadWriteRegisters<'_> {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        draft.read(function::READ_WRITE_REGISTERS)?;
        block(self.first, self.count.into(), function::READ_REGISTERS_MAX)?;
        let limit = function::READ_WRITE_REGISTERS_MAX;
        block(self.write_first, self.values.len(), limit)?;
        draft.word(self.first);
        draft.word(self.count);
        block_of_values(draft, self.write_first, self.values);
        Ok(())
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        self.answer(frame).map(|_| ())
    }
}

/// Writes first address, count, byte count and values.
fn block_of_values(draft: &mut Draft<'_>, first: u16, values: &[u16]) {
    draft.word(first);
    draft.word(values.len() as u16);
    draft.byte((2 * values.len()) as u8);
    draft.words(values);
}

fn registers(frame: &[u8], count: u16) -> Result<Registers<'_>, AnswerError> {
    counted_exactly(frame, 2 * usize::from(count)).map(Registers::new)
}
