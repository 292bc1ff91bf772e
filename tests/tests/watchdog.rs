//! The watchdog does not reset a unit that works: on a silent bus, and in the longest frames at the slowest rate.

use multidrop_bus::{Bus, BusConfig, Format, HostId, HostPort, Line, Stm32, Time, WireId};
use multidrop_testkit::conforms::Board;
use multidrop_testkit::frames::{adu, data, words};
use multidrop_testkit::plain::wire::{Way, ascii};
use multidrop_testkit::{LINE, Runner, conformance, guarded};

/// A board with `conformance` at its slowest, and a host.
fn slow(board: Board, way: Way) -> (Bus, HostId, Line) {
    let baud = match (board, way) {
        (Board::Nano, Way::Rtu) => 600,
        (Board::Nano, Way::Ascii) => 1_200,
        (Board::Stm32(_), _) => 650,
    };
    let line = match way {
        Way::Rtu => Line::n81(baud),
        Way::Ascii => Line {
            baud,
            format: Format::E71,
        },
    };
    let image = conformance(board, way, line);
    let mut bus = Bus::new(BusConfig::default());
    match board {
        Board::Nano => {
            bus.add_image("unit", &image).expect("a valid image");
        }
        Board::Stm32(runner) => {
            bus.add_stm32(Stm32 {
                name: "unit".to_owned(),
                image,
                emulator: runner.emulator(),
                wires: [None, None, None, Some(WireId::default())],
            })
            .expect("a valid image");
        }
    }
    let host = bus.add_host(HostPort::new(line));
    // Nothing is heard before the first t3.5.
    bus.run_for(Time::from_ms(50) + line.t35());
    (bus, host, line)
}

/// Function 41 with 252 bytes is answered with as many. A register that was written before tells that there was no reset: it is
/// 200 then.
fn is_not_reset_by_long_frames(board: Board, way: Way) {
    let (mut bus, host, line) = slow(board, way);
    let frame = |body: &[u8]| match way {
        Way::Rtu => adu(body),
        Way::Ascii => ascii(body, b'\n'),
    };
    let mut ask = |body: &[u8]| {
        let answer = bus.transact(host, &frame(body), line.t35() * 3);
        answer.map_or(Vec::new(), |answer| answer.bytes)
    };
    let write = [17, 6, 0, 100, 0, 200];
    assert_eq!(ask(&write), frame(&write));
    let payload: Vec<u8> = (0..252).map(|byte| byte as u8).collect();
    let request = [&[17, 0x41], &payload[..]].concat();
    let mut reversed = payload;
    reversed.reverse();
    let expected = frame(&[&[17, 0x41], &reversed[..]].concat());
    assert_eq!(expected.len(), if way == Way::Rtu { 256 } else { 513 });
    for _ in 0..3 {
        assert_eq!(ask(&request), expected);
        // And one of somebody else.
        let other = [&[18, 0x41], &reversed[..]].concat();
        assert_eq!(ask(&other), []);
    }
    assert_eq!(ask(&[17, 3, 0, 100, 0, 1]), frame(&[17, 3, 2, 0, 200]));
}

#[test]
fn a_nano_lives_through_256_characters_at_its_slowest() {
    is_not_reset_by_long_frames(Board::Nano, Way::Rtu);
}

#[test]
fn a_nano_lives_through_513_characters_at_its_slowest() {
    is_not_reset_by_long_frames(Board::Nano, Way::Ascii);
}

#[test]
fn an_stm32_lives_through_256_characters_at_its_slowest() {
    is_not_reset_by_long_frames(Board::Stm32(Runner::Core), Way::Rtu);
}

#[test]
fn an_stm32_lives_through_513_characters_at_its_slowest() {
    is_not_reset_by_long_frames(Board::Stm32(Runner::Core), Way::Ascii);
}

/// The part of its time that a node may be awake for the watchdog alone.
const SHARE: f64 = 0.000_2;

#[test]
fn a_nano_lives_through_an_hour_of_silence_and_sleeps() {
    let mut bus = Bus::new(BusConfig::default());
    let node = bus
        .add_image("unit", &guarded(16, LINE))
        .expect("a valid image");
    let host = bus.add_host(HostPort::new(LINE));
    bus.run_for(Time::from_ms(20));
    let write = words(1, 6, 3, 0x1234);
    let patience = Time::from_ms(20);
    let answer = bus.transact(host, &write, patience);
    assert_eq!(answer.expect("an answer").bytes, write);
    bus.run_for(Time::from_ms(20));

    bus.node_mut(node).clear_stats();
    bus.run_for(Time::from_s(3_600));
    let stats = bus.node(node).stats();
    // It was looked after: once in each half of the watchdog's time, 1.024 s.
    assert_eq!(stats.vectors[6].count, 3_515);
    let share = stats.awake as f64 / (stats.awake + stats.asleep) as f64;
    assert!(share <= SHARE, "awake for {share} of its time");

    let answer = bus.transact(host, &words(1, 3, 3, 1), patience);
    assert_eq!(answer.expect("an answer").bytes, data(1, 3, &[0x12, 0x34]));
}

/// LSI, which the STM32's watchdog counts, may be far off: neither makes it bite in silence, nor does it forget to.
#[test]
fn an_stm32_lives_at_both_ends_of_what_lsi_may_be() {
    for lsi in [17_000, 47_000] {
        let mut bus = Bus::new(BusConfig::default());
        let machine = bus
            .add_stm32(Stm32 {
                name: "unit".to_owned(),
                image: conformance(Board::Stm32(Runner::Core), Way::Rtu, LINE),
                emulator: Runner::Core.emulator(),
                wires: [None, None, None, Some(WireId::default())],
            })
            .expect("a valid image");
        let silicon = bus.machine_mut(machine).silicon();
        silicon.expect("it is not in QEMU").set_lsi(lsi);
        let host = bus.add_host(HostPort::new(LINE));
        bus.run_for(Time::from_ms(50));
        let write = words(17, 6, 100, 200);
        let patience = Time::from_ms(20);
        let answer = bus.transact(host, &write, patience);
        assert_eq!(answer.expect("an answer").bytes, write);
        bus.run_for(Time::from_s(20));
        let answer = bus.transact(host, &words(17, 3, 100, 1), patience);
        assert_eq!(
            answer.expect("an answer").bytes,
            data(17, 3, &[0, 200]),
            "LSI of {lsi} Hz"
        );
    }
}
