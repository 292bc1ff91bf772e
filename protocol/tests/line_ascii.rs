//! Characters on an ASCII line that no task waits for, and the tasks that are woken.

mod driver;

use driver::{Did, Line};
use multidrop_protocol::frame::ReceiveErrors;

/// `:`, unit id, function code, LRC, CR and LF.
const REQUEST: [u8; 9] = *b":1107E8\r\n";

fn hear(line: &mut Line, characters: &[u8]) {
    for character in characters {
        line.machine
            .on_ascii_character(&mut line.driver, *character, ReceiveErrors::NONE);
    }
}

#[test]
fn characters_during_a_transmission_are_not_received() {
    let mut line = Line::ascii();
    hear(&mut line, &REQUEST);
    assert_eq!(line.machine.fetch(), Some(Ok(2)));
    line.did();
    line.release(3);
    assert_eq!(line.alarm(), [Did::Talk(b':'), Did::Bound(3)]);
    hear(&mut line, b"x:");
    assert_eq!(line.did(), []);
    assert!(line.machine.is_sending());
    // Nor while its driver is on and nothing on the wire yet.
    let mut line = Line::ascii();
    line.driver.leads = true;
    hear(&mut line, &REQUEST);
    assert_eq!(line.machine.fetch(), Some(Ok(2)));
    line.did();
    line.release(3);
    assert_eq!(line.alarm(), [Did::Lead]);
    hear(&mut line, &REQUEST);
    assert_eq!(line.did(), []);
    assert_eq!(line.machine.fetch(), None);
}

#[test]
fn a_wait_for_silence_is_woken_by_a_damaged_frame_and_not_by_a_digit() {
    let mut line = Line::ascii();
    hear(&mut line, b":1");
    assert_eq!(line.machine.quiet(&mut line.driver), None);
    line.did();
    hear(&mut line, b"10");
    assert_eq!(line.did(), []);
    line.machine
        .on_ascii_character(&mut line.driver, b'7', ReceiveErrors::PARITY);
    assert_eq!(line.did(), [Did::User]);
    assert_eq!(
        line.machine.quiet(&mut line.driver),
        Some(ReceiveErrors::PARITY)
    );
}
