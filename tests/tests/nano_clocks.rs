//! The line at other CPU clocks than the Nano's: 8, 11.0592 and 20 MHz, from the slowest rate that Timer1 counts to
//! the fastest rate, a sixteenth of the clock.

use multidrop_bus::{Bus, BusConfig, Clock, Format, HostPort, Line, Nano, Time, Tx};
use multidrop_testkit::{Rig, assert_bus_rules, frames, image};

/// Turnaround beyond t3.5 at the most, in microseconds: one bit, or one at 38400 baud where that is
/// longer.
fn late(baud: u32) -> f64 {
    1e6 / f64::from(baud.min(38_400))
}

fn check(clock_hz: u32, baud: u32) {
    check_format(clock_hz, baud, Format::N81);
}

fn check_format(clock_hz: u32, baud: u32, format: Format) {
    let (clock, rate, bits) = (clock_hz.to_string(), baud.to_string(), format.to_string());
    let mut options = vec!["--clock", &clock, "--baud", &rate];
    if format != Format::N81 {
        options.extend(["--format", &bits]);
    }
    let line = Line { baud, format };
    let mut bus = Bus::new(BusConfig::default());
    let node = bus
        .add_nano(Nano {
            clock_hz,
            ..Nano::new("unit 1", image("registers", &options))
        })
        .expect("the image runs");
    let host = bus.add_host(HostPort::new(line));
    bus.run_for(Time::from_ms(50) + line.t35());

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
            .transact(host, &request, line.t35() + Time::from_ms(1500))
            .unwrap_or_else(|| panic!("{clock_hz} Hz, {baud} baud: no answer to {request:02x?}"));
        assert_eq!(answer.bytes, expected, "{clock_hz} Hz, {baud} baud");
        let beyond = answer.turnaround().us() - line.t35().us();
        assert!(
            (0.0..late(baud)).contains(&beyond),
            "{clock_hz} Hz, {baud} baud: answered {beyond:.2} us beyond t3.5"
        );
    }
    // A gap of 95 % of t3.5 voids a frame, one that begins t3.5 less its last 1/24 is a new one.
    for (per_mille, answered) in [(950, false), (975, true)] {
        bus.host(host).take();
        bus.run_for(line.t35() * 2);
        let other = frames::words(9, 3, 0, 1).into_iter().map(Tx::byte);
        let ours = frames::words(1, 0x03, 3, 1).into_iter().enumerate();
        let ours = ours.map(|(at, byte)| {
            let pause = line.t35() * per_mille / 1000;
            Tx::byte(byte).after(if at == 0 { pause } else { Time::ZERO })
        });
        let end = bus.host(host).send_each(other.chain(ours));
        bus.run_to(end);
        let answer = bus.transact(host, &[], line.t35() + Time::from_ms(500));
        assert_eq!(
            answer.is_some(),
            answered,
            "{clock_hz} Hz, {baud} baud {per_mille}"
        );
    }
    assert_bus_rules(&bus, line);
    bus.run_for(line.t35() * 2);
    assert!(bus.node(node).is_asleep());
}

/// Silences beyond the 16 bits of Timer1: at 1200 baud up to 80000 ticks, at 300 and 8 MHz 128000.
#[test]
fn slow_rates_in_every_format() {
    for format in [Format::N81, Format::E81, Format::O81, Format::N82] {
        for clock_hz in [8_000_000, 16_000_000, 20_000_000] {
            check_format(clock_hz, 1_200, format);
        }
    }
}

#[test]
fn the_slowest_rates() {
    for (clock_hz, baud, format) in [
        (8_000_000, 300, Format::N81),
        (8_000_000, 300, Format::E81),
        (11_059_200, 300, Format::N82),
        (16_000_000, 600, Format::E81),
        (20_000_000, 600, Format::N81),
        (20_000_000, 600, Format::N82),
        (20_000_000, 1_800, Format::N81),
    ] {
        check_format(clock_hz, baud, format);
    }
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

/// How much later than t3.5 an answer may begin: a sample of the receiver and one of the transmitter, each up to an eighth of a bit,
/// and the cycles of two interrupts and of what is rounded up to ticks.
fn rounded(clock_hz: u32, line: Line) -> Time {
    line.bits(1) / 4 + Clock::new(clock_hz, 0).time(130)
}

#[test]
fn silences_are_exact_at_a_clock_that_counts_no_whole_microseconds() {
    let clock_hz = 11_059_200;
    for baud in [9_600, 38_400, 115_200] {
        let line = Line::n81(baud);
        let rate = baud.to_string();
        let options = ["--clock", "11059200", "--baud", &rate];
        let nano = Nano {
            clock_hz,
            ..Nano::new("unit 1", image("registers", &options))
        };
        let mut rig = Rig::nano(nano, line);
        let mut beyond = Vec::new();
        for step in 0..40 {
            // Another phase of the node's clocks each time.
            rig.pause(Time::from_ms(2) + Time::from_ns(313 * step));
            let answer = rig.exchange(&frames::words(1, 4, 2, 1)).expect("an answer");
            beyond.push(answer.turnaround() - line.t35());
        }
        let latest = beyond.iter().max().expect("40 answers");
        assert!(
            *latest <= rounded(clock_hz, line),
            "{latest} beyond t3.5 at {baud}"
        );
    }
}

/// Timer1 goes round every 32.768 ms.
const TURN: Time = Time::from_us(32_768);

#[test]
fn answers_begin_at_t3_5_wherever_in_an_exchange_timer1_goes_round() {
    let line = Line::n81(38_400);
    // It is there from the start, and so is its timer, but for a few us.
    let mut rig = Rig::registers(16, line);
    for step in 0..110 {
        // An exchange takes 5.7 ms.
        let next = TURN * (step + 2) - Time::from_us(55) * step;
        rig.pause(next - rig.bus.now());
        let answer = rig.exchange(&frames::words(1, 4, 2, 1)).expect("an answer");
        let beyond = answer.turnaround() - line.t35();
        assert!(beyond < line.bits(1), "{beyond}, step {step}");
    }
}
