//! A host on the bus: a station without firmware, such as a PC with a USB adapter.
//!
//! It switches its driver on with the start bit of each character and off at the end of its last stop bit, and
//! receives the wire while it does not drive.

use std::collections::VecDeque;

use crate::line::{Format, Line};
use crate::time::{Clock, Time};

/// The settings of a host.
#[derive(Clone, Debug)]
pub struct HostPort {
    /// Its name in records.
    pub name: String,
    /// Its baud rate and format.
    pub line: Line,
    /// The error of its bit clock in parts per million; positive is too fast.
    pub clock_ppm: i32,
    /// Whether it receives its own characters.
    pub echo: bool,
    /// Whether its driver is switched from outside.
    pub(crate) has_driver_pin: bool,
}

impl HostPort {
    /// A host with an exact clock, without an echo.
    pub fn new(line: Line) -> Self {
        HostPort {
            name: "host".to_owned(),
            line,
            clock_ppm: 0,
            echo: false,
            has_driver_pin: false,
        }
    }
}

/// A character to send, right or damaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tx {
    value: u16,
    gap: Time,
    flip: u16,
    flip_parity: bool,
    low_stop: bool,
}

impl Tx {
    /// The character `value`, right after the one before.
    pub fn byte(value: u8) -> Self {
        Tx {
            value: u16::from(value),
            gap: Time::ZERO,
            flip: 0,
            flip_parity: false,
            low_stop: false,
        }
    }

    /// Sets the pause between the last stop bit before it and its start bit.
    pub fn after(self, gap: Time) -> Self {
        Tx { gap, ..self }
    }

    /// Inverts data bit `bit` (0 is sent first) and leaves the parity bit.
    pub fn flip_bit(self, bit: u8) -> Self {
        Tx {
            flip: self.flip ^ 2u16.checked_shl(u32::from(bit)).unwrap_or(0),
            ..self
        }
    }

    /// Inverts the parity bit, if the format has one.
    pub fn bad_parity(self) -> Self {
        Tx {
            flip_parity: true,
            ..self
        }
    }

    /// Makes all stop bits low.
    pub fn bad_stop(self) -> Self {
        Tx {
            low_stop: true,
            ..self
        }
    }

    /// The pause before it.
    pub fn gap(self) -> Time {
        self.gap
    }

    /// The data bits that a receiver of this format gets, or `None` if the parity or the first stop bit is wrong.
    pub fn received(self, format: Format) -> Option<u8> {
        let decoded = format.decode(self.encode(format));
        let good = !decoded.parity_error && !decoded.framing_error;
        good.then_some(decoded.value as u8)
    }

    fn encode(&self, format: Format) -> u16 {
        let mut bits = format.encode(self.value) ^ self.flip;
        let after_data = 1 + format.data_bits;
        if self.flip_parity && format.has_parity() {
            bits ^= 1 << after_data;
        }
        if self.low_stop {
            bits &= (1 << (format.bits() - u32::from(format.stop_bits))) - 1;
        }
        bits
    }
}

/// A character that a host received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RxByte {
    /// Its data bits.
    pub value: u8,
    /// The exact time at which the start bit began.
    pub start: Time,
    /// The time at which the last stop bit ended, by the host's own clock.
    pub end: Time,
    /// Whether the first stop bit was low.
    pub framing_error: bool,
    /// Whether the parity was wrong.
    pub parity_error: bool,
    /// Whether the wire changed about the middle of a bit, so that three samples there differ.
    pub noise: bool,
}

impl RxByte {
    /// Whether it came without an error.
    pub fn is_good(&self) -> bool {
        !self.framing_error && !self.parity_error
    }
}

/// The times at which the bits of a character begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct BitTimes {
    /// The time from which `clock` is counted.
    pub base: Time,
    pub clock: Clock,
    /// The tick of `clock` at which the start bit begins.
    pub first: u64,
    /// Ticks of `clock` per bit.
    pub ticks: u64,
    pub count: u32,
}

impl BitTimes {
    fn from_edge(start: Time, clock: Clock, format: Format) -> Self {
        BitTimes {
            base: start,
            clock,
            first: 0,
            ticks: 1,
            count: format.bits(),
        }
    }

    /// The time at which bit `bit` begins.
    pub fn bit(&self, bit: u32) -> Time {
        self.base + self.clock.time(self.first + u64::from(bit) * self.ticks)
    }

    pub fn start(&self) -> Time {
        self.bit(0)
    }

    /// The middle of bit `bit`.
    pub fn middle(&self, bit: u32) -> Time {
        (self.bit(bit) + self.bit(bit + 1)) / 2
    }

    /// The samples before and after the middle, of sixteen in a bit.
    fn beside(&self, bit: u32) -> [Time; 2] {
        let sixteenth = (self.bit(bit + 1) - self.bit(bit)) / 16;
        let middle = self.middle(bit);
        [middle - sixteenth, middle + sixteenth]
    }

    pub fn end(&self) -> Time {
        self.bit(self.count)
    }
}

/// A character that a station is sending.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub times: BitTimes,
    pub format: Format,
    /// Levels in the order of the wire, the start bit in bit 0.
    pub bits: u16,
    pub value: u16,
}

/// A host on the bus.
pub struct Host {
    config: HostPort,
    clock: Clock,
    outbox: Vec<Frame>,
    busy_until: Time,
    /// Levels that the host has received, from the start of the present character.
    heard: VecDeque<(Time, bool)>,
    receiving: Option<BitTimes>,
    /// Whether its receiver is on.
    listening: bool,
    inbox: VecDeque<RxByte>,
    now: Time,
}

