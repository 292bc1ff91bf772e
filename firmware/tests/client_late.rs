//! Late answers: none is taken for the answer to another request, and only requests that need to wait for them do.

mod desk;

use std::cell::RefCell;
use std::rc::Rc;

use desk::{Desk, Heard, Registers, SENDS, read};
use multidrop::poll::{PollEntry, PollList};
use multidrop::protocol::client::Diagnostic;
use multidrop::protocol::exception::Exception;
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::{ClientConfig, ClientError};

const TIMEOUT: u64 = 100;
const GUARD: u64 = 60;
const CONFIG: ClientConfig = ClientConfig::new()
    .timeout_ms(TIMEOUT as u16)
    .late_guard_ms(GUARD as u16);
const DELAY: u64 = 10;
/// A request and its answer.
const EXCHANGE: u64 = SENDS + DELAY + 1;

/// A peer that answers by the book, each request as `when` says: ms after its end, or not at all.
fn peer(
    mut when: impl FnMut(&[u8]) -> Option<u64> + 'static,
) -> impl FnMut(&[u8]) -> Vec<(u64, Heard)> + 'static {
    let mut registers = Registers::default();
    move |request| {
        let delay = when(request);
        let answer = registers.answer(request);
        match (answer, delay) {
            (Some(answer), Some(delay)) => vec![(delay, Heard::Frame(answer))],
            _ => vec![],
        }
    }
}

/// All but the first request are answered in time, the first one `late` ms behind its time, or not at all.
fn first_late(late: Option<u64>) -> impl FnMut(&[u8]) -> Vec<(u64, Heard)> + 'static {
    let mut asked = false;
    peer(move |_| match std::mem::replace(&mut asked, true) {
        true => Some(DELAY),
        false => late.map(|late| TIMEOUT + late),
    })
}

/// When requests to this unit began, and for which address.
fn began<const N: usize>(desk: &Desk<'_, N>, unit: u8) -> Vec<(u64, u8)> {
    let sent = desk.wire.sent.borrow();
    let own = sent.iter().filter(|(_, request)| request[0] == unit);
    own.map(|(when, request)| (*when, request[3])).collect()
}

#[test]
fn a_late_answer_is_not_taken_for_that_of_the_next_request() {
    // Behind the guard it comes while the next request is being sent.
    for late in 1..GUARD + SENDS {
        let mut desk = Desk::<1>::new(first_late(Some(late)));
        let client = desk.port.client(CONFIG);
        assert_eq!(desk.ask(read(client, 17, 7)).0, Err(ClientError::Timeout));
        let timed_out = desk.now();
        assert_eq!(
            desk.ask(read(client, 17, 9)).0,
            Ok(0x1009),
            "{late} ms late"
        );
        // It went out as soon as the late answer stood, and in any case when the guard was over.
        let (when, _) = began(&desk, 17)[1];
        let settled = if late <= GUARD { late + 1 } else { GUARD };
        assert_eq!(when - timed_out, settled, "{late} ms late");
    }
}

#[test]
fn without_a_guard_of_its_own_it_is_as_long_as_the_timeout() {
    let mut desk = Desk::<1>::new(first_late(None));
    let client = desk.port.client(CONFIG.late_guard_ms(0));
    assert_eq!(desk.ask(read(client, 17, 7)).0, Err(ClientError::Timeout));
    assert_eq!(
        desk.ask(read(client, 17, 9)),
        (Ok(0x1009), TIMEOUT + EXCHANGE)
    );
}

#[test]
fn requests_that_cannot_be_mistaken_are_sent_meanwhile() {
    let mut desk = Desk::<2>::new(first_late(None));
    let client = desk.port.client(CONFIG);
    assert_eq!(desk.ask(read(client, 17, 7)).0, Err(ClientError::Timeout));
    let timed_out = desk.now();
    let waits = Rc::new(RefCell::new(None));
    let result = waits.clone();
    desk.spawn(async move {
        *result.borrow_mut() = Some(read(client, 17, 9).await);
    });
    // Another unit with the same function, the same unit with another one.
    for _ in 0..2 {
        assert_eq!(desk.ask(read(client, 18, 9)), (Ok(0x2009), EXCHANGE));
        let write = desk.ask(async move { client.write_register(17, 3, 5).await });
        assert_eq!(write, (Ok(()), EXCHANGE));
    }
    assert_eq!(*waits.borrow(), None);
    desk.run(GUARD);
    assert_eq!(*waits.borrow(), Some(Ok(0x1009)));
    let (when, _) = began(&desk, 17).pop().expect("asked");
    assert!(when - timed_out >= GUARD && when - timed_out < GUARD + EXCHANGE);
}

