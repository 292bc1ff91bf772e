//! A USART (RM0090 30): its registers, flags and when they change. The bits are the bus's: a character is handed over when its
//! first stop bit has been judged, and sent as a whole.

use super::super::transmitter::Transmitter;
use super::super::{CTS, FE, NF, ORE, PE, RXNE, TC, TXE, line_of};
use super::Access;
use crate::host::RxByte;
use crate::line::{Line, Parity};
use crate::time::{Clock, Time};

/// Errors, which reading SR and then DR clears (RM0090 30.6.1).
const ERRORS: u32 = PE | FE | NF | ORE;

/// Bits of CR1 (RM0090 30.6.4). The interrupt enables stand where SR has their flags; PEIE is apart.
const RE: u32 = 1 << 2;
const TE: u32 = 1 << 3;
const PEIE: u32 = 1 << 8;
const PCE: u32 = 1 << 10;
const M: u32 = 1 << 12;
const UE: u32 = 1 << 13;
/// Bits of CR1 that are modelled: all but SBK, RWU, WAKE and IDLEIE.
const CR1: u32 = RE | TE | RXNE | TC | TXE | PEIE | 3 << 9 | M | UE | 1 << 15;
/// Of CR2: two stop bits and one.
const CR2: u32 = 1 << 13;

/// Bits of CR3 (RM0090 30.6.6).
const EIE: u32 = 1 << 0;
const RTSE: u32 = 1 << 8;
const CTSE: u32 = 1 << 9;
const CTSIE: u32 = 1 << 10;
const ONEBIT: u32 = 1 << 11;

/// See the module.
pub(super) struct Usart {
    clock_hz: u32,
    /// How far its clock is off.
    ppm: i32,
    data: u16,
    /// RXNE and the errors.
    received: u32,
    tc: bool,
    cts_changed: bool,
    /// What SR was when it was last read, if DR was not touched since.
    seen: u32,
    brr: u32,
    cr1: u32,
    cr2: u32,
    cr3: u32,
    gtpr: u32,
    transmitter: Transmitter,
    sending: bool,
    /// The level of CTS: high forbids to send.
    cts: bool,
    overruns: u64,
}

impl Usart {
    /// A USART after a reset, whose clock is off by this number of parts per million; the count of overruns is kept.
    pub fn new(ppm: i32, overruns: u64) -> Self {
        Usart {
            clock_hz: 0,
            ppm,
            data: 0,
            received: 0,
            tc: true,
            cts_changed: false,
            seen: 0,
            brr: 0,
            cr1: 0,
            cr2: 0,
            cr3: 0,
            gtpr: 0,
            transmitter: Transmitter::default(),
            sending: false,
            cts: false,
            overruns,
        }
    }

    /// It is reset by RCC: what it holds is gone. The line it sends on goes idle at once.
    pub fn reset(&mut self, now: Time) {
        let (clock_hz, cts) = (self.clock_hz, self.cts);
        *self = Usart {
            clock_hz,
            cts,
            ..Usart::new(self.ppm, self.overruns)
        };
        self.transmitter.hold_until(now);
    }

    /// Its clock, in Hz.
    pub fn set_clock(&mut self, hz: u32) {
        self.clock_hz = hz;
    }

    /// Rate and format, if they are set.
    pub fn line(&self) -> Option<Line> {
        line_of(self.clock_hz, self.brr, self.cr1, self.cr2)
    }

    /// How long a character takes.
    fn character(&self, line: Line) -> Time {
        Clock::new(line.baud, self.ppm).time(line.format.bits().into())
    }

    /// Whether its receiver is on.
    pub fn listens(&self) -> bool {
        self.cr1 & (UE | RE) == UE | RE
    }

    /// Whether a character is on its way out.
    pub fn is_sending(&self) -> bool {
        self.sending
    }

    /// Characters that were lost because the one before was not read.
    pub fn overruns(&self) -> u64 {
        self.overruns
    }

    /// The level of its RTS: low where it takes characters. With its receiver off it is low too (ES0182, RTS is active while RE or
    /// UE is 0).
    pub fn rts(&self) -> bool {
        self.cr3 & RTSE != 0 && self.listens() && self.received & RXNE != 0
    }

    /// CTS has this level.
    pub fn set_cts(&mut self, level: bool, now: Time) {
        if level == self.cts {
            return;
        }
        self.cts = level;
        if self.cr3 & CTSE != 0 {
            self.cts_changed = true;
            if !level {
                self.transmitter.hold_until(now);
            }
        }
    }

