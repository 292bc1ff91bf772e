//! A repeated request of each function, and answers that come soon, late and in a wrong shape.

use multidrop_protocol::sniffer::{Counts, Direction, Sniffer};

const PATIENCE_MS: u32 = 100;
const PATIENCE_US: u64 = 1000 * PATIENCE_MS as u64;

/// What an answer is told by.
#[derive(Clone, Copy, PartialEq)]
enum By {
    /// Its shape, at any time.
    Shape,
    /// Its time: it is the request once more, or may be.
    Time,
}

/// Requests with their answers, unit id left out.
const EXCHANGES: &[(&[u8], &[u8], By)] = &[
    (&[1, 0, 0x13, 0, 0x13], &[1, 3, 0xCD, 0x6B, 0x05], By::Time),
    (&[1, 0, 0, 0, 8], &[1, 1, 0xFF], By::Shape),
    (&[2, 0, 0xC4, 0, 0x16], &[2, 3, 0xAC, 0xDB, 0x35], By::Time),
    (&[2, 0, 0xC4, 0, 9], &[2, 2, 0xAC, 0x01], By::Shape),
    (&[3, 0, 0x6B, 0, 2], &[3, 4, 2, 0x2B, 0, 0], By::Shape),
    (&[4, 0, 8, 0, 1], &[4, 2, 0, 10], By::Shape),
    (&[5, 0, 0xAC, 0xFF, 0], &[5, 0, 0xAC, 0xFF, 0], By::Time),
    (&[6, 0, 1, 0, 3], &[6, 0, 1, 0, 3], By::Time),
    (&[7], &[7, 0x6D], By::Shape),
    (&[8, 0, 0, 0xA5, 0x37], &[8, 0, 0, 0xA5, 0x37], By::Time),
    (&[8, 0, 0x0B, 0, 0], &[8, 0, 0x0B, 1, 2], By::Time),
    (&[0x0B], &[0x0B, 0xFF, 0xFF, 1, 8], By::Shape),
    (&[0x0C], &[0x0C, 8, 0, 0, 1, 8, 1, 0x21, 0x20, 0], By::Shape),
    (
        &[0x0F, 0, 0x13, 0, 10, 2, 0xCD, 1],
        &[0x0F, 0, 0x13, 0, 10],
        By::Shape,
    ),
    (
        &[0x10, 0, 1, 0, 2, 4, 0, 10, 1, 2],
        &[0x10, 0, 1, 0, 2],
        By::Shape,
    ),
    (&[0x11], &[0x11, 2, 0x11, 0xFF], By::Shape),
    (
        &[0x14, 7, 6, 0, 4, 0, 1, 0, 2],
        &[0x14, 6, 5, 6, 0x0D, 0xFE, 0, 0x20],
        By::Shape,
    ),
    (
        &[0x15, 9, 6, 0, 4, 0, 7, 0, 1, 6, 0xAF],
        &[0x15, 9, 6, 0, 4, 0, 7, 0, 1, 6, 0xAF],
        By::Time,
    ),
    (
        &[0x16, 0, 4, 0, 0xF2, 0, 0x25],
        &[0x16, 0, 4, 0, 0xF2, 0, 0x25],
        By::Time,
    ),
    (
        &[0x17, 0, 3, 0, 2, 0, 14, 0, 1, 2, 0, 0xFF],
        &[0x17, 4, 0, 0xFE, 10, 0xCD],
        By::Shape,
    ),
    (
        &[0x18, 4, 0xDE],
        &[0x18, 0, 6, 0, 2, 1, 0xB8, 0x12, 0x84],
        By::Shape,
    ),
    (
        &[0x2B, 0x0E, 1, 0],
        &[0x2B, 0x0E, 1, 1, 0, 0, 1, 0, 2, 0x41, 0x42],
        By::Shape,
    ),
    (&[0x41, 1, 2], &[0x41, 2, 1], By::Time),
    (&[0x41, 1, 2], &[0x41, 1, 2], By::Time),
    (&[0x64], &[0x64, 7], By::Time),
];

const UNIT: u8 = 17;

/// A bus with a clock.
struct Bus {
    sniffer: Sniffer,
    now_us: u64,
}

impl Bus {
    fn new() -> Self {
        Bus {
            sniffer: Sniffer::new(PATIENCE_MS),
            now_us: 5,
        }
    }

