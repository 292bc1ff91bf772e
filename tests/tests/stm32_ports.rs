//! The application `ports` of the STM32 in QEMU: four ports at once, three Nanos behind RS4.

mod common;

use common::frames::{adu, be, block, data, exception, words};
use common::{LINE, ports};
use multidrop_bus::{
    Bus, BusConfig, Format, HostId, HostPort, Line, MachineId, NodeId, Stm32, Time, Tx, WireId,
    barrier, frames,
};

const TEXT: Line = Line::n81(230_400);
const AS2: Line = Line {
    baud: 19_200,
    format: Format::E71,
};

/// Who is on the four wires. RS4's is the first one.
struct Desk {
    bus: Bus,
    pc: HostId,
    ascii: HostId,
    terminal: HostId,
    machine: MachineId,
    nodes: Vec<NodeId>,
}

impl Desk {
    fn new(units: &[u8]) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let nodes = units
            .iter()
            .map(|unit| {
                let image = common::image("demo-unit", &["--unit", &unit.to_string()]);
                bus.add_image(&format!("unit {unit}"), &image)
                    .expect("a valid image")
            })
            .collect();
        let rs4 = WireId::default();
        let [as1, as2, rs2] = [0; 3].map(|_| bus.add_wire());
        let machine = bus
            .add_stm32(Stm32 {
                name: "ports".to_owned(),
                image: ports(),
                plugin: barrier().expect("set-up has built it"),
                wires: [Some(as1), Some(as2), Some(rs2), Some(rs4)],
            })
            .expect("QEMU runs");
        let pc = bus.add_host_on(as1, HostPort::new(LINE));
        let ascii = bus.add_host_on(as2, HostPort::new(AS2));
        let terminal = bus.add_host_on(rs2, HostPort::new(TEXT));
        bus.run_for(Time::from_ms(20));
        Desk {
            bus,
            pc,
            ascii,
            terminal,
            machine,
            nodes,
        }
    }

    /// Asks as the PC does.
    #[track_caller]
    fn expect(&mut self, request: &[u8], answer: &[u8]) {
        let heard = self.bus.transact(self.pc, request, Time::from_ms(300));
        let heard = heard.map_or(Vec::new(), |answer| answer.bytes);
        assert_eq!(heard, answer, "{request:02x?}");
    }

    /// What was printed since the last call, line by line and without times.
    fn printed(&mut self) -> Vec<String> {
        let heard = self.bus.host(self.terminal).take();
        assert!(heard.iter().all(|byte| byte.is_good()));
        let bytes = heard.iter().map(|byte| byte.value).collect();
        let text = String::from_utf8(bytes).expect("ASCII");
        let lines = text.split_terminator("\r\n");
        let mut last = 0.0;
        lines
            .map(|line| {
                let (time, line) = line.split_once(' ').expect("a time");
                let time: f64 = time.parse().expect("seconds");
                assert!(time > last, "{time} behind {last}");
                last = time;
                line.to_owned()
            })
            .collect()
    }
}

/// LOAD of a register of AS2 (0), RS2 (1) or RS4 (2).
fn load(port: u16, number: u16, value: u32) -> (Vec<u8>, Vec<u8>) {
    let first = 1000 * (port + 1) + 2 * number;
    let request = block(10, 16, first, 2, &value.to_be_bytes());
    (request, words(10, 16, first, 2))
}

/// A frame of unit id and PDU in ASCII (SER 2.5.2).
fn in_ascii(body: &[u8]) -> Vec<u8> {
    let sum = body.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    let bytes = [body, &[sum.wrapping_neg()]].concat();
    let digits: String = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    format!(":{digits}\r\n").into_bytes()
}

/// A host that asks again and again, beside others.
struct Asker {
    host: HostId,
    line: Line,
    due: Time,
    waits: Option<(Vec<u8>, Vec<u8>)>,
    answers: u32,
}

impl Asker {
    fn new(host: HostId, line: Line) -> Self {
        Asker {
            host,
            line,
            due: Time::ZERO,
            waits: None,
            answers: 0,
        }
    }

    /// Whether it may ask.
    fn is_free(&mut self, bus: &mut Bus) -> bool {
        let now = bus.now();
        let host = bus.host(self.host);
        if let Some((request, answer)) = &self.waits {
            let heard: Vec<u8> = host.heard().map(|byte| byte.value).collect();
            if heard.len() >= answer.len() {
                assert_eq!(heard, *answer, "answer to {request:02x?}");
                host.take();
                self.answers += 1;
                self.waits = None;
                self.due = now + self.line.t35() + self.line.character();
            } else {
                assert!(
                    now < self.due,
                    "{request:02x?} was answered {heard:02x?} at {now}"
                );
            }
            return false;
        }
        assert_eq!(host.heard().len(), 0, "unasked");
        now >= self.due
    }

