//! Ports B, C and D, their pin-change flags, and the external interrupts INT0 and INT1 on PD2 and PD3 (ATmega328P,
//! DS40002061B, chapters 14 and 13).
//!
//! # Delay of an input
//! A pin's level passes a latch and a flip-flop before `PINx` shows it: 0.5 to 1.5 cycles (14.2.4).
//! Here it shows one cycle after the first clock edge at or after the change. Figure 13-1 puts the
//! pin-change flag two further clock edges behind that; the flags of INT0 and INT1, of which the data sheet draws no figure,
//! are taken to come as late.

use std::collections::VecDeque;
use std::fmt;

/// A pin of the ATmega328P.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Pin {
    port: u8,
    bit: u8,
}

impl Pin {
    /// The pin PD0, RXD.
    pub const D0: Pin = Pin::at(2, 0);
    /// The pin PD1, TXD.
    pub const D1: Pin = Pin::at(2, 1);
    /// PD2, the usual DE.
    pub const D2: Pin = Pin::at(2, 2);
    /// The pin PD3.
    pub const D3: Pin = Pin::at(2, 3);
    /// The pin PD4.
    pub const D4: Pin = Pin::at(2, 4);
    /// The pin PD5.
    pub const D5: Pin = Pin::at(2, 5);
    /// The pin PD6.
    pub const D6: Pin = Pin::at(2, 6);
    /// The pin PD7.
    pub const D7: Pin = Pin::at(2, 7);
    /// PB5, the Nano's LED.
    pub const B5: Pin = Pin::at(0, 5);

    const fn at(port: u8, bit: u8) -> Self {
        Pin { port, bit }
    }

    /// The pin `bit` (0 to 7) of port `port` (`'B'`, `'C'` or `'D'`); `None` if there is none.
    pub fn new(port: char, bit: u8) -> Option<Self> {
        let port = port_index(port)?;
        (bit < 8).then_some(Pin::at(port as u8, bit))
    }

    fn mask(self) -> u8 {
        1 << self.bit
    }
}

impl fmt::Display for Pin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "P{}{}", char::from(b'B' + self.port), self.bit)
    }
}

/// What a pin does to the outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// An output that drives low.
    Low,
    /// An output that drives high.
    High,
    /// An input: not driven.
    Floating,
}

fn port_index(port: char) -> Option<usize> {
    match port {
        'B' | 'b' => Some(0),
        'C' | 'c' => Some(1),
        'D' | 'd' => Some(2),
        _ => None,
    }
}

/// Cycles from a pin's change to `PINx`, and from there to its pin-change flag.
const PIN_DELAY: u64 = 1;
const FLAG_DELAY: u64 = 2;

#[derive(Debug, Default)]
pub(crate) struct Gpio {
    port: [u8; 3],
    ddr: [u8; 3],
    /// Levels from outside, and which pins have one.
    outside: [u8; 3],
    connected: [u8; 3],
    /// Changes from outside still in the synchroniser: (shows at, port, mask, level).
    incoming: VecDeque<(u64, u8, u8, bool)>,
    /// Flags on their way: (set at, bits of PCIFR, bits of EIFR).
    flagging: VecDeque<(u64, u8, u8)>,
    pcmsk: [u8; 3],
    pcifr: u8,
    pcicr: u8,
    eifr: u8,
    eimsk: u8,
    eicra: u8,
}

/// Port D, and the pins of it that are INT0 and INT1: bits 0 and 1 of EIFR and EIMSK when they are moved to the right.
const PORT_D: usize = 2;
const INT_PINS: u8 = 0b11;
const INT_SHIFT: u8 = 2;

impl Gpio {
    /// The transceiver's receiver holds RXD high from the start.
    pub fn new() -> Self {
        let rxd = [0, 0, Pin::D0.mask()];
        Gpio {
            outside: rxd,
            connected: rxd,
            ..Gpio::default()
        }
    }

