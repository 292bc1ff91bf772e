//! Banks against plain vectors.

use multidrop_protocol::data::{Coils, CoilsOut, Registers, RegistersOut};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::registers::{Bank, CoilBank};
use proptest::prelude::*;

const COUNT: u16 = 45;
const BYTES: usize = 6;

/// Coils packed by division, one by one.
fn pack(values: &[bool]) -> Vec<u8> {
    values
        .chunks(8)
        .map(|chunk| {
            chunk
                .iter()
                .enumerate()
                .map(|(bit, on)| u8::from(*on) * 2u8.pow(bit as u32))
                .sum()
        })
        .collect()
}

#[test]
fn register_blocks_at_the_edges() {
    let mut bank = Bank::from_cells(65_530, [10, 11, 12, 13, 14, 15]);
    let mut bytes = [0; 4];
    assert_eq!(bank.read(65_534, RegistersOut::new(&mut bytes)), Ok(()));
    assert_eq!(bytes, [0, 14, 0, 15]);
    for first in [0, 65_528, 65_529, 65_535] {
        let values = Registers::new(&[0xEE; 4]);
        assert_eq!(
            bank.check(first, values),
            Err(Exception::IllegalDataAddress)
        );
        assert_eq!(
            bank.write(first, values),
            Err(Exception::IllegalDataAddress)
        );
        assert_eq!(
            bank.read(first, RegistersOut::new(&mut bytes)),
            Err(Exception::IllegalDataAddress)
        );
    }
    assert_eq!(*bank.cells(), [10, 11, 12, 13, 14, 15]);
    assert_eq!(
        (bank.get(65_529), bank.get(65_530), bank.get(0)),
        (None, Some(10), None)
    );
    assert!(bank.set(65_535, 7) && !bank.set(65_529, 7));
    assert_eq!(bank.cells()[5], 7);
    assert_eq!(bank.write(65_530, Registers::new(&[1, 2])), Ok(()));
    assert_eq!(bank.get(65_530), Some(0x0102));
}

#[test]
fn coil_blocks_at_the_edges() {
    let mut bank = CoilBank::<2>::new(65_522, 14);
    assert!(bank.set(65_535, true) && !bank.set(65_521, true) && !bank.set(0, true));
    assert_eq!(*bank.bytes(), [0, 0b0010_0000]);
    assert_eq!(
        (bank.get(65_535), bank.get(65_521), bank.get(0)),
        (Some(true), None, None)
    );
    assert!(bank.contains(65_522, 14) && !bank.contains(65_522, 15) && !bank.contains(65_521, 2));
    let mut bytes = [0];
    assert_eq!(bank.read(65_534, CoilsOut::new(&mut bytes, 2)), Ok(()));
    assert_eq!(bytes[0] & 3, 2);
    assert_eq!(
        bank.read(65_535, CoilsOut::new(&mut bytes, 2)),
        Err(Exception::IllegalDataAddress)
    );
}

#[test]
#[should_panic(expected = "past address 65535")]
fn a_bank_past_the_end() {
    let _ = Bank::<7>::new(65_530);
}

#[test]
#[should_panic(expected = "past address 65535")]
fn a_coil_bank_past_the_end() {
    let _ = CoilBank::<2>::new(65_522, 15);
}

#[test]
#[should_panic(expected = "a coil bank must have a bit for each coil")]
fn a_coil_bank_without_room() {
    let _ = CoilBank::<2>::new(0, 17);
}

#[test]
#[should_panic(expected = "unit id must be 1..=247")]
fn a_reserved_unit_id() {
    let _ = multidrop_protocol::server::Server::new(248);
}

#[test]
fn blocks_one_by_one() {
    let coils = Coils::new(&[0b0000_0101, 0xFF], 9);
    assert_eq!(
        (coils.get(0), coils.get(1), coils.get(8), coils.get(9)),
        (Some(true), Some(false), Some(true), None)
    );
    assert_eq!(coils.iter().filter(|on| *on).count(), 3);
    let registers = Registers::new(&[1, 2, 3, 4]);
    assert_eq!(
        (registers.get(1), registers.get(2), registers.len()),
        (Some(0x0304), None, 2)
    );
    let mut bytes = [0xFF; 2];
    let mut out = CoilsOut::new(&mut bytes, 10);
    out.fill_from([false, true, false]);
    out.set(9, false);
    assert_eq!(bytes, [0b1111_1010, 0b1111_1101]);
    let mut bytes = [0; 6];
    let mut out = RegistersOut::new(&mut bytes);
    out.fill_from([0x0102, 0x0304]);
    assert_eq!(bytes, [1, 2, 3, 4, 0, 0]);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn coils_read_and_written(
        start in any::<[u8; BYTES]>(),
        base in prop_oneof![Just(0u16), Just(1000), Just(65_535 - COUNT + 1)],
        skip in 0..COUNT + 2,
        values in prop::collection::vec(any::<bool>(), 1..usize::from(COUNT) + 2),
        padding in any::<bool>(),
    ) {
        let mut bank = CoilBank::from_bytes(base, COUNT, start);
        let mut plain: Vec<bool> = (0..8 * BYTES).map(|bit| start[bit / 8] >> (bit % 8) & 1 == 1).collect();
        let mut bytes = pack(&values);
        if padding && values.len() % 8 != 0 {
            *bytes.last_mut().unwrap() |= 0xFFu8 << (values.len() % 8);
        }
        let first = base.wrapping_add(skip);
        let coils = Coils::new(&bytes, values.len() as u16);
        let mut out = vec![0; bytes.len()];

        if usize::from(skip) + values.len() > COUNT.into() {
            let refused = Err(Exception::IllegalDataAddress);
            prop_assert_eq!(bank.check(first, coils), refused);
            prop_assert_eq!(bank.write(first, coils), refused);
            prop_assert_eq!(bank.read(first, CoilsOut::new(&mut out, values.len() as u16)), refused);
            prop_assert_eq!(bank.bytes(), &start);
            return Ok(());
        }
        prop_assert_eq!(bank.check(first, coils), Ok(()));
        prop_assert_eq!(bank.write(first, coils), Ok(()));
        let block = usize::from(skip)..usize::from(skip) + values.len();
        plain[block].copy_from_slice(&values);
        prop_assert_eq!(&bank.bytes()[..], &pack(&plain)[..], "bits outside the block are as before");
        prop_assert_eq!(bank.read(first, CoilsOut::new(&mut out, values.len() as u16)), Ok(()));
        let read = Coils::new(&out, values.len() as u16);
        prop_assert_eq!(read.iter().collect::<Vec<_>>(), values);
    }

    #[test]
    fn registers_read_and_written(
        base in any::<u16>().prop_map(|base| base.min(65_526)),
        skip in 0..12u16,
        values in prop::collection::vec(any::<u16>(), 1..12),
    ) {
        let mut bank = Bank::<10>::new(base);
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_be_bytes()).collect();
        let first = base.wrapping_add(skip);
        let fits = usize::from(skip) + values.len() <= 10;
        let registers = Registers::new(&bytes);
        prop_assert_eq!(bank.check(first, registers).is_ok(), fits);
        prop_assert_eq!(bank.write(first, registers).is_ok(), fits);
        let mut plain = [0; 10];
        if fits {
            plain[skip.into()..usize::from(skip) + values.len()].copy_from_slice(&values);
        }
        prop_assert_eq!(bank.cells(), &plain);
        let mut out = vec![0; bytes.len()];
        prop_assert_eq!(bank.read(first, RegistersOut::new(&mut out)).is_ok(), fits);
        prop_assert!(!fits || out == bytes);
    }
}
