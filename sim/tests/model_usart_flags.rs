//! The effects of USART0's flags and enable bits (DS40002061B, chapter 20), by `avr/usart_flags.S`.

use multidrop_bus::{Bus, Line, NodeId, Time};
use multidrop_testkit::assembler::one;

const LINE: Line = Line::n81(38_400);
const TXC: u8 = 1 << 6;
const UDRE: u8 = 1 << 5;

fn ran(mode: u32) -> (Bus, NodeId) {
    let (mut bus, node, _) = one("usart_flags", &[("MODE", mode)], LINE);
    bus.run_for(Time::from_ms(5));
    (bus, node)
}

fn sent(bus: &Bus) -> Vec<u16> {
    let bytes = bus.record().bytes().iter();
    bytes.map(|byte| byte.value).collect()
}

#[test]
fn a_byte_written_without_udre_is_ignored() {
    // 20.11.1.
    assert_eq!(sent(&ran(0).0), [1, 2]);
}

#[test]
fn txc_stands_until_it_is_cleared_whatever_is_sent() {
    // 20.11.2: a new character does not clear it, a one does.
    let (bus, node) = ran(1);
    assert_eq!(sent(&bus), [1, 2]);
    let [before, cleared] = bus.node(node).read(0x100);
    assert_eq!((before & TXC, cleared & TXC), (TXC, 0));
}

#[test]
fn the_interrupt_of_txc_comes_once_and_clears_it() {
    // 20.6.3.
    let (bus, node) = ran(2);
    assert_eq!(bus.node(node).read(0x100), [1, UDRE]);
    assert_eq!(bus.node(node).stats().vectors[20].count, 1);
}

#[test]
fn a_receiver_that_is_turned_off_forgets_what_waits_and_what_comes_in() {
    // 20.7.6. A character of ten bits, nine of them low, takes 260 us: over at 2 ms, or amid it.
    for us in [1_000, 1_900] {
        let (mut bus, node, host) = one("usart_flags", &[("MODE", 3)], LINE);
        bus.run_to(Time::from_us(us));
        bus.host(host).send(&[0x00]);
        bus.run_to(Time::from_ms(8));
        assert_eq!(bus.node(node).read(0x100), [UDRE], "{us}");
    }
    // One that begins later is received.
    let (mut bus, node, host) = one("usart_flags", &[("MODE", 3)], LINE);
    bus.run_to(Time::from_us(2_100));
    bus.host(host).send(&[0x00]);
    bus.run_to(Time::from_ms(8));
    assert_eq!(bus.node(node).read(0x100), [UDRE | 0x80]);
}

#[test]
fn a_transmitter_that_is_turned_off_sends_its_character_and_gives_the_pin_back() {
    // 20.6.5.
    let (bus, _) = ran(4);
    assert_eq!(sent(&bus), [0xff]);
    let byte = bus.record().bytes()[0];
    assert!(byte.is_good(), "{byte:?}");
    let edges: Vec<_> = bus.record().wire_edges().iter().rev().take(3).collect();
    // Start bit; then 1 to the end of the character; then the pin, which is low.
    let [last, rise, fall] = edges[..] else {
        panic!("{edges:?}");
    };
    assert_eq!((fall.time, fall.level), (byte.start, false));
    assert!(rise.level);
    assert_eq!((last.time, last.level), (byte.end, false));
}
