//! Every wait of a client at every time of the clock, whose lower 32 bits wrap, and the order of many requests.

mod desk;

use std::cell::RefCell;
use std::rc::Rc;

use desk::{Desk, Heard, Registers, SENDS, read};
use embassy_time::{Duration, MockDriver};
use multidrop::poll::{PollEntry, PollList};
use multidrop::{ClientConfig, ClientError};

const TIMEOUT: u64 = 30;
const GUARD: u64 = 20;
const TURNAROUND: u64 = 15;
const GAP: u64 = 7;
const CONFIG: ClientConfig = ClientConfig::new()
    .timeout_ms(TIMEOUT as u16)
    .late_guard_ms(GUARD as u16)
    .turnaround_ms(TURNAROUND as u16)
    .request_gap_ms(GAP as u16);
const DELAY: u64 = 4;
/// A request and its answer.
const EXCHANGE: u64 = SENDS + DELAY + 1;

/// Ticks before which the lower half of the time goes round, and half of that.
const ROUND: u64 = 1 << 32;
const TICKS_PER_MS: u64 = embassy_time::TICK_HZ / 1000;

/// Moments from which all waits here reach over the end of the lower half, its middle, or neither.
fn moments() -> impl Iterator<Item = u64> {
    let before = [0, 1, 2, 5, 6, 20, 21, 34, 35, 36, 50, 51, 55, 56, 60, 90];
    let edges = [ROUND / 2, ROUND, 2 * ROUND, 7 * ROUND];
    edges.into_iter().flat_map(move |edge| {
        before.into_iter().flat_map(move |ms| {
            let ms = ms * TICKS_PER_MS;
            [edge - ms, edge - ms - 1, edge - ms - TICKS_PER_MS / 2]
        })
    })
}

/// A desk whose time is this already. Unit 9 is not there, unit 8 is busy once, all others answer by the book.
fn at<const N: usize>(ticks: u64) -> Desk<'static, N> {
    let mut registers = Registers::default();
    let mut is_busy = true;
    let desk = Desk::new(move |request| match request[0] {
        0 | 9 => vec![],
        8 if std::mem::take(&mut is_busy) => {
            vec![(DELAY, Heard::Frame(vec![8, request[1] | 0x80, 6]))]
        }
        _ => {
            let answer = registers.answer(request).expect("no broadcast");
            vec![(DELAY, Heard::Frame(answer))]
        }
    });
    MockDriver::get().advance(Duration::from_ticks(ticks));
    desk
}

#[test]
fn a_timeout_and_the_guard_behind_it() {
    for moment in moments() {
        let mut desk = at::<1>(moment);
        let client = desk.port.client(CONFIG);
        let first = desk.ask(read(client, 9, 1));
        let expected = (Err(ClientError::Timeout), SENDS + TIMEOUT);
        assert_eq!(first, expected, "{moment:#x}");
        let second = desk.ask(read(client, 9, 1));
        let expected = (Err(ClientError::Timeout), GUARD + SENDS + TIMEOUT);
        assert_eq!(second, expected, "{moment:#x}");
        let other = desk.ask(read(client, 17, 1));
        assert_eq!(other, (Ok(0x1001), EXCHANGE), "{moment:#x}");
    }
}

#[test]
fn retries_the_gap_and_the_wait_for_a_busy_unit() {
    for moment in moments() {
        let mut desk = at::<1>(moment);
        let client = desk.port.client(CONFIG.retries(2));
        let missing = desk.ask(read(client, 9, 1));
        let expected = (Err(ClientError::Timeout), 3 * (SENDS + TIMEOUT));
        assert_eq!(missing, expected, "{moment:#x}");
        let busy = desk.ask(read(client, 8, 1));
        let expected = (Ok(0x8001), EXCHANGE + TIMEOUT + EXCHANGE);
        assert_eq!(busy, expected, "{moment:#x}");
        let next = desk.ask(read(client, 17, 1));
        assert_eq!(next, (Ok(0x1001), GAP + EXCHANGE), "{moment:#x}");
    }
}

