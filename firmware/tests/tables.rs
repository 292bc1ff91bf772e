//! A data model built from banks answers as one that is written by hand: what exists, what is written, which exception comes first.

use multidrop::prelude::*;
use multidrop::protocol::registers::{SparseBank, SparseCoilBank};
use multidrop::protocol::server::{ApplicationFunction, FunctionSet, Server};

const ILLEGAL_FUNCTION: u8 = 1;
const ILLEGAL_ADDRESS: u8 = 2;
const ILLEGAL_VALUE: u8 = 3;
const NEGATIVE_ACKNOWLEDGE: u8 = 7;

rules! {
    struct Limits: "RS4";
    VALID_REG { 100..=106 }
    VALID_DATA { 101..=102 => range(50..=800) }
    DISABLE_REG { 102..=103 }
}

/// The PDU that answers this one.
fn ask<M: DataModel>(model: &mut M, pdu: &[u8]) -> Vec<u8> {
    let server = Server::new(1);
    let mut frame = [0; 256];
    frame[0] = 1;
    frame[1..=pdu.len()].copy_from_slice(pdu);
    let len = pdu.len() as u8 + 1;
    let plan = server.prepare(model, &mut frame, len);
    let len = server.commit(model, &mut frame, len, plan);
    frame[1..usize::from(len)].to_vec()
}

/// A request of two words, which four functions read and two write.
fn words(function: u8, first: u16, second: u16) -> Vec<u8> {
    let [a, b] = first.to_be_bytes();
    let [c, d] = second.to_be_bytes();
    vec![function, a, b, c, d]
}

/// Write Multiple Registers.
fn write(first: u16, values: &[u16]) -> Vec<u8> {
    let mut pdu = words(0x10, first, values.len() as u16);
    pdu.push(2 * values.len() as u8);
    pdu.extend(values.iter().flat_map(|value| value.to_be_bytes()));
    pdu
}

fn exception(function: u8, code: u8) -> Vec<u8> {
    vec![function | 0x80, code]
}

/// Compares what each block of up to nine items is answered with what plain Rust says: the items at these addresses.
fn compare_reads<M: DataModel>(
    model: &mut M,
    function: u8,
    is_bits: bool,
    item: impl Fn(u16) -> Option<u16>,
) {
    for first in (0..=1010_u16).chain(65_530..=65_535) {
        for count in 1..=9_u16 {
            let items: Option<Vec<u16>> = (0..count)
                .map(|offset| first.checked_add(offset).and_then(&item))
                .collect();
            let right = match items {
                None => exception(function, ILLEGAL_ADDRESS),
                Some(items) if is_bits => {
                    let mut bytes = vec![0; items.len().div_ceil(8)];
                    for (index, &bit) in items.iter().enumerate() {
                        bytes[index / 8] |= (bit as u8) << (index % 8);
                    }
                    [vec![function, bytes.len() as u8], bytes].concat()
                }
                Some(items) => {
                    let bytes = items.iter().flat_map(|item| item.to_be_bytes());
                    [vec![function, 2 * items.len() as u8], bytes.collect()].concat()
                }
            };
            let answer = ask(model, &words(function, first, count));
            assert_eq!(answer, right, "function {function}, {count} from {first}");
        }
    }
}

#[test]
fn each_table_has_the_items_of_its_bank_and_no_others() {
    let mut tables = Tables::new()
        .holding(Bank::from_cells(100, [7, 8, 9, 10, 11, 12, 13]))
        .inputs(SparseBank::from_cells([3, 4, 6, 1000], [33, 44, 66, 1]))
        .coils(CoilBank::from_bytes(900, 12, [0b1010_0110, 0b1001]))
        .discrete(SparseCoilBank::from_cells([5, 6, 7], [true, false, true]));
    compare_reads(&mut tables, 3, false, |address| match address {
        100..=106 => Some(address - 93),
        _ => None,
    });
    compare_reads(&mut tables, 4, false, |address| match address {
        3 | 4 | 6 => Some(address * 11),
        1000 => Some(1),
        _ => None,
    });
    compare_reads(&mut tables, 1, true, |address| match address {
        900..=911 => Some(0b1001_1010_0110 >> (address - 900) & 1),
        _ => None,
    });
    compare_reads(&mut tables, 2, true, |address| match address {
        5..=7 => Some(address & 1),
        _ => None,
    });
}

