//! A simulated RS-485 bus, cycle by cycle: ATmega328P nodes with the firmware images that are flashed, and hosts
//! without firmware, on one half-duplex wire.
//!
//! The instruction core is simavr's; USART0, Timer1, EEPROM, ports, interrupt timing and sleep are modelled after the
//! data sheet (Microchip DS40002061B). An STM32F405 runs in QEMU or on Unicorn's core ([`Emulator`]). Equal inputs
//! give equal records: nothing depends on the machine's time or scheduling.
//!
//! ```no_run
//! use multidrop_bus::{Bus, BusConfig, HostPort, Line, Nano, Pin, Time};
//!
//! # fn main() -> Result<(), multidrop_bus::BusError> {
//! let mut bus = Bus::new(BusConfig::default());
//! let node = bus.add_nano(Nano::new("unit 1", "target/firmware/nano-demo-unit.elf"))?;
//! let host = bus.add_host(HostPort::new(Line::n81(38_400)));
//! bus.run_for(Time::from_ms(20));
//!
//! let request = [0x01, 0x03, 0x00, 0x00, 0x00, 0x01, 0x84, 0x0a];
//! if let Some(answer) = bus.transact(host, &request, Time::from_ms(100)) {
//!     println!("{:02x?} after {}", answer.bytes, answer.turnaround());
//! }
//! println!("{:?}\n{}", bus.node(node).port_state('D'), bus.record());
//! # Ok(())
//! # }
//! ```

mod bus;
mod eeprom;
mod elf;
mod error;
mod faults;
mod ffi;
mod frames;
mod gpio;
mod host;
mod line;
mod live;
mod machine;
mod node;
mod peripherals;
mod record;
mod repository;
mod time;
mod timer1;
mod usart;
mod vcd;
mod watchdog;
mod wire;

pub use bus::{Answer, Bus, BusConfig, WireId};
pub use eeprom::{Misuse, MisuseKind};
pub use elf::DataSymbol;
pub use error::BusError;
pub use faults::{Campaign, Damage, Fault, Random, received};
pub use frames::{Frame, Framing, framed, frames, with_crc};
pub use gpio::{Level, Pin};
pub use host::{Host, HostPort, RxByte, Tx};
pub use line::{Format, Line, Parity};
pub use live::{Behind, Live, LiveError};
pub use machine::{Cause, Emulator, Instructions, Machine, MachineId, Parts, Silicon, Stm32};
pub use node::{Nano, Node, Stats, VECTORS, VectorStats};
pub use record::{
    Conflict, DataEdge, DeEdge, HostId, NodeId, PinEdge, Record, Station, WireByte, WireEdge,
};
pub use repository::repository;
pub use time::{Clock, Time};
pub use usart::TxPhase;
