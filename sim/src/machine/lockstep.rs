//! An STM32F405 in QEMU, which knows the registers of its USARTs but neither bauds nor pins. Both are made up for here: what the
//! firmware writes to a data register goes on the wire at the rate and in the format that it has set, and TXE and TC are set
//! when there is room for more and when all has left; what comes from the wire is put into the register when its first stop bit
//! is judged, with its error flags. The beginning of a character is a falling edge for the external interrupt controller. DE is
//! the pin that the firmware sets.
//!
//! Time is exact to the instruction: each takes 8 ns, whatever it does. That is not what each takes in silicon.

use std::path::Path;

use super::parts::{Instructions, Parts};
use super::qemu::{Access, Qemu};
use super::transmitter::Transmitter;
use super::{FE, MachineOutput, ORE, PE, RXNE, TC, TXE, line_of};
use crate::error::BusError;
use crate::host::{Host, RxByte};
use crate::line::Line;
use crate::record::HostId;
use crate::time::{Clock, Time};

/// What a port is made of.
struct Usart {
    /// Where its registers are (RM0090 2.3).
    base: u64,
    /// The clock that its rate is divided from, in Hz.
    clock_hz: u32,
    /// The line of the external interrupt controller that its RXD is on.
    exti: u8,
    /// The bit of GPIOA that is its DE.
    de: Option<u8>,
}

/// AS1, AS2, RS2, RS4. The order of `-serial` is that of the first four USARTs.
const USARTS: [Usart; 4] = [
    Usart {
        base: 0x4001_1000,
        clock_hz: 42_000_000,
        exti: 10,
        de: None,
    },
    Usart {
        base: 0x4000_4400,
        clock_hz: 42_000_000,
        exti: 3,
        de: None,
    },
    Usart {
        base: 0x4000_4800,
        clock_hz: 42_000_000,
        exti: 11,
        de: None,
    },
    Usart {
        base: 0x4000_4C00,
        clock_hz: 42_000_000,
        exti: 1,
        de: Some(4),
    },
];

/// Registers of a USART (RM0090 30.6).
const SR: u64 = 0x00;
const DR: u64 = 0x04;
const BRR: u64 = 0x08;
const CR1: u64 = 0x0C;
const CR2: u64 = 0x10;
const CR3: u64 = 0x14;

/// BSRR of GPIOA (RM0090 8.4.7).
const GPIOA_BSRR: u64 = 0x4002_0018;

/// AIRCR (ARMv7-M B3.2.6), and what asks for a system reset there.
const AIRCR: u64 = 0xE000_ED0C;
const VECTKEY: u32 = 0x05FA << 16;
const SYSRESETREQ: u32 = 1 << 2;

/// Instructions in a second.
const INSTRUCTIONS_HZ: u32 = 125_000_000;

struct Port {
    usart: &'static Usart,
    serial: usize,
    host: HostId,
    brr: u32,
    cr1: u32,
    cr2: u32,
    transmitter: Transmitter,
    /// The flags of the transmitter in QEMU's SR.
    sending: u32,
    /// Those of the receiver: RXNE until the firmware has read the character, errors until the next one.
    received: u32,
    overruns: u64,
}

/// An STM32F405 in QEMU.
pub(super) struct Lockstep {
    qemu: Qemu,
    clock: Clock,
    /// When it was powered up.
    since: Time,
    ports: Vec<Port>,
}

impl Lockstep {
    pub fn new(image: &Path, plugin: &Path, parts: &Parts, now: Time) -> Result<Self, BusError> {
        let mut watched: Vec<_> = USARTS.iter().map(|u| (u.base, u.base + CR3)).collect();
        watched.push((GPIOA_BSRR, GPIOA_BSRR));
        watched.push((AIRCR, AIRCR));
        let stops: Vec<_> = USARTS.iter().map(|u| u.base + DR).collect();
        let qemu = Qemu::start(image, plugin, USARTS.len(), &watched, &stops, parts)?;
        Ok(Lockstep {
            qemu,
            clock: Clock::new(INSTRUCTIONS_HZ, 0),
            since: now,
            ports: Vec::new(),
        })
    }

    pub fn connect(&mut self, port: usize, host: HostId) {
        self.ports.push(Port {
            usart: &USARTS[port],
            serial: port,
            host,
            brr: 0,
            cr1: 0,
            cr2: 0,
            transmitter: Transmitter::default(),
            sending: TXE | TC,
            received: 0,
            overruns: 0,
        });
    }

    /// Why it has stopped, if it has.
    pub fn failure(&self) -> Option<&str> {
        self.qemu.failure()
    }

    /// What was executed.
    pub fn counted(&self) -> Instructions {
        self.qemu.counted()
    }

    /// Interrupts that are over: where they began, and how many instructions they took.
    pub fn interrupts(&self) -> &[(u64, u64)] {
        self.qemu.interrupts()
    }

    /// Characters that were lost on a port because the firmware had not read the one before.
    pub fn overruns(&self, port: usize) -> u64 {
        let found = self.ports.iter().find(|known| known.serial == port);
        found.map_or(0, |port| port.overruns)
    }

    pub fn now(&self) -> Time {
        self.since + self.clock.time(self.qemu.count())
    }

