//! Rules against a plain reading of the lists, and the example of the register set's own description.

use multidrop_protocol::data::Registers;
use multidrop_protocol::exception::Exception;
use multidrop_protocol::registers::{NoRules, RuleList, Rules, Span};
use multidrop_protocol::rules;
use proptest::prelude::*;

const LOW: u16 = 65_530;

rules! {
    /// Neighbouring ranges, gaps, both ends of the address space, lists out of order.
    struct Mixed: "RS4";
    VALID_REG { 40..=50, 0..=9, 10..=19, LOW..=65_535 }
    VALID_DATA {
        45..=46 => list(7),
        5..=12 => range(100..=200),
        0..=0 => range(0..=0),
        LOW..=65_535 => list(0, 1, 65_535),
        13..=14 => range(65_535..=65_535),
    }
    DISABLE_REG { 8..=11, 50..=50, 65_535..=65_535, 18..=41 }
}

/// The lists of the rules as data.
mod plain {
    pub const VALID: [(u32, u32); 4] = [(40, 50), (0, 9), (10, 19), (65_530, 65_535)];
    pub const DISABLE: [(u32, u32); 4] = [(8, 11), (50, 50), (65_535, 65_535), (18, 41)];

    pub fn takes(register: u32, value: u16) -> bool {
        match register {
            45 | 46 => value == 7,
            0 => value == 0,
            5..=12 => (100..201).contains(&value),
            65_530.. => [0, 1, 65_535].contains(&value),
            13 | 14 => value == 65_535,
            _ => true,
        }
    }

    /// One register after the other, and each list to its end before the next.
    pub fn check(first: u16, values: &[u16], flags: u32) -> u8 {
        let block = || (u32::from(first)..).zip(values);
        let within = |register, (low, high)| low <= register && register <= high;
        if block().any(|(register, _)| !VALID.iter().any(|range| within(register, *range))) {
            return 2;
        }
        let disabled = |register| {
            DISABLE
                .iter()
                .enumerate()
                .any(|(bit, range)| within(register, *range) && flags >> bit & 1 == 1)
        };
        if block().any(|(register, _)| disabled(register)) {
            return 7;
        }
        if block().any(|(register, value)| !takes(register, *value)) {
            return 3;
        }
        0
    }
}

fn bytes(values: &[u16]) -> Vec<u8> {
    values
        .iter()
        .flat_map(|value| value.to_be_bytes())
        .collect()
}

fn code(checked: Result<(), Exception>) -> u8 {
    checked.map_or_else(Exception::code, |()| 0)
}

fn near_an_edge() -> impl Strategy<Value = u16> {
    prop_oneof![0u16..60, 65_500u16..=65_535]
}

fn likely_value() -> impl Strategy<Value = u16> {
    prop_oneof![
        4 => prop::sample::select(vec![0, 1, 7, 99, 100, 150, 200, 201, 65_535]),
        1 => any::<u16>(),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(5_000))]

    #[test]
    fn a_write_is_checked_against_the_lists(
        first in near_an_edge(),
        values in prop::collection::vec(likely_value(), 1..24),
        flags in prop_oneof![Just(0u32), any::<u32>()],
    ) {
        let judged = Mixed::check_write(first, Registers::new(&bytes(&values)), flags);
        prop_assert_eq!(code(judged), plain::check(first, &values, flags));
    }

    #[test]
    fn a_block_of_allowed_values_is_allowed(
        first in prop_oneof![0u16..20, 40u16..51],
        count in 1usize..12,
    ) {
        let values: Vec<u16> = (u32::from(first)..)
            .take(count)
            .map(|register| (0..=65_535).find(|value| plain::takes(register, *value)).unwrap())
            .collect();
        let judged = code(Mixed::check_write(first, Registers::new(&bytes(&values)), 0));
        prop_assert_eq!(judged, plain::check(first, &values, 0));
        prop_assert!(judged == 0 || judged == 2);
    }

    #[test]
    fn a_read_is_bound_by_the_valid_registers_alone(first in near_an_edge(), count in 1u16..126) {
        let known = |register: u32| plain::VALID.iter().any(|&(low, high)| (low..=high).contains(&register));
        let exists = (u32::from(first)..).take(count.into()).all(known);
        prop_assert_eq!(Mixed::check_read(first, count).is_ok(), exists);
    }
}

rules! {
    /// The example of iDevOS.
    struct Example: "RS4";
    VALID_REG { 10..=90, 120..=190, 1000..=1000 }
    VALID_DATA { 10..=15 => range(100..=200), 1000..=1000 => list(1, 2, 3) }
    DISABLE_REG { 10..=20, 109..=130, 191..=199 }
}

#[test]
fn address_comes_before_disabled_and_disabled_before_value() {
    let check = |first, values: &[u16], flags| {
        code(Example::check_write(
            first,
            Registers::new(&bytes(values)),
            flags,
        ))
    };
    assert_eq!(check(15, &[200, 0], 0), 0);
    assert_eq!(check(15, &[201, 0], 0), 3);
    assert_eq!(check(9, &[100, 201], 0b001), 2);
    assert_eq!(check(15, &[201, 0], 0b001), 7);
    assert_eq!(check(15, &[201, 0], 0b110), 3);
    assert_eq!(check(20, &[0, 0], 0b001), 7);
    assert_eq!(check(21, &[0, 0], 0b001), 0);
    assert_eq!(check(125, &[0], 0b010), 7);
    assert_eq!(check(131, &[0], 0b010), 0);
    // Outside of the valid ones, whatever the flag says.
    assert_eq!(check(191, &[0], 0b100), 2);
    for value in 0..10 {
        assert_eq!(check(1000, &[value], 0) == 0, (1..4).contains(&value));
    }
}

#[test]
fn the_rules_of_a_list_can_be_counted_and_read() {
    assert_eq!(
        (
            Example::VALID_REG,
            Example::VALID_DATA,
            Example::DISABLE_REG
        ),
        (3, 2, 3)
    );
    let span = |first, last| Some(Span { first, last });
    assert_eq!(Example::registers(RuleList::ValidReg, 1), span(120, 190));
    assert_eq!(Example::registers(RuleList::ValidData, 0), span(10, 15));
    assert_eq!(Example::registers(RuleList::DisableReg, 2), span(191, 199));
    assert_eq!(Example::registers(RuleList::DisableReg, 3), None);
}

#[test]
fn more_values_than_a_request_has_are_refused() {
    let judged = |count: usize| NoRules::check_write(0, Registers::new(&vec![0; 2 * count]), 0);
    assert_eq!(judged(255), Ok(()));
    assert_eq!(judged(256), Err(Exception::IllegalDataValue));
    assert_eq!(judged(0), Ok(()));
}

#[test]
fn without_rules_every_value_is_allowed() {
    assert_eq!(
        NoRules::check_write(65_535, Registers::new(&[9, 9]), u32::MAX),
        Ok(())
    );
    assert_eq!(
        NoRules::check_write(65_535, Registers::new(&[9; 4]), 0),
        Err(Exception::IllegalDataAddress)
    );
    assert_eq!(NoRules::check_read(0, 125), Ok(()));
}
