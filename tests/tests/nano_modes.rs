//! A managed port in the simulator, the HAL's example `modes`: master and slave, RTU and ASCII, two bauds, switched
//! by pins under traffic. At any moment of a switch the node sends only whole frames.

use multidrop_bus::{
    Bus, BusConfig, Format, HostId, HostPort, Level, Line, Nano, NodeId, Pin, Record, Station,
    Time, WireByte,
};
use multidrop_testkit::random::Random;
use multidrop_testkit::{example, frames};

/// What the pins say.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Way {
    master: bool,
    ascii: bool,
    fast: bool,
}

const START: Way = Way {
    master: false,
    ascii: false,
    fast: false,
};

impl Way {
    fn line(self) -> Line {
        Line {
            baud: if self.fast { 115_200 } else { 38_400 },
            format: if self.ascii { Format::E71 } else { Format::N81 },
        }
    }

    /// Unit id and PDU as a frame.
    fn frame(self, body: &[u8]) -> Vec<u8> {
        if !self.ascii {
            return frames::adu(body);
        }
        let sum: u32 = body.iter().map(|byte| u32::from(*byte)).sum();
        let mut text = String::from(":");
        for byte in body {
            text += &format!("{byte:02X}");
        }
        text += &format!("{:02X}\r\n", (256 - sum % 256) % 256);
        text.into_bytes()
    }

    fn all() -> impl Iterator<Item = Way> {
        (0..8).map(|bits| Way {
            master: bits & 1 != 0,
            ascii: bits & 2 != 0,
            fast: bits & 4 != 0,
        })
    }
}

/// Unit id and PDU of a whole frame, RTU or ASCII; `None` if it is none.
fn body(bytes: &[u8]) -> Option<Vec<u8>> {
    if let [b':', digits @ .., b'\r', b'\n'] = bytes {
        let text = std::str::from_utf8(digits).ok()?;
        let body: Vec<u8> = (0..text.len())
            .step_by(2)
            .map(|at| u8::from_str_radix(text.get(at..at + 2)?, 16).ok())
            .collect::<Option<_>>()?;
        let sum: u32 = body.iter().map(|byte| u32::from(*byte)).sum();
        return sum
            .is_multiple_of(256)
            .then(|| body[..body.len() - 1].to_vec());
    }
    let body = bytes.get(..bytes.len().checked_sub(2)?)?;
    (frames::adu(body) == bytes).then(|| body.to_vec())
}

struct Rig {
    bus: Bus,
    node: NodeId,
    host: HostId,
    way: Way,
    random: Random,
    /// What slave 2 answers next, plus the register's number.
    level: u16,
}

const SLAVE: u8 = 1;
const PEER: u8 = 2;