impl Host {
    pub(crate) fn new(config: HostPort) -> Self {
        Host {
            clock: Clock::new(config.line.baud, config.clock_ppm),
            config,
            outbox: Vec::new(),
            busy_until: Time::ZERO,
            heard: VecDeque::from([(Time::ZERO, true)]),
            receiving: None,
            listening: true,
            inbox: VecDeque::new(),
            now: Time::ZERO,
        }
    }

    /// The name of the host.
    pub fn name(&self) -> &str {
        &self.config.name
    }

    /// Its baud rate and format.
    pub fn line(&self) -> Line {
        self.config.line
    }

    /// Changes baud rate and format for characters sent from now on and for the next received character.
    pub fn set_line(&mut self, line: Line) {
        self.config.line = line;
        self.clock = Clock::new(line.baud, self.config.clock_ppm);
    }

    /// Switches its receiver: what comes in is broken off, and it hears from the next falling edge on.
    pub(crate) fn set_listening(&mut self, on: bool) {
        if on != self.listening {
            self.listening = on;
            self.receiving = None;
        }
    }

    /// What it was sending ends here.
    pub(crate) fn break_off(&mut self, at: Time) {
        self.outbox.clear();
        self.busy_until = at;
    }

    /// What it sends next begins at `at` or later.
    pub(crate) fn send_from(&mut self, at: Time, byte: u8) {
        self.now = self.now.max(at);
        self.send(&[byte]);
    }

    /// Whether its driver is on for each character, and not by a pin of its own.
    pub(crate) fn switches_its_driver(&self) -> bool {
        !self.config.has_driver_pin
    }

    pub(crate) fn echo(&self) -> bool {
        self.config.echo
    }

    /// When its last stop bit will have ended.
    pub fn busy_until(&self) -> Time {
        self.busy_until
    }

    /// Sends bytes without a gap, after what is being sent. Returns when the last stop bit ends.
    pub fn send(&mut self, bytes: &[u8]) -> Time {
        self.send_each(bytes.iter().map(|&byte| Tx::byte(byte)))
    }

    /// Sends bytes with a pause of `gap` between them, none before the first.
    pub fn send_spaced(&mut self, bytes: &[u8], gap: Time) -> Time {
        self.send_each(
            bytes.iter().enumerate().map(|(index, &byte)| {
                Tx::byte(byte).after(if index == 0 { Time::ZERO } else { gap })
            }),
        )
    }

    /// Sends characters one by one as described. Returns when the last stop bit ends.
    pub fn send_each(&mut self, characters: impl IntoIterator<Item = Tx>) -> Time {
        let format = self.config.line.format;
        for character in characters {
            let start = self.busy_until.max(self.now) + character.gap;
            let times = BitTimes::from_edge(start, self.clock, format);
            self.busy_until = times.end();
            self.outbox.push(Frame {
                times,
                format,
                bits: character.encode(format),
                value: character.value & ((1 << format.data_bits) - 1),
            });
        }
        self.busy_until
    }

    /// What was heard since the last call.
    pub fn take(&mut self) -> Vec<RxByte> {
        self.inbox.drain(..).collect()
    }

    /// What was heard and not taken yet.
    pub fn heard(&self) -> impl ExactSizeIterator<Item = &RxByte> {
        self.inbox.iter()
    }

    /// Whether a character is coming in just now.
    pub fn is_receiving(&self) -> bool {
        self.receiving.is_some()
    }

    pub(crate) fn take_outbox(&mut self) -> Vec<Frame> {
        std::mem::take(&mut self.outbox)
    }

    pub(crate) fn has_outbox(&self) -> bool {
        !self.outbox.is_empty()
    }

    /// When the character that comes in can be judged: the middle of its first stop bit.
    pub(crate) fn next_event(&self) -> Time {
        self.receiving.map_or(Time::NEVER, |times| {
            times.middle(times.count - u32::from(self.config.line.format.stop_bits))
        })
    }

    pub(crate) fn edge(&mut self, at: Time, level: bool) {
        self.advance(at);
        let was = self.level_at(Time::NEVER);
        self.heard.push_back((at, level));
        if self.receiving.is_none() {
            while self.heard.len() > 2 {
                self.heard.pop_front();
            }
            if was && !level && self.listening {
                let format = self.config.line.format;
                self.receiving = Some(BitTimes::from_edge(at, self.clock, format));
            }
        }
    }

    fn level_at(&self, t: Time) -> bool {
        let at = self.heard.iter().rev().find(|(from, _)| *from <= t);
        at.is_none_or(|&(_, level)| level)
    }

    pub(crate) fn advance(&mut self, now: Time) {
        self.now = self.now.max(now);
        if self.next_event() > now {
            return;
        }
        let Some(times) = self.receiving.take() else {
            return;
        };
        if self.level_at(times.middle(0)) {
            // Noise shorter than half a bit.
            return;
        }
        let format = self.config.line.format;
        let bits = (0..times.count)
            .map(|bit| u16::from(self.level_at(times.middle(bit))) << bit)
            .fold(0, |bits, bit| bits | bit);
        let decoded = format.decode(bits);
        let noise = (0..times.count - u32::from(format.stop_bits)).any(|bit| {
            let level = bits >> bit & 1 != 0;
            times
                .beside(bit)
                .iter()
                .any(|at| self.level_at(*at) != level)
        });
        self.inbox.push_back(RxByte {
            value: decoded.value as u8,
            start: times.start(),
            end: times.end(),
            framing_error: decoded.framing_error,
            parity_error: decoded.parity_error,
            noise,
        });
    }
}
