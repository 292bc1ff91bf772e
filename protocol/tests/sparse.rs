//! Arrays with a table of addresses against a map, and runs of indices split into transactions.

use std::collections::BTreeMap;

use multidrop_protocol::data::{Coils, CoilsOut, Registers, RegistersOut};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::registers::items::run;
use multidrop_protocol::registers::{
    Bank, CoilBank, Items, NoCoils, Run, ScanEntry, ScanList, SparseBank, SparseCoilBank,
};
use proptest::prelude::*;

const EXAMPLE: [u16; 10] = [4, 5, 6, 7, 9, 1000, 1001, 30_000, 30_004, 63_023];

/// Runs by comparing each address with the one before.
fn split(addresses: &[u16], index: usize, count: usize) -> Vec<(u16, u16, u16)> {
    let mut runs: Vec<(u16, u16, u16)> = Vec::new();
    for (at, &address) in addresses.iter().enumerate().skip(index).take(count) {
        match runs.last_mut() {
            Some((_, first, found))
                if u32::from(*first) + u32::from(*found) == u32::from(address) =>
            {
                *found += 1;
            }
            _ => runs.push((at as u16, address, 1)),
        }
    }
    runs
}

fn runs<I: Items>(items: &I, index: u16, count: u16) -> Vec<(u16, u16, u16)> {
    let (mut at, mut left, mut found) = (index, count, Vec::new());
    while let Some(Run {
        index,
        first,
        count,
    }) = run(items, at, left)
    {
        found.push((index, first, count));
        (at, left) = (at.saturating_add(count), left - count);
    }
    found
}

#[test]
fn the_example_of_the_register_set() {
    let mut regs = SparseBank::new(EXAMPLE);
    // Master write of 6 and 7, read of 1000 and 1001.
    assert_eq!(runs(&regs, 2, 2), [(2, 6, 2)]);
    assert_eq!(runs(&regs, 5, 2), [(5, 1000, 2)]);
    assert_eq!(
        runs(&regs, 0, 10),
        [
            (0, 4, 4),
            (4, 9, 1),
            (5, 1000, 2),
            (7, 30_000, 1),
            (8, 30_004, 1),
            (9, 63_023, 1)
        ]
    );
    assert_eq!(run(&regs, 10, 1), None);
    assert_eq!(run(&regs, 0, 0), None);
    // Slave: only these exist.
    assert_eq!(regs.write(6, Registers::new(&[0, 102, 0x71, 0xC3])), Ok(()));
    assert_eq!((regs.item(2), regs.item(3)), (Some(102), Some(29_123)));
    let mut bytes = [0xEE; 4];
    assert_eq!(
        regs.read(7, RegistersOut::new(&mut bytes)),
        Err(Exception::IllegalDataAddress)
    );
    assert_eq!(bytes, [0xEE; 4]);
    assert_eq!(regs.read(6, RegistersOut::new(&mut bytes)), Ok(()));
    assert_eq!(bytes, [0, 102, 0x71, 0xC3]);
    assert_eq!(
        regs.write(7, Registers::new(&[1; 4])),
        Err(Exception::IllegalDataAddress)
    );
    assert_eq!(regs.item(3), Some(29_123));
}

#[test]
fn a_base_moves_dense_arrays_only() {
    let mut bank = Bank::<3>::new(10);
    assert!(bank.rebase(65_533) && !bank.rebase(65_534));
    assert_eq!(
        (bank.address_of(2), bank.address_of(3)),
        (Some(65_535), None)
    );
    assert_eq!(
        (bank.index_of(65_532), bank.index_of(65_533)),
        (None, Some(0))
    );
    let mut coils = CoilBank::<2>::new(0, 9);
    assert!(coils.rebase(65_527) && !coils.rebase(65_528));
    assert!(coils.set_item(8, true) && !coils.set_item(9, true));
    assert_eq!((coils.get(65_535), coils.item(8)), (Some(true), Some(true)));
    let mut sparse = SparseBank::new(EXAMPLE);
    assert!(sparse.rebase(65_535));
    assert_eq!(sparse.address_of(0), Some(4));
    assert!(Bank::<0>::new(0).is_empty() && NoCoils.is_empty());
    assert_eq!(
        (NoCoils.item(0), NoCoils.index_of(0), NoCoils.address_of(0)),
        (None, None, None)
    );
}

