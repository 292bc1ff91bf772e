//! The flashed images of the STM32 in a chip that is modelled after the manual: its registers as the firmware sets
//! them, clocks, counters and pins.

use std::path::PathBuf;

use multidrop_bus::{
    Answer, Bus, BusConfig, Emulator, HostId, HostPort, Line, MachineId, Silicon, Stm32, Time,
    WireId,
};
use multidrop_testkit::four::Desk;
use multidrop_testkit::frames::{data, words};
use multidrop_testkit::{
    LINE, Runner, assert_bus_rules, ports, stm32_registers, stm32_registers_at,
};

/// Registers (RM0090 2.3): RCC, FLASH, GPIOA and GPIOB, SYSCFG, EXTI, the interrupt controller.
const RCC: u32 = 0x4002_3800;
const FLASH: u32 = 0x4002_3C00;
const GPIOA: u32 = 0x4002_0000;
const GPIOB: u32 = 0x4002_0400;
const SYSCFG: u32 = 0x4001_3800;
const EXTI: u32 = 0x4001_3C00;
const AIRCR: u32 = 0xE000_ED0C;
/// USART1, USART2, USART3, UART4; and where BRR is.
const USARTS: [u32; 4] = [0x4001_1000, 0x4000_4400, 0x4000_4800, 0x4000_4C00];
const BRR: u32 = 0x08;

/// A desk on which `ports` has booted.
fn desk() -> Desk {
    Desk::new(&ports(Runner::Core), Runner::Core.emulator(), &[]).expect("a valid image")
}

fn silicon(bus: &mut Bus, machine: MachineId) -> &mut Silicon {
    let silicon = bus.machine_mut(machine).silicon();
    silicon.expect("it is not in QEMU")
}

/// What registers hold.
#[track_caller]
fn holds(silicon: &mut Silicon, registers: &[(u32, u32)]) {
    for &(address, value) in registers {
        let held = silicon.register(address).expect("it is modelled");
        assert_eq!(held, value, "{address:#010x} holds {held:#x}");
    }
}

#[test]
fn clocks_are_168_mhz_from_the_crystal_and_flash_and_buses_follow() {
    let mut desk = desk();
    let silicon = silicon(&mut desk.bus, desk.machine);
    assert_eq!(silicon.core_hz(), 168_000_000);
    holds(
        silicon,
        &[
            // 8 MHz / 4 * 168 / 2; / 7 for USB.
            (RCC + 0x04, 0x0740_2A04),
            // The PLL is the system's clock; APB1 and APB2 / 4.
            (RCC + 0x08, 0x0000_B40A),
            // Five wait states, prefetch, both caches.
            (FLASH, 0x0000_0705),
        ],
    );
}

#[test]
fn dividers_are_those_of_the_ports_rates() {
    let mut desk = desk();
    let silicon = silicon(&mut desk.bus, desk.machine);
    // 42 MHz / 38400, / 19200, / 230400, / 38400 (RM0090 30.3.4).
    for (usart, divider) in USARTS.into_iter().zip([0x446, 0x88C, 0xB6, 0x446]) {
        holds(silicon, &[(usart + BRR, divider)]);
    }
}

#[test]
fn pins_are_those_of_the_ports_and_the_debuggers_stay() {
    let mut desk = desk();
    let silicon = silicon(&mut desk.bus, desk.machine);
    holds(
        silicon,
        &[
            // PA0 to PA3, PA9, PA10 of USARTs, PA4 an output, PA13 to PA15 of the debugger.
            (GPIOA, 0xA828_01AA),
            (GPIOA + 0x20, 0x0000_7788),
            (GPIOA + 0x24, 0x0000_0770),
            // PB10, PB11 of a USART; PB3 and PB4 of the debugger.
            (GPIOB, 0x00A0_0280),
            (GPIOB + 0x24, 0x0000_7700),
            // Falling edges of PA1, PA3, PA10 and PB11.
            (SYSCFG + 0x08, 0),
            (SYSCFG + 0x0C, 0),
            (SYSCFG + 0x10, 0x0000_1000),
            (EXTI, 0x0C0A),
            (EXTI + 0x08, 0),
            (EXTI + 0x0C, 0x0C0A),
            // The highest bit of a priority is its group.
            (AIRCR, 0xFA05_0600),
        ],
    );
    // Nobody talks: DE is low, the others are at the mark.
    for (gpio, number, level) in [
        ('A', 4, false),
        ('A', 0, true),
        ('A', 9, true),
        ('B', 10, true),
    ] {
        assert_eq!(silicon.pin(gpio, number), level, "P{gpio}{number}");
    }
}

