//! One node with its host, what is asked of it, and what an exchange looked like on the wire.

use multidrop_bus::{
    Bus, BusConfig, Emulator, HostId, HostPort, Line, MachineId, Nano, NodeId, Parts, Station,
    Stm32, Time, Tx, WireId,
};

use crate::Trouble;
use crate::image::Image;
use multidrop_testkit::frames::{block, words};
use multidrop_testkit::model::Model;
use multidrop_testkit::random::Random;

/// The unit id of `registers`.
const UNIT: u8 = 1;

/// A request of a fixed shape, at random addresses and with random data where that is possible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// FC 03 with this number of registers.
    Read(u16),
    /// Write Single Register, FC 06.
    WriteOne,
    /// FC 10 with this number of registers.
    Write(u16),
}

impl Shape {
    /// All whose turnaround is measured with `count` registers.
    pub fn measured(count: u8) -> Vec<Shape> {
        let all = [
            Shape::Read(1),
            Shape::Read(16),
            Shape::WriteOne,
            Shape::Write(16),
            Shape::Read(125),
            Shape::Write(123),
        ];
        let fits = |shape: &Shape| shape.registers() <= u16::from(count);
        all.into_iter().filter(fits).collect()
    }

    fn registers(self) -> u16 {
        match self {
            Shape::Read(quantity) | Shape::Write(quantity) => quantity,
            Shape::WriteOne => 1,
        }
    }

    /// What it is called: function code and, after `x`, the number of registers.
    pub fn name(self) -> String {
        match self {
            Shape::Read(quantity) => format!("03x{quantity}"),
            Shape::WriteOne => "06".to_owned(),
            Shape::Write(quantity) => format!("10x{quantity}"),
        }
    }

    /// The request, to a unit with `count` registers.
    pub fn request(self, count: u8, random: &mut Random) -> Vec<u8> {
        let address = random.below(u16::from(count) - self.registers() + 1);
        match self {
            Shape::Read(quantity) => words(UNIT, 3, address, quantity),
            Shape::WriteOne => words(UNIT, 6, address, random.next() as u16),
            Shape::Write(quantity) => {
                let data = random.bytes(2 * usize::from(quantity));
                block(UNIT, 0x10, address, quantity, &data)
            }
        }
    }
}

/// Any of the eight functions, short and as long as `count` and a frame allow, one in eleven refused.
pub fn mixed(count: u8, random: &mut Random) -> Vec<u8> {
    let count = u16::from(count);
    let quantity = 1 + random.below(count);
    let address = random.below(count - quantity + 1);
    let longest = |limit: u16| limit.min(count);
    match random.below(11) {
        0 => words(UNIT, 1, address, quantity),
        1 => words(UNIT, 2, address, quantity),
        2 => words(UNIT, 3, address, 1),
        3 => words(UNIT, 3, 0, longest(125)),
        4 => words(UNIT, 4, 0, longest(125)),
        5 => words(UNIT, 5, address, random.pick(&[0, 0xff00])),
        6 => words(UNIT, 6, address, random.next() as u16),
        7 => {
            let data = random.bytes(usize::from(quantity.div_ceil(8)));
            block(UNIT, 0x0f, address, quantity, &data)
        }
        8 => {
            let quantity = longest(123);
            let data = random.bytes(2 * usize::from(quantity));
            block(UNIT, 0x10, 0, quantity, &data)
        }
        9 => words(UNIT, 3, count - quantity + 1, quantity),
        _ => words(UNIT, 0x63, 0, 0),
    }
}

/// An exchange as it was on the wire.
#[derive(Clone, Copy, Debug)]
pub struct Exchange {
    /// The request's last stop bit ended.
    pub request_end: Time,
    /// The answer's first start bit began.
    pub start: Time,
    /// The answer's last stop bit ended.
    pub end: Time,
    /// DE went up.
    pub de_up: Time,
    /// DE went down.
    pub de_down: Time,
    /// Longest pause between two characters of the answer.
    pub longest_gap: Time,
}

/// One node, one host, and a model of what the node must answer. The node is a Nano or an STM32.
pub struct Desk<N = NodeId> {
    /// The bus of the exchange.
    pub bus: Bus,
    /// The node that answers.
    pub node: N,
    /// The host that asks.
    pub host: HostId,
    /// Items in each table of the node.
    pub count: u8,
    /// Where all chance comes from.
    pub random: Random,
    station: Station,
    name: String,
    line: Line,
    model: Model,
}