    pub fn reset(&mut self, at: u64) {
        self.sync(at);
        self.port = [0; 3];
        self.ddr = [0; 3];
        self.pcmsk = [0; 3];
        self.pcifr = 0;
        self.pcicr = 0;
        self.eifr = 0;
        self.eimsk = 0;
        self.eicra = 0;
        self.flagging.clear();
    }

    /// PORTx and DDRx.
    pub fn port_state(&self, port: char) -> Option<(u8, u8)> {
        let index = port_index(port)?;
        Some((self.port[index], self.ddr[index]))
    }

    /// What the node does to a pin.
    pub fn output(&self, pin: Pin) -> Level {
        let index = usize::from(pin.port);
        if self.ddr[index] & pin.mask() == 0 {
            Level::Floating
        } else if self.port[index] & pin.mask() != 0 {
            Level::High
        } else {
            Level::Low
        }
    }

    /// The outside drives `pin` from `at` on.
    pub fn input(&mut self, pin: Pin, level: bool, at: u64) {
        let shows = at + PIN_DELAY;
        // RXD follows the wire, while changes of other pins may be known long before.
        let place = self.incoming.partition_point(|change| change.0 <= shows);
        self.incoming
            .insert(place, (shows, pin.port, pin.mask(), level));
    }

    /// The outside stops driving `pin`.
    pub fn release(&mut self, pin: Pin) {
        self.connected[usize::from(pin.port)] &= !pin.mask();
    }

    /// 14.2: what `PINx` reads.
    fn pins(&self, index: usize) -> u8 {
        let ddr = self.ddr[index];
        let pull_ups = self.port[index] & !self.connected[index];
        let outside = self.outside[index] & self.connected[index];
        self.port[index] & ddr | (outside | pull_ups) & !ddr
    }

    /// 13.2.4: any change of a pin with its mask bit set sets the port's flag, whether the
    /// interrupt is enabled or not, and for outputs too.
    fn changed(&mut self, index: usize, before: u8, at: u64) {
        let now = self.pins(index);
        let mut pin_change = 0;
        if (before ^ now) & self.pcmsk[index] != 0 {
            pin_change = 1 << index;
        }
        let mut external = 0;
        if index == PORT_D {
            let changed = (before ^ now) >> INT_SHIFT & INT_PINS;
            let high = now >> INT_SHIFT & INT_PINS;
            for int in 0..2 {
                // 13.2.1: any change, falling edge, rising edge; a low level has no flag.
                let is_edge = match self.sense(int) {
                    0 => false,
                    1 => true,
                    2 => high & 1 << int == 0,
                    _ => high & 1 << int != 0,
                };
                if is_edge {
                    external |= changed & 1 << int;
                }
            }
        }
        if pin_change | external != 0 {
            self.flagging
                .push_back((at + FLAG_DELAY, pin_change, external));
        }
    }

    /// ISCn1 and ISCn0 of EICRA (13.2.1).
    fn sense(&self, int: u8) -> u8 {
        self.eicra >> (2 * int) & 3
    }

    /// INT0 and INT1 that ask for their interrupt.
    fn external_asked(&self) -> u8 {
        let low = !self.pins(PORT_D) >> INT_SHIFT & INT_PINS;
        let by_level = (0..2).filter(|&int| self.sense(int) == 0);
        let by_level = by_level.fold(0, |mask, int| mask | low & 1 << int);
        (self.eifr | by_level) & self.eimsk
    }

    pub fn sync(&mut self, t: u64) {
        while let Some(&(at, port, mask, level)) = self.incoming.front()
            && at <= t
        {
            self.incoming.pop_front();
            let index = usize::from(port);
            let before = self.pins(index);
            self.connected[index] |= mask;
            self.outside[index] = self.outside[index] & !mask | if level { mask } else { 0 };
            self.changed(index, before, at);
        }
        while let Some(&(at, pin_change, external)) = self.flagging.front()
            && at <= t
        {
            self.flagging.pop_front();
            self.pcifr |= pin_change;
            self.eifr |= external;
        }
    }