#[test]
fn start_bits_are_seen_on_rxd_alone_and_not_on_a_pin_of_the_same_number() {
    let mut desk = desk();
    let silicon = silicon(&mut desk.bus, desk.machine);
    let seen = |silicon: &mut Silicon, gpio, number| {
        for level in [true, false] {
            silicon.drive(gpio, number, Some(level));
        }
        let seen = silicon.register(EXTI + 0x14).expect("it is modelled");
        silicon.drive(gpio, number, Some(true));
        seen >> number & 1 != 0
    };
    // PA11 is AS1's CTS, PB1, PB3 and PB10 are of nobody or of another USART.
    for (gpio, number) in [('A', 11), ('B', 1), ('B', 3), ('B', 10)] {
        assert!(!seen(silicon, gpio, number), "P{gpio}{number}");
    }
    for (gpio, number) in [('B', 11), ('A', 1), ('A', 3), ('A', 10)] {
        assert!(seen(silicon, gpio, number), "P{gpio}{number}");
    }
}

/// The image of `registers` with TIM5 begun at `count`, and a host.
fn begun_at(count: u32) -> (Bus, HostId) {
    let mut bus = Bus::new(BusConfig::default());
    let mut emulator = Runner::Core.emulator();
    if let Emulator::Core { count: begun, .. } = &mut emulator {
        *begun = count;
    }
    bus.add_stm32(Stm32 {
        name: "stm32".to_owned(),
        image: stm32_registers(Runner::Core),
        emulator,
        wires: [None, None, None, Some(WireId::default())],
    })
    .expect("a valid image");
    let host = bus.add_host(HostPort::new(LINE));
    bus.run_for(Time::from_ms(20));
    (bus, host)
}

#[test]
fn the_counters_wrap_comes_at_every_place_in_an_exchange_and_changes_nothing() {
    /// Of TIM5 (`board-stm32`).
    const TICK_HZ: u64 = 42_000_000;
    let exchanges = |count: u32| -> Vec<Answer> {
        let (mut bus, host) = begun_at(count);
        let answers = (0..3).map(|_| {
            let answer = bus.transact(host, &words(1, 3, 0, 1), Time::from_ms(20));
            answer.expect("an answer")
        });
        let answers = answers.collect();
        assert_bus_rules(&bus, LINE);
        answers
    };
    let ever = exchanges(0);
    assert_eq!(ever[0].bytes, data(1, 3, &[0, 0]));
    // From before the first request to behind the last answer: 20 to 45 ms.
    for us in (18_000..48_000).step_by(250) {
        let before_wrap = us * TICK_HZ / 1_000_000;
        let answers = exchanges((1_u64 << 32).wrapping_sub(before_wrap) as u32);
        assert_eq!(answers, ever, "{us} us after boot");
    }
}

#[test]
fn the_same_again_is_the_same_to_the_instruction() {
    let run = || {
        let mut desk = desk();
        let mut heard = Vec::new();
        for round in 0..20 {
            let answer = desk
                .bus
                .transact(desk.pc, &words(10, 3, 4044, 2), Time::from_ms(100));
            heard.push(answer);
            desk.bus.run_for(Time::from_us(1_237 * round));
        }
        let instructions = desk.bus.machine(desk.machine).instructions();
        (heard, instructions)
    };
    assert_eq!(run(), run());
}

#[test]
fn a_crystal_that_is_off_shifts_all_clocks_of_the_chip() {
    // 0.2 % slow: the characters of the answer take so much longer.
    let mut bus = Bus::new(BusConfig::default());
    let mut emulator = Runner::Core.emulator();
    if let Emulator::Core { clock_ppm, .. } = &mut emulator {
        *clock_ppm = -2_000;
    }
    bus.add_stm32(Stm32 {
        name: "stm32".to_owned(),
        image: stm32_registers(Runner::Core),
        emulator,
        wires: [None, None, None, Some(WireId::default())],
    })
    .expect("a valid image");
    let host = bus.add_host(HostPort::new(LINE));
    bus.run_for(Time::from_ms(20));
    let answer = bus.transact(host, &words(1, 3, 0, 1), Time::from_ms(20));
    let answer = answer.expect("an answer");
    let sent = bus.record().bytes().iter().rev().take(2);
    let ends: Vec<_> = sent.map(|byte| byte.end).collect();
    let character = (ends[0] - ends[1]).ps();
    let right = LINE.character().ps();
    // 42 MHz / 1094 is 0.02 % slow itself.
    assert!(
        character.abs_diff(right + right * 22 / 10_000) < right / 10_000,
        "{character}"
    );
    let t35 = LINE.t35().ps();
    let turnaround = answer.turnaround().ps();
    assert!(turnaround > t35 + t35 * 19 / 10_000, "{turnaround}");
}

