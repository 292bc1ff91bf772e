//! Clocks, and what is reset when: RCC, PWR and FLASH (RM0090 7.3, 5.4, 3.9).

use super::{Access, Cause, HSE_HZ, TICKS_HZ};

/// After these the oscillators are ready (DS, HSE oscillator and PLL characteristics): 2 ms and 0.2 ms.
const HSE_START: u64 = TICKS_HZ / 500;
const PLL_LOCK: u64 = TICKS_HZ / 5_000;

const HSI_HZ: u64 = 16_000_000;

/// Bits of CR.
const HSION: u32 = 1 << 0;
const HSIRDY: u32 = 1 << 1;
const HSEON: u32 = 1 << 16;
const HSERDY: u32 = 1 << 17;
const PLLON: u32 = 1 << 24;
const PLLRDY: u32 = 1 << 25;

/// Bits of CSR.
const LSION: u32 = 1 << 0;
const LSIRDY: u32 = 1 << 1;
const RMVF: u32 = 1 << 24;
const BORRSTF: u32 = 1 << 25;
const PINRSTF: u32 = 1 << 26;
const PORRSTF: u32 = 1 << 27;
const SFTRSTF: u32 = 1 << 28;
const IWDGRSTF: u32 = 1 << 29;

/// Offsets of registers that only hold what is written: resets, low power, the backup domain and the spread spectrum.
const PLAIN: [u32; 14] = [
    0x0C, 0x10, 0x14, 0x18, 0x20, 0x24, 0x50, 0x54, 0x58, 0x60, 0x64, 0x70, 0x80, 0x84,
];
/// Offsets of the registers that switch peripherals' clocks on.
const ENABLES: [u32; 5] = [0x30, 0x34, 0x38, 0x40, 0x44];

/// RCC, with the flash interface's and the regulator's part in the clocks.
pub(super) struct Rcc {
    cr: u32,
    pllcfgr: u32,
    cfgr: u32,
    csr: u32,
    plain: [u32; PLAIN.len()],
    enables: [u32; ENABLES.len()],
    hse_ready: u64,
    pll_ready: u64,
    /// The crystal does not swing.
    pub hse_fails: bool,
    pwr_cr: u32,
    acr: u32,
}

impl Rcc {
    /// After a reset by `cause`; the one before tells what flags have not been cleared since.
    pub fn new(cause: Cause, before: Option<&Rcc>) -> Self {
        let flag = match cause {
            Cause::Power => PORRSTF | BORRSTF,
            Cause::BrownOut => BORRSTF,
            Cause::Pin => 0,
            Cause::Software => SFTRSTF,
            Cause::Watchdog => IWDGRSTF,
        };
        let kept = match cause {
            Cause::Power => 0,
            _ => before.map_or(0, |before| before.csr & !(LSION | LSIRDY)),
        };
        Rcc {
            // With the value that the trimming has at reset.
            cr: HSION | HSIRDY | 16 << 3,
            pllcfgr: 0x2400_3010,
            cfgr: 0,
            // Every reset pulls the pin low too (RM0090 7.1.1).
            csr: kept | flag | PINRSTF,
            plain: [0; PLAIN.len()],
            // RM0090 7.3.10: the core's own RAM.
            enables: [0x0010_0000, 0, 0, 0, 0],
            hse_ready: u64::MAX,
            pll_ready: u64::MAX,
            hse_fails: before.is_some_and(|before| before.hse_fails),
            // VOS: scale 1.
            pwr_cr: 0x4000,
            acr: 0,
        }
    }

    fn is_ready(&self, source: u32, now: u64) -> bool {
        match source {
            0 => self.cr & HSIRDY != 0,
            1 => now >= self.hse_ready,
            _ => now >= self.pll_ready,
        }
    }

    /// What the PLL makes for the system, in Hz.
    fn pll_hz(&self) -> u64 {
        let field = |from: u32, bits: u32| u64::from(self.pllcfgr >> from & ((1 << bits) - 1));
        let input = if self.pllcfgr >> 22 & 1 != 0 {
            HSE_HZ
        } else {
            HSI_HZ
        };
        let (m, n, p) = (field(0, 6).max(1), field(6, 9), 2 * (field(16, 2) + 1));
        input * n / m / p
    }

    /// The core's clock, in Hz.
    pub fn core_hz(&self) -> u64 {
        let system = match self.cfgr >> 2 & 3 {
            0 => HSI_HZ,
            1 => HSE_HZ,
            _ => self.pll_hz(),
        };
        let hpre = self.cfgr >> 4 & 0xF;
        system >> [0, 1, 2, 3, 4, 6, 7, 8, 9][(hpre.saturating_sub(7)) as usize]
    }

    fn prescaler(&self, from: u32) -> u32 {
        (self.cfgr >> from & 7).saturating_sub(3)
    }

    /// The clock of APB1, in Hz.
    pub fn apb1_hz(&self) -> u64 {
        self.core_hz() >> self.prescaler(10)
    }

    /// The clock of APB2, in Hz.
    pub fn apb2_hz(&self) -> u64 {
        self.core_hz() >> self.prescaler(13)
    }

    /// The clock of the timers on APB1, in Hz: twice that of the bus unless it is the core's (RM0090 7.2).
    pub fn timers_hz(&self) -> u64 {
        let double = u64::from(self.prescaler(10) > 0);
        self.apb1_hz() << double
    }

