//! Frames of the standard and of devices in the field, with their CRC recomputed bit by bit.

mod common;

use common::{Tables, ask_on_line, send};
use multidrop_protocol::Adu;
use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::rtu::{self, Reception};

const FRAMES: [&[u8]; 8] = [
    &[0x01, 0x03, 0x00, 0x00, 0x00, 0x01, 0x84, 0x0A],
    &[0x11, 0x03, 0x00, 0x6B, 0x00, 0x03, 0x76, 0x87],
    &[
        0x11, 0x03, 0x06, 0xAE, 0x41, 0x56, 0x52, 0x43, 0x40, 0x49, 0xAD,
    ],
    &[0x11, 0x05, 0x00, 0xAC, 0xFF, 0x00, 0x4E, 0x8B],
    &[0x11, 0x06, 0x00, 0x01, 0x00, 0x03, 0x9A, 0x9B],
    &[
        0x11, 0x0F, 0x00, 0x13, 0x00, 0x0A, 0x02, 0xCD, 0x01, 0xBF, 0x0B,
    ],
    &[
        0x11, 0x10, 0x00, 0x01, 0x00, 0x02, 0x04, 0x00, 0x0A, 0x01, 0x02, 0xC6, 0xF0,
    ],
    &[0x0A, 0x81, 0x02, 0xB0, 0x53],
];

/// The definition, one bit at a time (SER 6.2.2).
fn crc_by_definition(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, &byte| {
        (0..8).fold(crc ^ u16::from(byte), |crc, _| {
            if crc & 1 != 0 {
                crc >> 1 ^ 0xA001
            } else {
                crc >> 1
            }
        })
    })
}

#[test]
fn crc_of_every_frame() {
    for adu in FRAMES {
        let (body, check) = adu.split_at(adu.len() - 2);
        assert_eq!(check, crc_by_definition(body).to_le_bytes(), "{adu:02X?}");
    }
}

#[test]
fn every_frame_whole_and_byte_by_byte() {
    for adu in FRAMES {
        let body = &adu[..adu.len() - 2];
        let mut out = [0; 256];
        assert_eq!(rtu::encode(body, &mut out), Ok(adu));
        assert_eq!(rtu::decode(adu), Ok(body));

        let mut frame: Adu = [0; 256];
        let mut reception = Reception::new();
        for &byte in adu {
            reception.push(&mut frame, byte);
        }
        let heard = reception.finish();
        assert_eq!(
            (usize::from(heard.len), heard.errors),
            (body.len(), ReceiveErrors::NONE)
        );
        assert_eq!(&frame[..body.len()], body);
        assert_eq!(send(&frame, heard.len), adu);
    }
}

#[test]
fn reads_107_to_109() {
    let mut tables = Tables::new();
    tables.holding[107..110].copy_from_slice(&[0xAE41, 0x5652, 0x4340]);
    assert_eq!(
        ask_on_line(&mut tables, FRAMES[1]).as_deref(),
        Some(FRAMES[2])
    );
}

#[test]
fn writes_are_echoed() {
    let mut tables = Tables::new();
    assert_eq!(
        ask_on_line(&mut tables, FRAMES[3]).as_deref(),
        Some(FRAMES[3])
    );
    assert!(tables.coils[172]);
    assert_eq!(
        ask_on_line(&mut tables, FRAMES[4]).as_deref(),
        Some(FRAMES[4])
    );
    assert_eq!(tables.holding[1], 3);
}

#[test]
fn writes_ten_coils_from_19() {
    let mut tables = Tables::new();
    let answer = ask_on_line(&mut tables, FRAMES[5]);
    let mut out = [0; 256];
    assert_eq!(
        answer.as_deref(),
        rtu::encode(&FRAMES[5][..6], &mut out).ok()
    );
    // 0xCD, lowest bit first, then 0x01.
    let on = [
        true, false, true, true, false, false, true, true, true, false,
    ];
    assert_eq!(tables.coils[19..29], on);
    assert_eq!(tables.coils.iter().filter(|on| **on).count(), 6);
}

#[test]
fn writes_two_registers_from_1() {
    let mut tables = Tables::new();
    let answer = ask_on_line(&mut tables, FRAMES[6]);
    let mut out = [0; 256];
    assert_eq!(
        answer.as_deref(),
        rtu::encode(&FRAMES[6][..6], &mut out).ok()
    );
    assert_eq!(tables.holding[..4], [0, 0x000A, 0x0102, 3]);
}

#[test]
fn frames_for_other_units_are_ignored() {
    let mut tables = Tables::new();
    assert_eq!(ask_on_line(&mut tables, FRAMES[0]), None);
    assert_eq!(ask_on_line(&mut tables, FRAMES[7]), None);
}
