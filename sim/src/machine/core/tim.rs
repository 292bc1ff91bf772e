//! TIM2 and TIM5: counters that count up, with four compare channels (RM0090 18.4).

use super::Access;

/// Bits of CR1.
const CEN: u32 = 1 << 0;
const UDIS: u32 = 1 << 1;
const URS: u32 = 1 << 2;
/// Bits of CR1 that are modelled: those, and ARPE, which changes nothing for a counter whose period stays.
const CR1: u32 = CEN | UDIS | URS | 1 << 7;

/// UIF and CC1IF to CC4IF.
const FLAGS: u32 = 0x1F;
/// Update generation (UG).
const UG: u32 = 1 << 0;

/// A timer of 32 bits.
#[derive(Clone, Debug)]
pub(super) struct Timer {
    cr1: u32,
    dier: u32,
    sr: u32,
    ccmr: [u32; 2],
    ccer: u32,
    /// What was written, and what is in use.
    psc: (u32, u32),
    arr: u32,
    ccr: [u32; 4],
    /// Ticks of its clock.
    clock: u64,
    /// The count at `since`, and how many counts since then have been looked at.
    base: u32,
    since: u64,
    seen: u64,
    /// What it counts from when it is switched on.
    begins_at: u32,
}

impl Timer {
    /// A timer after a reset, with a clock of this tick rate; when it is switched on it counts from `begins_at`.
    pub fn new(clock: u64, begins_at: u32) -> Self {
        Timer {
            cr1: 0,
            dier: 0,
            sr: 0,
            ccmr: [0; 2],
            ccer: 0,
            psc: (0, 0),
            arr: u32::MAX,
            ccr: [0; 4],
            clock,
            base: 0,
            since: 0,
            seen: 0,
            begins_at,
        }
    }

    fn period(&self) -> u64 {
        u64::from(self.arr) + 1
    }

    /// Ticks of a count.
    fn count_ticks(&self) -> u64 {
        self.clock * u64::from(self.psc.1 + 1)
    }

    /// Counts from `since` until `now`.
    fn counted(&self, now: u64) -> u64 {
        if self.cr1 & CEN == 0 {
            return 0;
        }
        now.saturating_sub(self.since) / self.count_ticks()
    }

    /// The value of the counter.
    pub fn count(&self, now: u64) -> u32 {
        ((u64::from(self.base) + self.counted(now)) % self.period()) as u32
    }

    /// It counts from `base` on.
    fn restart(&mut self, base: u32, now: u64) {
        self.base = base;
        self.since = now;
        self.seen = 0;
    }

    /// The first count after those that were looked at, at which the counter becomes `value`.
    fn next_at(&self, value: u32) -> u64 {
        let period = self.period();
        let first = (u64::from(self.base) + self.seen + 1) % period;
        self.seen + 1 + (u64::from(value) + period - first) % period
    }

