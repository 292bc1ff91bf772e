//! Blocks over the holes of a table of addresses, and the checks of a read and write in one request: of each part,
//! and again when the frame stands.

use multidrop_protocol::Adu;
use multidrop_protocol::data::{Registers, RegistersOut};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::port_registers::{PortRegisters, PortSettings, Register};
use multidrop_protocol::registers::{CoilBank, SparseBank};
use multidrop_protocol::rules;
use multidrop_protocol::server::{DataModel, FunctionSet, Server};

const ADDRESSES: [u16; 10] = [4, 5, 6, 7, 9, 1000, 1001, 30_000, 30_004, 63_023];

rules! {
    struct Limits: "RS4";
    VALID_REG { 4..=9, 1000..=1001, 30_000..=63_023 }
    VALID_DATA { 7..=7 => range(100..=200) }
    DISABLE_REG { 5..=6 }
}

type Slave = PortRegisters<SparseBank<10>, CoilBank<1>, Limits>;

/// Register n of the table holds 100 + n.
fn slave() -> Slave {
    let mut port = PortRegisters::new(
        PortSettings::DEFAULT,
        SparseBank::new(ADDRESSES),
        CoilBank::new(0, 8),
    );
    for index in 0..10 {
        port.load_raw(Register::Regs(index), 100 + u32::from(index))
            .unwrap();
    }
    port
}

/// The PDU answered to this PDU, where `between` happens after the request was looked at and before its frame stands.
fn answer(port: &mut Slave, pdu: &[u8], between: impl FnOnce(&mut Slave)) -> Vec<u8> {
    let server = Server::new(1);
    let mut adu: Adu = [0; 256];
    adu[0] = 1;
    adu[1..=pdu.len()].copy_from_slice(pdu);
    let len = pdu.len() as u8 + 1;
    let plan = server.prepare(port, &mut adu, len);
    between(port);
    let len = server.commit(port, &mut adu, len, plan);
    adu[1..len.into()].to_vec()
}

fn ask(port: &mut Slave, pdu: &[u8]) -> Vec<u8> {
    answer(port, pdu, |_| {})
}

fn words(code: u8, words: &[u16]) -> Vec<u8> {
    let mut pdu = vec![code];
    pdu.extend(words.iter().flat_map(|word| word.to_be_bytes()));
    pdu
}

/// FC 17: what is read, then what is written.
fn read_write(read: (u16, u16), first: u16, values: &[u16]) -> Vec<u8> {
    let mut pdu = words(0x17, &[read.0, read.1, first, values.len() as u16]);
    pdu.push(2 * values.len() as u8);
    pdu.extend(values.iter().flat_map(|word| word.to_be_bytes()));
    pdu
}

fn values(port: &Slave) -> Vec<u32> {
    (0..10)
        .map(|index| port.read(Register::Regs(index)).unwrap())
        .collect()
}

#[test]
fn a_block_is_there_whole_or_not_at_all() {
    let port = &mut slave();
    for first in 0..=65_535_u16 {
        // Every length that reaches over the longest hole between neighbours, and the shortest that does not.
        for count in [1, 2, 3, 4, 5, 6, 7] {
            let last = u32::from(first) + u32::from(count) - 1;
            let there = (u32::from(first)..=last)
                .map(|address| {
                    ADDRESSES
                        .iter()
                        .position(|known| u32::from(*known) == address)
                })
                .collect::<Option<Vec<_>>>();
            let expected = match &there {
                Some(places) => {
                    let mut pdu = vec![3, 2 * count as u8];
                    let values = places.iter().map(|place| 100 + *place as u16);
                    pdu.extend(values.flat_map(u16::to_be_bytes));
                    pdu
                }
                None => vec![0x83, 2],
            };
            assert_eq!(
                ask(port, &words(3, &[first, count])),
                expected,
                "{count} from {first}"
            );
            if there.is_none() {
                let mut write = words(16, &[first, count]);
                write.push(2 * count as u8);
                write.extend([0, 150].repeat(count.into()));
                assert_eq!(ask(port, &write), [0x90, 2], "{count} from {first}");
            }
        }
    }
    assert_eq!(values(port), (100..110).collect::<Vec<_>>());
}

#[test]
fn the_read_part_is_checked_before_anything_is_written() {
    let port = &mut slave();
    assert_eq!(
        ask(port, &read_write((4, 2), 1000, &[7, 8])),
        [0x17, 4, 0, 100, 0, 101]
    );
    assert_eq!(
        ask(port, &read_write((1000, 2), 1000, &[9, 10])),
        [0x17, 4, 0, 9, 0, 10]
    );
    let before = values(port);
    for read in [
        (8, 1),
        (7, 2),
        (9, 2),
        (0, 1),
        (63_023, 2),
        (65_535, 1),
        (65_535, 2),
    ] {
        assert_eq!(
            ask(port, &read_write(read, 1000, &[1, 2])),
            [0x97, 2],
            "{read:?}"
        );
    }
    for first in [3, 8, 9, 1001, 30_000, 63_023, 65_535] {
        assert_eq!(
            ask(port, &read_write((4, 1), first, &[1, 2])),
            [0x97, 2],
            "{first}"
        );
    }
    assert_eq!(values(port), before);
}

