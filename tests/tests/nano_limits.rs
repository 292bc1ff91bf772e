//! Every limit of the eight functions at its edge and one past it, against the firmware in the
//! simulator. After each refusal the tables are read: a refused request changes nothing.

use multidrop_testkit::Rig;
use multidrop_testkit::frames::{adu, be, block, claimed, data, exception, words};

/// Items in each table.
const COUNT: u16 = 128;

/// `registers` with marks in its tables, and these as they are read.
fn marked() -> (Rig, Vec<u8>) {
    let mut rig = Rig::full();
    let values: Vec<u16> = (0..COUNT).map(|at| 0xa000 | at).collect();
    rig.expect(
        &block(1, 0x10, 0, 123, &be(&values[..123])),
        &words(1, 0x10, 0, 123),
    );
    rig.expect(
        &block(1, 0x10, 123, 5, &be(&values[123..])),
        &words(1, 0x10, 123, 5),
    );
    rig.expect(
        &block(1, 0x0f, 0, COUNT, &[0xa5; 16]),
        &words(1, 0x0f, 0, COUNT),
    );
    let state = rig.state(COUNT);
    (rig, state)
}

/// Asks on a node with marks; all must be refused with `code` and leave the marks alone.
#[track_caller]
fn all_refused(requests: &[Vec<u8>], code: u8) {
    let (mut rig, before) = marked();
    for request in requests {
        rig.expect(request, &exception(1, request[1], code));
        assert_eq!(rig.state(COUNT), before, "{request:02x?} changed something");
    }
}

#[test]
fn quantity_of_registers_read() {
    let (mut rig, _) = marked();
    for (function, base) in [(3, 0xa000), (4, 0x1000)] {
        for (first, quantity) in [(0, 1), (127, 1), (0, 124), (0, 125), (3, 125)] {
            let values: Vec<u16> = (first..first + quantity).map(|at| base | at).collect();
            rig.expect(
                &words(1, function, first, quantity),
                &data(1, function, &be(&values)),
            );
        }
    }
    let wrong =
        |function| [0, 126, 127, 128, 0x0101, 0x8001, 0xffff].map(|n| words(1, function, 0, n));
    all_refused(&[wrong(3), wrong(4)].concat(), 3);
}

#[test]
fn quantity_of_bits_read() {
    let (mut rig, _) = marked();
    let coil = |at: u16| 0xa5 >> (at % 8) & 1 == 1;
    let input = |at: u16| at.is_multiple_of(3);
    for (function, is_on) in [(1, coil as fn(u16) -> bool), (2, input)] {
        for (first, quantity) in
            (1..=COUNT)
                .map(|n| (0, n))
                .chain([(127, 1), (5, 9), (120, 8), (1, 127)])
        {
            let mut bytes = vec![0; usize::from(quantity.div_ceil(8))];
            for index in (0..quantity).filter(|index| is_on(first + index)) {
                bytes[usize::from(index / 8)] |= 1 << (index % 8);
            }
            rig.expect(
                &words(1, function, first, quantity),
                &data(1, function, &bytes),
            );
        }
    }
    // 2000 is a legal quantity, of which there are not so many here; 2001 is none.
    for (quantity, code) in [
        (129, 2),
        (1999, 2),
        (2000, 2),
        (2001, 3),
        (0, 3),
        (0xffff, 3),
    ] {
        all_refused(&[words(1, 1, 0, quantity), words(1, 2, 0, quantity)], code);
    }
}

#[test]
fn quantity_of_registers_written() {
    let mut rig = Rig::full();
    for quantity in [1, 2, 122, 123] {
        let values: Vec<u16> = (0..quantity).map(|at| at << 8 | quantity).collect();
        rig.expect(
            &block(1, 0x10, 5, quantity, &be(&values)),
            &words(1, 0x10, 5, quantity),
        );
        rig.expect(&words(1, 3, 5, quantity), &data(1, 3, &be(&values)));
    }
    all_refused(
        &[
            block(1, 0x10, 0, 0, &[]),
            block(1, 0x10, 0, 0, &[1, 2]),
            block(1, 0x10, 0, 124, &[0xee; 246]),
            claimed(1, 0x10, 0, 124, 248, &[0xee; 246]),
            block(1, 0x10, 0, 129, &[1, 2]),
            block(1, 0x10, 0, 0x8001, &[1, 2]),
        ],
        3,
    );
}

#[test]
fn a_write_of_124_registers_does_not_fit_a_frame() {
    let (mut rig, before) = marked();
    let request = block(1, 0x10, 0, 124, &[0xee; 248]);
    assert_eq!(request.len(), 257);
    rig.expect_silence(&request);
    assert_eq!(rig.state(COUNT), before);
}

