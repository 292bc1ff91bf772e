//! Loads and reads of a port's registers, transactions and their answers.

use multidrop_testkit::harness::ports;

/// The input is the script; see [`ports`].
pub fn port_load(data: &[u8]) {
    ports::run(data);
}
