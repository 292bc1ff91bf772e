//! How answers go out, and when.

use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::line::{Chip, LineConfig, Wire};

use super::ChipUnderTest;
use super::desk::{ANSWER, CONFIG, Desk, REQUEST, count, crc};

/// The frame is judged before t3.5, and an answer that is released begins at t3.5.
pub fn a_frame_stands_before_t3_5_and_its_answer_begins_at_t3_5<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::silent(CONFIG);
    let came = desk.hear(&REQUEST);
    desk.wait(desk.intervals.to_complete);
    assert_eq!(desk.fetch(), Some(Ok(2)));
    assert_eq!(desk.verdict(), None);
    desk.release(&ANSWER);
    desk.wait(desk.intervals.to_stand() - 1);
    assert_eq!((desk.verdict(), count(&desk.user)), (None, 0));
    desk.wait(1 + desk.sight.latency);
    assert_eq!(
        count(&desk.user),
        1,
        "the task that waits for the verdict is woken"
    );
    assert_eq!(desk.verdict(), Some(true));
    assert_eq!((desk.on.sent(), desk.on.de_changes()), (vec![], vec![]));
    desk.wait(desk.intervals.to_start + desk.slack());
    let sent = desk.on.sent();
    assert_eq!(sent.first().map(|&(_, byte)| byte), Some(ANSWER[0]));
    desk.is_at(
        sent[0].0,
        came.wrapping_add(desk.intervals.t3_5),
        "the answer",
    );
}

/// DE goes up no later than the first start bit, characters have no gap, and DE goes down within a bit of the last one's end.
pub fn de_is_up_from_the_first_character_to_the_end_of_the_last<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::silent(CONFIG);
    let t3_5 = desk.hear_request();
    desk.release(&ANSWER);
    let (whole, _) = desk.character();
    desk.wait(desk.intervals.to_start + 7 * whole);
    let (sent, changes) = (desk.on.sent(), desk.on.de_changes());
    let bytes: Vec<u8> = sent.iter().map(|&(_, byte)| byte).collect();
    assert_eq!(bytes, [&ANSWER[..], &crc(&ANSWER)].concat());
    let [(up, true), (down, false)] = changes[..] else {
        panic!("DE goes up once and down once: {changes:?}");
    };
    desk.is_at(up, t3_5, "DE");
    desk.is_at(sent[0].0, up, "the first character");
    let gaps = sent
        .windows(2)
        .map(|pair| pair[1].0.wrapping_sub(pair[0].0));
    let took: Vec<u32> = gaps.collect();
    let margin = whole / 40;
    for took in &took {
        assert!(
            took.abs_diff(whole) <= margin,
            "characters without a gap: {took}"
        );
    }
    let end = sent[4].0.wrapping_add(took[0]);
    desk.is_at(down, end, "DE down");
    assert_eq!(desk.machine(|machine, _| machine.sent()), Some(true));
}

/// What is behind an edge at t3.5 shows within a character.
pub fn a_start_bit_at_t3_5_holds_an_answer_back<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::silent(CONFIG);
    desk.hear_request();
    desk.release(&ANSWER);
    desk.wait(desk.intervals.to_start - 1);
    desk.hear(&[0x22]);
    desk.wait(desk.intervals.t3_5 * 2);
    assert_eq!((desk.on.sent(), desk.on.de_changes()), (vec![], vec![]));
    assert_eq!(desk.machine(|machine, _| machine.sent()), Some(false));
}

/// What the transmitter holds goes out: the character in flight, and at most one more.
pub fn an_answer_that_is_dropped_is_cut_off_behind_a_character<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::silent(CONFIG);
    desk.hear_request();
    let long = [0x11; 100];
    desk.release(&long);
    let (whole, _) = desk.character();
    desk.wait(desk.intervals.to_start + 5 * whole);
    let before = desk.on.sent().len();
    desk.give_back();
    desk.wait(4 * whole);
    assert!(desk.on.sent().len() <= 2, "{before} and more");
    let changes = desk.on.de_changes();
    assert!(
        matches!(changes[..], [(_, true), (_, false)]),
        "{changes:?}"
    );
    desk.wait(desk.intervals.t3_5);
    desk.hear_request();
}

