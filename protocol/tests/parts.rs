//! Small parts by themselves: blocks of data, text, errors, and values computed from a format.

use multidrop_protocol::ascii;
use multidrop_protocol::data::{BytesOut, Coils, CoilsOut, Registers, RegistersOut};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::format::{Framing, LineFormat, Parity};
use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::registers::{self, Bank, CoilBank, Items, NoCoils, ScanList, SparseBank};
use multidrop_protocol::rtu::{Reception, Transmission};
use multidrop_protocol::timing;
use std::panic::catch_unwind;

#[test]
fn registers_are_read_from_a_frame() {
    let bytes = [0x01, 0x02, 0xFF, 0xFE, 0x00, 0x07, 0x99];
    let registers = Registers::new(&bytes);
    assert_eq!((registers.len(), registers.is_empty()), (3, false));
    let words = |registers: Registers<'_>| registers.iter().collect::<Vec<_>>();
    assert_eq!(words(registers), [0x0102, 0xFFFE, 7]);
    assert_eq!(registers.get(2), Some(7));
    assert_eq!(registers.get(3), None);
    assert_eq!(words(registers.part(1, 1)), [0xFFFE]);
    assert_eq!(words(registers.part(1, 2)), [0xFFFE, 7]);
    assert_eq!(words(registers.part(1, 3)), [0xFFFE, 7]);
    assert_eq!(words(registers.part(0, 0)), []);
    assert_eq!(words(registers.part(3, 1)), []);
    assert_eq!(words(registers.part(4, 1)), []);
    assert!(Registers::new(&bytes[..1]).is_empty());
    let mut cells = [9; 2];
    registers.copy_to(&mut cells);
    assert_eq!(cells, [0x0102, 0xFFFE]);
}

#[test]
fn registers_are_written_to_a_frame() {
    let mut bytes = [0xEE; 7];
    let mut out = RegistersOut::new(&mut bytes);
    assert_eq!((out.len(), out.is_empty()), (3, false));
    out.copy_from(&[0x0102, 0x0304]);
    out.set(2, 0xABCD);
    assert!(catch_unwind(|| RegistersOut::new(&mut [0; 2]).set(1, 0)).is_err());
    assert_eq!(bytes, [1, 2, 3, 4, 0xAB, 0xCD, 0xEE]);
    RegistersOut::new(&mut bytes).fill_from([0x1111, 0x2222]);
    assert_eq!(bytes, [0x11, 0x11, 0x22, 0x22, 0xAB, 0xCD, 0xEE]);
    assert!(RegistersOut::new(&mut bytes[..1]).is_empty());
}

#[test]
fn coils_are_read_from_a_frame() {
    let coils = Coils::new(&[0b1010_0101, 0xFF], 10);
    assert_eq!((coils.len(), coils.is_empty()), (10, false));
    let all: Vec<_> = coils.iter().map(u8::from).collect();
    assert_eq!(all, [1, 0, 1, 0, 0, 1, 0, 1, 1, 1]);
    assert_eq!(coils.get(8), Some(true));
    assert_eq!(coils.get(10), None);
    assert_eq!(coils.bytes(), [0b1010_0101, 0xFF]);
    assert!(Coils::new(&[], 0).is_empty());
    for (bytes, count) in [(1, 0), (0, 1), (2, 8), (1, 9), (3, 16), (2, 17)] {
        assert!(catch_unwind(|| Coils::new(&[0; 4][..bytes], count).len()).is_err());
    }
    assert_eq!(Coils::new(&[0; 2], 16).len(), 16);
}

#[test]
fn coils_are_written_to_a_frame() {
    let mut bytes = [0xFF, 0x00];
    let mut out = CoilsOut::new(&mut bytes, 10);
    assert_eq!((out.len(), out.is_empty()), (10, false));
    out.set(1, false);
    out.set(9, true);
    assert_eq!(out.bytes_mut(), [0b1111_1101, 0b10]);
    // As many as both have; what is behind stays.
    out.fill_from([false, true, false]);
    assert_eq!(bytes, [0b1111_1010, 0b10]);
    let mut out = CoilsOut::new(&mut bytes, 10);
    out.fill_from([true; 20]);
    assert_eq!(bytes, [0xFF, 0b11]);
    let mut out = CoilsOut::new(&mut bytes, 10);
    out.fill_from([false; 10]);
    assert_eq!(bytes, [0, 0]);
    assert!(CoilsOut::new(&mut [], 0).is_empty());
    assert!(catch_unwind(|| CoilsOut::new(&mut [0; 2], 10).set(10, true)).is_err());
    for (bytes, count) in [(1, 0), (0, 1), (2, 8), (1, 9)] {
        assert!(catch_unwind(|| CoilsOut::new(&mut [0; 4][..bytes], count).len()).is_err());
    }
}

#[test]
fn bytes_are_written_as_far_as_there_is_room() {
    let mut bytes = [0; 4];
    let mut out = BytesOut::new(&mut bytes);
    assert!(out.is_empty());
    out.push(1);
    out.extend(b"ab");
    assert_eq!(
        (out.len(), out.is_empty(), out.overflows()),
        (3, false, false)
    );
    out.extend(b"cd");
    assert_eq!((out.len(), out.overflows()), (4, true));
    assert_eq!(bytes, *b"\x01abc");
    // A frame has no more than 255.
    let mut bytes = [0; 300];
    let mut out = BytesOut::new(&mut bytes);
    out.extend(&[7; 255]);
    assert_eq!((out.len(), out.overflows()), (255, false));
    out.push(7);
    assert_eq!((out.len(), out.overflows()), (255, true));
    assert_eq!(bytes[255], 0);
}

