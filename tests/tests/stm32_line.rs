//! The lines of the STM32: the time of answers, the limits of a frame, and four lines at once.

use multidrop_bus::{
    Bus, BusConfig, HostId, HostPort, Line, MachineId, Parts, Stm32, Time, Tx, WireId,
};
use multidrop_testkit::four::{AS1, Desk, RS2, RS4, setting};
use multidrop_testkit::frames::{adu, block, data, words};
use multidrop_testkit::plain::wire::from_rtu;
use multidrop_testkit::{LINE, Rig, Runner, on_both, stm32_example, stm32_registers};

on_both! {
    answers_begin_at_t3_5,
    a_frame_is_what_has_no_gap_over_t1_5,
    a_request_at_t3_5_after_another_units_is_heard,
    a_click_of_1_us_suppresses_no_answer,
    with_gaps_allowed_t3_5_still_has_its_margin,
    a_gap_in_ms_ends_a_frame,
    every_port_answers_at_1200_baud,
    four_ports_at_once_lose_nothing,
}

/// A read of one register of unit 1.
fn request() -> Vec<u8> {
    words(1, 3, 0, 1)
}

fn answers_begin_at_t3_5(runner: Runner) {
    let mut rig = Rig::stm32(&stm32_registers(runner), runner, LINE);
    for step in 0..20 {
        rig.pause(Time::from_ns(5_000_000 + step * 1_237));
        for request in [
            words(1, 3, 0, 1),
            words(1, 3, 0, 16),
            words(1, 6, 0, 7),
            block(1, 16, 0, 16, &[1; 32]),
        ] {
            let answer = rig.exchange(&request).expect("an answer");
            let beyond = answer.turnaround().saturating_sub(LINE.t35());
            // That it is not before t3.5 is a rule of the bus, which every exchange is held against.
            assert!(beyond < LINE.bits(1), "{beyond} after {request:02x?}");
        }
    }
}

fn a_frame_is_what_has_no_gap_over_t1_5(runner: Runner) {
    let mut rig = Rig::stm32(&stm32_registers(runner), runner, LINE);
    for (gap_us, answered) in [
        (700, true),
        (740, true),
        (750, true),
        (758, false),
        (1000, false),
        (1700, false),
    ] {
        let characters = request().into_iter().enumerate().map(|(index, byte)| {
            let gap = if index == 4 { gap_us } else { 0 };
            Tx::byte(byte).after(Time::from_us(gap))
        });
        let characters: Vec<_> = characters.collect();
        assert_eq!(
            !rig.ask_each(characters).is_empty(),
            answered,
            "{gap_us} us"
        );
        rig.pause(Time::from_ms(5));
    }
}

fn a_request_at_t3_5_after_another_units_is_heard(runner: Runner) {
    let mut rig = Rig::stm32(&stm32_registers(runner), runner, LINE);
    for (pause_us, answered) in [(1660, false), (1690, true), (1750, true), (1760, true)] {
        let other = words(9, 3, 0, 1).into_iter().map(Tx::byte);
        let ours = request().into_iter().enumerate().map(|(index, byte)| {
            let pause = if index == 0 { pause_us } else { 0 };
            Tx::byte(byte).after(Time::from_us(pause))
        });
        let characters: Vec<_> = other.chain(ours).collect();
        assert_eq!(
            !rig.ask_each(characters).is_empty(),
            answered,
            "{pause_us} us"
        );
        rig.pause(Time::from_ms(5));
    }
}

/// An edge that is no character may hold an answer back for the time of one, and no longer.
fn a_click_of_1_us_suppresses_no_answer(runner: Runner) {
    let mut rig = Rig::stm32(&stm32_registers(runner), runner, LINE);
    for us in (1..100).chain((100..1_750).step_by(53)) {
        let end = rig.bus.host(rig.host).send(&request());
        rig.bus.run_to(end);
        let at = end + LINE.t35() + Time::from_us(5) - Time::from_us(us);
        rig.bus.noise(at, Time::from_us(1), false);
        let answer = rig.exchange(&[]);
        let answer = answer.unwrap_or_else(|| panic!("none: {us} us"));
        assert_eq!(answer.bytes, data(1, 3, &[0, 0]), "{us} us");
        let after = answer.received[0].start - end;
        assert!(
            after <= LINE.t35() + LINE.character() + LINE.bits(1),
            "{after}, {us} us"
        );
        rig.pause(Time::from_ms(5));
    }
}