#[test]
fn only_the_late_answer_or_its_exception_ends_the_wait_for_it() {
    let other = Heard::Frame(vec![18, 3, 2, 1, 2]);
    let function = Heard::Frame(vec![17, 4, 2, 1, 2]);
    let accepted = Heard::Frame(vec![17, 0x83, 5]);
    let damaged = Heard::Damaged(ReceiveErrors::CHECK);
    let void = Heard::Void(vec![17, 3, 2, 1, 2]);
    let refused = Heard::Frame(vec![17, 0x83, 2]);
    let answer = Heard::Frame(vec![17, 3, 2, 1, 2]);
    for (heard, ends) in [
        (other, false),
        (function, false),
        (accepted, false),
        (damaged, false),
        (void, false),
        (refused, true),
        (answer, true),
    ] {
        // While nobody asks, and while another unit is asked.
        for busy in [false, true] {
            let mut desk = Desk::<2>::new(first_late(None));
            let client = desk.port.client(CONFIG);
            assert_eq!(desk.ask(read(client, 17, 7)).0, Err(ClientError::Timeout));
            let timed_out = desk.now();
            desk.spawn(async move {
                let _ = read(client, 17, 9).await;
            });
            if busy {
                desk.spawn(async move {
                    let _ = read(client, 19, 9).await;
                });
            }
            desk.wire.comes(SENDS + 3, heard.clone());
            desk.run(GUARD + 2 * EXCHANGE);
            let (when, _) = began(&desk, 17)[1];
            assert_eq!(when - timed_out < GUARD, ends, "{heard:?}, {busy}");
        }
    }
}

#[test]
fn a_retry_does_not_wait_and_a_second_answer_is_expected() {
    // Both tries are answered, the first one in the wait for the second.
    let mut desk = Desk::<1>::new(peer(|request| match request[3] {
        7 => Some(TIMEOUT + 20),
        _ => Some(DELAY),
    }));
    let client = desk.port.client(CONFIG.retries(1));
    let first = desk.ask(read(client, 17, 7));
    assert_eq!(first, (Ok(0x1007), SENDS + TIMEOUT + 20 + 1));
    let second = SENDS + TIMEOUT;
    assert_eq!(began(&desk, 17), [(0, 7), (second, 7)]);
    // The other one comes, and nobody takes it for his.
    assert_eq!(desk.ask(read(client, 17, 9)).0, Ok(0x1009));
    let (when, _) = began(&desk, 17)[2];
    assert_eq!(when, second + SENDS + TIMEOUT + 20 + 1);
}

#[test]
fn late_answers_of_four_units_are_tracked_and_for_a_fifth_the_line_waits() {
    let mut desk = Desk::<1>::new(peer(|request| (request[0] > 5).then_some(DELAY)));
    let guard = 2000;
    let client = desk.port.client(CONFIG.timeout_ms(20).late_guard_ms(guard));
    for unit in 1..=4 {
        assert_eq!(desk.ask(read(client, unit, 7)).0, Err(ClientError::Timeout));
        assert_eq!(desk.ask(read(client, 17, 9)).1 > EXCHANGE, unit == 4);
    }
    // Until the first of them was over.
    let (when, _) = began(&desk, 17).pop().expect("asked");
    assert_eq!(when, SENDS + 20 + u64::from(guard));
}

#[test]
fn waiting_requests_are_sent_in_their_order() {
    let mut desk = Desk::<3>::new(first_late(None));
    let client = desk.port.client(CONFIG);
    assert_eq!(desk.ask(read(client, 17, 7)).0, Err(ClientError::Timeout));
    for address in [1, 2, 3] {
        desk.spawn(async move {
            assert!(read(client, 17, address).await.is_ok());
        });
        desk.run(3);
    }
    desk.run(GUARD + 4 * EXCHANGE);
    let addresses: Vec<u8> = began(&desk, 17).iter().map(|asked| asked.1).collect();
    assert_eq!(addresses, [7, 1, 2, 3]);
}

#[test]
fn a_waiting_request_may_be_given_up_at_any_moment() {
    for moment in 0..GUARD + EXCHANGE {
        let mut desk = Desk::<2>::new(first_late(None));
        let client = desk.port.client(CONFIG);
        assert_eq!(desk.ask(read(client, 17, 7)).0, Err(ClientError::Timeout));
        let waits = desk.spawn(async move {
            let _ = read(client, 17, 8).await;
        });
        desk.run(moment);
        desk.cancel(waits);
        assert_eq!(desk.ask(read(client, 17, 9)).0, Ok(0x1009), "{moment}");
        assert!(!client.is_busy());
    }
}

