//! Several nodes on one bus, and long runs of requests against a plain model.

use multidrop_bus::{Line, Station};
use multidrop_testkit::frames::{adu, block, claimed, data, words};
use multidrop_testkit::model::Model;
use multidrop_testkit::random::Random;
use multidrop_testkit::{LINE, Rig, image, registers};

/// Asks, and says which nodes drove the bus meanwhile.
fn who_answers(rig: &mut Rig, request: &[u8]) -> Vec<usize> {
    let patience = rig.patience();
    rig.bus.transact(rig.host, request, patience);
    let record = rig.bus.record();
    let who = (0..rig.nodes.len())
        .filter(|index| {
            let node = rig.nodes[*index];
            let drove = record
                .de_edges()
                .iter()
                .any(|edge| edge.from == node.into());
            drove || record.sent_by(Station::Node(node)).next().is_some()
        })
        .collect();
    rig.check();
    who
}

#[test]
fn only_the_addressed_unit_answers() {
    for units in [&[1, 2][..], &[1, 2, 3]] {
        let mut rig = Rig::units(units);
        for unit in 0..=255 {
            let expected: Vec<usize> = units
                .iter()
                .position(|known| *known == unit)
                .into_iter()
                .collect();
            for request in [
                words(unit, 3, 0, 1),
                words(unit, 3, 9, 9),
                words(unit, 0x63, 0, 0),
            ] {
                assert_eq!(who_answers(&mut rig, &request), expected, "unit {unit}");
            }
        }
    }
}

#[test]
fn units_keep_their_own_values() {
    let mut rig = Rig::units(&[1, 2, 3]);
    for unit in 1..=3 {
        let write = words(unit, 6, 0, 0x1111 * u16::from(unit));
        rig.expect(&write, &write);
    }
    for unit in 1..=3 {
        rig.expect(&words(unit, 3, 0, 1), &data(unit, 3, &[0x11 * unit; 2]));
    }
    rig.expect_silence(&words(0, 6, 0, 0xcafe));
    for unit in 1..=3 {
        rig.expect(&words(unit, 3, 0, 1), &data(unit, 3, &[0xca, 0xfe]));
    }
}

#[test]
fn an_unplugged_unit_does_not_affect_the_others() {
    let mut rig = Rig::units(&[1, 2, 3]);
    for unplugged in 0..3 {
        let node = rig.nodes[unplugged];
        rig.bus.unplug(node);
        for (index, unit) in [1, 2, 3].into_iter().enumerate() {
            let answer = if index == unplugged {
                Vec::new()
            } else {
                data(unit, 3, &[0, 0])
            };
            rig.expect(&words(unit, 3, 0, 1), &answer);
        }
        rig.bus.plug(node);
        let unit = unplugged as u8 + 1;
        rig.expect(&words(unit, 3, 0, 1), &data(unit, 3, &[0, 0]));
    }
}