/// A transceiver may hear itself; edges of that are no start bits either.
pub fn nothing_is_heard_while_it_sends<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::silent(CONFIG);
    desk.hear_request();
    desk.release(&ANSWER);
    desk.wait(desk.intervals.to_start + desk.slack());
    let (_, rest) = desk.character();
    for byte in ANSWER {
        desk.hear_one(byte, ReceiveErrors::NONE);
        desk.wait(rest);
    }
    desk.on.falling_edge();
    let (whole, _) = desk.character();
    desk.wait(3 * whole);
    let changes = desk.on.de_changes();
    assert!(
        matches!(changes[..], [(_, true), (_, false)]),
        "{changes:?}"
    );
    desk.give_back();
    assert_eq!(desk.fetch(), None);
    // From the end of the answer t3.5, and what is released then begins at once.
    desk.wait(desk.intervals.t3_5);
    desk.on.sent();
    assert!(desk.machine(|machine, _| machine.take_buffer()));
    let asked = desk.on.now();
    desk.release(&ANSWER);
    desk.wait(desk.slack());
    let sent = desk.on.sent();
    assert!(!sent.is_empty(), "no start bit was seen");
    desk.is_at(sent[0].0, asked, "a request");
}

/// The bus is let go of when all that was released, and one character more, could be out.
pub fn a_transmitter_that_stands_still_is_let_go_of<T: ChipUnderTest>() {
    if !<T::Chip as Chip>::Wire::IS_BOUNDED {
        return;
    }
    let mut desk = Desk::<T>::silent(CONFIG);
    let t3_5 = desk.hear_request();
    desk.release(&ANSWER);
    let (whole, _) = desk.character();
    desk.wait(desk.intervals.to_start + 2 * whole);
    desk.on.stop_transmitter();
    desk.wait(10 * whole);
    let changes = desk.on.de_changes();
    let [(_, true), (down, false)] = changes[..] else {
        panic!("DE goes up and down: {changes:?}");
    };
    let took = down.wrapping_sub(t3_5);
    assert!(
        (5 * whole..=6 * (whole + 1) + desk.slack()).contains(&took),
        "DE goes down {took} ticks behind t3.5; 6 characters are {}",
        6 * whole
    );
    assert!(desk.machine(|machine, _| machine.was_cut()));
    assert_eq!(desk.machine(|machine, _| machine.sent()), Some(false));
}

/// Each interval counts from the moment in which the alarm was due, not from the one in which its interrupt came.
pub fn interrupts_that_come_late_shift_no_interval<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::silent(CONFIG);
    let came = desk.hear(&REQUEST);
    let t3_5 = came.wrapping_add(desk.intervals.t3_5);
    desk.wait(desk.intervals.to_complete - 1);
    desk.on.hold_interrupts(true);
    desk.wait(desk.intervals.to_stand() / 2);
    desk.on.hold_interrupts(false);
    assert_eq!(desk.fetch(), Some(Ok(2)));
    desk.release(&ANSWER);
    let stands = came.wrapping_add(desk.intervals.to_complete + desk.intervals.to_stand());
    desk.on.run_until(stands.wrapping_sub(1));
    assert_eq!(desk.verdict(), None);
    desk.wait(1 + desk.sight.latency);
    assert_eq!(desk.verdict(), Some(true));
    desk.on.run_until(t3_5.wrapping_add(desk.slack()));
    let sent = desk.on.sent();
    assert!(!sent.is_empty());
    desk.is_at(sent[0].0, t3_5, "the answer");
}