    fn ask(&mut self, bus: &mut Bus, request: Vec<u8>, answer: Vec<u8>) {
        let end = bus.host(self.host).send(&request);
        self.due = end + Time::from_ms(400);
        self.waits = Some((request, answer));
    }
}

#[test]
fn four_ports_at_once_for_30_s_one_of_them_changed_each_second() {
    let mut desk = Desk::new(&[1, 2, 3]);
    let bus = &mut desk.bus;
    let mut pc = Asker::new(desk.pc, LINE);
    let mut ascii = Asker::new(desk.ascii, AS2);
    let mut units = [0_u16; 3];
    let mut cells = [0_u16; 16];
    let (mut unit, mut is_rtu) = (1_u8, false);
    let mut rounds = 0_u16;
    let mut asked = 0_u16;
    let mut loads = Vec::new();
    let mut next_change = bus.now() + Time::from_ms(1_000);
    let end = bus.now() + Time::from_ms(30_000);
    while bus.now() < end {
        bus.run_for(Time::from_us(500));
        if pc.is_free(bus) {
            if let Some((request, answer)) = loads.pop() {
                pc.ask(bus, request, answer);
            } else {
                rounds += 1;
                let place = usize::from(rounds / 2 % 3);
                let to = place as u8 + 1;
                let (request, answer) = if rounds.is_multiple_of(2) {
                    units[place] = rounds.wrapping_mul(26_541);
                    let request = words(to, 6, 0, units[place]);
                    (request.clone(), request)
                } else {
                    (words(to, 3, 0, 1), data(to, 3, &be(&[units[place]])))
                };
                pc.ask(bus, request, answer);
            }
        }
        // AS2 is changed between two exchanges: unit id, framing, baud.
        let is_free = ascii.is_free(bus);
        if bus.now() >= next_change && is_free {
            next_change = bus.now() + Time::from_ms(1_000);
            is_rtu = !is_rtu;
            unit = unit % 200 + 7;
            let line = Line {
                baud: if is_rtu { 57_600 } else { 19_200 },
                format: if is_rtu { Format::N81 } else { Format::E71 },
            };
            bus.host(desk.ascii).set_line(line);
            // The last one is the first to be loaded. RTU has no seven bits.
            let (framing, format) = (
                load(0, 1, u32::from(!is_rtu)),
                load(0, 23, if is_rtu { 0 } else { 4 }),
            );
            let (first, second) = if is_rtu {
                (format, framing)
            } else {
                (framing, format)
            };
            loads.extend([
                load(0, 22, line.baud),
                load(0, 5, unit.into()),
                second,
                first,
            ]);
            ascii.line = line;
            // Until all are loaded, and t3.5 of silence.
            ascii.due = bus.now() + Time::from_ms(300);
        } else if is_free && loads.is_empty() {
            asked += 1;
            let place = usize::from(asked / 2 % 16);
            let mut body = vec![unit, 3, 0, place as u8, 0, 1];
            let mut answer = vec![unit, 3, 2];
            if asked.is_multiple_of(2) {
                cells[place] = asked.wrapping_mul(40_503);
                body[1] = 6;
                body[4..].copy_from_slice(&cells[place].to_be_bytes());
                answer = body.clone();
            } else {
                answer.extend(cells[place].to_be_bytes());
            }
            match is_rtu {
                true => ascii.ask(bus, adu(&body), adu(&answer)),
                false => ascii.ask(bus, in_ascii(&body), in_ascii(&answer)),
            }
        }
    }
    // What is under way ends.
    bus.run_for(Time::from_ms(400));
    assert!(
        pc.answers > 1_500 && ascii.answers > 1_500,
        "{} {}",
        pc.answers,
        ascii.answers
    );

    // RS4: a request, its answer, and nothing else; all of it was printed.
    let on_rs4 = frames(bus.record_of(WireId::default()), LINE);
    assert_eq!(bus.record().conflicts(), []);
    let mut expected = Vec::new();
    let over = desk.bus.now() - Time::from_ms(20);
    for pair in on_rs4.chunks(2) {
        // What is not whole, or not printed yet.
        let [request, answer] = pair else { break };
        if answer.end() > over {
            break;
        }
        for (frame, way) in [(request, "req"), (answer, "ans")] {
            let body = frame.body().expect("a good frame");
            let hex: String = body.iter().map(|byte| format!(" {byte:02X}")).collect();
            expected.push(format!("{way}{hex}"));
        }
    }
    assert!(expected.len() > 4_000, "{}", expected.len());
    let printed = desk.printed();
    assert!(printed.len() >= expected.len());
    assert_eq!(printed[..expected.len()], expected);
    for port in 0..4 {
        assert_eq!(desk.bus.machine(desk.machine).overruns(port), 0);
    }

    // What was collected, no poll that failed, nothing that was not printed.
    let heard = desk
        .bus
        .transact(desk.pc, &words(10, 4, 0, 10), Time::from_ms(100));
    let heard = heard.expect("an answer").bytes;
    let told: Vec<u16> = heard[3..23]
        .chunks(2)
        .map(|pair| u16::from_be_bytes([pair[0], pair[1]]))
        .collect();
    assert_eq!(told[..3], units);
    assert!(told[3..6].iter().all(|count| *count > 250), "{told:?}");
    assert_eq!(told[6..], [0; 4]);
}

