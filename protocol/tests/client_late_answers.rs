//! Late answers without a clock: the requests that must wait for them, the end of a wait, and retries.

use multidrop_protocol::client::{AnswerError, Asking, Event, Failure, LateAnswers, Moment, Next};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::frame::ReceiveErrors;
use proptest::collection::vec;
use proptest::prelude::*;

const TIMEOUT: u32 = 100;
const GUARD: u32 = 60;

fn at(now: u32) -> Moment {
    Moment {
        now,
        timeout: TIMEOUT,
        guard: GUARD,
        gap: 0,
    }
}

/// A request to `unit` that goes out at `now` with this function and is not answered.
fn in_vain(late_answers: &mut LateAnswers, unit: u8, function: u8, now: u32) {
    let mut asking = Asking::new(unit, 0);
    assert_eq!(asking.wait(late_answers, function, now), 0);
    asking.sent(late_answers, function, &at(now));
    assert_eq!(asking.deadline(), now.wrapping_add(TIMEOUT));
    let next = asking.heard(late_answers, Event::Nothing, &at(asking.deadline()));
    assert_eq!(next, Next::Failed(Failure::Timeout));
}

fn answer(unit: u8, function: u8) -> [u8; 4] {
    [unit, function, 1, 0]
}

/// At any time of a clock that wraps.
#[test]
fn only_requests_with_that_unit_and_function_wait_for_the_guard_time() {
    for begin in [
        0,
        1,
        1000,
        u32::MAX - 159,
        u32::MAX - 100,
        u32::MAX / 2 - 130,
    ] {
        let mut late_answers = LateAnswers::new();
        assert!(late_answers.is_empty());
        in_vain(&mut late_answers, 17, 3, begin);
        assert!(!late_answers.is_empty());
        for after in 0..=GUARD {
            let now = begin.wrapping_add(TIMEOUT + after);
            assert_eq!(
                late_answers.wait(17, 3, now),
                GUARD - after,
                "{begin} + {after}"
            );
            if after < GUARD {
                assert_eq!(
                    (late_answers.wait(17, 4, now), late_answers.wait(18, 3, now)),
                    (0, 0)
                );
            }
        }
        assert!(late_answers.is_empty());
    }
}

/// Nobody asks for so long that the clock goes round: no request waits for longer than it would have had to.
#[test]
fn an_expired_late_answer_delays_no_request() {
    let mut late_answers = LateAnswers::new();
    in_vain(&mut late_answers, 17, 3, 0);
    let mut waits = 0;
    for now in (0..=u32::MAX).step_by(4099).skip(1) {
        let mut late_answers = LateAnswers::new();
        in_vain(&mut late_answers, 17, 3, 0);
        let wait = late_answers.wait(17, 3, now.wrapping_add(TIMEOUT + GUARD));
        assert!(wait <= TIMEOUT + GUARD);
        waits += u32::from(wait > 0);
    }
    assert!(waits <= 1);
    assert_eq!(late_answers.wait(17, 3, u32::MAX / 2), 0);
}

#[test]
fn only_the_late_answer_or_its_exception_ends_the_guard_time() {
    for (frame, ends) in [
        (&[17, 3, 2, 0, 0][..], true),
        (&[17, 0x83, 2], true),
        (&[17, 0x83, 6], true),
        (&[17, 0x83, 5], false),
        (&[18, 3, 2, 0, 0], false),
        (&[17, 4, 2, 0, 0], false),
        (&[17], false),
        (&[], false),
    ] {
        let mut late_answers = LateAnswers::new();
        in_vain(&mut late_answers, 17, 3, 0);
        assert_eq!(late_answers.heard(frame, &at(110)), ends, "{frame:02X?}");
        assert_eq!(late_answers.wait(17, 3, 110) == 0, ends, "{frame:02X?}");
        // Heard in the wait for another unit's answer.
        let mut late_answers = LateAnswers::new();
        in_vain(&mut late_answers, 17, 3, 0);
        let mut other = Asking::new(20, 0);
        other.sent(&mut late_answers, 3, &at(110));
        assert_eq!(
            late_answers.is_expected(frame),
            frame.len() > 1 && frame[..2] != [17, 4] && frame[0] != 18
        );
        let judged = Err(AnswerError::Unit(17));
        let next = other.heard(&mut late_answers, Event::Frame(frame, judged), &at(120));
        assert_eq!(next, Next::Wait);
        assert_eq!(late_answers.wait(17, 3, 120) == 0, ends, "{frame:02X?}");
        other.heard(
            &mut late_answers,
            Event::Damaged(ReceiveErrors::CHECK),
            &at(121),
        );
        assert_eq!(late_answers.wait(17, 3, 121) == 0, ends, "{frame:02X?}");
    }
}

