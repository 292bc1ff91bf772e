//! Pins: GPIOA to GPIOI, SYSCFG's routing, and EXTI (RM0090 8.4, 9.2, 12.3).

use super::Access;

/// Ports that are there: A to E and H in the package with 64 pins have pins, all have registers.
pub(super) const GPIOS: usize = 9;

/// The modes of a pin (RM0090 8.4.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mode {
    Input,
    Output,
    Alternate,
    Analog,
}

/// A pin: port 0 is A.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pin {
    pub gpio: u8,
    pub number: u8,
}

/// A pin by its name.
pub(super) const fn pin(gpio: char, number: u8) -> Pin {
    Pin {
        gpio: gpio as u8 - b'A',
        number,
    }
}

#[derive(Clone, Default)]
struct Gpio {
    moder: u32,
    otyper: u32,
    ospeedr: u32,
    pupdr: u32,
    odr: u16,
    lckr: u32,
    afr: [u32; 2],
    /// Levels that pins are driven to from outside.
    outside: [Option<bool>; 16],
}

/// All pins of the chip.
pub(super) struct Pins {
    gpios: [Gpio; GPIOS],
    exticr: [u32; 4],
    syscfg: [u32; 2],
    imr: u32,
    emr: u32,
    rtsr: u32,
    ftsr: u32,
    pr: u32,
}

impl Pins {
    /// As after a reset; what is outside stays.
    pub fn new(before: Option<&Pins>) -> Self {
        let mut gpios: [Gpio; GPIOS] = Default::default();
        // SWD and JTAG (RM0090 8.4.1, 8.4.3, 8.4.4).
        (gpios[0].moder, gpios[0].ospeedr, gpios[0].pupdr) =
            (0xA800_0000, 0x0C00_0000, 0x6400_0000);
        (gpios[1].moder, gpios[1].ospeedr, gpios[1].pupdr) =
            (0x0000_0280, 0x0000_00C0, 0x0000_0100);
        if let Some(before) = before {
            for (gpio, before) in gpios.iter_mut().zip(&before.gpios) {
                gpio.outside = before.outside;
            }
        }
        Pins {
            gpios,
            exticr: [0; 4],
            syscfg: [0; 2],
            imr: 0,
            emr: 0,
            rtsr: 0,
            ftsr: 0,
            pr: 0,
        }
    }

    fn gpio(&self, pin: Pin) -> &Gpio {
        &self.gpios[usize::from(pin.gpio)]
    }

    /// The mode of a pin.
    pub fn mode(&self, pin: Pin) -> Mode {
        match self.gpio(pin).moder >> (2 * pin.number) & 3 {
            0 => Mode::Input,
            1 => Mode::Output,
            2 => Mode::Alternate,
            _ => Mode::Analog,
        }
    }

    /// Whether a pin is connected to this alternate function.
    pub fn is_function(&self, pin: Pin, function: u8) -> bool {
        let afr = self.gpio(pin).afr[usize::from(pin.number / 8)];
        self.mode(pin) == Mode::Alternate && afr >> (4 * (pin.number % 8)) & 0xF == function.into()
    }

    /// What the pin's output register says, if it is an output.
    pub fn output(&self, pin: Pin) -> Option<bool> {
        let level = self.gpio(pin).odr >> pin.number & 1 != 0;
        (self.mode(pin) == Mode::Output).then_some(level)
    }

    /// Whether the chip pulls the pin up.
    pub fn is_pulled_up(&self, pin: Pin) -> bool {
        self.gpio(pin).pupdr >> (2 * pin.number) & 3 == 1
    }

    /// The level of a pin that no peripheral drives.
    pub fn level(&self, pin: Pin) -> bool {
        let outside = self.gpio(pin).outside[usize::from(pin.number)];
        let level = self.output(pin).or(outside);
        level.unwrap_or_else(|| self.is_pulled_up(pin))
    }