#[test]
fn the_turnaround_and_the_wait_for_silence() {
    for moment in moments() {
        let mut desk = at::<1>(moment);
        let client = desk.port.client(CONFIG);
        let broadcast = desk.ask(async move { client.write_register(0, 1, 1).await });
        assert_eq!(broadcast, (Ok(()), SENDS + TURNAROUND), "{moment:#x}");
        desk.wire.comes(1, Heard::Talk(2 * TIMEOUT));
        desk.run(1);
        let loud = desk.ask(read(client, 17, 1));
        assert_eq!(loud, (Err(ClientError::NoSilence), TIMEOUT), "{moment:#x}");
    }
}

#[test]
fn the_answer_to_a_request_given_up_is_waited_for() {
    for moment in moments() {
        let mut desk = at::<2>(moment);
        let client = desk.port.client(CONFIG);
        let first = desk.spawn(async move {
            let _ = read(client, 9, 1).await;
        });
        desk.run(SENDS + 3);
        desk.cancel(first);
        // Whoever is asked, until its timeout is over.
        let second = desk.ask(read(client, 17, 1));
        assert_eq!(second, (Ok(0x1001), TIMEOUT - 3 + EXCHANGE), "{moment:#x}");
    }
}

#[test]
fn a_poll_list_keeps_its_periods() {
    for moment in moments() {
        let scan: &'static PollList<2, 2> = Box::leak(Box::new(PollList::new([
            PollEntry::holding_registers(17, 1, 1).period_ms(50),
            PollEntry::holding_registers(18, 1, 1).period_ms(100),
        ])));
        let mut desk = at::<1>(moment);
        let client = desk.port.client(CONFIG.request_gap_ms(0));
        desk.spawn(async move { scan.run(client).await });
        desk.run(299);
        let sent = desk.wire.sent.borrow();
        let began = |unit: u8| {
            let own = sent.iter().filter(move |(_, request)| request[0] == unit);
            own.map(|(when, _)| *when).collect::<Vec<_>>()
        };
        // Where both are due, the one behind the last one read goes first.
        let first = [0, 50, 100, 150, 200, 250];
        assert_eq!(began(17).len(), 6, "{moment:#x}");
        assert!(
            began(17)
                .iter()
                .zip(first)
                .all(|(began, due)| (due..=due + EXCHANGE).contains(began)),
            "{moment:#x}"
        );
        assert_eq!(began(18), [EXCHANGE, 100, 200], "{moment:#x}");
        assert_eq!(scan.health(0).answers, 6);
        assert_eq!(scan.health(1).answers, 3);
    }
}

/// The CPU is busy with something else when a wait ends: it is over when the task is polled, however much later that is.
#[test]
fn a_wait_that_is_polled_late_is_over() {
    let minutes = ROUND / 3;
    for moment in [0, ROUND / 2 - 1, ROUND - 1] {
        for late in [1, TICKS_PER_MS, 50 * TICKS_PER_MS, minutes] {
            let jump = |ms: u64| {
                let ticks = ms * TICKS_PER_MS + late;
                MockDriver::get().advance(Duration::from_ticks(ticks));
            };
            // The timeout of one, then the guard behind it, for which the next one waits.
            let mut desk = at::<1>(moment);
            let client = desk.port.client(CONFIG);
            for waits in [0, GUARD] {
                let asks = desk.spawn(async move {
                    assert_eq!(read(client, 9, 1).await, Err(ClientError::Timeout));
                });
                desk.poll();
                if waits > 0 {
                    jump(waits);
                }
                desk.run(SENDS + 1);
                assert!(!desk.is_over(asks));
                jump(TIMEOUT);
                desk.poll();
                assert!(desk.is_over(asks), "{moment:#x}, {late}");
            }
            assert_eq!(desk.sent().len(), 2);
            drop(desk);
            // The turnaround.
            let mut desk = at::<1>(moment);
            let client = desk.port.client(CONFIG);
            let asks = desk.spawn(async move {
                assert_eq!(client.write_register(0, 1, 1).await, Ok(()));
            });
            desk.run(SENDS + 1);
            assert!(!desk.is_over(asks));
            jump(TURNAROUND);
            desk.poll();
            assert!(desk.is_over(asks), "{moment:#x}, {late}");
        }
    }
}