/// Interrupts may be off for longer than an interval takes: an alarm that is set to a moment that has passed goes off at once.
pub fn an_alarm_that_is_set_too_late_goes_off_at_once<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::silent(CONFIG);
    desk.hear(&REQUEST);
    desk.wait(desk.intervals.to_complete - 1);
    desk.on.hold_interrupts(true);
    desk.wait(2 + desk.intervals.to_stand() + desk.sight.latency);
    desk.on.hold_interrupts(false);
    desk.wait(1 + desk.sight.latency);
    assert_eq!(desk.fetch(), Some(Ok(2)));
    assert_eq!(
        desk.verdict(),
        Some(true),
        "the alarm of the judgement went off"
    );
}

/// Interrupts may be off until the transmitter has run empty before the last byte: DE stays up until that one is over.
pub fn a_transmitter_that_has_run_empty_sends_the_rest<T: ChipUnderTest>() {
    let mut desk = Desk::<T>::silent(CONFIG);
    desk.hear_request();
    desk.release(&ANSWER);
    let (whole, _) = desk.character();
    desk.wait(desk.intervals.to_start + 2 * whole + whole / 2);
    desk.on.hold_interrupts(true);
    desk.wait(whole + 3 * whole / 4);
    desk.on.hold_interrupts(false);
    desk.wait(4 * whole);
    let sent = desk.on.sent();
    let bytes: Vec<u8> = sent.iter().map(|&(_, byte)| byte).collect();
    assert_eq!(bytes, [&ANSWER[..], &crc(&ANSWER)].concat());
    let changes = desk.on.de_changes();
    let [(_, true), (down, false)] = changes[..] else {
        panic!("DE goes up and down: {changes:?}");
    };
    let took = down.wrapping_sub(sent[4].0);
    let slack = desk.slack();
    assert!(
        (whole - slack..=whole + slack).contains(&took),
        "DE goes down {took} ticks after the last start bit; a character is {whole}"
    );
}

/// DE_LEAD, where the chip has it.
pub fn de_goes_up_its_lead_before_the_first_character<T: ChipUnderTest>() {
    if !<T::Chip as Chip>::Wire::HAS_DELAYS {
        return;
    }
    let mut desk = Desk::<T>::silent(LineConfig {
        de_lead_us: 1_500,
        ..CONFIG
    });
    let lead = desk.sight.tick_hz / 1_000 * 3 / 2;
    let t3_5 = desk.hear_request();
    desk.release(&ANSWER);
    let (whole, _) = desk.character();
    desk.wait(desk.intervals.to_start + lead + 7 * whole);
    let (sent, changes) = (desk.on.sent(), desk.on.de_changes());
    assert_eq!(sent.len(), ANSWER.len() + 2);
    assert_eq!(changes.len(), 2, "{changes:?}");
    desk.is_at(changes[0].0, t3_5, "DE");
    desk.is_at(
        sent[0].0,
        changes[0].0.wrapping_add(lead),
        "the first character",
    );
}

/// RESPONSE_DELAY, where the chip has it.
pub fn an_answer_waits_for_its_delay<T: ChipUnderTest>() {
    if !<T::Chip as Chip>::Wire::HAS_DELAYS {
        return;
    }
    let mut desk = Desk::<T>::silent(LineConfig {
        response_delay_ms: 40,
        ..CONFIG
    });
    let delay = desk.sight.tick_hz / 1_000 * 40;
    let t3_5 = desk.hear_request();
    desk.release(&ANSWER);
    desk.wait(desk.intervals.to_start + delay - 1);
    assert_eq!(desk.on.de_changes(), []);
    desk.wait(1 + desk.slack());
    let sent = desk.on.sent();
    assert!(!sent.is_empty());
    // The tick is rounded up for each ms.
    let late = sent[0].0.wrapping_sub(t3_5.wrapping_add(delay));
    assert!(late <= desk.slack() + 40, "the answer is {late} ticks late");
}