    fn hears(&mut self, after_us: u64, pdu: &[u8]) -> Direction {
        self.now_us += after_us;
        self.sniffer.frame(&[&[UNIT], pdu].concat(), self.now_us)
    }

    fn counts(&self) -> [u32; 4] {
        let Counts {
            requests,
            answers,
            exceptions,
            unanswered,
            ..
        } = self.sniffer.counts();
        [requests, answers, exceptions, unanswered]
    }
}

#[test]
fn a_repeated_request_is_one_and_its_answer_is_the_answer() {
    for (request, answer, _) in EXCHANGES {
        for repeats in 0..3 {
            let mut bus = Bus::new();
            assert_eq!(bus.hears(0, request), Direction::Request);
            for _ in 0..repeats {
                // Once a client has waited in vain.
                let seen = bus.hears(PATIENCE_US + 1, request);
                assert_eq!(seen, Direction::Request, "{request:02X?}");
            }
            let seen = bus.hears(PATIENCE_US, answer);
            assert_eq!(seen, Direction::Answer, "{answer:02X?}");
            assert_eq!(bus.counts(), [repeats + 1, 1, 0, repeats]);
            // It is answered: what looks like an answer once more is a request.
            assert_eq!(bus.hears(10, answer), Direction::Request);
            assert_eq!(bus.counts(), [repeats + 2, 1, 0, repeats]);
        }
    }
}

#[test]
fn a_repeated_request_may_be_refused() {
    for (request, _, _) in EXCHANGES {
        let mut bus = Bus::new();
        let refusal = [request[0] | 0x80, 6];
        for round in 0..3 {
            assert_eq!(bus.hears(PATIENCE_US + 1, request), Direction::Request);
            // Late or soon: nothing else looks so.
            let after = PATIENCE_US * round;
            assert_eq!(bus.hears(after, &refusal), Direction::Exception);
            // It has no longer any to refuse.
            assert_eq!(bus.hears(1, &refusal), Direction::Request);
        }
        assert_eq!(bus.counts(), [6, 0, 3, 2]);
    }
}

/// Where answers are never the same bytes, not even the next moment makes a repeat one.
#[test]
fn a_request_that_no_answer_equals_may_be_repeated_at_once() {
    for (request, answer, _) in EXCHANGES {
        let equals = [5, 6, 8, 0x15, 0x16, 0x41, 0x64].contains(&request[0]);
        for after in [0, 1, 1000, PATIENCE_US] {
            let mut bus = Bus::new();
            bus.hears(0, request);
            let expected = match equals {
                true => Direction::Answer,
                false => Direction::Request,
            };
            assert_eq!(bus.hears(after, request), expected, "{request:02X?}");
            if !equals {
                assert_eq!(bus.hears(1, answer), Direction::Answer, "{answer:02X?}");
            }
        }
    }
}

#[test]
fn an_answer_known_by_its_shape_is_one_at_any_time() {
    for (request, answer, by) in EXCHANGES {
        for (after, is_answer) in [
            (PATIENCE_US - 1, true),
            (PATIENCE_US, true),
            (PATIENCE_US + 1, *by == By::Shape),
            (50 * PATIENCE_US, *by == By::Shape),
        ] {
            let mut bus = Bus::new();
            bus.hears(0, request);
            let expected = match is_answer {
                true => Direction::Answer,
                false => Direction::Request,
            };
            assert_eq!(
                bus.hears(after, answer),
                expected,
                "{answer:02X?} after {after}"
            );
        }
    }
}

/// Time is that of the last try.
#[test]
fn patience_begins_anew_with_each_repeat() {
    for (request, answer, _) in EXCHANGES.iter().filter(|(.., by)| *by == By::Time) {
        let mut bus = Bus::new();
        bus.hears(0, request);
        bus.hears(PATIENCE_US + 1, request);
        assert_eq!(bus.hears(PATIENCE_US, answer), Direction::Answer);
    }
}

#[test]
fn damage_between_a_request_and_its_answer_leaves_it_open() {
    for (request, answer, _) in EXCHANGES {
        let mut bus = Bus::new();
        bus.hears(0, request);
        bus.sniffer.damaged();
        assert_eq!(bus.hears(PATIENCE_US + 1, request), Direction::Request);
        bus.sniffer.damaged();
        assert_eq!(bus.hears(1, answer), Direction::Answer, "{answer:02X?}");
        assert_eq!(bus.counts(), [2, 1, 0, 1]);
        assert_eq!(bus.sniffer.counts().damaged, 2);
    }
}

