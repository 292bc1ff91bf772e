//! Silences: t1.5 and t3.5 at their limits, at four baud rates and two formats, against the firmware in the
//! simulator.

use multidrop_bus::{Bus, Line, Time, Tx};
use multidrop_testkit::frames::{block, data, exception, words};
use multidrop_testkit::rig::ALIVE;
use multidrop_testkit::{Rig, lines};

/// Runs `test` with a node of 16 items for each line.
fn on_each_line(test: impl Fn(&mut Rig)) {
    for line in lines() {
        let mut rig = Rig::registers(16, line);
        test(&mut rig);
        rig.expect_alive();
    }
}

fn named(line: Line) -> String {
    format!("at {} {}", line.baud, line.format)
}

/// Gaps inside a frame that are too long and do not end it, in order.
fn gaps_too_long(line: Line) -> Vec<Time> {
    let mut gaps = vec![line.t15() * 11 / 10];
    gaps.extend([200, 250, 300].map(|percent| line.t35() * percent / 350));
    // What begins in the last 1/24 of t3.5 begins a new frame, since two clocks measure it.
    gaps.push(line.t35() * 95 / 100);
    gaps
}

/// Pieces, each without a gap inside, with these pauses between them.
fn pieces(pieces: &[&[u8]], pause: Time) -> Vec<Tx> {
    let mut characters = Vec::new();
    for (index, piece) in pieces.iter().enumerate() {
        let before = if index == 0 { Time::ZERO } else { pause };
        for (at, byte) in piece.iter().enumerate() {
            let gap = if at == 0 { before } else { Time::ZERO };
            characters.push(Tx::byte(*byte).after(gap));
        }
    }
    characters
}

#[test]
fn a_gap_of_0_9_t15_anywhere_is_part_of_the_frame() {
    on_each_line(|rig| {
        let legal = rig.line.t15() * 9 / 10;
        let write = words(1, 6, 3, 0x1234);
        for at in 1..write.len() {
            let (head, tail) = write.split_at(at);
            let heard = rig.ask_each(pieces(&[head, tail], legal));
            assert_eq!(heard, write, "{} before byte {at}", named(rig.line));
        }
        let each: Vec<&[u8]> = write.chunks(1).collect();
        let heard = rig.ask_each(pieces(&each, legal));
        assert_eq!(heard, write, "{} everywhere", named(rig.line));
        // A character that comes within t1.5 of a whole request belongs to it.
        let heard = rig.ask_each(pieces(&[&words(1, 6, 3, 0x5555), &[0]], legal));
        assert_eq!(heard, exception(1, 6, 3), "{}", named(rig.line));
        let heard = rig.ask_each(pieces(&[&words(1, 6, 3, 0x5555), &[0xa5]], legal));
        assert_eq!(heard, [], "{}", named(rig.line));
        rig.expect(&words(1, 3, 3, 1), &data(1, 3, &[0x12, 0x34]));
    });
}

#[test]
fn a_gap_over_t15_inside_a_frame_drops_it() {
    on_each_line(|rig| {
        let before = rig.state(16);
        let write = words(1, 6, 3, 0x1234);
        for gap in gaps_too_long(rig.line) {
            for at in 1..write.len() {
                let (head, tail) = write.split_at(at);
                let heard = rig.ask_each(pieces(&[head, tail], gap));
                assert_eq!(heard, [], "{gap} before byte {at} {}", named(rig.line));
            }
        }
        assert_eq!(rig.state(16), before);
    });
}

#[test]
fn a_late_character_voids_a_whole_request_and_is_not_talked_over() {
    on_each_line(|rig| {
        let before = rig.state(16);
        let requests = [
            words(1, 6, 3, 0x1234),
            words(1, 5, 3, 0xff00),
            block(1, 0x10, 0, 16, &[0x5a; 32]),
            words(1, 3, 0, 16),
            words(1, 0x63, 0, 0),
        ];
        for gap in gaps_too_long(rig.line) {
            for request in &requests {
                for late in [0x00, 0x01, 0x55, 0xff] {
                    let heard = rig.ask_each(pieces(&[request, &[late]], gap));
                    assert_eq!(heard, [], "{late:02x} after {gap} {}", named(rig.line));
                }
                // What comes late may be a request itself: all of it is one bad frame.
                let heard = rig.ask_each(pieces(&[request, &ALIVE.request()], gap));
                assert_eq!(heard, [], "a request after {gap} {}", named(rig.line));
            }
            let heard = rig.ask_each(pieces(&[&[0x55], &requests[0]], gap));
            assert_eq!(heard, [], "{gap} before a request {}", named(rig.line));
        }
        assert_eq!(rig.state(16), before);
    });
}

