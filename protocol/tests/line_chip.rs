//! The suite that proves the driver of a chip, run with the driver that the guide's chapter "A new board" has as its example.

// ANCHOR: suite
use multidrop_testkit::line_chip_tests;
use multidrop_testkit::made_up::OnDesk;

line_chip_tests!(OnDesk);
// ANCHOR_END: suite