    /// What begins on the wire until `now`, and when. To be called again until there is nothing more.
    pub fn advance(&mut self, now: Time) -> Option<(Time, u8)> {
        let stopped = self.cr3 & CTSE != 0 && self.cts;
        if !stopped && let Some(line) = self.line() {
            let begun = self.transmitter.advance(now, self.character(line));
            if begun.is_some() {
                self.sending = true;
                return begun;
            }
        }
        let flags = self.transmitter.flags(now);
        if self.sending && flags & TC != 0 {
            self.sending = false;
            self.tc = true;
        }
        None
    }

    /// When it does something by itself after `now`.
    pub fn due(&self, now: Time) -> Time {
        self.transmitter.due(now)
    }

    /// Receives a character. It is lost if the one before was not read.
    pub fn deliver(&mut self, byte: RxByte) {
        if !self.listens() {
            return;
        }
        if self.received & RXNE != 0 {
            self.overruns += 1;
            self.received |= ORE;
            return;
        }
        self.data = self.with_parity(byte);
        self.received |= RXNE;
        for (flag, is_set) in [
            (FE, byte.framing_error),
            (PE, byte.parity_error),
            (NF, byte.noise),
        ] {
            if is_set {
                self.received |= flag;
            }
        }
    }

    /// The parity bit is read with the data (RM0090 30.3.7).
    fn with_parity(&self, byte: RxByte) -> u16 {
        let value = u16::from(byte.value);
        let Some(line) = self.line().filter(|_| self.cr1 & PCE != 0) else {
            return value;
        };
        let odd = value.count_ones() % 2 == 1;
        let right = odd == (line.format.parity() == Parity::Even);
        value | u16::from(right != byte.parity_error) << line.format.data_bits()
    }

    fn status(&self, now: Time) -> u32 {
        let flag = |flag: u32, is_set: bool| if is_set { flag } else { 0 };
        self.received
            | self.transmitter.flags(now) & TXE
            | flag(TC, self.tc)
            | flag(CTS, self.cts_changed)
    }

    /// Its interrupt line.
    pub fn interrupt(&self, now: Time) -> bool {
        let status = self.status(now);
        let of_cr1 = status & self.cr1 & (TXE | TC | RXNE) != 0;
        let overrun = status & ORE != 0 && self.cr1 & RXNE != 0;
        let parity = status & PE != 0 && self.cr1 & PEIE != 0;
        let error = status & (FE | NF | ORE) != 0 && self.cr3 & EIE != 0;
        let cts = status & CTS != 0 && self.cr3 & CTSIE != 0;
        self.cr1 & UE != 0 && (of_cr1 || overrun || parity || error || cts)
    }

    /// Reads a register.
    pub fn read(&mut self, offset: u32, now: Time) -> Option<u32> {
        Some(match offset {
            0x00 => {
                self.seen = self.status(now);
                self.seen
            }
            0x04 => {
                self.received &= !(RXNE | self.seen & ERRORS);
                self.seen = 0;
                self.data.into()
            }
            0x08 => self.brr,
            0x0C => self.cr1,
            0x10 => self.cr2,
            0x14 => self.cr3,
            0x18 => self.gtpr,
            _ => return None,
        })
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, now: Time) -> Access {
        match offset {
            // Cleared by zeros; the others cannot be (RM0090 30.6.1).
            0x00 => {
                self.tc &= value & TC != 0;
                self.cts_changed &= value & CTS != 0;
                self.received &= value | !RXNE;
            }
            0x04 => {
                if self.cr1 & (UE | TE) != UE | TE {
                    return Access::wrong("DR is written while the transmitter is off");
                }
                if self.seen & TC != 0 {
                    self.tc = false;
                }
                self.seen = 0;
                self.transmitter.put(now, value as u8);
            }
            0x08 if self.sending => return Access::wrong("BRR is written while it sends"),
            0x08 => self.brr = value & 0xFFFF,
            0x0C => {
                if value & !CR1 != 0 {
                    return Access::wrong("a mode in CR1 that is not modelled");
                }
                if self.sending && value & (UE | TE) != UE | TE {
                    return Access::wrong("the transmitter is switched off while it sends");
                }
                let begins = value & (UE | TE) == UE | TE && self.cr1 & (UE | TE) != UE | TE;
                self.cr1 = value;
                if begins && let Some(line) = self.line() {
                    // An idle character goes first (RM0090 30.3.2).
                    self.transmitter.idle(now, self.character(line));
                }
            }
            0x10 if value & !CR2 == 0 => self.cr2 = value,
            0x14 if value & !(EIE | RTSE | CTSE | CTSIE | ONEBIT) == 0 => self.cr3 = value,
            0x18 if value == 0 => self.gtpr = value,
            0x10..=0x18 => return Access::wrong("a mode that is not modelled"),
            _ => return Access::Unknown,
        }
        Access::Done
    }
}