#[test]
fn units_that_are_missing_and_ports_that_refuse() {
    let mut desk = Desk::new(&[2]);
    // A missing unit is told within the route's timeout, and the next request is answered.
    for round in 0..3 {
        desk.expect(&words(1, 3, 0, 1), &exception(1, 3, 0x0B));
        let write = words(2, 6, 0, round);
        desk.expect(&write, &write);
        desk.expect(&words(2, 3, 0, 1), &data(2, 3, &be(&[round])));
    }
    // The unit's own exception.
    desk.expect(&words(2, 3, 5, 1), &exception(2, 3, 2));
    // What a port refuses is 03, what there is not 02; all can be read.
    let (request, _) = load(2, 22, 5_000_000);
    desk.expect(&request, &exception(10, 16, 3));
    desk.expect(&words(10, 3, 3044, 2), &data(10, 3, &be(&[0, 38_400])));
    let (request, _) = load(3, 22, 9_600);
    desk.expect(&request, &exception(10, 16, 2));
    desk.expect(&words(10, 6, 3044, 1), &exception(10, 6, 2));
    desk.expect(&words(10, 3, 1006, 2), &exception(10, 3, 2));
    // The Nano is asleep, then off the bus: an asker that has given up finds the port as ever.
    let node = desk.nodes[0];
    desk.bus.unplug(node);
    desk.bus.host(desk.pc).send(&words(2, 3, 0, 1));
    desk.bus.run_for(Time::from_ms(10));
    desk.expect(&words(10, 3, 3044, 2), &data(10, 3, &be(&[0, 38_400])));
    desk.bus.plug(node);
    desk.expect(&words(2, 3, 0, 1), &data(2, 3, &be(&[2])));
}

#[test]
fn what_is_printed_is_what_was_on_the_wire_in_1000_exchanges_with_faults() {
    let mut desk = Desk::new(&[]);
    let bus = desk.bus.add_host_on(WireId::default(), HostPort::new(LINE));
    // RS4 listens only. Its last poll is over before the first exchange.
    let (request, answer) = load(2, 0, 3);
    desk.expect(&request, &answer);
    desk.bus.run_for(Time::from_ms(400));
    desk.printed();
    let mut random = common::random::Random::new(5);
    let mut expected = Vec::new();
    let mut damaged = 0;
    for _ in 0..1_000 {
        let unit = 1 + random.below(247) as u8;
        let count = 1 + random.below(20) as u8;
        let request = vec![unit, 3, random.next() as u8, random.next() as u8, 0, count];
        let (way, answer) = match random.one_in(10) {
            true => ("exc", vec![unit, 0x83, 1 + random.below(4) as u8]),
            false => {
                let mut answer = vec![unit, 3, 2 * count];
                answer.extend(random.bytes(2 * usize::from(count)));
                ("ans", answer)
            }
        };
        let mut is_asked = false;
        for (way, body) in [("req", request), (way, answer)] {
            let frame = adu(&body);
            let hex: String = body.iter().map(|byte| format!(" {byte:02X}")).collect();
            let mut characters: Vec<_> = frame.iter().map(|byte| Tx::byte(*byte)).collect();
            let at = usize::from(random.below(frame.len() as u16));
            expected.push(if random.one_in(100) {
                damaged += 1;
                match random.below(3) {
                    0 => {
                        characters[at] = characters[at].flip_bit(random.below(8) as u8);
                        "bad check".to_owned()
                    }
                    1 => {
                        characters[at] = characters[at].bad_stop();
                        "bad framing".to_owned()
                    }
                    _ => {
                        let at = at.max(1);
                        characters[at] = characters[at].after(Time::from_us(1_200));
                        // What came before the gap is judged as a frame first.
                        let short = if at < 4 { " length" } else { "" };
                        format!("bad gap{short} check")
                    }
                }
            } else if way == "req" || is_asked {
                is_asked = true;
                format!("{way}{hex}")
            } else {
                // Its request was damaged: nothing says that it is an answer.
                format!("req{hex}")
            });
            let end = desk.bus.host(bus).send_each(characters);
            desk.bus.run_to(end + Time::from_ms(3));
        }
    }
    desk.bus.run_for(Time::from_ms(100));
    let printed = desk.printed();
    for (number, (printed, expected)) in printed.iter().zip(&expected).enumerate() {
        assert_eq!(printed, expected, "line {number}");
    }
    assert_eq!(printed.len(), expected.len());
    assert!(damaged > 10, "{damaged}");
}
