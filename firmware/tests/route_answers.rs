//! Answers over a route: only valid answers are passed on, and a request without an answer gets none.

mod desk;

use desk::routed::{open, sent};
use desk::{Desk, Heard, SENDS, Wire};
use multidrop::ClientConfig;
use multidrop::protocol::frame::ReceiveErrors;

const TIMEOUT: u64 = 50;
const TURNAROUND: u64 = 30;
const CONFIG: ClientConfig = ClientConfig::new()
    .timeout_ms(TIMEOUT as u16)
    .turnaround_ms(TURNAROUND as u16);
/// From the request's end to the answer's.
const DELAY: u64 = 10;
/// An exchange that is not answered, and the way through the router and back.
const IN_VAIN: u64 = SENDS + TIMEOUT + SENDS + 6;

/// What the client is told of this request, to unit 4, where these come from behind, of unit 17.
fn told(request: &[u8], behind: &[Heard]) -> Vec<Vec<u8>> {
    let behind = behind.to_vec();
    let mut desk = Desk::<1>::new(move |_| {
        let heard = behind.iter().cloned().enumerate();
        heard
            .map(|(place, heard)| (DELAY + 3 * place as u64, heard))
            .collect()
    });
    let through = desk.port.client(CONFIG);
    let (wire, _) = open(&mut desk, through);
    wire.comes(1, Heard::Frame([&[4], request].concat()));
    desk.run(2 * IN_VAIN);
    assert_eq!(desk.sent(), [[&[17], request].concat()]);
    assert!(!wire.is_lent() && !desk.wire.is_lent());
    let told = sent(wire);
    assert!(told.iter().all(|told| told[0] == 4));
    told.iter().map(|told| told[1..].to_vec()).collect()
}

fn answer(pdu: &[u8]) -> Heard {
    Heard::Frame([&[17], pdu].concat())
}

/// Exception 0B: the unit has not answered.
fn no_answer(request: &[u8]) -> Vec<Vec<u8>> {
    vec![vec![request[0] | 0x80, 0x0B]]
}

/// Each write and what it echoes.
const WRITES: &[(&[u8], usize)] = &[
    (&[0x05, 0x00, 0xAC, 0xFF, 0x00], 5),
    (&[0x05, 0x00, 0xAC, 0x00, 0x00], 5),
    (&[0x06, 0x00, 0x01, 0x00, 0x03], 5),
    (&[0x0F, 0x00, 0x13, 0x00, 0x0A, 0x02, 0xCD, 0x01], 5),
    (
        &[0x10, 0x00, 0x01, 0x00, 0x02, 0x04, 0x00, 0x0A, 0x01, 0x02],
        5,
    ),
    (
        &[
            0x15, 0x0D, 0x06, 0x00, 0x04, 0x00, 0x07, 0x00, 0x03, 0x06, 0xAF, 0x04, 0xBE, 0x10,
            0x0D,
        ],
        15,
    ),
    (&[0x16, 0x00, 0x04, 0x00, 0xF2, 0x00, 0x25], 7),
];

#[test]
fn a_write_is_done_when_its_echo_is_right_in_every_byte() {
    for (request, echoed) in WRITES {
        let echo = &request[..*echoed];
        assert_eq!(told(request, &[answer(echo)]), [echo.to_vec()]);
        for place in 1..*echoed {
            for wrong in [0x01, 0x80] {
                let mut other = echo.to_vec();
                other[place] ^= wrong;
                assert_eq!(
                    told(request, &[answer(&other)]),
                    no_answer(request),
                    "{other:02X?}"
                );
            }
        }
        for len in [1, 2, 3, echoed - 1] {
            assert_eq!(told(request, &[answer(&echo[..len])]), no_answer(request));
        }
        let longer = [echo, &[0]].concat();
        assert_eq!(told(request, &[answer(&longer)]), no_answer(request));
        // A wrong one does not end the wait for the right one.
        let mut other = echo.to_vec();
        other[2] ^= 1;
        let both = [answer(&other), answer(echo)];
        assert_eq!(told(request, &both), [echo.to_vec()]);
    }
}

