//! The application `ports` of the STM32 with all four ports loaded at once, and one of them reconfigured each second: for
//! as long as one likes, for tests and for `bench`.
//!
//! | port | load | what is changed |
//! |---|---|---|
//! | AS1 | a PC reads its registers, and writes and reads units 1 and 2 | unit id, baud |
//! | AS2 | an ASCII master writes and reads its registers, and unit 3 as unit 13 | unit id, framing, format and baud |
//! | RS2 | prints RS4 | baud |
//! | RS4 | polls units 1, 2 and 3 | mode off and master again, baud, timeout |
//!
//! All registers are loaded by the PC. Whatever port is changed, the other three go on without a lost or wrong answer; so does
//! that one, before and after.

mod changes;
mod client;
mod sniffed;
pub mod units;

pub use client::{BusClient, Source};

use std::collections::VecDeque;
use std::path::Path;

use multidrop_bus::{
    Bus, BusConfig, BusError, Emulator, Format, HostId, HostPort, Line, MachineId, NodeId, Parts,
    Station, Stm32, Time, WireId,
};

use super::plain::wire::Way;
use changes::{BAUD, Step, change};
use sniffed::Sniffed;

/// The ports, as [`Stm32::wires`] has them.
pub const AS1: usize = 0;
/// The ASCII slave.
pub const AS2: usize = 1;
/// The index of the port that prints.
pub const RS2: usize = 2;
/// The index of the master's port.
pub const RS4: usize = 3;

/// What AS1 and RS4 are set to at first.
pub const LINE: Line = Line::n81(38_400);
/// The line of AS2.
pub const ASCII: Line = Line {
    baud: 19_200,
    format: Format::E71,
};
/// The line of RS2.
pub const TEXT: Line = Line::n81(230_400);

/// How long RS4 waits for a unit.
pub const TIMEOUT: Time = Time::from_ms(50);

/// How often a port is changed, and which, in turn.
const EVERY: Time = Time::from_ms(1_000);
const CHANGED: [usize; 4] = [AS1, AS2, RS2, RS4];

/// More than all need to listen.
const BOOT: Time = Time::from_ms(20);

/// How often the hosts look at what they have heard: more often than t3.5 passes.
const STEP: Time = Time::from_us(500);

/// Who is on the four wires. RS4's is the first one.
pub struct Desk {
    /// All of it.
    pub bus: Bus,
    /// The host on AS1.
    pub pc: HostId,
    /// The host on AS2.
    pub ascii: HostId,
    /// The host on RS2.
    pub terminal: HostId,
    /// The STM32 with `ports`.
    pub machine: MachineId,
    /// The units on RS4.
    pub nodes: Vec<NodeId>,
    /// Of the ports, in their order.
    pub wires: [WireId; 4],
}

impl Desk {
    /// The machine with the image of `ports`, and a Nano behind RS4 for each image of `demo-unit`; booted.
    ///
    /// # Errors
    /// Where an image cannot be run.
    pub fn new(ports: &Path, emulator: Emulator, units: &[&Path]) -> Result<Self, BusError> {
        Self::in_parts(ports, emulator, units, Parts::default())
    }

    /// A desk whose image of `ports` is counted in parts.
    ///
    /// # Errors
    /// As [`Desk::new`].
    pub fn in_parts(
        ports: &Path,
        emulator: Emulator,
        units: &[&Path],
        parts: Parts,
    ) -> Result<Self, BusError> {
        let mut desk = Self::at_zero(ports, emulator, units, parts)?;
        desk.bus.run_for(BOOT);
        Ok(desk)
    }

