//! The independent watchdog (RM0090 21.4). Its clock is an oscillator of 17 to 47 kHz, 32 nominally (DS, LSI oscillator characteristics).

use super::{Access, TICKS_HZ};

const LSI_HZ: u64 = 32_000;

/// The independent watchdog.
#[derive(Clone, Debug)]
pub(super) struct Iwdg {
    /// Ticks of LSI.
    lsi: u64,
    pr: u32,
    rlr: u32,
    unlocked: bool,
    /// When it resets the chip; `None` while it is off.
    due: Option<u64>,
}

impl Iwdg {
    /// A watchdog that is off.
    pub fn new() -> Self {
        Iwdg {
            lsi: TICKS_HZ / LSI_HZ,
            pr: 0,
            rlr: 0xFFF,
            unlocked: false,
            due: None,
        }
    }

    /// Sets the frequency of LSI in Hz from now on.
    pub fn set_lsi(&mut self, hz: u32) {
        self.lsi = TICKS_HZ / u64::from(hz);
    }

    /// As after a reset: LSI stays what it is.
    pub fn reset(&mut self) {
        let lsi = self.lsi;
        *self = Iwdg { lsi, ..Self::new() };
    }

    /// How long it waits: the reload value and one, each 4 to 256 periods of LSI (RM0090 21.3, table of timeouts).
    fn timeout(&self) -> u64 {
        let divider = 4_u64 << self.pr.min(6);
        u64::from(self.rlr + 1) * divider * self.lsi
    }

    /// When it resets the chip.
    pub fn due(&self) -> u64 {
        self.due.unwrap_or(u64::MAX)
    }

    /// A register. What is written takes effect at once: SR is 0.
    pub fn read(&self, offset: u32) -> Option<u32> {
        match offset {
            0x00 | 0x0C => Some(0),
            0x04 => Some(self.pr),
            0x08 => Some(self.rlr),
            _ => None,
        }
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, now: u64) -> Access {
        match (offset, value) {
            (0x00, 0x5555) => self.unlocked = true,
            (0x00, 0xAAAA) => {
                self.unlocked = false;
                self.due = self.due.map(|_| now + self.timeout());
            }
            (0x00, 0xCCCC) => {
                self.unlocked = false;
                self.due = Some(now + self.timeout());
            }
            (0x00, _) => self.unlocked = false,
            (0x04 | 0x08, _) if !self.unlocked => {
                return Access::wrong("PR and RLR of the watchdog are locked");
            }
            (0x04, _) => self.pr = value & 7,
            (0x08, _) => self.rlr = value & 0xFFF,
            _ => return Access::Unknown,
        }
        Access::Done
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_timeouts_are_those_of_the_manual() {
        // RM0090, table 107: at 32 kHz 0.125 ms to 512 ms with a divider of 4, 8 ms to 32768 ms with 256.
        for (pr, rlr, us) in [
            (0, 0, 125),
            (0, 0xFFF, 512_000),
            (6, 0, 8_000),
            (6, 0xFFF, 32_768_000),
            (7, 0xFFF, 32_768_000),
        ] {
            let mut watchdog = Iwdg::new();
            for (offset, value) in [(0, 0x5555), (4, pr), (8, rlr), (0, 0xCCCC)] {
                assert_eq!(watchdog.write(offset, value, 7), Access::Done);
            }
            assert_eq!(watchdog.due(), 7 + us * (TICKS_HZ / 1_000_000));
        }
    }

    #[test]
    fn it_is_fed_once_it_is_on_and_locked_until_it_is_unlocked() {
        let mut watchdog = Iwdg::new();
        assert_ne!(watchdog.write(8, 5, 0), Access::Done);
        watchdog.write(0, 0xAAAA, 5);
        assert_eq!(watchdog.due(), u64::MAX);
        watchdog.write(0, 0xCCCC, 0);
        let first = watchdog.due();
        watchdog.write(0, 0xAAAA, 1000);
        assert_eq!(watchdog.due(), first + 1000);
        watchdog.set_lsi(47_000);
        watchdog.write(0, 0xAAAA, 0);
        assert!(watchdog.due() < first);
    }
}
