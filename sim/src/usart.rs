//! USART0 as the data sheet describes it (ATmega328P, DS40002061B, chapter 20), asynchronous mode.
//!
//! All times are cycles of the node's clock; "at `t`" is the clock edge that begins cycle `t`.
//!
//! What the data sheet leaves open, and how it is read here:
//! * **Phase of a transmitted character.** 20.3.1: the down-counter runs free and is reloaded when
//!   `UBRR0L` is written. Whether the divider by 16 (8 in U2X) behind it is restarted by a new
//!   character is not said: [`TxPhase`].
//! * **Overrun.** 20.7.4: DOR says that a character is missing between the last one read and the
//!   next one. So the character that waited in the shift register is lost when the next start bit
//!   is validated, and the character after the gap carries the flag.
//! * **RXC** is set with the decision on the first stop bit: sample 10 of 16, or 6 of 8.
//! * A change of format or baud while a character is sent does not change that character.

use std::collections::VecDeque;

use crate::line::{Format, Parity};

/// Where the transmitter's divider by 16 (8 with U2X) stands when a character is written to an
/// idle transmitter. The data sheet does not say; a driver has to be right with both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TxPhase {
    /// The divider restarts: the start bit begins with the next tick of the baud generator, 1 to
    /// `UBRR0 + 1` cycles after the write.
    #[default]
    BaudTick,
    /// The divider runs free: the start bit begins up to one bit time after the write.
    BitClock,
}

// UCSR0A, 20.11.2
const RXC: u8 = 1 << 7;
const TXC: u8 = 1 << 6;
const UDRE: u8 = 1 << 5;
const FE: u8 = 1 << 4;
const DOR: u8 = 1 << 3;
const UPE: u8 = 1 << 2;
const U2X: u8 = 1 << 1;
const MPCM: u8 = 1 << 0;
// UCSR0B, 20.11.3
const RXCIE: u8 = 1 << 7;
const TXCIE: u8 = 1 << 6;
const UDRIE: u8 = 1 << 5;
const RXEN: u8 = 1 << 4;
const TXEN: u8 = 1 << 3;
const UCSZ2: u8 = 1 << 2;
const RXB8: u8 = 1 << 1;
const TXB8: u8 = 1 << 0;

/// A character on its way out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TxFrame {
    /// The start bit begins.
    pub start: u64,
    /// Cycles of one bit.
    pub bit: u64,
    /// Levels in the order of the wire, the start bit in bit 0.
    pub bits: u16,
    pub format: Format,
    pub value: u16,
}

impl TxFrame {
    /// The last stop bit ends.
    pub fn end(&self) -> u64 {
        self.start + self.bit * u64::from(self.format.bits())
    }
}

/// A received character with the flags that belong to it.
#[derive(Clone, Copy, Debug, Default)]
struct Received {
    value: u16,
    flags: u8,
}

/// The receiver, between characters or inside one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rx {
    /// Waiting for a falling edge.
    Idle,
    /// A falling edge was seen; the line is looked at with the tick at `tick` (sample 1).
    Edge { tick: u64 },
    /// Sample 1 was low; the start bit is decided at `first + 9` ticks (5 in U2X).
    Start { first: u64 },
    /// Inside a character.
    Data { first: u64 },
}

#[derive(Debug)]
pub(crate) struct Usart {
    phase: TxPhase,
    ucsra: u8,
    ucsrb: u8,
    ucsrc: u8,
    ubrr: u16,
    /// A time at which the baud generator ticked.
    tick_origin: u64,

    /// The character in the shift register, or the last one that was in it.
    shift: Option<TxFrame>,
    /// The character in the transmit buffer, from `start` on in the shift register.
    buffer: Option<TxFrame>,
    txc: bool,

    /// Recent levels of RXD, oldest first: (from, level).
    rxd: VecDeque<(u64, bool)>,
    rx: Rx,
    fifo: VecDeque<Received>,
    waiting: Option<Received>,
    overrun: bool,
    last_read: u8,
}

