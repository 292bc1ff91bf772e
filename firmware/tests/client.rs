//! The end of a request (SER 2.4): answers that are delayed, cut, doubled, damaged, wrong.

mod desk;

use desk::once::{CONFIG, DELAY, FOR_NOTHING, TIMEOUT, once};
use desk::{Desk, Heard, SENDS};
use multidrop::client::Blame;
use multidrop::protocol::client::{Diagnostic, RequestError};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::{ClientConfig, ClientError};

/// What becomes of a first read of register 7 of unit 17, and the ms it takes. A second one, of register 9,
/// has to be right.
fn first_read(
    config: ClientConfig,
    peer: impl FnMut(&[u8]) -> Vec<(u64, Heard)> + 'static,
) -> (Result<u16, ClientError>, u64) {
    let mut desk = Desk::<1>::new(peer);
    let client = desk.port.client(config);
    let read = move |address| async move {
        let mut cell = [0xEEEE];
        let read = client.read_holding_registers(17, address, &mut cell).await;
        read.map(|()| cell[0])
    };
    let (first, ms) = desk.ask(read(7));
    assert_eq!(
        desk.ask(read(9)).0,
        Ok(0x1009),
        "the next one, after {first:?}"
    );
    (first, ms)
}

#[test]
fn a_good_answer_ends_the_wait_when_it_stands() {
    let (read, ms) = first_read(CONFIG, once(|answer| vec![(DELAY, Heard::Frame(answer))]));
    assert_eq!((read, ms), (Ok(0x1007), SENDS + DELAY + 1));
}

#[test]
fn silence_is_a_timeout() {
    let (read, ms) = first_read(CONFIG, once(|_| vec![]));
    assert_eq!((read, ms), (Err(ClientError::Timeout), FOR_NOTHING));
    assert_eq!(ClientError::Timeout.blame(), Blame::Wire);
}

#[test]
fn an_answer_that_comes_too_late_is_dropped() {
    // Just before the timeout, and just after it, before the next request is out.
    let (read, _) = first_read(
        CONFIG,
        once(|answer| vec![(TIMEOUT - 1, Heard::Frame(answer))]),
    );
    assert_eq!(read, Ok(0x1007));
    let (read, _) = first_read(
        CONFIG,
        once(|answer| vec![(TIMEOUT + 1, Heard::Frame(answer))]),
    );
    assert_eq!(read, Err(ClientError::Timeout));
}

#[test]
fn a_late_answer_of_another_shape_does_not_end_the_next_wait() {
    for (late, address) in [(12, 7), (16, 7)] {
        let mut desk = Desk::<1>::new(once(move |answer| {
            vec![(TIMEOUT + late, Heard::Frame(answer))]
        }));
        let client = desk.port.client(CONFIG);
        let mut cells = [0; 2];
        let (first, _) =
            desk.ask(async move { client.read_holding_registers(17, address, &mut cells).await });
        assert_eq!(first, Err(ClientError::Timeout));
        // A write with an echo of its own, then a read of another length.
        let (second, _) = desk.ask(async move { client.write_register(17, 3, 0xBEEF).await });
        assert_eq!(second, Ok(()));
        let mut cell = [0];
        let (third, _) = desk.ask(async move {
            client
                .read_holding_registers(17, 3, &mut cell)
                .await
                .map(|()| cell)
        });
        assert_eq!(third, Ok([0xBEEF]));
    }
}

#[test]
fn an_answer_cut_off_at_any_byte_is_no_answer() {
    for len in 0..5 {
        // With a check that fits it, and without.
        let (read, ms) = first_read(
            CONFIG,
            once(move |answer| vec![(DELAY, Heard::Frame(answer[..len.max(2)].to_vec()))]),
        );
        assert_eq!(
            (read, ms),
            (Err(ClientError::WrongLength(len.max(2) as u8)), FOR_NOTHING)
        );
        let (read, ms) = first_read(
            CONFIG,
            once(|_| vec![(DELAY, Heard::Damaged(ReceiveErrors::CHECK))]),
        );
        assert_eq!(
            (read, ms),
            (Err(ClientError::Damaged(ReceiveErrors::CHECK)), FOR_NOTHING)
        );
    }
}

