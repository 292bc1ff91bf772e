//! Features of some drivers: a delay before an answer, DE before the first character, a limit on the time of a
//! transmission, and text. And the events for a task that waits for silence.

mod driver;

use driver::{Did, Line, REQUEST};
use multidrop_protocol::Adu;
use multidrop_protocol::frame::{ReceiveErrors, Received};
use multidrop_protocol::line::{Interval, Wire};
use multidrop_protocol::rtu::Reception;

const TALK: [Did; 2] = [Did::Talk(0x11), Did::Bound(3)];

#[test]
fn an_answer_waits_for_its_delay_part_by_part() {
    let mut line = Line::new();
    for byte in REQUEST {
        line.hear(byte, ReceiveErrors::NONE);
    }
    line.alarm();
    assert_eq!(line.machine.fetch(), Some(Ok(2)));
    assert_eq!(
        line.alarm(),
        [Did::BeginDelay, Did::Alarm(Interval::ToStart)]
    );
    line.driver.delays = 2;
    assert_eq!(line.release(3), []);
    for _ in 0..2 {
        assert_eq!(line.alarm(), []);
        assert_eq!(line.machine.sent(), None);
        assert!(!line.machine.is_sending());
    }
    assert_eq!(line.alarm(), TALK);
    assert!(line.machine.is_sending());
}

#[test]
fn where_gaps_are_allowed_the_delay_begins_with_the_frame() {
    let mut line = Line::new();
    line.driver.stands_at_once = true;
    for byte in REQUEST {
        line.hear(byte, ReceiveErrors::NONE);
    }
    line.did();
    assert_eq!(
        line.alarm(),
        [
            Did::Alarm(Interval::ToStand),
            Did::BeginDelay,
            Did::Alarm(Interval::ToStart),
            Did::Receiver
        ]
    );
}

#[test]
fn new_settings_end_a_delay() {
    let mut line = Line::new();
    line.hear_request();
    line.driver.delays = 9;
    line.machine.reset(&mut line.driver);
    let did = line.did();
    assert!(did.contains(&Did::EndDelay));
    assert_eq!(did[did.len() - 2..], [Did::Alarm(Interval::T3_5), Did::On]);
}

#[test]
fn the_driver_is_on_before_the_first_character() {
    let mut line = Line::new();
    line.driver.leads = true;
    line.hear_request();
    line.release(3);
    assert_eq!(line.alarm(), [Did::Lead]);
    assert!(line.machine.is_sending());
    assert_eq!(line.machine.sent(), None);
    // The receiver is off; what it had is dropped.
    line.hear(0x55, ReceiveErrors::NONE);
    assert_eq!(line.did(), []);
    assert_eq!(line.alarm(), [&[Did::Off][..], &TALK].concat());
    assert!(line.machine.is_sending());
}

#[test]
fn a_frame_withdrawn_while_the_driver_is_on_is_not_sent() {
    let mut line = Line::new();
    line.driver.leads = true;
    line.hear_request();
    line.release(3);
    line.alarm();
    assert!(line.machine.is_lent());
    line.machine.give_back(&mut line.driver);
    assert!(!line.machine.is_lent());
    assert_eq!(
        line.alarm(),
        [Did::Listen, Did::Alarm(Interval::T3_5Then), Did::User]
    );
    assert!(!line.machine.is_sending());
    assert!(!line.machine.take_buffer());
    assert_eq!(line.alarm(), [Did::Off, Did::User]);
    assert!(line.machine.take_buffer());
}

#[test]
fn a_transmitter_that_does_not_end_is_cut_off() {
    let mut line = Line::new();
    line.hear_request();
    line.release(3);
    line.alarm();
    assert_eq!(line.alarm(), [], "there is time left");
    assert!(!line.machine.was_cut() && line.machine.is_sending());
    line.driver.bound_is_over = true;
    assert_eq!(
        line.alarm(),
        [Did::Cut, Did::Alarm(Interval::T3_5Then), Did::User]
    );
    assert!(line.machine.was_cut() && !line.machine.is_sending());
    assert_eq!(line.machine.sent(), Some(false));
    line.machine.give_back(&mut line.driver);
    assert!(!line.machine.was_cut());
}

/// What goes out of the transmitter, to its end.
fn send(line: &mut Line) -> Vec<u8> {
    let mut sent = Vec::new();
    for did in line.did() {
        match did {
            Did::Talk(byte) | Did::Put(byte, _) => sent.push(byte),
            _ => {}
        }
    }
    loop {
        line.driver.room = 1;
        line.machine.on_ready(&mut line.driver);
        match line.did()[..] {
            [Did::Put(byte, last)] => {
                sent.push(byte);
                line.machine.on_sent(&mut line.driver);
                let end = [Did::Listen, Did::Alarm(Interval::T3_5), Did::On, Did::User];
                let is_end = line.did() == end;
                assert_eq!(is_end, last, "{} bytes", sent.len());
                if last {
                    return sent;
                }
            }
            ref did => panic!("{did:?}"),
        }
    }
}

#[test]
fn text_is_sent_without_a_check() {
    let mut line = Line::new();
    line.driver.is_text = true;
    assert!(line.machine.take_buffer());
    line.driver.adu[..4].copy_from_slice(b"AT\r\n");
    line.driver.room = 1;
    line.machine.release(&mut line.driver, 4);
    assert_eq!(send(&mut line), *b"AT\r\n");
    assert_eq!(line.machine.sent(), Some(true));
    // Nothing behind it.
    line.machine.on_ready(&mut line.driver);
    assert_eq!(line.did(), [Did::End]);
}