impl Rig {
    fn new(seed: u64) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let watch = [0, 1, 2].map(|bit| Pin::new('B', bit).expect("a pin"));
        let node = bus
            .add_nano(Nano {
                watch: watch.to_vec(),
                ..Nano::new("modes", example("modes"))
            })
            .expect("a valid image");
        let host = bus.add_host(HostPort::new(START.line()));
        let mut rig = Rig {
            bus,
            node,
            host,
            way: START,
            random: Random::new(seed),
            level: 0x1100,
        };
        rig.set_pins(START);
        rig.bus.run_for(Time::from_ms(30));
        rig
    }

    fn set_pins(&mut self, way: Way) {
        let node = self.bus.node_mut(self.node);
        for (pin, low) in [
            (Pin::D3, way.master),
            (Pin::D4, way.ascii),
            (Pin::D5, way.fast),
        ] {
            node.set_input(pin, Some(!low));
        }
        self.way = way;
    }

    fn set_line(&mut self) {
        let line = self.way.line();
        self.bus.host(self.host).set_line(line);
        self.bus.host(self.host).take();
    }

    /// Asks the node for its four registers, as it is set up.
    fn ask(&mut self) -> Option<Vec<u8>> {
        let request = self.way.frame(&[SLAVE, 3, 0, 0, 0, 4]);
        let answer = self.bus.transact(self.host, &request, Time::from_ms(60))?;
        Some(answer.bytes)
    }

    fn registers(&self) -> Vec<u8> {
        let words = (0..4).map(|index| self.level + index);
        words.flat_map(u16::to_be_bytes).collect()
    }

    fn expect_answer(&mut self) {
        let data = self.registers();
        let expected = self.way.frame(&[&[SLAVE, 3, 8], &data[..]].concat());
        assert_eq!(
            self.ask(),
            Some(expected),
            "{:?}\n{}",
            self.way,
            self.bus.record()
        );
    }

    /// Is slave 2 for a while; gives how many requests it has answered.
    fn be_slave(&mut self, ms: u64) -> usize {
        let end = self.bus.now() + Time::from_ms(ms);
        let mut answered = 0;
        while self.bus.now() < end {
            self.bus.run_for(Time::from_us(100));
            let quiet = self.way.line().t35();
            let (now, host) = (self.bus.now(), self.bus.host(self.host));
            let over = host
                .heard()
                .last()
                .is_some_and(|byte| byte.end + quiet < now);
            if !over || host.is_receiving() {
                continue;
            }
            let heard: Vec<u8> = host.take().iter().map(|byte| byte.value).collect();
            if body(&heard).as_deref() != Some(&[PEER, 3, 0, 0, 0, 4]) {
                continue;
            }
            self.level = self.level.wrapping_add(0x0101);
            let data = self.registers();
            let answer = self.way.frame(&[&[PEER, 3, 8], &data[..]].concat());
            let sent = self.bus.host(self.host).send(&answer);
            self.bus.run_to(sent);
            answered += 1;
        }
        answered
    }

    /// Traffic in the way it is, ended at any moment of it.
    fn traffic(&mut self) {
        if self.way.master {
            let ms = 30 + self.random.below(40);
            self.be_slave(ms.into());
            // Any moment between two requests, in a request, or while an answer is waited for.
            let us = self.random.below(25_000);
            self.bus.run_for(Time::from_us(us.into()));
            return;
        }
        for _ in 0..self.random.below(3) {
            self.expect_answer();
        }
        let request = self.way.frame(&[SLAVE, 3, 0, 0, 0, 4]);
        self.bus.host(self.host).send(&request);
        let us = self.random.below(12_000);
        self.bus.run_for(Time::from_us(us.into()));
    }

    /// Switches, with somebody still talking in the old way now and then, and checks that the next request is right.
    fn switch(&mut self, way: Way) {
        let before = self.way;
        self.set_pins(way);
        if !before.master && !way.master && self.random.one_in(2) {
            self.bus.run_for(Time::from_ms(15));
            let old = before.frame(&[SLAVE, 3, 0, 0, 0, 4]);
            self.bus.host(self.host).send(&old);
        }
        self.bus.run_for(Time::from_ms(40));
        self.set_line();
        let changing = Pin::new('B', 0).expect("a pin");
        assert_eq!(
            self.bus.node(self.node).output(changing),
            Level::Low,
            "a load was refused"
        );
        if way.master {
            assert!(
                self.be_slave(100) >= 2,
                "{before:?} to {way:?}\n{}",
                self.bus.record()
            );
        } else {
            // The last answer of the peer may have come after its time.
            self.bus.run_for(Time::from_ms(20));
            if before.master {
                let answer = self.ask().expect("an answer");
                let answer = body(&answer).expect("a whole one");
                assert_eq!(answer[..3], [SLAVE, 3, 8]);
                let last = [self.level, self.level.wrapping_sub(0x0101)];
                let level = u16::from_be_bytes([answer[3], answer[4]]);
                assert!(last.contains(&level), "{level:04x} of {last:04x?}");
                self.level = level;
            }
            self.expect_answer();
        }
    }

    /// Lets it come to rest, and judges the record.
    fn check(&mut self) {
        self.bus
            .run_for(Time::from_ms(if self.way.master { 0 } else { 10 }));
        while self.is_driving() {
            self.bus.run_for(Time::from_us(500));
        }
        assert_eq!(self.bus.node(self.node).bad_opcodes(), 0);
        assert_whole_frames(self.bus.record(), self.node);
        self.bus.clear_record();
    }

    fn is_driving(&self) -> bool {
        self.bus.node(self.node).output(Pin::D2) == Level::High
    }
}

