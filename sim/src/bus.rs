//! The bus: stations in lock step on one wire, or several.
//!
//! # Order of time
//!
//! The station with the least time runs first, for at most [`BusConfig::quantum`] beyond the next one. An edge of the
//! wire takes effect only when no station can act before it any more, so the order of edges is exact for any quantum.
//! A node that is awake may receive an edge of another node up to a quantum late, but in its right place. A sleeping
//! node receives it in time: its own time stands still until an event for it. When all nodes sleep and the wire is
//! idle, time jumps.

mod client;
mod machines;
mod running;

pub use client::Answer;

use std::collections::BTreeMap;
use std::path::Path;

use crate::error::BusError;
use crate::host::{Frame, Host, HostPort};
use crate::line::Line;
use crate::machine::Machine;
use crate::node::{Nano, Node};
use crate::record::{HostId, NodeId, Record, Station};
use crate::time::Time;
use crate::wire::Wire;

/// The settings of the whole bus.
#[derive(Clone, Debug)]
pub struct BusConfig {
    /// How far a node may run ahead of another node that is awake: much less than a bit time.
    pub quantum: Time,
    /// How long a conflict keeps the wire low: about a character, so that every receiver gets damaged bits and a
    /// framing error.
    pub conflict_hold: Time,
}

impl Default for BusConfig {
    /// A quantum of half a microsecond, and a conflict of one character at 38400 baud.
    fn default() -> Self {
        BusConfig {
            quantum: Time::from_ns(500),
            conflict_hold: Line::n81(38_400).character(),
        }
    }
}

/// A future event on the wire.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Event {
    /// The station's data line changes.
    Data(Station, bool),
    /// The station's driver is switched.
    Drive(Station, bool),
    /// A character begins.
    Begin(Station, Frame),
    /// The oldest character of the station ends.
    End(Station),
    /// Noise begins (a level) or ends.
    Noise(Option<bool>),
    /// The station stopped while it was sending.
    Cut(Station),
    /// Determine the levels of the wire again.
    Resolve,
}

/// A simulated RS-485 bus.
pub struct Bus {
    config: BusConfig,
    now: Time,
    nodes: Vec<Node>,
    hosts: Vec<Host>,
    /// The next time at which each node may act.
    activity: Vec<Time>,
    machines: Vec<Machine>,
    queue: BTreeMap<(Time, u64), (WireId, Event)>,
    sequence: u64,
    wires: Vec<Wire>,
    records: Vec<Record>,
    /// The wire of each host; nodes are on the first.
    host_wires: Vec<WireId>,
}

/// One of the wires of a bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct WireId(usize);

impl Bus {
    /// An empty bus at time zero.
    pub fn new(config: BusConfig) -> Self {
        Bus {
            wires: vec![Wire::new(config.conflict_hold)],
            records: vec![Record::default()],
            host_wires: Vec::new(),
            machines: Vec::new(),
            config,
            now: Time::ZERO,
            nodes: Vec::new(),
            hosts: Vec::new(),
            activity: Vec::new(),
            queue: BTreeMap::new(),
            sequence: 0,
        }
    }

    /// Puts a Nano on the bus and powers it up.
    ///
    /// # Errors
    /// [`BusError`], where the image cannot be read, is not for the ATmega328P or does not fit, or
    /// the clock is out of range.
    pub fn add_nano(&mut self, nano: Nano) -> Result<NodeId, BusError> {
        let mut node = Node::new(nano)?;
        if self.now > Time::ZERO {
            node.power_cut(Time::ZERO);
            node.power_up(self.now);
            node.take_outputs();
        }
        let id = NodeId(self.nodes.len());
        self.wires[0].add(
            Station::Node(id),
            node.config().de.is_none(),
            node.config().echo,
            true,
        );
        self.activity.push(node.activity_time());
        self.nodes.push(node);
        Ok(id)
    }

    /// Puts a Nano with default wiring (16 MHz, DE on PD2) on the bus.
    ///
    /// # Errors
    /// As [`Bus::add_nano`].
    pub fn add_image(&mut self, name: &str, elf: &Path) -> Result<NodeId, BusError> {
        self.add_nano(Nano::new(name, elf))
    }

    /// Puts a host on the bus.
    pub fn add_host(&mut self, port: HostPort) -> HostId {
        self.add_host_on(WireId::default(), port)
    }

    /// Puts a host on one of the wires.
    pub fn add_host_on(&mut self, wire: WireId, port: HostPort) -> HostId {
        let id = HostId(self.hosts.len());
        let mut host = Host::new(port);
        host.advance(self.now);
        let has_pin = !host.switches_its_driver();
        self.wires[wire.0].add(Station::Host(id), false, host.echo(), has_pin);
        self.hosts.push(host);
        self.host_wires.push(wire);
        id
    }

