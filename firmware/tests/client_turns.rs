//! The turns of several requests: broadcasts for which all others wait, simultaneous requests, and requests that are given up.

mod desk;

use desk::once::{CONFIG, DELAY, TIMEOUT, once};
use desk::{Desk, Heard, Registers, SENDS};
use multidrop::ClientError;
use multidrop::protocol::frame::ReceiveErrors;
use std::cell::RefCell;
use std::rc::Rc;

#[test]
fn after_a_broadcast_other_requests_wait_for_the_turnaround() {
    let mut desk = Desk::<1>::new(once(|answer| vec![(DELAY, Heard::Frame(answer))]));
    let client = desk.port.client(CONFIG.turnaround_ms(60));
    let (write, ms) = desk.ask(async move { client.write_registers(0, 3, &[5, 6]).await });
    assert_eq!((write, ms), (Ok(()), SENDS + 60));
    let (write, _) = desk.ask(async move { client.write_register(17, 3, 7).await });
    assert_eq!(write, Ok(()));
    let began: Vec<u64> = desk.wire.sent.borrow().iter().map(|sent| sent.0).collect();
    assert_eq!(began, [0, SENDS + 60]);
}

/// Given up at any moment: the next request still waits for all to be done.
#[test]
fn the_next_request_waits_for_the_turnaround_of_a_broadcast_that_was_given_up() {
    for moment in 0..SENDS + 60 {
        let mut desk = Desk::<1>::new(once(|answer| vec![(DELAY, Heard::Frame(answer))]));
        let client = desk.port.client(CONFIG.turnaround_ms(60));
        let first = desk.spawn(async move {
            let _ = client.write_register(0, 3, 7).await;
        });
        desk.run(moment);
        desk.cancel(first);
        let (write, _) = desk.ask(async move { client.write_register(17, 3, 7).await });
        assert_eq!(write, Ok(()));
        let sent = desk.wire.sent.borrow();
        let broadcast = sent.iter().any(|(_, request)| request[0] == 0);
        assert_eq!(broadcast, moment >= SENDS);
        let (began, _) = sent
            .iter()
            .find(|(_, request)| request[0] == 17)
            .expect("sent");
        assert!(
            !broadcast || *began >= SENDS + 60,
            "given up at {moment}: {began}"
        );
    }
}

#[test]
fn a_frame_after_a_broadcast_is_dropped() {
    let mut desk = Desk::<1>::new(|request| match request[0] {
        0 => vec![
            (DELAY, Heard::Frame(vec![17, 6, 0, 3, 0, 7])),
            (99, Heard::Damaged(ReceiveErrors::CHECK)),
        ],
        _ => vec![],
    });
    let client = desk.port.client(CONFIG);
    let (write, _) = desk.ask(async move { client.write_register(0, 3, 7).await });
    assert_eq!(write, Ok(()));
    let (write, _) = desk.ask(async move { client.write_register(17, 3, 7).await });
    assert_eq!(write, Err(ClientError::Timeout));
}

#[test]
fn two_tasks_take_turns() {
    let mut desk = Desk::<2>::new(once(|answer| vec![(DELAY, Heard::Frame(answer))]));
    let client = desk.port.client(CONFIG);
    for unit in [17, 18] {
        desk.spawn(async move {
            loop {
                assert_eq!(client.write_register(unit, 1, 1).await, Ok(()));
            }
        });
    }
    desk.run(1000);
    let units: Vec<u8> = desk.sent().iter().map(|request| request[0]).collect();
    assert!(units.len() > 50);
    assert!(
        units.chunks_exact(2).all(|pair| pair == [17, 18]),
        "{units:?}"
    );
}

#[test]
fn one_task_more_than_the_queue_holds_is_refused() {
    let mut desk = Desk::<1>::new(once(|answer| vec![(DELAY, Heard::Frame(answer))]));
    let client = desk.port.client(CONFIG);
    assert!(!client.is_busy());
    let results = Rc::new(RefCell::new(Vec::new()));
    for unit in [17, 18, 19] {
        let results = results.clone();
        desk.spawn(async move {
            let result = client.write_register(unit, 1, 1).await;
            results.borrow_mut().push((unit, result));
        });
    }
    desk.poll();
    assert!(client.is_busy());
    assert_eq!(*results.borrow(), [(19, Err(ClientError::QueueFull))]);
    desk.run(100);
    assert_eq!(results.borrow()[1..], [(17, Ok(())), (18, Ok(()))]);
    assert!(!client.is_busy());
}