/// How long DE may stay up: where the clock is read, or goes round, other interrupts wait.
const DE_LAG: Time = Time::from_us(20);

/// DE is up for whole frames of the node alone, one at a time, without a gap, and no bit of it is elsewhere (SER 3.2).
fn assert_whole_frames(record: &Record, node: NodeId) {
    assert_eq!(record.conflicts(), [], "\n{record}");
    let broken = |what: &str| panic!("{what}\n{record}");
    let mut sent: Vec<WireByte> = record.sent_by(Station::Node(node)).copied().collect();
    let edges: Vec<_> = record
        .de_edges()
        .iter()
        .filter(|edge| edge.from == node.into())
        .collect();
    for pair in edges.chunks(2) {
        let [on, off] = pair else {
            return broken("DE is up at the end");
        };
        assert!(on.on && !off.on);
        let rest = sent.split_off(sent.partition_point(|byte| byte.start < off.time));
        let frame = std::mem::replace(&mut sent, rest);
        let (Some(first), Some(last)) = (frame.first(), frame.last()) else {
            return broken("DE without a character");
        };
        let character = first.end - first.start;
        if first.start < on.time || first.start - on.time > character {
            broken("DE up too early or too late");
        }
        if off.time < last.end || off.time - last.end > DE_LAG {
            broken("DE down too early or too late");
        }
        if frame.windows(2).any(|pair| pair[0].end != pair[1].start) {
            broken("idle time between characters");
        }
        let bytes: Vec<u8> = frame.iter().map(|byte| byte.value as u8).collect();
        if !frame.iter().all(WireByte::is_good) || body(&bytes).is_none() {
            broken("not a whole frame");
        }
    }
    if !sent.is_empty() {
        broken("a character without DE");
    }
}

#[test]
fn after_every_change_of_mode_the_next_request_is_right() {
    let mut rig = Rig::new(1);
    rig.expect_answer();
    for from in Way::all() {
        for to in Way::all() {
            rig.switch(from);
            rig.check();
            rig.traffic();
            rig.switch(to);
            rig.check();
        }
    }
}

#[test]
fn switched_at_any_moment_of_any_traffic_there_is_no_stray_bit() {
    let ways: Vec<Way> = Way::all().collect();
    for seed in 0..4 {
        let mut rig = Rig::new(100 + seed);
        for _ in 0..40 {
            rig.traffic();
            let way = rig.random.pick(&ways);
            rig.switch(way);
            rig.check();
        }
    }
}

/// Setting the line up anew with another baud broke the CRC: esp-modbus #153.
#[test]
fn the_check_is_right_after_every_change_of_baud() {
    let mut rig = Rig::new(3);
    for turn in 0..20 {
        let way = Way {
            fast: turn & 1 == 0,
            ..START
        };
        rig.switch(way);
        for _ in 0..3 {
            rig.expect_answer();
        }
        // What is damaged is not answered, at any baud.
        let mut request = way.frame(&[SLAVE, 3, 0, 0, 0, 4]);
        request[3] ^= 1;
        let answer = rig.bus.transact(rig.host, &request, Time::from_ms(30));
        assert!(answer.is_none());
        rig.check();
    }
}

#[test]
fn the_image_fits_and_sleeps() {
    let mut rig = Rig::new(4);
    let ram = rig.bus.node(rig.node).static_ram();
    rig.bus.node_mut(rig.node).paint_stack();
    rig.traffic();
    rig.switch(Way {
        master: true,
        ascii: true,
        fast: true,
    });
    rig.be_slave(200);
    rig.switch(START);
    let stack = rig.bus.node(rig.node).stack_peak();
    println!("static RAM {ram}, peak stack {stack}");
    assert!(ram + stack < 2048 - 128, "{ram} + {stack}");
    rig.bus.node_mut(rig.node).clear_stats();
    rig.bus.run_for(Time::from_ms(500));
    let stats = rig.bus.node(rig.node).stats();
    let share = stats.asleep as f64 / (stats.asleep + stats.awake) as f64;
    println!("asleep {share}");
    assert!(share > 0.8, "{share}");
}
