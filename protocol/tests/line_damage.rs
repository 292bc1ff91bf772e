//! Each damaged frame is reported once, since the counters of the standard depend on it.

use multidrop_protocol::frame::ReceiveErrors;
use multidrop_testkit::harness::book::framed;
use multidrop_testkit::harness::bus::{Bus, Char, Settings};

const CHARACTER: u64 = 100;
const T1_5: u64 = 150;
const T3_5: u64 = 350;

fn bus(sees_start_bits: bool) -> Bus {
    let mut bus = Bus::new(Settings {
        character: CHARACTER,
        t1_5: T1_5,
        t3_5: T3_5,
        early: 2,
        strict: true,
        sees_start_bits,
        short_cut: true,
        ready_latency: 0,
    });
    bus.pass(1000);
    bus
}

/// These bytes after a silence, with `gap` before the one at `at`.
fn say(bus: &mut Bus, bytes: &[u8], gap: Option<(usize, u64)>) {
    let mut start = bus.last_end().max(bus.chip.now) + 2 * T3_5;
    for (index, &byte) in bytes.iter().enumerate() {
        if let Some((at, gap)) = gap
            && at == index
        {
            start += gap;
        }
        bus.chip.chars.push(Char {
            start,
            byte,
            errors: ReceiveErrors::NONE,
        });
        start += CHARACTER;
    }
    let rest = bus.last_end() + 2 * T3_5;
    bus.pass(rest);
}

fn request() -> Vec<u8> {
    framed(&[17, 3, 0, 0, 0, 1])
}

fn wrong_crc() -> Vec<u8> {
    let mut bytes = request();
    bytes[7] ^= 1;
    bytes
}

/// What is there to fetch; a good frame is given back.
fn fetch_all(bus: &mut Bus) -> Vec<Option<ReceiveErrors>> {
    let mut told = Vec::new();
    while let Some(fetched) = bus.fetch() {
        if fetched.is_ok() {
            bus.give_back();
        }
        told.push(fetched.err());
    }
    told
}

#[test]
fn a_late_character_is_reported_as_a_gap_anywhere() {
    for sees_start_bits in [true, false] {
        for at in 1..request().len() {
            for gap in [T1_5 + 1, 2 * CHARACTER, T3_5 - 2] {
                let mut bus = bus(sees_start_bits);
                say(&mut bus, &request(), Some((at, gap)));
                let told = fetch_all(&mut bus);
                assert_eq!(told.len(), 1, "{at} {gap}: {told:?}");
                let errors = told[0].expect("a damaged frame");
                assert!(
                    errors.contains(ReceiveErrors::GAP),
                    "{at} {gap}: {errors:?}"
                );
            }
        }
    }
}

/// Nothing else is wrong with it: what came before the gap was a whole good frame, and was lent, or is gone already.
#[test]
fn a_character_behind_a_good_frame_is_a_gap_and_nothing_else() {
    for (fetched, given_back) in [(false, false), (true, false), (true, true)] {
        let mut bus = bus(true);
        let start = bus.chip.now + 2 * T3_5;
        for (index, &byte) in request().iter().enumerate() {
            let start = start + index as u64 * CHARACTER;
            let errors = ReceiveErrors::NONE;
            bus.chip.chars.push(Char {
                start,
                byte,
                errors,
            });
        }
        let end = bus.last_end();
        bus.chip.chars.push(Char {
            start: end + 2 * CHARACTER,
            byte: 0x55,
            errors: ReceiveErrors::NONE,
        });
        bus.pass(end + T1_5 + 20);
        if fetched {
            assert_eq!(bus.fetch(), Some(Ok(6)));
        }
        if given_back {
            bus.give_back();
        }
        bus.pass(end + 10 * CHARACTER);
        assert!(bus.chip.receiver_woken);
        assert_eq!(bus.fetch(), Some(Err(ReceiveErrors::GAP)));
        if fetched && !given_back {
            assert_eq!(bus.machine.verdict(), Some(false));
        } else if !fetched {
            assert_eq!(bus.fetch(), Some(Ok(6)));
            assert_eq!(bus.machine.verdict(), Some(false));
        }
        assert_eq!(bus.fetch(), None);
    }
}

#[test]
fn damaged_frames_not_yet_read_are_reported_one_by_one_with_all_errors() {
    for count in [1, 2, 3, 254, 255] {
        let mut bus = bus(true);
        for _ in 1..count {
            say(&mut bus, &wrong_crc(), None);
        }
        say(&mut bus, &[17], None);
        let told = fetch_all(&mut bus);
        assert_eq!(told.len(), count);
        let last = ReceiveErrors::CHECK | ReceiveErrors::LENGTH;
        assert!(told.iter().all(|told| *told == Some(last)), "{told:?}");
        assert_eq!(bus.fetch(), None);
        say(&mut bus, &wrong_crc(), None);
        assert_eq!(fetch_all(&mut bus), [Some(ReceiveErrors::CHECK)]);
    }
}

#[test]
fn the_count_of_damaged_frames_stops_at_255() {
    let mut bus = bus(true);
    for _ in 0..300 {
        say(&mut bus, &wrong_crc(), None);
    }
    assert_eq!(fetch_all(&mut bus).len(), 255);
}

/// One that asks how many there were counts those before it.
#[test]
fn damaged_frames_are_reported_before_a_good_one() {
    let mut bus = bus(true);
    say(&mut bus, &wrong_crc(), None);
    say(&mut bus, &wrong_crc(), None);
    say(&mut bus, &request(), None);
    let wrong = Some(ReceiveErrors::CHECK);
    assert_eq!(fetch_all(&mut bus), [wrong, wrong, None]);
}

#[test]
fn a_frame_received_while_the_buffer_is_lent_is_reported_as_lost() {
    let mut bus = bus(true);
    say(&mut bus, &request(), None);
    assert_eq!(bus.fetch(), Some(Ok(6)));
    for _ in 0..2 {
        say(&mut bus, &request(), None);
    }
    let lost = Some(Err(ReceiveErrors::OVERRUN));
    assert_eq!([bus.fetch(), bus.fetch(), bus.fetch()], [lost, lost, None]);
}
