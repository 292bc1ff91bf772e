//! Requests routed from one line to another; the test plays client and server.

mod desk;

use std::cell::Cell;
use std::rc::Rc;

use desk::routed::{ClientSide, open, sent};
use desk::{Desk, Heard, Registers, SENDS, TestLine, Wire};
use multidrop::protocol::port_registers::Register;
use multidrop::protocol::registers::NoCoils;
use multidrop::{ClientConfig, ManagedPort, PortConfig, managed_receive, managed_run};

const TIMEOUT: u64 = 50;
const CONFIG: ClientConfig = ClientConfig::new().timeout_ms(TIMEOUT as u16);
/// From the request's end to the answer's.
const DELAY: u64 = 10;
/// What one exchange behind the router takes, and a little more than the way through it.
const EXCHANGE: u64 = SENDS + DELAY + 4;

/// A bus behind the router where every unit but 9 answers after `delay`, and never two requests at once.
fn bus(delay: impl Fn(&[u8]) -> u64 + 'static) -> impl FnMut(&[u8]) -> Vec<(u64, Heard)> {
    let mut registers = Registers::default();
    move |request| {
        if request[0] == 9 {
            return vec![];
        }
        let answer = registers.answer(request);
        let delay = delay(request);
        answer.map_or(vec![], |answer| vec![(delay, Heard::Frame(answer))])
    }
}

