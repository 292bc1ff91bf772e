//! Damaged frames between a request that was given up, or timed out, and its late answer: the late answer is still
//! recognised.

mod desk;

use std::cell::RefCell;
use std::rc::Rc;

use desk::{Desk, Heard, Registers, SENDS, read};
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::{ClientConfig, ClientError};

const TIMEOUT: u64 = 60;
const GUARD: u64 = 30;
const CONFIG: ClientConfig = ClientConfig::new()
    .timeout_ms(TIMEOUT as u16)
    .late_guard_ms(GUARD as u16);
const DELAY: u64 = 4;
/// The register that is answered late, and the one that is asked for behind it.
const LATE: u16 = 7;
const NEXT: u16 = 9;

/// What a noisy bus has between a request and its answer: nothing of it is the answer.
fn noise() -> Vec<Heard> {
    vec![
        Heard::Damaged(ReceiveErrors::CHECK),
        Heard::Damaged(ReceiveErrors::GAP | ReceiveErrors::LENGTH),
        Heard::Damaged(ReceiveErrors::OVERRUN),
        // The answer, and a late character behind it.
        Heard::Void(vec![17, 3, 2, 0xDE, 0xAD]),
        Heard::Void(vec![17, 0x83, 2]),
        // Somebody else's.
        Heard::Frame(vec![18, 3, 2, 0xDE, 0xAD]),
        Heard::Frame(vec![17, 4, 2, 0xDE, 0xAD]),
        // Not yet.
        Heard::Frame(vec![17, 0x83, 5]),
        Heard::Talk(3),
        Heard::Long(3, Box::new(Heard::Damaged(ReceiveErrors::CHECK))),
    ]
}

/// A peer that answers by the book, [`LATE`] after `delay`.
fn peer(delay: u64) -> impl FnMut(&[u8]) -> Vec<(u64, Heard)> {
    let mut registers = Registers::default();
    move |request| {
        let is_late = request[..2] == [17, 3] && u16::from(request[3]) == LATE;
        let answer = registers.answer(request).expect("no broadcast");
        let delay = if is_late { delay } else { DELAY };
        vec![(delay, Heard::Frame(answer))]
    }
}

type Place = Rc<RefCell<Vec<Result<u16, ClientError>>>>;

#[test]
fn the_answer_to_a_given_up_request_is_expected_despite_noise() {
    for heard in noise() {
        // In time, behind it, and in the guard.
        for delay in [20, TIMEOUT - 1, TIMEOUT + 1, TIMEOUT + GUARD - 1] {
            for at in [1, 2, 7, 10, 16] {
                // Given up while it is out; the noise comes when the next one waits already, or before that.
                for given_up in [1, 8] {
                    let mut desk = Desk::<2>::new(peer(delay));
                    let client = desk.port.client(CONFIG);
                    let first = desk.spawn(async move {
                        let _ = read(client, 17, LATE).await;
                    });
                    desk.run(SENDS);
                    desk.wire.comes(at, heard.clone());
                    desk.run(given_up);
                    desk.cancel(first);
                    let results = Place::default();
                    let place = results.clone();
                    desk.spawn(async move {
                        let result = read(client, 17, NEXT).await;
                        place.borrow_mut().push(result);
                    });
                    desk.run(SENDS + TIMEOUT + GUARD + 2 * (SENDS + DELAY));
                    assert_eq!(
                        *results.borrow(),
                        [Ok(0x1000 + NEXT)],
                        "{heard:?} {at} ms behind, answered after {delay}, given up after {given_up}"
                    );
                    // It went out when the answer had come, and not before.
                    let sent = desk.wire.sent.borrow();
                    assert!(sent[1].0 > SENDS + delay, "{heard:?}, {at}, {delay}");
                    assert_eq!(sent.len(), 2);
                }
            }
        }
    }
}

#[test]
fn the_answer_to_a_timed_out_request_is_expected_despite_noise() {
    for heard in noise() {
        for late in [3, 10, GUARD - 1] {
            for at in 1..=late.min(8) {
                let mut desk = Desk::<2>::new(peer(TIMEOUT + late));
                let client = desk.port.client(CONFIG);
                assert_eq!(
                    desk.ask(read(client, 17, LATE)).0,
                    Err(ClientError::Timeout)
                );
                desk.wire.comes(at, heard.clone());
                let (next, _) = desk.ask(read(client, 17, NEXT));
                assert_eq!(
                    next,
                    Ok(0x1000 + NEXT),
                    "{heard:?} {at} ms behind the timeout, answered {late} ms late"
                );
                let sent = desk.wire.sent.borrow();
                assert!(
                    sent[1].0 > SENDS + TIMEOUT + late,
                    "{heard:?}, {at}, {late}"
                );
            }
        }
    }
}