/// A port whose register INTER_CHARACTER is loaded with this value; its host, and a request that is answered.
fn desk_with_gaps(runner: Runner, inter_character: u32) -> (Desk, Vec<u8>, Vec<u8>) {
    let mut desk = Desk::new(&multidrop_testkit::ports(runner), runner.emulator(), &[])
        .expect("a valid image");
    let register = setting(AS1, 26);
    let value = inter_character.to_be_bytes();
    let load = block(10, 16, register, 2, &value);
    let answer = desk.bus.transact(desk.pc, &load, Time::from_ms(100));
    assert_eq!(answer.expect("an answer").bytes, words(10, 16, register, 2));
    desk.bus.run_for(Time::from_ms(100));
    let answer = adu(&[&[10, 3, 4][..], &value].concat());
    (desk, words(10, 3, register, 2), answer)
}

/// Sends frames in pieces, so far apart, and gives what comes back, and how long after.
fn say(desk: &mut Desk, pieces: &[&[u8]], apart: Time) -> Option<(Vec<u8>, Time)> {
    let pc = desk.pc;
    desk.bus.host(pc).take();
    let mut end = desk.bus.now();
    for (index, piece) in pieces.iter().enumerate() {
        let gap = if index == 0 { Time::ZERO } else { apart };
        let characters = piece.iter().enumerate().map(|(at, &byte)| {
            let before = if at == 0 { gap } else { Time::ZERO };
            Tx::byte(byte).after(before)
        });
        end = desk.bus.host(pc).send_each(characters);
    }
    desk.bus.run_to(end);
    assert_eq!(desk.bus.host(pc).take(), [], "talked over");
    let answer = desk.bus.transact(pc, &[], Time::from_ms(100));
    desk.bus.run_for(Time::from_ms(100));
    answer.map(|answer| {
        let after = answer.received[0].start - end;
        (answer.bytes, after)
    })
}

/// Where gaps are allowed, `silence` less its last 1/24 ends a frame: two clocks measure it.
fn check_gaps(runner: Runner, inter_character: u32, silence: Time) {
    let (mut desk, request, expected) = desk_with_gaps(runner, inter_character);
    let (head, tail) = request.split_at(3);
    for (percent, answered) in [(90, true), (95, true), (97, false), (99, false)] {
        let heard = say(&mut desk, &[head, tail], silence * percent / 100);
        assert_eq!(heard.is_some(), answered, "{percent} % of {silence}");
        if let Some((bytes, after)) = heard {
            assert_eq!(bytes, expected);
            assert!(after >= silence, "{after}");
            assert!(after < silence + LINE.character(), "{after}");
        }
    }
    // Two requests: the answer to the first one is withdrawn.
    for percent in [97, 99, 100] {
        let apart = silence * percent / 100;
        let heard = say(&mut desk, &[&request, &request], apart);
        let (bytes, after) = heard.unwrap_or_else(|| panic!("none at {percent} % of {silence}"));
        assert_eq!(bytes, expected, "{percent} %");
        assert!(after >= silence, "{after}");
    }
}

fn with_gaps_allowed_t3_5_still_has_its_margin(runner: Runner) {
    check_gaps(runner, 1, LINE.t35());
}

fn a_gap_in_ms_ends_a_frame(runner: Runner) {
    for ms in [2, 16, 50] {
        check_gaps(runner, ms, Time::from_ms(ms.into()));
    }
}

/// The machine with a server on each port, each on a wire of its own with a host.
struct Four {
    bus: Bus,
    hosts: [HostId; 4],
    machine: MachineId,
}

impl Four {
    fn at(runner: Runner, baud: u32) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let wires = [
            WireId::default(),
            bus.add_wire(),
            bus.add_wire(),
            bus.add_wire(),
        ];
        let port = || HostPort::new(Line::n81(baud));
        let hosts = wires.map(|wire| bus.add_host_on(wire, port()));
        let stm32 = Stm32 {
            name: "stm32".to_owned(),
            image: stm32_example(runner, "servers", baud),
            emulator: runner.emulator(),
            wires: wires.map(Some),
        };
        let machine = bus.add_stm32(stm32).expect("a valid image");
        bus.run_for(Time::from_ms(10));
        Four {
            bus,
            hosts,
            machine,
        }
    }

    /// A request on each wire, so much after each other; the answers.
    fn round(&mut self, requests: [&[u8]; 4], stagger: Time) -> [Vec<u8>; 4] {
        for (host, request) in self.hosts.into_iter().zip(requests) {
            self.bus.host(host).take();
            self.bus.host(host).send(request);
            self.bus.run_for(stagger);
        }
        self.bus.run_for(Time::from_ms(80));
        self.hosts.map(|host| {
            let heard = self.bus.host(host).take();
            heard.iter().map(|byte| byte.value).collect()
        })
    }

    fn overruns(&self) -> [u64; 4] {
        [0, 1, 2, 3].map(|port| self.bus.machine(self.machine).overruns(port))
    }
}

