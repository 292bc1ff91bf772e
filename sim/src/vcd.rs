//! The record as a wave form (Value Change Dump, IEEE 1364-2005, 18) for GTKWave and PulseView.
//!
//! One tick is a nanosecond and time is the bus's own, so that a place in the wave form is found
//! again in the text. Every station is a scope of its own.

use std::io::{self, Write};

use vcd::{IdCode, TimescaleUnit, Value, Writer};

use crate::bus::Bus;
use crate::gpio::Level;
use crate::record::Station;
use crate::time::Time;

/// Scope names that this file makes itself.
const BUS: &str = "bus";

/// How long before the record the file begins.
const LEAD: Time = Time::from_us(1);

/// A change of a signal.
type Change = (Time, IdCode, Value);

/// Declares signals and gathers what they do.
struct Dump<W: Write> {
    out: Writer<W>,
    initial: Vec<(IdCode, Value)>,
    changes: Vec<Change>,
}

impl<W: Write> Dump<W> {
    /// A signal that begins as `initial`.
    fn signal(
        &mut self,
        name: &str,
        initial: Value,
        changes: impl IntoIterator<Item = (Time, Value)>,
    ) -> io::Result<()> {
        let id = self.out.add_wire(1, name)?;
        self.initial.push((id, initial));
        let changes = changes.into_iter().map(|(time, value)| (time, id, value));
        self.changes.extend(changes);
        Ok(())
    }

    /// A signal that is recorded by its changes alone: before the first it was the other level.
    fn level(&mut self, name: &str, idle: bool, edges: Vec<(Time, bool)>) -> io::Result<()> {
        let initial = edges.first().map_or(idle, |(_, level)| !level);
        let changes = edges.into_iter().map(|(time, level)| (time, level.into()));
        self.signal(name, initial.into(), changes)
    }

    fn finish(mut self, since: Time, now: Time) -> io::Result<()> {
        self.out.enddefinitions()?;
        // A reader takes what comes at the first instant for the initial value.
        let mut at = ns(since.saturating_sub(LEAD));
        self.out.timestamp(at)?;
        self.out.begin(vcd::SimulationCommand::Dumpvars)?;
        for (id, value) in self.initial {
            self.out.change_scalar(id, value)?;
        }
        self.out.end()?;
        // Changes of the same instant stay in the order they were recorded in.
        self.changes.sort_by_key(|change| change.0);
        for (time, id, value) in self.changes {
            if ns(time) > at {
                at = ns(time);
                self.out.timestamp(at)?;
            }
            self.out.change_scalar(id, value)?;
        }
        if ns(now) > at {
            self.out.timestamp(ns(now))?;
        }
        self.out.flush()
    }
}

fn ns(time: Time) -> u64 {
    time.ps() / 1_000
}

/// A name of one's own for each signal: sigrok and PulseView do not show scopes.
fn signal(station: Station, name: &str) -> String {
    match station {
        Station::Node(id) => format!("node{}_{name}", id.0),
        Station::Host(id) => format!("host{}_{name}", id.0),
    }
}

/// Names in a VCD file end at the first blank.
fn scope(station: Station, name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let name: String = name.chars().map(plain).collect();
    signal(station, &name)
}

impl Bus {
    /// Writes the record as a Value Change Dump, from a microsecond before
    /// [`crate::Record::since`] to now:
    /// - `bus.wire`, the level of the wire, and `bus.conflict`, high while drivers disagree;
    /// - for each node a scope `nodeN_NAME` with `nodeN_txd` and `nodeN_de`, and its watched pins as
    ///   `nodeN_PB1`, `z` while they float and `x` before the first edge on record;
    /// - for each host a scope `hostN_NAME` with `hostN_txd`.
    ///
    /// Times are cut to nanoseconds. A file for sigrok-cli or PulseView wants `downsample=100` or
    /// so at import: libsigrok takes a sample for every tick.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_vcd(&self, out: impl Write) -> io::Result<()> {
        let record = self.record();
        let mut out = Writer::new(out);
        out.timescale(1, TimescaleUnit::NS)?;
        let mut dump = Dump {
            out,
            initial: Vec::new(),
            changes: Vec::new(),
        };

        dump.out.add_module(BUS)?;
        let wire = record.wire_edges().iter();
        dump.level(
            "wire",
            self.wire_level(),
            wire.map(|edge| (edge.time, edge.level)).collect(),
        )?;
        let conflicts = record.conflicts().iter().flat_map(|conflict| {
            let end = conflict.end.map(|time| (time, Value::V0));
            [Some((conflict.time, Value::V1)), end]
        });
        dump.signal("conflict", Value::V0, conflicts.flatten())?;
        dump.out.upscope()?;

        for (id, node) in self.nodes() {
            let station = Station::Node(id);
            dump.out.add_module(&scope(station, node.name()))?;
            self.dump_data(&mut dump, station)?;
            let de = record
                .de_edges()
                .iter()
                .filter(|edge| edge.from == Station::Node(id));
            let without_de = node.config().de.is_none();
            let edges = de.map(|edge| (edge.time, edge.on)).collect();
            dump.level(&signal(station, "de"), without_de, edges)?;
            for &pin in &node.config().watch {
                let edges = record.pin_edges().iter();
                let edges: Vec<_> = edges
                    .filter(|edge| edge.node == id && edge.pin == pin)
                    .map(|edge| (edge.time, value(edge.level)))
                    .collect();
                let initial = match edges.first() {
                    Some(_) => Value::X,
                    None => value(node.output(pin)),
                };
                dump.signal(&signal(station, &pin.to_string()), initial, edges)?;
            }
            dump.out.upscope()?;
        }
        for (id, host) in self.hosts() {
            let station = Station::Host(id);
            dump.out.add_module(&scope(station, host.name()))?;
            self.dump_data(&mut dump, station)?;
            dump.out.upscope()?;
        }
        dump.finish(record.since(), self.now())
    }

    fn dump_data(&self, dump: &mut Dump<impl Write>, station: Station) -> io::Result<()> {
        let edges = self.record().data_edges().iter();
        let edges = edges.filter(|edge| edge.from == station);
        let edges = edges.map(|edge| (edge.time, edge.level)).collect();
        dump.level(&signal(station, "txd"), true, edges)
    }
}

fn value(level: Level) -> Value {
    match level {
        Level::Low => Value::V0,
        Level::High => Value::V1,
        Level::Floating => Value::Z,
    }
}
