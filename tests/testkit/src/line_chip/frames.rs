//! How frames come in.

use multidrop_protocol::format::{Framing, LineFormat};
use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::line::{Chip, LineConfig, LineError};
use multidrop_protocol::port_registers::InterCharacter;

use super::ChipUnderTest;
use super::desk::{ANSWER, CONFIG, Desk, REQUEST, count, crc};

/// Behind the reset of the machine the wire has to be silent for t3.5 before anything is sent.
pub fn a_line_that_is_set_up_listens_after_t3_5<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::new(CONFIG);
    assert_eq!(desk.on.de_changes(), [], "DE is down and stays so");
    desk.wait(desk.intervals.t3_5 - 1);
    assert!(!desk.machine(|machine, _| machine.take_buffer()));
    desk.wait(1 + desk.sight.latency);
    assert!(desk.machine(|machine, _| machine.take_buffer()));
    assert_eq!((desk.on.sent(), desk.on.de_changes()), (vec![], vec![]));
}

/// The alarm is set with each character, and the receive task is woken by the frame alone.
pub fn a_frame_is_complete_at_t1_5_and_wakes_once<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::silent(CONFIG);
    assert_eq!(desk.fetch(), None);
    desk.hear(&REQUEST);
    desk.wait(desk.intervals.to_complete - 1);
    assert_eq!(count(&desk.receiver), 0, "no task is woken for a character");
    assert_eq!(desk.fetch(), None, "before t1.5");
    desk.wait(1 + desk.sight.latency);
    assert_eq!(count(&desk.receiver), 1, "the receive task is woken");
    assert_eq!(desk.fetch(), Some(Ok(2)), "at t1.5");
    assert_eq!(desk.buffer()[..4], REQUEST);
    assert_eq!(desk.verdict(), None, "provisional");
}

/// Between t1.5 and t3.5 a character belongs to a frame that is damaged by the gap.
pub fn a_late_character_voids_a_frame_and_withholds_its_answer<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::silent(CONFIG);
    let (_, rest) = desk.character();
    desk.hear(&REQUEST);
    desk.wait(desk.intervals.to_complete);
    assert_eq!(desk.fetch(), Some(Ok(2)));
    assert_eq!(desk.verdict(), None);
    desk.release(&ANSWER);
    desk.wait(rest + 2);
    desk.hear(&[0x55]);
    assert_eq!(count(&desk.user), 1, "told at once");
    assert_eq!(desk.verdict(), Some(false));
    desk.give_back();
    desk.wait(2 * desk.intervals.t3_5);
    assert_eq!(desk.fetch(), Some(Err(ReceiveErrors::GAP)));
    assert_eq!((desk.on.sent(), desk.on.de_changes()), (vec![], vec![]));
}

/// A character is known when it is over; that it had begun at t1.5 tells the start bit alone. Edges inside of characters are none.
pub fn a_start_bit_at_t1_5_is_waited_for<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::silent(CONFIG);
    let (_, rest) = desk.character();
    desk.hear(&REQUEST[..2]);
    // From the end of the character t1.5 is `to_complete` less what was left of it.
    desk.wait(desk.intervals.to_complete - 2);
    desk.hear(&REQUEST[2..3]);
    desk.wait(rest);
    desk.hear(&REQUEST[3..]);
    desk.wait(desk.intervals.to_complete + desk.sight.latency);
    assert_eq!(desk.fetch(), Some(Ok(2)), "one frame");
    assert_eq!(desk.buffer()[..4], REQUEST);
}

/// An edge at t1.5 that no character comes of.
pub fn an_edge_that_is_no_character_delays_by_one_character<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::silent(CONFIG);
    let came = desk.hear(&REQUEST);
    desk.wait(desk.intervals.to_complete - 2);
    desk.on.falling_edge();
    desk.wait(2 + desk.intervals.character - 1);
    assert_eq!(desk.fetch(), None);
    desk.wait(1 + desk.sight.latency);
    assert_eq!(desk.fetch(), Some(Ok(2)));
    desk.release(&ANSWER);
    let t3_5 = came.wrapping_add(desk.intervals.t3_5);
    desk.on.run_until(t3_5.wrapping_add(desk.slack()));
    let sent = desk.on.sent();
    assert!(!sent.is_empty(), "the answer begins at t3.5 all the same");
    desk.is_at(sent[0].0, t3_5, "the answer");
}