/// Somebody else's frame is no answer, whatever it looks like, and takes its place.
#[test]
fn an_answer_is_of_the_unit_and_the_function_that_were_asked() {
    for (request, answer, _) in EXCHANGES {
        let mut bus = Bus::new();
        bus.hears(0, request);
        bus.now_us += 1;
        let other = [&[UNIT + 1], *answer].concat();
        let seen = bus.sniffer.frame(&other, bus.now_us);
        assert_eq!(seen, Direction::Request, "{other:02X?}");

        let mut bus = Bus::new();
        bus.hears(0, request);
        let mut other = answer.to_vec();
        other[0] ^= 0x20;
        assert_eq!(bus.hears(1, &other), Direction::Request, "{other:02X?}");
    }
}

#[test]
fn a_broadcast_is_repeated_and_not_answered() {
    for (request, answer, _) in EXCHANGES {
        let mut sniffer = Sniffer::new(PATIENCE_MS);
        let broadcast = [&[0], *request].concat();
        for _ in 0..3 {
            assert_eq!(sniffer.frame(&broadcast, 1), Direction::Request);
        }
        let answer = [&[0], *answer].concat();
        assert_eq!(sniffer.frame(&answer, 2), Direction::Request);
        let heard = sniffer.counts();
        assert_eq!(
            (heard.requests, heard.broadcasts, heard.unanswered),
            (4, 4, 0)
        );
    }
}

/// What is one byte too long or too short for an answer is none, where the function says how long one is.
#[test]
fn an_answer_has_the_shape_that_its_function_has() {
    for (request, answer, _) in EXCHANGES {
        let longer = [answer, &[0x11][..]].concat();
        let shorter = &answer[..answer.len() - 1];
        let (may_be_longer, may_be_shorter) = match request[0] {
            // Any length at all.
            8 | 0x41 | 0x64 => (true, true),
            // From some length on: identification and a queue say inside how long they are.
            0x18 | 0x2B => (true, true),
            _ => (false, false),
        };
        for (other, may_be) in [(&longer[..], may_be_longer), (shorter, may_be_shorter)] {
            let mut bus = Bus::new();
            bus.hears(0, request);
            let expected = match may_be {
                true => Direction::Answer,
                false => Direction::Request,
            };
            assert_eq!(bus.hears(1, other), expected, "{other:02X?}");
        }
    }
    for (request, other) in [
        // Half a register, a group that begins as a request's, an exception of two bytes.
        (&[3, 0, 0x6B, 0, 2][..], &[3, 3, 2, 0x2B, 0][..]),
        (&[4, 0, 8, 0, 1], &[4, 1, 0]),
        (
            &[0x14, 7, 6, 0, 4, 0, 1, 0, 2],
            &[0x14, 7, 6, 0, 4, 0, 1, 0, 3],
        ),
        (&[0x18, 4, 0xDE], &[0x18, 0, 6, 0]),
        (&[0x2B, 0x0E, 1, 0], &[0x2B, 0x0E, 2, 0]),
        (&[0x2B, 0x0E, 1, 0], &[0x2B, 0x0E, 1, 1, 0, 0]),
        (&[3, 0, 0x6B, 0, 2], &[0x83, 2, 0]),
        (&[3, 0, 0x6B, 0, 2], &[0x83]),
    ] {
        let mut bus = Bus::new();
        bus.hears(0, request);
        assert_eq!(bus.hears(1, other), Direction::Request, "{other:02X?}");
    }
}

/// Whoever is asked answers it with an exception, so what is heard again is asked again.
#[test]
fn a_request_of_a_wrong_length_is_no_answer_to_itself() {
    for request in [
        &[5, 0, 1, 0xFF][..],
        &[6, 0, 1, 0, 7, 0],
        &[0x16, 0, 4, 0, 0xF2, 0],
        &[0x16, 0, 4, 0, 0xF2, 0, 0x25, 0],
    ] {
        let mut bus = Bus::new();
        bus.hears(0, request);
        assert_eq!(bus.hears(1, request), Direction::Request, "{request:02X?}");
    }
}