#[test]
fn quantity_of_coils_written() {
    let mut rig = Rig::full();
    for quantity in [1u16, 7, 8, 9, 127, 128] {
        let count = usize::from(quantity.div_ceil(8));
        rig.expect(
            &block(1, 0x0f, 0, quantity, &vec![0xff; count]),
            &words(1, 0x0f, 0, quantity),
        );
        // Those after the last are still off.
        let mut bytes = [0; 16];
        for at in 0..usize::from(quantity) {
            bytes[at / 8] |= 1 << (at % 8);
        }
        rig.expect(&words(1, 1, 0, COUNT), &data(1, 1, &bytes));
        rig.expect(
            &block(1, 0x0f, 0, COUNT, &[0; 16]),
            &words(1, 0x0f, 0, COUNT),
        );
    }
    // 1968 is a legal quantity, of which there are not so many here; 1969 is none.
    let longest = block(1, 0x0f, 0, 1968, &[0xff; 246]);
    assert_eq!(longest.len(), 255);
    all_refused(&[longest, block(1, 0x0f, 0, 129, &[0xff; 17])], 2);
    all_refused(
        &[
            block(1, 0x0f, 0, 1969, &[0xff; 247]),
            block(1, 0x0f, 0, 0, &[]),
            block(1, 0x0f, 0, 0, &[1]),
            // Their byte counts are right in eight bits.
            block(1, 0x0f, 0, 2049, &[0xff]),
            block(1, 0x0f, 0, 4016, &[0xff; 246]),
        ],
        3,
    );
}

#[test]
fn values_of_a_single_coil() {
    let mut rig = Rig::full();
    for at in [0, 1, 127] {
        for (value, bit) in [(0xff00, 1), (0, 0)] {
            let request = words(1, 5, at, value);
            rig.expect(&request, &request);
            rig.expect(&words(1, 1, at, 1), &data(1, 1, &[bit]));
        }
    }
    let wrong = [1, 0x00ff, 0x0100, 0x7f00, 0xfe00, 0xff01, 0xffff];
    all_refused(&wrong.map(|value| words(1, 5, 0, value)), 3);
    // The value is looked at before the address.
    all_refused(&[words(1, 5, 0xffff, 1)], 3);
}

#[test]
fn values_of_a_single_register() {
    let mut rig = Rig::full();
    for at in [0, 127] {
        for value in [0, 1, 0x7fff, 0x8000, 0xff00, 0xffff] {
            let request = words(1, 6, at, value);
            rig.expect(&request, &request);
            rig.expect(&words(1, 3, at, 1), &data(1, 3, &value.to_be_bytes()));
        }
    }
}

#[test]
fn addresses_past_the_end_of_a_table() {
    let mut requests = Vec::new();
    for function in 1..=4 {
        for (first, quantity) in [(127, 2), (128, 1), (4, 125), (0xff7f, 1)] {
            requests.push(words(1, function, first, quantity));
        }
    }
    requests.extend([128, 256, 0x8000, 0xffff].map(|at| words(1, 5, at, 0xff00)));
    requests.extend([128, 256, 0x8000, 0xffff].map(|at| words(1, 6, at, 0x1234)));
    for first in [127, 128] {
        requests.push(block(1, 0x0f, first, 2, &[3]));
        requests.push(block(1, 0x10, first, 2, &[1, 2, 3, 4]));
    }
    requests.push(block(1, 0x10, 6, 123, &[0xee; 246]));
    all_refused(&requests, 2);
}

#[test]
fn addresses_past_65535_do_not_wrap() {
    let mut requests = Vec::new();
    for function in 1..=4 {
        for (first, quantity) in [
            (0xffff, 1),
            (0xffff, 2),
            (0xfffe, 3),
            (0xff83, 125),
            (0xff84, 125),
        ] {
            requests.push(words(1, function, first, quantity));
        }
    }
    for (first, quantity) in [(0xffff, 1), (0xffff, 2), (0xfffe, 4)] {
        requests.push(block(1, 0x0f, first, quantity, &[0xff]));
        requests.push(block(
            1,
            0x10,
            first,
            quantity,
            &vec![0xee; 2 * usize::from(quantity)],
        ));
    }
    requests.push(block(1, 0x0f, 0xffff, 1968, &[0xff; 246]));
    requests.push(block(1, 0x10, 0xff86, 123, &[0xee; 246]));
    all_refused(&requests, 2);
}

/// A good request of each function.
fn one_of_each() -> Vec<Vec<u8>> {
    vec![
        words(1, 1, 0, 9),
        words(1, 2, 0, 9),
        words(1, 3, 0, 2),
        words(1, 4, 0, 2),
        words(1, 5, 0, 0),
        words(1, 6, 0, 0x1234),
        block(1, 0x0f, 0, 9, &[0, 0]),
        block(1, 0x10, 0, 2, &[1, 2, 3, 4]),
    ]
}

#[test]
fn a_request_of_the_wrong_length() {
    let mut requests = Vec::new();
    for request in one_of_each() {
        let body = &request[..request.len() - 2];
        requests.extend((2..body.len()).map(|len| adu(&body[..len])));
        for more in [1, 2, 254 - body.len()] {
            requests.push(adu(&[body, &vec![0x01; more]].concat()));
        }
    }
    all_refused(&requests, 3);
}

#[test]
fn a_further_zero_byte() {
    // The CRC of a frame and its CRC is 0, and so is that of further zeros (SER 2.5.1.2).
    let mut requests = Vec::new();
    for mut request in one_of_each() {
        request.push(0);
        requests.push(request.clone());
        request.push(0);
        requests.push(request);
    }
    all_refused(&requests, 3);
}

