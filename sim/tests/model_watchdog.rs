//! The watchdog against the data sheet (DS40002061B, 11.8, 11.9).

use multidrop_bus::{Bus, Level, Line, NodeId, Time};
use multidrop_testkit::assembler::{edges, one};

const LINE: Line = Line::n81(38_400);

/// Bits of WDTCSR.
const WDIE: u32 = 1 << 6;
const WDE: u32 = 1 << 3;

/// Cycles of a time-out at 16 MHz: 2048 of 128 kHz, twice as many with each step (table 11-2).
fn time(step: u32) -> u64 {
    (2_048 << step) * 125
}

/// The bits of a step in WDTCSR: the fourth stands apart.
fn step(step: u32) -> u32 {
    step & 7 | (step & 8) << 2
}

fn run(symbols: &[(&str, u32)], span: Time) -> (Bus, NodeId) {
    let (mut bus, node, _) = one("watchdog_modes", symbols, LINE);
    bus.run_for(span);
    (bus, node)
}

/// From PB0, behind the two cycles of which it was set, to the second start.
fn reset_after(bus: &Bus, node: NodeId) -> Option<u64> {
    let set = edges(bus, node, 0, Level::High)[0];
    let over = edges(bus, node, 2, Level::High);
    over.first().map(|over| over - set)
}

/// `sbi` on PB0 ends 4 cycles behind `wdr`, and the second start takes some 30 to PB2.
#[track_caller]
fn assert_about(found: Option<u64>, expected: u64) {
    let found = found.expect("a reset");
    assert!(
        (expected..expected + 40).contains(&(found + 6)),
        "{found} for {expected}"
    );
}

#[test]
fn it_resets_the_chip_after_the_time_of_its_step() {
    for n in [0, 1, 3, 7, 8, 9] {
        let (bus, node) = run(&[("CONTROL", WDE | step(n))], Time::from_s(9));
        assert_about(reset_after(&bus, node), time(n));
        // It is told by the flag.
        assert_eq!(bus.node(node).read(0x100), [1 << 3]);
    }
}

#[test]
fn wdr_begins_its_time_anew() {
    let (bus, node) = run(&[("CONTROL", WDE), ("MODE", 1)], Time::from_ms(200));
    // Five times 160 000 cycles, and then the time.
    let found = reset_after(&bus, node).expect("a reset");
    let expected = 5 * 160_000 + time(0);
    assert!((expected..expected + 100).contains(&found), "{found}");
}

#[test]
fn its_step_changes_within_the_sequence_alone() {
    for (mode, n) in [(2, 4), (3, 1)] {
        let symbols = [
            ("CONTROL", WDE | step(4)),
            ("CHANGED", WDE | step(1)),
            ("MODE", mode),
        ];
        let (bus, node) = run(&symbols, Time::from_s(1));
        assert_about(reset_after(&bus, node), time(n));
    }
    // Nor is it turned off without.
    for (mode, is_reset) in [(2, true), (3, false)] {
        let symbols = [("CONTROL", WDE), ("CHANGED", 0), ("MODE", mode)];
        let (bus, node) = run(&symbols, Time::from_s(1));
        assert_eq!(reset_after(&bus, node).is_some(), is_reset, "mode {mode}");
    }
}

#[test]
fn its_interrupt_comes_first_and_is_not_needed_for_the_reset() {
    for mode in [0, 4] {
        let symbols = [("CONTROL", WDIE | WDE | step(2)), ("MODE", mode)];
        let (bus, node) = run(&symbols, Time::from_s(1));
        assert_about(reset_after(&bus, node), 2 * time(2));
        let interrupts = edges(&bus, node, 1, Level::High).len();
        assert_eq!(interrupts, if mode == 4 { 1 } else { 0 });
    }
    // Without WDE nothing else comes.
    let symbols = [("CONTROL", WDIE | step(2)), ("MODE", 4)];
    let (bus, node) = run(&symbols, Time::from_s(1));
    assert_eq!(reset_after(&bus, node), None);
    assert_eq!(edges(&bus, node, 1, Level::High).len(), 1);
}

#[test]
fn it_cannot_be_turned_off_before_its_flag_is_cleared() {
    let (bus, node) = run(&[("CONTROL", WDE)], Time::from_s(1));
    assert_eq!(edges(&bus, node, 2, Level::High).len(), 1);
    // Here it goes on with the shortest time, again and again.
    let (bus, node) = run(
        &[("CONTROL", WDE | step(2)), ("MODE", 5)],
        Time::from_ms(64 + 163),
    );
    assert_eq!(edges(&bus, node, 2, Level::High).len(), 11);
}
