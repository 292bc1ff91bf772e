//! Counters, event log and listen-only mode of a server, when they wrap, are cleared, or are full (APP 6.8 to 6.10;
//! SER appendix A).

mod common;

use common::{LOCKED, Tables, UNIT};
use multidrop_protocol::Adu;
use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::server::{Counted, Server};

struct Unit {
    server: Server<Counted<64>>,
    model: Tables,
}

impl Unit {
    fn new() -> Unit {
        Unit {
            server: Server::counted(UNIT),
            model: Tables::new(),
        }
    }

    /// A good frame that stands: the answer, nothing if there is none.
    fn ask(&mut self, request: &[u8]) -> Vec<u8> {
        let mut frame: Adu = [0xA5; 256];
        frame[..request.len()].copy_from_slice(request);
        let len = request.len() as u8;
        let plan = self.server.prepare(&mut self.model, &mut frame, len);
        let len = self.server.commit(&mut self.model, &mut frame, len, plan);
        frame[..len.into()].to_vec()
    }

    /// A PDU to this unit; the PDU of the answer.
    fn pdu(&mut self, pdu: &[u8]) -> Vec<u8> {
        let answer = self.ask(&[&[UNIT], pdu].concat());
        answer.get(1..).unwrap_or(&[]).to_vec()
    }

    fn counter(&mut self, sub: u8) -> u16 {
        let answer = self.pdu(&[8, 0, sub, 0, 0]);
        assert_eq!(answer[..3], [8, 0, sub]);
        u16::from_be_bytes([answer[3], answer[4]])
    }

    /// The counter of FC 0B.
    fn events(&mut self) -> u16 {
        let answer = self.pdu(&[0x0B]);
        assert_eq!(answer[..3], [0x0B, 0, 0]);
        u16::from_be_bytes([answer[3], answer[4]])
    }

    /// The messages that FC 0C tells, and its event bytes.
    fn log(&mut self) -> (u16, Vec<u8>) {
        let answer = self.pdu(&[0x0C]);
        assert_eq!(usize::from(answer[1]), answer.len() - 2);
        let messages = u16::from_be_bytes([answer[6], answer[7]]);
        (messages, answer[8..].to_vec())
    }
}

const READ: [u8; 5] = [3, 0, 0, 0, 1];
const CLEAR: [u8; 5] = [8, 0, 0x0A, 0, 0];

#[test]
fn all_counters_go_round_after_65_536_messages() {
    let mut unit = Unit::new();
    unit.pdu(&CLEAR);
    // A write to a locked coil is an exception 07; one of these messages is everything that can be counted of a good one.
    for _ in 0..65_535 {
        assert_eq!(unit.pdu(&[5, 0, LOCKED as u8, 0, 0]), [0x85, 7]);
        unit.server.damaged(ReceiveErrors::OVERRUN);
    }
    // Asking is a message of its own each time.
    assert_eq!(unit.counter(0x0D), 65_535);
    assert_eq!((unit.counter(0x10), unit.counter(0x0C)), (65_535, 65_535));
    assert_eq!(unit.counter(0x12), 65_535);
    // 65535 writes, four questions, and this one: 65540.
    assert_eq!(unit.counter(0x0B), 4);
    assert_eq!(unit.counter(0x0E), 5);
    assert_eq!(unit.log().0, 6);
    unit.pdu(&[5, 0, LOCKED as u8, 0, 0]);
    unit.server.damaged(ReceiveErrors::OVERRUN);
    for sub in [0x0C, 0x0D, 0x10, 0x12] {
        assert_eq!(unit.counter(sub), 0, "{sub:02X}");
    }
}

