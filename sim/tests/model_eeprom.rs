//! The EEPROM against the data sheet (DS40002061B, 8.4 and 8.6): the window of EEMPE, programming times, wear, and
//! the content of a byte after a power cut.

use multidrop_bus::{Bus, Line, MisuseKind, NodeId, Pin, Time};
use multidrop_testkit::assembler::{bus_with, nano, one, rise};

const LINE: Line = Line::n81(38_400);

/// `avr/eeprom_window.S` writes 0x5a here.
const CELL: usize = 0x23;

fn started(symbols: &[(&str, u32)], clock_hz: u32) -> (Bus, NodeId) {
    let mut one = nano("eeprom_window", symbols);
    one.clock_hz = clock_hz;
    let (mut bus, node, _) = bus_with(one, LINE);
    bus.node_mut(node).eeprom_mut()[CELL] = 0x77;
    bus.run_for(Time::from_us(100));
    (bus, node)
}

/// What the cell holds in the end, how often it was written, and what was not allowed for.
fn outcome(mut bus: Bus, node: NodeId) -> (u8, u32, Vec<MisuseKind>) {
    bus.run_for(Time::from_ms(4));
    let node = bus.node(node);
    let misuses = node.eeprom_misuses().iter().map(|misuse| misuse.what);
    (
        node.eeprom()[CELL],
        node.eeprom_wear()[CELL],
        misuses.collect(),
    )
}

#[test]
fn eepe_writes_within_four_cycles_of_eempe_and_no_later() {
    // 8.6.3. `sbi` takes two cycles: EEPE follows two cycles after EEMPE, and one more for each `nop`.
    for nops in 0..=2 {
        let (bus, node) = started(&[("NOPS", nops)], 16_000_000);
        assert_eq!(outcome(bus, node), (0x5a, 1, vec![]), "{nops}");
    }
    for nops in [3, 4, 8] {
        let (bus, node) = started(&[("NOPS", nops)], 16_000_000);
        let expected = (0x77, 0, vec![MisuseKind::NotEnabled]);
        assert_eq!(outcome(bus, node), expected, "{nops}");
    }
}

#[test]
fn an_interrupt_between_eempe_and_eepe_means_no_write() {
    let (bus, node) = started(&[], 16_000_000);
    let begins = rise(&bus, node, 0);
    let mut lost = Vec::new();
    // D2 is seen three cycles later (13.1: a latch and two more). An interrupt takes 4 cycles, `reti` 4.
    for before in 0..20 {
        let (mut bus, node, _) = one("eeprom_window", &[], LINE);
        let seen = begins + 10 - before;
        let cycle = seen - 3;
        bus.node_mut(node).set_input_at(Pin::D2, true, cycle);
        bus.node_mut(node).eeprom_mut()[CELL] = 0x77;
        bus.run_for(Time::from_us(100));
        assert_eq!(bus.node(node).stats().vectors[1].count, 1, "{before}");
        match outcome(bus, node) {
            (0x5a, 1, misuses) => assert_eq!(misuses, []),
            (0x77, 0, misuses) => {
                assert_eq!(misuses, [MisuseKind::NotEnabled]);
                lost.push(seen);
            }
            other => panic!("{other:?}"),
        }
    }
    // `sbi` sets EEMPE in the two cycles behind `out`: what is seen in one of them is answered behind it.
    lost.reverse();
    assert_eq!(lost, [begins + 1, begins + 2]);
}

#[test]
fn programming_takes_3_4_ms_at_any_clock_and_1_8_for_half_of_it() {
    // Table 8-1: erase and write in one, erase alone, write alone; in us.
    for (mode, us, result) in [
        (0x00, 3_400, 0x5a),
        (0x10, 1_800, 0xff),
        (0x20, 1_800, 0x52),
    ] {
        for clock_hz in [8_000_000, 16_000_000, 20_000_000] {
            let (mut bus, node) = started(&[("MODE", mode)], clock_hz);
            // `out` shows it a cycle and two of halt later.
            let begins = rise(&bus, node, 1) - 3;
            let ends = begins + u64::from(clock_hz) / 1_000_000 * us;
            let clock = bus.node(node).clock();
            bus.run_to(clock.time(ends - 3));
            assert_eq!(bus.node(node).eeprom()[CELL], 0x77, "{mode:x} {clock_hz}");
            bus.run_to(clock.time(ends + 3));
            assert_eq!(bus.node(node).eeprom()[CELL], result, "{mode:x} {clock_hz}");
            assert_eq!(bus.node(node).eeprom_wear()[CELL], 1);
        }
    }
}

#[test]
fn power_lost_in_the_last_cycle_of_a_write_loses_the_byte_and_behind_it_does_not() {
    for (more, expected) in [(0, 0xff), (1, 0x5a)] {
        let (mut bus, node) = started(&[], 16_000_000);
        let ends = rise(&bus, node, 1) - 3 + 54_400;
        let clock = bus.node(node).clock();
        bus.run_to(clock.time(ends - 1 + more));
        bus.power_cut(node);
        assert_eq!(bus.node(node).eeprom()[CELL], expected);
        // The others are as they were.
        let others = bus.node(node).eeprom().iter().enumerate();
        for (address, byte) in others.filter(|(address, _)| *address != CELL) {
            assert_eq!(*byte, 0xff, "at {address}");
        }
    }
}

#[test]
fn a_read_halts_the_cpu_for_four_cycles_and_one_during_a_write_reads_nothing() {
    let (mut bus, node, _) = one("eeprom_read", &[], LINE);
    bus.node_mut(node).eeprom_mut()[0x23] = 0x77;
    bus.run_for(Time::from_ms(1));
    // 8.4.1. `sbi` takes two cycles, `out` shows it a cycle later.
    assert_eq!(rise(&bus, node, 1) - rise(&bus, node, 0), 2 + 4 + 1);
    // While 0x5a is written nothing halts, and EEDR stays as it is.
    assert_eq!(bus.node(node).read(0x100), [0x77, 0x5a]);
    let misuses = bus.node(node).eeprom_misuses();
    assert_eq!(misuses.len(), 1);
    assert_eq!(misuses[0].what, MisuseKind::ReadWhileWriting);
    assert_eq!(misuses[0].at, rise(&bus, node, 2) - 1);
}
