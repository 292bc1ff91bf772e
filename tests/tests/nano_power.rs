//! Reset and power cut of a node at every byte of a request and of an answer: DE goes down at once, the other nodes
//! are not affected, and the node answers again after its restart.

use multidrop_bus::{NodeId, Station, Time};
use multidrop_testkit::frames::{data, words};
use multidrop_testkit::random::Random;
use multidrop_testkit::{LINE, Rig};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cut {
    Reset,
    Power,
}

/// Time from the start of a boot to the first request.
const BOOT: Time = Time::from_ms(5);

/// Instants within `bytes` characters from `start` on: early, in the middle and late in each.
fn instants(start: Time, bytes: u64) -> Vec<Time> {
    let at = |byte: u64, percent: u64| start + LINE.character() * (100 * byte + percent) / 100;
    (0..bytes)
        .flat_map(|byte| [4, 53, 97].map(|percent| at(byte, percent)))
        .collect()
}

/// Units 1, 2 and 3, which hold 0x0101, 0x0202 and 0x0303.
fn units() -> Rig {
    let mut rig = Rig::units(&[1, 2, 3]);
    for unit in 1..=3 {
        let write = words(unit, 6, 0, 0x0101 * u16::from(unit));
        rig.expect(&write, &write);
    }
    rig
}

fn read(unit: u8) -> Vec<u8> {
    words(unit, 3, 0, 1)
}

fn holds(unit: u8, value: u16) -> Vec<u8> {
    data(unit, 3, &value.to_be_bytes())
}

fn cut(rig: &mut Rig, node: NodeId, how: Cut) {
    match how {
        Cut::Reset => rig.bus.reset(node),
        Cut::Power => rig.bus.power_cut(node),
    }
}

/// Whether a node drives the bus, as far as is recorded.
fn drives(rig: &Rig, node: NodeId) -> bool {
    let mut edges = rig.bus.record().de_edges().iter();
    edges
        .rfind(|edge| edge.from == node.into())
        .is_some_and(|edge| edge.on)
}

/// Unit 1 is cut `after` the start of a request to it.
fn cut_while_it_is_asked(how: Cut, after: Time, request: &[u8]) {
    let mut rig = units();
    let victim = rig.nodes[0];
    let start = rig.bus.now();
    let host = rig.host;
    let end = rig.bus.host(host).send(request);
    rig.bus.run_to(start + after);
    let what = format!("{how:?} {after} after the start of {request:02x?}");
    cut(&mut rig, victim, how);
    // The pins float as soon as the chip is in reset; a node may be a quantum ahead of the bus.
    rig.bus.run_for(Time::from_us(1));
    assert!(!drives(&rig, victim), "{what}: the bus is held");
    let sent = rig.bus.record().de_edges().len();
    // Of a character that was cut off the others hear all bits.
    let silence = LINE.character() + LINE.t35() * 101 / 100;
    rig.bus.run_to(end.max(start + after) + silence);
    assert_eq!(rig.bus.record().de_edges().len(), sent, "{what}");
    assert!(rig.bus.wire_level(), "{what}: the bus is held");
    assert_eq!(rig.bus.record().conflicts(), [], "{what}");
    rig.bus.clear_record();
    rig.bus.host(host).take();

    for unit in [2, 3] {
        rig.expect(&read(unit), &holds(unit, 0x0101 * u16::from(unit)));
    }
    if how == Cut::Power {
        rig.expect_silence(&read(1));
        rig.bus.power_up(victim);
        rig.pause(BOOT);
    }
    rig.expect(&read(1), &holds(1, 0));
    rig.expect(&words(1, 6, 0, 0x1234), &words(1, 6, 0, 0x1234));
    for unit in [2, 3] {
        rig.expect(&read(unit), &holds(unit, 0x0101 * u16::from(unit)));
    }
}

#[test]
fn at_every_byte_of_a_request() {
    for how in [Cut::Reset, Cut::Power] {
        for request in [read(1), words(1, 6, 0, 0x5555), words(0, 6, 9, 0x5555)] {
            for after in instants(Time::ZERO, request.len() as u64) {
                cut_while_it_is_asked(how, after, &request);
            }
        }
    }
}

#[test]
fn in_the_silence_before_an_answer() {
    let request = read(1);
    let end = LINE.character() * request.len() as u64;
    for how in [Cut::Reset, Cut::Power] {
        for percent in [1, 20, 42, 43, 44, 60, 80, 99, 100] {
            cut_while_it_is_asked(how, end + LINE.t35() * percent / 100, &request);
        }
    }
}

#[test]
fn at_every_byte_of_an_answer() {
    for how in [Cut::Reset, Cut::Power] {
        for request in [read(1), words(1, 6, 0, 0x5555), words(1, 0x63, 0, 0)] {
            let answer = match request[1] {
                3 => 7,
                6 => 8,
                _ => 5,
            };
            let end = LINE.character() * request.len() as u64;
            // One more: DE falls after the last.
            for after in instants(end + LINE.t35() + Time::from_us(15), answer + 1) {
                cut_while_it_is_asked(how, after, &request);
            }
        }
    }
}

#[test]
fn at_any_instant() {
    let mut random = Random::new(11);
    for _ in 0..100 {
        let how = random.pick(&[Cut::Reset, Cut::Power]);
        let after = Time::from_ns(u64::from(random.below(65_000)) * 100);
        cut_while_it_is_asked(how, after, &words(1, 6, 0, 0x5555));
    }
}

#[test]
fn while_a_neighbour_talks() {
    // 8 bytes of request, t3.5, 7 of answer.
    let span = LINE.character() * 15 + LINE.t35();
    for how in [Cut::Reset, Cut::Power] {
        for percent in (0..100).step_by(3) {
            let mut rig = units();
            let victim = rig.nodes[0];
            let start = rig.bus.now();
            let host = rig.host;
            let end = rig.bus.host(host).send(&read(2));
            rig.bus.run_to(start + span * percent / 100);
            cut(&mut rig, victim, how);
            rig.bus.run_for(Time::from_us(500));
            if how == Cut::Power {
                rig.bus.power_up(victim);
            }
            rig.bus.run_to(end + span);
            let heard = rig.bus.host(host).take();
            let bytes: Vec<u8> = heard.iter().map(|byte| byte.value).collect();
            assert_eq!(bytes, holds(2, 0x0202), "{how:?} at {percent} %");
            let sent = rig.bus.record().sent_by(Station::Node(victim)).count();
            assert_eq!(sent, 0);
            rig.pause(BOOT);
            rig.expect(&read(1), &holds(1, 0));
            rig.expect(&read(3), &holds(3, 0x0303));
        }
    }
}

#[test]
fn all_nodes_at_once() {
    let mut rig = units();
    for _ in 0..10 {
        for node in rig.nodes.clone() {
            rig.bus.power_cut(node);
        }
        rig.pause(Time::from_us(700));
        for node in rig.nodes.clone() {
            rig.bus.power_up(node);
        }
        rig.pause(BOOT);
        for unit in 1..=3 {
            rig.expect(&read(unit), &holds(unit, 0));
        }
    }
}
