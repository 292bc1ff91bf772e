//! Every limit of the standard at its edge and one past it.

mod common;

use common::{Tables, UNIT, ask, ask_on_line, refused, with_data, words};
use multidrop_protocol::exception::Exception::{
    IllegalDataAddress, IllegalDataValue, IllegalFunction,
};
use multidrop_protocol::frame::{EncodeError, ReceiveErrors};
use multidrop_protocol::rtu;

fn expect_refused(request: &[u8], exception: multidrop_protocol::exception::Exception) {
    let mut tables = Tables::new();
    let before = tables.clone();
    assert_eq!(
        ask(&mut tables, request),
        refused(request, exception),
        "{request:02X?}"
    );
    assert!(
        tables == before,
        "a refused request changed something: {request:02X?}"
    );
}

#[test]
fn quantity_of_bits_read() {
    for function in [1, 2] {
        expect_refused(&words(UNIT, function, 0, 0), IllegalDataValue);
        expect_refused(&words(UNIT, function, 0, 2001), IllegalDataValue);
        expect_refused(&words(UNIT, function, 0, 0xFFFF), IllegalDataValue);
        for count in [1u16, 7, 8, 9, 1999, 2000] {
            let answer = ask(&mut Tables::new(), &words(UNIT, function, 3, count)).unwrap();
            let bytes = usize::from(count.div_ceil(8));
            assert_eq!(answer[..3], [UNIT, function, bytes as u8]);
            assert_eq!(answer.len(), 3 + bytes);
            let on = |index: u16| answer[3 + usize::from(index / 8)] >> (index % 8) & 1 != 0;
            for index in 0..count {
                assert_eq!(
                    on(index),
                    function == 2 && index % 3 == 0,
                    "{function} {index}"
                );
            }
            for padding in count..(bytes * 8) as u16 {
                assert!(!on(padding), "{function} {count} {padding}");
            }
        }
    }
}

#[test]
fn quantity_of_registers_read() {
    for (function, base) in [(3, 0u16), (4, 0x1000)] {
        expect_refused(&words(UNIT, function, 0, 0), IllegalDataValue);
        expect_refused(&words(UNIT, function, 0, 126), IllegalDataValue);
        // 0x0101 has a low byte that alone would do.
        expect_refused(&words(UNIT, function, 0, 0x0101), IllegalDataValue);
        for count in [1u16, 2, 124, 125] {
            let answer = ask(&mut Tables::new(), &words(UNIT, function, 7, count)).unwrap();
            let mut expected = vec![UNIT, function, count as u8 * 2];
            expected.extend((7..7 + count).flat_map(|address| (base + address).to_be_bytes()));
            assert_eq!(answer, expected);
        }
    }
}

#[test]
fn quantity_of_coils_written() {
    expect_refused(&with_data(UNIT, 0x0F, 100, 0, &[]), IllegalDataValue);
    expect_refused(&with_data(UNIT, 0x0F, 100, 0, &[1]), IllegalDataValue);
    expect_refused(
        &with_data(UNIT, 0x0F, 100, 1969, &[0xFF; 247]),
        IllegalDataValue,
    );
    // 1968 + 8 * 256 coils would have the same byte count in eight bits.
    expect_refused(
        &with_data(UNIT, 0x0F, 100, 4016, &[0xFF; 246]),
        IllegalDataValue,
    );
    for count in [1u16, 7, 8, 9, 1967, 1968] {
        let mut tables = Tables::new();
        let request = with_data(
            UNIT,
            0x0F,
            100,
            count,
            &vec![0xFF; usize::from(count.div_ceil(8))],
        );
        assert_eq!(ask(&mut tables, &request).as_deref(), Some(&request[..6]));
        let on: Vec<usize> = (0..65_536)
            .filter(|address| tables.coils[*address])
            .collect();
        assert!(
            on.iter().copied().eq(100..100 + usize::from(count)),
            "{count}"
        );
    }
}