#[test]
fn a_request_over_a_start_bit_waits_for_silence() {
    let mut line = Line::new();
    assert!(line.machine.take_buffer());
    line.driver.start_bit = true;
    line.driver.delays = 5;
    assert_eq!(
        line.release(3),
        [Did::EndDelay, Did::Alarm(Interval::T3_5), Did::On]
    );
    assert!(!line.driver.start_bit);
    assert_eq!(line.machine.sent(), None);
    assert_eq!(line.alarm(), TALK);
    assert_eq!(send(&mut line).len(), 4);
}

#[test]
fn a_frame_without_room_wakes_the_wait_for_silence() {
    let mut line = Line::new();
    line.hear(1, ReceiveErrors::NONE);
    line.did();
    assert_eq!(line.machine.quiet(&mut line.driver), None);
    line.machine.on_too_long(&mut line.driver);
    assert_eq!(line.did(), [Did::User]);
    assert_eq!(
        line.machine.quiet(&mut line.driver),
        Some(ReceiveErrors::LENGTH)
    );
}

#[test]
fn a_line_is_quiet_when_no_good_frame_may_come() {
    let mut line = Line::new();
    assert_eq!(
        line.machine.quiet(&mut line.driver),
        Some(ReceiveErrors::NONE)
    );
    // A start bit: what comes of it is there within t3.5.
    line.driver.start_bit = true;
    assert_eq!(line.machine.quiet(&mut line.driver), None);
    assert_eq!(line.did(), [Did::Alarm(Interval::T3_5), Did::On]);
    assert_eq!(line.alarm(), [Did::Off, Did::User]);
    assert_eq!(
        line.machine.quiet(&mut line.driver),
        Some(ReceiveErrors::NONE)
    );
    // A character of a frame that may become good, and one that has spoilt it.
    line.hear(0x11, ReceiveErrors::NONE);
    assert_eq!(line.machine.quiet(&mut line.driver), None);
    line.did();
    line.hear(0x03, ReceiveErrors::PARITY);
    assert_eq!(line.did(), [Did::User]);
    assert_eq!(
        line.machine.quiet(&mut line.driver),
        Some(ReceiveErrors::PARITY)
    );
    line.alarm();
    line.alarm();
    // It is over and was not told yet.
    assert_eq!(line.machine.quiet(&mut line.driver), None);
    assert_eq!(line.machine.fetch(), Some(Err(ReceiveErrors::PARITY)));
    assert_eq!(
        line.machine.quiet(&mut line.driver),
        Some(ReceiveErrors::NONE)
    );
    // A good frame that nobody has fetched.
    for byte in REQUEST {
        line.hear(byte, ReceiveErrors::NONE);
    }
    for _ in 0..3 {
        line.alarm();
        assert_eq!(line.machine.quiet(&mut line.driver), None);
    }
    assert_eq!(line.machine.fetch(), Some(Ok(2)));
    assert_eq!(
        line.machine.quiet(&mut line.driver),
        Some(ReceiveErrors::NONE)
    );
    // The buffer is lent: the first character of the next frame is kept, and that frame may be good.
    line.hear(0x11, ReceiveErrors::NONE);
    assert_eq!(line.machine.quiet(&mut line.driver), None);
    line.hear(0x03, ReceiveErrors::NONE);
    assert_eq!(
        line.machine.quiet(&mut line.driver),
        Some(ReceiveErrors::OVERRUN)
    );
}

#[test]
fn a_line_is_not_quiet_while_it_sends() {
    let mut line = Line::new();
    line.hear_request();
    line.release(3);
    line.alarm();
    assert_eq!(line.machine.quiet(&mut line.driver), None);
    send(&mut line);
    assert_eq!(line.machine.quiet(&mut line.driver), None);
    assert_eq!(line.alarm(), [Did::Off, Did::User]);
    assert_eq!(
        line.machine.quiet(&mut line.driver),
        Some(ReceiveErrors::NONE)
    );
}

/// A driver that has nothing of all that, and leaves it out.
struct Plain {
    adu: Adu,
    listens: u8,
}

impl Wire for Plain {
    fn take(&mut self) -> u8 {
        0
    }
    fn start_bit_seen(&mut self) -> bool {
        false
    }
    fn clear_start_bit(&mut self) {}
    fn alarm(&mut self, _: Interval) -> bool {
        true
    }
    fn alarm_on(&mut self) {}
    fn alarm_off(&mut self) {}
    fn restart(&mut self) {}
    fn finish(&mut self) -> Received {
        Reception::new().finish()
    }
    fn adu(&self) -> &Adu {
        &self.adu
    }
    fn talk(&mut self, _: u8) {}
    fn is_ready(&mut self) -> bool {
        false
    }
    fn put(&mut self, _: u8, _: bool) {}
    fn end(&mut self) {}
    fn listen(&mut self) {
        self.listens += 1;
    }
    fn wake_receiver(&mut self) {}
    fn wake_user(&mut self) {}
}

#[test]
fn a_driver_need_not_have_any_of_it() {
    let mut plain = Plain {
        adu: [7; 256],
        listens: 0,
    };
    assert!(plain.ascii().is_none() && !plain.is_text());
    plain.store(3, 9);
    assert_eq!(plain.adu, [7; 256]);
    plain.bound(4);
    assert!(!plain.is_bound_over() && plain.is_delay_over() && !plain.lead());
    plain.begin_delay();
    plain.end_delay();
    plain.cut();
    assert_eq!(plain.listens, 1, "what is cut off listens");
}