#[test]
fn an_answer_wrong_in_any_byte_gives_the_matching_error() {
    for (place, expected) in [
        (0, Err(ClientError::WrongUnit(17 ^ 0x40))),
        (1, Err(ClientError::WrongFunction(3 ^ 0x40))),
        (2, Err(ClientError::WrongLength(5))),
        // Nobody can tell, if the check fits it.
        (3, Ok(0x5007)),
        (4, Ok(0x1047)),
    ] {
        let (read, ms) = first_read(
            CONFIG,
            once(move |mut answer| {
                answer[place] ^= 0x40;
                vec![(DELAY, Heard::Frame(answer))]
            }),
        );
        assert_eq!(read, expected, "byte {place}");
        assert_eq!(ms == FOR_NOTHING, expected.is_err());
    }
}

#[test]
fn an_echo_wrong_in_any_byte_is_not_the_answer() {
    for place in 0..6 {
        let mut desk = Desk::<1>::new(once(move |mut answer| {
            answer[place] ^= 0x40;
            vec![(DELAY, Heard::Frame(answer))]
        }));
        let client = desk.port.client(CONFIG);
        let (write, ms) = desk.ask(async move { client.write_register(17, 3, 0x1234).await });
        assert_eq!(ms, FOR_NOTHING);
        let expected = match place {
            0 => ClientError::WrongUnit(17 ^ 0x40),
            1 => ClientError::WrongFunction(6 ^ 0x40),
            _ => ClientError::WrongContent,
        };
        assert_eq!(write, Err(expected), "byte {place}");
        let (write, _) = desk.ask(async move { client.write_register(17, 3, 0x1234).await });
        assert_eq!(write, Ok(()));
    }
}

#[test]
fn an_answer_that_comes_twice_counts_once() {
    // The second comes before the next request is out: behind that, nothing but its shape tells.
    for apart in 2..=SENDS {
        let (read, _) = first_read(
            CONFIG,
            once(move |answer| {
                vec![
                    (DELAY, Heard::Frame(answer.clone())),
                    (DELAY + apart, Heard::Frame(answer)),
                ]
            }),
        );
        assert_eq!(read, Ok(0x1007), "{apart} ms apart");
    }
}

/// Fault 10 of other clients: the wait ended.
#[test]
fn other_units_answers_damaged_frames_and_other_functions_are_skipped() {
    let wrong = [
        Heard::Frame(vec![18, 3, 2, 1, 2]),
        Heard::Frame(vec![17, 4, 2, 1, 2]),
        Heard::Frame(vec![17, 3, 4, 1, 2, 3, 4]),
        Heard::Frame(vec![17, 0x84, 2]),
        Heard::Frame(vec![17, 0x83, 2, 0]),
        Heard::Damaged(ReceiveErrors::CHECK),
        Heard::Damaged(ReceiveErrors::PARITY),
        Heard::Void(vec![17, 3, 2, 1, 2]),
        Heard::Void(vec![17, 0x83, 2]),
    ];
    for first in &wrong {
        let first = first.clone();
        let (read, ms) = first_read(
            CONFIG,
            once(move |answer| vec![(DELAY, first.clone()), (DELAY + 5, Heard::Frame(answer))]),
        );
        assert_eq!((read, ms), (Ok(0x1007), SENDS + DELAY + 6));
    }
}

#[test]
fn the_last_wrong_frame_is_the_error() {
    let unit = Heard::Frame(vec![18, 3, 2, 1, 2]);
    let function = Heard::Frame(vec![17, 4, 2, 1, 2]);
    let check = Heard::Damaged(ReceiveErrors::CHECK);
    let void = Heard::Void(vec![17, 3, 2, 1, 2]);
    for (heard, expected) in [
        ([&unit, &function], ClientError::WrongFunction(4)),
        ([&function, &unit], ClientError::WrongUnit(18)),
        ([&unit, &check], ClientError::Damaged(ReceiveErrors::CHECK)),
        ([&check, &unit], ClientError::WrongUnit(18)),
        ([&unit, &void], ClientError::Damaged(ReceiveErrors::GAP)),
    ] {
        let [first, second] = heard.map(Clone::clone);
        let (read, ms) = first_read(
            CONFIG,
            once(move |_| vec![(DELAY, first.clone()), (DELAY + 5, second.clone())]),
        );
        assert_eq!((read, ms), (Err(expected), FOR_NOTHING));
    }
}