#[test]
fn with_four_late_answers_all_other_requests_wait_for_the_first() {
    let mut late_answers = LateAnswers::new();
    for unit in 1..=4 {
        let late = Moment {
            guard: 10_000,
            ..at(u32::from(unit) * 200)
        };
        let mut asking = Asking::new(unit, 0);
        assert_eq!(asking.wait(&mut late_answers, 3, late.now), 0, "{unit}");
        asking.sent(&mut late_answers, 3, &late);
    }
    assert_eq!(late_answers.wait(5, 3, 1000), 10_300 - 1000);
    assert_eq!(late_answers.wait(4, 3, 1000), 10_900 - 1000);
    // One that has its place may be tried again.
    let mut asking = Asking::new(4, 1);
    late_answers.heard(&answer(4, 3), &at(1000));
    assert_eq!(asking.wait(&mut late_answers, 3, 1000), 0);
    asking.sent(&mut late_answers, 3, &at(1000));
    assert_eq!(
        asking.heard(&mut late_answers, Event::Nothing, &at(1100)),
        Next::Again
    );
    assert_eq!(asking.wait(&mut late_answers, 3, 1100), 0);
    assert_eq!(late_answers.wait(5, 3, 1100), GUARD);
}

#[test]
fn an_answer_to_each_try_is_expected_before_another_request() {
    let mut late_answers = LateAnswers::new();
    let mut asking = Asking::new(17, 2);
    for (begin, next) in [(0, Next::Again), (100, Next::Again)] {
        assert_eq!(asking.wait(&mut late_answers, 3, begin), 0);
        asking.sent(&mut late_answers, 3, &at(begin));
        let heard = asking.heard(&mut late_answers, Event::Nothing, &at(begin + 100));
        assert_eq!(heard, next);
    }
    asking.sent(&mut late_answers, 3, &at(200));
    let first = answer(17, 3);
    let next = asking.heard(&mut late_answers, Event::Frame(&first, Ok(())), &at(210));
    assert_eq!(next, Next::Answered);
    // Two more may come.
    for now in [211, 212] {
        assert!(late_answers.wait(17, 3, now) > 0);
        assert!(late_answers.heard(&first, &at(now)));
    }
    assert_eq!(late_answers.wait(17, 3, 213), 0);
    assert!(!late_answers.heard(&first, &at(214)));
}

/// What it owes is another request's by then.
#[test]
fn a_retry_waits_for_late_answers_to_other_requests() {
    let mut late_answers = LateAnswers::new();
    let mut first = Asking::new(17, 1);
    first.sent(&mut late_answers, 3, &at(0));
    assert_eq!(
        first.heard(&mut late_answers, Event::Nothing, &at(100)),
        Next::Again
    );
    assert!(late_answers.heard(&answer(17, 3), &at(110)));
    in_vain(&mut late_answers, 17, 3, 120);
    assert_eq!(first.wait(&mut late_answers, 3, 220), GUARD);
}

