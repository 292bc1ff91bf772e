//! The router of `ports`, from AS1 and AS2 to units on RS4 that are slow, late or missing, for clients that do not
//! wait. The poll list sends requests on RS4 all the time. The units are a host that answers by a script.

mod routes;

use std::cell::{Cell, RefCell};

use multidrop_bus::Time;
use multidrop_testkit::four::units::asked;
use multidrop_testkit::plain::wire::Way;
use multidrop_testkit::{Runner, on_both};
use routes::{FAST, ROUTED, at_once, body, exception, expect, first, health, played, read, values};

on_both! {
    a_slow_unit_is_waited_for,
    a_missing_unit_is_told_in_time_and_keeps_nobody,
    an_answer_that_comes_in_the_wait_for_another_is_dropped_if_it_can_be_told_from_it,
    an_answer_behind_its_time_is_dropped_while_nobody_waits_or_a_poll_does,
    a_late_answer_never_becomes_the_value_of_another_register,
    a_long_answer_is_heard_to_its_end,
    what_is_too_long_for_an_answer_is_not_heard_to_its_end,
}

fn a_slow_unit_is_waited_for(runner: Runner) {
    // Its answer is over 46 ms after the request, and 50 ms is the route's time.
    let slow = Time::from_ms(44);
    let mut played = played(runner, |request| {
        let delay = if request[0] == 1 { slow } else { FAST };
        vec![(delay, values(request, 0))]
    });
    for round in 0..10 {
        let request = read(1, ROUTED + round, 2);
        let told = expect(&mut played, Way::Rtu, &request, &values(&request, 0));
        // Behind a poll of this unit and one of another at most.
        assert!(told.turnaround > slow && told.turnaround < slow * 2 + Time::from_ms(20));
        let request = read(11, ROUTED + round, 2);
        let mut answer = values(&read(1, ROUTED + round, 2), 0);
        answer[0] = 11;
        expect(&mut played, Way::Ascii, &request, &answer);
        let request = read(2, ROUTED, 1);
        expect(&mut played, Way::Rtu, &request, &values(&request, 0));
    }
    let (good, bad) = health(&mut played);
    assert!(good.iter().all(|count| *count > 8), "{good:?}");
    assert_eq!(bad, [0; 3]);
    let asked = asked(&played.desk);
    let (_, before) = asked.split_last().expect("requests");
    assert!(before.iter().all(|asked| asked.answered.is_some()));
}

fn a_missing_unit_is_told_in_time_and_keeps_nobody(runner: Runner) {
    let mut played = played(runner, |request| match request[0] {
        1 => Vec::new(),
        _ => at_once(values(request, 0)),
    });
    for round in 0..10 {
        let request = read(1, ROUTED, 1);
        let told = expect(&mut played, Way::Rtu, &request, &exception(&request, 0x0B));
        // Behind a poll of this unit, the guard behind that, and polls of the other two.
        assert!(told.turnaround < Time::from_ms(175), "{}", told.turnaround);
        let request = read(11, ROUTED, 1);
        let answer = exception(&request, 0x0B);
        expect(&mut played, Way::Ascii, &request, &answer);
        let request = read(3, ROUTED + round, 4);
        expect(&mut played, Way::Rtu, &request, &values(&request, 0));
    }
    let (good, bad) = health(&mut played);
    assert_eq!((good[0], bad[1], bad[2]), (0, 0, 0));
    for asked in asked(&played.desk) {
        assert_eq!(asked.answered.is_some(), asked.body[0] != 1);
    }
}

/// Unit 1 does not answer the first request, but answers it in the middle of the wait for the second one, and that one
/// behind it. Returns what the PC is told of both.
fn late(runner: Runner, first_asked: &[u8], second_asked: &[u8]) -> [Vec<u8>; 2] {
    let missing = RefCell::new(Vec::new());
    let mut played = played(runner, |request| {
        let right = values(request, if first(request) < ROUTED { 0 } else { 2 });
        if first(request) < ROUTED {
            return at_once(right);
        }
        let mut missing = missing.borrow_mut();
        if missing.is_empty() {
            missing.extend(values(request, 1));
            return Vec::new();
        }
        vec![(FAST, missing.clone()), (FAST * 4, right)]
    });
    // Polls are answered before, between and behind.
    played.run_for(Time::from_ms(150), |_| ());
    let told = [first_asked, second_asked].map(|request| {
        let told = played.ask(Way::Rtu, request);
        played.run_for(Time::from_ms(150), |_| ());
        told.body
    });
    let (good, bad) = health(&mut played);
    assert!(good.iter().all(|count| *count > 4), "{good:?}");
    assert_eq!(bad, [0; 3]);
    // What is kept of the polls is nothing else.
    let polled = played.ask(Way::Rtu, &body(10, 4, 0, 3)).body;
    let expected = [1, 2, 3].map(|unit| values(&read(unit, 0, 1), 0)[3..].to_vec());
    assert_eq!(polled[3..], expected.concat());
    asked(&played.desk);
    told
}