impl Usart {
    pub fn new(phase: TxPhase) -> Self {
        Usart {
            phase,
            ucsra: 0,
            ucsrb: 0,
            ucsrc: 0x06,
            ubrr: 0,
            tick_origin: 0,
            shift: None,
            buffer: None,
            txc: false,
            rxd: VecDeque::from([(0, true)]),
            rx: Rx::Idle,
            fifo: VecDeque::new(),
            waiting: None,
            overrun: false,
            last_read: 0,
        }
    }

    /// Reset at `at`: registers as 20.11 says, the line as it is.
    pub fn reset(&mut self, at: u64) {
        let level = self.rxd();
        *self = Usart::new(self.phase);
        self.tick_origin = at;
        self.rxd = VecDeque::from([(at, level)]);
    }

    fn tick(&self) -> u64 {
        u64::from(self.ubrr) + 1
    }

    fn divider(&self) -> u64 {
        if self.ucsra & U2X != 0 { 8 } else { 16 }
    }

    /// Ticks from sample 1 to the last of the three that decide (20.8.1, 20.8.2).
    fn decision(&self) -> u64 {
        if self.ucsra & U2X != 0 { 5 } else { 9 }
    }

    /// The first tick at `t` or later.
    fn tick_from(&self, t: u64) -> u64 {
        let tick = self.tick();
        self.tick_origin + t.saturating_sub(self.tick_origin).div_ceil(tick) * tick
    }

    fn format(&self) -> Format {
        let data_bits = match self.ucsrc >> 1 & 3 | (self.ucsrb & UCSZ2) {
            size @ 0..=3 => 5 + size,
            _ => 9,
        };
        let parity = match self.ucsrc >> 4 & 3 {
            2 => Parity::Even,
            3 => Parity::Odd,
            _ => Parity::None,
        };
        Format::new(data_bits, parity, 1 + (self.ucsrc >> 3 & 1))
    }

    // --- transmitter ------------------------------------------------------------------------

    /// Whether the transmitter is on. It holds the TXD pin then, and while it is off until what is pending has left (20.6.5).
    pub fn transmits(&self) -> bool {
        self.ucsrb & TXEN != 0
    }

    /// When the last character written will have left; 0 if there is none.
    pub fn tx_busy_until(&self) -> u64 {
        self.buffer.or(self.shift).map_or(0, |frame| frame.end())
    }

    /// 20.6.1. Returns the character as it will appear on TXD.
    fn write_udr(&mut self, value: u8, at: u64) -> Option<TxFrame> {
        self.sync(at);
        // 20.11.1: a write without UDRE is ignored.
        if self.ucsrb & TXEN == 0 || self.buffer.is_some() {
            return None;
        }
        // 20.11.2: TXC belongs to the frame before and stays until it is cleared.
        let format = self.format();
        let ninth = u16::from(self.ucsrb & TXB8) << 8;
        let bit = self.tick() * self.divider();
        let start = match self.shift {
            // Written before the last stop bit ended: no gap.
            Some(frame) if frame.end() > at => frame.end(),
            _ => match self.phase {
                TxPhase::BaudTick => self.tick_from(at + 1),
                TxPhase::BitClock => {
                    self.tick_origin + (at + 1 - self.tick_origin).div_ceil(bit) * bit
                }
            },
        };
        let frame = TxFrame {
            start,
            bit,
            bits: format.encode(u16::from(value) | ninth),
            format,
            value: (u16::from(value) | ninth) & ((1 << format.data_bits) - 1),
        };
        self.buffer = Some(frame);
        Some(frame)
    }

    fn sync_tx(&mut self, t: u64) {
        loop {
            if let Some(frame) = self.shift {
                if frame.end() > t {
                    return;
                }
                self.shift = None;
                // 20.6.3: the whole frame shifted out and nothing new in the buffer.
                if self.buffer.is_none_or(|next| next.start > frame.end()) {
                    self.txc = true;
                }
            }
            match self.buffer {
                Some(frame) if frame.start <= t => self.shift = self.buffer.take(),
                _ => return,
            }
        }
    }

    // --- receiver ---------------------------------------------------------------------------