#[test]
fn exception_05_extends_the_wait_once_and_06_is_tried_later() {
    let refused = |exception| Err(AnswerError::Exception(exception));
    let accepted = Event::Frame(&[17, 0x83, 5], refused(Exception::Acknowledge));
    let failed = Next::Failed(Failure::Answer(AnswerError::Exception(
        Exception::Acknowledge,
    )));
    let mut late_answers = LateAnswers::new();
    let mut asking = Asking::new(17, 3);
    asking.sent(&mut late_answers, 3, &at(0));
    assert_eq!(
        asking.heard(&mut late_answers, accepted, &at(90)),
        Next::Wait
    );
    assert_eq!(asking.deadline(), 190);
    let damaged = Event::Damaged(ReceiveErrors::CHECK);
    assert_eq!(
        asking.heard(&mut late_answers, damaged, &at(100)),
        Next::Wait
    );
    assert_eq!(
        asking.heard(&mut late_answers, Event::Nothing, &at(190)),
        failed
    );
    // It will answer later.
    assert_eq!(late_answers.wait(17, 3, 190), GUARD);

    let busy = Event::Frame(&[17, 0x83, 6], refused(Exception::ServerDeviceBusy));
    let mut late_answers = LateAnswers::new();
    let mut asking = Asking::new(17, 1);
    asking.sent(&mut late_answers, 3, &at(0));
    assert_eq!(asking.heard(&mut late_answers, busy, &at(10)), Next::Later);
    assert!(late_answers.is_empty());
    asking.sent(&mut late_answers, 3, &at(110));
    let failed = Next::Failed(Failure::Answer(AnswerError::Exception(
        Exception::ServerDeviceBusy,
    )));
    assert_eq!(asking.heard(&mut late_answers, busy, &at(120)), failed);
}

#[test]
fn the_frame_received_at_the_deadline_is_the_last() {
    let other = Event::Frame(&[18, 3, 2, 0, 0], Err(AnswerError::Unit(18)));
    let mut late_answers = LateAnswers::new();
    let mut asking = Asking::new(17, 0);
    asking.sent(&mut late_answers, 3, &at(0));
    asking.receives_last_frame();
    let next = asking.heard(&mut late_answers, other, &at(130));
    assert_eq!(next, Next::Failed(Failure::Answer(AnswerError::Unit(18))));
    // The guard begins where the wait ended.
    assert_eq!(late_answers.wait(17, 3, 130), GUARD);
}

#[test]
fn a_request_given_up_keeps_the_line_until_its_answer_or_timeout() {
    let mut late_answers = LateAnswers::new();
    let asked = |late_answers: &mut LateAnswers| {
        let mut asking = Asking::new(17, 0);
        asking.sent(late_answers, 3, &at(0));
        asking.given_up(late_answers, 30);
    };
    asked(&mut late_answers);
    assert_eq!(
        (late_answers.wait(18, 4, 30), late_answers.wait(17, 3, 30)),
        (70, 130)
    );
    assert!(late_answers.heard(&answer(17, 3), &at(40)));
    assert_eq!(
        (late_answers.wait(18, 4, 40), late_answers.wait(17, 3, 40)),
        (0, 0)
    );
    asked(&mut late_answers);
    assert_eq!(
        (late_answers.wait(18, 4, 100), late_answers.wait(17, 3, 100)),
        (0, 60)
    );
}

#[test]
fn a_pause_is_for_all_and_no_answer_ends_it() {
    let mut late_answers = LateAnswers::new();
    in_vain(&mut late_answers, 17, 3, 0);
    late_answers.pause(40, 110);
    assert_eq!(
        (late_answers.wait(18, 4, 110), late_answers.wait(17, 3, 110)),
        (40, 50)
    );
    assert!(late_answers.heard(&answer(17, 3), &at(120)));
    assert_eq!(
        (late_answers.wait(18, 4, 120), late_answers.wait(17, 3, 120)),
        (30, 30)
    );
    assert_eq!(late_answers.wait(18, 4, 150), 0);
    // Behind each answer, whoever waits for it.
    let slow = Moment { gap: 25, ..at(200) };
    let mut asking = Asking::new(17, 0);
    asking.sent(&mut late_answers, 3, &slow);
    let frame = answer(17, 3);
    asking.heard(&mut late_answers, Event::Frame(&frame, Ok(())), &slow);
    assert_eq!(late_answers.wait(18, 4, 200), 25);
}

