//! Faults that were found in other stacks, as regression tests against the firmware in the simulator.

use multidrop_bus::{Bus, BusConfig, HostPort, Line, Station, Time, Tx};
use multidrop_testkit::frames::{adu, be, block, claimed, data, exception, words};
use multidrop_testkit::rig::ALIVE;
use multidrop_testkit::{DE_LAG, Rig, lines, registers};

/// What a neighbour, unit 2, may answer: every function of the standard, and data that looks like
/// requests to us.
fn neighbours_answers() -> Vec<Vec<u8>> {
    let registers: Vec<u8> = (0..32).collect();
    let write_to_us = words(1, 6, 0, 0x5555);
    let broadcast = block(0, 0x10, 0, 2, &[0x55; 4]);
    let bodies: Vec<Vec<u8>> = vec![
        vec![1, 1, 0x01],
        vec![1, 2, 0xcd, 0x01],
        vec![2, 2, 0xff, 0xff],
        vec![3, 2, 0x00, 0x01],
        vec![3, 6, 0xae, 0x41, 0x56, 0x52, 0x43, 0x40],
        [&[3, 32], &registers[..]].concat(),
        [&[3, 8], &write_to_us[..]].concat(),
        [&[3, 14], &broadcast[..], &[0]].concat(),
        [&[4, 14, 1, 1], &adu(&[1, 0x63])[..], &write_to_us].concat(),
        vec![5, 0x00, 0xac, 0xff, 0x00],
        vec![6, 0x00, 0x01, 0x00, 0x03],
        vec![7, 0x6d],
        vec![8, 0x00, 0x00, 0xa5, 0x37],
        vec![0x0b, 0xff, 0xff, 0x01, 0x08],
        vec![0x0c, 8, 0, 0, 1, 8, 1, 0x21, 0x20, 0],
        vec![0x0f, 0x00, 0x13, 0x00, 0x0a],
        vec![0x10, 0x00, 0x01, 0x00, 0x02],
        [&[0x11, 11, 2, 0xff], &b"multidrop"[..]].concat(),
        vec![0x14, 6, 5, 6, 0x0d, 0xfe, 0x00, 0x20],
        vec![0x15, 9, 6, 0, 4, 0, 7, 0, 1, 6, 0xaf],
        vec![0x16, 0, 4, 0, 0xf2, 0, 0x25],
        [&[0x17, 12], &registers[..12]].concat(),
        vec![0x18, 0, 6, 0, 2, 1, 0xb8, 0x12, 0x84],
        [&[0x2b, 0x0e, 1, 0x82, 0, 0, 1, 0, 9], &b"multidrop"[..]].concat(),
        vec![0x41, 1, 6, 0, 0],
        vec![0x83, 2],
        vec![0x81, 1],
        vec![0x90, 4],
    ];
    bodies
        .iter()
        .map(|body| adu(&[&[2], &body[..]].concat()))
        .collect()
}

/// `bytes` with a pause before byte `split`.
fn split(bytes: &[u8], split: usize, pause: Time) -> Vec<Tx> {
    bytes
        .iter()
        .enumerate()
        .map(|(index, byte)| match index == split {
            true => Tx::byte(*byte).after(pause),
            false => Tx::byte(*byte),
        })
        .collect()
}

#[test]
fn fault_1_answers_of_neighbours_do_not_desynchronise() {
    let mut rig = Rig::full();
    let before = rig.state(128);
    let line = rig.line;
    // The edge of t3.5 itself has a test of its own.
    let silence = line.t35() * 101 / 100;
    let legal = line.t15() * 9 / 10;
    for answer in neighbours_answers() {
        // Position 0 splits nothing.
        for at in 0..answer.len() {
            let pause = if at == 0 { Time::ZERO } else { legal };
            let ours = split(&ALIVE.request(), 0, silence);
            let heard = rig.ask_each(split(&answer, at, pause).into_iter().chain(ours));
            assert_eq!(heard, ALIVE.answer(), "{answer:02x?} split at {at}");
        }
    }
    assert_eq!(rig.state(128), before);
}

#[test]
fn fault_1_answers_of_a_real_neighbour() {
    let images = [
        registers(16, multidrop_testkit::LINE),
        multidrop_testkit::image("demo-unit", &["--unit", "2"]),
    ];
    let mut rig = Rig::with(&[&images[0], &images[1]], multidrop_testkit::LINE);
    for round in 0..8u16 {
        let write = words(2, 6, 0, 0x0101 * round);
        rig.expect(&write, &write);
        rig.expect_alive();
        rig.expect(&words(2, 3, 0, 1), &data(2, 3, &be(&[0x0101 * round])));
        rig.expect_alive();
        rig.expect(&words(2, 1, 0, 17), &exception(2, 1, 2));
        rig.expect_alive();
    }
}

#[test]
fn fault_2_unknown_function_with_a_bad_crc_is_not_answered() {
    let mut rig = Rig::full();
    for function in [0x00, 0x07, 0x11, 0x41, 0x63, 0x80, 0x83, 0xff] {
        for bit in [0, 7, 8, 15] {
            let mut request = adu(&[1, function, 0, 0, 0, 1]);
            let at = request.len() - 2 + bit / 8;
            request[at] ^= 1 << (bit % 8);
            rig.expect_silence(&request);
        }
    }
    rig.expect_alive();
}