#[test]
fn the_event_counter_and_the_unanswered_go_round_too() {
    let mut unit = Unit::new();
    unit.pdu(&CLEAR);
    for _ in 0..65_535 {
        unit.ask(&[0, 6, 0, 1, 0, 9]);
    }
    assert_eq!(unit.events(), 65_535);
    assert_eq!(unit.counter(0x0F), 65_535);
    // That question was the event that takes it round.
    assert_eq!(unit.events(), 0);
    unit.ask(&[0, 6, 0, 1, 0, 9]);
    assert_eq!((unit.counter(0x0F), unit.events()), (0, 2));
}

#[test]
fn clearing_sets_every_counter_and_the_diagnostic_register_to_0() {
    let mut unit = Unit::new();
    unit.server.diagnostics().set_diagnostic_register(0x1234);
    for _ in 0..3 {
        unit.pdu(&[5, 0, LOCKED as u8, 0, 0]);
        unit.ask(&[0, 6, 0, 1, 0, 9]);
        unit.server.damaged(ReceiveErrors::OVERRUN);
    }
    // A restart leaves the register alone (APP 6.8.1 names it for 0A only).
    assert_eq!(unit.pdu(&[8, 0, 1, 0, 0]), [8, 0, 1, 0, 0]);
    for sub in [0x0C, 0x0D, 0x0F, 0x10, 0x12] {
        assert_eq!(unit.counter(sub), 0, "{sub:02X}");
    }
    assert_eq!(unit.counter(2), 0x1234);
    unit.server.damaged(ReceiveErrors::OVERRUN);
    assert_eq!(unit.pdu(&CLEAR), CLEAR);
    assert_eq!(unit.events(), 0);
    assert_eq!(unit.counter(2), 0);
    // The question before, and this one; the clearing message is none of them.
    assert_eq!(unit.counter(0x0B), 3);
    for sub in [0x0C, 0x0D, 0x0F, 0x10, 0x12] {
        assert_eq!(unit.counter(sub), 0, "{sub:02X}");
    }
    // It can be set anew.
    unit.server.diagnostics().set_diagnostic_register(7);
    assert_eq!(unit.counter(2), 7);
}

#[test]
fn an_overrun_is_counted_beside_the_error_and_cleared_by_itself() {
    let mut unit = Unit::new();
    unit.server.damaged(ReceiveErrors::OVERRUN);
    unit.server.damaged(ReceiveErrors::CHECK);
    unit.server
        .damaged(ReceiveErrors::OVERRUN | ReceiveErrors::CHECK);
    assert_eq!((unit.counter(0x0C), unit.counter(0x12)), (3, 2));
    // Receive events: bit 1 the error, bit 4 the overrun.
    assert_eq!(unit.log().1[5..], [0x92, 0x82, 0x92]);
    assert_eq!(unit.pdu(&[8, 0, 0x14, 0, 0]), [8, 0, 0x14, 0, 0]);
    assert_eq!((unit.counter(0x0C), unit.counter(0x12)), (3, 0));
    // No damaged frame is a message.
    assert_eq!(unit.counter(0x0B), 7);
}

#[test]
fn reading_the_events_and_exceptions_do_not_count_as_events() {
    let mut unit = Unit::new();
    unit.pdu(&READ);
    for _ in 0..3 {
        assert_eq!(unit.events(), 1);
        unit.log();
        unit.pdu(&[5, 0, LOCKED as u8, 0, 0]);
        unit.ask(&[0, 5, 0, LOCKED as u8, 0, 0]);
        unit.ask(&[0, 3, 0, 0, 0, 1]);
    }
    unit.pdu(&[8, 0, 0, 1, 2]);
    assert_eq!(unit.events(), 2);
}