#[test]
fn a_read_is_answered_only_with_the_length_it_requested() {
    // Function, how many, and bytes of data.
    for (function, count, bytes) in [
        (1, 1, 1),
        (1, 8, 1),
        (1, 9, 2),
        (2, 19, 3),
        (2, 2000, 250),
        (3, 1, 2),
        (3, 125, 250),
        (4, 3, 6),
        (0x17, 2, 4),
    ] {
        let [high, low] = u16::to_be_bytes(count);
        let mut request = vec![function, 0, 7, high, low];
        if function == 0x17 {
            request.extend([0, 9, 0, 1, 2, 0xAB, 0xCD]);
        }
        let of = |bytes: usize| {
            let mut pdu = vec![function, bytes as u8];
            pdu.resize(2 + bytes, 0x5A);
            pdu
        };
        assert_eq!(told(&request, &[answer(&of(bytes))]), [of(bytes)]);
        for wrong in [bytes - 1, bytes + 1, bytes + 2] {
            assert_eq!(
                told(&request, &[answer(&of(wrong))]),
                no_answer(&request),
                "{function}: {wrong} bytes"
            );
        }
    }
}

#[test]
fn a_diagnostic_is_answered_with_its_sub_function() {
    let request = [8, 0, 0x0B, 0, 0];
    let counter = [8, 0, 0x0B, 0x12, 0x34];
    assert_eq!(told(&request, &[answer(&counter)]), [counter]);
    for other in [
        &[8, 0, 0x0C, 0x12, 0x34][..],
        &[8, 1, 0x0B, 0x12, 0x34],
        &[8, 0],
        &[8],
    ] {
        assert_eq!(told(&request, &[answer(other)]), no_answer(&request));
    }
    // Data of any length come back.
    for data in [&[][..], &[1], &[1, 2, 3, 4]] {
        let request = [&[8, 0, 0], data].concat();
        assert_eq!(told(&request, &[answer(&request)]), [request]);
    }
}

#[test]
fn answers_to_other_functions_are_passed_on_unchecked() {
    for (request, behind) in [
        (&[0x07][..], &[0x07, 0x6D][..]),
        // With no sub-function.
        (&[0x08, 0], &[0x88, 3]),
        (&[0x0B], &[0x0B, 0xFF, 0xFF, 1, 8]),
        (&[0x0C], &[0x0C, 7, 0, 0, 1, 8, 1, 0x21, 0x20]),
        (&[0x11], &[0x11, 2, 17, 0xFF]),
        (
            &[0x14, 7, 6, 0, 4, 0, 1, 0, 1],
            &[0x14, 4, 3, 6, 0x0D, 0xFE],
        ),
        (&[0x18, 4, 0xDE], &[0x18, 0, 4, 0, 1, 1, 0xB8]),
        (&[0x2B, 0x0E, 1, 0], &[0x2B, 0x0E, 1, 1, 0, 0, 0]),
        (&[0x41, 1, 2], &[0x41, 2, 1]),
        (&[0x7F], &[0x7F]),
        // Too short and too long for what they seem to be: the unit says so.
        (&[0x03, 0, 1, 0], &[0x83, 3]),
        (&[0x05, 0, 1, 0xFF], &[0x85, 3]),
        (&[0x16, 0, 4, 0, 0xF2, 0, 0x25, 0], &[0x96, 3]),
    ] {
        assert_eq!(told(request, &[answer(behind)]), [behind.to_vec()]);
    }
}

#[test]
fn a_function_code_above_127_is_refused_at_once() {
    for function in [0, 0x80, 0x83, 0xFF] {
        let mut desk = Desk::<1>::new(|_| vec![]);
        let through = desk.port.client(CONFIG);
        let (wire, _) = open(&mut desk, through);
        wire.comes(1, Heard::Frame(vec![4, function, 0, 1, 0, 1]));
        desk.run(SENDS + 4);
        assert_eq!(sent(wire), [[4, function | 0x80, 1]]);
        assert_eq!(desk.sent(), [[0; 0]; 0]);
    }
}

#[test]
fn a_frame_that_is_no_answer_is_exception_0b() {
    let request = [3, 0, 7, 0, 1];
    let right = [3, 2, 0x12, 0x34];
    let good = answer(&right);
    for (behind, expected) in [
        (vec![], no_answer(&request)),
        (
            vec![Heard::Frame(vec![18, 3, 2, 1, 2])],
            no_answer(&request),
        ),
        // The client's name for it, which it does not have there.
        (vec![Heard::Frame(vec![4, 3, 2, 1, 2])], no_answer(&request)),
        (vec![answer(&[4, 2, 1, 2])], no_answer(&request)),
        (
            vec![Heard::Damaged(ReceiveErrors::CHECK)],
            no_answer(&request),
        ),
        (vec![Heard::Void([&[17], &right[..]].concat())], {
            no_answer(&request)
        }),
        (
            vec![Heard::Damaged(ReceiveErrors::CHECK), good.clone()],
            vec![right.to_vec()],
        ),
        (vec![good.clone(), good], vec![right.to_vec()]),
        (vec![answer(&[0x83, 2])], vec![vec![0x83, 2]]),
        (vec![answer(&[0x83, 0x55])], vec![vec![0x83, 0x55]]),
        (
            vec![answer(&[0x83, 2]), answer(&right)],
            vec![vec![0x83, 2]],
        ),
        // That of another function, and one that is too long.
        (vec![answer(&[0x84, 2])], no_answer(&request)),
        (vec![answer(&[0x83, 2, 0])], no_answer(&request)),
        // Not yet.
        (
            vec![answer(&[0x83, 5]), answer(&right)],
            vec![right.to_vec()],
        ),
    ] {
        assert_eq!(told(&request, &behind), expected, "{behind:02X?}");
    }
}