#[test]
fn a_scan_list_names_slave_and_item_of_each_place() {
    let mut list = ScanList::from_rows([4, 1000, 4], [7, 8, 9], [1, 17, 0], [2, 0, 1]);
    assert_eq!(list.entry(0), Some(ScanEntry { unit: 1, index: 2 }));
    assert_eq!(list.entry(1), Some(ScanEntry { unit: 17, index: 0 }));
    assert_eq!(list.entry(3), None);
    assert_eq!((list.address_of(2), list.item(2)), (Some(4), Some(9)));
    assert!(list.set_item(2, 5) && !list.set_item(3, 5));
    assert_eq!(list.cells(), &[7, 8, 5]);
    assert_eq!((list.index_of(4), list.index_of(5)), (Some(0), None));
    assert!(SparseBank::new(EXAMPLE).entry(0).is_none());
}

/// 24 addresses in order, many of them neighbours, often at the ends.
fn table() -> impl Strategy<Value = [u16; 24]> {
    (
        0u32..3,
        prop::collection::vec(prop_oneof![3 => Just(1u32), 1 => 2u32..4000], 24),
    )
        .prop_map(|(start, steps)| {
            let mut addresses = [0; 24];
            let mut address = start;
            for (cell, step) in addresses.iter_mut().zip(steps) {
                *cell = address.min(65_535) as u16;
                address += step;
            }
            // What ran past the end is packed against it.
            for index in (0..24).rev() {
                addresses[index] = addresses[index].min(65_535 - (23 - index as u16));
            }
            addresses
        })
}

proptest! {
    #[test]
    fn a_run_of_indices_is_split_into_the_fewest_transactions(
        addresses in table(),
        index in 0u16..26,
        count in 0u16..26,
    ) {
        let bank = SparseBank::new(addresses);
        prop_assert_eq!(
            runs(&bank, index, count),
            split(&addresses, usize::from(index).min(24), count.into())
        );
    }

    #[test]
    fn registers_are_those_of_a_map(
        addresses in table(),
        writes in prop::collection::vec((0usize..24, 0u16..3, prop::collection::vec(any::<u16>(), 1..6)), 1..20),
    ) {
        let mut bank = SparseBank::new(addresses);
        let mut map: BTreeMap<u32, u16> = addresses.iter().map(|address| (u32::from(*address), 0)).collect();
        for (near, off, values) in writes {
            let first = addresses[near].saturating_sub(1).saturating_add(off);
            let block = || (u32::from(first)..).take(values.len());
            let exists = block().all(|address| map.contains_key(&address));
            let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_be_bytes()).collect();
            prop_assert_eq!(bank.check(first, Registers::new(&bytes)).is_ok(), exists);
            prop_assert_eq!(bank.write(first, Registers::new(&bytes)).is_ok(), exists);
            if exists {
                map.extend(block().zip(values.iter().copied()));
            }
            prop_assert!(bank.cells().iter().eq(map.values()));

            let mut read = vec![0; values.len() * 2];
            prop_assert_eq!(bank.read(first, RegistersOut::new(&mut read)).is_ok(), exists);
            if exists {
                prop_assert_eq!(read, bytes);
            }
        }
    }

    #[test]
    fn coils_are_those_of_a_map(
        addresses in table(),
        writes in prop::collection::vec((0usize..24, 0u16..3, prop::collection::vec(any::<bool>(), 1..20)), 1..20),
    ) {
        let mut bank = SparseCoilBank::new(addresses);
        let mut map: BTreeMap<u32, bool> = addresses.iter().map(|address| (u32::from(*address), false)).collect();
        for (near, off, values) in writes {
            let first = addresses[near].saturating_sub(1).saturating_add(off);
            let block = || (u32::from(first)..).take(values.len());
            let exists = block().all(|address| map.contains_key(&address));
            let mut packed = vec![0u8; values.len().div_ceil(8)];
            for (bit, on) in values.iter().enumerate() {
                packed[bit / 8] += u8::from(*on) << (bit % 8);
            }
            let coils = Coils::new(&packed, values.len() as u16);
            prop_assert_eq!(bank.check(first, coils).is_ok(), exists);
            prop_assert_eq!(bank.write(first, coils).is_ok(), exists);
            if exists {
                map.extend(block().zip(values.iter().copied()));
            }
            prop_assert!(bank.cells().iter().eq(map.values()));

            let mut read = vec![0; packed.len()];
            let out = CoilsOut::new(&mut read, values.len() as u16);
            prop_assert_eq!(bank.read(first, out).is_ok(), exists);
            if exists {
                prop_assert_eq!(read, packed);
            }
        }
    }
}
