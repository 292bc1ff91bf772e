//! The rules of the bus that the tests check: a node that keeps them passes, and each violation is reported.

use std::panic::{AssertUnwindSafe, catch_unwind};

use multidrop_bus::{Bus, Format, Line, Station, Time, Tx};
use multidrop_testkit::{LINE, Rules, assert_bus_rules};

/// What the rules say of a bus.
fn verdict(bus: &Bus, rules: impl Into<Rules>) -> Result<(), String> {
    let held = catch_unwind(AssertUnwindSafe(|| assert_bus_rules(bus, rules)));
    held.map_err(|panic| match panic.downcast::<String>() {
        Ok(text) => *text,
        Err(_) => String::new(),
    })
}

/// A node that sends at 10 ms, after a host has sent these characters: the first at 1 ms.
fn run(symbols: &[(&str, u32)], line: Line, heard: impl IntoIterator<Item = Tx>) -> Bus {
    let (mut bus, _, host) = multidrop_testkit::assembler::one("violates", symbols, line);
    bus.run_for(Time::from_ms(1));
    bus.host(host).send_each(heard);
    bus.run_for(Time::from_ms(19));
    bus
}

#[track_caller]
fn told(bus: &Bus, rules: impl Into<Rules>, what: &str) {
    let said = verdict(bus, rules).expect_err("a rule was broken");
    assert!(said.contains(what), "{what}: {said}");
}

/// A frame whose last character ends at 1 ms and 8 characters.
fn frame() -> Vec<Tx> {
    (1..=8).map(Tx::byte).collect()
}

#[test]
fn a_node_that_keeps_the_rules_passes() {
    for heard in [vec![], frame()] {
        let bus = run(&[], LINE, heard);
        assert_eq!(verdict(&bus, LINE), Ok(()));
    }
}

#[test]
fn a_driver_that_is_on_too_long_or_too_short_is_reported() {
    // A bit is 416 cycles: four of these waits in 16 cycles.
    for (symbols, what) in [
        (("LEAD", 150), "DE up too early"),
        (("GAP", 2700), "idle time between characters"),
        (("LAG", 60), "DE down too late"),
        (("MODE", 1), "DE down too early"),
        (("MODE", 2), "a character without DE"),
        (("MODE", 3), "drove without a character"),
        (("MODE", 4), "ran wild"),
    ] {
        told(&run(&[symbols], LINE, []), LINE, what);
    }
}

#[test]
fn an_answer_before_t3_5_is_reported_to_the_microsecond() {
    let bus = run(&[], LINE, []);
    let began = bus.record().bytes()[0].start;
    // The last character ends so long before the answer begins.
    for (before, early) in [(1_749, true), (1_751, false)] {
        let begins = began - Time::from_us(before) - LINE.character();
        let (mut bus, _, host) = multidrop_testkit::assembler::one("violates", &[], LINE);
        bus.run_to(begins);
        bus.host(host).send_each([Tx::byte(1)]);
        bus.run_to(Time::from_ms(20));
        let heard = bus.record().sent_by(Station::Host(host)).next();
        assert_eq!(
            heard.map(|byte| byte.end),
            Some(began - Time::from_us(before))
        );
        match early {
            true => told(&bus, LINE, "an answer before t3.5"),
            false => assert_eq!(verdict(&bus, LINE), Ok(())),
        }
    }
}

#[test]
fn two_senders_at_once_are_reported() {
    let began = run(&[], LINE, []).record().bytes()[0].start;
    let (mut bus, _, host) = multidrop_testkit::assembler::one("violates", &[], LINE);
    bus.run_to(began);
    bus.host(host).send_each([Tx::byte(0xF0)]);
    bus.run_to(Time::from_ms(20));
    told(&bus, LINE, "two drivers disagreed");
}

#[test]
fn an_answer_to_a_frame_with_a_gap_or_a_bad_character_is_reported() {
    let with = |place: usize, wrong: fn(Tx) -> Tx| {
        let mut heard = frame();
        heard[place] = wrong(heard[place]);
        run(&[], LINE, heard)
    };
    let gap: fn(Tx) -> Tx = |one| one.after(Time::from_us(790));
    for place in 1..8 {
        told(&with(place, gap), LINE, "a frame with a gap");
    }
    let short: fn(Tx) -> Tx = |one| one.after(Time::from_us(750));
    assert_eq!(verdict(&with(4, short), LINE), Ok(()));
    for place in 0..8 {
        told(&with(place, Tx::bad_stop), LINE, "a damaged frame");
    }
    // What is apart by t3.5 is another frame, and its faults are its own.
    let apart: fn(Tx) -> Tx = |one| one.after(Time::from_us(1_760));
    let mut heard = frame();
    heard[2] = heard[2].bad_stop();
    heard[4] = apart(heard[4]);
    assert_eq!(verdict(&run(&[], LINE, heard), LINE), Ok(()));
    // A client asks whatever it has heard, and ASCII has a second between characters.
    assert_eq!(verdict(&with(4, gap), Rules::client(LINE)), Ok(()));
    assert_eq!(verdict(&with(4, gap), Rules::ascii(LINE)), Ok(()));
}

#[test]
fn characters_of_another_format_or_rate_are_reported() {
    let even = Line {
        format: Format::E81,
        ..LINE
    };
    // 8E1 where 8N1 is spoken, and the other way round; 35700 baud.
    told(&run(&[("UCSRC", 0x26)], LINE, []), LINE, "another length");
    told(&run(&[], even, []), even, "another length");
    told(&run(&[("UBRR", 27)], LINE, []), LINE, "another length");
    assert_eq!(verdict(&run(&[("UCSRC", 0x26)], even, []), even), Ok(()));
    // Odd parity is as long as even.
    let odd = run(&[("UCSRC", 0x36)], even, []);
    told(&odd, even, "another format");
    told(&odd, Rules::client(even), "another format");
    // Two stop bits are as long as one with a parity bit, of which 1 has a low one by odd parity.
    let two = Line {
        format: Format::N82,
        ..LINE
    };
    told(&odd, two, "another format");
}

#[test]
fn an_answer_to_a_frame_with_wrong_parity_is_reported() {
    for (format, ucsrc) in [(Format::E81, 0x26), (Format::O81, 0x36)] {
        let line = Line { format, ..LINE };
        let symbols = [("UCSRC", ucsrc)];
        assert_eq!(verdict(&run(&symbols, line, frame()), line), Ok(()));
        for place in 0..8 {
            for wrong in [Tx::bad_parity, |one: Tx| one.flip_bit(3)] {
                let mut heard = frame();
                heard[place] = wrong(heard[place]);
                told(&run(&symbols, line, heard), line, "a damaged frame");
            }
            // Two bits do not change parity: this is for the CRC.
            let mut heard = frame();
            heard[place] = heard[place].flip_bit(3).flip_bit(4);
            assert_eq!(verdict(&run(&symbols, line, heard), line), Ok(()));
        }
    }
}