    /// Whether the clock of a peripheral is on: the bit of the register at `offset`.
    pub fn is_on(&self, offset: u32, bit: u8) -> bool {
        let place = ENABLES.iter().position(|known| *known == offset);
        place.is_some_and(|place| self.enables[place] >> bit & 1 != 0)
    }

    /// What would not work on the chip: clocks that are too fast, or faster than flash or the regulator can follow (DS, general operating
    /// conditions; RM0090 3.5.1, 5.4.1).
    pub fn check(&self) -> Result<(), String> {
        let core = self.core_hz();
        let waits = u64::from(self.acr & 0xF);
        let limits = [
            ("the core", core, 168_000_000),
            ("APB1", self.apb1_hz(), 42_000_000),
            ("APB2", self.apb2_hz(), 84_000_000),
            ("flash with its wait states", core, 30_000_000 * (waits + 1)),
        ];
        for (what, hz, most) in limits {
            if hz > most {
                return Err(format!(
                    "{what} is clocked with {hz} Hz, at most {most} it may"
                ));
            }
        }
        if core > 144_000_000 && self.pwr_cr & 0x4000 == 0 {
            return Err(format!("{core} Hz need the regulator's scale 1 (VOS)"));
        }
        if !TICKS_HZ.is_multiple_of(core) || !TICKS_HZ.is_multiple_of(self.apb1_hz()) {
            return Err(format!("a core clock of {core} Hz is not modelled"));
        }
        Ok(())
    }

    /// Reads a register of RCC.
    pub fn read(&self, offset: u32, now: u64) -> Option<u32> {
        if let Some(place) = PLAIN.iter().position(|known| *known == offset) {
            return Some(self.plain[place]);
        }
        if let Some(place) = ENABLES.iter().position(|known| *known == offset) {
            return Some(self.enables[place]);
        }
        Some(match offset {
            0x00 => {
                let ready = |at: u64, flag: u32| if now >= at { flag } else { 0 };
                self.cr | ready(self.hse_ready, HSERDY) | ready(self.pll_ready, PLLRDY)
            }
            0x04 => self.pllcfgr,
            0x08 => self.cfgr,
            0x74 => self.csr | (self.csr & LSION) << 1,
            // Other chips of the family have a register there (RM0090 6.3.27); in this one it is reserved.
            0x8C => 0,
            _ => return None,
        })
    }

    /// Writes a register of RCC.
    pub fn write(&mut self, offset: u32, value: u32, now: u64) -> Access {
        if let Some(place) = PLAIN.iter().position(|known| *known == offset) {
            self.plain[place] = value;
            return Access::Done;
        }
        if let Some(place) = ENABLES.iter().position(|known| *known == offset) {
            self.enables[place] = value;
            return Access::Done;
        }
        match offset {
            0x00 => {
                let risen = value & !self.cr;
                if risen & HSEON != 0 && !self.hse_fails {
                    self.hse_ready = now + HSE_START;
                }
                if risen & PLLON != 0 {
                    self.pll_ready = now + PLL_LOCK;
                }
                if value & HSEON == 0 {
                    self.hse_ready = u64::MAX;
                }
                if value & PLLON == 0 {
                    self.pll_ready = u64::MAX;
                }
                self.cr = value & !(HSIRDY | HSERDY | PLLRDY) | (value & HSION) << 1;
            }
            0x04 if self.cr & PLLON != 0 && value != self.pllcfgr => {
                return Access::wrong("PLLCFGR is changed while the PLL is on");
            }
            0x04 => self.pllcfgr = value,
            0x08 => {
                let source = value & 3;
                if !self.is_ready(source, now) {
                    return Access::wrong("SW selects a clock that is not ready");
                }
                self.cfgr = value & !0xC | source << 2;
                if let Err(wrong) = self.check() {
                    return Access::Wrong(wrong);
                }
            }
            0x74 => {
                self.csr = self.csr & !LSION | value & LSION;
                if value & RMVF != 0 {
                    self.csr &= LSION;
                }
            }
            0x8C => {}
            _ => return Access::Unknown,
        }
        Access::Done
    }

    /// PWR: CR and CSR, with VOSRDY.
    pub fn read_power(&self, offset: u32) -> Option<u32> {
        match offset {
            0x00 => Some(self.pwr_cr),
            0x04 => Some(0x4000),
            _ => None,
        }
    }

    /// Writes a register of PWR.
    pub fn write_power(&mut self, offset: u32, value: u32) -> Access {
        match offset {
            0x00 => self.pwr_cr = value,
            0x04 => {}
            _ => return Access::Unknown,
        }
        Access::Done
    }

    /// FLASH: ACR, and the rest as it is while nothing is programmed.
    pub fn read_flash(&self, offset: u32) -> Option<u32> {
        match offset {
            0x00 => Some(self.acr),
            0x0C => Some(0),
            // LOCK.
            0x10 => Some(0x8000_0000),
            // As it is delivered: no protection, brown-out reset off.
            0x14 => Some(0x0FFF_AAED),
            _ => None,
        }
    }

    /// Writes a register of FLASH.
    pub fn write_flash(&mut self, offset: u32, value: u32) -> Access {
        if offset != 0 {
            return Access::Unknown;
        }
        self.acr = value;
        match self.check() {
            Ok(()) => Access::Done,
            Err(wrong) => Access::Wrong(wrong),
        }
    }
}
