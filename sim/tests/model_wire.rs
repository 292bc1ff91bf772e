//! Transceivers and the wire: characters that are lost, cut off, or damaged.

use multidrop_bus::{Bus, BusConfig, BusError, HostPort, Line, Nano, Station, Time};
use multidrop_testkit::assembler::{assemble, nano, one};

const LINE: Line = Line::n81(38_400);

#[test]
fn a_byte_sent_with_de_low_is_lost() {
    let (mut bus, node, host) = one("de", &[("MODE", 0)], LINE);
    bus.run_for(Time::from_ms(1));
    let byte = *bus
        .record()
        .sent_by(Station::Node(node))
        .next()
        .expect("it was sent");
    assert!(byte.lost && !byte.is_good());
    assert_eq!(byte.sent, 0x55);
    assert_eq!(bus.record().wire_edges(), []);
    assert_eq!(bus.host(host).take(), []);
}

#[test]
fn de_going_off_cuts_the_character() {
    let (mut bus, node, host) = one("de", &[("MODE", 1)], LINE);
    bus.run_for(Time::from_ms(1));
    let byte = *bus
        .record()
        .sent_by(Station::Node(node))
        .next()
        .expect("it was sent");
    // UBRR0L is written at 17 (`sbi` 2, 15), DE goes on at 19, UDR0 is written at 22, the start bit
    // begins at 17 + 26 = 43. `ldi` twice, 468 rounds of 4 less 1, `cbi` 2: DE goes off at 1897,
    // 4.46 bits into the character. From the middle of data bit 3 on the wire is at the mark:
    // 0x55 | 0xf8 = 0xfd.
    assert_eq!(byte.truncated, Some(bus.node(node).clock().time(1897)));
    assert_eq!((byte.sent, byte.value), (0x55, 0xfd));
    let heard: Vec<_> = bus
        .host(host)
        .take()
        .iter()
        .map(|byte| byte.value)
        .collect();
    assert_eq!(heard, [0xfd]);
}

#[test]
fn two_drivers_spoil_the_byte_for_everybody_and_are_noted() {
    let mut bus = Bus::new(BusConfig::default());
    let hog = bus
        .add_nano(nano("de", &[("MODE", 2)]))
        .expect("a valid image");
    let listener = bus.add_nano(nano("poll_rx", &[])).expect("a valid image");
    let sender = bus.add_host(HostPort::new(LINE));
    let other = bus.add_host(HostPort::new(LINE));
    bus.run_to(Time::from_ms(1));
    bus.host(sender).send(&[0x55]);
    bus.run_for(Time::from_ms(2));

    let conflict = bus.record().conflicts()[0];
    assert_eq!(conflict.time, Time::from_ms(1));
    assert_eq!(conflict.low, Station::Host(sender));
    assert_eq!(conflict.high, Station::Node(hog));
    let byte = *bus
        .record()
        .sent_by(Station::Host(sender))
        .next()
        .expect("it was sent");
    assert!(byte.conflict && byte.framing_error && byte.value != 0x55);
    // FE is bit 4 of UCSR0A.
    let [flags, value] = bus.node(listener).read(0x100);
    assert!(
        flags & 0x10 != 0 && value != 0x55,
        "{flags:02x} {value:02x}"
    );
    let heard = bus.host(other).take();
    assert!(heard[0].framing_error && heard[0].value != 0x55);
}

#[test]
fn a_node_does_not_hear_itself_unless_wired_so() {
    for echo in [false, true] {
        let mut bus = Bus::new(BusConfig::default());
        let mut talker = nano("send", &[]);
        talker.echo = echo;
        let node = bus.add_nano(talker).expect("a valid image");
        bus.run_for(Time::from_us(50));
        // RXD is bit 0 of PIND; the first data bit of 0x55 is on the wire from 29 to 55 us, high;
        // the second, low, follows.
        assert_eq!(
            bus.node(node).output(multidrop_bus::Pin::D2),
            multidrop_bus::Level::High
        );
        bus.run_for(Time::from_us(20));
        assert!(!bus.wire_level());
        assert_eq!(bus.node(node).hears(), !echo);
    }
}

#[test]
fn an_unplugged_node_neither_drives_nor_hears() {
    let (mut bus, node, host) = one("echo", &[], LINE);
    bus.run_for(Time::from_ms(1));
    let transact = |bus: &mut Bus| bus.transact(host, &[1], Time::from_ms(5));
    assert!(transact(&mut bus).is_some());
    bus.unplug(node);
    assert_eq!(transact(&mut bus), None);
    assert_eq!(bus.record().sent_by(Station::Node(node)).count(), 1);
    bus.host(host).send(&[0]);
    bus.run_for(Time::from_us(100));
    assert!(!bus.wire_level() && bus.node(node).hears());
    bus.run_for(Time::from_ms(1));
    bus.plug(node);
    assert_eq!(transact(&mut bus).map(|answer| answer.bytes), Some(vec![2]));
}

