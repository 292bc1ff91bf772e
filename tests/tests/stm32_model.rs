//! The image `conformance` of the STM32 in QEMU against the plain model of its unit: random requests of all functions and damaged
//! frames on the wire, and each time the same answer. All tables, counters and the log are read back again and again.

mod common;

use common::LINE;
use common::conforms::{Board, holds};
use common::plain::wire::{Flaw, Way};
use multidrop_bus::{Format, Line};

const FAST: Line = Line::n81(115_200);

#[test]
fn random_requests_at_115200() {
    for seed in 1..=2 {
        holds(
            Board::Stm32,
            Way::Rtu,
            FAST,
            &[Flaw::Gap, Flaw::Framing],
            seed,
            850,
        );
    }
}

#[test]
fn random_requests_with_parity() {
    let line = Line {
        format: Format::E81,
        ..LINE
    };
    let flaws = [Flaw::Gap, Flaw::Framing, Flaw::Parity];
    holds(Board::Stm32, Way::Rtu, line, &flaws, 3, 300);
}

#[test]
fn random_requests_in_ascii() {
    let line = Line {
        format: Format::E71,
        ..FAST
    };
    holds(
        Board::Stm32,
        Way::Ascii,
        line,
        &[Flaw::Framing, Flaw::Parity],
        4,
        300,
    );
}
