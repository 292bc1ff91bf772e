//! Interrupt timing, sleep, Timer1 and pin change against cycle counts worked out from the data
//! sheet (DS40002061B).

use multidrop_bus::{Level, Line, MisuseKind, Pin, Time};
use multidrop_testkit::assembler::{edges, one, rise};

const LINE: Line = Line::n81(38_400);

/// `avr/interrupts.S` starts Timer1 at the end of its 22nd cycle (`rjmp` 2, 8 of one cycle, four
/// times `ldi` `sts` 12) with OCR1A = 100: the counter is 100 at 122, the flag stands one timer
/// clock later (16.10), at 123.
const FLAG: u64 = 123;

fn interrupts(mode: u32) -> (multidrop_bus::Bus, multidrop_bus::NodeId) {
    let (mut bus, node, _) = one("interrupts", &[("MODE", mode)], LINE);
    bus.run_for(Time::from_us(100));
    (bus, node)
}

#[test]
fn an_interrupt_is_answered_in_four_cycles() {
    // 7.7.1. A nop ends at 123; 4 cycles; `out` takes one more.
    let (bus, node) = interrupts(0);
    assert_eq!(rise(&bus, node, 0), FLAG + 4 + 1);
}

#[test]
fn waking_up_takes_four_more() {
    let (bus, node) = interrupts(1);
    assert_eq!(rise(&bus, node, 0), FLAG + 4 + 4 + 1);
    // `reti` takes 4, then the instruction behind `sleep` is executed.
    assert_eq!(rise(&bus, node, 1), FLAG + 8 + 1 + 4 + 1);
    // `ldi` `out` `sei` `sleep` end at 26; asleep until the flag.
    assert_eq!(bus.node(node).stats().asleep, FLAG - 26);
}

#[test]
fn one_instruction_follows_sei() {
    // 150 nops from 22 to 172; `sei` ends at 173; the `out` behind it at 174; only then 4 cycles
    // of response and the `out` of the handler.
    let (bus, node) = interrupts(2);
    assert_eq!(rise(&bus, node, 1), 174);
    assert_eq!(rise(&bus, node, 0), 174 + 4 + 1);
}

#[test]
fn sleep_without_its_enable_bit_does_nothing() {
    let (bus, node) = interrupts(3);
    assert_eq!(rise(&bus, node, 1), 22 + 1 + 1);
    assert_eq!(bus.node(node).stats().asleep, 0);
}

#[test]
fn without_the_i_flag_nothing_wakes_a_sleeping_node() {
    let (mut bus, node, host) = one("interrupts", &[("MODE", 4)], LINE);
    bus.run_for(Time::from_ms(1));
    bus.host(host).send(&[0x55, 0xaa]);
    bus.run_for(Time::from_ms(1));
    assert!(bus.node(node).is_asleep());
    assert_eq!(edges(&bus, node, 1, Level::High), []);
    assert_eq!(bus.now(), Time::from_ms(2));
}

#[test]
fn an_interrupt_is_measured_from_its_acceptance_to_the_end_of_reti() {
    let (bus, node) = interrupts(0);
    // 4 of response, `out` 1, `reti` 4.
    let stats = bus.node(node).stats().vectors[11];
    assert_eq!(
        (stats.count, stats.min, stats.max, stats.total),
        (1, 9, 9, 9)
    );
}

#[test]
fn udre_asks_as_long_as_it_stands_and_one_instruction_runs_in_between() {
    let (mut bus, node, _) = one("udre_level", &[], LINE);
    bus.run_for(Time::from_us(100));
    // One instruction behind `sei` and one behind each of four `reti`.
    assert_eq!(bus.node(node).read(0x100), [5, 5]);
}

/// `avr/match.S` starts the timer at the end of cycle 18 and shows PB0 at 19; from there it reads
/// TIFR1 every 3 cycles and shows PB1 3 cycles after the read that saw OCF1B.
fn match_seen(prescaler: u32, at: u32) -> u64 {
    let (mut bus, node, _) = one("match", &[("CS", prescaler), ("AT", at)], LINE);
    bus.run_for(Time::from_ms(1));
    assert_eq!(rise(&bus, node, 0), 19);
    rise(&bus, node, 1)
}

fn read_after(flag: u64) -> u64 {
    19 + (flag - 19).div_ceil(3) * 3 + 3
}

#[test]
fn a_compare_match_sets_its_flag_one_timer_clock_later() {
    // No prescaling: the counter is n at 18 + n.
    for at in [200, 201, 202, 203] {
        assert_eq!(
            match_seen(1, at),
            read_after(18 + u64::from(at) + 1),
            "{at}"
        );
    }
}

