//! Loading and reading registers.

use super::{
    Change, Duplex, Flow, InterCharacter, LineSettings, Mode, PortRegisters, Reason, Refused,
    Register, Settings, Status,
};
use crate::UNIT_MAX;
use crate::format::{Framing, LineFormat};
use crate::function::{
    READ_BITS_MAX, READ_COILS, READ_DISCRETE_INPUTS, READ_HOLDING_REGISTERS, READ_INPUT_REGISTERS,
    READ_REGISTERS_MAX, READ_WRITE_REGISTERS, WRITE_MULTIPLE_COILS, WRITE_MULTIPLE_REGISTERS,
    WRITE_SINGLE_COIL, WRITE_SINGLE_REGISTER,
};
use crate::registers::{Items, RuleList, Rules};

/// What iDevOS's coil examples load for on.
const ON: u32 = 255;

/// The range of a register that takes any word.
const WORD: (u32, u32) = (0, 65_535);

impl<R, C, V> PortRegisters<R, C, V>
where
    R: Items<Item = u16>,
    C: Items<Item = bool>,
    V: Rules,
{
    /// Loads a register, whatever the chip can do. See [`load_checked`](Self::load_checked).
    ///
    /// # Errors
    ///
    /// [`Refused`]; nothing is changed then.
    pub fn load(&mut self, register: Register, value: u32) -> Result<Change, Refused> {
        self.load_checked(register, value, &|_| Ok(()))
    }

    /// Loads a register. `line` says of settings of the line that are otherwise right whether the chip can do them.
    ///
    /// START is 1 from here on until [`finish`](Self::finish). A transaction under way is not touched by any load: it works with
    /// what the registers described when it was started.
    ///
    /// # Errors
    ///
    /// [`Refused`]; nothing is changed then.
    #[inline(never)]
    pub fn load_checked(
        &mut self,
        register: Register,
        value: u32,
        line: &dyn Fn(&LineSettings) -> Result<(), Reason>,
    ) -> Result<Change, Refused> {
        let refused = |reason| Refused {
            register,
            value,
            reason,
        };
        self.take(register, value, line).map_err(refused)?;
        match register {
            Register::Mode | Register::SlaveId => Ok(Change::Mode),
            Register::Baud
            | Register::Framing
            | Register::Format
            | Register::Duplex
            | Register::Flow
            | Register::InterCharacter
            | Register::CtsTimeout
            | Register::DeLead
            | Register::ResponseDelay => Ok(Change::Line),
            Register::Start => self.start().map(|()| Change::Start),
            _ => Ok(Change::Done),
        }
    }

    fn take(
        &mut self,
        register: Register,
        value: u32,
        line: &dyn Fn(&LineSettings) -> Result<(), Reason>,
    ) -> Result<(), Reason> {
        if let Some((word, (low, high))) = self.word_mut(register) {
            *word = within(value, low, high)? as u16;
            return Ok(());
        }
        let mut new = self.settings.line;
        match register {
            Register::Mode => {
                let mode = match value {
                    0 => Mode::Master,
                    1 => Mode::Slave,
                    2 => Mode::Off,
                    3 => Mode::Sniffer,
                    4 => return Err(Reason::NotYet),
                    _ => return Err(Reason::Choice),
                };
                if mode.talks() && new.framing == Framing::Text {
                    return Err(Reason::Text);
                }
                if mode == Mode::Slave && self.settings.slave_id == 0 {
                    return Err(Reason::SlaveZero);
                }
                self.settings.mode = mode;
                return Ok(());
            }
            Register::SlaveId => {
                let low = u32::from(self.settings.mode == Mode::Slave);
                self.settings.slave_id = within(value, low, UNIT_MAX.into())? as u8;
                return Ok(());
            }
            Register::Base => return self.rebase(within(value, 0, WORD.1)? as u16),
            Register::Regs(index) => {
                let value = within(value, 0, WORD.1)? as u16;
                return match self.regs.set_item(index, value) {
                    true => Ok(()),
                    false => Err(Reason::Index(self.regs.len() as u32)),
                };
            }
            Register::Coils(index) => {
                if !matches!(value, 0 | 1 | ON) {
                    return Err(Reason::Choice);
                }
                return match self.coils.set_item(index, value != 0) {
                    true => Ok(()),
                    false => Err(Reason::Index(self.coils.len() as u32)),
                };
            }
            Register::Func => {
                self.function = match value {
                    1 | 2 | 5 | 15 if C::NONE => return Err(Reason::NoCoils),
                    1..=6 | 15 | 16 | 23 => value as u8,
                    _ => return Err(Reason::Choice),
                };
                return Ok(());
            }
            Register::Retries => {
                self.settings.retries = within(value, 0, 255)? as u8;
                return Ok(());
            }
            Register::DisableFlg(index) => {
                if index >= V::DISABLE_REG {
                    return Err(Reason::Index(V::DISABLE_REG.into()));
                }
                let flag = 1 << index;
                match value {
                    0 => self.flags &= !flag,
                    1 => self.flags |= flag,
                    _ => return Err(Reason::Choice),
                }
                return Ok(());
            }
            Register::Start => {
                return match value {
                    1 if self.running => Err(Reason::Running),
                    1 => Ok(()),
                    _ => Err(Reason::Choice),
                };
            }
            Register::Baud => {
                let (low, high) = Settings::BAUD;
                new.baud = within(value, low, high)?;
            }
            Register::Framing => {
                new.framing = match value {
                    0 => Framing::Rtu,
                    1 => Framing::Ascii,
                    2 if self.settings.mode.talks() => return Err(Reason::Text),
                    2 => Framing::Text,
                    _ => return Err(Reason::Choice),
                };
            }
            Register::Format => new.format = format(value).ok_or(Reason::Choice)?,
            Register::Duplex => {
                new.duplex = match value {
                    0 => Duplex::Half,
                    1 => Duplex::Full,
                    _ => return Err(Reason::Choice),
                };
            }
            Register::Flow => {
                new.flow = match value {
                    0 => Flow::None,
                    1 => Flow::RtsCts,
                    _ => return Err(Reason::Choice),
                };
            }
            Register::InterCharacter => {
                let (low, high) = InterCharacter::GAP;
                new.inter_character = match value {
                    0 => InterCharacter::Strict,
                    1 => InterCharacter::Off,
                    _ if (low..=high).contains(&value) => InterCharacter::Gap(value as u8),
                    _ => return Err(Reason::Choice),
                };
            }
            // Those that only tell; the others are words.
            _ => return Err(Reason::ReadOnly),
        }
        if new.framing == Framing::Rtu && new.format.data_bits() == 7 {
            return Err(Reason::SevenBits);
        }
        line(&new)?;
        self.settings.line = new;
        Ok(())
    }

    /// Where the value of a register is that takes every word of a range, and the range; `None` for others.
    fn word_mut(&mut self, register: Register) -> Option<(&mut u16, (u32, u32))> {
        let settings = &mut self.settings;
        Some(match register {
            Register::RegOff => (&mut self.reg_offset, WORD),
            // How many a scan list may walk is a matter of its length alone.
            Register::RegCnt if R::SCANS => (&mut self.reg_count, (1, WORD.1)),
            Register::RegCnt => (&mut self.reg_count, (1, READ_REGISTERS_MAX as u32)),
            Register::CoilOff => (&mut self.coil_offset, WORD),
            Register::CoilCnt => (&mut self.coil_count, (1, READ_BITS_MAX as u32)),
            Register::Timeout => (&mut settings.timeout_ms, Settings::TIMEOUT),
            Register::Turnaround => (&mut settings.turnaround_ms, WORD),
            Register::LateGuard => (&mut settings.late_guard_ms, WORD),
            Register::RequestGap => (&mut settings.request_gap_ms, WORD),
            Register::CtsTimeout => (&mut settings.line.cts_timeout_ms, Settings::CTS_TIMEOUT),
            Register::DeLead => (&mut settings.line.de_lead_us, Settings::DE_LEAD),
            Register::ResponseDelay => {
                let word = &mut settings.line.response_delay_ms;
                (word, Settings::RESPONSE_DELAY)
            }
            _ => return None,
        })
    }

    fn rebase(&mut self, base: u16) -> Result<(), Reason> {
        let old = self.settings.base;
        if !self.regs.rebase(base) {
            return Err(Reason::Base(self.regs.len() as u32));
        }
        if !self.coils.rebase(base) {
            self.regs.rebase(old);
            return Err(Reason::Base(self.coils.len() as u32));
        }
        self.settings.base = base;
        Ok(())
    }

    /// Begins the transaction if the registers describe one.
    fn start(&mut self) -> Result<(), Refused> {
        let wrong = |register, value: u16, reason| {
            Err(Refused {
                register,
                value: value.into(),
                reason,
            })
        };
        let mode = self.settings.mode;
        if mode != Mode::Master {
            return wrong(Register::Mode, mode as u16, Reason::NotMaster);
        }
        let most = count_max(self.function);
        if !C::NONE && is_for_coils(self.function) {
            let (offset, count) = (self.coil_offset, self.coil_count);
            if count > most {
                let reason = Reason::Count(self.function, most);
                return wrong(Register::CoilCnt, count, reason);
            }
            let len = self.coils.len();
            let first = if C::SPARSE { offset } else { 0 };
            if usize::from(first) + usize::from(count) > len {
                let reason = Reason::Beyond(count, len as u32);
                return match C::SPARSE {
                    true => wrong(Register::CoilOff, offset, reason),
                    false => wrong(Register::CoilCnt, count, Reason::Range(1, len as u32)),
                };
            }
            let base = self.settings.base;
            if !C::SPARSE && u32::from(base) + u32::from(offset) + u32::from(count) > 65_536 {
                return wrong(Register::CoilOff, offset, Reason::Address(base, count));
            }
        } else {
            let (offset, count) = (self.reg_offset, self.reg_count);
            if !R::SCANS && count > most {
                let reason = Reason::Count(self.function, most);
                return wrong(Register::RegCnt, count, reason);
            }
            let len = self.regs.len();
            if usize::from(offset) + usize::from(count) > len {
                return wrong(Register::RegOff, offset, Reason::Beyond(count, len as u32));
            }
        }
        self.running = true;
        self.status = Status::Transmitting;
        self.error = 0;
        Ok(())
    }

    /// Reads a register.
    ///
    /// # Errors
    ///
    /// [`Refused`] for an element that an array does not have.
    #[inline(never)]
    pub fn read(&self, register: Register) -> Result<u32, Refused> {
        let none = |len: usize| Refused {
            register,
            value: 0,
            reason: Reason::Index(len as u32),
        };
        let rule = |list, index, len: u8| {
            let span = V::registers(list, index).ok_or(none(len.into()))?;
            Ok(u32::from(span.first) << 16 | u32::from(span.last))
        };
        let line = &self.settings.line;
        Ok(match register {
            Register::Mode => self.settings.mode as u32,
            Register::Framing => match line.framing {
                Framing::Rtu => 0,
                Framing::Ascii => 1,
                Framing::Text => 2,
            },
            Register::Base => self.settings.base.into(),
            Register::Regs(index) => {
                let item = self.regs.item(index);
                item.ok_or(none(self.regs.len()))?.into()
            }
            Register::Coils(index) => {
                let item = self.coils.item(index);
                item.ok_or(none(self.coils.len()))?.into()
            }
            Register::SlaveId => self.settings.slave_id.into(),
            Register::Func => self.function.into(),
            Register::RegOff => self.reg_offset.into(),
            Register::RegCnt => self.reg_count.into(),
            Register::CoilOff => self.coil_offset.into(),
            Register::CoilCnt => self.coil_count.into(),
            Register::Status => self.status as u32,
            Register::Error => self.error.into(),
            Register::Timeout => self.settings.timeout_ms.into(),
            Register::Retries => self.settings.retries.into(),
            Register::Turnaround => self.settings.turnaround_ms.into(),
            Register::DataOk => self.ended_well.into(),
            Register::DataErr => self.ended_badly.into(),
            Register::ValidData(index) => rule(RuleList::ValidData, index, V::VALID_DATA)?,
            Register::ValidReg(index) => rule(RuleList::ValidReg, index, V::VALID_REG)?,
            Register::DisableReg(index) => rule(RuleList::DisableReg, index, V::DISABLE_REG)?,
            Register::DisableFlg(index) if index < V::DISABLE_REG => self.flags >> index & 1,
            Register::DisableFlg(_) => return Err(none(V::DISABLE_REG.into())),
            Register::Baud => line.baud,
            Register::Format => number(line.format),
            Register::Duplex => line.duplex as u32,
            Register::Flow => line.flow as u32,
            Register::InterCharacter => match line.inter_character {
                InterCharacter::Strict => 0,
                InterCharacter::Off => 1,
                InterCharacter::Gap(ms) => ms.into(),
            },
            Register::LateGuard => self.settings.late_guard_ms.into(),
            Register::CtsTimeout => line.cts_timeout_ms.into(),
            Register::RequestGap => self.settings.request_gap_ms.into(),
            Register::DeLead => line.de_lead_us.into(),
            Register::ResponseDelay => line.response_delay_ms.into(),
            Register::Start => self.running.into(),
        })
    }
}

