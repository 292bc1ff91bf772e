//! The bus between the stations: bit times, drivers, collisions, noise, and receivers.

use multidrop_bus::{
    Bus, BusConfig, Format, HostId, HostPort, Line, Nano, Parity, RxByte, Station, Time, Tx,
};
use multidrop_testkit::assembler::{nano, one};

const LINE: Line = Line::n81(38_400);
const START: Time = Time::from_ms(1);

/// A bus with hosts on it, at `START`.
fn with_hosts(config: BusConfig, ports: impl IntoIterator<Item = HostPort>) -> (Bus, Vec<HostId>) {
    let mut bus = Bus::new(config);
    let ports = ports.into_iter();
    let hosts = ports.map(|port| bus.add_host(port)).collect();
    bus.run_to(START);
    (bus, hosts)
}

fn hosts(count: usize) -> (Bus, Vec<HostId>) {
    let ports = (0..count).map(|_| HostPort::new(LINE));
    with_hosts(BusConfig::default(), ports)
}

/// Edges of the wire: times and levels.
fn edges(bus: &Bus) -> Vec<(Time, bool)> {
    let edges = bus.record().wire_edges().iter();
    edges.map(|edge| (edge.time, edge.level)).collect()
}

/// The end of so many bits at `baud`, of a clock that is off, in picoseconds.
fn bits(count: u128, baud: u128, ppm: i128) -> u64 {
    let microhertz = baud * (1_000_000 + ppm) as u128;
    (count * 1_000_000_000_000_000_000 / microhertz) as u64
}

#[test]
fn the_bits_of_a_host_are_exact_whatever_its_clock() {
    for (baud, ppm) in [
        (38_400, 0),
        (38_400, 20_000),
        (38_400, -20_000),
        (115_200, 7),
    ] {
        let mut port = HostPort::new(Line::n81(baud));
        port.clock_ppm = ppm;
        let (mut bus, hosts) = with_hosts(BusConfig::default(), [port]);
        bus.host(hosts[0]).send(&[0x55]);
        bus.run_for(Time::from_ms(1));
        // Low, high and so on, from the start bit to the stop bit.
        let expected = (0..10).map(|bit| {
            let at = bits(bit, baud.into(), ppm.into());
            (START + Time::from_ps(at), bit % 2 == 1)
        });
        assert_eq!(edges(&bus), expected.collect::<Vec<_>>(), "{baud} {ppm}");
        let byte = bus.record().bytes()[0];
        let end = START + Time::from_ps(bits(10, baud.into(), ppm.into()));
        assert_eq!((byte.start, byte.end), (START, end));
    }
}

#[test]
fn the_bits_of_a_node_are_cycles_of_its_own_clock() {
    for ppm in [0, 20_000, -20_000] {
        let mut sender = nano("send", &[]);
        sender.clock_ppm = ppm;
        let mut bus = Bus::new(BusConfig::default());
        bus.add_nano(sender).expect("a valid image");
        bus.run_for(Time::from_us(300));
        // The first start bit begins in cycle 47; a bit is 416 cycles.
        let at = |bit: u128| bits(47 + 416 * bit, 16_000_000, ppm.into());
        let expected: Vec<_> = (0..10)
            .map(|bit| (Time::from_ps(at(bit)), bit % 2 == 1))
            .collect();
        assert_eq!(edges(&bus)[..10], expected, "{ppm}");
    }
}