fn an_answer_that_comes_in_the_wait_for_another_is_dropped_if_it_can_be_told_from_it(
    runner: Runner,
) {
    let first = read(1, ROUTED, 2);
    let write = |value| body(1, 6, ROUTED, value);
    for (first, second) in [
        // Another unit, another function, another length, another value.
        (first.clone(), read(2, ROUTED, 2)),
        (first.clone(), body(1, 4, ROUTED, 2)),
        (first.clone(), read(1, ROUTED, 3)),
        (write(7), write(8)),
    ] {
        let told = late(runner, &first, &second);
        assert_eq!(told[0], exception(&first, 0x0B));
        assert_eq!(told[1], values(&second, 2), "{second:02x?}");
    }
    // Nothing in a Modbus frame says which of two such requests it answers, and the guard is over.
    let told = late(runner, &first, &read(1, ROUTED + 1, 2));
    assert_eq!(told, [exception(&first, 0x0B), values(&first, 1)]);
}

fn an_answer_behind_its_time_is_dropped_while_nobody_waits_or_a_poll_does(runner: Runner) {
    let delay = Cell::new(Time::ZERO);
    let mut played = played(runner, |request| match first(request) {
        ROUTED => vec![(delay.get(), values(request, 1))],
        _ => at_once(values(request, 0)),
    });
    for ms in [53, 58, 63, 71, 80] {
        delay.set(Time::from_ms(ms));
        let request = read(1, ROUTED, 2);
        expect(&mut played, Way::Rtu, &request, &exception(&request, 0x0B));
        let request = read(1, ROUTED + 1, 3);
        expect(&mut played, Way::Rtu, &request, &values(&request, 0));
        played.run_for(Time::from_ms(137), |_| ());
        let request = read(2, ROUTED + 1, 2);
        expect(&mut played, Way::Rtu, &request, &values(&request, 0));
    }
    let (_, bad) = health(&mut played);
    assert_eq!(bad, [0; 3]);
    asked(&played.desk);
}

/// Unit 1 answers what is routed to it behind RS4's time, in the same shape as the polls of its register 0.
fn a_late_answer_never_becomes_the_value_of_another_register(runner: Runner) {
    let delay = Cell::new(Time::ZERO);
    let mut played = played(runner, |request| match first(request) {
        0 => at_once(values(request, 0)),
        _ => vec![(delay.get(), values(request, 1))],
    });
    let polled = values(&read(1, 0, 1), 0)[3..].to_vec();
    for ms in [52, 57, 63, 70, 78, 88, 95] {
        delay.set(Time::from_ms(ms));
        let request = read(1, ROUTED, 1);
        expect(&mut played, Way::Rtu, &request, &exception(&request, 0x0B));
        for _ in 0..12 {
            played.run_for(Time::from_ms(10), |_| ());
            let told = played.ask(Way::Rtu, &body(10, 4, 0, 1)).body;
            assert_eq!(told[3..], polled, "answered after {ms} ms");
        }
    }
    let (good, bad) = health(&mut played);
    assert!(good.iter().all(|count| *count > 8), "{good:?}");
    assert_eq!(bad, [0; 3]);
    asked(&played.desk);
}

/// 255 characters take 66 ms, and RS4 waits for 50 ms for the first of them.
fn a_long_answer_is_heard_to_its_end(runner: Runner) {
    let mut played = played(runner, |request| at_once(values(request, 0)));
    for count in [87, 88, 125] {
        let request = read(2, ROUTED, count);
        expect(&mut played, Way::Rtu, &request, &values(&request, 0));
    }
    let (_, bad) = health(&mut played);
    assert_eq!(bad, [0; 3]);
    asked(&played.desk);
}

/// It begins in time, has its 257th character after 112 ms, and ends after 150.
fn what_is_too_long_for_an_answer_is_not_heard_to_its_end(runner: Runner) {
    let mut played = played(runner, |request| match first(request) {
        ROUTED => vec![(Time::from_ms(45), [&request[..1], &[3; 400]].concat())],
        _ => at_once(values(request, 0)),
    });
    let request = read(2, ROUTED, 1);
    let told = expect(&mut played, Way::Rtu, &request, &exception(&request, 0x0B));
    // Behind polls of the other two.
    let expected = Time::from_ms(110)..Time::from_ms(140);
    assert!(expected.contains(&told.turnaround), "{}", told.turnaround);
}
