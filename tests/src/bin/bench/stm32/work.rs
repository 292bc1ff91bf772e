//! Instructions of an exchange: all that were not waiting, and what of them is there in QEMU alone.

use multidrop_bus::{
    Bus, BusConfig, Emulator, HostId, HostPort, Instructions, Line, Machine, MachineId, Stm32,
    Time, WireId,
};

use super::parts;
use crate::Trouble;
use crate::figures::{Range, Set};
use crate::image::Image;
use crate::traffic::{Desk, Shape};
use multidrop_testkit::frames::{adu, block, data, words};
use multidrop_testkit::random::Random;

/// Exchanges from which a range is taken.
const EXCHANGES: usize = 20;
/// After an answer: what comes of the silence behind it.
const AFTER: Time = Time::from_ms(5);

/// What a series of exchanges took.
#[derive(Default)]
struct Work {
    all: Range,
    emulation: Range,
    own: Range,
}

impl Work {
    fn add(&mut self, counted: Instructions) {
        self.all.add(counted.work() as f64);
        self.emulation.add(counted.marked as f64);
        self.own.add((counted.work() - counted.marked) as f64);
    }

    fn store(self, set: &mut Set, shape: &str) {
        for (range, name) in [
            (self.all, "work"),
            (self.emulation, "emulation"),
            (self.own, "own"),
        ] {
            range.store(set, &format!("{name}_{shape}"), "instructions");
        }
    }
}

/// `registers`, from before the request's first start bit to after the last silence.
pub fn of_registers(desk: &mut Desk<MachineId>, set: &mut Set) -> Result<(), Trouble> {
    for shape in [
        Shape::Read(1),
        Shape::Read(16),
        Shape::Write(16),
        Shape::Read(125),
    ] {
        let mut work = Work::default();
        for _ in 0..EXCHANGES {
            desk.idle();
            let request = shape.request(desk.count, &mut desk.random);
            let before = desk.bus.machine(desk.node).counted();
            desk.expect(&request)?;
            desk.bus.run_for(AFTER);
            work.add(desk.bus.machine(desk.node).counted() - before);
        }
        work.store(set, &shape.name());
    }
    Ok(())
}

/// Shortest, middle and longest interrupt that began with this handler.
pub fn interrupts(machine: &Machine, handler: &str, name: &str, set: &mut Set) {
    let mut lengths = machine.interrupts(handler);
    lengths.sort_unstable();
    let figures = [
        ("min", lengths.first()),
        ("median", lengths.get(lengths.len() / 2)),
        ("max", lengths.last()),
    ];
    for (which, value) in figures {
        if let Some(&value) = value {
            let name = format!("{name}_interrupt_{which}_instructions");
            set.insert(name, value as f64);
        }
    }
}

/// Ports of `ports`, in the order of [`Stm32::wires`].
pub const AS2: usize = 1;
/// The index of port RS2.
pub const RS2: usize = 2;
/// The index of port RS4.
pub const RS4: usize = 3;

/// Registers of a port (`MB_xxx`), by number, and values.
const MODE: u16 = 0;
const OFF: u32 = 2;
const SLAVE: u32 = 1;
const FRAMING: u16 = 1;
const BAUD: u16 = 22;
const FORMAT: u16 = 23;

/// `ports` with its master off and a host on each of the other three wires; AS1 is unit 10, at 38400 8N1.
pub struct Managed {
    /// All of it.
    pub bus: Bus,
    /// The STM32 on the bus.
    pub machine: MachineId,
    /// On AS1, AS2 and RS2.
    pub hosts: [HostId; 3],
    name: String,
}

impl Managed {
    /// Boots it. The interrupts of these handlers are timed.
    pub fn new(image: &Image, handlers: &[&str]) -> Result<Self, Trouble> {
        let mut bus = Bus::new(BusConfig::default());
        let wires = [WireId::default(), bus.add_wire(), bus.add_wire()];
        let [as1, as2, rs2] = wires;
        let stm32 = Stm32 {
            name: image.name(),
            image: image.path.clone(),
            emulator: Emulator::qemu()?,
            wires: [Some(as1), Some(as2), Some(rs2), None],
        };
        let machine = bus.add_stm32_in_parts(stm32, parts(image, handlers)?)?;
        let hosts = wires.map(|wire| bus.add_host_on(wire, HostPort::new(image.line())));
        bus.run_for(Time::from_ms(20));
        let name = image.name();
        let mut managed = Managed {
            bus,
            machine,
            hosts,
            name,
        };
        managed.load(RS4, MODE, OFF)?;
        Ok(managed)
    }

    /// Makes a port an RTU slave at this rate, 8N1.
    pub fn make_slave(&mut self, port: usize, baud: u32) -> Result<(), Trouble> {
        for (register, value) in [(FORMAT, 0), (FRAMING, 0), (MODE, SLAVE), (BAUD, baud)] {
            self.load(port, register, value)?;
        }
        self.bus.host(self.hosts[port]).set_line(Line::n81(baud));
        Ok(())
    }

    fn load(&mut self, port: usize, register: u16, value: u32) -> Result<(), Trouble> {
        let first = 1000 * (port as u16 + 1) + 2 * register;
        let request = block(10, 16, first, 2, &value.to_be_bytes());
        self.expect(0, &request, &words(10, 16, first, 2)).map(drop)
    }

    /// Asks on a wire, and gives from the request's end to the answer's first start bit.
    pub fn expect(&mut self, port: usize, request: &[u8], answer: &[u8]) -> Result<Time, Trouble> {
        let patience = Time::from_ms(100);
        let heard = self.bus.transact(self.hosts[port], request, patience);
        match heard {
            Some(heard) if heard.bytes == answer && heard.is_clean() => Ok(heard.turnaround()),
            heard => Err(Trouble::Firmware {
                image: self.name.clone(),
                what: format!("{request:02x?} on port {port} was answered {heard:02x?}"),
            }),
        }
    }
}

/// AS2 of `ports`, a managed port, as an RTU slave at the rate that `registers` has.
pub fn of_managed(image: &Image, set: &mut Set) -> Result<(), Trouble> {
    const UNIT: u8 = 1;
    let mut managed = Managed::new(image, &[])?;
    managed.make_slave(AS2, image.baud)?;
    let mut random = Random::new(1);
    let mut cells = vec![0; 32];
    managed.expect(
        AS2,
        &block(UNIT, 16, 0, 16, &cells),
        &words(UNIT, 16, 0, 16),
    )?;
    for shape in [Shape::Read(1), Shape::Read(16), Shape::Write(16)] {
        let mut work = Work::default();
        for _ in 0..EXCHANGES {
            managed
                .bus
                .run_for(Time::from_ps(random.next() % Time::from_ms(2).ps()));
            let (request, answer) = match shape {
                Shape::Write(count) => {
                    cells = random.bytes(2 * usize::from(count));
                    let request = block(UNIT, 16, 0, count, &cells);
                    (request, words(UNIT, 16, 0, count))
                }
                Shape::Read(count) => {
                    let read = &cells[..2 * usize::from(count)];
                    (words(UNIT, 3, 0, count), data(UNIT, 3, read))
                }
                Shape::WriteOne => {
                    let request = adu(&[UNIT, 6, 0, 0, cells[0], cells[1]]);
                    (request.clone(), request)
                }
            };
            let before = managed.bus.machine(managed.machine).counted();
            managed.expect(AS2, &request, &answer)?;
            managed.bus.run_for(AFTER);
            work.add(managed.bus.machine(managed.machine).counted() - before);
        }
        work.store(set, &shape.name());
    }
    Ok(())
}