    fn at_zero(
        ports: &Path,
        emulator: Emulator,
        units: &[&Path],
        parts: Parts,
    ) -> Result<Self, BusError> {
        let mut bus = Bus::new(BusConfig::default());
        let mut nodes = Vec::new();
        for unit in units {
            nodes.push(bus.add_image("unit", unit)?);
        }
        let rs4 = WireId::default();
        let [as1, as2, rs2] = [0; 3].map(|_| bus.add_wire());
        let wires = [as1, as2, rs2, rs4];
        let stm32 = Stm32 {
            name: "ports".to_owned(),
            image: ports.to_path_buf(),
            emulator,
            wires: wires.map(Some),
        };
        let machine = bus.add_stm32_in_parts(stm32, parts)?;
        let pc = bus.add_host_on(as1, HostPort::new(LINE));
        let ascii = bus.add_host_on(as2, HostPort::new(ASCII));
        let terminal = bus.add_host_on(rs2, HostPort::new(TEXT));
        Ok(Desk {
            bus,
            pc,
            ascii,
            terminal,
            machine,
            nodes,
            wires,
        })
    }

    /// A port on its wire.
    pub fn station(&self, port: usize) -> Station {
        let station = self.bus.machine(self.machine).station(port);
        station.expect("all four are on wires")
    }

    /// What a port is set to now.
    pub fn line_of(&mut self, port: usize) -> Line {
        match self.station(port) {
            Station::Host(id) => self.bus.host(id).line(),
            Station::Node(_) => LINE,
        }
    }
}

/// Where the settings of a port are in the registers of AS1's unit: `n` is the number of the register, that of
/// `Register::number`.
pub fn setting(port: usize, n: u16) -> u16 {
    1000 * (port as u16 + 1) + 2 * n
}

/// What became of it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Good answers: of AS1, of AS2; lines that RS2 has printed; answers that RS4 has got from units.
    pub answers: [u64; 4],
    /// Requests that were not answered, and lines that were not printed.
    pub lost: u64,
    /// Answers and lines that were not what they should be, and frames on RS4 that should not be there.
    pub wrong: u64,
    /// The first few of both, in words.
    pub troubles: Vec<String>,
    /// How often each port was changed.
    pub reconfigurations: [u32; 4],
    /// The longest time from a request's end to the beginning of the port's own answer; of AS1 and AS2.
    pub turnaround: [Time; 4],
    /// The time of an exchange whose answer is a unit's.
    pub routed: [Time; 4],
    /// Characters lost on each port because the one before was not read.
    pub overruns: [u64; 4],
}

impl Report {
    /// Something is not there.
    pub fn lost(&mut self, what: String) {
        self.lost += 1;
        self.describe(what);
    }

    /// Something is not right.
    pub fn wrong(&mut self, what: String) {
        self.wrong += 1;
        self.describe(what);
    }

    fn describe(&mut self, what: String) {
        if self.troubles.len() < 8 {
            self.troubles.push(what);
        }
    }
}

/// What the hosts know of the machine.
struct Load {
    report: Report,
    pc: BusClient,
    ascii: BusClient,
    sniffed: Sniffed,
    /// What is left of the change under way, when the next one begins, and of which of [`CHANGED`].
    steps: VecDeque<Step>,
    next_change: Time,
    turn: usize,
    /// What may not be asked on AS2 meanwhile.
    hush: Option<Step>,
    /// What the terminal is to be changed to, as soon as RS2 is no longer this.
    terminal: Option<(Line, Line)>,
    /// AS1's unit id and line, and AS2's unit id.
    as1: (u8, Line),
    as2: u8,
    /// Rates as they were loaded.
    bauds: [u32; 4],
    /// Requests so far, and what is in the registers that they write.
    pc_asked: u16,
    ascii_asked: u16,
    units: [u16; 3],
    cells: [u16; 16],
}