    /// RXD changes to `level` at `at`.
    pub fn rxd_edge(&mut self, at: u64, level: bool) {
        self.sync_rx(at);
        let was = self.rxd();
        self.rxd.push_back((at, level));
        if self.rx == Rx::Idle {
            while self.rxd.len() > 2 {
                self.rxd.pop_front();
            }
            if was && !level && self.ucsrb & RXEN != 0 {
                self.rx = Rx::Edge {
                    tick: self.tick_from(at),
                };
            }
        }
    }

    /// The level of RXD.
    pub fn rxd(&self) -> bool {
        self.level_at(u64::MAX)
    }

    fn level_at(&self, t: u64) -> bool {
        let at = self.rxd.iter().rev().find(|(from, _)| *from <= t);
        at.is_none_or(|&(_, level)| level)
    }

    /// The majority of the three samples that end with the tick at `t`.
    fn majority(&self, t: u64) -> bool {
        let tick = self.tick();
        let samples = [t, t.saturating_sub(tick), t.saturating_sub(2 * tick)];
        samples.into_iter().filter(|&t| self.level_at(t)).count() >= 2
    }

    /// When the receiver next has something to decide.
    fn rx_event(&self) -> u64 {
        match self.rx {
            Rx::Idle => u64::MAX,
            Rx::Edge { tick } => tick,
            Rx::Start { first } => first + self.decision() * self.tick(),
            Rx::Data { first } => self.decided_at(first, self.first_stop_bit()),
        }
    }

    fn first_stop_bit(&self) -> u32 {
        let format = self.format();
        format.bits() - u32::from(format.stop_bits)
    }

    fn decided_at(&self, first: u64, bit: u32) -> u64 {
        first + (u64::from(bit) * self.divider() + self.decision()) * self.tick()
    }

    fn sync_rx(&mut self, t: u64) {
        while self.rx_event() <= t {
            let at = self.rx_event();
            match self.rx {
                Rx::Idle => return,
                Rx::Edge { tick } => {
                    // Too short to be seen by any sample: no start bit (20.8.1).
                    self.rx = match self.level_at(tick) {
                        true => Rx::Idle,
                        false => Rx::Start { first: tick },
                    };
                }
                Rx::Start { first } => {
                    if self.majority(at) {
                        self.rx = Rx::Idle;
                    } else {
                        // 20.7.4: a start bit with two characters in the FIFO and one waiting.
                        if self.waiting.take().is_some() {
                            self.overrun = true;
                        }
                        self.rx = Rx::Data { first };
                    }
                }
                Rx::Data { first } => {
                    self.rx = Rx::Idle;
                    self.complete(first);
                }
            }
        }
    }

    fn complete(&mut self, first: u64) {
        let format = self.format();
        let stop = self.first_stop_bit();
        let mut bits = 0;
        for bit in 1..=stop {
            bits |= u16::from(self.majority(self.decided_at(first, bit))) << bit;
        }
        let decoded = format.decode(bits);
        // 20.9: the first stop bit tells address from data, or the ninth bit where there is one.
        let address = match format.data_bits {
            9 => decoded.value >> 8 == 1,
            _ => !decoded.framing_error,
        };
        if self.ucsra & MPCM != 0 && !address {
            return;
        }
        let mut flags = 0;
        flags |= if decoded.framing_error { FE } else { 0 };
        flags |= if decoded.parity_error { UPE } else { 0 };
        flags |= if std::mem::take(&mut self.overrun) {
            DOR
        } else {
            0
        };
        let received = Received {
            value: decoded.value,
            flags,
        };
        if self.fifo.len() < 2 {
            self.fifo.push_back(received);
        } else {
            self.waiting = Some(received);
        }
    }

    fn read_udr(&mut self) -> u8 {
        if let Some(received) = self.fifo.pop_front() {
            self.last_read = received.value as u8;
            self.fifo.extend(self.waiting.take());
        }
        self.last_read
    }

    // --- registers --------------------------------------------------------------------------

    /// Lets everything happen that is due at `t`.
    pub fn sync(&mut self, t: u64) {
        self.sync_tx(t);
        self.sync_rx(t);
    }

    /// When something next happens by itself.
    pub fn next_event(&self) -> u64 {
        let tx = match (self.buffer, self.shift) {
            (Some(frame), _) => frame.start,
            (None, Some(frame)) => frame.end(),
            (None, None) => u64::MAX,
        };
        tx.min(self.rx_event())
    }