impl Desk {
    /// Boots a node that is a Nano as sold but for what `change` does.
    pub fn new(image: &Image, change: impl FnOnce(&mut Nano)) -> Result<Self, Trouble> {
        let mut bus = Bus::new(BusConfig::default());
        let mut nano = Nano::new(image.name(), &image.path);
        change(&mut nano);
        let node = bus.add_nano(nano)?;
        Ok(Self::booted(bus, node, node.into(), image))
    }
}

impl Desk<MachineId> {
    /// Boots an STM32 in QEMU with RS4 on the wire, its instructions counted in parts.
    pub fn stm32(image: &Image, parts: Parts) -> Result<Self, Trouble> {
        let mut bus = Bus::new(BusConfig::default());
        let stm32 = Stm32 {
            name: image.name(),
            image: image.path.clone(),
            emulator: Emulator::qemu()?,
            wires: [None, None, None, Some(WireId::default())],
        };
        let machine = bus.add_stm32_in_parts(stm32, parts)?;
        let rs4 = bus.machine(machine).station(3);
        let rs4 = rs4.ok_or_else(|| Trouble::NoImage(image.name()))?;
        Ok(Self::booted(bus, machine, rs4, image))
    }
}

impl<N> Desk<N> {
    /// With the host, after what the node needs to boot.
    fn booted(mut bus: Bus, node: N, station: Station, image: &Image) -> Self {
        let host = bus.add_host(HostPort::new(image.line()));
        bus.run_for(Time::from_ms(20));
        Desk {
            bus,
            node,
            host,
            count: image.count,
            random: Random::new(u64::from(image.baud) << 8 | u64::from(image.count)),
            station,
            name: image.name(),
            line: image.line(),
            model: Model::new(UNIT, usize::from(image.count)),
        }
    }

    /// The settings of the line.
    pub fn line(&self) -> Line {
        self.line
    }

    /// Lets up to 2 ms pass: over a millisecond-long pattern of the timer and any phase of the bit clock.
    pub fn idle(&mut self) {
        let pause = self.chance(Time::from_ms(2));
        self.bus.run_for(pause);
    }

    /// A span shorter than `end`.
    pub fn chance(&mut self, end: Time) -> Time {
        Time::from_ps(self.random.next() % end.ps())
    }

    /// Sends these bytes as fast as the line goes and gives the exchange, or nothing where the answer is not
    /// the model's to the last bit.
    pub fn ask(&mut self, request: &[u8]) -> Option<Exchange> {
        self.ask_each(request.iter().map(|&byte| Tx::byte(byte)), request)
    }

    /// Sends a request whose characters are described one by one, and waits for its answer.
    pub fn ask_each(
        &mut self,
        characters: impl IntoIterator<Item = Tx>,
        request: &[u8],
    ) -> Option<Exchange> {
        let expected = self.model.answer(request);
        self.bus.clear_record();
        let host = self.bus.host(self.host);
        host.take();
        let request_end = host.send_each(characters);
        self.bus.run_to(request_end);
        let patience = self.line.t35() + Time::from_ms(5);
        let answer = self.bus.transact(self.host, &[], patience);
        let heard = answer.as_ref().map_or(&[][..], |answer| &answer.bytes);
        if heard != expected || !answer.as_ref().is_none_or(|answer| answer.is_clean()) {
            return None;
        }
        let record = self.bus.record();
        let sent: Vec<_> = record.sent_by(self.station).collect();
        let gaps = sent
            .windows(2)
            .map(|pair| pair[1].start.saturating_sub(pair[0].end));
        let de = |on| record.de_edges().iter().find(|edge| edge.on == on);
        Some(Exchange {
            request_end,
            start: sent.first()?.start,
            end: sent.last()?.end,
            de_up: de(true)?.time,
            de_down: de(false)?.time,
            longest_gap: gaps.max().unwrap_or(Time::ZERO),
        })
    }

    /// [`Desk::ask`] where a wrong answer is the firmware's fault.
    pub fn expect(&mut self, request: &[u8]) -> Result<Exchange, Trouble> {
        let exchange = self.ask(request);
        exchange.ok_or_else(|| Trouble::Firmware {
            image: self.name.clone(),
            what: format!("a wrong answer to {request:02x?}\n{}", self.bus.record()),
        })
    }
}