#[test]
fn silence_after_a_bad_frame_makes_the_next_one_good() {
    on_each_line(|rig| {
        let write = words(1, 6, 3, 0x1234);
        for gap in gaps_too_long(rig.line) {
            let mut characters = pieces(&[&write, &[0x55]], gap);
            let silence = rig.line.t35() * 105 / 100;
            characters.extend(pieces(&[&[], &ALIVE.request()], silence));
            let heard = rig.ask_each(characters);
            assert_eq!(heard, ALIVE.answer(), "{gap} {}", named(rig.line));
        }
        rig.expect(&words(1, 3, 3, 1), &data(1, 3, &[0, 0]));
    });
}

#[test]
fn frames_1_05_t35_apart_are_two() {
    on_each_line(|rig| {
        let silence = rig.line.t35() * 105 / 100;
        for foreign in [words(2, 3, 0, 1), data(2, 3, &[1, 2]), words(0, 6, 5, 7)] {
            let heard = rig.ask_each(pieces(&[&foreign, &ALIVE.request()], silence));
            assert_eq!(heard, ALIVE.answer(), "{foreign:02x?} {}", named(rig.line));
        }
        rig.expect(&words(1, 3, 5, 1), &data(1, 3, &[0, 7]));
    });
}

#[test]
fn a_request_t35_after_a_neighbours_exchange_is_answered() {
    // SER 2.5.1.1: frames are apart by at least 3.5 characters. So this is legal, to the picosecond.
    on_each_line(|rig| {
        let silence = rig.line.t35();
        let frames = [words(2, 3, 0, 1), data(2, 3, &[1, 2]), ALIVE.request()];
        let heard = rig.ask_each(pieces(&[&frames[0], &frames[1], &frames[2]], silence));
        assert_eq!(heard, ALIVE.answer(), "{}", named(rig.line));
    });
}

#[test]
fn a_request_t35_after_our_own_answer_is_answered() {
    on_each_line(|rig| {
        let (host, count) = (rig.host, ALIVE.answer().len());
        for percent in [100, 101, 105, 150, 350] {
            rig.bus.host(host).take();
            rig.bus.host(host).send(&ALIVE.request());
            let answered = |bus: &mut Bus| bus.host(host).heard().len() == count;
            assert!(rig.bus.run_until(answered, Time::from_s(1)));
            // Heard in the middle of the last stop bit; sent to its end.
            rig.bus.run_for(rig.line.bits(1));
            let last = rig.bus.record().bytes().last().expect("an answer").end;
            rig.bus.run_to(last + rig.line.t35() * percent / 100);
            let heard = rig.ask_each(ALIVE.request().into_iter().map(Tx::byte));
            assert_eq!(heard, ALIVE.answer(), "{percent} % {}", named(rig.line));
        }
    });
}

#[test]
fn answers_begin_at_t35_and_soon_after() {
    for line in lines().filter(|line| line.baud > 19_200) {
        let mut rig = Rig::registers(128, line);
        let mut spread = |request: &[u8], limit: Time| {
            let (mut least, mut most) = (Time::NEVER, Time::ZERO);
            for index in 0..40 {
                // Another phase of the node's clocks each time.
                rig.pause(Time::from_ns(313 * index));
                let answer = rig.exchange(request).expect("an answer");
                assert!(answer.turnaround() >= line.t35(), "{}", named(line));
                let beyond = answer.turnaround() - line.t35();
                (least, most) = (least.min(beyond), most.max(beyond));
            }
            assert!(most <= limit, "{most} {} {request:02x?}", named(line));
            assert!(most - least <= Time::from_us(20), "{least} to {most}");
        };
        let short = Time::from_us(120);
        spread(&words(1, 3, 0, 1), short);
        spread(&words(1, 6, 0, 1), short);
        let long = Time::from_us(560);
        spread(&words(1, 3, 0, 16), long);
        spread(&words(1, 3, 0, 125), long);
        spread(&block(1, 0x10, 0, 16, &[0x5a; 32]), long);
        spread(&block(1, 0x10, 0, 123, &[0x5a; 246]), long);
    }
}
