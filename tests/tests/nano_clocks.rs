//! The line at other CPU clocks than the Nano's: 8, 11.0592 and 20 MHz, from 2400 baud to the fastest
//! rate that each takes, which is a sixteenth of the clock.

mod common;

use common::{assert_bus_rules, frames, image};
use multidrop_bus::{Bus, BusConfig, HostPort, Line, Nano, Time};

/// Turnaround beyond t3.5 at the most, in microseconds: one bit, or one at 38400 baud where that is
/// longer.
fn late(baud: u32) -> f64 {
    1e6 / f64::from(baud.min(38_400))
}

/// t3.5 in microseconds (SER 2.5.1.1), 10 bits a character.
fn t3_5(baud: u32) -> f64 {
    if baud > 19_200 {
        1750.0
    } else {
        35e6 / f64::from(baud)
    }
}

fn check(clock_hz: u32, baud: u32) {
    let options = [
        "--clock",
        &clock_hz.to_string(),
        "--baud",
        &baud.to_string(),
    ];
    let line = Line::n81(baud);
    let mut bus = Bus::new(BusConfig::default());
    let node = bus
        .add_nano(Nano {
            clock_hz,
            ..Nano::new("unit 1", image("registers", &options))
        })
        .expect("the image runs");
    let host = bus.add_host(HostPort::new(line));
    bus.run_for(Time::from_ms(50));

    let data: Vec<u8> = (0..32).map(|byte| byte * 7).collect();
    let exchanges = [
        (
            frames::block(1, 0x10, 0, 16, &data),
            frames::words(1, 0x10, 0, 16),
        ),
        (frames::words(1, 0x03, 0, 16), frames::data(1, 0x03, &data)),
        (
            frames::words(1, 0x06, 3, 0xBEEF),
            frames::words(1, 0x06, 3, 0xBEEF),
        ),
        (
            frames::words(1, 0x03, 3, 1),
            frames::data(1, 0x03, &[0xBE, 0xEF]),
        ),
        (frames::words(1, 0x03, 16, 1), frames::exception(1, 0x03, 2)),
    ];
    for (request, expected) in exchanges {
        let answer = bus
            .transact(host, &request, Time::from_ms(1500))
            .unwrap_or_else(|| panic!("{clock_hz} Hz, {baud} baud: no answer to {request:02x?}"));
        assert_eq!(answer.bytes, expected, "{clock_hz} Hz, {baud} baud");
        let beyond = answer.turnaround().us() - t3_5(baud);
        assert!(
            (0.0..late(baud)).contains(&beyond),
            "{clock_hz} Hz, {baud} baud: answered {beyond:.2} us beyond t3.5"
        );
    }
    assert_bus_rules(&bus, line);
    bus.run_for(Time::from_ms(50));
    assert!(bus.node(node).is_asleep());
}

#[test]
fn at_8_mhz() {
    for baud in [2_400, 38_400, 500_000] {
        check(8_000_000, baud);
    }
}

#[test]
fn at_11_0592_mhz() {
    for baud in [115_200, 691_200] {
        check(11_059_200, baud);
    }
}

#[test]
fn at_16_mhz() {
    for baud in [2_400, 1_000_000] {
        check(16_000_000, baud);
    }
}

#[test]
fn at_20_mhz() {
    for baud in [38_400, 250_000] {
        check(20_000_000, baud);
    }
}
