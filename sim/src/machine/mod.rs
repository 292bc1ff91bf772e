//! An STM32F405 on the bus: four ports, each on a wire of its own or with others.
//!
//! There are two that run its firmware ([`Emulator`]): QEMU, which is well known and takes images that are built for it, and a
//! core in this process, which takes the images that are flashed and has the chip's clocks, pins, timers and USARTs.

mod child;
mod core;
mod lockstep;
mod parts;
mod qemu;
mod transmitter;

use std::path::PathBuf;

use self::core::Output;
pub use self::core::{Cause, Silicon};
use crate::bus::WireId;
use crate::error::BusError;
use crate::host::{Host, HostPort};
use crate::line::{Format, Line, Parity};
use crate::record::{HostId, Station};
use crate::repository::repository;
use crate::time::Time;
use lockstep::Lockstep;
pub use parts::{Instructions, Parts};

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
    /// What runs it.
    pub emulator: Emulator,
    /// The wires of AS1, AS2, RS2 and RS4.
    pub wires: [Option<WireId>; 4],
}

/// What runs an STM32's firmware.
#[derive(Clone, Debug)]
pub enum Emulator {
    /// QEMU, with an image that is built for it.
    Qemu {
        /// The barrier of `qemu/barrier.c`, compiled.
        plugin: PathBuf,
    },
    /// A core in this process, with an image that is flashed.
    Core {
        /// Unicorn's shared library.
        library: PathBuf,
        /// How far the crystal is off, in parts per million; positive is too fast.
        clock_ppm: i32,
        /// What TIM5 counts from when the firmware switches it on, in place of 0.
        count: u32,
    },
}

impl Emulator {
    /// QEMU, with the barrier where set-up has put it.
    ///
    /// # Errors
    /// [`BusError::Machine`] if it is not there.
    pub fn qemu() -> Result<Self, BusError> {
        let path = repository().map(|root| root.join("target/qemu/barrier.so"));
        let plugin = path.filter(|path| path.is_file());
        let plugin = plugin.ok_or_else(|| BusError::Machine {
            reason: "target/qemu/barrier.so is missing: cargo xtask setup builds it".to_owned(),
        })?;
        Ok(Emulator::Qemu { plugin })
    }

    /// The core, with Unicorn's library where set-up has put it. The crystal is exact, and the counter begins at 0.
    ///
    /// # Errors
    /// [`BusError::Machine`] if it is not there.
    pub fn core() -> Result<Self, BusError> {
        let library = repository().and_then(|root| self::core::library(&root));
        let library = library.ok_or_else(|| BusError::Machine {
            reason: "Unicorn is not in target/python: cargo xtask setup installs it".to_owned(),
        })?;
        Ok(Emulator::Core {
            library,
            clock_ppm: 0,
            count: 0,
        })
    }
}

/// The ports' names.
const NAMES: [&str; 4] = ["AS1", "AS2", "RS2", "RS4"];
/// The one with a DE pin.
const WITH_DE: usize = 3;

/// Bits of a USART's SR (RM0090 30.6.1).
const PE: u32 = 1 << 0;
const FE: u32 = 1 << 1;
const NF: u32 = 1 << 2;
const ORE: u32 = 1 << 3;
const RXNE: u32 = 1 << 5;
const TC: u32 = 1 << 6;
const TXE: u32 = 1 << 7;
const CTS: u32 = 1 << 9;

/// Rate and format as registers of a USART with this clock say, if they say any.
fn line_of(clock_hz: u32, brr: u32, cr1: u32, cr2: u32) -> Option<Line> {
    let bit = |register: u32, bit: u32| register >> bit & 1 != 0;
    // RM0090 30.3.4: with eight samples the fraction has three bits.
    let (divisor, factor) = match bit(cr1, 15) {
        true => ((brr & !0xF) + (brr & 7) * 2, 2),
        false => (brr, 1),
    };
    let baud = (clock_hz * factor + divisor / 2).checked_div(divisor)?;
    let parity = match (bit(cr1, 10), bit(cr1, 9)) {
        (false, _) => Parity::None,
        (true, false) => Parity::Even,
        (true, true) => Parity::Odd,
    };
    Some(Line {
        baud,
        format: Format {
            data_bits: 8 + u8::from(bit(cr1, 12)) - u8::from(bit(cr1, 10)),
            parity,
            stop_bits: if bit(cr2, 13) { 2 } else { 1 },
        },
    })
}

/// What a machine did.
pub(crate) enum MachineOutput {
    Line(HostId, Line),
    Byte(HostId, Time, u8),
    Drive(HostId, Time, bool),
    Listen(HostId, bool),
    Cut(HostId, Time),
}

/// Where a port is.
#[derive(Clone, Copy)]
struct Connected {
    port: usize,
    host: HostId,
    wire: WireId,
}

enum Runs {
    Qemu(Box<Lockstep>),
    Core(Box<Silicon>),
}

/// An STM32F405 on the bus.
pub struct Machine {
    name: String,
    ports: Vec<Connected>,
    parts: Parts,
    clock_ppm: i32,
    runs: Runs,
}

impl Machine {
    pub(crate) fn new(stm32: Stm32, parts: Parts, now: Time) -> Result<Self, BusError> {
        let image = &stm32.image;
        let runs = match &stm32.emulator {
            Emulator::Qemu { plugin } => {
                Runs::Qemu(Box::new(Lockstep::new(image, plugin, &parts, now)?))
            }
            Emulator::Core {
                library,
                clock_ppm,
                count,
            } => {
                let silicon = Silicon::new(library, image, now, *clock_ppm, *count)?;
                Runs::Core(Box::new(silicon))
            }
        };
        let clock_ppm = match stm32.emulator {
            Emulator::Qemu { .. } => 0,
            Emulator::Core { clock_ppm, .. } => clock_ppm,
        };
        Ok(Machine {
            name: stm32.name,
            ports: Vec::new(),
            parts,
            clock_ppm,
            runs,
        })
    }

