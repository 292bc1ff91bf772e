//! Edges on port D for which tasks wait, beside a server on the bus: neither affects the other.

use multidrop_bus::{Line, Nano, Pin, Time, Tx};
use multidrop_testkit::frames::{block, data, words};
use multidrop_testkit::{Rig, Rules, assert_bus_rules, example_at};

/// The example `port_d`, at this rate.
fn rig(baud: u32) -> Rig {
    let nano = Nano {
        de: Pin::new('C', 0),
        watch: (0..5).filter_map(|bit| Pin::new('B', bit)).collect(),
        ..Nano::new("port_d", example_at("port_d", baud))
    };
    Rig::nano(nano, Line::n81(baud))
}

/// A read of input register 2, with a pause before each character but the first.
fn spread(pause: Time) -> impl Iterator<Item = Tx> {
    let request = words(1, 4, 2, 1).into_iter().enumerate();
    request.map(move |(at, byte)| Tx::byte(byte).after(if at == 0 { Time::ZERO } else { pause }))
}

#[test]
fn a_gap_within_t1_5_is_part_of_the_frame_while_edges_are_waited_for() {
    for baud in [9_600, 19_200, 38_400, 115_200] {
        let mut rig = rig(baud);
        for percent in [0, 50, 80, 95] {
            let heard = rig.ask_each(spread(rig.line.t15() * percent / 100));
            let what = format!("gaps of {percent} % of t1.5 at {baud}");
            assert_eq!(heard, data(1, 4, &[0x10, 0x02]), "{what}");
        }
        for percent in [110, 150, 200] {
            let heard = rig.ask_each(spread(rig.line.t15() * percent / 100));
            assert_eq!(heard, [], "gaps of {percent} % of t1.5 at {baud}");
            rig.pause(Time::from_ms(10));
        }
    }
}

/// The pins that the example follows, and where it shows what it has seen of them.
const PINS: [(u8, u8); 5] = [(2, 0), (3, 1), (4, 2), (5, 3), (6, 4)];

fn port_d(bit: u8) -> Pin {
    Pin::new('D', bit).expect("a pin")
}

/// How often PB`bit` has changed since the record was cleared.
fn shown(rig: &Rig, bit: u8) -> usize {
    let edges = rig.bus.record().pin_edges().iter();
    edges
        .filter(|edge| Some(edge.pin) == Pin::new('B', bit))
        .count()
}

/// Drives all pins high, which is where their pull-ups hold them.
fn connect(rig: &mut Rig) {
    let node = rig.node();
    for (input, _) in PINS {
        rig.bus.node_mut(node).set_input(port_d(input), Some(true));
    }
    rig.pause(Time::from_ms(5));
}

#[test]
fn an_edge_at_every_cycle_about_a_character_is_seen_once() {
    let mut rig = rig(115_200);
    connect(&mut rig);
    let node = rig.node();
    // A character takes 1389 cycles, its interrupt comes half a bit before its end; t1.5 is over 12 000 later, t3.5 28 000.
    let about = (0..1_100).step_by(13).chain(1_100..1_800);
    let offsets = about.chain((1_800..30_000).step_by(97));
    let mut level = true;
    for offset in offsets {
        level = !level;
        rig.bus.clear_record();
        let start = rig.bus.node(node).cycle();
        rig.bus.host(rig.host).send(&[0xff]);
        for pin in [Pin::D3, Pin::D4] {
            let node = rig.bus.node_mut(node);
            node.set_input_at(pin, level, start + offset);
        }
        rig.bus.run_for(Time::from_ms(4));
        let seen = [shown(&rig, 1), shown(&rig, 2)];
        assert_eq!(
            seen,
            [1, 1],
            "PD3 and PD4, an edge {offset} cycles after the start bit"
        );
    }
}

#[test]
fn an_edge_anywhere_in_an_exchange_suppresses_no_answer() {
    let mut rig = rig(115_200);
    connect(&mut rig);
    let node = rig.node();
    let request = words(1, 4, 2, 1);
    let mut latest = Time::ZERO;
    let mut level = true;
    // The request and t3.5: 1.4 and 1.8 ms.
    for offset in (0..50_000).step_by(61) {
        level = !level;
        let start = rig.bus.node(node).cycle();
        let node = rig.bus.node_mut(node);
        node.set_input_at(Pin::D4, level, start + offset);
        let answer = rig
            .bus
            .transact(rig.host, &request, rig.patience())
            .expect("an answer");
        assert_eq!(answer.bytes, data(1, 4, &[0x10, 0x02]), "{offset}");
        assert_bus_rules(&rig.bus, Rules::from(rig.line).and_de_lag(Time::from_us(5)));
        latest = latest.max(answer.turnaround().saturating_sub(rig.line.t35()));
        rig.bus.run_for(Time::from_ms(1));
    }
    // The interrupt of the edge may be first, and take 11 us.
    assert!(latest <= Time::from_us(20), "{latest} beyond t3.5");
}

#[test]
fn nothing_is_lost_at_115200_baud_while_all_pins_change() {
    let mut rig = rig(115_200);
    connect(&mut rig);
    let node = rig.node();
    let mut levels = [true; PINS.len()];
    let mut edges = [0; PINS.len()];
    for round in 0..200_u64 {
        rig.bus.clear_record();
        // In each round some of the pins, at places of their own.
        let start = rig.bus.node(node).cycle();
        let mut changes = Vec::new();
        for (index, (input, _)) in PINS.into_iter().enumerate() {
            if (round + index as u64).is_multiple_of(3) {
                continue;
            }
            levels[index] = !levels[index];
            let is_seen = input != 5 || levels[index];
            edges[index] = usize::from(is_seen);
            let offset = 1_000 + (round * 7_919 + index as u64 * 11_003) % 60_000;
            changes.push((start + offset, port_d(input), levels[index]));
        }
        changes.sort_unstable();
        for (cycle, pin, level) in changes {
            rig.bus.node_mut(node).set_input_at(pin, level, cycle);
        }
        let values = [round as u8; 32];
        let write = block(1, 16, 0, 16, &values);
        let answer = rig.bus.transact(rig.host, &write, rig.patience());
        assert_eq!(answer.expect("an answer").bytes, words(1, 16, 0, 16));
        let answer = rig
            .bus
            .transact(rig.host, &words(1, 3, 0, 16), rig.patience());
        assert_eq!(answer.expect("an answer").bytes, data(1, 3, &values));
        rig.bus.run_for(Time::from_ms(8));
        for (index, (input, output)) in PINS.into_iter().enumerate() {
            let expected = std::mem::take(&mut edges[index]);
            assert_eq!(shown(&rig, output), expected, "PD{input} in round {round}");
        }
    }
}