fn within(value: u32, low: u32, high: u32) -> Result<u32, Reason> {
    if value < low || value > high {
        Err(Reason::Range(low, high))
    } else {
        Ok(value)
    }
}

/// Matches rather than a table: that would be in RAM on AVR.
fn format(number: u32) -> Option<LineFormat> {
    Some(match number {
        0 => LineFormat::F8N1,
        1 => LineFormat::F8E1,
        2 => LineFormat::F8O1,
        3 => LineFormat::F8N2,
        4 => LineFormat::F7E1,
        5 => LineFormat::F7O1,
        6 => LineFormat::F7N2,
        _ => return None,
    })
}

fn number(format: LineFormat) -> u32 {
    match format {
        LineFormat::F8N1 => 0,
        LineFormat::F8E1 => 1,
        LineFormat::F8O1 => 2,
        LineFormat::F8N2 => 3,
        LineFormat::F7E1 => 4,
        LineFormat::F7O1 => 5,
        LineFormat::F7N2 => 6,
    }
}

/// Whether FUNC works with COILS.
pub(super) fn is_for_coils(function: u8) -> bool {
    matches!(
        function,
        READ_COILS | READ_DISCRETE_INPUTS | WRITE_SINGLE_COIL | WRITE_MULTIPLE_COILS
    )
}

/// How many items one transaction of FUNC carries at most.
fn count_max(function: u8) -> u16 {
    use crate::function::{READ_WRITE_REGISTERS_MAX, WRITE_COILS_MAX, WRITE_REGISTERS_MAX};
    match function {
        READ_COILS | READ_DISCRETE_INPUTS => READ_BITS_MAX,
        READ_HOLDING_REGISTERS | READ_INPUT_REGISTERS => READ_REGISTERS_MAX,
        WRITE_MULTIPLE_COILS => WRITE_COILS_MAX,
        WRITE_MULTIPLE_REGISTERS => WRITE_REGISTERS_MAX,
        READ_WRITE_REGISTERS => READ_WRITE_REGISTERS_MAX,
        WRITE_SINGLE_COIL | WRITE_SINGLE_REGISTER => 1,
        _ => 0,
    }
}
