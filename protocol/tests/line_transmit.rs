//! Sending without having been asked: a client's request.

mod harness;

use harness::book::framed;
use harness::bus::{Bus, Char, Settings};
use multidrop_protocol::rtu::Flaws;

const BODY: [u8; 6] = [5, 3, 0, 0, 0, 1];
const FRAME: u64 = 800;

fn bus() -> Bus {
    let mut bus = Bus::new(Settings {
        character: 100,
        t1_5: 150,
        t3_5: 350,
        early: 2,
        strict: true,
        sees_start_bits: true,
        short_cut: true,
        ready_latency: 0,
    });
    bus.pass(1000);
    bus
}

/// One try, as a port makes it: whether it has begun to talk.
fn try_to_transmit(bus: &mut Bus) -> bool {
    if !bus.take_buffer() {
        return false;
    }
    bus.adu()[..BODY.len()].copy_from_slice(&BODY);
    bus.release(BODY.len() as u8);
    let sends = bus.machine.is_sending();
    if !sends {
        bus.give_back();
    }
    sends
}

fn hear(bus: &mut Bus, start: u64) {
    let byte = 0x55;
    let flaws = Flaws::NONE;
    bus.chip.chars.push(Char { start, byte, flaws });
}

#[test]
fn a_silent_line_sends_at_once() {
    let mut bus = bus();
    assert!(try_to_transmit(&mut bus));
    bus.pass(1000 + FRAME);
    assert!(!bus.machine.is_sending() && bus.chip.user_woken);
    let talk = &bus.chip.talks[0];
    assert_eq!((talk.start, talk.end), (1000, 1000 + FRAME));
    assert_eq!(talk.bytes, framed(&BODY));
}

#[test]
fn nobody_sends_before_t3_5_and_whoever_waits_is_woken_then() {
    let mut bus = bus();
    hear(&mut bus, 2000);
    for now in 2095..2448 {
        bus.pass(now);
        assert!(!try_to_transmit(&mut bus), "{now}");
        assert!(!bus.chip.user_woken);
    }
    bus.pass(2450);
    assert!(bus.chip.user_woken && try_to_transmit(&mut bus));
}

#[test]
fn the_next_frame_waits_for_t3_5_behind_ours() {
    let mut bus = bus();
    assert!(try_to_transmit(&mut bus));
    let end = 1000 + FRAME;
    bus.pass(end);
    bus.give_back();
    bus.chip.user_woken = false;
    assert!(!try_to_transmit(&mut bus));
    bus.pass(end + 349);
    assert!(!try_to_transmit(&mut bus) && !bus.chip.user_woken);
    bus.pass(end + 400);
    assert!(bus.chip.user_woken && try_to_transmit(&mut bus));
}

/// One that tries again and again must not do so for ever, nor talk over a character of which only the
/// start bit has come so far.
#[test]
fn an_edge_holds_a_line_back_for_t3_5() {
    let mut bus = bus();
    bus.chip.glitches.push(1200);
    bus.pass(5000);
    assert!(!try_to_transmit(&mut bus));
    assert!(!try_to_transmit(&mut bus));
    bus.pass(5000 + 340);
    assert!(!bus.chip.user_woken && !try_to_transmit(&mut bus));
    bus.pass(5000 + 460);
    assert!(bus.chip.user_woken && try_to_transmit(&mut bus));
}

#[test]
fn a_character_under_way_is_not_talked_over() {
    let mut bus = bus();
    hear(&mut bus, 4950);
    bus.pass(5000);
    assert!(!try_to_transmit(&mut bus));
    assert!(!try_to_transmit(&mut bus));
    bus.pass(5049 + 340);
    assert!(!try_to_transmit(&mut bus));
    bus.pass(5050 + 460);
    assert!(try_to_transmit(&mut bus));
}
