//! Frames as a whole and byte by byte.

use multidrop_protocol::Adu;
use multidrop_protocol::frame::{EncodeError, ReceiveErrors};
use multidrop_protocol::rtu::{self, Reception, Transmission};

use multidrop_testkit::harness::book;

/// The input as unit id and PDU to be encoded, and as a frame to be decoded.
pub fn codec(data: &[u8]) {
    encode(data);
    decode(data);
    // The same with a right CRC, which bytes seldom have.
    if (2..=300).contains(&data.len()) {
        decode(&book::framed(data));
    }
}

fn encode(body: &[u8]) {
    let mut out = [0xEE; 256];
    match rtu::encode(body, &mut out) {
        Ok(frame) => {
            assert_eq!(frame, book::framed(body));
            assert_eq!(rtu::decode(frame), Ok(body));
            let mut adu: Adu = [0xEE; 256];
            adu[..body.len()].copy_from_slice(body);
            let mut transmission = Transmission::new();
            transmission.start(body.len() as u8);
            let mut sent = Vec::new();
            while let Some(byte) = transmission.next(&adu) {
                sent.push(byte);
                assert_eq!(transmission.is_over(), sent.len() == frame.len());
            }
            assert_eq!(sent, frame);
            let mut short = vec![0xEE; body.len() + 1];
            assert_eq!(rtu::encode(body, &mut short), Err(EncodeError::Room));
            assert!(short.iter().all(|&byte| byte == 0xEE), "touched");
        }
        Err(error) => {
            assert_eq!(error, EncodeError::Length);
            assert!(!(2..=254).contains(&body.len()));
        }
    }
}

fn decode(bytes: &[u8]) {
    let mut adu: Adu = [0xEE; 256];
    let mut reception = Reception::new();
    for &byte in bytes {
        reception.push(&mut adu, byte);
    }
    let heard = reception.finish();
    let whole = rtu::decode(bytes);
    assert_eq!(whole.ok(), book::unframed(bytes));
    match whole {
        Ok(body) => {
            assert_eq!(heard.errors, ReceiveErrors::NONE);
            assert_eq!(&adu[..heard.len.into()], body);
        }
        // What no longer fits is not summed up.
        Err(_) if bytes.len() > 256 => assert!(heard.errors.contains(ReceiveErrors::LENGTH)),
        Err(errors) => assert_eq!(heard.errors, errors),
    }
    let kept = bytes.len().min(256);
    assert_eq!(&adu[..kept], &bytes[..kept]);
    assert!(adu[kept..].iter().all(|&byte| byte == 0xEE), "touched");
}
