//! The application `ports` of the STM32: four ports at once, three Nanos behind RS4.

use multidrop_bus::{HostId, HostPort, Line, Time, Tx, WireByte, WireId};
use multidrop_testkit::four::{self, AS1, Desk, RS2, RS4, TEXT, setting};
use multidrop_testkit::frames::{adu, be, block, data, exception, words};
use multidrop_testkit::{LINE, Runner, on_both, ports};

on_both! {
    four_ports_at_once_for_30_s_one_of_them_changed_each_second,
    units_that_are_missing_and_ports_that_refuse,
    what_is_printed_is_what_was_on_the_wire_in_1000_exchanges_with_faults,
    a_line_goes_on_where_it_was_when_the_printers_baud_is_changed_in_the_middle_of_it,
}

/// The machine, and these units behind RS4.
fn desk(runner: Runner, units: &[u8]) -> Desk {
    let images: Vec<_> = units
        .iter()
        .map(|unit| multidrop_testkit::image("demo-unit", &["--unit", &unit.to_string()]))
        .collect();
    let images: Vec<_> = images.iter().map(|image| image.as_path()).collect();
    Desk::new(&ports(runner), runner.emulator(), &images).expect("valid images")
}

/// Asks as the PC does.
#[track_caller]
fn expect(desk: &mut Desk, request: &[u8], answer: &[u8]) {
    let heard = desk.bus.transact(desk.pc, request, Time::from_ms(300));
    let heard = heard.map_or(Vec::new(), |answer| answer.bytes);
    assert_eq!(heard, answer, "{request:02x?}");
}