#[test]
fn a_conflict_begins_at_the_first_bit_that_differs() {
    let (mut bus, hosts) = hosts(2);
    for host in &hosts {
        bus.host(*host).send(&[0x35]);
    }
    bus.run_for(Time::from_ms(1));
    assert_eq!(bus.record().conflicts(), []);
    assert!(bus.record().bytes().iter().all(|byte| byte.is_good()));

    let second = bus.now();
    bus.host(hosts[0]).send(&[0x35]);
    bus.host(hosts[1]).send(&[0x75]);
    bus.run_for(Time::from_ms(1));
    let conflicts = bus.record().conflicts();
    assert_eq!(conflicts.len(), 1);
    // Data bit 6 is the eighth; in the next one both are low.
    let bit = |bit| second + Time::from_ps(bits(bit, 38_400, 0));
    assert_eq!(
        (conflicts[0].time, conflicts[0].end),
        (bit(7), Some(bit(8)))
    );
    let (low, high) = (conflicts[0].low, conflicts[0].high);
    assert_eq!((low, high), (hosts[0].into(), hosts[1].into()));
    let bytes = &bus.record().bytes()[2..];
    assert!(bytes.iter().all(|byte| byte.conflict && !byte.is_good()));
    // The low one wins, and the wire stays low for a character.
    let byte = bytes
        .iter()
        .find(|byte| byte.from == Station::Host(hosts[1]));
    assert_eq!(
        byte.map(|byte| (byte.value, byte.framing_error)),
        Some((0x35, true))
    );
}

#[test]
fn a_collision_holds_the_wire_low_as_long_as_it_is_set_and_at_least_while_it_lasts() {
    // Nine bits low against a driver that is high: 234 us.
    let over = START + Time::from_ps(bits(9, 38_400, 0));
    for (hold, until) in [
        (Time::from_us(100), over),
        (Time::from_us(400), START + Time::from_us(400)),
    ] {
        let config = BusConfig {
            conflict_hold: hold,
            ..BusConfig::default()
        };
        let mut bus = Bus::new(config);
        bus.add_nano(nano("de", &[("MODE", 2)]))
            .expect("a valid image");
        let host = bus.add_host(HostPort::new(LINE));
        bus.run_to(START);
        bus.host(host).send(&[0x00]);
        bus.run_for(Time::from_ms(1));
        assert_eq!(edges(&bus), [(START, false), (until, true)], "{hold}");
        assert_eq!(bus.record().conflicts()[0].end, Some(over));
    }
}

/// A node without a DE pin, which drives as long as it has power.
fn hog() -> Nano {
    Nano {
        de: None,
        ..nano("de", &[("MODE", 2)])
    }
}

/// Whether a host's character comes through.
fn comes_through(bus: &mut Bus, from: HostId, to: HostId) -> bool {
    bus.host(to).take();
    bus.host(from).send(&[0x35]);
    bus.run_for(Time::from_ms(2));
    let heard = bus.host(to).take();
    heard.iter().map(|byte| byte.value).eq([0x35]) && heard.iter().all(RxByte::is_good)
}

#[test]
fn a_driver_is_off_the_wire_without_power_and_unplugged_and_on_it_again_later() {
    let (mut bus, hosts) = hosts(2);
    let node = bus.add_nano(hog()).expect("a valid image");
    bus.run_for(START);
    let through = |bus: &mut Bus| comes_through(bus, hosts[0], hosts[1]);
    assert!(!through(&mut bus));
    bus.power_cut(node);
    assert!(through(&mut bus));
    bus.power_up(node);
    assert!(!through(&mut bus));
    bus.unplug(node);
    assert!(through(&mut bus));
    bus.plug(node);
    assert!(!through(&mut bus));
    // A host that is off the wire is neither heard nor hears.
    bus.unplug(node);
    bus.unplug(hosts[1]);
    assert!(!through(&mut bus));
    bus.plug(hosts[1]);
    assert!(through(&mut bus));
}

#[test]
fn an_undriven_wire_is_at_the_mark() {
    let (mut bus, hosts) = hosts(2);
    assert!(bus.wire_level());
    bus.host(hosts[0]).send(&[0x00]);
    bus.run_for(Time::from_us(100));
    assert!(!bus.wire_level());
    bus.unplug(hosts[0]);
    bus.run_for(Time::from_us(1));
    assert!(bus.wire_level());
    bus.run_for(Time::from_ms(1));
    // Start bit and two of data were low: the rest is 1.
    let heard = bus.host(hosts[1]).take();
    assert_eq!(
        heard.iter().map(|byte| byte.value).collect::<Vec<_>>(),
        [0xf8]
    );
    assert_eq!(bus.record().bytes()[0].value, 0xf8);
}

