//! The image `conformance` of the STM32 against the plain model of its unit: random requests of all functions and
//! damaged frames on the wire must give equal answers. All tables, counters and the log are read back repeatedly.

use multidrop_testkit::conforms::{Board, at_115200, in_ascii, with_parity};
use multidrop_testkit::{Runner, on_both};

on_both! {
    random_requests_at_115200,
    random_requests_with_parity,
    random_requests_in_ascii,
}

fn random_requests_at_115200(runner: Runner) {
    at_115200(Board::Stm32(runner));
}

fn random_requests_with_parity(runner: Runner) {
    with_parity(Board::Stm32(runner));
}

fn random_requests_in_ascii(runner: Runner) {
    in_ascii(Board::Stm32(runner));
}
