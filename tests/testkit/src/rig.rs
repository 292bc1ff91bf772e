//! One node with the image `registers`, and a host that sends it requests.

use std::path::Path;

use multidrop_bus::{
    Answer, Bus, BusConfig, HostId, HostPort, Line, Nano, NodeId, Station, Stm32, Time, Tx, WireId,
};

use super::frames::{data, words};
use super::{LINE, Rules, Runner, assert_bus_rules, image, registers};

/// A bus with one host and nodes. Every exchange is held against the rules of the bus.
pub struct Rig {
    /// The bus with its nodes.
    pub bus: Bus,
    /// The nodes, in their order.
    pub nodes: Vec<NodeId>,
    /// The host that asks.
    pub host: HostId,
    /// What all are set to.
    pub line: Line,
    /// Characters that nodes sent in what was checked last.
    pub answered: usize,
    /// How long after t3.5 an answer may begin.
    pub slack: Time,
    /// Whether ASCII is spoken.
    is_ascii: bool,
}

impl Rig {
    /// A bus with these images, booted.
    pub fn with(images: &[&Path], line: Line) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let nodes = images
            .iter()
            .map(|image| {
                let name = image.file_stem().expect("a file").to_string_lossy();
                bus.add_image(&name, image).expect("a valid image")
            })
            .collect();
        let host = bus.add_host(HostPort::new(line));
        let mut rig = Rig {
            bus,
            nodes,
            host,
            line,
            answered: 0,
            slack: Time::from_ms(3),
            is_ascii: false,
        };
        rig.pause(Time::from_ms(20));
        rig
    }

    /// A bus with this Nano, booted.
    pub fn nano(nano: Nano, line: Line) -> Self {
        let mut rig = Self::with(&[], line);
        rig.nodes
            .push(rig.bus.add_nano(nano).expect("a valid image"));
        rig.pause(Time::from_ms(20));
        rig
    }

    /// A bus with an STM32 that runs this image, RS4 on the wire, booted.
    pub fn stm32(image: &Path, runner: Runner, line: Line) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        bus.add_stm32(Stm32 {
            name: "stm32".to_owned(),
            image: image.to_path_buf(),
            emulator: runner.emulator(),
            wires: [None, None, None, Some(WireId::default())],
        })
        .expect("a valid image");
        let host = bus.add_host(HostPort::new(line));
        let mut rig = Rig {
            bus,
            nodes: Vec::new(),
            host,
            line,
            answered: 0,
            slack: Time::from_ms(3),
            is_ascii: false,
        };
        rig.pause(Time::from_ms(20));
        rig
    }

    /// `registers` with `count` items in each table.
    pub fn registers(count: u8, line: Line) -> Self {
        Self::with(&[&registers(count, line)], line)
    }

    /// `registers` with 128 items in each table at 38400 8N1.
    pub fn full() -> Self {
        Self::registers(128, LINE)
    }

    /// One `demo-unit` for each unit id.
    pub fn units(units: &[u8]) -> Self {
        let images: Vec<_> = units
            .iter()
            .map(|unit| image("demo-unit", &["--unit", &unit.to_string()]))
            .collect();
        let paths: Vec<&Path> = images.iter().map(|path| path.as_path()).collect();
        Self::with(&paths, LINE)
    }

    /// A rig whose nodes speak ASCII.
    pub fn ascii(self) -> Self {
        Rig {
            is_ascii: true,
            ..self
        }
    }

    /// The first node.
    pub fn node(&self) -> NodeId {
        self.nodes[0]
    }

    /// Within this time of a request's end an answer has begun, or none comes.
    pub fn patience(&self) -> Time {
        self.line.t35() + self.slack
    }

    /// Lets time pass and holds it against the rules.
    pub fn pause(&mut self, span: Time) {
        self.bus.run_for(span);
        self.check();
    }

    /// Holds what was recorded against the rules and forgets it.
    pub fn check(&mut self) {
        let rules = match self.is_ascii {
            true => Rules::ascii(self.line),
            false => self.line.into(),
        };
        assert_bus_rules(&self.bus, rules);
        let bytes = self.bus.record().bytes().iter();
        self.answered = bytes
            .filter(|byte| byte.from != Station::Host(self.host))
            .count();
        self.bus.clear_record();
    }

    /// Sends a frame, gives all about its answer.
    pub fn exchange(&mut self, request: &[u8]) -> Option<Answer> {
        let answer = self.bus.transact(self.host, request, self.patience());
        self.check();
        if let Some(answer) = &answer {
            assert!(answer.is_clean(), "{answer:02x?}");
        }
        answer
    }

    /// Sends a frame, gives the bytes of its answer; empty if none comes.
    pub fn ask(&mut self, request: &[u8]) -> Vec<u8> {
        self.exchange(request)
            .map_or(Vec::new(), |answer| answer.bytes)
    }

    /// Sends characters as described and gives all bytes that come in until t3.5 and some more after
    /// the last of them, empty if none come.
    pub fn ask_each(&mut self, characters: impl IntoIterator<Item = Tx>) -> Vec<u8> {
        let characters: Vec<_> = characters.into_iter().collect();
        let host = self.bus.host(self.host);
        host.take();
        let end = host.send_each(characters);
        self.bus.run_to(end);
        // What came while it was being sent counts too.
        let mut bytes = self.heard();
        bytes.extend(
            self.bus
                .transact(self.host, &[], self.patience())
                .map_or(Vec::new(), |answer| answer.bytes),
        );
        self.check();
        bytes
    }

    fn heard(&mut self) -> Vec<u8> {
        let heard = self.bus.host(self.host).take();
        heard.iter().map(|byte| byte.value).collect()
    }

    /// Asks and compares the answer, byte for byte.
    #[track_caller]
    pub fn expect(&mut self, request: &[u8], answer: &[u8]) {
        let heard = self.ask(request);
        assert_eq!(
            heard, answer,
            "\n{request:02x?}\nanswered {heard:02x?}\nexpected {answer:02x?}"
        );
    }

    /// A frame that must not be answered.
    #[track_caller]
    pub fn expect_silence(&mut self, request: &[u8]) {
        self.expect(request, &[]);
    }

    /// A read of input register 2 by unit 1, which is always the same, must be answered.
    #[track_caller]
    pub fn expect_alive(&mut self) {
        self.expect(&ALIVE.request(), &ALIVE.answer());
    }

    /// Coils and holding registers of unit 1, `count` of each, as they are read on the bus.
    pub fn state(&mut self, count: u16) -> Vec<u8> {
        let mut state = self.ask(&words(1, 1, 0, count));
        let mut first = 0;
        while first < count {
            let quantity = (count - first).min(125);
            let answer = self.ask(&words(1, 3, first, quantity));
            assert_eq!(answer.len(), 5 + 2 * usize::from(quantity), "{answer:02x?}");
            state.extend(answer);
            first += quantity;
        }
        state
    }
}

/// The request that asks whether a node lives, and its answer.
pub struct Alive;

/// The value of [`Alive`], for all tests.
pub const ALIVE: Alive = Alive;

impl Alive {
    /// FC 04, one register from 2, unit 1.
    pub fn request(&self) -> Vec<u8> {
        words(1, 4, 2, 1)
    }

    /// The value 0x1002 as an answer.
    pub fn answer(&self) -> Vec<u8> {
        data(1, 4, &[0x10, 0x02])
    }
}
