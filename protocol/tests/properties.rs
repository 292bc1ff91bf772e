//! Any input: no panic, no answer that is too long, and the state and answer of a plain reading of the standard.

mod common;

use common::{LIMITED, LOCKED, Tables, UNIT, ask, exists};
use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::rtu::{self, Reception};
use multidrop_protocol::{Adu, UNIT_MAX};
use proptest::prelude::*;

/// What the standard says to a request, in the plainest way and without the crate under test: the answer, and the tables
/// changed. Shares no code with the server.
fn by_the_book(tables: &mut Tables, request: &[u8]) -> Option<Vec<u8>> {
    let (unit, function, rest) = (request[0], request[1], &request[2..]);
    if unit != UNIT && unit != 0 {
        return None;
    }
    if unit == 0 && (1..=4).contains(&function) {
        return None;
    }
    let refusal = |code: u8| (unit != 0).then(|| vec![unit, function | 0x80, code]);
    let word = |at: usize| u32::from(rest[at]) << 8 | u32::from(rest[at + 1]);
    if !matches!(function, 1..=6 | 15 | 16) {
        return refusal(1);
    }
    if rest.len() < 4 {
        return refusal(3);
    }
    let (first, quantity) = (word(0), word(2));
    let reads = |most: u32| rest.len() == 4 && quantity >= 1 && quantity <= most;
    let (well_formed, count) = match function {
        1 | 2 => (reads(2000), quantity),
        3 | 4 => (reads(125), quantity),
        5 => (rest.len() == 4 && (quantity == 0xFF00 || quantity == 0), 1),
        6 => (rest.len() == 4, 1),
        _ => {
            let (most, bytes) = if function == 15 {
                (1968, quantity.div_ceil(8))
            } else {
                (123, quantity * 2)
            };
            let data = rest.len() as u32;
            let fits = data >= 5 && u32::from(rest[4]) == bytes && data == 5 + bytes;
            (fits && quantity >= 1 && quantity <= most, quantity)
        }
    };
    if !well_formed {
        return refusal(3);
    }
    if (first..first + count).any(|address| !exists(address)) {
        return refusal(2);
    }
    let mut answer = vec![unit, function];
    match function {
        1 | 2 => {
            let table = if function == 1 {
                &tables.coils
            } else {
                &tables.discrete_inputs
            };
            let mut bytes = vec![0u8; count.div_ceil(8) as usize];
            for index in 0..count {
                if table[(first + index) as usize] {
                    bytes[(index / 8) as usize] += 2u8.pow(index % 8);
                }
            }
            answer.push(bytes.len() as u8);
            answer.extend(bytes);
            return Some(answer);
        }
        3 | 4 => {
            let table = if function == 3 {
                &tables.holding
            } else {
                &tables.input
            };
            answer.push(count as u8 * 2);
            for address in first..first + count {
                answer.push((table[address as usize] >> 8) as u8);
                answer.push(table[address as usize] as u8);
            }
            return Some(answer);
        }
        5 | 15 => {
            if (first..first + count).contains(&LOCKED.into()) {
                return refusal(7);
            }
            if tables.broken {
                return refusal(4);
            }
            for index in 0..count {
                let on = if function == 5 {
                    quantity != 0
                } else {
                    rest[5 + (index / 8) as usize] / 2u8.pow(index % 8) % 2 == 1
                };
                tables.coils[(first + index) as usize] = on;
            }
        }
        _ => {
            let value = |index: u32| {
                if function == 6 {
                    quantity
                } else {
                    word(5 + 2 * index as usize)
                }
            };
            if (0..count).any(|index| first + index == LIMITED.into() && value(index) > 200) {
                return refusal(3);
            }
            if tables.broken {
                return refusal(4);
            }
            for index in 0..count {
                tables.holding[(first + index) as usize] = value(index) as u16;
            }
        }
    }
    answer.extend(&rest[..4]);
    (unit != 0).then_some(answer)
}

/// Addresses where something changes, and others.
fn address() -> impl Strategy<Value = u16> {
    prop_oneof![
        any::<u16>(),
        0..130u16,
        2990..3010u16,
        64_990..65_010u16,
        65_530..=65_535u16,
        Just(0x00FF),
        Just(0x0100)
    ]
}

fn quantity() -> impl Strategy<Value = u16> {
    prop_oneof![
        any::<u16>(),
        0..20u16,
        118..130u16,
        1960..2010u16,
        Just(0xFF00)
    ]
}

fn unit() -> impl Strategy<Value = u8> {
    prop_oneof![8 => Just(UNIT), 2 => Just(0), 1 => any::<u8>()]
}