/// The slowest rate that all ports have.
fn every_port_answers_at_1200_baud(runner: Runner) {
    let line = Line::n81(1_200);
    let mut four = Four::at(runner, line.baud);
    four.bus.run_for(line.t35());
    for host in four.hosts {
        let answer = four.bus.transact(host, &request(), line.t35() * 2);
        let answer = answer.expect("an answer");
        assert_eq!(answer.bytes, data(1, 3, &[0, 0]));
        let after = answer.turnaround();
        let in_time = line.t35()..line.t35() + line.bits(1);
        assert!(in_time.contains(&after), "{after}");
    }
}

fn four_ports_at_once_lose_nothing(runner: Runner) {
    for (baud, rounds) in [(115_200, 10), (2_000_000, 30)] {
        let mut four = Four::at(runner, baud);
        for round in 0..rounds {
            let values: Vec<u8> = (0..246u16).map(|i| (i * 7 + round) as u8).collect();
            let write = block(1, 16, 0, 123, &values);
            let read = words(1, 3, 0, 125);
            let stagger = Time::from_ns(u64::from(round) * 137);
            let answers = four.round([&write, &read, &read, &write], stagger);
            assert_eq!(
                answers.each_ref().map(Vec::len),
                [8, 255, 255, 8],
                "round {round} at {baud}"
            );
            assert!(answers.iter().all(|answer| from_rtu(answer).is_some()));
        }
        assert_eq!(four.overruns(), [0; 4], "{baud}");
    }
}

/// One request to AS1 of `ports`.
struct Round {
    /// From its last character in AS1's receiver to the first one of the answer in its transmitter.
    instructions: u64,
    /// Characters that RS2 got in that time.
    on_rs2: usize,
}

/// Requests to AS1, if `asks`, while garbage comes in on RS2 at `baud`, if `garbage`: at the same times in any case. And how many
/// instructions each interrupt of RS2 took.
fn rounds(baud: u32, garbage: bool, asks: bool) -> (Vec<Round>, Vec<u64>) {
    let image = multidrop_testkit::ports(Runner::Qemu);
    let parts = Parts::of(&image, "usart/state.rs", &[], &["USART3"]).expect("a valid image");
    let mut desk =
        Desk::in_parts(&image, Runner::Qemu.emulator(), &[], parts).expect("QEMU runs the image");
    // RS4 is off, and nothing is printed.
    for (port, register, value) in [(RS4, 0, 2_u32), (RS2, 22, baud)] {
        let first = setting(port, register);
        let load = block(10, 16, first, 2, &value.to_be_bytes());
        let answer = desk.bus.transact(desk.pc, &load, Time::from_ms(100));
        assert_eq!(answer.expect("an answer").bytes, words(10, 16, first, 2));
        desk.bus.run_for(Time::from_ms(60));
    }
    let printed = desk.bus.machine(desk.machine).interrupts("USART3").len();
    let terminal = Line::n81(baud);
    desk.bus.host(desk.terminal).set_line(terminal);
    let request = words(10, 3, setting(RS2, 22), 2);
    let rounds = (0..20u64).map(|round| {
        desk.bus.run_for(Time::from_ms(5));
        if garbage {
            // As long as the request, the silence and a little more.
            let len = Time::from_us(4_500).ps() / terminal.character().ps();
            let noise = (0..len).map(|index| {
                let byte = Tx::byte((index * 37 + round) as u8);
                if index % 7 == 3 {
                    byte.bad_stop()
                } else {
                    byte
                }
            });
            desk.bus.host(desk.terminal).send_each(noise);
        }
        desk.bus.run_for(Time::from_ns(200_000 + round * 1_237));
        if !asks {
            desk.bus.run_for(Time::from_ms(10));
            return Round {
                instructions: 0,
                on_rs2: 0,
            };
        }
        let answer = desk.bus.transact(desk.pc, &request, Time::from_ms(20));
        let answer = answer.expect("an answer");
        let value = [&[10, 3, 4][..], &baud.to_be_bytes()].concat();
        assert_eq!(answer.bytes, adu(&value));
        // A character is in the receiver in the middle of its stop bit.
        let delivered = |end: Time, line: Line| end.saturating_sub(line.bits(1) / 2);
        let from = delivered(answer.request_end, LINE);
        let to = answer.received[0].start;
        let on_rs2 = desk.bus.record_of(desk.wires[RS2]).bytes().iter();
        let on_rs2 = on_rs2.filter(|byte| {
            let at = delivered(byte.end, terminal);
            from <= at && at <= to
        });
        Round {
            instructions: to.saturating_sub(from).ps().div_ceil(8_000),
            on_rs2: on_rs2.count(),
        }
    });
    let rounds = rounds.collect();
    let interrupts = desk.bus.machine(desk.machine).interrupts("USART3");
    (rounds, interrupts[printed..].to_vec())
}

