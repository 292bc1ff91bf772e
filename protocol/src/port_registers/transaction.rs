//! What the registers of a master describe: one request after the other, and what its answer means for the arrays.

use super::PortRegisters;
use super::load::is_for_coils;
use crate::client::{AnswerError, Draft, ReadBits, ReadRegisters, Request, RequestError};
use crate::data::Registers;
use crate::function::{
    COIL_OFF, COIL_ON, READ_COILS, READ_DISCRETE_INPUTS, READ_HOLDING_REGISTERS,
    READ_INPUT_REGISTERS, READ_WRITE_REGISTERS, WRITE_MULTIPLE_COILS, WRITE_MULTIPLE_REGISTERS,
    WRITE_SINGLE_COIL, WRITE_SINGLE_REGISTER,
};
use crate::registers::Rules;
use crate::registers::items::{Items, Run, run};

/// A transaction as the registers described it when it was started, to be carried out [`TransactionStep`] by step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transaction {
    function: u8,
    unit: u8,
    base: u16,
    offset: u16,
    left: u16,
    scans: bool,
}

impl Transaction {
    /// Whether it goes on after a step that failed: a scan list does, with the next slave; of a block that had to be split the
    /// rest is left alone.
    pub const fn goes_on(&self) -> bool {
        self.scans
    }
}

/// One request: items at addresses that follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TransactionStep {
    /// The slave, 0..=247.
    pub unit: u8,
    /// Address of the first item.
    pub first: u16,
    /// How many items.
    pub count: u16,
    function: u8,
    /// Where they are in the array.
    index: u16,
}