#[test]
fn text_is_sent_unchanged() {
    let mut adu = [0; 256];
    adu[..5].copy_from_slice(b"line\n");
    let mut rtu = Transmission::default();
    let mut ascii = ascii::Transmission::default();
    assert!(rtu.is_over() && rtu.is_text_over());
    assert_eq!((rtu.next(&adu), rtu.next_text(&adu)), (None, None));
    for len in [1, 5, 254] {
        rtu.start(len);
        let mut sent = Vec::new();
        while !rtu.is_text_over() {
            sent.extend(rtu.next_text(&adu));
        }
        assert_eq!(rtu.next_text(&adu), None);
        assert_eq!(sent, adu[..len.into()]);
    }
    ascii.start(2, b'\n');
    assert_eq!(ascii.next(adu[0]), Some(b':'));
}

#[test]
fn an_empty_reception_has_no_errors() {
    let none = Reception::default().finish();
    assert_eq!(
        (none.len, none.errors),
        (0, ReceiveErrors::LENGTH | ReceiveErrors::CHECK)
    );
}

#[test]
fn receive_errors_are_a_set() {
    let all = [
        ReceiveErrors::GAP,
        ReceiveErrors::PARITY,
        ReceiveErrors::FRAMING,
        ReceiveErrors::OVERRUN,
        ReceiveErrors::LENGTH,
        ReceiveErrors::CHECK,
        ReceiveErrors::CHARACTER,
    ];
    for (place, flaw) in all.into_iter().enumerate() {
        assert_eq!(flaw.bits(), 1 << place);
        assert!(!flaw.is_empty() && ReceiveErrors::NONE.is_empty());
        for other in all {
            let both = flaw | other;
            assert!(both.contains(flaw) && both.contains(other) && both.contains(both));
            assert_eq!(flaw.contains(other), flaw == other);
            assert_eq!(flaw.contains(both), flaw == other);
            let mut sum = flaw;
            sum |= other;
            assert_eq!((sum, sum.bits()), (both, flaw.bits() | other.bits()));
        }
    }
    for bits in 0..=255 {
        assert_eq!(ReceiveErrors::from_bits_truncate(bits).bits(), bits & 0x7F);
    }
}

#[test]
fn the_number_of_characters_of_a_frame() {
    for len in 0..=254u8 {
        let bytes = u16::from(len);
        assert_eq!(Framing::Rtu.characters(len), bytes + 2);
        assert_eq!(Framing::Ascii.characters(len), 2 * bytes + 5);
        assert_eq!(Framing::Text.characters(len), bytes);
    }
    for (format, data, parity, stop) in [
        (LineFormat::F8N1, 8, Parity::None, 1),
        (LineFormat::F8E1, 8, Parity::Even, 1),
        (LineFormat::F8O1, 8, Parity::Odd, 1),
        (LineFormat::F8N2, 8, Parity::None, 2),
        (LineFormat::F7E1, 7, Parity::Even, 1),
        (LineFormat::F7O1, 7, Parity::Odd, 1),
        (LineFormat::F7N2, 7, Parity::None, 2),
    ] {
        assert_eq!(format.data_bits(), data);
        assert_eq!(format.parity(), parity);
        assert_eq!(format.stop_bits(), stop);
        let parity_bits = u8::from(parity != Parity::None);
        assert_eq!(format.character_bits(), 1 + data + parity_bits + stop);
        assert_eq!(LineFormat::from_name(format.name()), Some(format));
    }
    assert_eq!(LineFormat::from_name("9N1"), None);
}

#[test]
fn silences_of_so_many_ms_are_rounded_up() {
    assert_eq!(timing::gap(2, 2_000_000), 4000);
    assert_eq!(timing::gap(50, 1_382_400), 50 * 1383);
    assert_eq!(timing::gap(5, 1_000_001), 5 * 1001);
    assert_eq!(timing::margin(4_800), 200);
    assert_eq!(timing::margin(4_799), 199);
}

#[test]
fn a_computed_table_has_its_size() {
    let absent = Err(Exception::IllegalDataAddress);
    assert_eq!(registers::within(0, 10, 10), Ok(()));
    assert_eq!(registers::within(9, 1, 10), Ok(()));
    assert_eq!(registers::within(9, 2, 10), absent);
    assert_eq!(registers::within(10, 1, 10), absent);
    assert_eq!(registers::within(0, 11, 10), absent);
    assert_eq!(registers::within(65_535, 1, 65_535), absent);
    assert_eq!(registers::within(65_534, 1, 65_535), Ok(()));
}

#[test]
fn banks_lend_their_cells() {
    let mut bank = Bank::<2>::new(40);
    bank.cells_mut()[1] = 7;
    assert_eq!(
        (bank.base(), bank.get(41), bank.cells()),
        (40, Some(7), &[0, 7])
    );
    let mut coils = CoilBank::<2>::new(30, 12);
    coils.bytes_mut()[1] = 0b1000;
    assert_eq!((coils.base(), coils.count()), (30, 12));
    assert_eq!((coils.get(41), coils.get(40)), (Some(true), Some(false)));
    let mut sparse = SparseBank::new([5, 9]);
    sparse.cells_mut()[0] = 3;
    assert_eq!((sparse.addresses(), sparse.cells()), (&[5, 9], &[3, 0]));
    let mut list = ScanList::new([5, 4], [1, 2]);
    list.cells_mut()[1] = 8;
    assert_eq!(list.cells(), &[0, 8]);
    let mut none = NoCoils;
    assert!(!none.set_item(0, true) && none.rebase(7) && none.is_empty());
    assert_eq!(
        (none.item(0), none.address_of(0), none.index_of(0)),
        (None, None, None)
    );
}