#[test]
fn a_flag_set_before_the_frame_stands_protects_the_register() {
    for pdu in [
        read_write((4, 1), 5, &[1]),
        read_write((4, 1), 5, &[1, 2]),
        words(0x16, &[6, 0, 150]),
    ] {
        let port = &mut slave();
        let before = values(port);
        let set = |value| {
            move |port: &mut Slave| {
                port.load_raw(Register::DisableFlg(0), value)
                    .map(drop)
                    .unwrap()
            }
        };
        assert_eq!(answer(port, &pdu, set(1)), [pdu[0] | 0x80, 7]);
        assert_eq!(values(port), before, "{pdu:02X?}");
        // Taken back in time it does no harm, and what is refused at once stays refused.
        assert_eq!(answer(port, &pdu, set(0)), [pdu[0] | 0x80, 7]);
        assert_eq!(values(port), before);
        assert_eq!(ask(port, &pdu)[0], pdu[0]);
        assert_ne!(values(port), before);
    }
}

#[test]
fn a_mask_applies_to_the_value_when_the_frame_stands() {
    let port = &mut slave();
    // With bit 7 set 103 becomes 231 and 120 becomes 248, which are out of 100..=200; 0 becomes 128.
    let mask = words(0x16, &[7, 0xFF7F, 0x80]);
    assert_eq!(ask(port, &mask), [0x96, 3]);
    port.load_raw(Register::Regs(3), 0).unwrap();
    let changed = |port: &mut Slave| port.load_raw(Register::Regs(3), 120).map(drop).unwrap();
    assert_eq!(answer(port, &mask, changed), [0x96, 3]);
    assert_eq!(port.read(Register::Regs(3)), Ok(120));
    port.load_raw(Register::Regs(3), 0).unwrap();
    assert_eq!(ask(port, &mask), mask);
    assert_eq!(port.read(Register::Regs(3)), Ok(128));
}

/// Registers everywhere, by a model that trusts what it is told: blocks do not run past 65535.
struct Trusting;

impl DataModel for Trusting {
    const FUNCTIONS: FunctionSet = FunctionSet::ALL;

    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        assert!(usize::from(first) + out.len() <= 65_536);
        Ok(())
    }

    fn check_holding_registers(&mut self, first: u16, count: u16) -> Result<(), Exception> {
        assert!(u32::from(first) + u32::from(count) <= 65_536);
        Ok(())
    }

    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        assert!(usize::from(first) + values.len() <= 65_536);
        Ok(())
    }

    fn write_registers(&mut self, _: u16, _: Registers<'_>) -> Result<(), Exception> {
        Ok(())
    }
}

#[test]
fn neither_part_runs_past_65535() {
    let server = Server::new(1);
    let ask = |pdu: Vec<u8>| {
        let mut adu: Adu = [0; 256];
        adu[0] = 1;
        adu[1..=pdu.len()].copy_from_slice(&pdu);
        let len = pdu.len() as u8 + 1;
        let plan = server.prepare(&mut Trusting, &mut adu, len);
        let len = server.commit(&mut Trusting, &mut adu, len, plan);
        adu[1..len.into()][..2].to_vec()
    };
    assert_eq!(ask(read_write((65_534, 2), 65_535, &[1])), [0x17, 4]);
    assert_eq!(ask(read_write((65_534, 3), 0, &[1])), [0x97, 2]);
    assert_eq!(ask(read_write((65_535, 125), 0, &[1])), [0x97, 2]);
    assert_eq!(ask(read_write((0, 1), 65_535, &[1, 2])), [0x97, 2]);
}

#[test]
fn both_parts_of_fc_17_have_a_quantity() {
    let port = &mut slave();
    assert_eq!(ask(port, &read_write((4, 1), 4, &[])), [0x97, 3]);
    assert_eq!(ask(port, &read_write((4, 0), 4, &[1])), [0x97, 3]);
    // As many as a frame carries are a matter of their addresses.
    for (read, written, code) in [(125, 121, 2), (126, 121, 3)] {
        let pdu = read_write((4, read), 4, &vec![0; written]);
        assert_eq!(
            ask(port, &pdu),
            [0x97, code],
            "{read} read, {written} written"
        );
    }
}