/// A request of somebody, and when its answer comes, if it does: ms behind its last character.
#[derive(Clone, Debug)]
struct Wanted {
    unit: u8,
    function: u8,
    retries: u8,
    /// Of each try.
    delays: Vec<Option<u32>>,
    /// Given up so many ms after it went out.
    given_up: Option<u32>,
}

fn wanted() -> impl Strategy<Value = Wanted> {
    // Within the timeout and the guard, always: behind it is the limit.
    let delay = prop_oneof![1..20_u32, 1..TIMEOUT + GUARD];
    (
        1..4_u8,
        3..5_u8,
        0..3_u8,
        vec(proptest::option::weighted(0.8, delay), 3),
        proptest::option::weighted(0.2, 0..TIMEOUT),
    )
        .prop_map(|(unit, function, retries, delays, given_up)| Wanted {
            unit,
            function,
            retries,
            delays,
            given_up,
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    /// A line with one request after the other, and units that answer late: each answer that is taken is one to that request,
    /// and each request is over at some time.
    #[test]
    fn no_answer_is_ever_taken_for_another_requests(
        all in vec(wanted(), 1..12),
        begin in prop_oneof![Just(0), any::<u32>(), u32::MAX - 500..=u32::MAX],
    ) {
        let mut late_answers = LateAnswers::new();
        // When it comes, of whom, and to which request.
        let mut coming: Vec<(u64, u8, u8, usize)> = Vec::new();
        let mut now = 0_u64;
        let clock = |now: u64| at(begin.wrapping_add(now as u32));
        for (number, wanted) in all.iter().enumerate() {
            let mut asking = Asking::new(wanted.unit, wanted.retries);
            let mut delays = wanted.delays.iter();
            'tries: loop {
                // Nobody waits for what comes until it may go out.
                let mut patience = 0;
                while asking.wait(&mut late_answers, wanted.function, clock(now).now) > 0 {
                    now += 1;
                    patience += 1;
                    prop_assert!(patience <= 3 * (TIMEOUT + GUARD), "it waits for ever");
                    coming.retain(|&(when, unit, function, _)| {
                        if when == now {
                            late_answers.heard(&answer(unit, function), &clock(now));
                        }
                        when > now
                    });
                }
                asking.sent(&mut late_answers, wanted.function, &clock(now));
                let out = now;
                if let Some(delay) = delays.next().expect("a try") {
                    coming.push((now + u64::from(*delay), wanted.unit, wanted.function, number));
                }
                loop {
                    if wanted.given_up.is_some_and(|after| now - out >= u64::from(after)) {
                        asking.given_up(&mut late_answers, clock(now).now);
                        break 'tries;
                    }
                    let mut next = Next::Wait;
                    now += 1;
                    coming.sort_unstable();
                    while next == Next::Wait && coming.first().is_some_and(|first| first.0 <= now) {
                        let (when, unit, function, to) = coming.remove(0);
                        // Two at once are no frames.
                        if when < now {
                            continue;
                        }
                        let frame = answer(unit, function);
                        let judged = if unit != wanted.unit {
                            Err(AnswerError::Unit(unit))
                        } else if function != wanted.function {
                            Err(AnswerError::Function(function))
                        } else {
                            Ok(())
                        };
                        next = asking.heard(&mut late_answers, Event::Frame(&frame, judged), &clock(now));
                        if next == Next::Answered {
                            prop_assert_eq!(to, number, "another request's");
                        }
                    }
                    if next == Next::Wait && clock(now).now == asking.deadline() {
                        next = asking.heard(&mut late_answers, Event::Nothing, &clock(now));
                    }
                    match next {
                        Next::Wait => {}
                        Next::Again => break,
                        _ => break 'tries,
                    }
                }
            }
        }
    }
}
