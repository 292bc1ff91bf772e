//! The counts of the machine's instructions by part, against counts by hand.

use multidrop_bus::{
    Bus, BusConfig, BusError, Emulator, HostPort, Instructions, Line, MachineId, Parts, Stm32,
    Time, Tx, WireId,
};
use multidrop_testkit::assembler::assemble_arm;

const LINE: Line = Line::n81(38_400);

/// `arm/parts.S` after these characters, each so much after the one before: what was executed meanwhile, and how long its
/// interrupts took.
fn after(characters: &[(u8, Time)]) -> (Instructions, Vec<u64>) {
    let image = assemble_arm("parts", &[]);
    let parts = Parts::of(&image, "marked.inc", &[], &["USART1"]).expect("it has all of them");
    let mut bus = Bus::new(BusConfig::default());
    let host = bus.add_host(HostPort::new(LINE));
    let stm32 = Stm32 {
        name: "stm32".to_owned(),
        image,
        emulator: Emulator::qemu().expect("set-up has built it"),
        wires: [Some(WireId::default()), None, None, None],
    };
    let machine: MachineId = bus.add_stm32_in_parts(stm32, parts).expect("QEMU runs");
    bus.run_for(Time::from_ms(1));
    let before = bus.machine(machine).counted();
    let sent = characters.iter();
    bus.host(host)
        .send_each(sent.map(|&(byte, after)| Tx::byte(byte).after(after)));
    bus.run_for(Time::from_ms(10));
    let machine = bus.machine(machine);
    (machine.counted() - before, machine.interrupts("USART1"))
}

#[test]
fn work_waiting_and_marked_code_are_counted_apart() {
    let gap = Time::from_ms(1);
    for characters in [
        &[][..],
        &[(0x00, gap)],
        &[(0x07, gap)],
        &[(0x00, gap), (0x07, gap), (0x23, gap)],
    ] {
        let (counted, interrupts) = after(characters);
        let lengths = characters
            .iter()
            .map(|&(byte, _)| 6 + 2 * (u64::from(byte & 7) + 1));
        let lengths: Vec<_> = lengths.collect();
        assert_eq!(interrupts, lengths);
        let each = characters.len() as u64;
        // bl, ldr, str, tst, beq, b; and what is marked.
        let work = (6 + 3) * each + lengths.iter().sum::<u64>();
        assert_eq!((counted.work(), counted.marked), (work, 3 * each));
        // 10 ms of 8 ns, each time to the end of a block.
        assert!(counted.all.abs_diff(1_250_000) < 20, "{}", counted.all);
    }
}

#[test]
fn an_interrupt_amid_work_is_counted_and_not_timed() {
    let (counted, interrupts) = after(&[(0x80, Time::ZERO), (0x01, Time::ZERO)]);
    assert_eq!(interrupts, [8]);
    // Two rounds, the first with its delay; two interrupts.
    let delay = 1 + 2 * 62_500;
    assert_eq!(counted.work(), 2 * 9 + delay + 8 + 10);
    assert_eq!(counted.marked, 6);
}

#[test]
fn parts_that_an_image_has_not_are_errors() {
    let image = assemble_arm("parts", &[]);
    let error = Parts::of(&image, "marked.inc", &[], &["USART2"]).expect_err("no such function");
    assert!(matches!(error, BusError::NoSymbol(name) if name == "USART2"));
    let error = Parts::of(&image, "other.inc", &[], &[]).expect_err("no such source");
    assert!(error.to_string().contains("other.inc"), "{error}");
    let image = assemble_arm("echo", &[]);
    let error = Parts::of(&image, "echo.S", &[], &[]).expect_err("it never waits");
    assert!(matches!(error, BusError::NoSymbol(name) if name == "multidrop_idle"));
}