#[test]
fn quantity_of_registers_written() {
    expect_refused(&with_data(UNIT, 0x10, 200, 0, &[]), IllegalDataValue);
    expect_refused(&with_data(UNIT, 0x10, 200, 0, &[1, 2]), IllegalDataValue);
    expect_refused(
        &with_data(UNIT, 0x10, 200, 124, &[1; 246]),
        IllegalDataValue,
    );
    // 1 + 128 registers would have the same byte count in eight bits.
    expect_refused(&with_data(UNIT, 0x10, 200, 129, &[1, 2]), IllegalDataValue);
    for count in [1u16, 2, 122, 123] {
        let mut tables = Tables::new();
        let request = with_data(UNIT, 0x10, 200, count, &vec![0xEE; usize::from(count) * 2]);
        assert_eq!(ask(&mut tables, &request).as_deref(), Some(&request[..6]));
        for address in 0..65_536 {
            let written = (200..200 + usize::from(count)).contains(&address);
            assert_eq!(
                tables.holding[address],
                if written { 0xEEEE } else { address as u16 }
            );
        }
    }
}

#[test]
fn a_write_of_124_registers_is_too_long_for_a_frame() {
    let mut adu = with_data(UNIT, 0x10, 0, 124, &[0; 248]);
    let check = multidrop_protocol::crc::checksum(&adu).to_le_bytes();
    adu.extend(check);
    assert_eq!(adu.len(), 257);
    assert_eq!(ask_on_line(&mut Tables::new(), &adu), None);
    assert_eq!(rtu::decode(&adu), Err(ReceiveErrors::LENGTH));
}

#[test]
fn byte_count_fits_quantity() {
    for wrong in [1u8, 3] {
        let mut request = with_data(UNIT, 0x0F, 100, 10, &[0xFF; 2]);
        request[6] = wrong;
        expect_refused(&request, IllegalDataValue);
        expect_refused(
            &with_data(UNIT, 0x0F, 100, 10, &vec![0xFF; wrong.into()]),
            IllegalDataValue,
        );
    }
    for wrong in [3u8, 5, 2, 6] {
        let mut request = with_data(UNIT, 0x10, 200, 2, &[0xFF; 4]);
        request[6] = wrong;
        expect_refused(&request, IllegalDataValue);
        expect_refused(
            &with_data(UNIT, 0x10, 200, 2, &vec![0xFF; wrong.into()]),
            IllegalDataValue,
        );
    }
}

#[test]
fn request_length_is_exact() {
    let requests = [
        words(UNIT, 1, 0, 1),
        words(UNIT, 2, 0, 1),
        words(UNIT, 3, 0, 1),
        words(UNIT, 4, 0, 1),
        words(UNIT, 5, 0, 0xFF00),
        words(UNIT, 6, 0, 0x1234),
        with_data(UNIT, 0x0F, 0, 1, &[1]),
        with_data(UNIT, 0x10, 0, 1, &[1, 2]),
    ];
    for whole in requests {
        assert_eq!(ask(&mut Tables::new(), &whole).unwrap()[1], whole[1]);
        for len in 2..whole.len() {
            expect_refused(&whole[..len], IllegalDataValue);
        }
        for more in [1, 2, 100, 254 - whole.len()] {
            let mut longer = whole.clone();
            longer.extend(vec![0; more]);
            expect_refused(&longer, IllegalDataValue);
        }
    }
}

#[test]
fn a_further_zero_byte_keeps_the_crc_but_not_the_length() {
    let mut adu = vec![UNIT, 6, 0, 1, 0, 3];
    adu.extend(multidrop_protocol::crc::checksum(&adu).to_le_bytes());
    adu.push(0);
    let mut out = [0; 256];
    let refusal = rtu::encode(&[UNIT, 0x86, 3], &mut out).unwrap().to_vec();
    assert_eq!(ask_on_line(&mut Tables::new(), &adu), Some(refusal));
}

#[test]
fn value_of_a_single_coil() {
    for value in [0x0001, 0x00FF, 0x0100, 0xFE00, 0xFF01, 0xFFFF] {
        expect_refused(&words(UNIT, 5, 0, value), IllegalDataValue);
    }
    let mut tables = Tables::new();
    let (on, off) = (words(UNIT, 5, 9, 0xFF00), words(UNIT, 5, 9, 0));
    assert_eq!(ask(&mut tables, &on), Some(on));
    assert!(tables.coils[9]);
    assert_eq!(ask(&mut tables, &off), Some(off));
    assert!(!tables.coils[9]);
}