/// A port that asks through the desk's own.
fn client<const N: usize>(desk: &mut Desk<'_, N>) -> &'static Wire {
    let through = desk.port.client(CONFIG);
    open(desk, through).0
}

fn read(unit: u8, address: u8) -> Heard {
    Heard::Frame(vec![unit, 3, 0, address, 0, 1])
}

/// Register `address` of `target`, told by `unit`.
fn told(unit: u8, target: u8, address: u8) -> Vec<u8> {
    vec![unit, 3, 2, target.wrapping_mul(0x10), address]
}

#[test]
fn a_request_is_routed_and_its_answer_returned() {
    let mut desk = Desk::<1>::new(bus(|_| DELAY));
    let wire = client(&mut desk);
    for (unit, target) in [(2, 2), (4, 17), (3, 3)] {
        wire.comes(1, read(unit, 7));
        desk.run(EXCHANGE + SENDS + 2);
        assert_eq!(sent(wire), [told(unit, target, 7)]);
        wire.sent.borrow_mut().clear();
    }
    let targets: Vec<_> = desk.sent().iter().map(|request| request[0]).collect();
    assert_eq!(targets, [2, 17, 3]);
    // The unit's own exception is passed on.
    wire.comes(1, Heard::Frame(vec![4, 0x41, 1]));
    desk.run(EXCHANGE + SENDS + 2);
    assert_eq!(sent(wire), [[4, 0xC1, 1]]);
}

#[test]
fn others_units_and_broadcasts_are_not_routed() {
    let mut desk = Desk::<1>::new(bus(|_| DELAY));
    let wire = client(&mut desk);
    for unit in [6, 247, 248, 255] {
        wire.comes(1, read(unit, 7));
        // Given back before it stands.
        desk.run(1);
        assert!(!wire.is_lent(), "{unit}");
        desk.run(60);
        assert!(!wire.is_lent(), "{unit}");
    }
    wire.comes(1, Heard::Frame(vec![0, 6, 0, 1, 0, 1]));
    desk.run(60);
    assert_eq!(desk.sent(), [[0; 0]; 0]);
}

#[test]
fn the_ports_own_unit_takes_precedence_over_its_routes() {
    let mut desk = Desk::<1>::new(bus(|_| DELAY));
    let through = desk.port.client(CONFIG);
    let (wire, port) = open(&mut desk, through);
    port.load_raw(Register::Regs(0), 0x1234).unwrap();
    for (unit, own) in [(1, false), (3, true), (2, false)] {
        port.load_raw(Register::SlaveId, unit.into()).unwrap();
        desk.run(1);
        wire.comes(1, read(unit, 0));
        desk.run(SENDS + 4);
        wire.comes(1, read(3, 0));
        desk.run(EXCHANGE + SENDS + 2);
        let expected = if own {
            vec![3, 3, 2, 0x12, 0x34]
        } else {
            told(3, 3, 0)
        };
        assert_eq!(sent(wire), [vec![unit, 3, 2, 0x12, 0x34], expected]);
        wire.sent.borrow_mut().clear();
    }
}

#[test]
fn a_request_before_a_change_of_settings_is_not_answered_after_it() {
    let mut desk = Desk::<1>::new(bus(|_| DELAY));
    let through = desk.port.client(CONFIG);
    let (wire, port) = open(&mut desk, through);
    for (register, value) in [
        (Register::Baud, 9600),
        (Register::Mode, 2),
        (Register::Mode, 1),
    ] {
        wire.comes(1, read(2, 7));
        desk.run(SENDS + 4);
        port.load_raw(register, value).unwrap();
        desk.run(4 * EXCHANGE);
        assert_eq!(sent(wire), [[0; 0]; 0], "{register:?}");
    }
    wire.comes(1, read(2, 7));
    desk.run(EXCHANGE + SENDS + 2);
    assert_eq!(sent(wire), [told(2, 2, 7)]);
}

#[test]
fn a_target_port_that_is_not_master_is_exception_0a() {
    const BEHIND: PortConfig = PortConfig::new("RS4").client();
    let mut desk = Desk::<1>::new(bus(|_| DELAY));
    let far = desk.other();
    let behind = ManagedPort::new(TestLine(far), &BEHIND, BEHIND.bank(), NoCoils);
    let behind: &'static ClientSide = Box::leak(Box::new(behind));
    desk.spawn(async move { managed_receive(behind).await });
    desk.spawn(async move { managed_run(behind).await });
    let (wire, _) = open(&mut desk, behind.client(CONFIG));
    for (mode, told) in [(0, 0x0B), (1, 0x0A), (2, 0x0A), (3, 0x0A), (0, 0x0B)] {
        behind.load_raw(Register::Mode, mode).unwrap();
        desk.run(1);
        far.sent.borrow_mut().clear();
        wire.comes(1, read(4, 7));
        // Told at once if nobody is asked.
        desk.run(SENDS + 4 + if told == 0x0B { SENDS + TIMEOUT + 2 } else { 0 });
        assert_eq!(sent(wire), [[4, 0x83, told]], "mode {mode}");
        assert_eq!(sent(far).len(), usize::from(told == 0x0B), "mode {mode}");
        wire.sent.borrow_mut().clear();
        // A late answer is not expected any more.
        desk.run(TIMEOUT);
    }
    // A request that is under way ends; one that comes behind the change is refused.
    wire.comes(1, read(4, 7));
    desk.run(SENDS + 4);
    behind.load_raw(Register::Mode, 2).unwrap();
    desk.run(TIMEOUT + SENDS + 2);
    assert_eq!(sent(wire), [[4, 0x83, 0x0B]]);
}

#[test]
fn a_missing_unit_is_exception_0b_within_the_routes_timeout() {
    let mut desk = Desk::<1>::new(bus(|_| DELAY));
    let wire = client(&mut desk);
    wire.comes(1, read(5, 7));
    desk.run(SENDS + TIMEOUT + SENDS + 6);
    assert_eq!(sent(wire), [[5, 0x83, 0x0B]]);
    wire.sent.borrow_mut().clear();
    wire.comes(1, read(2, 8));
    desk.run(EXCHANGE + SENDS + 2);
    assert_eq!(sent(wire), [told(2, 2, 8)], "the next one");
}

#[test]
fn an_answer_that_comes_too_late_is_not_taken_for_the_next() {
    let slow = Rc::new(Cell::new(true));
    let first = slow.clone();
    let mut desk = Desk::<1>::new(bus(move |_| if first.take() { TIMEOUT + 3 } else { DELAY }));
    let wire = client(&mut desk);
    wire.comes(1, read(2, 7));
    desk.run(SENDS + TIMEOUT + SENDS + 6);
    assert_eq!(sent(wire), [[2, 0x83, 0x0B]]);
    wire.comes(1, read(2, 8));
    desk.run(2 * EXCHANGE);
    assert_eq!(sent(wire).last(), Some(&told(2, 2, 8)));
}

#[test]
fn two_clients_take_turns_on_one_bus() {
    let mut desk = Desk::<2>::new(bus(|_| DELAY));
    let clients = [client(&mut desk), client(&mut desk)];
    let mut expected = [vec![], vec![]];
    for address in 0..20 {
        for (place, wire) in clients.iter().enumerate() {
            let unit = 2 + place as u8;
            wire.comes(1, read(unit, address));
            expected[place].push(told(unit, unit, address));
        }
        desk.run(2 * EXCHANGE + SENDS + 4);
    }
    assert_eq!([sent(clients[0]), sent(clients[1])], expected);
    // One after the other: each request began when the answer to the one before was over.
    let requests = desk.wire.sent.borrow();
    let apart = requests.windows(2).map(|pair| pair[1].0 - pair[0].0);
    assert!(apart.min() >= Some(SENDS + DELAY));
    let units: Vec<_> = requests.iter().map(|(_, bytes)| bytes[0]).collect();
    assert_eq!(units, [2, 3].repeat(20));
}

#[test]
fn a_new_request_replaces_the_pending_one() {
    let mut desk = Desk::<1>::new(bus(|_| DELAY));
    let wire = client(&mut desk);
    // A frame begins when the one before has stood, and the answer would go out after the last of these.
    for second in 2..SENDS + DELAY + 1 {
        wire.comes(1, read(2, 7));
        wire.comes(2 + second, read(4, 8));
        desk.run(4 * EXCHANGE + TIMEOUT);
        assert_eq!(sent(wire), [told(4, 17, 8)], "{second} ms later");
        assert!(!wire.is_lent());
        wire.sent.borrow_mut().clear();
    }
}

#[test]
fn a_request_to_another_unit_replaces_the_pending_one_too() {
    let mut desk = Desk::<1>::new(bus(|_| DELAY));
    let wire = client(&mut desk);
    wire.comes(1, read(2, 7));
    wire.comes(8, read(77, 8));
    desk.run(4 * EXCHANGE);
    assert_eq!(sent(wire), [[0; 0]; 0]);
    assert!(!wire.is_lent());
}

#[test]
fn a_void_request_is_not_routed() {
    let mut desk = Desk::<1>::new(bus(|_| DELAY));
    let wire = client(&mut desk);
    wire.comes(1, Heard::Void(vec![2, 6, 0, 1, 0, 1]));
    desk.run(4 * EXCHANGE);
    assert_eq!(desk.sent(), [[0; 0]; 0]);
    assert!(!wire.is_lent());
}

#[test]
fn too_many_requests_are_exception_0a() {
    let mut desk = Desk::<1>::new(bus(|_| DELAY));
    let clients = [client(&mut desk), client(&mut desk), client(&mut desk)];
    for wire in clients {
        wire.comes(1, read(2, 7));
    }
    desk.run(4 * EXCHANGE);
    let answers = clients.map(|wire| sent(wire)[0].clone());
    let refused = answers.iter().filter(|answer| **answer == [2, 0x83, 0x0A]);
    assert_eq!(refused.count(), 1, "{answers:02X?}");
    assert_eq!(answers.iter().filter(|a| **a == told(2, 2, 7)).count(), 2);
}

#[test]
fn a_bus_that_is_never_silent_is_exception_0a() {
    let mut desk = Desk::<1>::new(bus(|_| DELAY));
    let wire = client(&mut desk);
    desk.wire.comes(1, Heard::Talk(10 * TIMEOUT));
    wire.comes(5, read(2, 7));
    desk.run(TIMEOUT + 5 * SENDS);
    assert_eq!(sent(wire), [[2, 0x83, 0x0A]]);
}