    pub fn read_ucsra(&self) -> u8 {
        let mut value = self.ucsra & (U2X | MPCM);
        if let Some(head) = self.fifo.front() {
            value |= RXC | head.flags;
        }
        value |= if self.txc { TXC } else { 0 };
        value |= if self.buffer.is_none() { UDRE } else { 0 };
        value
    }

    pub fn read(&mut self, address: u16, at: u64) -> u8 {
        self.sync(at);
        match address {
            0xc0 => self.read_ucsra(),
            0xc1 => {
                let ninth = self.fifo.front().is_some_and(|head| head.value >> 8 != 0);
                self.ucsrb & !RXB8 | if ninth { RXB8 } else { 0 }
            }
            0xc2 => self.ucsrc,
            0xc4 => self.ubrr as u8,
            0xc5 => (self.ubrr >> 8) as u8,
            0xc6 => self.read_udr(),
            _ => 0,
        }
    }

    /// A write; returns the character it put on its way.
    pub fn write(&mut self, address: u16, value: u8, at: u64) -> Option<TxFrame> {
        self.sync(at);
        match address {
            0xc0 => {
                if value & TXC != 0 {
                    self.txc = false;
                }
                self.ucsra = value & (U2X | MPCM);
            }
            0xc1 => {
                self.ucsrb = value & !RXB8;
                if value & RXEN == 0 {
                    // 20.7.6: the receive buffer is flushed at once.
                    self.rx = Rx::Idle;
                    self.fifo.clear();
                    self.waiting = None;
                    self.overrun = false;
                }
            }
            0xc2 => self.ucsrc = value,
            0xc4 => {
                self.ubrr = self.ubrr & 0xf00 | u16::from(value);
                self.tick_origin = at;
            }
            0xc5 => self.ubrr = self.ubrr & 0xff | u16::from(value & 0xf) << 8,
            0xc6 => return self.write_udr(value, at),
            _ => {}
        }
        None
    }

    /// The lowest vector whose interrupt is asked for (12.1: 18 RX, 19 UDRE, 20 TX, counting reset
    /// as 0). RX and UDRE ask as long as their flag stands.
    pub fn vector(&self) -> Option<u8> {
        if self.ucsrb & RXCIE != 0 && !self.fifo.is_empty() {
            Some(18)
        } else if self.ucsrb & UDRIE != 0 && self.buffer.is_none() {
            Some(19)
        } else if self.ucsrb & TXCIE != 0 && self.txc {
            Some(20)
        } else {
            None
        }
    }

    /// A vector is executed: TXC is cleared by that, RXC and UDRE are not.
    pub fn acknowledge(&mut self, vector: u8) {
        if vector == 20 {
            self.txc = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Characters of 8N1 without a gap, 16 cycles to a bit, from `at` on. Gives the end of the last.
    fn hear(usart: &mut Usart, at: u64, characters: &[u8]) -> u64 {
        let mut begins = at;
        for &value in characters {
            let bits = Format::N81.encode(value.into());
            for bit in 0..10 {
                usart.rxd_edge(begins + 16 * bit, bits >> bit & 1 == 1);
            }
            begins += 160;
        }
        begins
    }

    #[test]
    fn a_receiver_that_is_switched_off_forgets_what_it_has_heard() {
        let mut usart = Usart::new(TxPhase::default());
        usart.write(0xc1, RXEN, 0);
        // Two wait in the FIFO, one in the shift register, and the start bit of a fourth has made an overrun of that.
        let end = hear(&mut usart, 100, &[1, 2, 3, 4]);
        assert_eq!(usart.read(0xc0, end - 100), RXC | UDRE);
        usart.write(0xc1, 0, end - 100);
        assert_eq!(usart.read(0xc0, end - 100), UDRE);
        usart.write(0xc1, RXEN, end);
        let end = hear(&mut usart, end + 100, &[5]);
        assert_eq!(usart.read(0xc0, end), RXC | UDRE);
        assert_eq!(usart.read(0xc6, end), 5);
        assert_eq!(usart.read(0xc0, end), UDRE);
    }
}
