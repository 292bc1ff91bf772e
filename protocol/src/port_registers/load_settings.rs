//! Loading and reading the registers that are settings of the port: the same code for all ports of an image.

use super::settings::InterCharacter;
use super::{Duplex, Flow, LineSettings, Mode, PortSettings, Reason, Register};
use crate::UNIT_MAX;
use crate::format::{Framing, LineFormat};

/// The range of a register that takes any word.
pub(super) const WORD: (u32, u32) = (0, 65_535);

impl PortSettings {
    /// Loads a register that is a setting; `line` says whether the chip can do what concerns the line.
    ///
    /// # Errors
    ///
    /// Why it keeps its value; [`Reason::ReadOnly`] for a register that is none of the settings.
    #[inline(never)]
    pub(super) fn load(
        &mut self,
        register: Register,
        value: u32,
        line: &dyn Fn(&LineSettings) -> Result<(), Reason>,
    ) -> Result<(), Reason> {
        if let Some((word, (low, high))) = self.word_mut(register) {
            *word = within(value, low, high)? as u16;
            return Ok(());
        }
        let mut new = self.line;
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
                if mode == Mode::Slave && self.slave_id == 0 {
                    return Err(Reason::SlaveZero);
                }
                self.mode = mode;
                return Ok(());
            }
            Register::SlaveId => {
                let low = u32::from(self.mode == Mode::Slave);
                self.slave_id = within(value, low, UNIT_MAX.into())? as u8;
                return Ok(());
            }
            Register::Retries => {
                self.retries = within(value, 0, 255)? as u8;
                return Ok(());
            }
            Register::Baud => {
                let (low, high) = PortSettings::BAUD;
                new.baud = within(value, low, high)?;
            }
            Register::Framing => {
                new.framing = match value {
                    0 => Framing::Rtu,
                    1 => Framing::Ascii,
                    2 if self.mode.talks() => return Err(Reason::Text),
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
            _ => return Err(Reason::ReadOnly),
        }
        if new.framing == Framing::Rtu && new.format.data_bits() == 7 {
            return Err(Reason::SevenBits);
        }
        line(&new)?;
        self.line = new;
        Ok(())
    }

    /// Where the value of a register is that takes every word of a range, and the range; `None` for others.
    fn word_mut(&mut self, register: Register) -> Option<(&mut u16, (u32, u32))> {
        let line = &mut self.line;
        Some(match register {
            Register::Timeout => (&mut self.timeout_ms, PortSettings::TIMEOUT),
            Register::Turnaround => (&mut self.turnaround_ms, WORD),
            Register::LateGuard => (&mut self.late_guard_ms, WORD),
            Register::RequestGap => (&mut self.request_gap_ms, WORD),
            Register::CtsTimeout => (&mut line.cts_timeout_ms, PortSettings::CTS_TIMEOUT),
            Register::DeLead => (&mut line.de_lead_us, PortSettings::DE_LEAD),
            Register::ResponseDelay => (&mut line.response_delay_ms, PortSettings::RESPONSE_DELAY),
            _ => return None,
        })
    }

    /// Reads a register that is a setting; 0 for others.
    #[inline(never)]
    pub(super) fn read(&self, register: Register) -> u32 {
        let line = &self.line;
        match register {
            Register::Mode => self.mode as u32,
            Register::Framing => match line.framing {
                Framing::Rtu => 0,
                Framing::Ascii => 1,
                Framing::Text => 2,
            },
            Register::SlaveId => self.slave_id.into(),
            Register::Timeout => self.timeout_ms.into(),
            Register::Retries => self.retries.into(),
            Register::Turnaround => self.turnaround_ms.into(),
            Register::LateGuard => self.late_guard_ms.into(),
            Register::RequestGap => self.request_gap_ms.into(),
            Register::Baud => line.baud,
            Register::Format => number(line.format),
            Register::Duplex => line.duplex as u32,
            Register::Flow => line.flow as u32,
            Register::InterCharacter => match line.inter_character {
                InterCharacter::Strict => 0,
                InterCharacter::Off => 1,
                InterCharacter::Gap(ms) => ms.into(),
            },
            Register::CtsTimeout => line.cts_timeout_ms.into(),
            Register::DeLead => line.de_lead_us.into(),
            Register::ResponseDelay => line.response_delay_ms.into(),
            _ => 0,
        }
    }
}

pub(super) fn within(value: u32, low: u32, high: u32) -> Result<u32, Reason> {
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
