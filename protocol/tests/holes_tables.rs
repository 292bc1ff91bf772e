//! Tables of addresses with holes, with every function that reads or writes a block: a block exists whole or not at
//! all, and no item is taken for its neighbour.

use std::collections::BTreeMap;

use multidrop_protocol::Adu;
use multidrop_protocol::data::{Registers, RegistersOut};
use multidrop_protocol::port_registers::{PortRegisters, PortSettings, Register};
use multidrop_protocol::registers::{Items, NoRules, ScanList, SparseBank, SparseCoilBank};
use multidrop_protocol::server::Server;

const REGISTERS: [u16; 10] = [4, 5, 6, 7, 9, 1000, 1001, 30_000, 30_004, 63_023];
/// Blocks of one to eighteen neighbours, up to both ends.
const COILS: [u16; 36] = [
    0, 1, 2, 4, 6, 7, 100, 101, 102, 103, 104, 105, 106, 107, 109, 110, 111, 112, 113, 114, 115,
    116, 117, 118, 119, 120, 121, 122, 123, 124, 125, 126, 30_000, 65_533, 65_534, 65_535,
];

type Slave<R> = PortRegisters<R, SparseCoilBank<36>, NoRules>;

/// A slave and what it is to hold.
struct Pair<R: Items<Item = u16>> {
    slave: Slave<R>,
    registers: BTreeMap<u32, u16>,
    coils: BTreeMap<u32, bool>,
}

fn pair<R: Items<Item = u16> + 'static>(regs: R) -> Pair<R> {
    let mut slave = PortRegisters::new(PortSettings::DEFAULT, regs, SparseCoilBank::new(COILS));
    let mut registers = BTreeMap::new();
    for index in 0..slave.regs().len() as u16 {
        let address = slave.regs().address_of(index).expect("an item");
        slave
            .load_raw(Register::Regs(index), 0x100 + u32::from(index))
            .unwrap();
        // Of those that are there twice the first is served.
        registers.entry(address.into()).or_insert(0x100 + index);
    }
    let mut coils = BTreeMap::new();
    for (index, address) in COILS.iter().enumerate() {
        let on = index * index % 7 < 3;
        slave
            .load_raw(Register::Coils(index as u16), on.into())
            .unwrap();
        coils.insert(u32::from(*address), on);
    }
    Pair {
        slave,
        registers,
        coils,
    }
}

fn words(code: u8, words: &[u16]) -> Vec<u8> {
    let mut pdu = vec![code];
    pdu.extend(words.iter().flat_map(|word| word.to_be_bytes()));
    pdu
}

fn packed(bits: &[bool]) -> Vec<u8> {
    let bytes = bits.chunks(8);
    bytes
        .map(|eight| {
            let places = eight.iter().enumerate();
            places.map(|(place, on)| u8::from(*on) << place).sum()
        })
        .collect()
}

/// The items of a block, if all of them are there.
fn block<T: Copy>(map: &BTreeMap<u32, T>, first: u16, count: u16) -> Option<Vec<T>> {
    (u32::from(first)..u32::from(first) + u32::from(count))
        .map(|address| map.get(&address).copied())
        .collect()
}

impl<R: Items<Item = u16> + 'static> Pair<R> {
    fn ask(&mut self, pdu: &[u8]) -> Vec<u8> {
        let server = Server::new(1);
        let mut adu: Adu = [0xA5; 256];
        adu[0] = 1;
        adu[1..=pdu.len()].copy_from_slice(pdu);
        let len = pdu.len() as u8 + 1;
        let plan = server.prepare(&mut self.slave, &mut adu, len);
        let len = server.commit(&mut self.slave, &mut adu, len, plan);
        adu[1..len.into()].to_vec()
    }

    /// Functions 03 and 04.
    fn reads(&mut self, first: u16, count: u16) {
        let expected = block(&self.registers, first, count);
        for code in [3, 4] {
            let told = self.ask(&words(code, &[first, count]));
            let expected = match &expected {
                Some(values) => {
                    let mut pdu = vec![code, 2 * count as u8];
                    pdu.extend(values.iter().flat_map(|value| value.to_be_bytes()));
                    pdu
                }
                None => vec![code | 0x80, 2],
            };
            assert_eq!(told, expected, "{code}: {count} from {first}");
        }
    }

    /// Functions 01 and 02.
    fn reads_bits(&mut self, first: u16, count: u16) {
        let expected = block(&self.coils, first, count);
        for code in [1, 2] {
            let told = self.ask(&words(code, &[first, count]));
            let expected = match &expected {
                Some(bits) => {
                    let bytes = packed(bits);
                    [vec![code, bytes.len() as u8], bytes].concat()
                }
                None => vec![code | 0x80, 2],
            };
            assert_eq!(told, expected, "{code}: {count} from {first}");
        }
    }

    /// Function 06 or 10, and that nothing else has changed.
    fn writes(&mut self, first: u16, values: &[u16]) {
        let request = match values {
            [value] => words(6, &[first, *value]),
            _ => {
                let mut pdu = words(16, &[first, values.len() as u16]);
                pdu.push(2 * values.len() as u8);
                pdu.extend(values.iter().flat_map(|value| value.to_be_bytes()));
                pdu
            }
        };
        let is_there = block(&self.registers, first, values.len() as u16).is_some();
        let told = self.ask(&request);
        match is_there {
            true => {
                assert_eq!(told, request[..5]);
                let addresses = u32::from(first)..;
                self.registers.extend(addresses.zip(values.iter().copied()));
            }
            false => assert_eq!(told, [request[0] | 0x80, 2], "{values:?} from {first}"),
        }
        self.is_as_it_is_to_be();
    }

    /// Function 05 or 0F.
    fn writes_bits(&mut self, first: u16, bits: &[bool]) {
        let request = match bits {
            [on] => words(5, &[first, if *on { 0xFF00 } else { 0 }]),
            _ => {
                let bytes = packed(bits);
                let head = words(15, &[first, bits.len() as u16]);
                [head, vec![bytes.len() as u8], bytes].concat()
            }
        };
        let is_there = block(&self.coils, first, bits.len() as u16).is_some();
        let told = self.ask(&request);
        match is_there {
            true => {
                assert_eq!(told, request[..5]);
                let addresses = u32::from(first)..;
                self.coils.extend(addresses.zip(bits.iter().copied()));
            }
            false => assert_eq!(told, [request[0] | 0x80, 2], "{bits:?} from {first}"),
        }
        self.is_as_it_is_to_be();
    }

    /// Sends function 16.
    fn masks(&mut self, address: u16, and: u16, or: u16) {
        let request = words(0x16, &[address, and, or]);
        let told = self.ask(&request);
        match self.registers.get_mut(&address.into()) {
            Some(value) => {
                assert_eq!(told, request);
                *value = *value & and | or & !and;
            }
            None => assert_eq!(told, [0x96, 2], "{address}"),
        }
        self.is_as_it_is_to_be();
    }

    fn is_as_it_is_to_be(&self) {
        let regs = self.slave.regs();
        for (address, value) in &self.registers {
            let index = regs.index_of(*address as u16).expect("in the table");
            assert_eq!(regs.item(index), Some(*value), "register {address}");
        }
        let coils = self.slave.coils();
        for (address, on) in &self.coils {
            let index = coils.index_of(*address as u16).expect("in the table");
            assert_eq!(coils.item(index), Some(*on), "coil {address}");
        }
    }
}

