//! Intervals of the STM32's lines at each rate and format, also when the line's timer wraps; and the time for the
//! crystal to start. In the image that is flashed.

use multidrop_bus::{
    Answer, Bus, BusConfig, Emulator, Format, HostPort, Line, Stm32, Time, WireId,
};
use multidrop_testkit::four::{Desk, RS4};
use multidrop_testkit::frames::{adu, data, words};
use multidrop_testkit::{LINE, Rig, Runner, ports, stm32_example, stm32_registers};

/// Ticks of TIM5 in a microsecond (`board-stm32`).
const TICKS: u64 = 42;

/// What the example `delays` sends back.
const FRAME: [u8; 3] = [7, 1, 2];

/// The core, with TIM5 begun so long before its end.
fn wraps_in(us: u64) -> Emulator {
    let mut emulator = Runner::Core.emulator();
    if let Emulator::Core { count, .. } = &mut emulator {
        *count = (1_u64 << 32).wrapping_sub(us * TICKS) as u32;
    }
    emulator
}

/// The example `delays`, with what it is told by this function and four bytes; its greeting is over.
fn delays(function: u8, bytes: [u8; 4]) -> Rig {
    let image = stm32_example(Runner::Core, "delays", LINE.baud);
    let mut rig = Rig::stm32(&image, Runner::Core, LINE);
    let frame = adu(&[&[7, function][..], &bytes].concat());
    rig.bus.host(rig.host).send(&frame);
    rig.bus.run_for(Time::from_ms(100));
    rig
}

/// An exchange of [`FRAME`], and how long after its end the answer begins.
fn turnaround(rig: &mut Rig, patience: Time) -> Time {
    let answer: Option<Answer> = rig.bus.transact(rig.host, &adu(&FRAME), patience);
    let answer = answer.expect("an answer");
    assert_eq!(answer.bytes, adu(&FRAME));
    answer.turnaround()
}

#[test]
fn answers_begin_at_t3_5_at_every_rate_and_in_every_format() {
    for baud in [1_200, 9_600, 19_200, 57_600, 115_200, 1_000_000] {
        for (number, format) in [(0, Format::N81), (1, Format::E81), (3, Format::N82)] {
            let [high, low] = ((baud / 100) as u16).to_be_bytes();
            let mut rig = delays(0x43, [high, low, number, 0]);
            let line = Line { baud, format };
            rig.bus.host(rig.host).set_line(line);
            rig.bus.run_for(Time::from_ms(200));
            for _ in 0..3 {
                let after = turnaround(&mut rig, line.t35() * 2);
                assert!(
                    after >= line.t35() && after < line.t35() + line.bits(1).max(LINE.bits(1)),
                    "{after}, {line:?}"
                );
            }
        }
    }
}

/// When RS4 of `ports` sends where no unit answers, with the line's timer going round so long after boot.
fn polls(wrap_us: u64) -> Vec<(Time, u16)> {
    let mut desk = Desk::new(&ports(Runner::Core), wraps_in(wrap_us), &[]).expect("an image");
    desk.bus.run_for(Time::from_ms(90));
    let station = desk.station(RS4);
    let sent = desk.bus.record().sent_by(station);
    sent.map(|byte| (byte.start, byte.value)).collect()
}

#[test]
fn a_client_sends_in_time_wherever_the_lines_timer_wraps() {
    // Two requests, the time until the first is given up, and the silence behind it.
    let ever = polls(1 << 30);
    assert!(ever.len() >= 8 * 2, "{}", ever.len());
    for step in 0..12 {
        assert_eq!(polls(2_000 + step * 5_300), ever, "{step}");
    }
}

#[test]
fn the_crystal_is_given_100_ms() {
    let mut bus = Bus::new(BusConfig::default());
    let stm32 = Stm32 {
        name: "stm32".to_owned(),
        image: stm32_registers(Runner::Core),
        emulator: Runner::Core.emulator(),
        wires: [None, None, None, Some(WireId::default())],
    };
    let machine = bus.add_stm32(stm32).expect("a valid image");
    let host = bus.add_host(HostPort::new(LINE));
    let silicon = bus.machine_mut(machine).silicon();
    silicon.expect("it is not in QEMU").fail_crystal();
    for (ms, hz) in [(99, 16_000_000), (2, 168_000_000)] {
        bus.run_for(Time::from_ms(ms));
        let silicon = bus.machine_mut(machine).silicon();
        assert_eq!(silicon.expect("it is not in QEMU").core_hz(), hz, "{ms} ms");
    }
    bus.run_for(LINE.t35() * 2);
    let answer = bus.transact(host, &words(1, 3, 0, 1), Time::from_ms(20));
    assert_eq!(answer.expect("an answer").bytes, data(1, 3, &[0, 0]));
}