#[test]
fn the_prescaler_runs_free_from_reset() {
    // By 8: timer clocks at 24, 32, ..: the counter is n at 24 + 8 (n - 1) (17.1).
    for at in [20, 21, 22] {
        assert_eq!(
            match_seen(2, at),
            read_after(24 + 8 * u64::from(at)),
            "{at}"
        );
    }
    // By 64: at 64, 128, ..
    assert_eq!(match_seen(3, 3), read_after(64 + 64 * 3));
    // By 256 and 1024.
    assert_eq!(match_seen(4, 3), read_after(256 + 256 * 3));
    assert_eq!(match_seen(5, 3), read_after(1024 + 1024 * 3));
}

#[test]
fn timer_registers_temp_flags_and_blocked_match() {
    let (mut bus, node, _) = one("timer", &[], LINE);
    bus.run_for(Time::from_ms(1));
    // TCNT1 = 0x12f0 is written at the end of a cycle; 14 cycles and the second of `lds`
    // later it is 0x12f0 + 15 = 0x12ff. TEMP keeps 0x12 while the counter goes on (16.3).
    let [low, high, flags, cleared, blocked, matched, end] = bus.node(node).read(0x100);
    assert_eq!([low, high], [0xff, 0x12]);
    // OCF1A from 0x1305; OCF1B because both OCR1B and TCNT1 were 0 when the timer started.
    assert_eq!(flags, 0b110);
    // `sbi TIFR1, 1` clears that flag alone (notes of the register summary).
    assert_eq!(cleared, 0b100);
    // 16.7.2: the value just written to TCNT1 matches nothing; reached by counting it does.
    assert_eq!(blocked, 0);
    assert_eq!(matched, 0b100);
    assert_eq!(end, 0xaa);
}

#[test]
fn the_pin_change_flag_sees_a_start_bit_with_its_interrupt_off() {
    let (mut bus, node, host) = one("pcif", &[], LINE);
    bus.run_for(Time::from_ms(1));
    assert_eq!(edges(&bus, node, 0, Level::High), []);
    bus.host(host).send(&[0x00]);
    bus.run_for(Time::from_ms(1));
    // RXD falls at 16000; PIND shows it one cycle later, PCIF2 stands another two later. Read
    // every 3 cycles, shown 3 cycles after the read.
    let seen = rise(&bus, node, 0);
    assert!((16_006..=16_008).contains(&seen), "{seen}");
    // Cleared through `sbi`; RXD read as low.
    assert_eq!(edges(&bus, node, 1, Level::High).len(), 1);
    assert_eq!(edges(&bus, node, 2, Level::High), []);
}

#[test]
fn a_pin_driven_from_outside_wakes_the_node_and_its_count_has_a_name() {
    let (mut bus, node, _) = one("pins", &[], LINE);
    bus.run_for(Time::from_ms(1));
    for level in [true, false, true] {
        bus.node_mut(node).set_input(Pin::D3, Some(level));
        bus.run_for(Time::from_ms(1));
    }
    let count = bus
        .node(node)
        .symbol("count")
        .expect("a variable of the program");
    assert_eq!(bus.node(node).read(count.address), [3]);
    // `lds` 2, `inc` 1, `sts` 2, `reti` 4 behind 4 of response.
    let stats = bus.node(node).stats();
    let vector = stats.vectors[5];
    assert_eq!((vector.count, vector.min, vector.max), (3, 13, 13));
    // 4 ms at 16 MHz; 3 times 4 of waking up, 13 of the handler and 3 of `rjmp` and `sleep`.
    let start = 2 + 4 + 3 * 3 + 2 + 1 + 1;
    assert_eq!(stats.awake, start + 3 * (4 + 13 + 3));
    assert_eq!(stats.awake + stats.asleep, 64_000);
    // One return address on the stack, one byte of variables.
    assert_eq!(bus.node(node).stack_peak(), 2);
    assert_eq!(bus.node(node).static_ram(), 1);
    bus.node_mut(node).paint_stack();
    assert_eq!(bus.node(node).stack_peak(), 0);
    assert!(bus.node(node).symbol("counter").is_err());
}