/// The other units of a scan list are read at their periods, to the millisecond, however long one is silent.
#[test]
fn a_poll_list_reads_the_next_entry_while_a_late_answer_holds_one_up() {
    let scan = PollList::<4, 4>::new([
        PollEntry::holding_registers(1, 0, 1).period_ms(300),
        PollEntry::holding_registers(2, 0, 1).period_ms(300),
        PollEntry::holding_registers(9, 0, 1).period_ms(20),
        PollEntry::holding_registers(3, 0, 1).period_ms(300),
    ]);
    let scan = &scan;
    let mut desk = Desk::<1>::new(peer(|request| (request[0] != 9).then_some(DELAY)));
    // An answer that is late is expected for longer than a period.
    let client = desk.port.client(CONFIG.timeout_ms(40).late_guard_ms(250));
    desk.spawn(async move { scan.run(client).await });
    desk.run(6000);
    for (entry, unit) in [(0, 1), (1, 2), (3, 3)] {
        assert_eq!(scan.health(entry).answers, 20, "unit {unit}");
        let began = began(&desk, unit);
        assert!(
            began
                .windows(2)
                .all(|pair| (pair[1].0 - pair[0].0).abs_diff(300) <= 45)
        );
    }
    // And it is asked as often as may be.
    let silent = began(&desk, 9);
    assert!(
        silent
            .windows(2)
            .all(|pair| pair[1].0 - pair[0].0 >= SENDS + 40 + 250)
    );
    assert!(silent.len() > 17, "{silent:?}");
    assert_eq!(usize::from(scan.health(2).timeouts), silent.len());
}

#[test]
fn the_timeout_bounds_the_beginning_of_an_answer() {
    let long = |begins: u64, length: u64, frame: Vec<u8>| {
        move |_: &[u8]| {
            let heard = Heard::Long(length, Box::new(Heard::Frame(frame.clone())));
            vec![(begins, heard)]
        }
    };
    let answer = vec![17, 3, 2, 0x12, 0x34];
    for (begins, length, heard, expected, over) in [
        // Begun in time and over long behind it; begun too late.
        (10, 500, answer.clone(), Ok(0x1234), 511),
        (TIMEOUT - 1, 30, answer.clone(), Ok(0x1234), TIMEOUT + 30),
        (TIMEOUT + 1, 30, answer, Err(ClientError::Timeout), TIMEOUT),
        // What is not the answer ends it when it is over.
        (
            90,
            50,
            vec![18, 3, 2, 1, 2],
            Err(ClientError::WrongUnit(18)),
            140,
        ),
        (
            90,
            50,
            vec![17, 4, 2, 1, 2],
            Err(ClientError::WrongFunction(4)),
            140,
        ),
        (
            90,
            50,
            vec![17, 3, 4, 1, 2],
            Err(ClientError::WrongLength(5)),
            141,
        ),
        (
            90,
            50,
            vec![17, 0x83, 2],
            Err(ClientError::Exception(Exception::IllegalDataAddress)),
            141,
        ),
        // Exception 05 alone extends it.
        (
            90,
            50,
            vec![17, 0x83, 5],
            Err(ClientError::Exception(Exception::Acknowledge)),
            141 + TIMEOUT,
        ),
    ] {
        let mut desk = Desk::<1>::new(long(begins, length, heard));
        let client = desk.port.client(CONFIG);
        assert_eq!(desk.ask(read(client, 17, 7)), (expected, SENDS + over));
    }
}

#[test]
fn only_one_frame_is_received_after_the_timeout() {
    // The next one begins in the moment in which it is over, or behind it.
    for begins in [150, 151, 152] {
        let mut desk = Desk::<1>::new(move |_| {
            let long = |frame| Heard::Long(60, Box::new(Heard::Frame(frame)));
            vec![
                (90, long(vec![18, 3, 2, 1, 2])),
                (begins, long(vec![17, 3, 2, 1, 2])),
            ]
        });
        let client = desk.port.client(CONFIG);
        let over = (Err(ClientError::WrongUnit(18)), SENDS + 150);
        assert_eq!(desk.ask(read(client, 17, 7)), over, "{begins}");
    }
}

#[test]
fn a_damaged_frame_is_received_to_its_end_too() {
    let mut desk = Desk::<1>::new(|_| {
        let damaged = Heard::Damaged(ReceiveErrors::CHECK);
        vec![(90, Heard::Long(60, Box::new(damaged)))]
    });
    let client = desk.port.client(CONFIG);
    let over = (Err(ClientError::Damaged(ReceiveErrors::CHECK)), SENDS + 150);
    assert_eq!(desk.ask(read(client, 17, 7)), over);
}

#[test]
fn no_request_is_sent_within_the_gap_after_an_answer() {
    const GAP: u64 = 40;
    let mut desk = Desk::<2>::new(peer(|_| Some(DELAY)));
    let client = desk.port.client(CONFIG.request_gap_ms(GAP as u16));
    for unit in [17, 18] {
        desk.spawn(async move {
            for address in [1, 2, 0] {
                // The last one is refused, which is an answer too.
                let asked = match address {
                    0 => client.diagnose(unit, Diagnostic::Clear).await.map(drop),
                    _ => read(client, unit, address).await.map(drop),
                };
                assert_eq!(asked.is_ok(), address != 0);
            }
        });
    }
    desk.run(10 * (EXCHANGE + GAP));
    let sent = desk.wire.sent.borrow();
    assert_eq!(sent.len(), 6);
    for pair in sent.windows(2) {
        assert_eq!(pair[1].0 - pair[0].0, EXCHANGE + GAP);
    }
}
