//! USART0's transmitter against cycle counts worked out from the data sheet (DS40002061B, ch. 20).
//!
//! `avr/send.S` writes UBRR0L at the end of its 21st cycle: three `sbi` (2 cycles each), then five
//! times `ldi` and `sts` (1 + 2): 6 + 15 = 21. The baud generator ticks at 21 + k (UBRR + 1)
//! (20.3.1). UDR0 is written 3 cycles later, so the first start bit begins with the next tick, at
//! 21 + (UBRR + 1), wherever UBRR + 1 > 3.

use multidrop_bus::{Line, Nano, NodeId, Station, Time, TxPhase};
use multidrop_testkit::assembler::{bus_with, nano, rise};

const WRITTEN: u64 = 21;

fn run(nano: Nano) -> (multidrop_bus::Bus, NodeId) {
    let (mut bus, node, _) = bus_with(nano, Line::n81(38_400));
    bus.run_for(Time::from_ms(5));
    (bus, node)
}

/// Start and end of each character, in cycles.
fn characters(bus: &multidrop_bus::Bus, node: NodeId) -> Vec<(u64, u64)> {
    let clock = bus.node(node).clock();
    bus.record()
        .sent_by(Station::Node(node))
        .map(|byte| {
            (
                clock.tick_at_or_after(byte.start),
                clock.tick_at_or_after(byte.end),
            )
        })
        .collect()
}

/// Three characters in a row: `bits` bits of `bit` cycles, no gap (20.6.1: double-buffered).
fn three_in_a_row(symbols: &[(&str, u32)], tick: u64, bit: u64, bits: u64) {
    let (bus, node) = run(nano("send", symbols));
    let first = WRITTEN + tick;
    let character = bits * bit;
    let expected: Vec<_> = (0..3)
        .map(|k| (first + k * character, first + (k + 1) * character))
        .collect();
    assert_eq!(characters(&bus, node), expected, "{symbols:?}");
    // TXC comes once, when all three have left (20.6.3). The loop that waits for it reads UCSR0A
    // every 5 cycles and shows it 5 cycles after the read: `lds`'s second cycle (1), `sbrs` that
    // skips (2), `sbi` (2).
    let end = first + 3 * character;
    let seen = rise(&bus, node, 0);
    assert!(
        (end + 5..=end + 9).contains(&seen),
        "{symbols:?}: {seen}, not {end} + 5..=9"
    );
}

#[test]
fn character_times_at_38400() {
    // UBRR 25: (25 + 1) * 16 = 416 cycles per bit.
    three_in_a_row(&[("UBRR", 25), ("UCSRC", 0x06)], 26, 416, 10); // 8N1
    three_in_a_row(&[("UBRR", 25), ("UCSRC", 0x26)], 26, 416, 11); // 8E1
    three_in_a_row(&[("UBRR", 25), ("UCSRC", 0x0e)], 26, 416, 11); // 8N2
    three_in_a_row(&[("UBRR", 25), ("UCSRC", 0x24)], 26, 416, 10); // 7E1
}

#[test]
fn character_times_at_115200() {
    // UBRR 8: (8 + 1) * 16 = 144 cycles per bit.
    three_in_a_row(&[("UBRR", 8), ("UCSRC", 0x06)], 9, 144, 10);
    three_in_a_row(&[("UBRR", 8), ("UCSRC", 0x26)], 9, 144, 11);
    three_in_a_row(&[("UBRR", 8), ("UCSRC", 0x0e)], 9, 144, 11);
    three_in_a_row(&[("UBRR", 8), ("UCSRC", 0x24)], 9, 144, 10);
}

#[test]
fn character_times_with_double_speed() {
    // U2X: 8 ticks per bit. UBRR 51: 52 * 8 = 416. UBRR 16: 17 * 8 = 136.
    three_in_a_row(&[("UBRR", 51), ("UCSRA", 2)], 52, 416, 10);
    three_in_a_row(&[("UBRR", 16), ("UCSRA", 2)], 17, 136, 10);
}

#[test]
fn the_bytes_on_the_wire_are_those_written() {
    let (bus, node) = run(nano("send", &[]));
    let sent: Vec<_> = bus.record().sent_by(Station::Node(node)).collect();
    let values: Vec<_> = sent.iter().map(|byte| byte.value).collect();
    assert_eq!(values, [0x55, 0x0f, 0xa5]);
    assert!(sent.iter().all(|byte| byte.is_good()));
}

/// A third byte written 5207 cycles after UDRE was read as set: `sbrs` 2 and the rest of `lds` 1,
/// two `ldi` 2, 1300 rounds of 4 less 1, `ldi` and `sts` 3. UDRE is set when the second character
/// moves on, at 21 + 26 + 4160 = 4207, and read up to 4 cycles later: the write is at 9414 ..= 9418.
const LATE: (&str, u32) = ("GAP", 1300);

#[test]
fn a_late_byte_starts_with_the_next_tick_of_the_baud_generator() {
    let (bus, node) = run(nano("send", &[LATE]));
    // The next of 21 + 26 k is 21 + 26 * 362 = 9433.
    assert_eq!(characters(&bus, node)[2].0, 9433);
}

#[test]
fn a_late_byte_starts_with_the_next_bit_when_the_divider_runs_free() {
    let mut late = nano("send", &[LATE]);
    late.tx_phase = TxPhase::BitClock;
    let (bus, node) = run(late);
    // Bits begin at 21 + 416 k. The first character now starts a bit after the write, at 437; the
    // second at 4597, so the third is written 390 later than above, at 9804 ..= 9808. The next bit
    // begins at 21 + 416 * 24 = 10005.
    let starts: Vec<_> = characters(&bus, node).iter().map(|c| c.0).collect();
    assert_eq!(starts, [437, 4597, 10_005]);
}

#[test]
fn clock_of_11_0592_mhz_makes_38400_exactly() {
    let mut exact = nano("send", &[("UBRR", 17)]);
    exact.clock_hz = 11_059_200;
    let (bus, node) = run(exact);
    // 18 * 16 = 288 cycles per bit; 2880 / 11.0592 MHz = 260.416 666.. us.
    assert_eq!(
        characters(&bus, node),
        [(39, 2919), (2919, 5799), (5799, 8679)]
    );
    let starts: Vec<_> = bus.record().bytes().iter().map(|byte| byte.start).collect();
    // 39 / 11.0592 MHz = 3.526 475 694.. us, cut to picoseconds.
    assert_eq!(starts[0], Time::from_ps(3_526_475));
    assert_eq!(starts[2], Time::from_ps(524_359_809));
}