#[test]
fn garbage_on_one_port_delays_another_by_one_interrupt_for_each_of_its_characters_at_most() {
    for baud in [230_400, 2_000_000] {
        let (_, alone) = rounds(baud, true, false);
        let longest = *alone.iter().max().expect("interrupts");
        let (quiet, none) = rounds(baud, false, true);
        let (noisy, _) = rounds(baud, true, true);
        assert!(none.is_empty());
        for (quiet, noisy) in quiet.iter().zip(&noisy) {
            let on_rs2 = noisy.on_rs2 as u64;
            assert_eq!(quiet.on_rs2, 0);
            assert!(on_rs2 >= 40, "{on_rs2}");
            let delay = noisy.instructions.saturating_sub(quiet.instructions);
            assert!(delay <= on_rs2 * longest, "{delay}, {on_rs2} x {longest}");
            // Far less: AS1's last character waits for an interrupt that is under way, and so does the alarm at t3.5, which
            // lets one more character go first.
            assert!(delay <= 3 * longest, "{delay}, {longest}");
        }
    }
}

/// The counters of `wraps`: beats of 10 ms, and how late the latest was seen, in us.
fn beats(rig: &mut Rig) -> (u16, u16) {
    let answer = rig.ask(&words(1, 3, 0, 2));
    assert_eq!(answer.len(), 9, "{answer:02x?}");
    let word = |at| u16::from_be_bytes([answer[at], answer[at + 1]]);
    (word(3), word(5))
}

#[test]
fn answers_begin_at_t3_5_wherever_in_an_exchange_the_timer_of_the_line_goes_round() {
    let mut rig = Rig::stm32(
        &stm32_example(Runner::Qemu, "wraps", 38_400),
        Runner::Qemu,
        LINE,
    );
    // The request, t1.5, t3.5, and the answer with the silence behind it: some 8 ms in all.
    for step in 0..60 {
        // 10 ms until the beat that sees it and 10 ms more; the request comes 30 ms after this one's answer.
        let wrap_in_us = 10_000 + step * 200;
        rig.expect(&words(1, 6, 2, wrap_in_us), &words(1, 6, 2, wrap_in_us));
        rig.pause(Time::from_ms(20));
        for _ in 0..3 {
            let answer = rig.exchange(&request()).expect("an answer");
            let beyond = answer.turnaround().saturating_sub(LINE.t35());
            assert!(beyond < LINE.bits(1), "{beyond}, wrap in {wrap_in_us} us");
        }
    }
}

#[test]
fn time_goes_on_when_its_counter_goes_round() {
    let mut rig = Rig::stm32(
        &stm32_example(Runner::Qemu, "wraps", 38_400),
        Runner::Qemu,
        LINE,
    );
    let (before, _) = beats(&mut rig);
    let from = rig.bus.now();
    // TIM2 goes round after a second.
    rig.pause(Time::from_s(3));
    let (after, late_us) = beats(&mut rig);
    let expected = (rig.bus.now() - from).ps() / Time::from_ms(10).ps();
    assert!(
        u64::from(after - before).abs_diff(expected) <= 1,
        "{before}, {after}, not {expected} more"
    );
    assert!(late_us < 100, "{late_us} us late");
}
