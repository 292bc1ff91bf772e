//! The addresses of the registers (RM0090 2.3).

use super::Chip;
use crate::machine::core::gpio::Pin;
use crate::machine::core::nvic::Asked;
use crate::machine::core::{Access, Cause, Output, WIRING};

impl Chip {
    /// The register that is switched on by this bit of an enable register of RCC, if `address` is one of a peripheral that has one.
    fn enable_of(address: u32) -> Option<(u32, u8)> {
        Some(match address & !0x3FF {
            0x4000_0000 => (0x40, 0),
            0x4000_0C00 => (0x40, 3),
            0x4000_4400 => (0x40, 17),
            0x4000_4800 => (0x40, 18),
            0x4000_4C00 => (0x40, 19),
            0x4000_7000 => (0x40, 28),
            0x4001_1000 => (0x44, 4),
            0x4001_3800 => (0x44, 14),
            0x4002_0000..=0x4002_2000 => (0x30, ((address - 0x4002_0000) / 0x400) as u8),
            _ => return None,
        })
    }

    pub(super) fn is_off(&self, address: u32) -> bool {
        let enable = Self::enable_of(address);
        enable.is_some_and(|(offset, bit)| !self.rcc.is_on(offset, bit))
    }

    /// Reads a register of this size; `None` if it is not modelled.
    pub fn load(&mut self, address: u32, size: u32) -> Option<u32> {
        let offset = address & 0x3FF;
        match address & !0x3FF {
            0x4000_0000 => {
                self.tim2.advance(self.now);
                self.tim2.read(offset, self.now)
            }
            0x4000_0C00 => {
                self.tim5.advance(self.now);
                self.tim5.read(offset, self.now)
            }
            0x4000_3000 => self.iwdg.read(offset),
            0x4000_7000 => self.rcc.read_power(offset),
            0x4001_3800 => self.pins.read_routing(offset),
            0x4001_3C00 => self.pins.read_exti(offset),
            0x4002_0000..=0x4002_2000 => {
                let gpio = (address - 0x4002_0000) / 0x400;
                let mut levels = self.pins.read(gpio as usize, offset)?;
                if offset == 0x10 {
                    // RTS is a USART's.
                    for number in 0..16 {
                        let at = Pin {
                            gpio: gpio as u8,
                            number,
                        };
                        let bit = 1 << number;
                        levels = levels & !bit | u32::from(self.level(at)) << number;
                    }
                }
                Some(levels)
            }
            0x4002_3800 => self.rcc.read(offset, self.now),
            0x4002_3C00 => self.rcc.read_flash(offset),
            0xE000_E000..=0xE000_EFFF => {
                let offset = address - 0xE000_E000;
                let read = self.nvic.read_priorities(offset, size);
                read.or_else(|| self.nvic.read(offset))
            }
            0xE004_2000 => match offset {
                // Revision Z.
                0x00 => Some(0x1001_6413),
                0x04..=0x0C => Some(self.dbgmcu[offset as usize / 4 - 1]),
                _ => None,
            },
            page => {
                let port = WIRING.iter().position(|wiring| wiring.usart == page)?;
                self.advance(port);
                let now = self.time();
                self.usarts[port].read(offset, now)
            }
        }
    }

    pub(super) fn store(&mut self, address: u32, size: u32, value: u32) -> Access {
        let (offset, now) = (address & 0x3FF, self.now);
        match address & !0x3FF {
            0x4000_0000 => {
                self.tim2.advance(now);
                self.tim2.write(offset, value, now)
            }
            0x4000_0C00 => {
                self.tim5.advance(now);
                self.tim5.write(offset, value, now)
            }
            0x4000_3000 => self.iwdg.write(offset, value, now),
            0x4000_7000 => self.rcc.write_power(offset, value),
            0x4001_3800 => self.pins.write_routing(offset, value),
            0x4001_3C00 => self.pins.write_exti(offset, value),
            0x4002_0000..=0x4002_2000 => {
                let gpio = (address - 0x4002_0000) / 0x400;
                let access = self.pins.write(gpio as usize, offset, value);
                self.show_driver();
                self.show_handshake();
                access
            }
            0x4002_3800 => {
                let access = self.rcc.write(offset, value, now);
                for (port, wiring) in WIRING.iter().enumerate() {
                    if (offset, value >> wiring.reset.1 & 1) == (wiring.reset.0, 1) {
                        self.usarts[port].reset(self.time());
                    }
                }
                self.set_clocks();
                access
            }
            0x4002_3C00 => self.rcc.write_flash(offset, value),
            0xE000_E000..=0xE000_EFFF => {
                let offset = address - 0xE000_E000;
                if self.nvic.write_priorities(offset, size, value) {
                    return Access::Done;
                }
                match self.nvic.write(offset, value) {
                    Some(Asked::Nothing) => {
                        if self.nvic.mpu.changed {
                            self.stop_at = 0;
                        }
                        Access::Done
                    }
                    Some(Asked::Reset) => {
                        self.reset = Some(Cause::Software);
                        Access::Done
                    }
                    None => Access::Unknown,
                }
            }
            0xE004_2000 => match offset {
                0x04..=0x0C => {
                    self.dbgmcu[offset as usize / 4 - 1] = value;
                    Access::Done
                }
                _ => Access::Unknown,
            },
            page => match WIRING.iter().position(|wiring| wiring.usart == page) {
                Some(port) => self.store_usart(port, offset, value),
                None => Access::Unknown,
            },
        }
    }

    fn store_usart(&mut self, port: usize, offset: u32, value: u32) -> Access {
        self.advance(port);
        let now = self.time();
        let usart = &mut self.usarts[port];
        let before = (usart.line(), usart.listens());
        let access = usart.write(offset, value, now);
        let after = (usart.line(), usart.listens());
        if before.0 != after.0
            && let Some(line) = after.0
        {
            self.outputs.push(Output::Line(port, line));
        }
        if before.1 != after.1 {
            self.outputs.push(Output::Listen(port, after.1));
        }
        if before != after {
            self.stop_at = 0;
        }
        self.advance(port);
        // It has something to do, and has to be looked at again then.
        self.stop_at = self.stop_at.min(self.tick_of(self.usarts[port].due(now)));
        access
    }
}