#[test]
fn de_that_goes_on_inside_a_character_puts_its_rest_on_the_wire_and_it_is_lost() {
    let (mut bus, node, _) = one("de", &[("MODE", 3)], LINE);
    bus.run_for(Time::from_ms(1));
    let record = bus.record();
    let byte = record.bytes()[0];
    let on = record.de_edges()[0];
    assert!(on.on && byte.lost && !byte.is_good());
    // 52 rounds of 4 cycles behind UDR0: in the start bit, half a bit late.
    assert!(byte.start < on.time && on.time < byte.start + LINE.bits(1));
    assert_eq!(edges(&bus)[0], (on.time, false));
    assert_eq!(byte.from, Station::Node(node));
}

#[test]
fn noise_holds_the_wire_for_its_time_and_no_longer() {
    let (mut bus, hosts) = hosts(2);
    let us = |us| START + Time::from_us(us);
    bus.noise(us(10), Time::from_us(30), false);
    bus.run_for(Time::from_ms(1));
    assert_eq!(edges(&bus), [(us(10), false), (us(40), true)]);
    // Over a character it wins against the driver, and leaves it the rest: bits 1 and 2 of 0x00.
    bus.clear_record();
    let begin = bus.now();
    let bit = |bit| Time::from_ps(bits(bit, 38_400, 0));
    bus.noise(begin + bit(2), bit(2), true);
    bus.host(hosts[0]).send(&[0x00]);
    bus.run_for(Time::from_ms(1));
    let heard = bus.host(hosts[1]).take();
    let last = heard.last().map(|byte| byte.value);
    assert_eq!(last, Some(0b110));
    assert_eq!(bus.record().bytes()[0].value, 0b110);
    assert_eq!(bus.record().conflicts(), []);
}

#[test]
fn a_host_finds_parity_and_stop_bits_wrong_each_by_its_own_flag() {
    for format in [Format::E81, Format::O81, Format::E71, Format::O71] {
        let line = Line { format, ..LINE };
        let ports = [HostPort::new(line), HostPort::new(line)];
        let (mut bus, hosts) = with_hosts(BusConfig::default(), ports);
        let apart = |one: Tx| one.after(Time::from_ms(1));
        let characters = [
            Tx::byte(0x31),
            apart(Tx::byte(0x31).bad_parity()),
            apart(Tx::byte(0x31).flip_bit(1)),
            apart(Tx::byte(0x31).flip_bit(1).flip_bit(2)),
            apart(Tx::byte(0x31).bad_stop()),
        ];
        bus.host(hosts[0]).send_each(characters);
        bus.run_for(Time::from_ms(8));
        let heard = bus.host(hosts[1]).take().into_iter();
        let heard: Vec<_> = heard
            .map(|byte| (byte.value, byte.parity_error, byte.framing_error))
            .collect();
        let expected = [
            (0x31, false, false),
            (0x31, true, false),
            (0x33, true, false),
            (0x37, false, false),
            (0x31, false, true),
        ];
        assert_eq!(heard, expected, "{format}");
        // The record says so too.
        let bytes = bus.record().bytes().iter();
        let told: Vec<_> = bytes
            .map(|byte| (byte.value as u8, byte.parity_error, byte.framing_error))
            .collect();
        assert_eq!(told, expected, "{format}");
    }
}

