//! The watchdog and MCUSR, the reset flags (DS40002061B, 11.8, 11.9).
//!
//! The oscillator has exactly 128 kHz here; on silicon it has that at 5 V and 25 degrees and drifts (29-12, 30.9). Where the
//! data sheet is silent: a prescaler that is changed under way taps the same counter, so that a time-out comes when the counter
//! next reaches a multiple of the new time.

/// Counts of the oscillator in the shortest time-out (table 11-2), and in a second.
const SHORTEST: u64 = 2048;
const OSCILLATOR_HZ: u64 = 128_000;

// WDTCSR, 11.9.2
const WDIF: u8 = 1 << 7;
const WDIE: u8 = 1 << 6;
const WDP3: u8 = 1 << 5;
const WDCE: u8 = 1 << 4;
const WDE: u8 = 1 << 3;
const WDP: u8 = WDP3 | 0b111;

/// The flag of a watchdog reset in MCUSR, 11.9.1.
pub(crate) const WDRF: u8 = 1 << 3;

/// Cycles within which WDCE allows a change (11.8.2).
const WINDOW: u64 = 4;
/// The vector of its interrupt (12.1).
const VECTOR: u8 = 6;

#[derive(Debug)]
pub(crate) struct Watchdog {
    hz: u64,
    wdtcsr: u8,
    mcusr: u8,
    /// Until when a change is allowed.
    window: u64,
    /// When the counter was 0, and up to when time-outs have been seen.
    since: u64,
    seen: u64,
    bites: bool,
}

impl Watchdog {
    pub fn new(hz: u32) -> Self {
        Watchdog {
            hz: hz.into(),
            wdtcsr: 0,
            mcusr: 0,
            window: 0,
            since: 0,
            seen: 0,
            bites: false,
        }
    }

    /// A reset at `at`, which leaves these flags (11.9.1). A watchdog reset leaves it running at the shortest time (11.9.2, WDE).
    pub fn reset(&mut self, at: u64, mcusr: u8) {
        *self = Watchdog {
            mcusr,
            wdtcsr: if mcusr & WDRF != 0 { WDE } else { 0 },
            since: at,
            seen: at,
            ..Watchdog::new(self.hz as u32)
        };
    }

    pub fn mcusr(&self) -> u8 {
        self.mcusr
    }

    /// Executes `wdr` (11.8.1).
    pub fn restart(&mut self, at: u64) {
        self.sync(at);
        self.since = at;
        self.seen = at;
    }

    /// The cycles of a time-out.
    fn time(&self) -> u64 {
        let wdp = (self.wdtcsr & 0b111) | (self.wdtcsr & WDP3) >> 2;
        // Ten and more are reserved (table 11-2).
        (SHORTEST << wdp.min(9)) * self.hz / OSCILLATOR_HZ
    }

    fn runs(&self) -> bool {
        self.wdtcsr & (WDE | WDIE) != 0
    }

    /// When it next times out.
    pub fn next_event(&self) -> u64 {
        if !self.runs() || self.bites {
            return u64::MAX;
        }
        let time = self.time();
        self.since + ((self.seen - self.since) / time + 1) * time
    }

    pub fn sync(&mut self, t: u64) {
        while self.next_event() <= t {
            self.seen = self.next_event();
            let interrupts = self.wdtcsr & (WDIE | WDIF) == WDIE;
            if interrupts {
                self.wdtcsr |= WDIF;
            } else if self.wdtcsr & WDE != 0 {
                // Also where the interrupt of the time-out before was not executed (11.9.2, WDIE).
                self.bites = true;
            }
        }
        self.seen = self.seen.max(t);
    }

    /// Whether it resets the chip.
    pub fn bites(&self) -> bool {
        self.bites
    }

    pub fn vector(&self) -> Option<u8> {
        (self.wdtcsr & (WDIE | WDIF) == WDIE | WDIF).then_some(VECTOR)
    }

    /// The vector is executed: the flag is cleared, and with WDE the interrupt's enable bit (11.9.2, WDIE).
    pub fn acknowledge(&mut self, vector: u8) {
        if vector == VECTOR {
            self.wdtcsr &= !WDIF;
            if self.wdtcsr & WDE != 0 {
                self.wdtcsr &= !WDIE;
            }
        }
    }

    pub fn read(&mut self, address: u16, at: u64) -> u8 {
        self.sync(at);
        match address {
            0x54 => self.mcusr,
            _ => self.wdtcsr | if at < self.window { WDCE } else { 0 },
        }
    }

    pub fn write(&mut self, address: u16, value: u8, at: u64) {
        self.sync(at);
        if address == 0x54 {
            // A flag is cleared by a 0.
            self.mcusr &= value;
            return;
        }
        let mut kept = self.wdtcsr & !(WDIE | WDIF & value);
        kept |= value & WDIE;
        let is_allowed = at <= self.window;
        if value & WDCE != 0 && value & WDE != 0 {
            self.window = at + WINDOW;
            kept |= WDE;
        } else if is_allowed {
            self.window = 0;
            kept = kept & !(WDE | WDP) | value & (WDE | WDP);
        } else {
            kept |= value & WDE;
        }
        // 11.9.2, WDE: WDRF overrides it.
        if self.mcusr & WDRF != 0 {
            kept |= WDE;
        }
        if !self.runs() && kept & (WDE | WDIE) != 0 {
            self.since = at;
            self.seen = at;
        }
        self.wdtcsr = kept;
    }
}