#[test]
fn a_watchdog_reset_floats_the_pins_and_time_goes_on() {
    let (mut bus, node, _) = one("watchdog", &[], LINE);
    bus.run_for(Time::from_ms(40));
    let on: Vec<_> = bus.record().de_edges().iter().map(|edge| edge.on).collect();
    assert_eq!(on, [true, false, true, false, true]);
    // 640 000 cycles, and the rest of an instruction of two.
    assert!((640_000..=640_001).contains(&bus.node(node).cycle()));
}

#[test]
fn an_eeprom_write_takes_3_4_ms_and_halts_the_cpu_for_two_cycles() {
    let (mut bus, node, _) = one("eeprom", &[], LINE);
    bus.run_for(Time::from_ms(2));
    // `rjmp` 2, 16 instructions of one cycle, two `sbi` 4: the write starts at 22, 2 of halt, `out`.
    assert_eq!(rise(&bus, node, 0), 22 + 2 + 1);
    assert_eq!(bus.node(node).eeprom()[0x123], 0xff);
    bus.run_for(Time::from_ms(2));
    // 3.4 ms are 54 400 cycles (table 8-1); 8 to wake up and respond, two `out`.
    assert_eq!(rise(&bus, node, 1), 22 + 54_400 + 8 + 2);
    assert_eq!(bus.node(node).eeprom()[0x123], 0x5a);
    assert_eq!(bus.node(node).read(0x100), [0x5a]);
}

#[test]
fn losing_power_in_an_eeprom_write_loses_the_byte_and_a_reset_does_not() {
    for (cut, expected) in [(true, 0xff), (false, 0x5a)] {
        let (mut bus, node, _) = one("eeprom", &[], LINE);
        bus.node_mut(node).eeprom_mut()[0x123] = 0x77;
        bus.run_for(Time::from_ms(2));
        assert_eq!(bus.node(node).eeprom()[0x123], 0x77);
        if cut {
            bus.power_cut(node);
        } else {
            bus.reset(node);
        }
        bus.run_for(Time::from_ms(2));
        assert_eq!(bus.node(node).eeprom()[0x123], expected);
    }
}

#[test]
fn an_access_that_the_data_sheet_does_not_allow_is_recorded() {
    use MisuseKind::{AddressChanged, NotEnabled, ReadWhileWriting, WriteEnableCleared};
    let (mut bus, node, _) = one("eeprom", &[], LINE);
    bus.run_for(Time::from_ms(4));
    assert_eq!(bus.node(node).eeprom_misuses(), []);

    let (mut bus, node, _) = one("eeprom_misuse", &[], LINE);
    bus.run_for(Time::from_ms(4));
    let seen = bus.node(node).eeprom_misuses().iter();
    let seen: Vec<_> = seen.map(|misuse| misuse.what).collect();
    let expected = [
        NotEnabled,
        WriteEnableCleared,
        WriteEnableCleared,
        AddressChanged,
        ReadWhileWriting,
    ];
    assert_eq!(seen, expected);
    // The write itself is not disturbed by it.
    assert_eq!(bus.node(node).eeprom()[0x23], 0x5a);
}

#[test]
fn int0_sees_the_edges_that_it_is_set_to() {
    // Driven low, where it floats at first, then up and down twice.
    for (sense, expected) in [(1, 4), (2, 2), (3, 2)] {
        let (mut bus, node, _) = one("int0", &[("SENSE", sense)], LINE);
        bus.node_mut(node).set_input(Pin::D2, Some(false));
        bus.run_for(Time::from_ms(1));
        for level in [true, false, true, false] {
            bus.node_mut(node).set_input(Pin::D2, Some(level));
            bus.run_for(Time::from_ms(1));
        }
        let count = bus.node(node).symbol("count").expect("a variable").address;
        assert_eq!(bus.node(node).read(count), [expected], "{sense}");
        assert_eq!(bus.node(node).stats().vectors[1].count, u64::from(expected));
    }
    // A low level asks again and again.
    let (mut bus, node, _) = one("int0", &[("SENSE", 0)], LINE);
    bus.node_mut(node).set_input(Pin::D2, Some(true));
    bus.run_for(Time::from_ms(1));
    let before = bus.node(node).stats().vectors[1].count;
    bus.node_mut(node).set_input(Pin::D2, Some(false));
    bus.run_for(Time::from_us(100));
    bus.node_mut(node).set_input(Pin::D2, Some(true));
    bus.run_for(Time::from_us(10));
    let asked = bus.node(node).stats().vectors[1].count - before;
    assert!(asked > 50, "{asked}");
    bus.run_for(Time::from_ms(1));
    assert_eq!(bus.node(node).stats().vectors[1].count, before + asked);
}
