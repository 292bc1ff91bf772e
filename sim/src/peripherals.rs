//! The registers that replace simavr's: USART0, Timer1, EEPROM, watchdog and the ports, and what they put out.

use crate::eeprom::Eeprom;
use crate::ffi::Peripherals;
use crate::gpio::{Gpio, Level, Pin};
use crate::timer1::Timer1;
use crate::usart::{TxFrame, TxPhase, Usart};
use crate::watchdog::Watchdog;

/// Something a node does to the outside, at a cycle of its own clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Output {
    pub at: u64,
    pub what: OutputKind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum OutputKind {
    /// A character on TXD, all of it known in advance.
    Frame(TxFrame),
    /// TXD as the port pin drives it, where the transmitter does not.
    Txd(bool),
    /// A reset: what was announced for later does not come.
    Reset,
    /// A watched pin.
    Pin(Pin, Level),
}

/// The pins whose changes are put out.
#[derive(Debug)]
struct Watched {
    pin: Pin,
    level: Level,
}

#[derive(Debug)]
pub(crate) struct Nano328 {
    pub usart: Usart,
    pub timer: Timer1,
    pub gpio: Gpio,
    pub eeprom: Eeprom,
    pub watchdog: Watchdog,
    watched: Vec<Watched>,
    txd: bool,
    outputs: Vec<Output>,
    pub bad_opcodes: u32,
}

impl Nano328 {
    pub fn new(phase: TxPhase, pins: &[Pin], eeprom: Eeprom, watchdog: Watchdog) -> Self {
        let mut all = pins.to_vec();
        all.sort_unstable();
        all.dedup();
        Nano328 {
            usart: Usart::new(phase),
            timer: Timer1::default(),
            gpio: Gpio::new(),
            eeprom,
            watchdog,
            watched: all
                .into_iter()
                .map(|pin| Watched {
                    pin,
                    level: Level::Floating,
                })
                .collect(),
            txd: true,
            outputs: Vec::new(),
            bad_opcodes: 0,
        }
    }

    /// Reset (or loss of power) at `at`, which leaves these flags in MCUSR: every pin floats.
    pub fn reset(&mut self, at: u64, mcusr: u8) {
        self.watchdog.reset(at, mcusr);
        self.usart.reset(at);
        self.timer.reset(at);
        self.gpio.reset(at);
        self.eeprom.reset();
        self.txd = true;
        self.outputs.push(Output {
            at,
            what: OutputKind::Reset,
        });
        self.put_out_pins(at);
    }

    pub fn rxd_edge(&mut self, at: u64, level: bool) {
        self.usart.rxd_edge(at, level);
        self.gpio.input(Pin::D0, level, at);
    }

    pub fn next_event(&self) -> u64 {
        self.usart
            .next_event()
            .min(self.timer.next_event())
            .min(self.gpio.next_event())
            .min(self.eeprom.next_event())
            .min(self.watchdog.next_event())
    }

    pub fn sync(&mut self, t: u64) {
        self.gpio.sync(t);
        self.timer.sync(t);
        self.usart.sync(t);
        self.eeprom.sync(t);
        self.watchdog.sync(t);
    }

    /// The lowest vector asked for, which is the one with the highest priority (7.7).
    pub fn vector(&self) -> Option<u8> {
        self.gpio
            .vector()
            .or_else(|| self.watchdog.vector())
            .or_else(|| self.timer.vector())
            .or_else(|| self.usart.vector())
            .or_else(|| self.eeprom.vector())
    }

    pub fn acknowledge(&mut self, vector: u8) {
        self.gpio.acknowledge(vector);
        self.timer.acknowledge(vector);
        self.usart.acknowledge(vector);
        self.watchdog.acknowledge(vector);
    }

    pub fn has_outputs(&self) -> bool {
        !self.outputs.is_empty()
    }

    pub fn take_outputs(&mut self) -> Vec<Output> {
        std::mem::take(&mut self.outputs)
    }

    fn put_out_pins(&mut self, at: u64) {
        for watched in &mut self.watched {
            let level = self.gpio.output(watched.pin);
            if level != watched.level {
                watched.level = level;
                self.outputs.push(Output {
                    at,
                    what: OutputKind::Pin(watched.pin, level),
                });
            }
        }
        // 20.6.5: once what is pending has left, the port has the pin back. A floating TXD is
        // pulled up by the transceiver's input.
        let driven = self.usart.transmits() || self.gpio.output(Pin::D1) != Level::Low;
        if driven != self.txd {
            self.txd = driven;
            self.outputs.push(Output {
                at: at.max(self.usart.tx_busy_until()),
                what: OutputKind::Txd(driven),
            });
        }
    }
}

impl Peripherals for Nano328 {
    const REGISTERS: &'static [u16] = &[
        0x23, 0x24, 0x25, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x2b, // ports
        0x3b, 0x3c, 0x3d, 0x68, 0x69, 0x6b, 0x6c, 0x6d, // pin change, external interrupts
        0x36, 0x43, 0x6f, 0x80, 0x81, 0x82, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a,
        0x8b, // T1
        0xc0, 0xc1, 0xc2, 0xc4, 0xc5, 0xc6, // USART0
        0x3f, 0x40, 0x41, 0x42, // EEPROM
        0x54, 0x60, // MCUSR and watchdog
    ];
    const SINGLE_BIT: &'static [u16] = &[0x23, 0x26, 0x29, 0x36, 0x3b, 0x3c, 0x3f];

    fn read(&mut self, address: u16, at: u64) -> u8 {
        match address {
            0xc0..=0xc6 => self.usart.read(address, at),
            0x36 | 0x43 | 0x6f | 0x80..=0x8b => self.timer.read(address, at),
            0x3f..=0x42 => self.eeprom.read(address, at),
            0x54 | 0x60 => self.watchdog.read(address, at),
            _ => self.gpio.read(address, at),
        }
    }

    fn write(&mut self, address: u16, value: u8, at: u64) -> u64 {
        match address {
            0xc0..=0xc6 => {
                if let Some(frame) = self.usart.write(address, value, at) {
                    self.outputs.push(Output {
                        at: frame.start,
                        what: OutputKind::Frame(frame),
                    });
                }
            }
            0x36 | 0x43 | 0x6f | 0x80..=0x8b => self.timer.write(address, value, at),
            0x3f..=0x42 => return self.eeprom.write(address, value, at),
            0x54 | 0x60 => self.watchdog.write(address, value, at),
            _ => self.gpio.write(address, value, at),
        }
        if matches!(address, 0x23..=0x2b | 0xc1) {
            self.put_out_pins(at);
        }
        0
    }

    fn write_bit(&mut self, address: u16, bit: u8, set: bool, at: u64) -> u64 {
        match (address, set) {
            (0x3f, _) => self.eeprom.write_bit(bit, set, at),
            // A one in a flag register clears that flag, in PINx it toggles that pin; a zero does nothing.
            (_, true) => self.write(address, 1 << bit, at),
            (_, false) => 0,
        }
    }

    fn watchdog_reset(&mut self, at: u64) {
        self.watchdog.restart(at);
    }

    fn bad_opcode(&mut self) {
        self.bad_opcodes += 1;
    }
}