/// A frame that comes while the buffer is lent is lost, and told so.
pub fn nothing_is_stored_while_the_buffer_is_lent<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::silent(CONFIG);
    desk.hear_request();
    let before = desk.buffer();
    desk.wait(desk.intervals.t3_5);
    desk.hear(&[0x12, 0x03, 0x00, 0x01, 0x00, 0x02]);
    desk.wait(desk.intervals.t3_5);
    assert_eq!(desk.buffer(), before);
    assert_eq!(desk.fetch(), Some(Err(ReceiveErrors::OVERRUN)));
    desk.give_back();
    desk.wait(desk.intervals.t3_5);
    desk.hear_request();
}

/// The first character of a frame is kept for as long as the second takes: the task has so long to give the buffer back.
pub fn the_first_character_of_a_frame_that_comes_early_is_kept<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::silent(CONFIG);
    let (_, rest) = desk.character();
    desk.hear_request();
    desk.wait(desk.intervals.t3_5);
    desk.hear(&REQUEST[..1]);
    desk.give_back();
    desk.wait(rest);
    desk.hear(&REQUEST[1..]);
    desk.wait(desk.intervals.to_complete + desk.sight.latency);
    assert_eq!(desk.fetch(), Some(Ok(2)));
    assert_eq!(desk.buffer()[..4], REQUEST);
}

/// Each kind of error by itself, and nobody sees the frame.
pub fn a_damaged_frame_is_told_with_its_errors<T: ChipUnderTest>() {
    for errors in [
        ReceiveErrors::FRAMING,
        ReceiveErrors::PARITY,
        ReceiveErrors::OVERRUN,
    ] {
        let mut desk = Desk::<T>::silent(CONFIG);
        let (_, rest) = desk.character();
        assert_eq!(desk.fetch(), None);
        desk.hear(&REQUEST[..2]);
        desk.wait(rest);
        desk.hear_one(REQUEST[2], errors);
        desk.wait(rest);
        desk.hear(&REQUEST[3..]);
        desk.wait(desk.intervals.t3_5);
        assert_eq!(count(&desk.receiver), 1);
        assert_eq!(desk.fetch(), Some(Err(errors)));
        assert_eq!(desk.fetch(), None);
        desk.hear_request();
    }
    let mut desk = Desk::<T>::silent(CONFIG);
    desk.hear(&[0x11, 0x07, 0x4C, 0x23]);
    desk.wait(desk.intervals.t3_5);
    assert_eq!(desk.fetch(), Some(Err(ReceiveErrors::CHECK)));
}

/// Of unit id 0x11 and zeros: what makes the CRC right stands at the end.
pub fn frames_of_256_bytes_fit_and_no_longer_ones<T: ChipUnderTest>() {
    let mut frame = vec![0; 254];
    frame[0] = 0x11;
    frame.extend(crc(&frame));
    let mut desk = Desk::<T>::silent(CONFIG);
    desk.hear(&frame);
    desk.wait(desk.intervals.to_complete + desk.sight.latency);
    assert_eq!(desk.fetch(), Some(Ok(254)));
    assert_eq!(desk.buffer()[..], frame);
    desk.give_back();
    desk.wait(desk.intervals.t3_5);
    let mut long = vec![0; 255];
    long[0] = 0x11;
    long.extend(crc(&long));
    desk.hear(&long);
    desk.wait(desk.intervals.t3_5);
    let told = desk.fetch();
    assert!(
        matches!(told, Some(Err(errors)) if errors.contains(ReceiveErrors::LENGTH)),
        "{told:?}"
    );
}