#[test]
fn a_byte_count_that_does_not_fit() {
    let mut requests = Vec::new();
    for count in [0, 1, 3, 254, 255] {
        requests.push(claimed(1, 0x0f, 0, 9, count, &[0xff; 2]));
        requests.push(block(
            1,
            0x0f,
            0,
            9,
            &vec![0xff; usize::from(count.min(247u8))],
        ));
    }
    for count in [0, 2, 3, 5, 6, 252, 255] {
        requests.push(claimed(1, 0x10, 0, 2, count, &[0xee; 4]));
        requests.push(block(
            1,
            0x10,
            0,
            2,
            &vec![0xee; usize::from(count.min(246u8))],
        ));
    }
    all_refused(&requests, 3);
}

#[test]
fn quantity_and_value_are_checked_before_the_address() {
    let mut requests: Vec<_> = [1, 2, 3, 4]
        .map(|function| words(1, function, 0xffff, 0))
        .to_vec();
    requests.push(block(1, 0x0f, 0xffff, 0, &[]));
    requests.push(block(1, 0x10, 0xffff, 0, &[]));
    requests.push(claimed(1, 0x10, 0xffff, 2, 5, &[0; 5]));
    all_refused(&requests, 3);
}

#[test]
fn missing_functions_are_exception_01() {
    let (mut rig, before) = marked();
    let known = [1, 2, 3, 4, 5, 6, 0x0f, 0x10];
    for function in (0..=0xff).filter(|function| !known.contains(function)) {
        let refusal = exception(1, function, 1);
        rig.expect(&adu(&[1, function]), &refusal);
        rig.expect(&words(1, function, 0, 1), &refusal);
        rig.expect(&adu(&[&[1, function], &[0xff; 252][..]].concat()), &refusal);
    }
    assert_eq!(rig.state(COUNT), before);
}

#[test]
fn a_broadcast_write_is_executed_in_silence() {
    let mut rig = Rig::full();
    rig.expect_silence(&words(0, 5, 3, 0xff00));
    rig.expect_silence(&words(0, 6, 4, 0x1234));
    rig.expect_silence(&block(0, 0x0f, 8, 9, &[0xff, 0x01]));
    rig.expect_silence(&block(0, 0x10, 126, 2, &[0xca, 0xfe, 0xba, 0xbe]));
    rig.expect(&words(1, 1, 0, 24), &data(1, 1, &[0x08, 0xff, 0x01]));
    rig.expect(&words(1, 3, 4, 1), &data(1, 3, &[0x12, 0x34]));
    rig.expect(&words(1, 3, 126, 2), &data(1, 3, &[0xca, 0xfe, 0xba, 0xbe]));
}

#[test]
fn other_broadcasts_do_nothing() {
    let (mut rig, before) = marked();
    for mut request in one_of_each().drain(..4) {
        request[0] = 0;
        rig.expect_silence(&adu(&request[..6]));
    }
    // Refused, and nobody hears it.
    let refused = [
        words(0, 5, 0, 1),
        words(0, 6, 128, 1),
        block(0, 0x0f, 127, 2, &[3]),
        block(0, 0x10, 127, 2, &[1, 2, 3, 4]),
        claimed(0, 0x10, 0, 2, 6, &[0xee; 6]),
        words(0, 0x07, 0, 0),
        words(0, 0x41, 0, 0),
        words(0, 0xff, 0, 0),
    ];
    for request in refused {
        rig.expect_silence(&request);
    }
    assert_eq!(rig.state(COUNT), before);
}

#[test]
fn requests_to_other_units_are_not_answered() {
    let (mut rig, before) = marked();
    for unit in 2..=255 {
        rig.expect_silence(&words(unit, 6, 0, 0x1234));
        rig.expect_silence(&words(unit, 3, 0, 1));
        rig.expect_silence(&words(unit, 0x63, 0, 1));
    }
    assert_eq!(rig.state(COUNT), before);
}

#[test]
fn unit_247_is_the_last() {
    let mut rig = Rig::units(&[247]);
    rig.expect(&words(247, 3, 0, 1), &data(247, 3, &[0, 0]));
    for unit in 248..=255 {
        rig.expect_silence(&words(unit, 6, 0, 0x1234));
    }
    rig.expect(&words(247, 3, 0, 1), &data(247, 3, &[0, 0]));
}

#[test]
fn a_refused_block_write_changes_nothing_at_all() {
    // The first items are there, the last is not.
    let (mut rig, before) = marked();
    for first in [1, 64, 120, 127] {
        let quantity = COUNT + 1 - first;
        if quantity <= 123 {
            let values = vec![0xee; 2 * usize::from(quantity)];
            rig.expect(
                &block(1, 0x10, first, quantity, &values),
                &exception(1, 0x10, 2),
            );
        }
        let coils = vec![0x5a; usize::from(quantity.div_ceil(8))];
        rig.expect(
            &block(1, 0x0f, first, quantity, &coils),
            &exception(1, 0x0f, 2),
        );
        assert_eq!(rig.state(COUNT), before);
    }
}