#[test]
fn the_longest_waits_end_in_time() {
    let longest = u64::from(u16::MAX);
    for moment in [0, ROUND - 1, ROUND / 2] {
        let mut desk = at::<1>(moment);
        let client = desk
            .port
            .client(CONFIG.timeout_ms(u16::MAX).late_guard_ms(u16::MAX));
        let first = desk.ask(read(client, 9, 1));
        assert_eq!(first, (Err(ClientError::Timeout), SENDS + longest));
        let began = desk.now();
        let second = desk.spawn(async move {
            let _ = read(client, 9, 1).await;
        });
        desk.run(longest + SENDS);
        assert_eq!(desk.wire.sent.borrow()[1].0 - began, longest);
        assert!(!desk.is_over(second));
    }
}

/// More requests than tickets: whoever asks behind another is asked behind it.
#[test]
fn three_tasks_take_turns_for_long() {
    let mut desk = at::<3>(0);
    let client = desk.port.client(CONFIG.request_gap_ms(0));
    for unit in [17, 18, 19] {
        desk.spawn(async move {
            for _ in 0..300 {
                assert!(read(client, unit, 1).await.is_ok());
            }
        });
    }
    desk.run(900 * EXCHANGE);
    let units: Vec<u8> = desk.sent().iter().map(|request| request[0]).collect();
    assert_eq!(units, [17, 18, 19].repeat(300));
    assert!(!client.is_busy());
}

/// Those that wait go in the order in which they came, wherever places were free, and whoever goes away in between.
#[test]
fn places_that_are_free_again_do_not_change_the_order() {
    // Who of four goes away while the first is asked.
    for gone in 1..=4 {
        for before in [0, 250, 251, 252, 253, 254, 255, 256] {
            let mut desk = at::<4>(0);
            let client = desk.port.client(CONFIG.request_gap_ms(0));
            let ended: Rc<RefCell<Vec<u8>>> = Rc::default();
            // So many have waited before: the line is taken, and they go away.
            let holds = desk.spawn(async move {
                let _ = read(client, 16, 1).await;
            });
            desk.poll();
            for _ in 0..before {
                let waits = desk.spawn(async move {
                    let _ = read(client, 16, 1).await;
                });
                desk.poll();
                desk.cancel(waits);
            }
            desk.run(EXCHANGE);
            assert!(desk.is_over(holds));
            let mut tasks = Vec::new();
            for unit in 17..=21 {
                let ended = ended.clone();
                tasks.push(desk.spawn(async move {
                    assert!(read(client, unit, 1).await.is_ok());
                    ended.borrow_mut().push(unit);
                }));
                desk.poll();
            }
            desk.cancel(tasks[gone]);
            let late = ended.clone();
            desk.spawn(async move {
                assert!(read(client, 22, 1).await.is_ok());
                late.borrow_mut().push(22);
            });
            desk.run(7 * EXCHANGE);
            let mut expected = vec![17, 18, 19, 20, 21, 22];
            expected.remove(gone);
            assert_eq!(*ended.borrow(), expected);
        }
    }
}

/// A client with other times uses these, and the first client its own.
#[test]
fn a_client_with_other_times_uses_them() {
    let mut desk = at::<1>(0);
    let client = desk.port.client(CONFIG);
    let patient = client.with(CONFIG.timeout_ms(3 * TIMEOUT as u16).retries(1));
    for (client, ms) in [
        (client, SENDS + TIMEOUT),
        (patient, GUARD + 2 * (SENDS + 3 * TIMEOUT)),
        (client, GUARD + SENDS + TIMEOUT),
    ] {
        let missing = desk.ask(read(client, 9, 1));
        assert_eq!(missing, (Err(ClientError::Timeout), ms));
    }
}