#[test]
fn reset_in_the_middle_of_a_character_frees_the_wire_at_once() {
    let (mut bus, node, _) = one("send", &[], LINE);
    // 16 cycles are 1 us: the second character runs from 4207 to 8367.
    bus.run_to(Time::from_us(400));
    assert_eq!(bus.record().de_edges().len(), 1);
    bus.reset(node);
    bus.run_for(Time::from_ns(1));
    let edge = bus.record().de_edges()[1];
    assert_eq!((edge.on, edge.time), (false, Time::from_us(400)));
    let cut = bus
        .record()
        .sent_by(Station::Node(node))
        .find(|byte| byte.truncated.is_some());
    assert_eq!(
        cut.and_then(|byte| byte.truncated),
        Some(Time::from_us(400))
    );
    // It starts anew: three more characters.
    bus.run_for(Time::from_ms(3));
    assert_eq!(
        bus.record()
            .sent_by(Station::Node(node))
            .filter(|b| b.is_good())
            .count(),
        4
    );
}

#[test]
fn power_cut_loses_sram_and_keeps_eeprom() {
    let (mut bus, node, host) = one("poll_rx", &[], LINE);
    let fresh: [u8; 2] = bus.node(node).read(0x100);
    bus.run_for(Time::from_ms(1));
    bus.node_mut(node).eeprom_mut()[7] = 0x42;
    bus.host(host).send(&[0x33]);
    bus.run_for(Time::from_ms(1));
    assert_eq!(bus.node(node).read(0x100), [0xa0, 0x33]);
    bus.power_cut(node);
    bus.host(host).send(&[0x44]);
    bus.run_for(Time::from_ms(1));
    bus.power_up(node);
    bus.run_for(Time::from_ms(1));
    assert_eq!(bus.node(node).read(0x100), fresh);
    assert_eq!(bus.node(node).eeprom()[7], 0x42);
    bus.host(host).send(&[0x55]);
    bus.run_for(Time::from_ms(1));
    assert_eq!(bus.node(node).read(0x100), [0xa0, 0x55]);
}

#[test]
fn the_same_run_gives_the_same_record() {
    let run = || {
        let mut bus = Bus::new(BusConfig::default());
        for (name, ppm) in [("echo", 0), ("poll_rx", 13_000), ("echo", -7_000)] {
            let mut node = nano(name, &[]);
            node.clock_ppm = ppm;
            bus.add_nano(node).expect("a valid image");
        }
        let host = bus.add_host(HostPort::new(LINE));
        bus.run_for(Time::from_ms(1));
        for byte in 0..20 {
            bus.transact(host, &[byte, 0x55], Time::from_ms(3));
        }
        let stats: Vec<_> = bus.nodes().map(|(_, node)| node.stats().clone()).collect();
        (bus.record().clone(), stats)
    };
    let (first, second) = (run(), run());
    // Two echoing nodes fight: there is something to differ in.
    assert!(!first.0.conflicts().is_empty());
    assert_eq!(first, second);
}

#[test]
fn wrong_images_are_refused_by_name() {
    let mut bus = Bus::new(BusConfig::default());
    let missing = bus.add_nano(Nano::new("x", "no/such/file.elf"));
    assert!(matches!(missing, Err(BusError::Read { .. })));
    let source = multidrop_testkit::places::programs().join("avr/echo.S");
    assert!(matches!(
        bus.add_nano(Nano::new("x", source)),
        Err(BusError::NotElf { .. })
    ));
    // The test program itself is an ELF image, for another machine.
    let own = std::env::current_exe().expect("a path");
    assert!(matches!(
        bus.add_nano(Nano::new("x", own)),
        Err(BusError::WrongMcu { .. })
    ));
    // Bytes 18 and 36 of an ELF32 header are the machine and its family: ARM, and an ATtiny's core.
    for (offset, value) in [(18, 40), (36, 25)] {
        let image = assemble("echo", &[]);
        let mut bytes = std::fs::read(&image).expect("an image");
        bytes[offset] = value;
        std::fs::write(&image, bytes).expect("an image");
        let refused = bus.add_nano(Nano::new("x", image));
        assert!(
            matches!(refused, Err(BusError::WrongMcu { .. })),
            "{offset}"
        );
    }
    let mut fast = Nano::new("x", assemble("echo", &[]));
    fast.clock_hz = 20_000_001;
    assert!(matches!(
        bus.add_nano(fast),
        Err(BusError::Clock(20_000_001))
    ));
}
