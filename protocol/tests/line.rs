//! Frames byte by byte: lengths and errors.

use multidrop_protocol::frame::{ReceiveErrors, Received};
use multidrop_protocol::rtu::{self, Reception, Transmission};
use multidrop_protocol::{Adu, crc};

fn receive(bytes: &[u8]) -> (Received, Adu) {
    let mut adu: Adu = [0; 256];
    let mut reception = Reception::new();
    for &byte in bytes {
        reception.push(&mut adu, byte);
    }
    (reception.finish(), adu)
}

/// A run of this many bytes with a right CRC at its end.
fn run_of(len: usize) -> Vec<u8> {
    let mut bytes: Vec<u8> = (0..len - 2).map(|index| index as u8).collect();
    bytes.extend(crc::checksum(&bytes).to_le_bytes());
    bytes
}

#[test]
fn four_to_256_bytes_are_a_frame() {
    for len in 2..=600 {
        let bytes = run_of(len);
        let (heard, adu) = receive(&bytes);
        match len {
            2..4 => assert_eq!(
                (heard.len, heard.errors),
                (len as u8 - 2, ReceiveErrors::LENGTH)
            ),
            4..=256 => {
                assert_eq!(
                    (usize::from(heard.len), heard.errors),
                    (len - 2, ReceiveErrors::NONE)
                );
                assert_eq!(adu[..len - 2], bytes[..len - 2]);
            }
            _ => {
                assert!(heard.errors.contains(ReceiveErrors::LENGTH), "{len}");
                assert_eq!(heard.len, 254);
                assert_eq!(adu[..], bytes[..256], "the surplus went somewhere");
            }
        }
    }
    assert!(receive(&[]).0.errors.contains(ReceiveErrors::LENGTH));
    assert!(receive(&[7]).0.errors.contains(ReceiveErrors::LENGTH));
}

#[test]
fn an_error_of_the_line_stays_until_the_restart() {
    let all = [
        ReceiveErrors::GAP,
        ReceiveErrors::PARITY,
        ReceiveErrors::FRAMING,
        ReceiveErrors::OVERRUN,
    ];
    for flaw in all {
        let mut adu: Adu = [0; 256];
        let mut reception = Reception::new();
        let bytes = run_of(8);
        reception.push(&mut adu, bytes[0]);
        reception.add(flaw);
        for &byte in &bytes[1..] {
            reception.push(&mut adu, byte);
        }
        assert_eq!(
            reception.finish(),
            Received {
                len: 6,
                errors: flaw
            }
        );
        reception.restart();
        assert!(reception.is_empty());
        for &byte in &bytes {
            reception.push(&mut adu, byte);
            assert!(!reception.is_empty());
        }
        assert_eq!(
            reception.finish(),
            Received {
                len: 6,
                errors: ReceiveErrors::NONE
            }
        );
    }
}

#[test]
fn errors_accumulate() {
    let two = ReceiveErrors::GAP | ReceiveErrors::CHECK;
    assert!(
        two.contains(ReceiveErrors::GAP)
            && two.contains(ReceiveErrors::CHECK)
            && !two.contains(ReceiveErrors::PARITY)
    );
    assert_eq!(ReceiveErrors::from_bits_truncate(two.bits()), two);
    assert_eq!(ReceiveErrors::from_bits_truncate(0x80), ReceiveErrors::NONE);
}

#[test]
fn finishing_an_unfinished_frame_does_not_change_it() {
    let bytes = run_of(256);
    let mut adu: Adu = [0; 256];
    let mut reception = Reception::new();
    for &byte in &bytes {
        reception.finish();
        reception.push(&mut adu, byte);
    }
    assert_eq!(
        reception.finish(),
        Received {
            len: 254,
            errors: ReceiveErrors::NONE
        }
    );
}

#[test]
fn nothing_is_sent_before_a_start_and_after_the_crc() {
    let adu: Adu = [0x5A; 256];
    let mut transmission = Transmission::new();
    assert!(transmission.is_over());
    assert_eq!(transmission.next(&adu), None);
    for len in [2, 254] {
        transmission.start(len);
        let mut sent = Vec::new();
        while !transmission.is_over() {
            sent.extend(transmission.next(&adu));
        }
        assert_eq!(transmission.next(&adu), None);
        assert_eq!(rtu::decode(&sent), Ok(&adu[..len.into()]));
    }
}