    /// Adds a wire that is separate from the others but shares their time: for a machine with several ports.
    pub fn add_wire(&mut self) -> WireId {
        self.wires.push(Wire::new(self.config.conflict_hold));
        self.records.push(Record {
            since: self.now,
            ..Record::default()
        });
        WireId(self.wires.len() - 1)
    }

    /// The time of the bus.
    pub fn now(&self) -> Time {
        self.now
    }

    /// The node with this id.
    pub fn node(&self, id: NodeId) -> &Node {
        &self.nodes[id.0]
    }

    /// The node with this id, mutable.
    pub fn node_mut(&mut self, id: NodeId) -> &mut Node {
        &mut self.nodes[id.0]
    }

    /// The nodes, in the order they were added.
    pub fn nodes(&self) -> impl Iterator<Item = (NodeId, &Node)> {
        self.nodes
            .iter()
            .enumerate()
            .map(|(i, node)| (NodeId(i), node))
    }

    /// The hosts, in the order they were added.
    pub fn hosts(&self) -> impl Iterator<Item = (HostId, &Host)> {
        self.hosts
            .iter()
            .enumerate()
            .map(|(i, host)| (HostId(i), host))
    }

    /// The host with this id.
    pub fn host(&mut self, id: HostId) -> &mut Host {
        &mut self.hosts[id.0]
    }

    /// The record of the first wire.
    pub fn record(&self) -> &Record {
        &self.records[0]
    }

    /// The record of one of the wires.
    pub fn record_of(&self, wire: WireId) -> &Record {
        &self.records[wire.0]
    }

    /// Clears the records of all wires.
    pub fn clear_record(&mut self) {
        for record in &mut self.records {
            *record = Record {
                since: self.now,
                ..Record::default()
            };
        }
    }

    /// The level of the first wire; true is the idle level.
    pub fn wire_level(&self) -> bool {
        self.wires[0].level()
    }

    fn wire_of(&self, station: Station) -> WireId {
        match station {
            Station::Node(_) => WireId::default(),
            Station::Host(id) => self.host_wires[id.0],
        }
    }

    // --- faults -----------------------------------------------------------------------------

    /// Takes a station's transceiver off the wire: it drives nothing and receives an idle line.
    pub fn unplug(&mut self, station: impl Into<Station>) {
        self.set_plugged(station.into(), false);
    }

    /// Connects a station that was unplugged.
    pub fn plug(&mut self, station: impl Into<Station>) {
        self.set_plugged(station.into(), true);
    }

    fn set_plugged(&mut self, station: Station, plugged: bool) {
        let wire = self.wire_of(station);
        self.wires[wire.0].set_plugged(station, plugged);
        self.schedule(self.now, wire, Event::Resolve);
    }

    /// Pulls a node's reset pin.
    pub fn reset(&mut self, id: NodeId) {
        self.interrupt(id, Node::reset);
    }

    /// Cuts a node's power: its pins float, its SRAM is lost.
    pub fn power_cut(&mut self, id: NodeId) {
        self.interrupt(id, Node::power_cut);
        self.wires[0].set_powered(Station::Node(id), false);
        self.schedule(self.now, WireId::default(), Event::Resolve);
    }

    /// Switches a node's power on again.
    pub fn power_up(&mut self, id: NodeId) {
        self.nodes[id.0].power_up(self.now);
        self.wires[0].set_powered(Station::Node(id), true);
        self.schedule(self.now, WireId::default(), Event::Resolve);
        self.refresh(id.0);
    }

    fn interrupt(&mut self, id: NodeId, act: fn(&mut Node, Time)) {
        self.collect();
        act(&mut self.nodes[id.0], self.now);
        self.collect();
        self.refresh(id.0);
    }

    /// Forces the first wire to `level` from `from` (at least now) for `length`, whatever drives it.
    pub fn noise(&mut self, from: Time, length: Time, level: bool) {
        let from = from.max(self.now);
        self.schedule(from, WireId::default(), Event::Noise(Some(level)));
        self.schedule(from + length, WireId::default(), Event::Noise(None));
    }
}

impl Event {
    fn is_from(&self, station: Station) -> bool {
        match self {
            Event::Data(from, _) | Event::Drive(from, _) => *from == station,
            Event::Begin(from, _) | Event::End(from) | Event::Cut(from) => *from == station,
            Event::Noise(_) | Event::Resolve => false,
        }
    }
}

impl From<NodeId> for Station {
    fn from(id: NodeId) -> Self {
        Station::Node(id)
    }
}

impl From<HostId> for Station {
    fn from(id: HostId) -> Self {
        Station::Host(id)
    }
}
