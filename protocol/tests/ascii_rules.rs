//! The rules of an ASCII line one by one, to the tick.

use multidrop_protocol::frame::ReceiveErrors;
use multidrop_testkit::harness::ascii::{self, framed};
use multidrop_testkit::harness::book::{self, Book};
use multidrop_testkit::harness::bus::{SECOND, Settings};
use multidrop_testkit::harness::judge::Verdict;
use multidrop_testkit::harness::script::{Config, Op, Sent, frame};

const CHARACTER: u64 = 100;

fn line() -> Settings {
    Settings {
        character: CHARACTER,
        t1_5: 150,
        t3_5: 350,
        early: 2,
        strict: true,
        sees_start_bits: true,
        short_cut: false,
        ready_latency: 0,
    }
}

/// Both kinds of models, tasks that take so long; the request that the run adds is not counted.
fn play(latencies: &[u64], ops: &[Op]) -> Verdict {
    let config = Config {
        settings: line(),
        latencies: latencies.to_vec(),
    };
    let mut verdict = ascii::run::<false>(&config, ops, &mut Book::new());
    let other = ascii::run::<true>(&config, ops, &mut Book::new());
    assert_eq!(verdict.answered, other.answered);
    verdict.answered -= 1;
    verdict.good -= 1;
    verdict
}

fn polite(chars: Vec<Sent>) -> Op {
    Op::Talk {
        polite: true,
        chars,
    }
}

fn at_once(chars: Vec<Sent>) -> Op {
    Op::Talk {
        polite: false,
        chars,
    }
}

fn read() -> Vec<u8> {
    framed(&[book::UNIT, 3, 0, 3, 0, 2])
}

fn write(value: u8) -> Vec<u8> {
    framed(&[book::UNIT, 6, 0, 5, 0, value])
}

fn counts(seen: Verdict) -> (usize, usize, usize, usize) {
    (seen.good, seen.bad, seen.answered, seen.executed)
}

#[test]
fn a_request_is_answered_at_t3_5_and_a_write_done_before() {
    let seen = play(
        &[0],
        &[polite(frame(9, &read())), polite(frame(9, &write(7)))],
    );
    assert_eq!(counts(seen), (2, 0, 2, 1));
    assert_eq!(seen.latest, 0);
}

#[test]
fn a_gap_of_more_than_a_second_voids_the_frame() {
    for at in 1..read().len() {
        for (gap, good) in [
            (SECOND - 1, 1),
            (SECOND, 1),
            (SECOND + 4, 1),
            (SECOND + 5, 0),
            (2 * SECOND, 0),
        ] {
            let mut chars = frame(9, &read());
            chars[at].gap = gap;
            let seen = play(&[0], &[polite(chars)]);
            assert_eq!(counts(seen), (good, 1 - good, good, 0), "{gap} before {at}");
        }
    }
}

#[test]
fn any_character_damaged_in_any_way_spoils_one_frame_and_no_other() {
    for at in 0..read().len() {
        for flaw in [
            ReceiveErrors::PARITY,
            ReceiveErrors::FRAMING,
            ReceiveErrors::OVERRUN,
        ] {
            let mut chars = frame(9, &read());
            chars[at].errors = flaw;
            let seen = play(&[0], &[at_once(chars), at_once(frame(0, &write(8)))]);
            // Without its `:` it is no frame at all.
            let bad = usize::from(at > 0);
            assert_eq!(counts(seen), (1, bad, 1, 1), "{at} {flaw:?}");
        }
        for byte in 0..=255 {
            let mut chars = frame(9, &read());
            let old = std::mem::replace(&mut chars[at].byte, byte);
            let same = old.eq_ignore_ascii_case(&byte);
            let seen = play(&[0], &[at_once(chars), polite(frame(0, &write(8)))]);
            // One that turns into `:` leaves the rest of a frame, too short or with a wrong LRC.
            let good = 1 + usize::from(same);
            // In place of LF it is the beginning of one more that does not end.
            let bad = usize::from(!same && at > 0) + usize::from(at == 16 && byte == b':');
            assert_eq!(counts(seen), (good, bad, good, 1), "{at} {byte:02X}");
        }
    }
}

#[test]
fn a_colon_begins_a_new_frame_anywhere() {
    for at in 0..read().len() - 1 {
        let chars = frame(9, &[&read()[..at], &write(1)[..]].concat());
        let seen = play(&[0], &[polite(chars)]);
        assert_eq!(counts(seen), (1, usize::from(at == 16), 1, 1), "{at}");
    }
}