#[test]
fn fault_3_unit_255_is_not_a_broadcast() {
    let mut rig = Rig::full();
    let before = rig.state(128);
    for unit in 248..=255 {
        rig.expect_silence(&words(unit, 5, 0, 0xff00));
        rig.expect_silence(&words(unit, 6, 0, 0x5555));
        rig.expect_silence(&block(unit, 0x0f, 0, 3, &[7]));
        rig.expect_silence(&block(unit, 0x10, 0, 2, &[0x55; 4]));
    }
    assert_eq!(rig.state(128), before);
}

#[test]
fn fault_4_two_registers_with_six_bytes_are_refused() {
    let mut rig = Rig::full();
    let before = rig.state(128);
    let request = block(1, 0x10, 1, 2, &[0xee; 6]);
    rig.expect(&request, &exception(1, 0x10, 3));
    assert_eq!(rig.state(128), before);
}

#[test]
fn fault_5_a_quantity_of_0_is_refused() {
    let mut rig = Rig::full();
    for function in [1, 2, 3, 4] {
        rig.expect(&words(1, function, 0, 0), &exception(1, function, 3));
    }
    for function in [0x0f, 0x10] {
        rig.expect(&block(1, function, 0, 0, &[]), &exception(1, function, 3));
    }
}

#[test]
fn fault_6_a_byte_count_of_255_is_refused() {
    let mut rig = Rig::full();
    let before = rig.state(128);
    for function in [0x0f, 0x10] {
        for len in [0, 1, 2, 246, 247] {
            let request = claimed(1, function, 0, 2, 255, &vec![0xee; len]);
            rig.expect(&request, &exception(1, function, 3));
        }
    }
    assert_eq!(rig.state(128), before);
}

#[test]
fn fault_7_limits_are_not_off_by_one() {
    let mut rig = Rig::full();
    let inputs: Vec<u16> = (0x1000..0x1000 + 125).collect();
    rig.expect(&words(1, 4, 0, 125), &data(1, 4, &be(&inputs)));
    // 2000 coils are a legal quantity: it is the address that is refused.
    rig.expect(&words(1, 1, 0, 2000), &exception(1, 1, 2));
    for quantity in [120, 121, 122, 123] {
        let values = vec![0x77; 2 * usize::from(quantity)];
        rig.expect(
            &block(1, 0x10, 0, quantity, &values),
            &words(1, 0x10, 0, quantity),
        );
        rig.expect(&words(1, 3, 0, quantity), &data(1, 3, &values));
    }
}

#[test]
fn fault_8_a_request_out_of_limits_is_refused_whole() {
    let mut rig = Rig::full();
    let before = rig.state(128);
    for value in [0x0001, 0x00ff, 0x0100, 0x1234, 0xff01, 0xffff] {
        rig.expect(&words(1, 5, 0, value), &exception(1, 5, 3));
    }
    for quantity in [1969u16, 2000] {
        let values = [0xff; 247];
        let count = quantity.div_ceil(8) as u8;
        rig.expect(
            &claimed(1, 0x0f, 0, quantity, count, &values),
            &exception(1, 0x0f, 3),
        );
    }
    for quantity in [124, 125] {
        let values = [0xee; 246];
        rig.expect(
            &claimed(1, 0x10, 0, quantity, (2 * quantity) as u8, &values),
            &exception(1, 0x10, 3),
        );
    }
    // The first of these are there.
    rig.expect(&block(1, 0x10, 120, 9, &[0xee; 18]), &exception(1, 0x10, 2));
    rig.expect(&block(1, 0x0f, 120, 9, &[0xff; 2]), &exception(1, 0x0f, 2));
    assert_eq!(rig.state(128), before);
}

#[test]
fn fault_11_de_holds_for_the_answer_and_no_longer() {
    let extremes = [2_400, 1_000_000].map(Line::n81);
    for line in lines().chain(extremes) {
        let mut bus = Bus::new(BusConfig::default());
        let node = bus
            .add_image("unit 1", &registers(16, line))
            .expect("a valid image");
        let host = bus.add_host(HostPort::new(line));
        bus.run_for(line.t35() * 2 + Time::from_ms(20));
        let requests = [
            words(1, 3, 0, 1),
            words(1, 3, 0, 16),
            words(1, 6, 0, 1),
            adu(&[1, 0x63]),
            block(1, 0x10, 0, 16, &[0x5a; 32]),
        ];
        for request in requests {
            bus.clear_record();
            let patience = line.t35() + Time::from_ms(3);
            let answer = bus.transact(host, &request, patience).expect("an answer");
            let record = bus.record();
            let [on, off] = record.de_edges() else {
                panic!("{} {}\n{record}", line.baud, line.format);
            };
            assert!(on.on && !off.on);
            let sent: Vec<_> = record.sent_by(Station::Node(node)).collect();
            assert_eq!(sent.len(), answer.bytes.len(), "\n{record}");
            let (first, last) = (sent[0].start, sent[sent.len() - 1].end);
            assert!(on.time <= first && off.time >= last, "\n{record}");
            assert!(first - on.time <= line.character(), "\n{record}");
            assert!(off.time - last <= DE_LAG, "\n{record}");
            assert!(sent.iter().all(|byte| byte.is_good()), "\n{record}");
        }
    }
}
