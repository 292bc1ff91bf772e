//! The image `conformance` in the simulator against the plain model of its unit: random requests of all functions and
//! damaged frames on the wire must give equal answers. All tables, counters and the log are read back repeatedly.

use multidrop_testkit::conforms::{Board, at_115200, in_ascii, with_parity};

#[test]
fn random_requests_at_115200() {
    at_115200(Board::Nano);
}

#[test]
fn random_requests_with_parity() {
    with_parity(Board::Nano);
}

#[test]
fn random_requests_in_ascii() {
    in_ascii(Board::Nano);
}
