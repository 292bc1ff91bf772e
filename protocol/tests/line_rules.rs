//! The rules of the line one by one, to the tick.

use multidrop_protocol::frame::ReceiveErrors;
use multidrop_testkit::harness::book::{self, Book, framed};
use multidrop_testkit::harness::bus::Settings;
use multidrop_testkit::harness::judge::Verdict;
use multidrop_testkit::harness::script::{self, Config, Op, Sent, frame};

const CHARACTER: u64 = 100;

/// At 9600 baud or less.
fn slow_baud() -> Settings {
    Settings {
        character: CHARACTER,
        t1_5: 150,
        t3_5: 350,
        early: 0,
        strict: true,
        sees_start_bits: true,
        short_cut: true,
        ready_latency: 0,
    }
}

/// At 115200 baud.
fn fast_baud() -> Settings {
    Settings {
        t1_5: 864,
        t3_5: 2016,
        ..slow_baud()
    }
}

fn every_line() -> Vec<Settings> {
    let mut lines = Vec::new();
    for settings in [slow_baud(), fast_baud()] {
        for sees_start_bits in [true, false] {
            for strict in [true, false] {
                lines.push(Settings {
                    sees_start_bits,
                    strict,
                    ..settings.clone()
                });
            }
        }
    }
    lines
}