impl<R, C, V> PortRegisters<R, C, V>
where
    R: Items<Item = u16>,
    C: Items<Item = bool>,
    V: Rules,
{
    /// What the registers describe, for [`Change::Start`](super::Change::Start).
    pub fn transaction(&self) -> Transaction {
        let for_coils = !C::NONE && is_for_coils(self.function);
        let (offset, left) = if for_coils {
            (self.coil_offset, self.coil_count)
        } else {
            (self.reg_offset, self.reg_count)
        };
        Transaction {
            function: self.function,
            unit: self.settings.slave_id,
            base: self.settings.base,
            offset,
            left,
            scans: R::SCANS && !for_coils,
        }
    }

    /// The next request of a transaction, `None` after the last. Items that are not consecutive in address take more than one,
    /// as few as there can be, in order.
    pub fn next_step(&self, transaction: &mut Transaction) -> Option<TransactionStep> {
        let Transaction {
            function,
            mut unit,
            base,
            offset,
            left,
            scans,
        } = *transaction;
        let for_coils = !C::NONE && is_for_coils(function);
        if left == 0 {
            return None;
        }
        let found = if scans {
            let entry = self.regs.entry(offset)?;
            unit = entry.unit;
            run(&self.regs, entry.index, 1)?
        } else if for_coils && C::SPARSE {
            run(&self.coils, offset, left)?
        } else if !for_coils && R::SPARSE {
            run(&self.regs, offset, left)?
        } else {
            Run {
                index: if for_coils { 0 } else { offset },
                first: base.checked_add(offset)?,
                count: left,
            }
        };
        transaction.left -= found.count;
        transaction.offset = offset.saturating_add(found.count);
        Some(TransactionStep {
            unit,
            first: found.first,
            count: found.count,
            function,
            index: found.index,
        })
    }

    /// Writes the request of a step, with what is in the arrays now; gives the value that a single write is echoed with.
    ///
    /// # Errors
    ///
    /// [`RequestError::Broadcast`] for a read from slave id 0.
    pub fn encode(
        &self,
        step: &TransactionStep,
        draft: &mut Draft<'_>,
    ) -> Result<u16, RequestError> {
        let items = step.indices();
        match step.function {
            READ_COILS if !C::NONE => ReadBits::coils(step.first, step.count).encode(draft)?,
            READ_DISCRETE_INPUTS if !C::NONE => {
                ReadBits::discrete_inputs(step.first, step.count).encode(draft)?;
            }
            READ_HOLDING_REGISTERS => {
                ReadRegisters::holding(step.first, step.count).encode(draft)?;
            }
            READ_INPUT_REGISTERS => ReadRegisters::input(step.first, step.count).encode(draft)?,
            WRITE_SINGLE_COIL | WRITE_SINGLE_REGISTER => {
                let value = if step.function == WRITE_SINGLE_REGISTER {
                    self.regs.item(step.index).unwrap_or_default()
                } else if self.coils.item(step.index).unwrap_or_default() {
                    COIL_ON
                } else {
                    COIL_OFF
                };
                draft.byte(step.function);
                draft.word(step.first);
                draft.word(value);
                return Ok(value);
            }
            WRITE_MULTIPLE_COILS if !C::NONE => {
                draft.byte(step.function);
                draft.word(step.first);
                draft.word(step.count);
                draft.byte(step.count.div_ceil(8) as u8);
                let (mut byte, mut bit) = (0, 1);
                for index in items {
                    if self.coils.item(index).unwrap_or_default() {
                        byte |= bit;
                    }
                    bit <<= 1;
                    if bit == 0 {
                        draft.byte(byte);
                        (byte, bit) = (0, 1);
                    }
                }
                if bit != 1 {
                    draft.byte(byte);
                }
            }
            _ => {
                if step.function == READ_WRITE_REGISTERS {
                    draft.read(step.function)?;
                    draft.word(step.first);
                    draft.word(step.count);
                } else {
                    draft.byte(step.function);
                }
                draft.word(step.first);
                draft.word(step.count);
                draft.byte(step.count as u8 * 2);
                for index in items {
                    draft.word(self.regs.item(index).unwrap_or_default());
                }
            }
        }
        Ok(0)
    }

    /// Whether `frame`, from the right slave and with the right function, answers `step`, whose request was written with
    /// this [`value`](Self::encode).
    ///
    /// # Errors
    ///
    /// [`AnswerError::Length`] or [`AnswerError::Content`].
    pub fn check(step: &TransactionStep, value: u16, frame: &[u8]) -> Result<(), AnswerError> {
        match step.function {
            READ_COILS | READ_DISCRETE_INPUTS if !C::NONE => {
                ReadBits::coils(step.first, step.count).check(frame)
            }
            READ_HOLDING_REGISTERS | READ_INPUT_REGISTERS | READ_WRITE_REGISTERS => {
                ReadRegisters::holding(step.first, step.count).check(frame)
            }
            WRITE_SINGLE_COIL | WRITE_SINGLE_REGISTER => echo(frame, step.first, value),
            WRITE_MULTIPLE_COILS | WRITE_MULTIPLE_REGISTERS => echo(frame, step.first, step.count),
            _ => Err(AnswerError::Content),
        }
    }

    /// Puts what an answer that was [checked](Self::check) has into the arrays.
    pub fn store(&mut self, step: &TransactionStep, frame: &[u8]) {
        let data = frame.get(3..).unwrap_or(&[]);
        match step.function {
            READ_COILS | READ_DISCRETE_INPUTS if !C::NONE => {
                for (place, index) in (0u16..).zip(step.indices()) {
                    let byte = data.get(usize::from(place >> 3)).copied().unwrap_or(0);
                    self.coils.set_item(index, byte >> (place & 7) & 1 != 0);
                }
            }
            READ_HOLDING_REGISTERS | READ_INPUT_REGISTERS | READ_WRITE_REGISTERS => {
                let values = Registers::new(data);
                for (value, index) in values.iter().zip(step.indices()) {
                    self.regs.set_item(index, value);
                }
            }
            _ => {}
        }
    }
}

impl TransactionStep {
    /// Where its items are in the array, which has all of them.
    fn indices(&self) -> impl Iterator<Item = u16> + use<> {
        let index = self.index;
        (0..self.count).map(move |place| index.wrapping_add(place))
    }
}

fn echo(frame: &[u8], first: u16, second: u16) -> Result<(), AnswerError> {
    let words = Registers::new(frame.get(2..).unwrap_or(&[]));
    if frame.len() != 6 {
        Err(AnswerError::Length(frame.len().min(255) as u8))
    } else if words.iter().eq([first, second]) {
        Ok(())
    } else {
        Err(AnswerError::Content)
    }
}
