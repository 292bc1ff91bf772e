//! Rules that stop the build, and their messages.

use multidrop_protocol::data::Registers;
use multidrop_protocol::exception::Exception;
use multidrop_protocol::registers::rules_check::{DISABLE_MAX, List, RULES_MAX, Values, check};
use multidrop_protocol::registers::{NoRules, RuleList, Rules, Span};
use std::panic::catch_unwind;

/// What stops the build; nothing if it goes on.
fn said(lists: Vec<(&'static str, Vec<(Span, Values)>)>) -> Option<String> {
    let lists: Vec<List> = lists
        .into_iter()
        .map(|(name, rules)| (name, &*rules.leak()))
        .collect();
    let said = catch_unwind(|| check("RS4", &lists)).err()?;
    Some(*said.downcast::<String>().expect("a text"))
}

fn span(first: u16, last: u16) -> Span {
    Span { first, last }
}

fn ranges(name: &'static str, spans: &[(u16, u16)]) -> Option<String> {
    let rules: Vec<_> = spans
        .iter()
        .map(|(first, last)| (span(*first, *last), Values::Any))
        .collect();
    said(vec![(name, rules)])
}

#[test]
fn right_rules_pass() {
    assert_eq!(said(vec![]), None);
    assert_eq!(ranges("VALID_REG", &[(0, 65_535)]), None);
    assert_eq!(
        ranges("VALID_REG", &[(5, 5), (6, 9), (0, 4), (10, 10)]),
        None
    );
    let rules = vec![
        (span(1, 1), Values::Range(span(7, 7))),
        (span(2, 9), Values::Range(span(0, 65_535))),
        (span(10, 10), Values::List(&[3])),
    ];
    assert_eq!(said(vec![("VALID_DATA", rules)]), None);
}

#[test]
fn a_list_is_not_empty_and_not_too_long() {
    let empty = ranges("VALID_REG", &[]);
    assert_eq!(
        empty.as_deref(),
        Some("port RS4: VALID_REG is empty, must have a range or be left out")
    );
    for (name, max) in [
        ("DISABLE_REG", DISABLE_MAX),
        ("VALID_REG", RULES_MAX),
        ("VALID_DATA", RULES_MAX),
    ] {
        let spans: Vec<_> = (0..=max as u16).map(|place| (place, place)).collect();
        assert_eq!(ranges(name, &spans[..max]), None);
        assert_eq!(
            ranges(name, &spans),
            Some(format!(
                "port RS4: {name} has {} ranges, must be at most {max}",
                max + 1
            ))
        );
    }
}

#[test]
fn ranges_are_not_reversed_and_do_not_overlap() {
    assert_eq!(
        ranges("VALID_REG", &[(1, 1), (10, 9)]).as_deref(),
        Some("port RS4: VALID_REG 10..=9: the first register must not be above the last one")
    );
    // By one register at either end, inside, around, and equal.
    for (first, last) in [(20, 22), (1, 10), (12, 13), (5, 30), (10, 20), (10, 10)] {
        assert_eq!(
            ranges("DISABLE_REG", &[(10, 20), (40, 50), (first, last)]),
            Some(format!(
                "port RS4: DISABLE_REG {first}..={last} overlaps 10..=20"
            ))
        );
    }
    assert_eq!(ranges("DISABLE_REG", &[(10, 20), (21, 22), (0, 9)]), None);
    // Lists have nothing to do with each other.
    let both = || vec![(span(3, 4), Values::Any)];
    let lists = vec![("VALID_REG", both()), ("DISABLE_REG", both())];
    assert_eq!(said(lists), None);
}

#[test]
fn a_rule_must_allow_a_value() {
    let reversed = vec![(span(1, 2), Values::Range(span(9, 8)))];
    assert_eq!(
        said(vec![("VALID_DATA", reversed)]).as_deref(),
        Some("port RS4: VALID_DATA 1..=2: low is 9, must not be above high, which is 8")
    );
    let nothing = vec![
        (span(0, 0), Values::List(&[1])),
        (span(1, 2), Values::List(&[])),
    ];
    assert_eq!(
        said(vec![("VALID_DATA", nothing)]).as_deref(),
        Some("port RS4: VALID_DATA 1..=2: list is empty, must have a value")
    );
}

#[test]
fn without_rules_every_value_is_allowed_up_to_the_last_address() {
    let values = [0; 2 * 256];
    for (first, count) in [(0, 1), (65_535, 1), (65_530, 6), (100, 125)] {
        assert_eq!(NoRules::check_read(first, count), Ok(()));
        let values = Registers::new(&values[..2 * usize::from(count)]);
        assert_eq!(NoRules::check_write(first, values, u32::MAX), Ok(()));
    }
    let absent = Err(Exception::IllegalDataAddress);
    assert_eq!(NoRules::check_read(65_535, 2), absent);
    assert_eq!(
        NoRules::check_write(65_535, Registers::new(&values[..4]), 0),
        absent
    );
    assert_eq!(NoRules::check_read(65_535, 0), Ok(()));
    assert_eq!(NoRules::check_write(65_535, Registers::new(&[]), 0), Ok(()));
    let write = |count: usize| NoRules::check_write(0, Registers::new(&values[..2 * count]), 0);
    assert_eq!(
        (write(255), write(256)),
        (Ok(()), Err(Exception::IllegalDataValue))
    );
    for list in [
        RuleList::ValidReg,
        RuleList::ValidData,
        RuleList::DisableReg,
    ] {
        assert_eq!(NoRules::registers(list, 0), None);
    }
    assert_eq!(Span::of(&(3..=9)), span(3, 9));
}
