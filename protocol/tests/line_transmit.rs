//! Transmissions that are not answers: the requests of a client.

use multidrop_protocol::frame::ReceiveErrors;
use multidrop_testkit::harness::book::framed;
use multidrop_testkit::harness::bus::{Bus, Char, Settings};

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

/// Hands something to the line, as a port does; whether that has lent its buffer.
fn release(bus: &mut Bus) -> bool {
    if !bus.take_buffer() {
        return false;
    }
    bus.adu()[..BODY.len()].copy_from_slice(&BODY);
    bus.release(BODY.len() as u8);
    true
}

/// Begins a transmission, and withdraws it unless it is sent at once; returns whether it was sent.
fn try_to_transmit(bus: &mut Bus) -> bool {
    if !release(bus) {
        return false;
    }
    let sends = bus.machine.is_sending();
    if !sends {
        bus.give_back();
    }
    sends
}

/// Whoever releases too late is told so, and not left to wait.
#[test]
fn a_frame_that_is_withdrawn_is_reported_as_not_sent() {
    let mut bus = bus();
    hear(&mut bus, 2000);
    bus.pass(2448);
    assert!(release(&mut bus));
    assert_eq!(bus.machine.sent(), None);
    hear(&mut bus, 2449);
    bus.chip.user_woken = false;
    // An edge so far, which might be none.
    bus.pass(2543);
    assert_eq!((bus.machine.sent(), bus.chip.user_woken), (None, false));
    bus.pass(2544);
    assert_eq!(
        (bus.machine.sent(), bus.chip.user_woken),
        (Some(false), true)
    );
    bus.give_back();
    assert!(!try_to_transmit(&mut bus));
    bus.pass(2449 + 100 + 350);
    assert!(try_to_transmit(&mut bus));
}

fn hear(bus: &mut Bus, start: u64) {
    let byte = 0x55;
    let errors = ReceiveErrors::NONE;
    bus.chip.chars.push(Char {
        start,
        byte,
        errors,
    });
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
fn a_task_that_waits_for_silence_is_woken_at_t3_5() {
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
fn the_next_frame_waits_for_t3_5_after_the_last_transmission() {
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

/// One that tries again and again does not wait longer by that, nor talks over a character of which only the start bit has
/// come so far.
#[test]
fn an_edge_delays_a_transmission_by_t3_5() {
    for tries in [1, 2, 5] {
        let mut bus = bus();
        bus.chip.glitches.push(1200);
        for at in 0..tries {
            bus.pass(5000 + 50 * at);
            assert!(release(&mut bus));
            assert_eq!(bus.machine.sent(), None);
            if at + 1 < tries {
                bus.give_back();
            }
        }
        bus.pass(5000 + 460);
        assert_eq!(bus.chip.talks[0].start, 5000 + 355, "{tries} tries");
    }
}

#[test]
fn no_transmission_begins_during_a_received_character() {
    let mut bus = bus();
    hear(&mut bus, 4950);
    bus.pass(5000);
    assert!(release(&mut bus));
    bus.pass(5045);
    assert_eq!(bus.machine.sent(), Some(false));
    bus.give_back();
    bus.pass(5049 + 340);
    assert!(!try_to_transmit(&mut bus));
    bus.pass(5050 + 460);
    assert!(try_to_transmit(&mut bus));
}

/// As a client does whose answer has just come: the next request is started at t3.5 by the alarm.
#[test]
fn a_request_made_when_a_frame_stands_starts_at_t3_5_to_the_tick() {
    for good in [true, false] {
        let mut bus = bus();
        let mut bytes = framed(&BODY);
        if !good {
            bytes[7] ^= 1;
        }
        for (index, &byte) in bytes.iter().enumerate() {
            let start = 2000 + 100 * index as u64;
            let errors = ReceiveErrors::NONE;
            bus.chip.chars.push(Char {
                start,
                byte,
                errors,
            });
        }
        let end = 2000 + FRAME;
        bus.pass(end + 160);
        if good {
            assert_eq!(bus.fetch(), Some(Ok(BODY.len() as u8)));
            bus.give_back();
        }
        assert!(!bus.take_buffer());
        bus.pass(end + 347);
        assert!(!bus.take_buffer());
        // Judged two ticks early.
        bus.pass(end + 348);
        assert!(bus.chip.user_woken && release(&mut bus));
        assert_eq!(bus.machine.sent(), None);
        bus.pass(end + 350 + FRAME);
        assert_eq!(bus.machine.sent(), Some(true), "good: {good}");
        let talk = &bus.chip.talks[0];
        assert_eq!((talk.start, talk.end), (end + 350, end + 350 + FRAME));
        assert_eq!(talk.bytes, framed(&BODY));
    }
}