    /// The flag of each event and the count at which it comes next; that of a compare value that is never reached does not come.
    fn events(&self) -> impl Iterator<Item = (u32, u64)> + '_ {
        let update = (self.cr1 & UDIS == 0).then(|| (1, self.next_at(0)));
        let matches = self.ccr.iter().enumerate();
        let matches = matches.filter(|(_, value)| **value <= self.arr);
        let matches = matches.map(|(channel, value)| (2 << channel, self.next_at(*value)));
        update.into_iter().chain(matches)
    }

    /// Sets the flags of what has come until `now`.
    pub fn advance(&mut self, now: u64) {
        let counted = self.counted(now);
        if counted == self.seen {
            return;
        }
        let come = self.events().filter(|(_, count)| *count <= counted);
        let flags = come.fold(0, |flags, (flag, _)| flags | flag);
        self.sr |= flags;
        self.seen = counted;
    }

    /// When the next of its interrupts comes; [`advance`](Self::advance) was called.
    pub fn next(&self) -> u64 {
        if self.cr1 & CEN == 0 {
            return u64::MAX;
        }
        let waited = self.dier & !self.sr;
        let next = self.events().filter(|(flag, _)| waited & flag != 0);
        let next = next.map(|(_, count)| self.since + count * self.count_ticks());
        next.min().unwrap_or(u64::MAX)
    }

    /// Its interrupt line.
    pub fn interrupt(&self) -> bool {
        self.sr & self.dier & FLAGS != 0
    }

    /// The clock is another one from now on.
    pub fn set_clock(&mut self, clock: u64, now: u64) {
        self.advance(now);
        let count = self.count(now);
        self.clock = clock;
        self.restart(count, now);
    }

    /// A register; [`advance`](Self::advance) was called.
    pub fn read(&self, offset: u32, now: u64) -> Option<u32> {
        Some(match offset {
            0x00 => self.cr1,
            0x04 | 0x08 => 0,
            0x0C => self.dier,
            0x10 => self.sr,
            0x18 | 0x1C => self.ccmr[(offset as usize - 0x18) / 4],
            0x20 => self.ccer,
            0x24 => self.count(now),
            0x28 => self.psc.0,
            0x2C => self.arr,
            0x34..=0x40 => self.ccr[(offset as usize - 0x34) / 4],
            _ => return None,
        })
    }

    /// A register; [`advance`](Self::advance) was called.
    pub fn write(&mut self, offset: u32, value: u32, now: u64) -> Access {
        match offset {
            0x00 => {
                if value & !CR1 != 0 {
                    return Access::wrong("a mode of the counter that is not modelled");
                }
                let count = self.count(now);
                let begins = value & CEN != 0 && self.cr1 & CEN == 0;
                self.cr1 = value;
                if begins {
                    self.restart(count.wrapping_add(self.begins_at), now);
                } else if value & CEN == 0 {
                    self.restart(count, now);
                }
            }
            0x04 | 0x08 if value == 0 => {}
            0x0C => self.dier = value,
            // Flags are cleared by zeros (RM0090 18.4.5).
            0x10 => self.sr &= value,
            0x14 => {
                self.sr |= value & FLAGS & !UG;
                if value & UG != 0 {
                    self.psc.1 = self.psc.0;
                    self.restart(0, now);
                    if self.cr1 & (URS | UDIS) == 0 {
                        self.sr |= UG;
                    }
                }
            }
            // Compare channels, frozen: a match sets the flag and nothing else (RM0090 18.4.7).
            0x18 | 0x1C if value == 0 => self.ccmr[(offset as usize - 0x18) / 4] = value,
            0x20 if value == 0 => self.ccer = value,
            0x24 => self.restart(value, now),
            0x28 => self.psc.0 = value & 0xFFFF,
            0x2C => {
                let count = self.count(now);
                self.arr = value;
                self.restart(count, now);
            }
            0x34..=0x40 => self.ccr[(offset as usize - 0x34) / 4] = value,
            _ => return Access::Unknown,
        }
        Access::Done
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Counts once in 8 ticks: the prescaler takes effect with an update, which is no event here.
    fn timer(arr: u32, begins_at: u32) -> Timer {
        let mut timer = Timer::new(4, begins_at);
        for (offset, value) in [(0x28, 1), (0x2C, arr), (0x14, UG), (0x10, 0), (0x00, CEN)] {
            assert_eq!(timer.write(offset, value, 1000), Access::Done);
        }
        timer
    }

    #[test]
    fn a_match_sets_its_flag_at_the_count_and_not_before() {
        let mut timer = timer(u32::MAX, 0);
        timer.write(0x38, 100, 1000);
        timer.write(0x0C, 4, 1000);
        assert_eq!(timer.next(), 1000 + 800);
        timer.advance(1799);
        assert_eq!(
            (timer.read(0x10, 1799), timer.interrupt()),
            (Some(0), false)
        );
        timer.advance(1800);
        assert_eq!(timer.count(1800), 100);
        assert!(timer.interrupt());
        timer.write(0x10, !4, 1800);
        assert!(!timer.interrupt());
        // A whole round later.
        assert_eq!(timer.next(), 1000 + 8 * (100 + (1 << 32)));
    }

    #[test]
    fn a_value_that_has_passed_is_missed_until_the_next_round() {
        let mut timer = timer(999, 0);
        timer.advance(1000 + 8 * 500);
        timer.write(0x34, 500, 1000 + 8 * 500);
        timer.write(0x0C, 2, 1000 + 8 * 500);
        assert_eq!(timer.next(), 1000 + 8 * 1500);
        timer.write(0x14, 2, 1000 + 8 * 500);
        assert!(timer.interrupt());
    }

    #[test]
    fn the_counter_wraps_with_an_update_and_matches_behind_it() {
        let mut timer = timer(u32::MAX, u32::MAX - 9);
        timer.write(0x34, 5, 1000);
        // The other channels match a compare value of 0 with the update (RM0090 18.4.5, CC1IF), whether they are used or not.
        for channel in [0x38, 0x3C, 0x40] {
            timer.write(channel, 100, 1000);
        }
        timer.write(0x0C, 2, 1000);
        assert_eq!(timer.next(), 1000 + 8 * 15);
        timer.advance(1000 + 8 * 10);
        assert_eq!(timer.read(0x10, 0), Some(1));
        assert_eq!(timer.count(1000 + 8 * 10), 0);
        timer.advance(1000 + 8 * 15);
        assert_eq!(timer.read(0x10, 0), Some(3));
    }

    #[test]
    fn a_period_of_sixteen_bits_has_its_half_and_its_end() {
        let mut timer = timer(0xFFFF, 0);
        timer.write(0x34, 0x8000, 1000);
        timer.write(0x0C, 3, 1000);
        assert_eq!(timer.next(), 1000 + 8 * 0x8000);
        timer.advance(timer.next());
        assert_eq!(timer.next(), 1000 + 8 * 0x1_0000);
    }
}