/// Dropped at every moment of a transaction, with answers that come early, late and not at all: the turn is
/// given back, and the next request gets its own answer, although it has the same shape.
#[test]
fn a_request_given_up_at_any_moment_leaves_no_answer_behind() {
    for delay in [1, DELAY, 60, TIMEOUT - 1, 5000] {
        for moment in 0..=SENDS + 65 {
            let mut registers = Registers::default();
            let mut desk = Desk::<2>::new(move |request| {
                let delay = if request[3] == 7 { delay } else { DELAY };
                let answer = registers.answer(request).expect("no broadcast");
                vec![(delay, Heard::Frame(answer))]
            });
            let client = desk.port.client(CONFIG);
            let first = desk.spawn(async move {
                let mut cell = [0];
                let _ = client.read_holding_registers(17, 7, &mut cell).await;
            });
            // Behind it another one waits already, or comes later.
            let waits = moment % 2 == 0;
            let result = Rc::new(RefCell::new(None));
            let second = {
                let result = result.clone();
                async move {
                    let mut cell = [0];
                    let read = client.read_holding_registers(17, 9, &mut cell).await;
                    *result.borrow_mut() = Some(read.map(|()| cell[0]));
                }
            };
            let mut second = Some(second);
            if waits {
                desk.spawn(second.take().expect("not yet"));
            }
            desk.run(moment);
            desk.cancel(first);
            if let Some(second) = second {
                desk.spawn(second);
            }
            // For as long as an answer in time, and the guard behind it.
            desk.run(SENDS + 2 * TIMEOUT + 2 * (SENDS + DELAY + 5));
            assert_eq!(
                *result.borrow(),
                Some(Ok(0x1009)),
                "delay {delay}, given up at {moment}"
            );
            // Cut off before its last character, the first was no request.
            assert_eq!(
                desk.wire.cut.get() > 0,
                (1..SENDS).contains(&moment) || moment == 0
            );
        }
    }
}

/// The answer has come, and is not looked at any more.
#[test]
fn an_answer_that_nobody_takes_is_given_back() {
    for heard in [
        Heard::Frame(vec![17, 3, 2, 0x12, 0x34]),
        Heard::Damaged(ReceiveErrors::CHECK),
    ] {
        let comes = heard.clone();
        let mut desk = Desk::<1>::new(once(move |_| vec![(DELAY, comes.clone())]));
        let client = desk.port.client(CONFIG);
        let first = desk.spawn(async move {
            let _ = client.read_holding_registers(17, 7, &mut [0]).await;
        });
        desk.run(SENDS + DELAY - 1);
        desk.receive_only();
        assert_eq!(desk.wire.is_lent(), matches!(heard, Heard::Frame(_)));
        desk.cancel(first);
        assert!(!desk.wire.is_lent());
        let (next, _) = desk.ask(async move {
            let mut cell = [0];
            let read = client.read_holding_registers(17, 9, &mut cell).await;
            read.map(|()| cell)
        });
        assert_eq!(next, Ok([0x1009]));
    }
}

#[test]
fn a_frame_that_no_request_waits_for_is_dropped() {
    let mut desk = Desk::<1>::new(once(|answer| {
        vec![
            (DELAY, Heard::Frame(answer.clone())),
            (DELAY + 20, Heard::Damaged(ReceiveErrors::CHECK)),
            (DELAY + 40, Heard::Frame(answer)),
        ]
    }));
    let client = desk.port.client(CONFIG);
    let read = move |address| async move {
        let mut cell = [0];
        let read = client.read_holding_registers(17, address, &mut cell).await;
        read.map(|()| cell[0])
    };
    assert_eq!(desk.ask(read(7)).0, Ok(0x1007));
    desk.run(100);
    assert_eq!(desk.ask(read(9)), (Ok(0x1009), SENDS + DELAY + 1));
}

/// The second, which waits for the answer to the first, is given up too.
#[test]
fn the_next_request_waits_for_an_answer_that_is_still_to_come() {
    let mut desk = Desk::<2>::new(once(|answer| vec![(60, Heard::Frame(answer))]));
    let client = desk.port.client(CONFIG);
    let read = move |address| async move {
        let mut cell = [0];
        let read = client.read_holding_registers(17, address, &mut cell).await;
        read.map(|()| cell[0])
    };
    let first = desk.spawn(async move {
        let _ = read(7).await;
    });
    desk.run(SENDS + 2);
    desk.cancel(first);
    let second = desk.spawn(async move {
        let _ = read(8).await;
    });
    desk.run(2);
    assert_eq!(desk.sent().len(), 1);
    desk.cancel(second);
    assert_eq!(desk.ask(read(9)).0, Ok(0x1009));
    assert_eq!(desk.sent().len(), 2);
}
