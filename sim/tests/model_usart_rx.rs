//! USART0's receiver against cycle counts worked out from the data sheet (DS40002061B, ch. 20).
//!
//! `avr/poll_rx.S` writes UBRR0L at the end of its 17th cycle (`sbi` 2, five times `ldi` `sts` 15).
//! It reads UCSR0A every 5 cycles and toggles PB0 5 cycles after the read that saw RXC.

use multidrop_bus::{Bus, Format, Level, Line, NodeId, Parity, Time, Tx};
use multidrop_testkit::assembler::{bus_with, edges, nano, one};

/// The host's start bit begins with cycle 16000.
const START: Time = Time::from_ms(1);

fn received(bus: &Bus, node: NodeId, count: usize) -> Vec<(u8, u8)> {
    let ram: [u8; 64] = bus.node(node).read(0x100);
    ram.chunks(2)
        .take(count)
        .map(|pair| (pair[0], pair[1]))
        .collect()
}

fn shown_at(symbols: &[(&str, u32)], line: Line) -> u64 {
    let (mut bus, node, host) = one("poll_rx", symbols, line);
    bus.run_to(START);
    bus.host(host).send(&[0x5a]);
    bus.run_for(Time::from_ms(2));
    let mask = (1u16 << line.format.data_bits()) - 1;
    assert_eq!(u16::from(received(&bus, node, 1)[0].1), 0x5a & mask);
    let toggles = edges(&bus, node, 0, Level::High);
    assert_eq!(toggles.len(), 1);
    toggles[0]
}

fn assert_rxc(symbols: &[(&str, u32)], line: Line, rxc: u64) {
    let shown = shown_at(symbols, line);
    assert!(
        (rxc + 5..=rxc + 9).contains(&shown),
        "{symbols:?}: {shown}, not {rxc} + 5..=9"
    );
}

#[test]
fn rxc_comes_with_the_tenth_sample_of_the_first_stop_bit() {
    // UBRR 25: ticks at 17 + 26 k. The first at or after 16000 is 17 + 26 * 615 = 16007: sample 1.
    // 8N1: the stop bit is bit 9, its sample 10 is 9 * 16 + 9 = 153 ticks later: 19985 (20.8.2).
    let n81 = Line::n81(38_400);
    assert_rxc(&[("UBRR", 25)], n81, 16_007 + 153 * 26);
    // 8N2: the first stop bit decides. 7E1 has as many bits. 8E1 has one more: 169 ticks.
    let with = |format| Line { format, ..n81 };
    assert_rxc(&[("UCSRC", 0x0e)], with(Format::N82), 16_007 + 153 * 26);
    assert_rxc(&[("UCSRC", 0x24)], with(Format::E71), 16_007 + 153 * 26);
    assert_rxc(&[("UCSRC", 0x26)], with(Format::E81), 16_007 + 169 * 26);
    // UBRR 8: ticks at 17 + 9 k; 17 + 9 * 1776 = 16001.
    assert_rxc(&[("UBRR", 8)], Line::n81(111_111), 16_001 + 153 * 9);
}

#[test]
fn rxc_comes_with_the_sixth_sample_at_double_speed() {
    // U2X, UBRR 51: ticks at 17 + 52 k; 17 + 52 * 308 = 16033; 9 * 8 + 5 = 77 ticks.
    assert_rxc(
        &[("UBRR", 51), ("UCSRA", 2)],
        Line::n81(38_400),
        16_033 + 77 * 52,
    );
}

/// Five characters take 1.3 ms from 1 ms on; the program looks after 5 ms.
const LATER: (&str, u32) = ("WAIT", 16_000);
/// RXC and UDRE.
const GOOD: u8 = 0xa0;

/// The bus after it looked, and what was in SRAM before.
fn late(bytes: &[u8]) -> (Bus, NodeId, Vec<(u8, u8)>) {
    let (mut bus, node, host) = one("poll_rx", &[LATER], Line::n81(38_400));
    let before = received(&bus, node, 4);
    bus.run_to(START);
    bus.host(host).send(bytes);
    bus.run_for(Time::from_ms(6));
    (bus, node, before)
}

#[test]
fn three_characters_wait_two_in_the_fifo_and_one_in_the_shift_register() {
    let (bus, node, before) = late(&[1, 2, 3]);
    let expected = [(GOOD, 1), (GOOD, 2), (GOOD, 3), before[3]];
    assert_eq!(received(&bus, node, 4), expected);
}

#[test]
fn the_start_bit_of_a_fourth_overruns_the_third() {
    // DOR (bit 3) comes with the character after the gap (20.7.4).
    let (bus, node, _) = late(&[1, 2, 3, 4]);
    assert_eq!(
        received(&bus, node, 3),
        [(GOOD, 1), (GOOD, 2), (GOOD | 8, 4)]
    );
    let (bus, node, _) = late(&[1, 2, 3, 4, 5]);
    assert_eq!(
        received(&bus, node, 3),
        [(GOOD, 1), (GOOD, 2), (GOOD | 8, 5)]
    );
}