/// A router in front of one unit, 17, that answers as it is told to.
fn wired(
    peer: impl FnMut(&[u8]) -> Vec<(u64, Heard)> + 'static,
) -> (Desk<'static, 1>, &'static Wire) {
    let mut desk = Desk::<1>::new(peer);
    let through = desk.port.client(CONFIG);
    let (wire, _) = open(&mut desk, through);
    (desk, wire)
}

const LISTEN_ONLY: [u8; 5] = [8, 0, 4, 0, 0];

/// There is no answer to it (APP 6.8, sub-function 04), so none has failed to come.
#[test]
fn silence_after_force_listen_only_mode_is_no_exception() {
    let read = [3, 0, 7, 0, 1];
    let (mut desk, wire) = wired(|request| match request {
        [2, ..] => vec![(DELAY, Heard::Frame(vec![2, 3, 2, 0x12, 0x34]))],
        _ => vec![],
    });
    wire.comes(1, Heard::Frame([&[4][..], &LISTEN_ONLY].concat()));
    desk.run(10 * TIMEOUT);
    assert_eq!(sent(wire), [[0; 0]; 0]);
    assert!(!wire.is_lent() && !desk.wire.is_lent());
    // The unit does listen only, which is a matter of each request behind it; another one answers.
    wire.comes(1, Heard::Frame([&[4][..], &read].concat()));
    desk.run(IN_VAIN);
    assert_eq!(sent(wire), [[4, 0x83, 0x0B]]);
    wire.comes(1, Heard::Frame([&[2][..], &read].concat()));
    desk.run(IN_VAIN);
    assert_eq!(sent(wire).last(), Some(&vec![2, 3, 2, 0x12, 0x34]));
}

#[test]
fn after_force_listen_only_mode_the_turnaround_delay_passes() {
    let (mut desk, wire) = wired(|_| vec![]);
    wire.comes(1, Heard::Frame([&[4][..], &LISTEN_ONLY].concat()));
    wire.comes(SENDS + 8, Heard::Frame(vec![2, 3, 0, 7, 0, 1]));
    desk.run(IN_VAIN + TURNAROUND + SENDS + 8);
    let began: Vec<u64> = desk.wire.sent.borrow().iter().map(|sent| sent.0).collect();
    assert_eq!(began[1] - began[0], SENDS + TURNAROUND);
    assert_eq!(sent(wire), [[2, 0x83, 0x0B]]);
}

#[test]
fn an_answer_to_force_listen_only_mode_is_not_passed_on() {
    for answer in [&LISTEN_ONLY[..], &[0x88, 1]] {
        let heard = Heard::Frame([&[17], answer].concat());
        let (mut desk, wire) = wired(move |_| vec![(DELAY, heard.clone())]);
        wire.comes(1, Heard::Frame([&[4][..], &LISTEN_ONLY].concat()));
        desk.run(10 * TIMEOUT);
        assert_eq!(sent(wire), [[0; 0]; 0]);
    }
}

/// Only sub-function 04 as the standard has it: all else is answered, if only with an exception.
#[test]
fn silence_after_any_other_diagnostic_is_exception_0b() {
    for request in [
        &[8, 0, 4, 0, 1][..],
        &[8, 0, 4, 1, 0],
        &[8, 0, 4, 0],
        &[8, 0, 4, 0, 0, 0],
        &[8, 0, 4],
        &[8, 0, 3, 0, 0],
        &[8, 0, 5, 0, 0],
        &[8, 1, 4, 0, 0],
        &[8, 0, 1, 0, 0],
        &[8, 0, 0, 0, 4],
        &[3, 0, 4, 0, 0],
    ] {
        assert_eq!(told(request, &[]), no_answer(request), "{request:02X?}");
    }
}