#[test]
fn an_exception_is_an_answer() {
    for (code, expected) in [
        (1, ClientError::Exception(Exception::IllegalFunction)),
        (2, ClientError::Exception(Exception::IllegalDataAddress)),
        (4, ClientError::Exception(Exception::ServerDeviceFailure)),
        (6, ClientError::Exception(Exception::ServerDeviceBusy)),
        (
            0x0B,
            ClientError::Exception(Exception::GatewayTargetFailedToRespond),
        ),
        (0x77, ClientError::UnknownException(0x77)),
    ] {
        let (read, ms) = first_read(
            CONFIG,
            once(move |_| vec![(DELAY, Heard::Frame(vec![17, 0x83, code]))]),
        );
        assert_eq!((read, ms), (Err(expected), SENDS + DELAY + 1));
        assert_eq!(expected.blame(), Blame::Peer);
    }
}

#[test]
fn exception_05_extends_the_wait_by_one_timeout() {
    let accepted = || (DELAY, Heard::Frame(vec![17, 0x83, 5]));
    let acknowledge = Err(ClientError::Exception(Exception::Acknowledge));
    // Answered within the extension.
    let (read, _) = first_read(
        CONFIG,
        once(move |answer| vec![accepted(), (TIMEOUT + 5, Heard::Frame(answer))]),
    );
    assert_eq!(read, Ok(0x1007));
    // Not answered; wrong things heard meanwhile do not hide that it was accepted; nor is it tried again.
    let (read, ms) = first_read(
        CONFIG.retries(3),
        once(move |_| {
            vec![
                accepted(),
                (DELAY + 20, Heard::Damaged(ReceiveErrors::CHECK)),
            ]
        }),
    );
    assert_eq!((read, ms), (acknowledge, SENDS + DELAY + 1 + TIMEOUT));
    // Extended once.
    let (read, ms) = first_read(
        CONFIG,
        once(move |_| vec![accepted(), (DELAY + 90, Heard::Frame(vec![17, 0x83, 5]))]),
    );
    assert_eq!((read, ms), (acknowledge, SENDS + DELAY + 90 + 1));
}

#[test]
fn exception_06_is_tried_again_later_if_retries_are_left() {
    let busy = |function: u8| move |_| vec![(DELAY, Heard::Frame(vec![17, function | 0x80, 6]))];
    let (read, ms) = first_read(CONFIG.retries(1), once(busy(3)));
    assert_eq!((read, ms), (Ok(0x1007), 2 * (SENDS + DELAY + 1) + TIMEOUT));
    // Others may ask meanwhile.
    let mut desk = Desk::<2>::new(once(busy(6)));
    let client = desk.port.client(CONFIG.retries(1));
    let first = desk.spawn(async move {
        assert_eq!(client.write_register(17, 1, 1).await, Ok(()));
    });
    desk.run(SENDS + DELAY + 2);
    let (other, ms) = desk.ask(async move { client.write_register(18, 1, 1).await });
    assert_eq!((other, ms), (Ok(()), SENDS + DELAY + 1));
    desk.run(TIMEOUT + 20);
    assert!(desk.is_over(first));
    let units: Vec<u8> = desk.sent().iter().map(|request| request[0]).collect();
    assert_eq!(units, [17, 18, 17]);
}

#[test]
fn retries_are_sent_and_counted() {
    for retries in 0..3 {
        let mut desk = Desk::<1>::new(|_| vec![]);
        let client = desk.port.client(CONFIG.retries(retries));
        let (write, ms) = desk.ask(async move { client.write_register(17, 3, 5).await });
        let times = 1 + u64::from(retries);
        assert_eq!(
            (write, ms),
            (Err(ClientError::Timeout), times * FOR_NOTHING)
        );
        let request: &[u8] = &[17, 6, 0, 3, 0, 5];
        assert_eq!(desk.sent(), vec![request; times as usize]);
    }
    let (read, ms) = first_read(
        CONFIG.retries(2),
        once(|_| vec![(DELAY, Heard::Damaged(ReceiveErrors::CHECK))]),
    );
    assert_eq!((read, ms), (Ok(0x1007), FOR_NOTHING + SENDS + DELAY + 1));
    // An exception is an answer, and is not asked for again.
    let (read, ms) = first_read(
        CONFIG.retries(2),
        once(|_| vec![(DELAY, Heard::Frame(vec![17, 0x83, 2]))]),
    );
    assert_eq!(
        (read, ms),
        (
            Err(ClientError::Exception(Exception::IllegalDataAddress)),
            SENDS + DELAY + 1
        )
    );
}

