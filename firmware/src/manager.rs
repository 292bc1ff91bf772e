//! The port manager: owns all ports of an application, and loads and reads the registers of each by name or by
//! position.
//!
//! The ports of an application are a `const` table of [`PortConfig`], which [`table`] checks. The types of the ports
//! differ; the manager knows each port as a [`Managed`].
//!
//! ```
//! use multidrop::PortConfig;
//! use multidrop::manager::{self, Managed, Manager, ManagerError};
//! use multidrop::protocol::port_registers::Value;
//!
//! const PORTS: [PortConfig; 2] = manager::table([
//!     PortConfig::new("AS1").slave_id(17),
//!     PortConfig::new("RS4").client(),
//! ]);
//!
//! /// The ports are of type `ManagedPort`, opened with `PORTS[0]` and `PORTS[1]`.
//! fn set_up(as1: &'static dyn Managed, rs4: &'static dyn Managed) -> Result<(), ManagerError<'static>> {
//!     let manager = Manager::new([as1, rs4]);
//!     manager.load("RS4", Value::Baud(9600))?; // LOAD(MB_RS4_BAUD, 9600)
//!     manager.load(0, Value::SlaveId(18))
//! }
//! ```

use core::fmt;

use multidrop_protocol::message::Message;
use multidrop_protocol::port_registers::{PortRegisters, Refused, Register, Value};
use multidrop_protocol::registers::{Items, Rules};

use crate::config::PortConfig;
use crate::line::Line;
use crate::managed::ManagedPort;

/// A port that a [`Manager`] can load and read.
pub trait Managed {
    /// The port's name, such as `"RS4"`.
    fn name(&self) -> &'static str;

    /// Loads a register with a number, see [`ManagedPort::load_raw`].
    ///
    /// # Errors
    /// [`Refused`]: the register keeps its old value.
    fn load_raw(&self, register: Register, value: u32) -> Result<(), Refused>;

    /// Reads a register, see [`ManagedPort::read`].
    ///
    /// # Errors
    /// [`Refused`] for an element that an array does not have.
    fn read(&self, register: Register) -> Result<u32, Refused>;
}

impl<L, R, C, V, D, const N: usize> Managed for ManagedPort<L, PortRegisters<R, C, V>, D, N>
where
    L: Line + 'static,
    R: Items<Item = u16>,
    C: Items<Item = bool>,
    V: Rules,
{
    fn name(&self) -> &'static str {
        ManagedPort::name(self)
    }

    fn load_raw(&self, register: Register, value: u32) -> Result<(), Refused> {
        ManagedPort::load_raw(self, register, value)
    }

    fn read(&self, register: Register) -> Result<u32, Refused> {
        ManagedPort::read(self, register)
    }
}

/// Names a port: by its name, or by its position in the table, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Selector<'a> {
    /// The name, in capitals as in the table.
    Name(&'a str),
    /// The position in the table, from 0.
    Place(usize),
}

impl<'a> From<&'a str> for Selector<'a> {
    fn from(name: &'a str) -> Self {
        Self::Name(name)
    }
}

impl From<usize> for Selector<'_> {
    fn from(place: usize) -> Self {
        Self::Place(place)
    }
}

/// Why a register was not loaded or read. Nothing was changed. The caller is to blame. The message names the port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ManagerError<'a> {
    /// There is no such port.
    NoPort {
        /// The port that was asked for.
        port: Selector<'a>,
        /// The number of ports of the manager.
        ports: usize,
    },
    /// The port refused the load or read.
    Refused {
        /// The port's name.
        port: &'static str,
        /// Register, value, and the values that are accepted.
        refused: Refused,
    },
}

impl fmt::Display for ManagerError<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoPort {
                port: Selector::Name(name),
                ports,
            } => write!(f, "no port named {name} ({ports} ports)"),
            Self::NoPort {
                port: Selector::Place(place),
                ports,
            } => write!(f, "no port number {place}, must be below {ports}"),
            Self::Refused { port, refused } => write!(f, "port {port}: {refused}"),
        }
    }
}

impl core::error::Error for ManagerError<'_> {}

/// The `N` ports of an application.
pub struct Manager<const N: usize> {
    ports: [&'static dyn Managed; N],
}

impl<const N: usize> Manager<N> {
    /// A manager of these ports, in the order of their table.
    pub const fn new(ports: [&'static dyn Managed; N]) -> Self {
        Self { ports }
    }

    /// The port with this name or position, or `None`.
    pub fn port<'a>(&self, port: impl Into<Selector<'a>>) -> Option<&'static dyn Managed> {
        match port.into() {
            Selector::Name(name) => self.ports.iter().copied().find(|port| port.name() == name),
            Selector::Place(place) => self.ports.get(place).copied(),
        }
    }

    /// Loads a register of one port with a value of its type. The other ports and their tasks are not affected.
    ///
    /// # Errors
    /// [`ManagerError`], which names the port. The register keeps its old value.
    pub fn load<'a>(
        &self,
        port: impl Into<Selector<'a>>,
        value: Value,
    ) -> Result<(), ManagerError<'a>> {
        self.load_raw(port, value.register(), value.number())
    }

    /// Loads a register of one port with a number, as it is on the wire.
    ///
    /// # Errors
    /// [`ManagerError`], which names the port. The register keeps its old value.
    pub fn load_raw<'a>(
        &self,
        port: impl Into<Selector<'a>>,
        register: Register,
        value: u32,
    ) -> Result<(), ManagerError<'a>> {
        self.with(port.into(), |port| port.load_raw(register, value))
    }

    /// Reads a register of a port.
    ///
    /// # Errors
    /// [`ManagerError`], which names the port.
    pub fn read<'a>(
        &self,
        port: impl Into<Selector<'a>>,
        register: Register,
    ) -> Result<u32, ManagerError<'a>> {
        self.with(port.into(), |port| port.read(register))
    }

    fn with<'a, R>(
        &self,
        selector: Selector<'a>,
        f: impl FnOnce(&dyn Managed) -> Result<R, Refused>,
    ) -> Result<R, ManagerError<'a>> {
        let Some(port) = self.port(selector) else {
            return Err(ManagerError::NoPort {
                port: selector,
                ports: N,
            });
        };
        f(port).map_err(|refused| ManagerError::Refused {
            port: port.name(),
            refused,
        })
    }
}

/// Checks a table of ports, for use in a `const`.
///
/// # Panics
/// At compile time, with the name, if two ports have the same name.
pub const fn table<const N: usize>(ports: [PortConfig; N]) -> [PortConfig; N] {
    let mut port = 0;
    while port < N {
        let mut other = port + 1;
        while other < N {
            if same(ports[port].name(), ports[other].name()) {
                Message::new()
                    .text("port ")
                    .text(ports[port].name())
                    .text(": two ports in the table have this name")
                    .fail();
            }
            other += 1;
        }
        port += 1;
    }
    ports
}

const fn same(one: &str, other: &str) -> bool {
    let (one, other) = (one.as_bytes(), other.as_bytes());
    if one.len() != other.len() {
        return false;
    }
    let mut at = 0;
    while at < one.len() {
        if one[at] != other[at] {
            return false;
        }
        at += 1;
    }
    true
}