#[test]
fn computed_inputs_follow_from_their_address() {
    let mut tables = Tables::new()
        .inputs(Computed::<1000, 8, _>(|address| 0x1000 + address))
        .discrete(Computed::<2, 30, _>(|address| address % 3 == 0));
    compare_reads(&mut tables, 4, false, |address| match address {
        1000..=1007 => Some(0x1000 + address),
        _ => None,
    });
    compare_reads(&mut tables, 2, true, |address| match address {
        2..=31 => Some(u16::from(address % 3 == 0)),
        _ => None,
    });
}

#[test]
fn writes_change_the_items_that_they_name() {
    let mut tables = Tables::new()
        .holding(Bank::<4>::new(10))
        .coils(CoilBank::<2>::new(0, 16));
    let echo = words(6, 12, 0xABCD);
    assert_eq!(ask(&mut tables, &echo), echo);
    assert_eq!(ask(&mut tables, &write(10, &[1, 2])), words(0x10, 10, 2));
    assert_eq!(tables.holding.cells(), &[1, 2, 0xABCD, 0]);
    let echo = words(5, 15, 0xFF00);
    assert_eq!(ask(&mut tables, &echo), echo);
    let mut pdu = words(0x0F, 1, 3);
    pdu.extend([1, 0b101]);
    assert_eq!(ask(&mut tables, &pdu), words(0x0F, 1, 3));
    assert_eq!(tables.coils.bytes(), &[0b1010, 0x80]);
    // One item of the block is missing: nothing is written.
    let answer = ask(&mut tables, &write(12, &[5, 6, 7]));
    assert_eq!(answer, exception(0x10, ILLEGAL_ADDRESS));
    assert_eq!(tables.holding.cells(), &[1, 2, 0xABCD, 0]);
    let answer = ask(&mut tables, &words(5, 16, 0xFF00));
    assert_eq!(answer, exception(5, ILLEGAL_ADDRESS));
}

#[test]
fn addresses_come_before_disabled_ranges_and_those_before_values() {
    let mut tables = Tables::new().holding(Bank::<8>::new(100)).rules(Limits);
    let wrong = write(101, &[900, 900]);
    // 107 is in the bank and not in VALID_REG, 108 in neither.
    for (first, last) in [(106, 107), (107, 108)] {
        let answer = ask(&mut tables, &write(first, &[1, 2]));
        assert_eq!(answer, exception(0x10, ILLEGAL_ADDRESS), "{first}");
        let answer = ask(&mut tables, &words(3, first, last - first + 1));
        assert_eq!(answer, exception(3, ILLEGAL_ADDRESS), "{first}");
    }
    assert_eq!(ask(&mut tables, &wrong), exception(0x10, ILLEGAL_VALUE));
    tables.rules.flags = 1;
    assert_eq!(
        ask(&mut tables, &wrong),
        exception(0x10, NEGATIVE_ACKNOWLEDGE)
    );
    // Reads do not care, and neither do writes beside the range.
    assert_eq!(ask(&mut tables, &words(3, 102, 1)), [3, 2, 0, 0]);
    assert_eq!(ask(&mut tables, &words(6, 101, 50)), words(6, 101, 50));
    assert_eq!(tables.holding.get(101), Some(50));
    // 103 is not in this bank, and the value for 102 is wrong.
    let mut small = Tables::new().holding(Bank::<2>::new(101)).rules(Limits);
    let answer = ask(&mut small, &write(102, &[900, 1]));
    assert_eq!(answer, exception(0x10, ILLEGAL_ADDRESS));
    // A quantity of 0 is wrong wherever it is.
    let answer = ask(&mut tables, &words(3, 500, 0));
    assert_eq!(answer, exception(3, ILLEGAL_VALUE));
}