/// Loads a desk that was just made, for so long. The bus's records are taken on the way.
pub fn run(desk: &mut Desk, span: Time) -> Report {
    let mut load = Load {
        report: Report::default(),
        pc: BusClient::new(desk.pc, AS1, Way::Rtu, LINE),
        ascii: BusClient::new(desk.ascii, AS2, Way::Ascii, ASCII),
        sniffed: Sniffed::new(desk.station(RS4)),
        steps: VecDeque::new(),
        next_change: desk.bus.now() + EVERY,
        turn: 0,
        hush: None,
        terminal: None,
        as1: (10, LINE),
        as2: 1,
        bauds: [LINE.baud, ASCII.baud, TEXT.baud, LINE.baud],
        pc_asked: 0,
        ascii_asked: 0,
        units: [0; 3],
        cells: [0; 16],
    };
    let end = desk.bus.now() + span;
    let mut look = desk.bus.now();
    while desk.bus.now() < end || (!load.steps.is_empty() && desk.bus.now() < end + EVERY * 2) {
        desk.bus.run_for(STEP);
        let is_over = desk.bus.now() >= end;
        load.step(desk, is_over);
        if desk.bus.now() >= look {
            load.look(desk);
            look = desk.bus.now() + Time::from_ms(100);
        }
    }
    if let Some(step) = load.steps.front() {
        load.report.lost(format!("it never came to {step:?}"));
    }
    // What is under way ends.
    let end = desk.bus.now() + Time::from_ms(500);
    while desk.bus.now() < end {
        desk.bus.run_for(STEP);
        load.pc.is_free(&mut desk.bus, &mut load.report);
        load.ascii.is_free(&mut desk.bus, &mut load.report);
    }
    load.look(desk);
    load.sniffed.finish(desk.bus.now(), &mut load.report);
    let machine = desk.bus.machine(desk.machine);
    load.report.overruns = [AS1, AS2, RS2, RS4].map(|port| machine.overruns(port));
    load.report
}

impl Load {
    /// Who may ask does.
    fn step(&mut self, desk: &mut Desk, is_over: bool) {
        if let Some((line, old)) = self.terminal
            && desk.line_of(RS2) != old
        {
            desk.bus.host(desk.terminal).set_line(line);
            self.terminal = None;
        }
        let pc_is_free = self.pc.is_free(&mut desk.bus, &mut self.report);
        let ascii_is_free = self.ascii.is_free(&mut desk.bus, &mut self.report);
        if pc_is_free {
            if self.steps.is_empty() && desk.bus.now() >= self.next_change && !is_over {
                self.next_change += EVERY;
                let port = CHANGED[self.turn % CHANGED.len()];
                self.turn += 1;
                let count = self.report.reconfigurations[port];
                self.steps = change(port, count, self.as1).into();
            }
            self.ask_as1(desk, ascii_is_free);
        }
        if ascii_is_free && self.hush != Some(Step::Hush) {
            self.ask_as2(&mut desk.bus);
        }
    }

    /// The PC asks what comes next.
    fn ask_as1(&mut self, desk: &mut Desk, ascii_is_free: bool) {
        loop {
            let Some(step) = self.steps.front_mut() else {
                return self.ask_any(&mut desk.bus);
            };
            match step {
                Step::Own(count) if *count > 0 => {
                    *count -= 1;
                    return self.ask_own(&mut desk.bus);
                }
                Step::Hush => {
                    self.hush = Some(Step::Hush);
                    if !ascii_is_free {
                        return self.ask_own(&mut desk.bus);
                    }
                }
                Step::HushUnits => {
                    self.hush = Some(Step::HushUnits);
                    if self.ascii.awaits_unit() {
                        return self.ask_own(&mut desk.bus);
                    }
                }
                Step::Printed if self.terminal.is_some() => return self.ask_own(&mut desk.bus),
                _ => {}
            }
            let Some(step) = self.steps.pop_front() else {
                return;
            };
            match step {
                Step::Load(port, register, value) => {
                    if register == BAUD {
                        self.bauds[port] = value;
                    }
                    let first = setting(port, register);
                    let mut request = body(self.as1.0, 16, first, 2);
                    let answer = request.clone();
                    request.push(4);
                    request.extend(value.to_be_bytes());
                    return self.pc.ask(&mut desk.bus, request, answer, Source::Port);
                }
                Step::Refused(code) => {
                    let request = body(1, 3, 0, 1);
                    let answer = vec![1, 0x83, code];
                    return self.pc.ask(&mut desk.bus, request, answer, Source::Unit);
                }
                Step::Pc(unit, line) => {
                    if line != self.as1.1 {
                        self.pc.speak(&mut desk.bus, Way::Rtu, line);
                    }
                    self.as1 = (unit, line);
                    return;
                }
                Step::Ascii(unit, way, line) => {
                    self.as2 = unit;
                    self.ascii.speak(&mut desk.bus, way, line);
                }
                Step::Terminal(line) => self.terminal = Some((line, desk.line_of(RS2))),
                Step::Done(port) => {
                    self.hush = None;
                    self.report.reconfigurations[port] += 1;
                }
                Step::Own(_) | Step::Hush | Step::HushUnits | Step::Printed => {}
            }
        }
    }