/// The image with RS4 on a wire with a host, its crystal dead or alive, after so long as it may wait for that.
fn with_crystal(image: PathBuf, line: Line, swings: bool) -> (Bus, MachineId, HostId) {
    let mut bus = Bus::new(BusConfig::default());
    let stm32 = Stm32 {
        name: "stm32".to_owned(),
        image,
        emulator: Runner::Core.emulator(),
        wires: [None, None, None, Some(WireId::default())],
    };
    let machine = bus.add_stm32(stm32).expect("a valid image");
    if !swings {
        silicon(&mut bus, machine).fail_crystal();
    }
    let host = bus.add_host(HostPort::new(line));
    bus.run_for(Time::from_ms(120));
    (bus, machine, host)
}

#[test]
fn without_the_crystal_the_chips_own_oscillator_makes_the_same_clocks_after_100_ms() {
    let (mut bus, machine, host) = with_crystal(stm32_registers(Runner::Core), LINE, false);
    let silicon = silicon(&mut bus, machine);
    assert_eq!(silicon.core_hz(), 168_000_000);
    // 16 MHz / 8 * 168 / 2; / 7. HSE is off again.
    holds(
        silicon,
        &[(RCC + 0x04, 0x0700_2A08), (RCC + 0x08, 0x0000_B40A)],
    );
    let cr = silicon.register(RCC).expect("it is modelled");
    assert_eq!(cr >> 16 & 1, 0, "{cr:#x}");
    let answer = bus.transact(host, &words(1, 3, 0, 1), Time::from_ms(20));
    assert_eq!(answer.expect("an answer").bytes, data(1, 3, &[0, 0]));
    assert_bus_rules(&bus, LINE);
}

#[test]
fn without_the_crystal_a_rate_that_may_be_off_by_more_than_2_5_percent_stays_off() {
    // 42 MHz / 22 is 2.1 % slow: with the crystal the rate is one of the port's, with an oscillator of 1 % it is not.
    const BAUD: u32 = 1_950_000;
    let image = || stm32_registers_at(Runner::Core, Line::n81(BAUD));
    let line = Line::n81(1_909_091);
    for swings in [true, false] {
        let (mut bus, machine, host) = with_crystal(image(), line, swings);
        let answer = bus.transact(host, &words(1, 3, 0, 1), Time::from_ms(20));
        assert_eq!(answer.is_some(), swings);
        let silicon = silicon(&mut bus, machine);
        // UE of UART4's CR1; its pins are set up all the same.
        let cr1 = silicon.register(USARTS[3] + 0x0C).expect("it is modelled");
        assert_eq!(cr1 >> 13 & 1, u32::from(swings));
        assert!(!silicon.pin('A', 4));
    }
}

#[test]
fn the_debugger_is_not_let_into_a_chip_that_sleeps() {
    let mut desk = desk();
    let silicon = silicon(&mut desk.bus, desk.machine);
    // CR, and what stands still while the CPU is halted (RM0090 38.16.3, 38.16.4).
    holds(silicon, &[(0xE004_2004, 0), (0xE004_2008, 0)]);
}

#[test]
fn the_guard_below_the_stack_is_up() {
    let mut desk = desk();
    let silicon = silicon(&mut desk.bus, desk.machine);
    // On, with the memory map as it is outside of region 0, which is 256 bytes without access and without execution.
    holds(
        silicon,
        &[
            (0xE000_ED94, 5),
            (0xE000_ED98, 0),
            (0xE000_EDA0, 0x1000_000F),
        ],
    );
    let guard = silicon.register(0xE000_ED9C).expect("it is modelled");
    assert!(guard.is_multiple_of(256), "{guard:#x}");
    let below = silicon.memory::<4>(guard - 4).expect("RAM");
    let above = silicon.memory::<4>(guard + 256).expect("RAM");
    assert_eq!((below != above, above), (true, [0xC5; 4]));
}