/// A request that is right, or nearly.
fn request() -> impl Strategy<Value = Vec<u8>> {
    let function =
        prop_oneof![6 => 1..=6u8, 4 => prop_oneof![Just(15u8), Just(16u8)], 1 => any::<u8>()];
    let data = prop::collection::vec(any::<u8>(), 0..=247);
    let slip = prop_oneof![12 => Just(0i32), 1 => -3..=3i32];
    (
        unit(),
        function,
        address(),
        quantity(),
        data,
        slip.clone(),
        slip,
    )
        .prop_map(
            |(unit, function, address, quantity, data, byte_count_slip, length_slip)| {
                let mut request = common::words(unit, function, address, quantity);
                if matches!(function, 15 | 16) {
                    let bytes = match function {
                        15 => usize::from(quantity).div_ceil(8),
                        _ => usize::from(quantity) * 2,
                    };
                    request.push((bytes as i32 + byte_count_slip) as u8);
                    request.extend(data.iter().cycle().take(if data.is_empty() {
                        0
                    } else {
                        bytes.min(247)
                    }));
                }
                let len = (request.len() as i32 + length_slip).clamp(2, 254) as usize;
                request.resize(len, 0x55);
                request
            },
        )
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_bytes_in(request in prop::collection::vec(any::<u8>(), 2..=254), own in any::<bool>()) {
        let mut request = request;
        if own {
            request[0] = UNIT;
        }
        let (mut tables, mut book) = (Tables::new(), Tables::new());
        let answer = ask(&mut tables, &request);
        prop_assert!(answer.as_ref().is_none_or(|answer| answer.len() <= 254));
        prop_assert_eq!(answer, by_the_book(&mut book, &request));
        prop_assert!(tables == book);
    }

    #[test]
    fn sequences_of_requests(requests in prop::collection::vec(request(), 1..40), broken in any::<bool>()) {
        let (mut tables, mut book) = (Tables::new(), Tables::new());
        tables.broken = broken;
        book.broken = broken;
        for request in requests {
            let before = tables.clone();
            let answer = ask(&mut tables, &request);
            prop_assert!(answer.as_ref().is_none_or(|answer| answer.len() <= 254));
            if answer.as_ref().is_some_and(|answer| answer[1] & 0x80 != 0) {
                prop_assert!(tables == before, "a refused request changed something: {:02X?}", request);
            }
            prop_assert_eq!(answer, by_the_book(&mut book, &request), "{:02X?}", request);
            prop_assert!(tables == book, "{:02X?}", request);
        }
    }

    #[test]
    fn any_length_with_any_frame(bytes in any::<[u8; 32]>(), len in any::<u8>(), unit in unit()) {
        let mut frame: Adu = [0xFF; 256];
        frame[..32].copy_from_slice(&bytes);
        frame[0] = unit;
        let server = common::server();
        let mut tables = Tables::new();
        let plan = server.prepare(&mut tables, &mut frame, len);
        let answer = server.commit(&mut tables, &mut frame, len, plan);
        prop_assert!(answer == 0 || (3..=254).contains(&answer));
    }

    #[test]
    fn encode_and_decode(body in prop::collection::vec(any::<u8>(), 2..=254)) {
        let mut out = [0; 256];
        let adu = rtu::encode(&body, &mut out).unwrap();
        prop_assert_eq!(rtu::decode(adu), Ok(&body[..]));
    }

    #[test]
    fn a_frame_decoded_byte_by_byte_equals_the_whole(bytes in prop::collection::vec(any::<u8>(), 0..300), good in any::<bool>()) {
        let mut bytes = bytes;
        if good {
            bytes.extend(multidrop_protocol::crc::checksum(&bytes).to_le_bytes());
        }
        let mut frame: Adu = [0; 256];
        let mut reception = Reception::new();
        for &byte in &bytes {
            reception.push(&mut frame, byte);
        }
        let heard = reception.finish();
        match rtu::decode(&bytes) {
            Ok(body) => {
                prop_assert_eq!(heard.errors, ReceiveErrors::NONE);
                prop_assert_eq!(body, &frame[..heard.len.into()]);
                prop_assert_eq!(common::send(&frame, heard.len), bytes);
            }
            // What no longer fits is not summed up, so a frame too long may have a wrong sum or not.
            Err(_) if bytes.len() > 256 => prop_assert!(heard.errors.contains(ReceiveErrors::LENGTH)),
            Err(errors) => prop_assert_eq!(heard.errors, errors),
        }
    }

    #[test]
    fn requests_to_other_units_are_ignored(request in request(), unit in 1..=255u8) {
        let mut request = request;
        request[0] = if unit == UNIT { UNIT_MAX + 1 } else { unit };
        let mut tables = Tables::new();
        let before = tables.clone();
        prop_assert_eq!(ask(&mut tables, &request), None);
        prop_assert!(tables == before);
    }
}