/// One silence completes and judges a frame then.
pub fn where_gaps_are_allowed_a_frame_ends_at_t3_5<T: ChipUnderTest>() {
    let config = LineConfig {
        inter_character: InterCharacter::Off,
        ..CONFIG
    };
    let mut desk = Desk::<T>::silent(config);
    let (_, rest) = desk.character();
    desk.hear(&REQUEST[..2]);
    desk.wait(rest + 2 * desk.intervals.character);
    let came = desk.hear(&REQUEST[2..]);
    desk.wait(desk.intervals.to_complete - 1);
    assert_eq!(desk.fetch(), None);
    desk.wait(1 + desk.sight.latency);
    assert_eq!(desk.fetch(), Some(Ok(2)));
    assert_eq!(desk.verdict(), Some(true));
    desk.release(&ANSWER);
    let t3_5 = came.wrapping_add(desk.intervals.t3_5);
    desk.on.run_until(t3_5.wrapping_add(desk.slack()));
    let sent = desk.on.sent();
    assert!(!sent.is_empty());
    desk.is_at(sent[0].0, t3_5, "the answer");
}

/// A frame that comes in is forgotten, other intervals count, and what the chip cannot do is refused.
pub fn new_settings_take_the_place_of_the_old_ones<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::silent(CONFIG);
    desk.hear(&REQUEST[..3]);
    let slower = LineConfig {
        baud: 9_600,
        format: LineFormat::F8E1,
        ..CONFIG
    };
    desk.set_up(slower).expect("the chip does this");
    desk.wait(desk.intervals.t3_5 + 2 * desk.intervals.character);
    assert_eq!(desk.fetch(), None);
    let t3_5 = desk.hear_request();
    desk.release(&ANSWER);
    desk.wait(desk.intervals.to_start + 7 * desk.intervals.character);
    let sent = desk.on.sent();
    assert_eq!(sent.len(), ANSWER.len() + 2);
    desk.is_at(sent[0].0, t3_5, "the answer");
    let took = sent[1].0.wrapping_sub(sent[0].0);
    let (whole, _) = desk.character();
    assert!(
        took.abs_diff(whole) <= whole / 40,
        "a character of {took} ticks"
    );
    let refused = |config| desk.on.chip().settings(&config).map(drop);
    let seven = LineConfig {
        format: LineFormat::F7E1,
        ..CONFIG
    };
    assert_eq!(refused(seven), Err(LineError::Format(LineFormat::F7E1)));
    let fast = LineConfig {
        baud: 10_000_000,
        ..CONFIG
    };
    let told = refused(fast);
    assert!(
        matches!(told, Err(LineError::Baud { nearest }) if nearest < 10_000_000),
        "{told:?}"
    );
}

/// `:` begins a frame and CR LF end it: it stands then, and its answer begins at t3.5.
pub fn ascii_frames_come_and_go_where_the_chip_has_them<T: ChipUnderTest>() {
    let config = LineConfig {
        framing: Framing::Ascii,
        format: LineFormat::F7E1,
        baud: 19_200,
        ..CONFIG
    };
    match T::power_up().chip().settings(&config) {
        Ok(_) => {}
        Err(LineError::Framing(Framing::Ascii)) => return,
        Err(error) => panic!("{error:?}"),
    }
    let mut desk = Desk::<T>::silent(config);
    let came = desk.hear(b":1107E8\r\n");
    assert_eq!(desk.fetch(), Some(Ok(2)));
    assert_eq!(desk.buffer()[..2], REQUEST[..2]);
    assert_eq!(desk.verdict(), Some(true));
    desk.release(&ANSWER);
    desk.wait(desk.intervals.t3_5 + 15 * desk.intervals.character);
    let sent = desk.on.sent();
    let bytes: Vec<u8> = sent.iter().map(|&(_, byte)| byte).collect();
    assert_eq!(String::from_utf8_lossy(&bytes), ":11870266\r\n");
    desk.is_at(
        sent[0].0,
        came.wrapping_add(desk.intervals.t3_5),
        "the answer",
    );
    let changes = desk.on.de_changes();
    assert!(
        matches!(changes[..], [(_, true), (_, false)]),
        "{changes:?}"
    );
}