#[test]
fn the_last_address_is_65535() {
    let mut tables = Tables::new();
    let answer = ask(&mut tables, &words(UNIT, 3, 65_535, 1)).unwrap();
    assert_eq!(answer, [UNIT, 3, 2, 0xFF, 0xFF]);
    assert_eq!(
        ask(&mut tables, &words(UNIT, 4, 65_411, 125))
            .unwrap()
            .len(),
        253
    );
    assert_eq!(
        ask(&mut tables, &words(UNIT, 1, 65_529, 7)).unwrap().len(),
        4
    );
    assert_eq!(
        ask(&mut tables, &words(UNIT, 5, 65_535, 0xFF00)).unwrap()[1],
        5
    );
    assert!(tables.coils[65_535]);
    assert_eq!(ask(&mut tables, &words(UNIT, 6, 65_535, 1)).unwrap()[1], 6);
    assert_eq!(tables.holding[65_535], 1);

    // The address space does not wrap to 0, where there is something, too.
    for function in [1, 2, 3, 4] {
        expect_refused(&words(UNIT, function, 65_535, 2), IllegalDataAddress);
        expect_refused(&words(UNIT, function, 65_412, 125), IllegalDataAddress);
    }
    expect_refused(&with_data(UNIT, 0x0F, 65_535, 2, &[3]), IllegalDataAddress);
    expect_refused(
        &with_data(UNIT, 0x10, 65_535, 2, &[1, 2, 3, 4]),
        IllegalDataAddress,
    );
}

#[test]
fn a_block_that_leaves_a_bank_is_refused_whole() {
    for function in [1, 2, 3, 4] {
        assert_eq!(
            ask(&mut Tables::new(), &words(UNIT, function, 2998, 2)).unwrap()[1],
            function
        );
        expect_refused(&words(UNIT, function, 2999, 2), IllegalDataAddress);
        expect_refused(&words(UNIT, function, 64_999, 2), IllegalDataAddress);
    }
    expect_refused(&words(UNIT, 5, 3000, 0xFF00), IllegalDataAddress);
    expect_refused(&words(UNIT, 6, 3000, 1), IllegalDataAddress);
    expect_refused(&with_data(UNIT, 0x0F, 2999, 2, &[3]), IllegalDataAddress);
    expect_refused(
        &with_data(UNIT, 0x10, 2999, 2, &[1, 2, 3, 4]),
        IllegalDataAddress,
    );
}

#[test]
fn quantity_is_checked_before_addresses() {
    for function in [1, 2, 3, 4] {
        expect_refused(&words(UNIT, function, 3000, 0), IllegalDataValue);
        expect_refused(&words(UNIT, function, 65_535, 2001), IllegalDataValue);
    }
    expect_refused(&words(UNIT, 5, 3000, 1), IllegalDataValue);
}

#[test]
fn unknown_functions() {
    for function in (0..=255u8).filter(|code| !matches!(code, 1..=6 | 0x0F | 0x10)) {
        let mut tables = Tables::new();
        assert_eq!(
            ask(&mut tables, &[UNIT, function, 0, 0]),
            Some(vec![UNIT, function | 0x80, IllegalFunction.code()])
        );
    }
}

#[test]
fn lengths_of_frames() {
    let mut out = [0; 256];
    assert_eq!(rtu::encode(&[1], &mut out), Err(EncodeError::Length));
    assert_eq!(rtu::encode(&[1, 2], &mut out).map(<[u8]>::len), Ok(4));
    assert_eq!(rtu::encode(&[1; 254], &mut out).map(<[u8]>::len), Ok(256));
    assert_eq!(
        rtu::encode(&[1; 255], &mut [0; 300]),
        Err(EncodeError::Length)
    );
    assert_eq!(rtu::encode(&[1, 2], &mut [0; 3]), Err(EncodeError::Room));
    // The CRC of one byte is right, the frame is too short all the same.
    assert_eq!(rtu::decode(&[0x01, 0x7E, 0x80]), Err(ReceiveErrors::LENGTH));
}
