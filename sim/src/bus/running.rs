//! Time goes on: whoever is furthest behind runs, and what is due happens.

use super::{Bus, Event, WireId};
use crate::error::BusError;
use crate::gpio::Level;
use crate::host::{BitTimes, Frame, Host};
use crate::peripherals::OutputKind;
use crate::record::{HostId, NodeId, PinEdge, Station};
use crate::time::Time;

impl Bus {
    /// Runs for a span of bus time.
    ///
    /// # Panics
    /// If [`Bus::try_run_for`] returns an error.
    pub fn run_for(&mut self, span: impl Into<Time>) {
        self.run_to(self.now.saturating_add(span.into()));
    }

    /// Runs for a span of bus time.
    ///
    /// # Errors
    /// [`BusError::Stopped`] if a machine's process has died or hangs; the bus has still reached the end of the span.
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

    /// Runs until `done` returns true, which is checked after each event, but at most for `limit`. Returns whether it
    /// did.
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

    /// Nodes may have received inputs from outside.
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

    /// Handles one event, or runs one node once; returns false at the deadline.
    pub(super) fn step(&mut self, deadline: Time) -> bool {
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

    pub(super) fn refresh(&mut self, index: usize) {
        self.activity[index] = self.nodes[index].activity_time();
    }

    pub(super) fn schedule(&mut self, at: Time, wire: WireId, event: Event) {
        self.sequence += 1;
        self.queue.insert((at, self.sequence), (wire, event));
    }

    /// Collects the events that stations have announced.
    pub(super) fn collect(&mut self) {
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

    /// Applies all events that are due now, as one change of the wire.
    pub(super) fn happen(&mut self) {
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
}
