//! A peer that keeps CTS off: a frame waits for CTS_TIMEOUT and no longer. In the image that is flashed, since QEMU
//! has no pins.

use multidrop_bus::{Bus, BusConfig, HostId, HostPort, Line, MachineId, Stm32, Time, WireId};
use multidrop_testkit::frames::{data, words};
use multidrop_testkit::{LINE, Runner, stm32_example};

/// CTS_TIMEOUT of both ports.
const CTS_TIMEOUT: Time = Time::from_ms(200);

/// The CTS pins of AS1 and RS2.
const AS1: (char, u8) = ('A', 11);
const RS2: (char, u8) = ('B', 13);

/// The image `handshake`, a host on AS1 and one on RS2.
struct Desk {
    bus: Bus,
    machine: MachineId,
    as1: HostId,
    rs2: HostId,
    rs2_wire: WireId,
}

impl Desk {
    fn new() -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let rs2_wire = bus.add_wire();
        let machine = bus
            .add_stm32(Stm32 {
                name: "handshake".to_owned(),
                image: stm32_example(Runner::Core, "handshake", 38_400),
                emulator: Runner::Core.emulator(),
                wires: [Some(WireId::default()), None, Some(rs2_wire), None],
            })
            .expect("a valid image");
        let as1 = bus.add_host(HostPort::new(LINE));
        let rs2 = bus.add_host_on(rs2_wire, HostPort::new(LINE));
        let mut desk = Desk {
            bus,
            machine,
            as1,
            rs2,
            rs2_wire,
        };
        desk.hold(AS1, false);
        desk.hold(RS2, false);
        desk.bus.run_for(Time::from_ms(50));
        desk
    }

    /// Takes CTS away, or gives it.
    fn hold(&mut self, (gpio, number): (char, u8), held: bool) {
        let silicon = self.bus.machine_mut(self.machine).silicon();
        silicon
            .expect("it is not in QEMU")
            .drive(gpio, number, Some(held));
    }

    fn ask(&mut self, request: &[u8]) -> Vec<u8> {
        let answer = self.bus.transact(self.as1, request, Time::from_ms(20));
        answer.map_or(Vec::new(), |answer| answer.bytes)
    }

    #[track_caller]
    fn expect(&mut self, request: &[u8], answer: &[u8]) {
        let heard = self.ask(request);
        assert_eq!(heard, answer, "{request:02x?}\n{}", self.bus.record());
    }

    /// 08/000F: requests that were not answered.
    #[track_caller]
    fn expect_unanswered(&mut self, count: u16) {
        let request = words(1, 8, 0x0F, 0);
        let answer = words(1, 8, 0x0F, count);
        self.expect(&request, &answer);
    }
}

#[test]
fn an_answer_that_is_held_is_dropped_at_the_end_of_cts_timeout() {
    let mut desk = Desk::new();
    let write = words(1, 6, 5, 0x1234);
    desk.expect(&write, &write);
    desk.expect_unanswered(0);
    for round in 1..=2 {
        desk.hold(AS1, true);
        let begun = desk.bus.now();
        desk.bus.clear_record();
        let read = words(1, 3, 5, 1);
        desk.expect(&read, &[]);
        // It is not dropped before: the peer may take its time.
        desk.bus.run_to(begun + CTS_TIMEOUT - Time::from_ms(20));
        desk.hold(AS1, false);
        desk.bus.run_for(Time::from_ms(10));
        let heard = desk.bus.host(desk.as1).take();
        let heard: Vec<u8> = heard.iter().map(|byte| byte.value).collect();
        assert_eq!(heard, data(1, 3, &[0x12, 0x34]));

        desk.hold(AS1, true);
        desk.expect(&read, &[]);
        desk.bus.run_for(CTS_TIMEOUT);
        desk.bus.clear_record();
        desk.hold(AS1, false);
        // Nothing of it is left over.
        desk.bus.run_for(Time::from_ms(50));
        assert_eq!(desk.bus.record().bytes(), []);
        desk.expect(&read, &data(1, 3, &[0x12, 0x34]));
        desk.expect_unanswered(round);
    }
}

#[test]
fn cts_timeout_may_be_longer_than_the_timer_of_the_line_can_tell_past_from_future() {
    let mut desk = Desk::new();
    let longer = words(1, 6, 0, 3);
    desk.expect(&longer, &longer);
    desk.bus.run_for(Time::from_ms(50));
    let (read, answer) = (words(1, 3, 5, 1), data(1, 3, &[0, 0]));
    // Half a round of TIM5 is 51 s.
    for (held_s, is_dropped) in [(59, false), (61, true)] {
        desk.hold(AS1, true);
        desk.expect(&read, &[]);
        desk.bus.run_for(Time::from_s(held_s));
        desk.hold(AS1, false);
        desk.bus.run_for(Time::from_ms(20));
        let heard = desk.bus.host(desk.as1).take();
        let heard: Vec<u8> = heard.iter().map(|byte| byte.value).collect();
        let expected = if is_dropped { &[][..] } else { &answer };
        assert_eq!(heard, expected, "{held_s} s");
        desk.expect(&read, &answer);
    }
    desk.expect_unanswered(1);
}

#[test]
fn settings_wait_no_longer_than_cts_timeout() {
    let mut desk = Desk::new();
    desk.hold(AS1, true);
    let slower = words(1, 6, 0, 2);
    desk.expect(&slower, &[]);
    desk.bus.run_for(CTS_TIMEOUT + Time::from_ms(20));
    desk.hold(AS1, false);
    desk.bus.host(desk.as1).set_line(Line::n81(9_600));
    desk.bus.host(desk.as1).take();
    desk.expect(&words(1, 3, 5, 1), &data(1, 3, &[0, 0]));
}

#[test]
fn a_request_that_is_held_ends_with_an_error_of_its_own() {
    let mut desk = Desk::new();
    let outcome = words(1, 3, 1, 1);
    let mut before = 0;
    // Held, and not held but not answered, which takes its TIMEOUT of a second.
    for (held, after) in [(true, 2), (false, 3), (true, 2)] {
        desk.hold(RS2, held);
        let order = words(1, 6, 0, 1);
        desk.expect(&order, &order);
        desk.bus.run_for(CTS_TIMEOUT - Time::from_ms(40));
        desk.expect(&outcome, &data(1, 3, &[0, before]));
        desk.bus
            .run_for(Time::from_ms(if held { 60 } else { 1_000 }));
        desk.expect(&outcome, &data(1, 3, &[0, after]));
        let sent = desk.bus.record_of(desk.rs2_wire).bytes().len();
        assert_eq!(sent, if held { 0 } else { 8 });
        desk.bus.clear_record();
        desk.bus.host(desk.rs2).take();
        before = after;
        // An answer may be late: LATE_GUARD is over before the next one is asked.
        desk.bus.run_for(Time::from_ms(1_100));
    }
}
