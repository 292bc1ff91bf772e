//! An STM32F405 on the bus: four ports, each on a wire of its own or with others.
//!
//! It runs in QEMU, which knows the registers of its USARTs but neither bauds nor pins. Both are made up for here: what the
//! firmware writes to a data register goes on the wire at the rate and in the format that it has set, and TXE and TC are set
//! when there is room for more and when all has left; what comes from the wire is put into the register when its first stop bit
//! is judged, with its error flags. The beginning of a character is a falling edge for the external interrupt controller. DE is
//! the pin that the firmware sets.
//!
//! Time is exact to the instruction: each takes 8 ns, whatever it does. That is not what each takes in silicon.

mod child;
mod parts;
mod qemu;
mod transmitter;

use std::path::PathBuf;

use crate::bus::WireId;
use crate::error::BusError;
use crate::host::{Host, HostPort, RxByte};
use crate::line::{Format, Line, Parity};
use crate::record::{HostId, Station};
use crate::repository::repository;
use crate::time::{Clock, Time};
pub use parts::{Instructions, Parts};
use qemu::{Access, Qemu};
use transmitter::Transmitter;

/// An STM32 on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MachineId(pub(crate) usize);

/// How to put an STM32 on the bus.
#[derive(Clone, Debug)]
pub struct Stm32 {
    /// Its name in messages.
    pub name: String,
    /// The firmware: an ELF file.
    pub image: PathBuf,
    /// The barrier of `qemu/barrier.c`, compiled: [`barrier`].
    pub plugin: PathBuf,
    /// The wires of AS1, AS2, RS2 and RS4.
    pub wires: [Option<WireId>; 4],
}

/// The barrier, where set-up has put it.
///
/// # Errors
/// [`BusError::Machine`] if it is not there.
pub fn barrier() -> Result<PathBuf, BusError> {
    let path = repository().map(|root| root.join("target/qemu/barrier.so"));
    let path = path.filter(|path| path.is_file());
    path.ok_or_else(|| BusError::Machine {
        reason: "target/qemu/barrier.so is missing: cargo xtask setup builds it".to_owned(),
    })
}

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
        clock_hz: 84_000_000,
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

/// Bits of SR.
const PE: u32 = 1 << 0;
const FE: u32 = 1 << 1;
const ORE: u32 = 1 << 3;
const RXNE: u32 = 1 << 5;
const TC: u32 = 1 << 6;
const TXE: u32 = 1 << 7;

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
    wire: WireId,
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

/// What a machine did.
pub(crate) enum MachineOutput {
    Line(HostId, Line),
    Byte(HostId, Time, u8),
    Drive(HostId, Time, bool),
}

/// An STM32F405 in QEMU.
pub struct Machine {
    name: String,
    qemu: Qemu,
    clock: Clock,
    /// When it was powered up.
    since: Time,
    ports: Vec<Port>,
    parts: Parts,
}

impl Machine {
    pub(crate) fn new(stm32: Stm32, parts: Parts, now: Time) -> Result<Self, BusError> {
        let mut watched: Vec<_> = USARTS.iter().map(|u| (u.base, u.base + CR3)).collect();
        watched.push((GPIOA_BSRR, GPIOA_BSRR));
        watched.push((AIRCR, AIRCR));
        let stops: Vec<_> = USARTS.iter().map(|u| u.base + DR).collect();
        let (image, plugin) = (&stm32.image, &stm32.plugin);
        let qemu = Qemu::start(image, plugin, USARTS.len(), &watched, &stops, &parts)?;
        Ok(Machine {
            name: stm32.name,
            qemu,
            clock: Clock::new(INSTRUCTIONS_HZ, 0),
            since: now,
            ports: Vec::new(),
            parts,
        })
    }

    /// The transceiver of a port, until the firmware sets it up.
    pub(crate) fn host_port(&self, port: usize) -> HostPort {
        let names = ["AS1", "AS2", "RS2", "RS4"];
        HostPort {
            name: format!("{} {}", self.name, names[port]),
            has_driver_pin: USARTS[port].de.is_some(),
            ..HostPort::new(Line::n81(38_400))
        }
    }

    pub(crate) fn connect(&mut self, port: usize, host: HostId, wire: WireId) {
        self.ports.push(Port {
            usart: &USARTS[port],
            serial: port,
            host,
            wire,
            brr: 0,
            cr1: 0,
            cr2: 0,
            transmitter: Transmitter::default(),
            sending: TXE | TC,
            received: 0,
            overruns: 0,
        });
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Why it has stopped, if it has: its process has died, or hangs. Its time passes on, and it does nothing.
    pub fn failure(&self) -> Option<&str> {
        self.qemu.failure()
    }

    /// Instructions executed since it was powered up.
    pub fn instructions(&self) -> u64 {
        self.qemu.count()
    }

    /// The station that a port is on its wire; 0 to 3 are AS1, AS2, RS2, RS4. `None` if it is on no wire.
    pub fn station(&self, port: usize) -> Option<Station> {
        let found = self.ports.iter().find(|known| known.serial == port);
        found.map(|port| Station::Host(port.host))
    }

    /// Characters that were lost on a port because the firmware had not read the one before.
    pub fn overruns(&self, port: usize) -> u64 {
        let found = self.ports.iter().find(|known| known.serial == port);
        found.map_or(0, |port| port.overruns)
    }

    pub(crate) fn now(&self) -> Time {
        self.since + self.clock.time(self.qemu.count())
    }

    pub(crate) fn hosts(&self) -> impl Iterator<Item = HostId> {
        self.ports.iter().map(|port| port.host)
    }

    pub(crate) fn is(&self, station: Station) -> bool {
        self.hosts().any(|host| Station::Host(host) == station)
    }

    pub(crate) fn is_on(&self, wire: WireId) -> bool {
        self.ports.iter().any(|port| port.wire == wire)
    }

    /// Runs to `limit`, or to where a character is handed to a transmitter or leaves it.
    pub(crate) fn run_to(&mut self, limit: Time) -> Vec<MachineOutput> {
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
    pub(crate) fn hear(&mut self, hosts: &mut [Host], began: &[HostId]) {
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
        let bit = |register: u32, bit: u32| register >> bit & 1 != 0;
        // RM0090 30.3.4: with eight samples the fraction has three bits.
        let (divisor, factor) = match bit(self.cr1, 15) {
            true => ((self.brr & !0xF) + (self.brr & 7) * 2, 2),
            false => (self.brr, 1),
        };
        let baud = (self.usart.clock_hz * factor + divisor / 2).checked_div(divisor)?;
        let parity = match (bit(self.cr1, 10), bit(self.cr1, 9)) {
            (false, _) => Parity::None,
            (true, false) => Parity::Even,
            (true, true) => Parity::Odd,
        };
        Some(Line {
            baud,
            format: Format {
                data_bits: 8 + u8::from(bit(self.cr1, 12)) - u8::from(bit(self.cr1, 10)),
                parity,
                stop_bits: if bit(self.cr2, 13) { 2 } else { 1 },
            },
        })
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
