//! The STM32 in QEMU, in step with the bus.

use multidrop_bus::{
    Bus, BusConfig, Emulator, HostId, HostPort, Line, MachineId, Stm32, Time, Tx, WireId,
};
use multidrop_testkit::assembler::assemble_arm;

const LINE: Line = Line::n81(38_400);

/// A bus, a host and the machine that echoes. They would fight for the wire if a character came before the echo is over.
fn echo() -> (Bus, HostId, MachineId) {
    let mut bus = Bus::new(BusConfig::default());
    let host = bus.add_host(HostPort::new(LINE));
    let machine = bus
        .add_stm32(Stm32 {
            name: "stm32".to_owned(),
            image: assemble_arm("echo", &[]),
            emulator: Emulator::qemu().expect("set-up has built it"),
            wires: [Some(WireId::default()), None, None, None],
        })
        .expect("QEMU runs");
    bus.run_for(Time::from_ms(1));
    (bus, host, machine)
}

/// What the machine sent, with when its first bit began.
fn sent(bus: &Bus, machine: MachineId) -> Vec<(Time, u16)> {
    let station = bus.machine(machine).station(0).expect("it is on the wire");
    let bytes = bus.record().sent_by(station);
    bytes.map(|byte| (byte.start, byte.sent)).collect()
}

#[test]
fn a_character_is_there_when_its_stop_bit_is_judged() {
    let (mut bus, host, machine) = echo();
    // From 0 to 750 instructions, 6 us, later the loop looks again: seen at 100 phases.
    for step in 0..100 {
        bus.run_for(Time::from_ns(1_000_000 + step * 80));
        bus.clear_record();
        let end = bus.host(host).send(&[0x40 + step as u8]);
        bus.run_for(Time::from_ms(1));
        let middle_of_stop = end.saturating_sub(LINE.bits(1) / 2);
        let [(start, value)] = sent(&bus, machine)[..] else {
            panic!("{}", bus.record());
        };
        assert_eq!(value, 0x40 + step as u16);
        let after = start.saturating_sub(middle_of_stop);
        assert!(after < Time::from_us(7), "{after}");
    }
}

#[test]
fn the_same_again_is_the_same_to_the_instruction() {
    let run = || {
        let (mut bus, host, machine) = echo();
        for byte in 0..50 {
            bus.host(host).send(&[byte]);
            bus.run_for(Time::from_us(1_237));
        }
        (sent(&bus, machine), bus.machine(machine).instructions())
    };
    assert_eq!(run(), run());
}

#[test]
fn errors_of_a_character_are_seen_once() {
    let (mut bus, host, machine) = echo();
    bus.host(host).send_each([
        Tx::byte(0x41),
        Tx::byte(0x42).after(Time::from_ms(1)).bad_stop(),
        Tx::byte(0x43).after(Time::from_ms(2)),
    ]);
    bus.run_for(Time::from_ms(10));
    let values: Vec<_> = sent(&bus, machine)
        .iter()
        .map(|(_, value)| *value)
        .collect();
    assert_eq!(values, [0x41, 0xC2, 0x43]);
    assert_eq!(bus.machine(machine).overruns(0), 0);
}

#[test]
fn time_is_what_the_instructions_take() {
    let (mut bus, _, machine) = echo();
    let before = bus.machine(machine).instructions();
    bus.run_for(Time::from_ms(100));
    let passed = bus.machine(machine).instructions() - before;
    // 8 ns each; it stops between two blocks of instructions.
    assert!(passed.abs_diff(12_500_000) < 2_000, "{passed}");
}
