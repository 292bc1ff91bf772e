//! What happened on the wire.

use std::fmt;

use crate::gpio::{Level, Pin};
use crate::line::Format;
use crate::time::Time;

/// A station: a node or a host, in the order they were put on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Station {
    /// A node.
    Node(NodeId),
    /// A host.
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

/// A character that a station sent, and what became of it on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WireByte {
    /// Who sent it.
    pub from: Station,
    /// The start bit begins.
    pub start: Time,
    /// The last stop bit ends.
    pub end: Time,
    /// What was sent.
    pub sent: u16,
    /// What a receiver with the sender's clock and format reads off the wire.
    pub value: u16,
    /// The levels that it reads, in the order of the wire, the start bit in bit 0.
    pub bits: u16,
    /// It reads a stop bit that is low.
    pub framing_error: bool,
    /// It reads the wrong parity.
    pub parity_error: bool,
    /// The driver was off at the start bit: nothing of it may be on the wire.
    pub lost: bool,
    /// When the driver went off inside the character, if it did.
    pub truncated: Option<Time>,
    /// Another driver was on at the same time with another level.
    pub conflict: bool,
}

impl WireByte {
    /// Whether it reached the wire as it was sent.
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

/// A node's driver switched on or off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeEdge {
    /// Whose.
    pub from: Station,
    /// When.
    pub time: Time,
    /// On or off.
    pub on: bool,
}

/// An edge of a watched pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinEdge {
    /// Whose.
    pub node: NodeId,
    /// Which.
    pub pin: Pin,
    /// When.
    pub time: Time,
    /// What it does from now on.
    pub level: Level,
}

/// Two drivers began to disagree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conflict {
    /// When.
    pub time: Time,
    /// A station that drives the wire low.
    pub low: Station,
    /// A station that drives it high.
    pub high: Station,
    /// When the drivers no longer disagreed; `None`: not yet. The wire is held low for longer
    /// ([`crate::BusConfig::conflict_hold`]).
    pub end: Option<Time>,
}

/// What a station puts to its driver changed (a node's TXD), whether the driver is on or not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DataEdge {
    /// Whose.
    pub from: Station,
    /// When.
    pub time: Time,
    /// The level from then on; true is the mark, the idle level.
    pub level: bool,
}

/// An edge of the wire itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WireEdge {
    /// When.
    pub time: Time,
    /// The level from then on; true is the mark, the idle level.
    pub level: bool,
}

/// Everything since the bus was made or the record was cleared, in the order of time (characters
/// in the order of their ends).
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

    /// The characters one station sent.
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

    /// Where drivers fought.
    pub fn conflicts(&self) -> &[Conflict] {
        &self.conflicts
    }

    /// When the record begins.
    pub fn since(&self) -> Time {
        self.since
    }

    /// The edges that stations put to their drivers.
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