    /// Drives a pin from outside, or lets go of it. EXTI sees the edge (RM0090 12.2.5).
    pub fn drive(&mut self, pin: Pin, level: Option<bool>) {
        let before = self.level(pin);
        self.gpios[usize::from(pin.gpio)].outside[usize::from(pin.number)] = level;
        let after = self.level(pin);
        // The input is off in analog mode (RM0090 8.3.12).
        if before == after || self.mode(pin) == Mode::Analog {
            return;
        }
        let line = u32::from(pin.number);
        let routed = self.exticr[usize::from(pin.number / 4)] >> (pin.number % 4 * 4) & 0xF;
        let selected = if after { self.rtsr } else { self.ftsr };
        // The mask is taken to be in front of the pending bit too: what the manual promises and no more.
        if routed == pin.gpio.into() && (selected & (self.imr | self.emr)) >> line & 1 != 0 {
            self.pr |= 1 << line;
        }
    }

    /// Whether the interrupt of these lines of EXTI is asked for.
    pub fn interrupts(&self, lines: u32) -> bool {
        self.pr & self.imr & lines != 0
    }

    /// A port's register.
    pub fn read(&self, gpio: usize, offset: u32) -> Option<u32> {
        let registers = self.gpios.get(gpio)?;
        Some(match offset {
            0x00 => registers.moder,
            0x04 => registers.otyper,
            0x08 => registers.ospeedr,
            0x0C => registers.pupdr,
            0x10 => (0..16).fold(0, |levels, number| {
                let pin = Pin {
                    gpio: gpio as u8,
                    number,
                };
                levels | u32::from(self.level(pin)) << number
            }),
            0x14 => registers.odr.into(),
            0x1C => registers.lckr,
            0x20 => registers.afr[0],
            0x24 => registers.afr[1],
            _ => return None,
        })
    }

    /// A port's register.
    pub fn write(&mut self, gpio: usize, offset: u32, value: u32) -> Access {
        let Some(registers) = self.gpios.get_mut(gpio) else {
            return Access::Unknown;
        };
        match offset {
            0x00 => registers.moder = value,
            0x04 => registers.otyper = value,
            0x08 => registers.ospeedr = value,
            0x0C => registers.pupdr = value,
            0x14 => registers.odr = value as u16,
            // Setting has priority (RM0090 8.4.7).
            0x18 => registers.odr = registers.odr & !((value >> 16) as u16) | value as u16,
            0x20 => registers.afr[0] = value,
            0x24 => registers.afr[1] = value,
            _ => return Access::Unknown,
        }
        Access::Done
    }

    /// Reads a register of SYSCFG.
    pub fn read_routing(&self, offset: u32) -> Option<u32> {
        Some(match offset {
            0x00 | 0x04 => self.syscfg[offset as usize / 4],
            0x08..=0x14 => self.exticr[(offset as usize - 8) / 4],
            0x20 => 0,
            _ => return None,
        })
    }

    /// Writes a register of SYSCFG.
    pub fn write_routing(&mut self, offset: u32, value: u32) -> Access {
        match offset {
            0x00 | 0x04 => self.syscfg[offset as usize / 4] = value,
            0x08..=0x14 => self.exticr[(offset as usize - 8) / 4] = value,
            _ => return Access::Unknown,
        }
        Access::Done
    }

    /// Reads a register of EXTI.
    pub fn read_exti(&self, offset: u32) -> Option<u32> {
        Some(match offset {
            0x00 => self.imr,
            0x04 => self.emr,
            0x08 => self.rtsr,
            0x0C => self.ftsr,
            0x10 => 0,
            0x14 => self.pr,
            _ => return None,
        })
    }

    /// Writes a register of EXTI.
    pub fn write_exti(&mut self, offset: u32, value: u32) -> Access {
        match offset {
            0x00 => self.imr = value,
            0x04 => self.emr = value,
            0x08 => self.rtsr = value,
            0x0C => self.ftsr = value,
            0x10 => self.pr |= value & self.imr,
            // Cleared by ones.
            0x14 => self.pr &= !value,
            _ => return Access::Unknown,
        }
        Access::Done
    }
}
