//! The record of a wire.

use std::fmt;

use crate::gpio::{Level, Pin};
use crate::line::Format;
use crate::time::Time;

/// A station: a node or a host, in the order they were put on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Station {
    /// A node on the bus.
    Node(NodeId),
    /// A host on the bus.
    Host(HostId),
}

/// A node on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeId(pub(crate) usize);

/// A host on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct HostId(pub(crate) usize);

impl fmt::Display for Station {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Station::Node(id) => write!(f, "node {}", id.0),
            Station::Host(id) => write!(f, "host {}", id.0),
        }
    }
}

/// A character that a station sent, and its state on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WireByte {
    /// The station that sent it.
    pub from: Station,
    /// The time at which the start bit begins.
    pub start: Time,
    /// The time at which the last stop bit ends.
    pub end: Time,
    /// The value that was sent.
    pub sent: u16,
    /// The value that a receiver with the sender's clock and format reads.
    pub value: u16,
    /// The levels that it reads, in the order of the wire, the start bit in bit 0.
    pub bits: u16,
    /// Whether it reads a stop bit that is low.
    pub framing_error: bool,
    /// Whether it reads wrong parity.
    pub parity_error: bool,
    /// Whether the driver was off at the start bit, so that nothing of it may be on the wire.
    pub lost: bool,
    /// The time at which the driver went off inside the character, if it did.
    pub truncated: Option<Time>,
    /// Whether another driver was on with another level.
    pub conflict: bool,
}

impl WireByte {
    /// Whether it was on the wire as it was sent.
    pub fn is_good(&self) -> bool {
        self.value == self.sent
            && !(self.framing_error
                || self.parity_error
                || self.lost
                || self.conflict
                || self.truncated.is_some())
    }

    /// Whether a receiver of this format, with the sender's clock, finds its parity and its first stop bit right.
    pub fn fits(&self, format: Format) -> bool {
        let decoded = format.decode(self.bits);
        !decoded.parity_error && !decoded.framing_error
    }
}

impl fmt::Display for WireByte {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:>16}  {}  {:02x}",
            self.start.to_string(),
            self.from,
            self.value
        )?;
        if self.value != self.sent {
            write!(f, " (sent {:02x})", self.sent)?;
        }
        for (set, name) in [
            (self.framing_error, "framing"),
            (self.parity_error, "parity"),
            (self.lost, "lost: driver off"),
            (self.truncated.is_some(), "truncated: driver off"),
            (self.conflict, "conflict"),
        ] {
            if set {
                write!(f, "  {name}")?;
            }
        }
        Ok(())
    }
}

/// A node's driver was switched on or off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeEdge {
    /// The station whose driver was switched.
    pub from: Station,
    /// The time of the event.
    pub time: Time,
    /// Whether the driver is on.
    pub on: bool,
}

/// An edge of a watched pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinEdge {
    /// The node of the pin.
    pub node: NodeId,
    /// The pin that has changed.
    pub pin: Pin,
    /// The time of the event.
    pub time: Time,
    /// The state of the pin from now on.
    pub level: Level,
}

/// A conflict: two drivers drive different levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conflict {
    /// The time of the event.
    pub time: Time,
    /// A station that drives the wire low.
    pub low: Station,
    /// A station that drives it high.
    pub high: Station,
    /// The end of the conflict, `None` while it lasts. The wire is held low for longer
    /// ([`crate::BusConfig::conflict_hold`]).
    pub end: Option<Time>,
}

/// A change of the level that a station gives to its driver (a node's TXD), whether the driver is on or not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DataEdge {
    /// The station that drives.
    pub from: Station,
    /// The time of the event.
    pub time: Time,
    /// The level from then on; true is the mark, the idle level.
    pub level: bool,
}

/// An edge of the wire itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WireEdge {
    /// The time of the event.
    pub time: Time,
    /// The level from then on; true is the mark, the idle level.
    pub level: bool,
}

/// All events since the bus was made or the record was cleared, in the order of time (characters in the order of
/// their ends).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Record {
    pub(crate) bytes: Vec<WireByte>,
    pub(crate) de: Vec<DeEdge>,
    pub(crate) pins: Vec<PinEdge>,
    pub(crate) conflicts: Vec<Conflict>,
    pub(crate) wire: Vec<WireEdge>,
    pub(crate) data: Vec<DataEdge>,
    pub(crate) since: Time,
}

impl Record {
    /// The characters sent.
    pub fn bytes(&self) -> &[WireByte] {
        &self.bytes
    }

    /// The characters that one station sent.
    pub fn sent_by(&self, station: Station) -> impl Iterator<Item = &WireByte> {
        self.bytes.iter().filter(move |byte| byte.from == station)
    }

    /// The edges of all drivers' DE.
    pub fn de_edges(&self) -> &[DeEdge] {
        &self.de
    }

    /// The edges of watched pins.
    pub fn pin_edges(&self) -> &[PinEdge] {
        &self.pins
    }

    /// The conflicts of drivers.
    pub fn conflicts(&self) -> &[Conflict] {
        &self.conflicts
    }

    /// The time at which the record begins.
    pub fn since(&self) -> Time {
        self.since
    }

    /// The edges that stations gave to their drivers.
    pub fn data_edges(&self) -> &[DataEdge] {
        &self.data
    }

    /// The edges of the wire.
    pub fn wire_edges(&self) -> &[WireEdge] {
        &self.wire
    }
}

impl fmt::Display for Record {
    /// One line for each character, DE edge and conflict.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut lines: Vec<(Time, String)> = Vec::new();
        lines.extend(self.bytes.iter().map(|byte| (byte.start, byte.to_string())));
        lines.extend(self.de.iter().map(|edge| {
            let state = if edge.on { "on" } else { "off" };
            let station = edge.from;
            (
                edge.time,
                format!("{:>16}  {station}  DE {state}", edge.time.to_string()),
            )
        }));
        lines.extend(self.conflicts.iter().map(|conflict| {
            let (time, low, high) = (conflict.time, conflict.low, conflict.high);
            (
                time,
                format!("{:>16}  conflict: {low} low, {high} high", time.to_string()),
            )
        }));
        lines.sort_by_key(|(time, _)| *time);
        for (_, line) in lines {
            writeln!(f, "{line}")?;
        }
        Ok(())
    }
}
