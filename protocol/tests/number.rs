//! Numbers and text in registers, against bytes moved by hand.

use multidrop_protocol::number::{Order, Pad, TextError};
use proptest::prelude::*;

/// Where the bytes `ABCDEFGH` of a number go, by the letters of its order.
fn shuffled(order: Order, bytes: &[u8]) -> Vec<u16> {
    let letters = match (order, bytes.len()) {
        (Order::Abcd, 4) => "ABCD",
        (Order::Cdab, 4) => "CDAB",
        (Order::Badc, 4) => "BADC",
        (Order::Dcba, 4) => "DCBA",
        (Order::Abcd, _) => "ABCDEFGH",
        (Order::Cdab, _) => "GHEFCDAB",
        (Order::Badc, _) => "BADCFEHG",
        (Order::Dcba, _) => "HGFEDCBA",
    };
    let placed: Vec<u8> = letters
        .bytes()
        .map(|letter| bytes[usize::from(letter - b'A')])
        .collect();
    let words = placed.chunks(2);
    words
        .map(|word| u16::from(word[0]) * 256 + u16::from(word[1]))
        .collect()
}

#[test]
fn known_values() {
    // 1234567 is 0x0012D687; -2 is 0xFFFFFFFE; pi as a single is 0x40490FDB, as a double 0x400921FB54442D18.
    assert_eq!(Order::Abcd.from_u32(1_234_567), [0x0012, 0xD687]);
    assert_eq!(Order::Cdab.from_u32(1_234_567), [0xD687, 0x0012]);
    assert_eq!(Order::Badc.from_u32(1_234_567), [0x1200, 0x87D6]);
    assert_eq!(Order::Dcba.from_u32(1_234_567), [0x87D6, 0x1200]);
    assert_eq!(Order::Cdab.i32([0xFFFE, 0xFFFF]), -2);
    assert_eq!(Order::Abcd.f32([0x4049, 0x0FDB]), std::f32::consts::PI);
    assert_eq!(Order::Dcba.f32([0xDB0F, 0x4940]), std::f32::consts::PI);
    assert_eq!(
        Order::Cdab.from_f64(std::f64::consts::PI),
        [0x2D18, 0x5444, 0x21FB, 0x4009]
    );
    assert_eq!(
        Order::Badc.f64([0x0940, 0xFB21, 0x4454, 0x182D]),
        std::f64::consts::PI
    );
    // The seed's way: hi * 65536 + lo.
    assert_eq!(Order::Abcd.u32([3, 4]), 3 * 65536 + 4);
}

#[test]
fn at_compile_time() {
    const SETPOINT: [u16; 2] = Order::Cdab.from_f32(12.5);
    const BACK: f32 = Order::Cdab.f32(SETPOINT);
    assert_eq!((SETPOINT, BACK), ([0x0000, 0x4148], 12.5));
    const NAME: [u16; 3] = {
        let mut registers = [0xFFFF; 3];
        assert!(
            Order::Abcd
                .from_text("pump", Pad::Zero, &mut registers)
                .is_ok()
        );
        registers
    };
    assert_eq!(NAME, [0x7075, 0x6D70, 0x0000]);
}

#[test]
fn text_is_padded_and_read_back() {
    let mut registers = [0; 3];
    let mut room = [0; 6];
    assert_eq!(
        Order::Badc.from_text("Grün", Pad::Space, &mut registers),
        Ok(())
    );
    assert_eq!(registers, [0x7247, 0xBCC3, 0x206E]);
    let text = Order::Badc.text(&registers, Pad::Space, &mut room);
    assert_eq!(text, Ok("Grün"));
    assert_eq!(Order::Abcd.text(&[], Pad::Zero, &mut []), Ok(""));
    assert_eq!(
        Order::Abcd.text(&[0x2020, 0x2020], Pad::Space, &mut []),
        Ok("")
    );
    // A zero in the middle stays.
    let text = Order::Abcd.text(&[0x4100, 0x4200], Pad::Zero, &mut room);
    assert_eq!(text, Ok("A\0B"));
}

#[test]
fn text_that_does_not_fit_is_refused_and_nothing_changed() {
    let mut registers = [0xABCD; 2];
    assert_eq!(
        Order::Abcd.from_text("pumps", Pad::Zero, &mut registers),
        Err(TextError::Room { room: 4, needed: 5 })
    );
    assert_eq!(registers, [0xABCD; 2]);
    assert_eq!(
        Order::Abcd.text(&[0x4142, 0x4300], Pad::Zero, &mut [0; 2]),
        Err(TextError::Room { room: 2, needed: 3 })
    );
    assert_eq!(
        Order::Abcd.text(&[0x41FF, 0x4300], Pad::Zero, &mut [0; 8]),
        Err(TextError::Utf8 { place: 1 })
    );
}

proptest! {
    #[test]
    fn four_bytes_are_stored_in_the_named_order(value: u32) {
        for order in Order::ALL {
            let registers = shuffled(order, &value.to_be_bytes());
            prop_assert_eq!(&order.from_u32(value)[..], &registers);
            prop_assert_eq!(order.u32([registers[0], registers[1]]), value);
            let signed = value as i32;
            prop_assert_eq!(order.i32(order.from_i32(signed)), signed);
            prop_assert_eq!(order.from_i32(signed), order.from_u32(value));
            let single = f32::from_bits(value);
            prop_assert_eq!(order.from_f32(single), order.from_u32(value));
            prop_assert_eq!(order.f32(order.from_u32(value)).to_bits(), value);
        }
    }

    #[test]
    fn eight_bytes_are_stored_in_the_named_order(value: u64) {
        for order in Order::ALL {
            let registers = shuffled(order, &value.to_be_bytes());
            prop_assert_eq!(&order.from_u64(value)[..], &registers);
            let four = [registers[0], registers[1], registers[2], registers[3]];
            prop_assert_eq!(order.u64(four), value);
            prop_assert_eq!(order.from_i64(value as i64), four);
            prop_assert_eq!(order.i64(four), value as i64);
            prop_assert_eq!(order.from_f64(f64::from_bits(value)), four);
            prop_assert_eq!(order.f64(four).to_bits(), value);
        }
    }

    #[test]
    fn text_there_and_back(text in "\\PC{0,20}", more in 0..4_usize, spaces: bool) {
        let pad = if spaces { Pad::Space } else { Pad::Zero };
        let expected = if spaces { text.trim_end_matches(' ') } else { &text };
        for order in Order::ALL {
            let mut registers = vec![0x5555; text.len().div_ceil(2) + more];
            prop_assert_eq!(order.from_text(&text, pad, &mut registers), Ok(()));
            let swap = matches!(order, Order::Badc | Order::Dcba);
            for (place, byte) in text.bytes().enumerate() {
                let high = place.is_multiple_of(2) != swap;
                let register = registers[place / 2];
                prop_assert_eq!(byte, if high { register >> 8 } else { register & 0xFF } as u8);
            }
            let mut room = [0; 100];
            prop_assert_eq!(order.text(&registers, pad, &mut room), Ok(expected));
        }
    }
}