#[test]
fn what_is_not_given_does_not_exist() {
    let requests = [
        words(1, 0, 1),
        words(2, 0, 1),
        words(3, 0, 1),
        words(4, 0, 1),
        words(5, 0, 0xFF00),
        words(6, 0, 1),
        [words(0x0F, 0, 1), vec![1, 1]].concat(),
        write(0, &[1]),
    ];
    let answered = |has: fn(&[u8]) -> Vec<u8>| -> Vec<u8> {
        let is_there = |request: &&Vec<u8>| has(request) != exception(request[0], ILLEGAL_FUNCTION);
        let there = requests.iter().filter(is_there);
        there.map(|request| request[0]).collect()
    };
    let none = answered(|pdu| ask(&mut Tables::new(), pdu));
    assert_eq!(none, []);
    let holding = answered(|pdu| ask(&mut Tables::new().holding(Bank::<1>::new(0)), pdu));
    assert_eq!(holding, [3, 6, 0x10]);
    let inputs = answered(|pdu| ask(&mut Tables::new().inputs(Bank::<1>::new(0)), pdu));
    assert_eq!(inputs, [4]);
    let coils = answered(|pdu| ask(&mut Tables::new().coils(CoilBank::<1>::new(0, 1)), pdu));
    assert_eq!(coils, [1, 5, 0x0F]);
    let discrete = answered(|pdu| ask(&mut Tables::new().discrete(CoilBank::<1>::new(0, 1)), pdu));
    assert_eq!(discrete, [2]);
    assert_eq!(size_of_val(&Tables::new()), 0);
    let bank = Tables::new().holding(Bank::<1>::new(0));
    assert_eq!(size_of_val(&bank), size_of::<Bank<1>>());
}

/// What `functions` is given.
struct Reverse;

type Own = Tables<
    Bank<2>,
    multidrop::tables::Absent,
    multidrop::tables::Absent,
    multidrop::tables::Absent,
    multidrop::tables::Ruled<Limits>,
    Reverse,
>;

impl Functions<Own> for Reverse {
    const STANDARD: FunctionSet = FunctionSet::EIGHT.with(0x16).with(0x17);
    const OWN: &'static [ApplicationFunction<Own>] = &[ApplicationFunction {
        code: 0x41,
        broadcast: false,
        run: |tables, pdu, len| {
            tables.holding.set(100, 0xBEEF);
            pdu[1..len].reverse();
            Ok(len)
        },
    }];
}

#[test]
fn functions_of_the_application_reach_the_banks() {
    let mut tables: Own = Tables::new()
        .holding(Bank::new(100))
        .rules(Limits)
        .functions(Reverse);
    assert_eq!(ask(&mut tables, &[0x41, 1, 2, 3]), [0x41, 3, 2, 1]);
    assert_eq!(tables.holding.get(100), Some(0xBEEF));
    assert_eq!(ask(&mut tables, &[0x42]), exception(0x42, ILLEGAL_FUNCTION));
    // Mask Write Register: (0xBEEF & 0x00FF) | (0x1200 & !0x00FF).
    let pdu = [words(0x16, 100, 0x00FF), vec![0x12, 0]].concat();
    assert_eq!(ask(&mut tables, &pdu), pdu);
    assert_eq!(tables.holding.get(100), Some(0x12EF));
    // Read/Write Multiple Registers reads two and writes one; of three one does not exist.
    let head = |count| [words(0x17, 100, count), words(0x17, 100, 1)[1..].to_vec()].concat();
    let pdu = [head(2), vec![2, 0, 77]].concat();
    assert_eq!(ask(&mut tables, &pdu), [0x17, 4, 0, 77, 0, 0]);
    let pdu = [head(3), vec![2, 0, 88]].concat();
    assert_eq!(ask(&mut tables, &pdu), exception(0x17, ILLEGAL_ADDRESS));
    assert_eq!(tables.holding.get(100), Some(77));
    // Functions of tables that are not given are none of the standard's eight any more.
    assert_eq!(
        ask(&mut tables, &words(1, 0, 1)),
        exception(1, ILLEGAL_FUNCTION)
    );
}