#[test]
fn an_invalid_request_is_refused_and_not_sent() {
    let mut desk = Desk::<1>::new(|_| vec![]);
    let client = desk.port.client(CONFIG);
    let (refused, ms) = desk.ask(async move {
        let mut cells = [0; 126];
        let mut bits = [false; 2001];
        [
            client.read_holding_registers(0, 1, &mut cells[..1]).await,
            client.read_holding_registers(248, 1, &mut cells[..1]).await,
            client.read_holding_registers(17, 1, &mut cells).await,
            client.read_holding_registers(17, 1, &mut []).await,
            client.read_coils(17, 1, &mut bits).await,
            client
                .read_input_registers(17, 65_535, &mut cells[..2])
                .await,
            client.read_packed_coils(17, 0, 9, &mut [0]).await,
        ]
    });
    assert_eq!(ms, 0);
    assert!(desk.sent().is_empty());
    let expected = [
        RequestError::Broadcast { function: 3 },
        RequestError::Unit { unit: 248 },
        RequestError::Count {
            count: 126,
            max: 125,
        },
        RequestError::Count { count: 0, max: 125 },
        RequestError::Count {
            count: 2001,
            max: 2000,
        },
        RequestError::End {
            first: 65_535,
            count: 2,
        },
        RequestError::Room { room: 1, needed: 2 },
    ];
    assert_eq!(
        refused,
        expected.map(|error| Err(ClientError::Request(error)))
    );
    assert_eq!(
        ClientError::Request(expected[2]).to_string(),
        "not sent: count is 126, must be 1..=125"
    );
}

#[test]
fn force_listen_only_mode_has_no_answer_to_wait_for() {
    let mut desk = Desk::<1>::new(|_| vec![]);
    let client = desk.port.client(CONFIG);
    let (told, ms) = desk.ask(async move { client.diagnose(17, Diagnostic::ListenOnly).await });
    assert_eq!((told, ms), (Ok(0), SENDS + 100));
    assert_eq!(desk.sent(), [[17, 8, 0, 4, 0, 0]]);
}

#[test]
fn a_request_waits_for_silence_and_gives_up_after_a_timeout() {
    // Twice somebody begins to talk when it is about to go out.
    let mut desk = Desk::<1>::new(once(|answer| vec![(DELAY, Heard::Frame(answer))]));
    desk.wire.interrupts.borrow_mut().extend([20, 30]);
    let client = desk.port.client(CONFIG);
    let (write, ms) = desk.ask(async move { client.write_register(17, 3, 7).await });
    assert_eq!((write, ms), (Ok(()), 50 + SENDS + DELAY + 1));
    assert_eq!(desk.sent().len(), 1);

    desk.wire.interrupts.borrow_mut().extend([60, 60]);
    let (write, ms) = desk.ask(async move { client.write_register(17, 3, 7).await });
    assert_eq!((write, ms), (Err(ClientError::NoSilence), TIMEOUT));
    assert_eq!(desk.sent().len(), 1);
    desk.run(100);
    let (write, _) = desk.ask(async move { client.write_register(17, 3, 7).await });
    assert_eq!(write, Ok(()));
    // Whoever looks sees what went out, when it is out, and nothing of what did not.
    let sent = desk.wire.sent.borrow();
    let out: Vec<_> = sent
        .iter()
        .map(|(began, bytes)| (began + SENDS, bytes.clone()))
        .collect();
    assert_eq!(*desk.wire.shown.borrow(), out);
}

/// Fault 9 of other clients: the answer to function 10 could not be decoded.
#[test]
fn function_10_is_answered_with_address_and_count() {
    let mut desk = Desk::<1>::new(once(|answer| {
        assert_eq!(answer, [17, 16, 0, 1, 0, 2]);
        vec![(DELAY, Heard::Frame(answer))]
    }));
    let client = desk.port.client(CONFIG);
    let (write, _) =
        desk.ask(async move { client.write_registers(17, 1, &[0x000A, 0x0102]).await });
    assert_eq!(write, Ok(()));
    // The example of the standard (APP 6.12).
    assert_eq!(desk.sent(), [[17, 16, 0, 1, 0, 2, 4, 0, 0x0A, 1, 2]]);
}