#[test]
fn the_third_is_lost_as_soon_as_a_fourth_begins() {
    // Characters of 260 us from 1 ms on: it looks at 1.9 ms, amid the fourth, and at 1.7 ms, amid the third.
    for (wait, third) in [(6_080, None), (5_440, Some((GOOD, 3)))] {
        let symbols = [("WAIT", wait)];
        let (mut bus, node, host) = one("poll_rx", &symbols, Line::n81(38_400));
        bus.run_to(START);
        bus.host(host).send(&[1, 2, 3, 4]);
        bus.run_for(Time::from_ms(2));
        let mut expected = vec![(GOOD, 1), (GOOD, 2)];
        expected.extend(third);
        expected.push((if third.is_some() { GOOD } else { GOOD | 8 }, 4));
        assert_eq!(received(&bus, node, expected.len()), expected, "{wait}");
    }
}

#[test]
fn flags_belong_to_their_character() {
    let line = Line {
        baud: 38_400,
        format: Format::E81,
    };
    let (mut bus, node, host) = one("poll_rx", &[LATER, ("UCSRC", 0x26)], line);
    bus.run_to(START);
    bus.host(host).send_each([
        Tx::byte(0x11),
        Tx::byte(0x22).bad_parity(),
        Tx::byte(0x33).bad_stop(),
    ]);
    bus.run_for(Time::from_ms(6));
    // UPE is bit 2, FE bit 4.
    let expected = [(GOOD, 0x11), (GOOD | 4, 0x22), (GOOD | 0x10, 0x33)];
    assert_eq!(received(&bus, node, 3), expected);
}

#[test]
fn a_damaged_data_bit_is_a_parity_error_or_another_byte() {
    let line = |format| Line {
        baud: 38_400,
        format,
    };
    for (ucsrc, format, flag) in [(0x26, Format::E81, 4), (0x06, Format::N81, 0)] {
        let (mut bus, node, host) = one("poll_rx", &[("UCSRC", ucsrc)], line(format));
        bus.run_to(START);
        bus.host(host).send_each([Tx::byte(0x11).flip_bit(7)]);
        bus.run_for(Time::from_ms(2));
        assert_eq!(received(&bus, node, 1), [(GOOD | flag, 0x91)]);
    }
}

#[test]
fn mpcm_drops_data_frames_and_strips_the_address_bit() {
    // 7N2 with MPCM: the first stop bit is the eighth bit of what the host sends (20.9).
    let symbols = [("UCSRA", 1), ("UCSRC", 0x0c)];
    let (mut bus, node, host) = one("poll_rx", &symbols, Line::n81(38_400));
    bus.run_to(START);
    bus.host(host).send(&[0x41, 0xc2, 0x43, 0xc4]);
    bus.run_for(Time::from_ms(3));
    assert_eq!(
        received(&bus, node, 2),
        [(GOOD | 1, 0x42), (GOOD | 1, 0x44)]
    );
}

/// What a node hears of bytes sent without a gap by a host whose clock is off.
fn with_clock_off(ppm: i32) -> bool {
    let bytes = [
        0x00, 0xff, 0x55, 0xaa, 0x80, 0x7f, 0x01, 0xfe, 0x00, 0x00, 0x80, 0x80,
    ];
    let (mut bus, node, _) = bus_with(nano("poll_rx", &[]), Line::n81(38_400));
    let mut port = multidrop_bus::HostPort::new(Line::n81(38_400));
    port.clock_ppm = ppm;
    let host = bus.add_host(port);
    bus.run_to(START);
    bus.host(host).send(&bytes);
    bus.run_for(Time::from_ms(5));
    received(&bus, node, bytes.len()) == bytes.map(|byte| (GOOD, byte))
}

#[test]
fn baud_mismatch_of_2_percent_is_received_and_of_6_percent_is_not() {
    // Ten bits at most 4.5 % off keep the samples of the stop bit inside it (20.8.3).
    for ppm in [0, 20_000, -20_000] {
        assert!(with_clock_off(ppm), "{ppm} ppm");
    }
    for ppm in [60_000, -60_000] {
        assert!(!with_clock_off(ppm), "{ppm} ppm");
    }
}

#[test]
fn odd_parity_is_not_even_parity() {
    let odd = Line {
        baud: 38_400,
        format: Format::new(8, Parity::Odd, 1),
    };
    let (mut bus, node, host) = one("poll_rx", &[("UCSRC", 0x26)], odd);
    bus.run_to(START);
    bus.host(host).send(&[0x10]);
    bus.run_for(Time::from_ms(2));
    assert_eq!(received(&bus, node, 1), [(GOOD | 4, 0x10)]);
}

#[test]
fn a_spike_shorter_than_half_a_bit_is_no_start_bit() {
    let (mut bus, node, _) = one("poll_rx", &[], Line::n81(38_400));
    bus.noise(START, Time::from_us(8), false);
    bus.run_for(Time::from_ms(3));
    assert_eq!(edges(&bus, node, 0, Level::High), []);
    // Three of four samples of 8, 9, 10 low: from 12 us on a bit of 26 us is a start bit.
    bus.noise(bus.now(), Time::from_us(20), false);
    bus.run_for(Time::from_ms(3));
    assert_eq!(received(&bus, node, 1), [(GOOD, 0xff)]);
}