/// A request to a unit with `count` items in each table: mostly right, or nearly.
fn request(random: &mut Random, units: &[u8], count: u16) -> Vec<u8> {
    let unit = match random.below(20) {
        0 => 0,
        1 => random.next() as u8,
        _ => random.pick(units),
    };
    let function = match random.below(20) {
        0 => random.next() as u8,
        _ => random.pick(&[1, 2, 3, 4, 5, 6, 0x0f, 0x10]),
    };
    let address = match random.below(10) {
        0 => random.pick(&[count, count - 1, 0xffff, 0xfffe, 0x8000, 256]),
        _ => random.below(count),
    };
    let room = count.saturating_sub(address).max(1);
    let quantity = match random.below(10) {
        0 => random.pick(&[0, 1, 123, 124, 125, 126, 1968, 1969, 2000, 2001, 0xffff]),
        1 => room + 1,
        _ => random.below(room) + 1,
    };
    let mut request = match function {
        5 => words(
            unit,
            5,
            address,
            random.pick(&[0xff00, 0xff00, 0, 0, 1, 0xff01]),
        ),
        6 => words(unit, 6, address, random.next() as u16),
        0x0f | 0x10 => {
            let need = match function {
                0x0f => quantity.div_ceil(8),
                _ => quantity.saturating_mul(2),
            };
            // As much as fits into a frame of 256.
            let values = random.bytes(usize::from(need.min(247)));
            match random.below(15) {
                0 => claimed(
                    unit,
                    function,
                    address,
                    quantity,
                    random.next() as u8,
                    &values,
                ),
                _ => block(unit, function, address, quantity, &values),
            }
        }
        _ => words(unit, function, address, quantity),
    };
    match random.below(30) {
        0 => {
            // Too short or too long, with a good CRC.
            request.truncate(request.len() - 2);
            request.truncate(2.max(request.len() - usize::from(random.below(4))));
            let more = usize::from(random.below(3));
            request.extend(random.bytes(more));
            request.truncate(254);
            adu(&request)
        }
        1 => {
            let at = usize::from(random.below(request.len() as u16));
            request[at] ^= 1 << random.below(8);
            request
        }
        _ => request,
    }
}

/// 500 requests; gives how many were answered without an exception.
fn converse(line: Line, seed: u64) -> usize {
    const COUNT: u16 = 128;
    let mut rig = Rig::registers(COUNT as u8, line);
    let mut model = Model::new(1, usize::from(COUNT));
    let mut random = Random::new(seed);
    let mut done = 0;
    for index in 0..500 {
        let request = request(&mut random, &[1], COUNT);
        let expected = model.answer(&request);
        let answer = rig.exchange(&request);
        let bytes = answer.map_or(Vec::new(), |answer| {
            assert!(
                answer.gaps.iter().all(|gap| gap.ps() == 0),
                "{index}: {:?}",
                answer.gaps
            );
            answer.bytes
        });
        assert_eq!(
            bytes, expected,
            "request {index} of seed {seed}: {request:02x?}"
        );
        done += usize::from(bytes.get(1).is_some_and(|function| function & 0x80 == 0));
        if index % 25 == 24 {
            for read in [
                words(1, 1, 0, COUNT),
                words(1, 3, 0, 125),
                words(1, 3, 125, 3),
            ] {
                rig.expect(&read, &model.answer(&read));
            }
        }
    }
    done
}

#[test]
fn five_hundred_requests_agree_with_the_model_at_38400() {
    assert!(converse(LINE, 1) > 250);
}

#[test]
fn five_hundred_requests_agree_with_the_model_at_115200() {
    assert!(converse(Line::n81(115_200), 2) > 250);
}

#[test]
fn five_hundred_requests_to_three_units_agree_with_the_model() {
    let images = [
        registers(16, LINE),
        image("demo-unit", &["--unit", "2"]),
        image("demo-unit", &["--unit", "3"]),
    ];
    let mut rig = Rig::with(&[&images[0], &images[1], &images[2]], LINE);
    let mut model = Model::new(1, 16);
    // Registers of the demonstration units, seen by FC 03 and 06.
    let mut others = [0u16; 2];
    let mut random = Random::new(3);
    for index in 0..500 {
        let (request, expected) = match random.below(3) {
            0 => {
                let request = request(&mut random, &[1], 16);
                // A broadcast would reach all three.
                if request[0] <= 3 && request[0] != 1 {
                    continue;
                }
                let expected = model.answer(&request);
                (request, expected)
            }
            other => {
                let unit = other as u8 + 1;
                let value = &mut others[usize::from(other) - 1];
                if random.one_in(2) {
                    *value = random.next() as u16;
                    let write = words(unit, 6, 0, *value);
                    (write.clone(), write)
                } else {
                    (words(unit, 3, 0, 1), data(unit, 3, &value.to_be_bytes()))
                }
            }
        };
        let heard = rig.ask(&request);
        assert_eq!(heard, expected, "request {index}: {request:02x?}");
    }
}