/// What was printed since the last call, line by line and without times.
fn printed(desk: &mut Desk) -> Vec<String> {
    let heard = desk.bus.host(desk.terminal).take();
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

/// LOAD of a port's register, and its answer.
fn load(port: usize, number: u16, value: u32) -> (Vec<u8>, Vec<u8>) {
    let first = setting(port, number);
    let request = block(10, 16, first, 2, &value.to_be_bytes());
    (request, words(10, 16, first, 2))
}

/// The machine with RS4 listening only, and a host on its wire. Its last poll is over, and printed.
fn listening(runner: Runner) -> (Desk, HostId) {
    let mut desk = desk(runner, &[]);
    let bus = desk.bus.add_host_on(WireId::default(), HostPort::new(LINE));
    let (request, answer) = load(RS4, 0, 3);
    expect(&mut desk, &request, &answer);
    desk.bus.run_for(Time::from_ms(400));
    printed(&mut desk);
    (desk, bus)
}

fn four_ports_at_once_for_30_s_one_of_them_changed_each_second(runner: Runner) {
    let mut desk = desk(runner, &[1, 2, 3]);
    let report = four::run(&mut desk, Time::from_ms(30_000));
    println!("{report:#?}");
    assert_eq!((report.lost, report.wrong), (0, 0), "{report:#?}");
    assert_eq!(report.overruns, [0; 4]);
    let [as1, as2, rs2, rs4] = report.answers;
    assert!(as1 > 1_500 && as2 > 1_000, "{report:#?}");
    assert!(rs4 > 2_000 && rs2 > 2 * rs4, "{report:#?}");
    assert!(report.reconfigurations.iter().sum::<u32>() >= 29);
}

fn units_that_are_missing_and_ports_that_refuse(runner: Runner) {
    let mut desk = desk(runner, &[2]);
    // A missing unit is told within the route's timeout, and the next request is answered.
    for round in 0..3 {
        expect(&mut desk, &words(1, 3, 0, 1), &exception(1, 3, 0x0B));
        let write = words(2, 6, 0, round);
        expect(&mut desk, &write, &write);
        expect(&mut desk, &words(2, 3, 0, 1), &data(2, 3, &be(&[round])));
    }
    // The unit's own exception.
    expect(&mut desk, &words(2, 3, 5, 1), &exception(2, 3, 2));
    // What a port refuses is 03, what there is not 02; all can be read.
    let (request, _) = load(RS4, 22, 5_000_000);
    expect(&mut desk, &request, &exception(10, 16, 3));
    expect(
        &mut desk,
        &words(10, 3, 4044, 2),
        &data(10, 3, &be(&[0, 38_400])),
    );
    let (request, _) = load(RS4 + 1, 22, 9_600);
    expect(&mut desk, &request, &exception(10, 16, 2));
    expect(&mut desk, &words(10, 6, 4044, 1), &exception(10, 6, 2));
    expect(&mut desk, &words(10, 3, 2006, 2), &exception(10, 3, 2));
    // A pair of wires for each direction is for a port without DE; RTS and CTS are nobody's here.
    const DUPLEX: u16 = 24;
    const FLOW: u16 = 25;
    let (request, answer) = load(AS1, DUPLEX, 1);
    expect(&mut desk, &request, &answer);
    for (port, register) in [(RS4, DUPLEX), (AS1, FLOW), (RS4, FLOW)] {
        let (request, _) = load(port, register, 1);
        expect(&mut desk, &request, &exception(10, 16, 3));
    }
    // The Nano is asleep, then off the bus: a client that has given up finds the port as ever.
    let node = desk.nodes[0];
    desk.bus.unplug(node);
    desk.bus.host(desk.pc).send(&words(2, 3, 0, 1));
    desk.bus.run_for(Time::from_ms(10));
    expect(
        &mut desk,
        &words(10, 3, 4044, 2),
        &data(10, 3, &be(&[0, 38_400])),
    );
    desk.bus.plug(node);
    // The unit owes an answer: until TIMEOUT and LATE_GUARD are over it is not asked for the same again.
    desk.bus.run_for(Time::from_ms(150));
    expect(&mut desk, &words(2, 3, 0, 1), &data(2, 3, &be(&[2])));
}

fn what_is_printed_is_what_was_on_the_wire_in_1000_exchanges_with_faults(runner: Runner) {
    let (mut desk, bus) = listening(runner);
    let mut random = multidrop_testkit::random::Random::new(5);
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
    let printed = printed(&mut desk);
    for (number, (printed, expected)) in printed.iter().zip(&expected).enumerate() {
        assert_eq!(printed, expected, "line {number}");
    }
    assert_eq!(printed.len(), expected.len());
    assert!(damaged > 10, "{damaged}");
}

fn a_line_goes_on_where_it_was_when_the_printers_baud_is_changed_in_the_middle_of_it(
    runner: Runner,
) {
    let (mut desk, bus) = listening(runner);
    desk.bus.clear_record();
    let mut random = multidrop_testkit::random::Random::new(6);
    let mut expected = Vec::new();
    let mut line = TEXT;
    for round in 0..16 {
        // Three pieces of 254 characters and some more.
        let body = [&[round + 1, 0x41][..], &random.bytes(250)].concat();
        let hex: String = body.iter().map(|byte| format!(" {byte:02X}")).collect();
        expected.push(format!("req{hex}"));
        let end = desk.bus.host(bus).send(&adu(&body));
        // The change falls somewhere into the 35 ms in which it is printed, or 18 at the other rate.
        desk.bus
            .run_to(end - Time::from_ms(4) + Time::from_us(1_600) * u64::from(round));
        let old = desk.line_of(RS2);
        line = if line == TEXT {
            Line::n81(460_800)
        } else {
            TEXT
        };
        let (request, answer) = load(RS2, 22, line.baud);
        desk.bus.host(desk.pc).send(&request);
        for _ in 0..320 {
            desk.bus.run_for(Time::from_us(250));
            if desk.line_of(RS2) != old {
                desk.bus.host(desk.terminal).set_line(line);
            }
        }
        let heard = desk.bus.host(desk.pc).take();
        let heard: Vec<u8> = heard.iter().map(|byte| byte.value).collect();
        assert_eq!(heard, answer);
    }
    assert_eq!(printed(&mut desk), expected);
    // Lines that were printed in part at one rate, in part at the other.
    let on_rs2 = desk.bus.record_of(desk.wires[RS2]).bytes();
    let mixed = on_rs2.split(|byte| byte.value == 10).filter(|line| {
        let fast = |byte: &&WireByte| byte.end.saturating_sub(byte.start) < Time::from_us(30);
        let fast = line.iter().filter(fast).count();
        fast > 0 && fast < line.len()
    });
    assert!(mixed.count() > 5);
}
