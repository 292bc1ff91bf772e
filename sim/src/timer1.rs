//! Timer/Counter1 as the data sheet describes it (ATmega328P, DS40002061B, chapter 16), in normal
//! mode with the prescaled system clock. Input capture, CTC, PWM and external clocks are not there.
//!
//! The counter is not stepped: its value follows from the prescaler, which runs free from reset
//! (17.1), and from when it was last looked at.

// TIFR1 and TIMSK1, 16.11.8 and 16.11.9
const TOV: u8 = 1 << 0;
const OCA: u8 = 1 << 1;
const OCB: u8 = 1 << 2;

#[derive(Debug, Default)]
pub(crate) struct Timer1 {
    tccra: u8,
    tccrb: u8,
    tcnt: u16,
    ocr: [u16; 2],
    icr: u16,
    temp: u8,
    timsk: u8,
    tifr: u8,
    /// `tcnt` is right for this time.
    synced: u64,
    /// A time at which the prescaler was zero.
    prescaler_zero: u64,
    /// The counter was written: no match with the value written (16.7.2).
    blocked: bool,
}

impl Timer1 {
    pub fn reset(&mut self, at: u64) {
        *self = Timer1 {
            synced: at,
            prescaler_zero: at,
            ..Timer1::default()
        };
    }

    /// Cycles of one timer clock, 16.11.2; `None` while stopped.
    fn prescaler(&self) -> Option<u64> {
        match self.tccrb & 7 {
            1 => Some(1),
            2 => Some(8),
            3 => Some(64),
            4 => Some(256),
            5 => Some(1024),
            _ => None,
        }
    }

    /// Timer clocks from now until the flag of compare value `ocr` is set: one after the counter
    /// reaches it (16.10, figures 16-10 and 16-11).
    fn clocks_to_match(&self, ocr: u16) -> u64 {
        match ocr.wrapping_sub(self.tcnt) {
            0 if self.blocked => 0x1_0001,
            distance => u64::from(distance) + 1,
        }
    }

    fn clocks_to(&self, flag: u8) -> u64 {
        match flag {
            TOV => 0x1_0000 - u64::from(self.tcnt),
            OCA => self.clocks_to_match(self.ocr[0]),
            _ => self.clocks_to_match(self.ocr[1]),
        }
    }

    /// Lets the counter run until `t`.
    pub fn sync(&mut self, t: u64) {
        if t <= self.synced {
            return;
        }
        if let Some(cycles) = self.prescaler() {
            let clocks =
                (t - self.prescaler_zero) / cycles - (self.synced - self.prescaler_zero) / cycles;
            for flag in [TOV, OCA, OCB] {
                if self.clocks_to(flag) <= clocks {
                    self.tifr |= flag;
                }
            }
            self.tcnt = self.tcnt.wrapping_add(clocks as u16);
            self.blocked &= clocks == 0;
        }
        self.synced = t;
    }

    /// When an enabled interrupt's flag is next set.
    pub fn next_event(&self) -> u64 {
        let Some(cycles) = self.prescaler() else {
            return u64::MAX;
        };
        let done = (self.synced - self.prescaler_zero) / cycles;
        [TOV, OCA, OCB]
            .into_iter()
            .filter(|flag| self.timsk & !self.tifr & flag != 0)
            .map(|flag| self.prescaler_zero + (done + self.clocks_to(flag)) * cycles)
            .min()
            .unwrap_or(u64::MAX)
    }

    pub fn read(&mut self, address: u16, at: u64) -> u8 {
        self.sync(at);
        match address {
            0x36 => self.tifr,
            0x6f => self.timsk,
            0x80 => self.tccra,
            0x81 => self.tccrb,
            // 16.3: reading the low byte takes the high byte along into TEMP. The compare
            // registers are read directly.
            0x84 => {
                self.temp = (self.tcnt >> 8) as u8;
                self.tcnt as u8
            }
            0x85 | 0x87 => self.temp,
            0x86 => {
                self.temp = (self.icr >> 8) as u8;
                self.icr as u8
            }
            0x88 => self.ocr[0] as u8,
            0x89 => (self.ocr[0] >> 8) as u8,
            0x8a => self.ocr[1] as u8,
            0x8b => (self.ocr[1] >> 8) as u8,
            _ => 0,
        }
    }

    pub fn write(&mut self, address: u16, value: u8, at: u64) {
        // A timer clock at the very edge of the write still sees the old values.
        self.sync(at);
        let word = u16::from(self.temp) << 8 | u16::from(value);
        match address {
            0x36 => self.tifr &= !value,
            // GTCCR.PSRSYNC, 17.4.1
            0x43 if value & 1 != 0 => self.prescaler_zero = at,
            0x6f => self.timsk = value & (TOV | OCA | OCB),
            0x80 => self.tccra = value,
            0x81 => self.tccrb = value,
            // 16.3: the high byte waits in TEMP for the low byte.
            0x85 | 0x87 | 0x89 | 0x8b => self.temp = value,
            0x84 => {
                self.tcnt = word;
                self.blocked = true;
            }
            0x86 => self.icr = word,
            0x88 => self.ocr[0] = word,
            0x8a => self.ocr[1] = word,
            _ => {}
        }
    }

    /// The lowest vector whose interrupt is asked for (12.1: 11 A, 12 B, 13 overflow).
    pub fn vector(&self) -> Option<u8> {
        let asked = self.tifr & self.timsk;
        if asked & OCA != 0 {
            Some(11)
        } else if asked & OCB != 0 {
            Some(12)
        } else if asked & TOV != 0 {
            Some(13)
        } else {
            None
        }
    }

    /// A vector is executed, which clears its flag.
    pub fn acknowledge(&mut self, vector: u8) {
        match vector {
            11 => self.tifr &= !OCA,
            12 => self.tifr &= !OCB,
            13 => self.tifr &= !TOV,
            _ => {}
        }
    }
}
