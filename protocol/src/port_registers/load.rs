//! Loading and reading registers.

use super::{Change, LineSettings, Mode, PortRegisters, Reason, Refused, Register, Status, Value};
use crate::function::{
    READ_BITS_MAX, READ_COILS, READ_DISCRETE_INPUTS, READ_HOLDING_REGISTERS, READ_INPUT_REGISTERS,
    READ_REGISTERS_MAX, READ_WRITE_REGISTERS, WRITE_MULTIPLE_COILS, WRITE_MULTIPLE_REGISTERS,
    WRITE_SINGLE_COIL, WRITE_SINGLE_REGISTER,
};
use crate::registers::{Items, RuleList, Rules};

/// What iDevOS's coil examples load for on.
const ON: u32 = 255;

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
    pub fn load(&mut self, value: Value) -> Result<Change, Refused> {
        self.load_raw(value.register(), value.number())
    }

    /// Loads a register by number, whatever the chip can do. See [`load_checked`](Self::load_checked).
    ///
    /// # Errors
    ///
    /// [`Refused`]; nothing is changed then.
    pub fn load_raw(&mut self, register: Register, value: u32) -> Result<Change, Refused> {
        self.load_checked(register, value, &|_| Ok(()))
    }

    /// Loads a register by number. `line` says of settings of the line that are otherwise right whether the chip can do them.
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
            _ if register.is_of_line() => Ok(Change::Line),
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
        // How many places of a scan list are walked is a matter of its length alone.
        if R::SCANS && register == Register::RegCnt {
            if !matches!(value, 1..=65_535) {
                return Err(Reason::Range(1, 65_535));
            }
        } else if !register.has_in_range(value) {
            return Err(self.settings.wrong(register));
        }
        let word = value as u16;
        match register {
            Register::Base => return self.rebase(word),
            Register::Regs(index) => {
                if !self.regs.set_item(index, word) {
                    return Err(Reason::Index(self.regs.len() as u32));
                }
            }
            Register::Coils(index) => {
                if !matches!(value, 0 | 1 | ON) {
                    return Err(Reason::Value);
                }
                if !self.coils.set_item(index, value != 0) {
                    return Err(Reason::Index(self.coils.len() as u32));
                }
            }
            Register::Func => {
                self.function = match value {
                    1 | 2 | 5 | 15 if C::NONE => return Err(Reason::NoCoils),
                    1..=6 | 15 | 16 | 23 => value as u8,
                    _ => return Err(Reason::Value),
                };
            }
            Register::RegOff => self.reg_offset = word,
            Register::RegCnt => self.reg_count = word,
            Register::CoilOff => self.coil_offset = word,
            Register::CoilCnt => self.coil_count = word,
            Register::DisableFlg(index) => {
                if index >= V::DISABLE_REG {
                    return Err(Reason::Index(V::DISABLE_REG.into()));
                }
                let flag = 1 << index;
                match value {
                    0 => self.flags &= !flag,
                    1 => self.flags |= flag,
                    _ => return Err(Reason::Value),
                }
            }
            Register::Start => match value {
                1 if self.running => return Err(Reason::Running),
                1 => {}
                _ => return Err(Reason::Value),
            },
            Register::Status
            | Register::Error
            | Register::DataOk
            | Register::DataErr
            | Register::ValidData(_)
            | Register::ValidReg(_)
            | Register::DisableReg(_) => return Err(Reason::ReadOnly),
            _ => return self.settings.load(register, value, line),
        }
        Ok(())
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
        Ok(match register {
            Register::Base => self.settings.base.into(),
            Register::Regs(index) => {
                let item = self.regs.item(index);
                item.ok_or(none(self.regs.len()))?.into()
            }
            Register::Coils(index) => {
                let item = self.coils.item(index);
                item.ok_or(none(self.coils.len()))?.into()
            }
            Register::Func => self.function.into(),
            Register::RegOff => self.reg_offset.into(),
            Register::RegCnt => self.reg_count.into(),
            Register::CoilOff => self.coil_offset.into(),
            Register::CoilCnt => self.coil_count.into(),
            Register::Status => self.status as u32,
            Register::Error => self.error.into(),
            Register::DataOk => self.ended_well.into(),
            Register::DataErr => self.ended_badly.into(),
            Register::ValidData(index) => rule(RuleList::ValidData, index, V::VALID_DATA)?,
            Register::ValidReg(index) => rule(RuleList::ValidReg, index, V::VALID_REG)?,
            Register::DisableReg(index) => rule(RuleList::DisableReg, index, V::DISABLE_REG)?,
            Register::DisableFlg(index) if index < V::DISABLE_REG => self.flags >> index & 1,
            Register::DisableFlg(_) => return Err(none(V::DISABLE_REG.into())),
            Register::Start => self.running.into(),
            _ => self.settings.read(register),
        })
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