    /// When a flag is next set whose interrupt is enabled, or a change shows that may set one.
    pub fn next_event(&self) -> u64 {
        if self.pcicr | self.eimsk == 0 {
            return u64::MAX;
        }
        let incoming = self.incoming.front().map_or(u64::MAX, |change| change.0);
        let flagging = self.flagging.front().map_or(u64::MAX, |flag| flag.0);
        incoming.min(flagging)
    }

    pub fn read(&mut self, address: u16, at: u64) -> u8 {
        self.sync(at);
        match address {
            0x23..=0x2b => {
                let index = usize::from((address - 0x23) / 3);
                match (address - 0x23) % 3 {
                    0 => self.pins(index),
                    1 => self.ddr[index],
                    _ => self.port[index],
                }
            }
            0x3b => self.pcifr,
            0x3c => self.eifr,
            0x3d => self.eimsk,
            0x69 => self.eicra,
            0x68 => self.pcicr,
            0x6b..=0x6d => self.pcmsk[usize::from(address - 0x6b)],
            _ => 0,
        }
    }

    pub fn write(&mut self, address: u16, value: u8, at: u64) {
        self.sync(at);
        match address {
            0x23..=0x2b => {
                let index = usize::from((address - 0x23) / 3);
                let before = self.pins(index);
                match (address - 0x23) % 3 {
                    // 14.2.2: a one written to PINx toggles PORTx.
                    0 => self.port[index] ^= value,
                    1 => self.ddr[index] = value,
                    _ => self.port[index] = value,
                }
                self.changed(index, before, at + PIN_DELAY);
            }
            0x3b => self.pcifr &= !value,
            0x3c => self.eifr &= !value,
            0x3d => self.eimsk = value & INT_PINS,
            0x69 => self.eicra = value & 0xf,
            0x68 => self.pcicr = value & 7,
            0x6b..=0x6d => self.pcmsk[usize::from(address - 0x6b)] = value,
            _ => {}
        }
    }

    /// The lowest vector whose interrupt is asked for (12.1: 1 and 2 for INT0 and INT1, 3, 4, 5 for ports B, C, D).
    pub fn vector(&self) -> Option<u8> {
        let external = self.external_asked();
        if external != 0 {
            return Some(1 + external.trailing_zeros() as u8);
        }
        let asked = self.pcifr & self.pcicr;
        (asked != 0).then(|| 3 + asked.trailing_zeros() as u8)
    }

    /// A vector is executed, which clears its flag.
    pub fn acknowledge(&mut self, vector: u8) {
        match vector {
            1 | 2 => self.eifr &= !(1 << (vector - 1)),
            3..=5 => self.pcifr &= !(1 << (vector - 3)),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_show_in_the_order_of_time_whichever_is_known_first() {
        let mut gpio = Gpio::new();
        gpio.write(0x6d, Pin::D0.mask(), 0);
        gpio.input(Pin::D3, true, 1_000);
        gpio.input(Pin::D0, false, 100);
        gpio.input(Pin::D0, true, 200);
        let pins = |gpio: &mut Gpio, at| gpio.read(0x29, at) & (Pin::D0.mask() | Pin::D3.mask());
        assert_eq!(pins(&mut gpio, 150), 0);
        assert_eq!(gpio.read(0x3b, 150), 1 << PORT_D);
        gpio.write(0x3b, 1 << PORT_D, 160);
        assert_eq!(pins(&mut gpio, 250), Pin::D0.mask());
        assert_eq!(gpio.read(0x3b, 250), 1 << PORT_D);
        gpio.write(0x3b, 1 << PORT_D, 260);
        assert_eq!(pins(&mut gpio, 1_100), Pin::D0.mask() | Pin::D3.mask());
        assert_eq!(gpio.read(0x3b, 1_100), 0);
    }
}