#[test]
fn lower_case_is_read_and_upper_case_sent() {
    let body = [book::UNIT, 16, 0, 5, 0, 1, 2, 0xAB, 0xCD];
    let lower = framed(&body).to_ascii_lowercase();
    assert_eq!(
        counts(play(&[0], &[polite(frame(9, &lower))])),
        (1, 0, 1, 1)
    );
    let seen = play(&[0], &[polite(frame(9, &lower)), polite(frame(9, &read()))]);
    assert_eq!(seen.answered, 2);
}

#[test]
fn characters_outside_of_a_frame_are_not_counted_and_delay_the_answer() {
    for noise in [&b"\n"[..], b"0123\r\n", b"\0\xFF\r\r"] {
        for gap in [0, 99, 349, 350] {
            let ops = [at_once(frame(9, &read())), at_once(frame(gap, noise))];
            let seen = play(&[0], &ops);
            assert_eq!(counts(seen), (1, 0, 1, 0), "{gap} {noise:?}");
            let busy = gap + noise.len() as u64 * CHARACTER;
            assert_eq!(seen.latest, busy, "{gap} {noise:?}");
        }
    }
}

#[test]
fn a_new_request_before_t3_5_withdraws_the_answer_and_is_received() {
    for gap in [0, 1, 349, 350] {
        let ops = [at_once(frame(9, &write(4))), at_once(frame(gap, &write(5)))];
        assert_eq!(counts(play(&[25], &ops)), (2, 0, 1, 2), "{gap}");
    }
}

#[test]
fn frames_of_neighbours_may_follow_without_silence() {
    let other = framed(&[5, 3, 0, 0, 0, 1]);
    let ops: Vec<Op> = (0..9).map(|_| at_once(frame(0, &other))).collect();
    assert_eq!(counts(play(&[25], &ops)), (9, 0, 0, 0));
}

#[test]
fn the_longest_frames_and_one_byte_more() {
    for (len, good) in [(254, 1), (255, 0), (256, 0), (300, 0)] {
        let mut body = vec![5; len];
        body[1] = 0x50;
        let text = framed(&body);
        let seen = play(&[0], &[polite(frame(9, &text))]);
        assert_eq!(counts(seen), (good, 1 - good, 0, 0), "{}", text.len());
    }
    for text in [
        &b":\r\n"[..],
        b":00\r\n",
        b":11EF\r\n",
        b":1103006B00037\r\n",
        b":1103006B00037E0\r\n",
    ] {
        let seen = play(&[0], &[polite(frame(9, text))]);
        assert_eq!(counts(seen), (0, 1, 0, 0), "{text:?}");
    }
    let body = [book::UNIT, 3, 0, 3, 0, 125];
    assert_eq!(play(&[0], &[polite(frame(9, &framed(&body)))]).answered, 1);
}

#[test]
fn a_frame_without_a_free_buffer_is_reported_as_damaged() {
    let other = framed(&[5, 3, 0, 0, 0, 1]);
    let ops = [at_once(frame(9, &read())), at_once(frame(0, &other))];
    // Counted by the judge: each frame is fetched, or told as damaged.
    let seen = play(&[5000], &ops);
    assert_eq!((seen.good, seen.answered), (1, 0));
}

#[test]
fn a_slow_task_answers_late_unless_a_new_request_comes() {
    for latency in [200, 1000, 100_000] {
        for noise in [&b""[..], b"\r\n"] {
            let ops = [polite(frame(9, &write(3))), at_once(frame(360, noise))];
            let seen = play(&[latency], &ops);
            assert_eq!((seen.answered, seen.executed), (1, 1), "{latency}");
        }
    }
}

#[test]
fn an_edge_without_a_character_delays_the_answer_by_one_character() {
    let end = 9 + read().len() as u64 * CHARACTER;
    for after in (1..350).step_by(7) {
        let ops = [Op::Glitch(end + after), at_once(frame(9, &read()))];
        let seen = play(&[0], &ops);
        assert_eq!((seen.answered, seen.latest), (1, CHARACTER), "{after}");
    }
}

#[test]
fn the_line_works_after_new_settings_or_a_dropped_task_at_any_tick() {
    for after in (0..50 * CHARACTER).step_by(3) {
        for op in [Op::Reset(after), Op::Cancel(after)] {
            play(
                &[0],
                &[op, at_once(frame(9, &read())), polite(frame(9, &write(4)))],
            );
        }
    }
}