/// Each address of a table, the two before it and the two behind it.
fn near(table: &[u16]) -> Vec<u16> {
    let mut near: Vec<u16> = table
        .iter()
        .flat_map(|&address| {
            [-2, -1, 0, 1, 2].map(|off| (i32::from(address) + off).clamp(0, 65_535) as u16)
        })
        .collect();
    near.sort_unstable();
    near.dedup();
    near
}

#[test]
fn registers_over_holes_by_every_function() {
    let mut pair = pair(SparseBank::new(REGISTERS));
    let mut value = 0x4000;
    for first in near(&REGISTERS) {
        for count in (1..=9).chain([124, 125]) {
            if u32::from(first) + u32::from(count) <= 65_536 {
                pair.reads(first, count);
            }
        }
        for count in 1..=5 {
            let values: Vec<u16> = (value..).take(count).collect();
            value += 16;
            pair.writes(first, &values);
        }
        pair.masks(first, 0xF0F0, 0x1234);
    }
}

#[test]
fn coils_over_holes_by_every_function() {
    let mut pair = pair(SparseBank::new(REGISTERS));
    let mut seed = 1_u32;
    for first in near(&COILS) {
        let room = 65_536 - u32::from(first);
        for count in (1..=20).chain([999, 2000]) {
            if u32::from(count) <= room {
                pair.reads_bits(first, count);
            }
        }
        for count in (1..=19).filter(|count| *count <= room) {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let bits: Vec<bool> = (0..count).map(|bit| seed >> (bit + 8) & 1 == 1).collect();
            pair.writes_bits(first, &bits);
        }
    }
}

/// Behind a table is nothing, and address 0 does not follow 65535.
#[test]
fn a_block_does_not_go_round() {
    let mut pair = pair(SparseBank::new([0, 1, 65_534, 65_535]));
    for (code, first, count) in [
        (3, 65_535, 2),
        (4, 65_534, 3),
        (1, 65_535, 2),
        (2, 65_533, 4),
    ] {
        assert_eq!(
            pair.ask(&words(code, &[first, count])),
            [code | 0x80, 2],
            "{code}: {count} from {first}"
        );
    }
    pair.reads(65_534, 2);
    pair.reads(0, 2);
    pair.reads_bits(65_533, 3);
    let mut write = words(16, &[65_535, 2]);
    write.extend([4, 0xAA, 0xAA, 0xBB, 0xBB]);
    assert_eq!(pair.ask(&write), [0x90, 2]);
    let mut write = words(15, &[65_535, 2]);
    write.extend([1, 3]);
    assert_eq!(pair.ask(&write), [0x8F, 2]);
    pair.is_as_it_is_to_be();
    // Nor where no server has looked at it before.
    let mut bank = SparseBank::new([0, 1, 65_534, 65_535]);
    let mut bytes = [0xEE; 4];
    for first in [65_535, 65_534] {
        let is_there = first == 65_534;
        assert_eq!(bank.check(first, Registers::new(&bytes)).is_ok(), is_there);
        assert_eq!(
            bank.read(first, RegistersOut::new(&mut bytes)).is_ok(),
            is_there
        );
    }
    assert!(bank.write(65_535, Registers::new(&[1; 4])).is_err());
    assert_eq!(bank.cells(), &[0; 4]);
}

/// The list of a master that is loaded to be a slave: its addresses are in any order, and some are there twice.
#[test]
fn a_scan_list_is_served_by_its_addresses() {
    let addresses = [9, 4, 1000, 5, 4, 65_535, 6, 1001];
    let list = ScanList::new(addresses, [1; 8]);
    let mut pair = pair(list);
    for first in near(&addresses) {
        for count in 1..=4 {
            if u32::from(first) + u32::from(count) <= 65_536 {
                pair.reads(first, count);
            }
        }
        pair.writes(first, &[0x4000 + first % 100]);
        pair.masks(first, 0xFFF0, 5);
    }
    // The second one with address 4 is served to nobody.
    assert_eq!(pair.slave.regs().item(4), Some(0x104));
}