#[test]
fn the_log_keeps_the_last_64_in_order_wherever_it_begins() {
    let mut unit = Unit::new();
    // What each puts there: a good read 80 40, a refused one 80 48, a broadcast C0 40, a damaged frame 82.
    let mut told = Vec::new();
    for round in 0..200_u32 {
        match round * 7 % 4 {
            0 => {
                unit.pdu(&READ);
                told.extend([0x80, 0x40]);
            }
            1 => {
                unit.pdu(&[5, 0, LOCKED as u8, 0, 0]);
                told.extend([0x80, 0x48]);
            }
            2 => {
                unit.ask(&[0, 6, 0, 1, 0, 9]);
                told.extend([0xC0, 0x40]);
            }
            _ => {
                unit.server.damaged(ReceiveErrors::CHECK);
                told.push(0x82);
            }
        }
        let newest_first = told.iter().rev().copied();
        let expected: Vec<_> = [0x80].into_iter().chain(newest_first).take(64).collect();
        assert_eq!(unit.log().1, expected, "after {round}");
        told.extend([0x80, 0x40]);
    }
    // 0000 keeps the log, FF00 clears it; both add the restart.
    unit.pdu(&[8, 0, 1, 0, 0]);
    told.extend([0x80, 0x40, 0x00]);
    let newest_first = told.iter().rev().copied();
    let expected: Vec<_> = [0x80].into_iter().chain(newest_first).take(64).collect();
    assert_eq!(unit.log().1, expected);
    unit.pdu(&[8, 0, 1, 0xFF, 0]);
    assert_eq!(unit.log(), (1, vec![0x80, 0x00]));
    // And it fills anew from wherever it stood.
    unit.pdu(&READ);
    assert_eq!(unit.log().1, [0x80, 0x40, 0x80, 0x40, 0x80, 0x00]);
}

#[test]
fn a_refused_broadcast_is_counted_as_an_exception() {
    let mut unit = Unit::new();
    assert!(unit.ask(&[0, 5, 0, LOCKED as u8, 0, 0]).is_empty());
    assert_eq!(unit.counter(0x0D), 1);
    assert_eq!(unit.counter(0x10), 1);
    assert_eq!(unit.counter(0x0F), 1);
    // Its send event has no exception: nothing was sent.
    assert_eq!(unit.log().1[7..], [0x40, 0xC0]);
    // A broadcast read is ignored, not refused.
    assert!(unit.ask(&[0, 3, 0, 0, 0, 1]).is_empty());
    assert_eq!((unit.counter(0x0D), unit.counter(0x0F)), (1, 2));
}

#[test]
fn only_a_restart_ends_listen_only_mode() {
    let mut unit = Unit::new();
    assert!(unit.ask(&[UNIT, 8, 0, 4, 0, 0]).is_empty());
    assert!(unit.server.diagnostics().listens_only());
    for request in [
        &[UNIT, 3, 0, 0, 0, 1][..],
        &[UNIT, 6, 0, 0, 0, 1],
        &[0, 6, 0, 0, 0, 1],
        &[UNIT, 8, 0, 0x0A, 0, 0],
        &[UNIT, 8, 0, 1, 0, 1],
        &[UNIT, 8, 0, 1, 0],
        &[UNIT, 8, 0, 4, 0, 0],
    ] {
        assert!(unit.ask(request).is_empty(), "{request:?}");
        assert!(unit.server.diagnostics().listens_only(), "{request:?}");
    }
    assert_eq!(unit.model.holding[0], 0, "nothing was written");
    assert!(unit.ask(&[UNIT, 8, 0, 1, 0, 0]).is_empty());
    assert!(!unit.server.diagnostics().listens_only());
    assert_eq!(unit.pdu(&READ), [3, 2, 0, 0]);
}

#[test]
fn frames_for_others_are_messages_of_the_bus_and_no_others() {
    let mut unit = Unit::new();
    unit.pdu(&CLEAR);
    for _ in 0..3 {
        assert!(unit.ask(&[UNIT + 1, 3, 0, 0, 0, 1]).is_empty());
    }
    // Three, and each question itself, CLEAR not: it is counted before it clears.
    assert_eq!(unit.counter(0x0B), 4);
    assert_eq!(unit.counter(0x0E), 2);
    assert_eq!(unit.counter(0x0F), 0);
}