#[test]
fn a_character_fits_the_formats_in_which_parity_and_stop_bit_are_right() {
    let odd = Format::new(8, Parity::Odd, 1);
    let fits = |one: Tx, format| {
        let line = Line { format, ..LINE };
        let (mut bus, hosts) = with_hosts(BusConfig::default(), [HostPort::new(line)]);
        bus.host(hosts[0]).send_each([one]);
        bus.run_for(Time::from_ms(1));
        let byte = bus.record().bytes()[0];
        [Format::N81, Format::E81, odd, Format::N82].map(|format| byte.fits(format))
    };
    // 0x31 has three ones: its even parity bit is 1, as a stop bit is.
    let one = Tx::byte(0x31);
    assert_eq!(fits(one, Format::E81), [true, true, false, true]);
    assert_eq!(fits(one, odd), [false, false, true, false]);
    assert_eq!(
        fits(one.bad_parity(), Format::E81),
        [false, false, true, false]
    );
    assert_eq!(
        fits(one.bad_stop(), Format::E81),
        [true, false, false, true]
    );
    // 8N1 is a bit shorter than the others, whose stop bit is not there.
    assert_eq!(fits(one, Format::N81), [true, false, false, true]);
}

#[test]
fn a_host_flags_a_level_that_changes_about_the_middle_of_a_bit() {
    let (mut bus, hosts) = hosts(2);
    let bit = |sixteenths: u128| Time::from_ps(bits(sixteenths, 16 * 38_400, 0));
    // The sample before the middle of data bit 0, of a byte of ones; then one near the edge of a bit.
    for (from, noisy) in [(16 + 6, true), (16 + 2, false)] {
        let begin = bus.now();
        bus.noise(begin + bit(from), bit(2) - Time::from_ns(800), false);
        bus.host(hosts[0]).send(&[0xff]);
        bus.run_for(Time::from_ms(1));
        let heard = bus.host(hosts[1]).take();
        assert_eq!(
            (heard.len(), heard[0].value, heard[0].noise),
            (1, 0xff, noisy)
        );
    }
}

#[test]
fn a_host_takes_no_spike_for_a_start_bit() {
    let (mut bus, hosts) = hosts(1);
    // A bit is 26 us, its middle at 13.
    for (us, heard) in [(5, 0), (12, 0), (14, 1)] {
        bus.noise(bus.now(), Time::from_us(us), false);
        bus.run_for(Time::from_ms(1));
        assert_eq!(bus.host(hosts[0]).take().len(), heard, "{us} us");
    }
}

#[test]
fn a_reset_drops_the_character_under_way() {
    let sent = |reset: Option<Time>| {
        let (mut bus, node, _) = one("send", &[], LINE);
        let mut since = Time::ZERO;
        if let Some(at) = reset {
            bus.run_to(at);
            bus.reset(node);
            since = at;
        }
        bus.run_to(since + Time::from_ms(2));
        let edges = bus.record().data_edges().iter();
        let later = edges.filter(|edge| edge.time > since);
        later
            .map(|edge| (edge.time - since, edge.level))
            .collect::<Vec<_>>()
    };
    // 400 us are 6400 cycles: in the second of three characters.
    assert_eq!(sent(Some(Time::from_us(400))), sent(None));
}

#[test]
fn the_record_is_the_same_whatever_the_quantum() {
    let run = |quantum| {
        let config = BusConfig {
            quantum,
            ..BusConfig::default()
        };
        let mut bus = Bus::new(config);
        for (name, ppm) in [("send", 0), ("send", 9_000)] {
            let mut node = nano(name, &[]);
            node.clock_ppm = ppm;
            bus.add_nano(node).expect("a valid image");
        }
        let host = bus.add_host(HostPort::new(LINE));
        bus.run_to(START);
        bus.host(host).send(&[0x35, 0x53]);
        bus.run_to(Time::from_ms(5));
        (bus.record().clone(), bus.host(host).take())
    };
    let exact = run(Time::from_ns(100));
    assert!(exact.0.conflicts().len() > 1);
    for us in [1, 5, 50] {
        assert_eq!(run(Time::from_us(us)), exact, "{us} us");
    }
}