    /// A port's rate, as AS1's own registers have it.
    fn ask_own(&mut self, bus: &mut Bus) {
        self.pc_asked = self.pc_asked.wrapping_add(1);
        let port = CHANGED[usize::from(self.pc_asked) % CHANGED.len()];
        let request = body(self.as1.0, 3, setting(port, BAUD), 2);
        let mut answer = vec![self.as1.0, 3, 4];
        answer.extend(self.bauds[port].to_be_bytes());
        self.pc.ask(bus, request, answer, Source::Port);
    }

    /// A unit's register is written, then read; then AS1's own.
    fn ask_any(&mut self, bus: &mut Bus) {
        let (round, step) = (self.pc_asked / 3, self.pc_asked % 3);
        if step == 2 {
            return self.ask_own(bus);
        }
        self.pc_asked = self.pc_asked.wrapping_add(1);
        let place = usize::from(round % 2);
        let value = (step == 0).then_some(round.wrapping_mul(26_541));
        let cell = &mut self.units[place];
        let (request, answer) = write_or_read(place as u8 + 1, 0, cell, value);
        self.pc.ask(bus, request, answer, Source::Unit);
    }

    /// A register of AS2 is written, then read; then the third unit's.
    fn ask_as2(&mut self, bus: &mut Bus) {
        let (round, step) = (self.ascii_asked / 4, self.ascii_asked % 4);
        self.ascii_asked = self.ascii_asked.wrapping_add(1);
        let value = (step % 2 == 0).then_some(round.wrapping_mul(40_503));
        if step < 2 || self.hush == Some(Step::HushUnits) {
            let place = round % 16;
            let cell = &mut self.cells[usize::from(place)];
            let (request, answer) = write_or_read(self.as2, place, cell, value);
            return self.ascii.ask(bus, request, answer, Source::Port);
        }
        let (request, answer) = write_or_read(13, 0, &mut self.units[2], value);
        self.ascii.ask(bus, request, answer, Source::Unit);
    }

    /// Takes what was on the wires.
    fn look(&mut self, desk: &mut Desk) {
        let now = desk.bus.now();
        for wire in desk.wires {
            for conflict in desk.bus.record_of(wire).conflicts() {
                self.report.wrong(format!("{conflict:?}"));
            }
        }
        let on_rs4 = desk.bus.record_of(WireId::default()).bytes();
        self.sniffed.heard(on_rs4, now, &mut self.report);
        desk.bus.clear_record();
        let printed = desk.bus.host(desk.terminal).take();
        if let Some(bad) = printed.iter().find(|byte| !byte.is_good()) {
            self.report.wrong(format!("RS2: {bad:?}"));
        }
        let text: String = printed.iter().map(|byte| char::from(byte.value)).collect();
        self.sniffed.printed(&text, &mut self.report);
    }
}

/// Unit id, function code and two words.
fn body(unit: u8, function: u8, first: u16, second: u16) -> Vec<u8> {
    let words = [first.to_be_bytes(), second.to_be_bytes()];
    [&[unit, function], words.as_flattened()].concat()
}

/// A write of a register or a read of it, and its answer.
fn write_or_read(unit: u8, at: u16, cell: &mut u16, write: Option<u16>) -> (Vec<u8>, Vec<u8>) {
    match write {
        Some(value) => {
            *cell = value;
            let request = body(unit, 6, at, value);
            (request.clone(), request)
        }
        None => {
            let mut answer = vec![unit, 3, 2];
            answer.extend(cell.to_be_bytes());
            (body(unit, 3, at, 1), answer)
        }
    }
}