    /// Runs to `limit`, or to where a character is handed to a transmitter or leaves it.
    pub fn run_to(&mut self, limit: Time) -> Vec<MachineOutput> {
        let now = self.now();
        let due = self.ports.iter().map(|port| port.transmitter.due(now));
        let limit = due.fold(limit, Time::min);
        let count = self
            .clock
            .tick_at_or_after(limit.saturating_sub(self.since));
        let accesses = self.qemu.run_to(count.max(self.qemu.count() + 1));
        let mut outputs = Vec::new();
        for access in accesses {
            let at = self.since + self.clock.time(access.count);
            for port in &mut self.ports {
                port.accessed(access, at, &mut outputs);
            }
        }
        let now = self.now();
        for port in &mut self.ports {
            port.send(now, &mut outputs);
            port.show_sending(&mut self.qemu, now);
        }
        outputs
    }

    /// What its transceivers have heard; on `began` a character has just begun.
    pub fn hear(&mut self, hosts: &mut [Host], began: &[HostId]) {
        for port in &mut self.ports {
            for byte in hosts[port.host.0].take() {
                port.deliver(&mut self.qemu, byte);
            }
            if began.contains(&port.host) {
                self.qemu.falling_edge(port.usart.exti);
            }
        }
    }
}

impl Port {
    fn accessed(&mut self, access: Access, at: Time, outputs: &mut Vec<MachineOutput>) {
        let Some(value) = access.stored else {
            if access.address == self.usart.base + DR {
                self.received &= !RXNE;
            }
            return;
        };
        if access.address == GPIOA_BSRR {
            outputs.extend(self.driven(value, at));
            return;
        }
        if access.address == AIRCR {
            let resets = value & !0xFFFF == VECTKEY && value & SYSRESETREQ != 0;
            if resets {
                outputs.extend(self.reset(at));
            }
            return;
        }
        let Some(register) = access.address.checked_sub(self.usart.base) else {
            return;
        };
        match register {
            DR => {
                self.send(at, outputs);
                self.transmitter.put(at, value as u8);
                self.send(at, outputs);
                // QEMU says that it has left already.
                self.sending |= TC;
                return;
            }
            BRR => self.brr = value,
            CR1 => self.cr1 = value,
            CR2 => self.cr2 = value,
            _ => return,
        }
        let line = self.line();
        outputs.extend(line.map(|line| MachineOutput::Line(self.host, line)));
    }

    /// DE, if this is a port that has it.
    fn driven(&self, value: u32, at: Time) -> Option<MachineOutput> {
        // The lower half sets, the upper half resets, and setting has priority.
        let bit = self.usart.de?;
        let sets = value >> bit & 1 != 0;
        let resets = value >> (16 + bit) & 1 != 0;
        (sets || resets).then_some(MachineOutput::Drive(self.host, at, sets))
    }

    /// The chip is reset, which QEMU does by itself with all that it knows of. Its pins float, and DE is pulled down.
    fn reset(&mut self, at: Time) -> Option<MachineOutput> {
        (self.brr, self.cr1, self.cr2) = (0, 0, 0);
        self.transmitter = Transmitter::default();
        (self.sending, self.received) = (TXE | TC, 0);
        self.usart.de?;
        Some(MachineOutput::Drive(self.host, at, false))
    }

    /// Puts on the wire what begins there until `now`.
    fn send(&mut self, now: Time, outputs: &mut Vec<MachineOutput>) {
        let Some(line) = self.line() else {
            return;
        };
        let begun = self.transmitter.advance(now, line.character());
        outputs.extend(begun.map(|(at, byte)| MachineOutput::Byte(self.host, at, byte)));
    }

    /// Puts the transmitter's flags into SR. QEMU takes a value of more than ten bits for a mask of what stays.
    fn show_sending(&mut self, qemu: &mut Qemu, now: Time) {
        let flags = self.transmitter.flags(now);
        let (set, clear) = (flags & !self.sending, self.sending & !flags);
        self.sending = flags;
        if set != 0 {
            self.show(qemu);
        } else if clear != 0 {
            qemu.write(self.usart.base + SR, !clear);
        }
    }

    /// Puts all flags into SR. With any of them QEMU sets TXE.
    fn show(&self, qemu: &mut Qemu) {
        qemu.write(self.usart.base + SR, self.sending | self.received);
        if self.sending & TXE == 0 {
            qemu.write(self.usart.base + SR, !TXE);
        }
    }

    /// Rate and format as they are set, if they are.
    fn line(&self) -> Option<Line> {
        line_of(self.usart.clock_hz, self.brr, self.cr1, self.cr2)
    }

    fn deliver(&mut self, qemu: &mut Qemu, byte: RxByte) {
        // Receiver and USART are on (RM0090 30.6.4: RE, UE).
        if self.cr1 & 1 << 2 == 0 || self.cr1 & 1 << 13 == 0 {
            return;
        }
        if self.received & RXNE != 0 {
            self.overruns += 1;
            self.received |= ORE;
            return self.show(qemu);
        }
        if self.received != 0 {
            self.received = 0;
            self.show(qemu);
        }
        qemu.deliver(self.serial, self.usart.base, byte.value);
        self.received = RXNE;
        if byte.framing_error {
            self.received |= FE;
        }
        if byte.parity_error {
            self.received |= PE;
        }
        if self.received != RXNE {
            self.show(qemu);
        }
    }
}
