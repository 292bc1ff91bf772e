//! The machines on a bus: how they are put on its wires, and how far they may run.

use super::{Bus, Event, WireId};
use crate::error::BusError;
use crate::machine::{Cause, Machine, MachineId, MachineOutput, Parts, Stm32};
use crate::record::{HostId, Station};
use crate::time::Time;

/// How far a machine may run ahead of nodes that are awake: it hears the beginning of their characters so much late. Each
/// stop costs some 30 us of the host's time in QEMU, and one in this process.
const QEMU_AHEAD_OF_NODES: Time = Time::from_us(20);
const CORE_AHEAD_OF_NODES: Time = Time::from_us(1);

/// How far it may run ahead of everything: what is sent from outside between two steps comes so much late.
const MACHINE_AHEAD: Time = Time::from_us(200);

impl Bus {
    /// Powers an STM32 up, with its ports on wires.
    ///
    /// # Errors
    /// [`BusError`], where QEMU cannot be started with the image.
    pub fn add_stm32(&mut self, stm32: Stm32) -> Result<MachineId, BusError> {
        self.add_stm32_in_parts(stm32, Parts::default())
    }

    /// Adds an STM32 whose image is counted in parts, which takes the host longer.
    ///
    /// # Errors
    /// As [`Bus::add_stm32`].
    pub fn add_stm32_in_parts(
        &mut self,
        stm32: Stm32,
        parts: Parts,
    ) -> Result<MachineId, BusError> {
        let wires = stm32.wires;
        let mut machine = Machine::new(stm32, parts, self.now)?;
        for (port, wire) in wires.into_iter().enumerate() {
            if let Some(wire) = wire {
                let host = self.add_host_on(wire, machine.host_port(port));
                // The core says when its receivers are on.
                self.hosts[host.0].set_listening(!machine.sees_edges());
                machine.connect(port, host, wire);
            }
        }
        self.machines.push(machine);
        Ok(MachineId(self.machines.len() - 1))
    }

    /// The machines, in the order they were added.
    pub fn machines(&self) -> impl Iterator<Item = &Machine> {
        self.machines.iter()
    }

    /// The machine with this id.
    pub fn machine(&self, id: MachineId) -> &Machine {
        &self.machines[id.0]
    }

    /// Whether all machines run.
    pub(super) fn machines_run(&self) -> Result<(), BusError> {
        match self.machines.iter().find_map(Machine::failure) {
            None => Ok(()),
            Some(reason) => Err(BusError::Stopped {
                reason: reason.to_owned(),
            }),
        }
    }

    /// The machine with this id, mutable.
    pub fn machine_mut(&mut self, id: MachineId) -> &mut Machine {
        &mut self.machines[id.0]
    }

    /// Whether the transceiver of a machine's port, which is this station, hears what the port itself sends.
    pub fn set_echo(&mut self, station: Station, echo: bool) {
        let wire = self.wire_of(station);
        self.wires[wire.0].set_echo(station, echo);
    }

    /// Resets an STM32. Nothing happens to one in QEMU.
    pub fn reset_stm32(&mut self, id: MachineId, cause: Cause) {
        if let Some(silicon) = self.machines[id.0].silicon() {
            silicon.reset(cause);
        }
    }

    /// Runs a machine, which is furthest behind, as far as nothing can happen that it has to hear; or to where its transmitters
    /// have something to do. `nodes` is when the first of the nodes may do something.
    pub(super) fn run_machine(&mut self, index: usize, nodes: Time, deadline: Time) {
        let machine = &self.machines[index];
        let is_heard = |wire: &WireId, from| !machine.is(from) || self.wires[wire.0].echoes(from);
        let hears = |event: &(WireId, Event)| match event {
            (wire, Event::Begin(from, _)) => machine.is_on(*wire) && is_heard(wire, *from),
            (wire, Event::Data(from, _)) if machine.sees_edges() => {
                machine.is_on(*wire) && is_heard(wire, *from)
            }
            (wire, Event::Noise(_)) => machine.is_on(*wire),
            (wire, Event::Resolve) => machine.sees_edges() && machine.is_on(*wire),
            _ => false,
        };
        let begins = self.queue.iter().find(|(_, event)| hears(event));
        let begins = begins.map_or(Time::NEVER, |((time, _), _)| *time);
        let judged = machine.hosts().map(|id| self.hosts[id.0].next_event());
        let ahead = if machine.sees_edges() {
            CORE_AHEAD_OF_NODES
        } else {
            QEMU_AHEAD_OF_NODES
        };
        let limit = judged
            .fold(begins, Time::min)
            .min(nodes.saturating_add(ahead))
            .min(machine.now() + MACHINE_AHEAD)
            .min(deadline);
        for output in self.machines[index].run_to(limit) {
            match output {
                MachineOutput::Line(host, line) => self.hosts[host.0].set_line(line),
                MachineOutput::Byte(host, at, byte) => self.hosts[host.0].send_from(at, byte),
                MachineOutput::Drive(host, at, on) => {
                    let wire = self.host_wires[host.0];
                    self.schedule(at, wire, Event::Drive(Station::Host(host), on));
                }
                MachineOutput::Listen(host, on) => self.hosts[host.0].set_listening(on),
                MachineOutput::Cut(host, at) => self.cut(host, at),
            }
        }
    }

    /// A machine has stopped in the middle of a character: what it would have done is not done.
    fn cut(&mut self, host: HostId, at: Time) {
        let station = Station::Host(host);
        let wire = self.host_wires[host.0];
        self.queue
            .retain(|(time, _), (_, event)| *time <= at || !event.is_from(station));
        self.hosts[host.0].break_off(at);
        self.schedule(at, wire, Event::Cut(station));
    }
}
