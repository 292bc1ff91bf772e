//! The bus: stations in lock step on one wire, or several.
//!
//! # Order of time
//! The station that is furthest behind runs first, for at most [`BusConfig::quantum`] beyond the
//! next one. An edge of the wire is worked out only when no station can act before it any more, so
//! the order of edges is exact whatever the quantum; a node that is awake may hear an edge that
//! another node made up to a quantum late, in its right place nevertheless. A sleeping node never
//! does: its own time stands still until it has a reason to move. When all sleep and the wire is
//! idle, time jumps.

mod machines;

use std::collections::BTreeMap;
use std::path::Path;

use crate::error::BusError;
use crate::gpio::Level;
use crate::host::{BitTimes, Frame, Host, HostPort, RxByte};
use crate::line::Line;
use crate::machine::Machine;
use crate::node::{Nano, Node};
use crate::peripherals::OutputKind;
use crate::record::{HostId, NodeId, PinEdge, Record, Station};
use crate::time::Time;
use crate::wire::Wire;

/// What holds for the whole bus.
#[derive(Clone, Debug)]
pub struct BusConfig {
    /// How far a node may run ahead of another that is awake too. Well under a bit time.
    pub quantum: Time,
    /// How long a conflict keeps the wire low: about a character, so that every receiver hears
    /// damaged bits and a framing error.
    pub conflict_hold: Time,
}

impl Default for BusConfig {
    /// Half a microsecond, and a character at 38400 baud.
    fn default() -> Self {
        BusConfig {
            quantum: Time::from_ns(500),
            conflict_hold: Line::n81(38_400).character(),
        }
    }
}

/// Something that will happen to the wire.
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
    /// The station stopped in the middle of what it did.
    Cut(Station),
    /// Look again.
    Resolve,
}

/// A simulated RS-485 bus.
pub struct Bus {
    config: BusConfig,
    now: Time,
    nodes: Vec<Node>,
    hosts: Vec<Host>,
    /// When each node may next do something.
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

/// The answer to a request, as a host heard it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    /// The bytes, damaged ones included.
    pub bytes: Vec<u8>,
    /// The same with times and flags.
    pub received: Vec<RxByte>,
    /// When the request's last stop bit ended.
    pub request_end: Time,
    /// When the answer's last stop bit ended, by the clock of who sent it.
    pub end: Time,
    /// Pauses between the answer's characters, exact, in their order.
    pub gaps: Vec<Time>,
}

impl Answer {
    /// From the end of the request's last stop bit to the answer's first start bit.
    pub fn turnaround(&self) -> Time {
        self.received.first().map_or(Time::ZERO, |first| {
            first.start.saturating_sub(self.request_end)
        })
    }

