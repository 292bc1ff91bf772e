//! ASCII frames, whole and character by character. The expected text is from the standard, or made by the plain
//! reading of the harness.

use multidrop_protocol::ascii::{
    self, ADU_MAX, ADU_MIN, DELIMITER, Decoded, Reception, Transmission, decode, encode,
};
use multidrop_protocol::frame::{EncodeError, ReceiveErrors};
use multidrop_testkit::harness::ascii::framed;
use multidrop_testkit::harness::random::Random;

const BODY: [u8; 6] = [0x11, 3, 0, 0x6B, 0, 3];
const TEXT: &[u8] = b":1103006B00037E\r\n";

fn decoded(text: &[u8], delimiter: u8) -> Result<Vec<u8>, ReceiveErrors> {
    let mut out = [0; 256];
    decode(text, delimiter, &mut out).map(<[u8]>::to_vec)
}

#[test]
fn the_frame_of_the_standard_both_ways() {
    let mut out = [0; ADU_MAX];
    assert_eq!(encode(&BODY, DELIMITER, &mut out), Ok(TEXT));
    assert_eq!(decoded(TEXT, DELIMITER), Ok(BODY.to_vec()));
    assert_eq!(
        decoded(b":1103006b00037e\r\n", DELIMITER),
        Ok(BODY.to_vec())
    );
    assert_eq!(ascii::lrc(&BODY), 0x7E);
}

#[test]
fn any_frame_of_2_to_254_bytes_is_what_the_plain_reading_makes_of_it() {
    let mut random = Random::new(2);
    for len in 0..=300 {
        let body: Vec<u8> = (0..len).map(|_| random.byte()).collect();
        let mut out = [0xEE; ADU_MAX + 40];
        if !(2..=254).contains(&len) {
            assert_eq!(encode(&body, DELIMITER, &mut out), Err(EncodeError::Length));
            assert!(out.iter().all(|&byte| byte == 0xEE));
            continue;
        }
        let text = framed(&body);
        assert!((ADU_MIN..=ADU_MAX).contains(&text.len()));
        assert_eq!(encode(&body, DELIMITER, &mut out), Ok(&text[..]));
        assert!(out[text.len()..].iter().all(|&byte| byte == 0xEE));
        let short = &mut out[..text.len() - 1];
        assert_eq!(encode(&body, DELIMITER, short), Err(EncodeError::Room));
        assert_eq!(decoded(&text, DELIMITER), Ok(body));
    }
}

#[test]
fn any_delimiter_serves_both_ways() {
    for delimiter in 0..=255 {
        let mut text = TEXT.to_vec();
        text[16] = delimiter;
        let mut out = [0; ADU_MAX];
        assert_eq!(encode(&BODY, delimiter, &mut out), Ok(&text[..]));
        assert_eq!(decoded(&text, delimiter), Ok(BODY.to_vec()));
        if delimiter != DELIMITER {
            assert!(decoded(&text, DELIMITER).is_err());
            assert!(decoded(TEXT, delimiter).is_err());
        }
    }
}

#[test]
fn each_error_of_a_frame_is_reported() {
    let too_long = framed(&[7; 255]);
    let (length, check, character) = (
        ReceiveErrors::LENGTH,
        ReceiveErrors::CHECK,
        ReceiveErrors::CHARACTER,
    );
    for (text, errors) in [
        (&b""[..], character),
        (b"1103006B00037E\r\n", character),
        (b":1103006B00037F\r\n", check),
        (b":1103006B00037E0\r\n", length),
        (b":110300:6B00037E\r\n", character),
        (b":1103006B00037E\r\n\n", character | length),
        (b":1103006B00037E\r", length),
        (b":1103006B00037E\n", character | length),
        (b":11 03006B00037E\r\n", character | check),
        (b":11EF\r\n", length),
        (b":\r\n", length),
        (&too_long, length),
    ] {
        let found = decoded(text, DELIMITER).expect_err("a damaged frame");
        assert!(
            found.contains(errors),
            "{found:?}, {:?}",
            text.escape_ascii()
        );
        let named = ReceiveErrors::LENGTH | ReceiveErrors::CHECK | ReceiveErrors::CHARACTER;
        assert!(named.contains(found), "{found:?}");
    }
    assert_eq!(decoded(b":1103006B00037E0\r\n", DELIMITER), Err(length));
    assert_eq!(decoded(b":1103006B00037F\r\n", DELIMITER), Err(check));
}

#[test]
fn any_text_is_decoded_without_a_panic() {
    let mut random = Random::new(3);
    let alphabet = b"0123456789ABCDEFabcdef:\r\n\0\xFF ";
    for _ in 0..20_000 {
        let len = random.below(40);
        let text: Vec<u8> = (0..len).map(|_| random.pick(alphabet)).collect();
        let text = [b":", &text[..], b"\r\n"].concat();
        if let Ok(body) = decoded(&text, DELIMITER) {
            assert_eq!(framed(&body), text.to_ascii_uppercase());
        }
    }
}

#[test]
fn an_error_of_the_line_stays_and_stops_the_bytes() {
    for at in 0..16 {
        let mut reception = Reception::new(DELIMITER);
        for (index, &character) in TEXT[1..].iter().enumerate() {
            if index == at {
                reception.add(ReceiveErrors::PARITY);
            }
            let step = reception.push(character);
            let byte = matches!(step, Decoded::Byte { .. });
            assert!(!byte || index < at);
            assert_eq!(step == Decoded::End, index == 15 && at != 15);
        }
        assert!(reception.finish().errors.contains(ReceiveErrors::PARITY));
    }
}

#[test]
fn a_finished_transmission_gives_no_more_characters() {
    let mut transmission = Transmission::new();
    assert!(transmission.is_over());
    assert_eq!(transmission.next(0), None);
    transmission.start(2, DELIMITER);
    let mut text = Vec::new();
    while !transmission.is_over() {
        let byte = [0x11, 0x03, 0xEE][usize::from(transmission.position())];
        text.push(transmission.next(byte).unwrap());
    }
    assert_eq!(text, b":1103EC\r\n");
    assert_eq!(transmission.next(0), None);
}