/// The noise is heard by a request to another unit, which takes neither it nor the answer behind it.
#[test]
fn a_request_to_another_unit_is_sent_between_noise_and_late_answer() {
    for heard in noise() {
        for late in [11, 16, GUARD - 1] {
            let mut answers = peer(TIMEOUT + late);
            let mut desk = Desk::<2>::new(move |request| {
                let mut heard = answers(request);
                if request[0] == 20 {
                    // Between the late ones.
                    heard[0].0 = 16;
                }
                heard
            });
            let client = desk.port.client(CONFIG);
            assert_eq!(
                desk.ask(read(client, 17, LATE)).0,
                Err(ClientError::Timeout)
            );
            let results = Place::default();
            for unit in [20, 17] {
                let place = results.clone();
                desk.spawn(async move {
                    let result = read(client, unit, NEXT).await;
                    place.borrow_mut().push(result);
                });
            }
            desk.wire.comes(SENDS + 1, heard.clone());
            desk.run(GUARD + 16 + 4 * (SENDS + DELAY));
            let expected = [Ok(0x4000 + NEXT), Ok(0x1000 + NEXT)];
            assert_eq!(*results.borrow(), expected, "{heard:?}, {late}");
        }
    }
}

/// One that timed out owes an answer, and one behind it is given up: the answer to the first does not end the wait for the second.
#[test]
fn another_units_late_answer_does_not_end_the_wait() {
    let given_up = SENDS + 2;
    // Of the second request's timeout, whose answer does not come.
    for comes in [3, 10, TIMEOUT - 5] {
        let mut answers = peer(TIMEOUT + SENDS + comes);
        let mut desk = Desk::<2>::new(move |request| match request[0] {
            20 => vec![],
            _ => answers(request),
        });
        let client = desk.port.client(CONFIG.late_guard_ms(10 * TIMEOUT as u16));
        assert_eq!(
            desk.ask(read(client, 17, LATE)).0,
            Err(ClientError::Timeout)
        );
        let second = desk.spawn(async move {
            let _ = read(client, 20, NEXT).await;
        });
        desk.run(given_up);
        desk.cancel(second);
        let third = desk.ask(read(client, 18, NEXT));
        let waits = SENDS + TIMEOUT - given_up;
        assert_eq!(
            third,
            (Ok(0x2000 + NEXT), waits + SENDS + DELAY + 1),
            "{comes}"
        );
    }
}

/// What was given up before its last character was out is no request; noise then is nobody's answer.
#[test]
fn noise_after_a_request_that_was_cut_off_delays_no_request() {
    for heard in noise() {
        let mut desk = Desk::<1>::new(peer(DELAY));
        let client = desk.port.client(CONFIG);
        let first = desk.spawn(async move {
            let _ = read(client, 17, LATE).await;
        });
        desk.run(2);
        desk.cancel(first);
        desk.wire.comes(1, heard.clone());
        desk.run(TIMEOUT + GUARD);
        let next = desk.ask(read(client, 17, NEXT));
        assert_eq!(next, (Ok(0x1000 + NEXT), SENDS + DELAY + 1), "{heard:?}");
    }
}

/// Each of it is heard and the wait goes on; the answer behind it is the answer, and nothing of it is kept for the next.
#[test]
fn noise_before_an_answer_does_not_outlive_it() {
    for heard in noise() {
        let mut answers = peer(20);
        let mut desk = Desk::<1>::new(move |request| match request[0] {
            19 => vec![],
            _ => answers(request),
        });
        let client = desk.port.client(CONFIG);
        desk.wire.comes(SENDS + 5, heard.clone());
        let (first, _) = desk.ask(read(client, 17, LATE));
        assert_eq!(first, Ok(0x1000 + LATE), "{heard:?}");
        let (second, _) = desk.ask(read(client, 19, NEXT));
        assert_eq!(second, Err(ClientError::Timeout), "{heard:?}");
    }
}