    /// Whether every byte came without a framing or parity error.
    pub fn is_clean(&self) -> bool {
        self.received.iter().all(RxByte::is_good)
    }
}

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

    /// One more wire, apart from the others but at the same time: for a machine with several ports.
    pub fn add_wire(&mut self) -> WireId {
        self.wires.push(Wire::new(self.config.conflict_hold));
        self.records.push(Record {
            since: self.now,
            ..Record::default()
        });
        WireId(self.wires.len() - 1)
    }

    /// How far the bus is.
    pub fn now(&self) -> Time {
        self.now
    }

    /// A node.
    pub fn node(&self, id: NodeId) -> &Node {
        &self.nodes[id.0]
    }

    /// A node.
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

    /// A host.
    pub fn host(&mut self, id: HostId) -> &mut Host {
        &mut self.hosts[id.0]
    }

    /// What happened so far, on the first wire.
    pub fn record(&self) -> &Record {
        &self.records[0]
    }

    /// What happened so far on one of the wires.
    pub fn record_of(&self, wire: WireId) -> &Record {
        &self.records[wire.0]
    }

    /// Forgets what happened so far, on all wires.
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

    /// Takes a station's transceiver off the wire: it drives nothing and hears an idle line.
    pub fn unplug(&mut self, station: impl Into<Station>) {
        self.set_plugged(station.into(), false);
    }

    /// Puts it back.
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

    /// Gives it power again.
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

    // --- running ----------------------------------------------------------------------------

    /// Runs for a span of bus time.
    ///
    /// # Panics
    /// Where [`Bus::try_run_for`] has an error.
    pub fn run_for(&mut self, span: impl Into<Time>) {
        self.run_to(self.now.saturating_add(span.into()));
    }

    /// Runs for a span of bus time.
    ///
    /// # Errors
    /// [`BusError::Stopped`] when a machine's process has died or hangs; the bus has come to the end of the span all the same.
    pub fn try_run_for(&mut self, span: impl Into<Time>) -> Result<(), BusError> {
        let deadline = self.now.saturating_add(span.into());
        self.look_again();
        while self.step(deadline) {}
        self.settle();
        self.machines_run()
    }

    /// Runs to an instant.
    ///
    /// # Panics
    /// As [`Bus::run_for`].
    pub fn run_to(&mut self, deadline: Time) {
        let ran = self.try_run_for(deadline.saturating_sub(self.now));
        ran.unwrap_or_else(|error| panic!("{error}"));
    }

    /// Runs until `done` says so, looked at whenever something happened, but at most for `limit`.
    /// Returns whether it did.
    ///
    /// # Panics
    /// As [`Bus::run_for`].
    pub fn run_until(
        &mut self,
        mut done: impl FnMut(&mut Bus) -> bool,
        limit: impl Into<Time>,
    ) -> bool {
        let deadline = self.now.saturating_add(limit.into());
        self.look_again();
        loop {
            if done(self) {
                self.settle();
                return true;
            }
            if !self.step(deadline) {
                self.settle();
                let ran = self.machines_run();
                ran.unwrap_or_else(|error| panic!("{error}"));
                return done(self);
            }
        }
    }

    /// Nodes may have been given inputs from outside.
    fn look_again(&mut self) {
        for index in 0..self.nodes.len() {
            self.refresh(index);
        }
    }

    fn settle(&mut self) {
        for index in 0..self.nodes.len() {
            self.nodes[index].settle(self.now);
            self.refresh(index);
        }
    }

    /// One event or one run of one node; false at the deadline.
    fn step(&mut self, deadline: Time) -> bool {
        self.collect();
        let (mut first, mut second) = ((Time::NEVER, 0), Time::NEVER);
        for (index, &time) in self.activity.iter().enumerate() {
            if time < first.0 {
                second = first.0;
                first = (time, index);
            } else {
                second = second.min(time);
            }
        }
        let machine = self.machines.iter().enumerate();
        let machine = machine.min_by_key(|(_, machine)| machine.now());
        let behind = machine.map(|(index, machine)| (machine.now(), index));
        let queued = self
            .queue
            .first_key_value()
            .map_or(Time::NEVER, |((time, _), _)| *time);
        let event = self
            .hosts
            .iter()
            .map(Host::next_event)
            .fold(queued, Time::min);
        let next = behind.map_or(first.0, |(time, _)| time.min(first.0));
        if event <= next && event <= deadline {
            self.now = self.now.max(event);
            self.happen();
            return true;
        }
        if let Some((time, index)) = behind
            && time <= first.0
            && time < deadline
        {
            self.now = self.now.max(time);
            self.run_machine(index, first.0, deadline);
            return true;
        }
        if first.0 >= deadline {
            self.now = self.now.max(deadline);
            for host in &mut self.hosts {
                host.advance(deadline);
            }
            return false;
        }
        self.now = self.now.max(first.0);
        let limit = (first.0 + self.config.quantum)
            .max(second.min(event))
            .min(deadline);
        let node = &mut self.nodes[first.1];
        let cycle = node.clock().tick_at_or_after(limit).max(node.cycle() + 1);
        node.run(cycle);
        self.refresh(first.1);
        true
    }

    fn refresh(&mut self, index: usize) {
        self.activity[index] = self.nodes[index].activity_time();
    }

    fn schedule(&mut self, at: Time, wire: WireId, event: Event) {
        self.sequence += 1;
        self.queue.insert((at, self.sequence), (wire, event));
    }

    /// Takes over what stations have announced.
    fn collect(&mut self) {
        for index in 0..self.nodes.len() {
            if self.nodes[index].has_outputs() {
                self.collect_node(index);
            }
        }
        for index in 0..self.hosts.len() {
            if self.hosts[index].has_outbox() {
                let station = Station::Host(HostId(index));
                let wire = self.host_wires[index];
                let drives = self.hosts[index].switches_its_driver();
                for frame in self.hosts[index].take_outbox() {
                    if drives {
                        self.schedule(frame.times.start(), wire, Event::Drive(station, true));
                    }
                    self.schedule_frame(station, frame);
                    self.schedule(frame.times.end(), wire, Event::Data(station, true));
                    if drives {
                        self.schedule(frame.times.end(), wire, Event::Drive(station, false));
                    }
                }
            }
        }
    }

    fn collect_node(&mut self, index: usize) {
        let station = Station::Node(NodeId(index));
        let wire = WireId::default();
        let clock = self.nodes[index].clock();
        let de = self.nodes[index].config().de;
        for output in self.nodes[index].take_outputs() {
            let at = clock.time(output.at);
            match output.what {
                OutputKind::Frame(frame) => {
                    let times = BitTimes {
                        base: Time::ZERO,
                        clock,
                        first: frame.start,
                        ticks: frame.bit,
                        count: frame.format.bits(),
                    };
                    self.schedule_frame(
                        station,
                        Frame {
                            times,
                            format: frame.format,
                            bits: frame.bits,
                            value: frame.value,
                        },
                    );
                }
                OutputKind::Reset => {
                    self.queue
                        .retain(|(time, _), (_, event)| *time <= at || !event.is_from(station));
                    self.schedule(at, wire, Event::Cut(station));
                }
                OutputKind::Txd(level) => self.schedule(at, wire, Event::Data(station, level)),
                OutputKind::Pin(pin, level) => {
                    if Some(pin) == de {
                        self.schedule(at, wire, Event::Drive(station, level == Level::High));
                    }
                    self.records[0].pins.push(PinEdge {
                        node: NodeId(index),
                        pin,
                        time: at,
                        level,
                    });
                }
            }
        }
    }

    fn schedule_frame(&mut self, station: Station, frame: Frame) {
        let wire = self.wire_of(station);
        self.schedule(frame.times.start(), wire, Event::Begin(station, frame));
        let mut level = true;
        for bit in 0..frame.times.count {
            let next = frame.bits >> bit & 1 == 1;
            if next != level || bit == 0 {
                self.schedule(frame.times.bit(bit), wire, Event::Data(station, next));
                level = next;
            }
        }
        self.schedule(frame.times.end(), wire, Event::End(station));
    }

    /// Everything that is due now, as one change of the wire.
    fn happen(&mut self) {
        for host in &mut self.hosts {
            host.advance(self.now);
        }
        while let Some(entry) = self.queue.first_entry()
            && entry.key().0 <= self.now
        {
            let (wire, event) = entry.remove();
            self.wires[wire.0].apply(event, self.now, &mut self.records[wire.0]);
        }
        let (mut began, mut edges) = (Vec::new(), Vec::new());
        for wire in (0..self.wires.len()).map(WireId) {
            if !self.wires[wire.0].is_changed() {
                continue;
            }
            let again = self.wires[wire.0].resolve(self.now, &mut self.records[wire.0]);
            if let Some(again) = again {
                self.schedule(again, wire, Event::Resolve);
            }
            for (station, level) in self.wires[wire.0].take_heard() {
                match station {
                    Station::Node(id) => {
                        self.nodes[id.0].rxd_edge(self.now, level);
                        self.refresh(id.0);
                    }
                    Station::Host(id) => {
                        let host = &mut self.hosts[id.0];
                        let was_receiving = host.is_receiving();
                        host.edge(self.now, level);
                        edges.push((id, level));
                        if host.is_receiving() && !was_receiving {
                            began.push(id);
                        }
                    }
                }
            }
        }
        for machine in &mut self.machines {
            machine.hear(&mut self.hosts, &began, &edges);
        }
    }

    // --- a client ---------------------------------------------------------------------------

    /// Sends a request and waits for the answer: what comes within `timeout` of the request's end,
    /// up to a silence of 3.5 characters (1750 us above 19200 baud). `None`: nothing came.
    ///
    /// Returns one character later than that, so that a request sent right after it does not begin
    /// at the very edge of t3.5.
    pub fn transact(&mut self, id: HostId, request: &[u8], timeout: Time) -> Option<Answer> {
        let host = self.host(id);
        host.take();
        let request_end = host.send(request);
        let silence = host.line().t35() + host.line().character();
        let mut deadline = request_end + timeout;
        let mut count = 0;
        while self.now < deadline {
            let span = deadline - self.now;
            self.run_until(
                |bus| bus.host(id).heard().len() > count || bus.host(id).is_receiving(),
                span,
            );
            if self.host(id).is_receiving() {
                self.run_until(|bus| !bus.host(id).is_receiving(), Time::from_ms(100));
            }
            if self.host(id).heard().len() > count {
                count = self.host(id).heard().len();
                let end = self.host(id).heard().last().map(|byte| byte.end);
                deadline = end.unwrap_or(deadline) + silence;
            }
        }
        let received = self.host(id).take();
        let sent = |byte: &RxByte| {
            let record = &self.records[self.host_wires[id.0].0];
            let mut bytes = record.bytes.iter().rev();
            bytes
                .find(|sent| sent.start == byte.start)
                .map_or(byte.end, |sent| sent.end)
        };
        let end = received.last().map(sent)?;
        Some(Answer {
            bytes: received.iter().map(|byte| byte.value).collect(),
            gaps: received
                .windows(2)
                .map(|pair| pair[1].start.saturating_sub(sent(&pair[0])))
                .collect(),
            received,
            request_end,
            end,
        })
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