/// Both kinds of models, tasks that take no time; the request that [`script::run`] adds is not counted.
fn play(settings: &Settings, latencies: &[u64], ops: &[Op]) -> Verdict {
    let config = Config {
        settings: settings.clone(),
        latencies: latencies.to_vec(),
    };
    let mut verdict = script::run::<false>(&config, ops, &mut Book::new());
    let other = script::run::<true>(&config, ops, &mut Book::new());
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

fn after_silence(settings: &Settings, bytes: &[u8]) -> Vec<Sent> {
    frame(settings.t3_5 + 1, bytes)
}

#[test]
fn a_gap_over_t1_5_voids_the_frame() {
    for settings in every_line() {
        let longest = if settings.strict {
            settings.t1_5
        } else {
            settings.t3_5
        };
        for at in 1..read().len() {
            for (gap, answers) in [(0, 1), (longest - 1, 1), (longest, 1), (longest + 1, 0)] {
                let mut chars = after_silence(&settings, &read());
                chars[at].gap = gap;
                let seen = play(&settings, &[0], &[polite(chars)]);
                assert_eq!(
                    seen.answered, answers,
                    "{gap} before byte {at}: {settings:?}"
                );
            }
        }
    }
}

#[test]
fn frames_over_t3_5_apart_are_two_and_closer_ones_void() {
    let other = framed(&[5, 3, 0, 0, 0, 1]);
    for settings in every_line() {
        for (gap, answers) in [(1, 1), (0, 0), (-1, 0), (-99, 0)] {
            let gap = settings.t3_5.checked_add_signed(gap).unwrap();
            let ops = [
                polite(after_silence(&settings, &other)),
                at_once(frame(gap, &read())),
            ];
            assert_eq!(play(&settings, &[0], &ops).answered, answers, "{gap}");
        }
    }
}

/// By our clock: another's may be a little faster.
#[test]
fn a_request_that_begins_in_the_margin_before_t3_5_is_received_and_not_talked_over() {
    for settings in every_line() {
        let settings = Settings {
            early: settings.t3_5 / 24,
            ..settings
        };
        for (gap, executed) in [
            (settings.t3_5 + 1, 2),
            (settings.t3_5, 2),
            (settings.judged() + 1, 2),
            (settings.judged(), 0),
        ] {
            let broadcast = framed(&[0, 6, 0, 5, 0, 99]);
            let ops = [
                polite(after_silence(&settings, &broadcast)),
                at_once(frame(gap, &write(98))),
            ];
            assert_eq!(play(&settings, &[0], &ops).executed, executed, "{gap}");
            let ops = [
                polite(after_silence(&settings, &read())),
                at_once(frame(gap.min(settings.t3_5), &write(98))),
            ];
            let seen = play(&settings, &[0], &ops);
            assert_eq!(seen.answered, executed / 2, "{gap}");
        }
    }
}

#[test]
fn a_character_before_t3_5_withdraws_the_answer_and_the_write() {
    for settings in every_line() {
        for gap in [settings.t3_5 - CHARACTER, settings.t3_5 - 1, settings.t3_5] {
            for request in [read(), write(77)] {
                let mut chars = after_silence(&settings, &request);
                chars.extend(frame(gap, &[0x55]));
                let seen = play(&settings, &[0], &[polite(chars)]);
                assert_eq!(
                    (seen.good, seen.answered, seen.executed),
                    (0, 0, 0),
                    "{gap}"
                );
            }
        }
    }
}

#[test]
fn traffic_of_neighbours_with_gaps_anywhere_is_not_answered() {
    let exchanges: [(&[u8], &[u8]); 9] = [
        (&[5, 1, 0, 19, 0, 19], &[5, 1, 3, 0xCD, 0x6B, 0x05]),
        (&[5, 2, 0, 196, 0, 22], &[5, 2, 3, 0xAC, 0xDB, 0x35]),
        (&[5, 3, 0, 107, 0, 3], &[5, 3, 6, 2, 0x2B, 0, 0, 0, 0x64]),
        (&[5, 4, 0, 8, 0, 1], &[5, 4, 2, 0, 10]),
        (&[5, 5, 0, 172, 0xFF, 0], &[5, 5, 0, 172, 0xFF, 0]),
        (&[5, 6, 0, 1, 0, 3], &[5, 6, 0, 1, 0, 3]),
        // An answer that looks like a request to us from its third byte on.
        (&[5, 3, 0, 0, 0, 4], &[5, 3, 8, 17, 6, 0, 5, 0, 99, 0, 0]),
        (&[5, 15, 0, 19, 0, 10, 2, 0xCD, 1], &[5, 15, 0, 19, 0, 10]),
        (&[5, 16, 0, 1, 0, 2, 4, 0, 10, 1, 2], &[5, 16, 0, 1, 0, 2]),
    ];
    for settings in [slow_baud(), fast_baud()] {
        for (request, answer) in exchanges {
            let answer = framed(answer);
            for at in 0..answer.len() {
                for gap in [
                    settings.t1_5,
                    settings.t1_5 + 1,
                    settings.t3_5,
                    settings.t3_5 + 1,
                ] {
                    let mut chars = after_silence(&settings, &answer);
                    if at > 0 {
                        chars[at].gap = gap;
                    }
                    let ops = [
                        at_once(after_silence(&settings, &framed(request))),
                        at_once(chars),
                        at_once(after_silence(&settings, &read())),
                    ];
                    assert_eq!(play(&settings, &[0], &ops).answered, 1);
                }
            }
        }
    }
}

#[test]
fn the_longest_frames_and_one_byte_more() {
    for settings in every_line() {
        for (len, good) in [(254, 1), (255, 0)] {
            let mut body = vec![5; len];
            body[1] = 0x50;
            let ops = [polite(after_silence(&settings, &framed(&body)))];
            assert_eq!(play(&settings, &[0], &ops).good, good);
        }
        let mut request = vec![book::UNIT, 16, 0, 3, 0, 123, 246];
        request.extend([0xA5; 246]);
        let ops = [
            polite(after_silence(&settings, &framed(&request))),
            polite(after_silence(
                &settings,
                &framed(&[book::UNIT, 3, 0, 3, 0, 125]),
            )),
        ];
        assert_eq!(play(&settings, &[0], &ops).answered, 2);
    }
}

#[test]
fn a_damaged_character_voids_its_frame_and_no_other() {
    for flaw in [
        ReceiveErrors::PARITY,
        ReceiveErrors::FRAMING,
        ReceiveErrors::OVERRUN,
    ] {
        for at in 0..read().len() {
            let settings = slow_baud();
            let mut chars = after_silence(&settings, &write(7));
            chars[at].errors = flaw;
            let ops = [at_once(chars), at_once(after_silence(&settings, &write(8)))];
            let seen = play(&settings, &[0], &ops);
            assert_eq!((seen.bad, seen.answered), (1, 1));
        }
    }
}

/// The task takes so long that somebody else has asked somebody else meanwhile; what it would say then would be taken for
/// that one's answer.
#[test]
fn an_answer_after_another_frame_is_not_sent() {
    for settings in every_line() {
        let ops = [
            polite(after_silence(&settings, &read())),
            at_once(after_silence(&settings, &framed(&[5, 3, 0, 3, 0, 2]))),
        ];
        let first_frame = 8 * CHARACTER + settings.t3_5;
        let between = first_frame + settings.t3_5 + CHARACTER;
        let seen = play(&settings, &[between], &ops);
        assert_eq!(seen.answered, 0, "{settings:?}");
    }
}

/// Whoever wrote may not have waited for the answer.
#[test]
fn a_write_that_stands_is_executed_even_if_its_answer_is_too_late() {
    for settings in every_line() {
        let ops = [
            polite(after_silence(&settings, &write(55))),
            at_once(after_silence(&settings, &framed(&[5, 3, 0, 3, 0, 2]))),
        ];
        let between = 8 * CHARACTER + 2 * settings.t3_5 + CHARACTER;
        let seen = play(&settings, &[between], &ops);
        assert_eq!((seen.answered, seen.executed), (0, 1), "{settings:?}");
    }
}

#[test]
fn a_slow_task_answers_late_if_the_line_stays_silent() {
    for settings in every_line() {
        for latency in [200, 1000, 100_000] {
            let ops = [polite(after_silence(&settings, &write(3)))];
            let seen = play(&settings, &[latency], &ops);
            assert_eq!((seen.answered, seen.executed), (1, 1));
        }
    }
}

#[test]
fn after_new_settings_at_any_tick_no_earlier_frame_is_answered() {
    for settings in [slow_baud(), fast_baud()] {
        for after in (0..8 * CHARACTER + settings.t3_5).step_by(3) {
            let ops = [
                Op::Reset(settings.t3_5 + 1 + after),
                at_once(after_silence(&settings, &write(9))),
            ];
            let seen = play(&settings, &[0], &ops);
            assert_eq!((seen.answered, seen.executed), (0, 0), "{after}");
        }
        // The answer is ready after the line listens again.
        let ops = [
            at_once(after_silence(&settings, &read())),
            Op::Reset(settings.t3_5 + 1),
        ];
        let seen = play(&settings, &[5000], &ops);
        assert_eq!((seen.good, seen.answered), (1, 0));
    }
}

#[test]
fn the_line_works_after_a_task_was_dropped_at_any_tick() {
    for ready_latency in [0, 130] {
        let settings = Settings {
            ready_latency,
            ..slow_baud()
        };
        for after in (0..25 * CHARACTER).step_by(3) {
            let ops = [
                Op::Cancel(settings.t3_5 + 1 + after),
                at_once(after_silence(&settings, &read())),
                polite(after_silence(&settings, &write(4))),
            ];
            play(&settings, &[0], &ops);
        }
    }
}

#[test]
fn an_edge_without_a_character_costs_at_most_the_time_of_one() {
    let lines = every_line().into_iter().filter(|it| it.sees_start_bits);
    let judged_early = lines.clone().map(|settings| Settings {
        early: settings.t3_5 / 24,
        ..settings
    });
    for settings in lines.chain(judged_early) {
        let end = settings.t3_5 + 1 + 8 * CHARACTER;
        for after in (1..settings.t3_5 + CHARACTER).step_by(7) {
            let ops = [
                Op::Glitch(end + after),
                at_once(after_silence(&settings, &read())),
            ];
            let seen = play(&settings, &[0], &ops);
            assert_eq!(seen.answered, 1, "{after}");
            // Before t1.5 the wait for a character is over long before t3.5.
            let costs = if settings.strict && after <= settings.t1_5 {
                0
            } else {
                CHARACTER
            };
            assert!(seen.latest <= costs, "{after}: {seen:?}");
        }
    }
}