    /// The transceiver of a port, until the firmware sets it up.
    pub(crate) fn host_port(&self, port: usize) -> HostPort {
        HostPort {
            name: format!("{} {}", self.name, NAMES[port]),
            has_driver_pin: port == WITH_DE,
            clock_ppm: self.clock_ppm,
            ..HostPort::new(Line::n81(38_400))
        }
    }

    pub(crate) fn connect(&mut self, port: usize, host: HostId, wire: WireId) {
        self.ports.push(Connected { port, host, wire });
        match &mut self.runs {
            Runs::Qemu(qemu) => qemu.connect(port, host),
            // An undriven wire is at the mark.
            Runs::Core(silicon) => silicon.receive(port, true),
        }
    }

    /// The name of the machine.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Why it has stopped, if it has, in QEMU: its process has died, or hangs. Its time passes on, and it does nothing.
    pub fn failure(&self) -> Option<&str> {
        match &self.runs {
            Runs::Qemu(qemu) => qemu.failure(),
            Runs::Core(_) => None,
        }
    }

    /// Instructions executed since it was powered up.
    pub fn instructions(&self) -> u64 {
        self.counted().all
    }

    /// Instructions since it was powered up. Idle and marked ones are known where it was put on the bus with
    /// [`add_stm32_in_parts`](crate::Bus::add_stm32_in_parts), in QEMU.
    pub fn counted(&self) -> Instructions {
        match &self.runs {
            Runs::Qemu(qemu) => qemu.counted(),
            Runs::Core(silicon) => Instructions {
                all: silicon.instructions(),
                ..Instructions::default()
            },
        }
    }

    /// How many instructions interrupts took that began with this handler, each by itself and in their order: those that came while it waited
    /// for work, or right behind another one that did. Known in QEMU.
    pub fn interrupts(&self, handler: &str) -> Vec<u64> {
        let Runs::Qemu(qemu) = &self.runs else {
            return Vec::new();
        };
        let known = self.parts.named.iter().find(|(name, _)| name == handler);
        let ended = qemu.interrupts().iter();
        ended
            .filter(|(address, _)| known.is_some_and(|(_, begin)| begin == address))
            .map(|&(_, length)| length)
            .collect()
    }

    /// What there is of a chip, where it is not QEMU's.
    pub fn silicon(&mut self) -> Option<&mut Silicon> {
        match &mut self.runs {
            Runs::Qemu(_) => None,
            Runs::Core(silicon) => Some(silicon),
        }
    }

    /// The station that a port is on its wire; 0 to 3 are AS1, AS2, RS2, RS4. `None` if it is on no wire.
    pub fn station(&self, port: usize) -> Option<Station> {
        let found = self.ports.iter().find(|known| known.port == port);
        found.map(|known| Station::Host(known.host))
    }

    /// Characters that were lost on a port because the firmware had not read the one before.
    pub fn overruns(&self, port: usize) -> u64 {
        match &self.runs {
            Runs::Qemu(qemu) => qemu.overruns(port),
            Runs::Core(silicon) => silicon.overruns(port),
        }
    }

    pub(crate) fn now(&self) -> Time {
        match &self.runs {
            Runs::Qemu(qemu) => qemu.now(),
            Runs::Core(silicon) => silicon.now(),
        }
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

    /// Whether it sees every edge of its wires, and not only where characters begin.
    pub(crate) fn sees_edges(&self) -> bool {
        matches!(self.runs, Runs::Core(_))
    }

    /// Runs to `limit`, or to where it has something to tell.
    pub(crate) fn run_to(&mut self, limit: Time) -> Vec<MachineOutput> {
        match &mut self.runs {
            Runs::Qemu(qemu) => qemu.run_to(limit),
            Runs::Core(silicon) => {
                let outputs = silicon.run_to(limit);
                let ports = &self.ports;
                outputs
                    .into_iter()
                    .filter_map(|one| told(ports, one))
                    .collect()
            }
        }
    }

    /// What its transceivers have heard; where a character has just begun, and edges as they have just come.
    pub(crate) fn hear(&mut self, hosts: &mut [Host], began: &[HostId], edges: &[(HostId, bool)]) {
        let silicon = match &mut self.runs {
            Runs::Qemu(qemu) => return qemu.hear(hosts, began),
            Runs::Core(silicon) => silicon,
        };
        for known in &self.ports {
            for (_, level) in edges.iter().filter(|(host, _)| *host == known.host) {
                silicon.receive(known.port, *level);
            }
            for byte in hosts[known.host.0].take() {
                silicon.deliver(known.port, byte);
            }
        }
    }
}

/// The events of a port and its wire; a port without a wire is not received.
fn told(ports: &[Connected], output: Output) -> Option<MachineOutput> {
    let host = |port: usize| {
        let found = ports.iter().find(|known| known.port == port);
        found.map(|known| known.host)
    };
    Some(match output {
        Output::Line(port, line) => MachineOutput::Line(host(port)?, line),
        Output::Byte(port, at, byte) => MachineOutput::Byte(host(port)?, at, byte),
        Output::Drive(port, at, on) => MachineOutput::Drive(host(port)?, at, on),
        Output::Listen(port, on) => MachineOutput::Listen(host(port)?, on),
        Output::Cut(port, at) => MachineOutput::Cut(host(port)?, at),
    })
}
