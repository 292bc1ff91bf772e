//! Slow lines, whose silences are longer than one turn of a timer, with clocks of client and unit that differ: t1.5
//! and t3.5 are right by the unit's clock, and no frame is lost.

use multidrop_bus::{Format, Line, Station, Time, Tx};
use multidrop_testkit::Runner;
use multidrop_testkit::frames::words;
use multidrop_testkit::pair::{Pair, by_clock};

/// In parts per million: client and unit.
const APART: [(i32, i32); 4] = [
    (10_000, -10_000),
    (-10_000, 10_000),
    (20_000, 0),
    (0, 20_000),
];

fn even(baud: u32) -> Line {
    Line {
        baud,
        format: Format::E81,
    }
}

/// A write with a pause before one of its characters; whether it was answered.
fn with_pause(pair: &mut Pair, frame: &[u8], at: usize, pause: Time) -> bool {
    let characters = frame.iter().enumerate();
    let characters: Vec<_> = characters
        .map(|(place, &byte)| match place == at {
            true => Tx::byte(byte).after(pause),
            false => Tx::byte(byte),
        })
        .collect();
    let answer = pair.say_each(characters);
    if !answer.is_empty() {
        assert_eq!(answer, frame, "a write of one register comes back");
    }
    !answer.is_empty()
}

/// A pause of half a bit less than t1.5 by the unit's clock is part of a frame, one of half a bit more voids it, up to the last part
/// of t3.5.
fn gaps_are_judged(pair: &mut Pair) {
    let line = pair.line;
    let bit = line.bits(1);
    let by_unit = |span: Time| by_clock(span, pair.unit_ppm);
    let (t15, t35) = (by_unit(line.t15()), by_unit(line.t35()));
    let cases = [
        (t15 - bit / 2, true),
        (t15 + bit / 2, false),
        (t35 * 94 / 100, false),
    ];
    for (pause, answered) in cases {
        let was = with_pause(pair, &words(1, 6, 3, 0x0100), 4, pause);
        let (baud, unit) = (line.baud, pair.unit_ppm);
        assert_eq!(was, answered, "{pause}, {baud} baud, unit {unit}");
    }
    // A character that begins in the last 1/24 of t3.5 begins a frame, behind any that came before it.
    let characters = words(2, 3, 0, 2).into_iter().map(Tx::byte);
    let mut characters: Vec<_> = characters.collect();
    let write = words(1, 6, 3, 0x0200);
    characters.push(Tx::byte(write[0]).after(t35 * 97 / 100));
    characters.extend(write[1..].iter().map(|&byte| Tx::byte(byte)));
    assert_eq!(pair.say_each(characters), write);
}

/// Answers begin t3.5 after the request by the unit's clock, or up to a bit later.
fn answers_are_in_time(pair: &Pair) {
    let bytes = pair.bus.record().bytes();
    let host = Station::Host(pair.client);
    let mut answers = 0;
    for two in bytes.windows(2) {
        if two[0].from != host || two[1].from == host {
            continue;
        }
        answers += 1;
        let line = pair.line;
        let due = by_clock(line.character() + line.t35(), pair.unit_ppm);
        let after = two[1].start - two[0].start;
        let latest = due + line.bits(1);
        assert!(after >= due && after <= latest, "{after}, due {due}");
    }
    assert!(answers > 5, "{answers}");
}

fn holds(pair: impl Fn(Line, i32, i32) -> Pair, line: Line) {
    for apart in APART {
        holds_at(&pair, line, apart);
    }
}

fn holds_at(pair: impl Fn(Line, i32, i32) -> Pair, line: Line, (client, unit): (i32, i32)) {
    let mut pair = pair(line, client, unit);
    gaps_are_judged(&mut pair);
    // Back to back, t3.5 apart by the client's clock.
    let what = format!("{} baud, client {client}, unit {unit}", line.baud);
    assert_eq!(pair.lost(1), 0, "{what}");
    answers_are_in_time(&pair);
    assert_eq!(pair.bus.record().conflicts(), []);
}

/// Here t1.5 alone is longer than Timer1 counts in one go.
#[test]
fn a_nano_at_400_baud() {
    holds_at(Pair::nano, even(400), APART[0]);
}

#[test]
fn a_nano_at_600_baud() {
    holds(Pair::nano, even(600));
}

#[test]
fn a_nano_at_1200_baud() {
    holds(Pair::nano, Line::n81(1_200));
}

#[test]
fn a_nano_at_2400_baud() {
    holds(Pair::nano, even(2_400));
}

#[test]
fn an_stm32_at_641_baud() {
    holds(stm32, Line::n81(641));
}

#[test]
fn an_stm32_at_1200_baud() {
    holds(stm32, even(1_200));
}

/// The core alone has a clock that can be off.
fn stm32(line: Line, client_ppm: i32, unit_ppm: i32) -> Pair {
    Pair::stm32(Runner::Core, line, client_ppm, unit_ppm)
}
