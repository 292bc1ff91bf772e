//! Delayed interrupts of the Nano, with the HAL's example `held_off`: lost characters are counted, and everything
//! else is in time.

use multidrop_bus::{Answer, Line, Nano, NodeId, Pin, Time, Tx};
use multidrop_testkit::frames::{adu, data, words};
use multidrop_testkit::{LINE, Rig, example_at};

/// The unit id of the example.
const UNIT: u8 = 17;

/// From D3 going low until interrupts are off, at most, if nothing else is to be done.
const AHEAD: Time = Time::from_us(24);

/// Index of USART_TX among the vectors.
const SENT: usize = 20;

fn rig(line: Line) -> Rig {
    let nano = Nano::new("held_off", example_at("held_off", line.baud));
    let mut rig = Rig::nano(nano, line);
    let node = rig.node();
    rig.bus.node_mut(node).set_input(Pin::D3, Some(true));
    rig
}

/// Interrupts are off from `from` or a little before until `to`, which have not come yet.
fn hold(rig: &mut Rig, from: Time, to: Time) {
    let node: NodeId = rig.node();
    let node = rig.bus.node_mut(node);
    for (level, time) in [(false, from - AHEAD), (true, to)] {
        let cycle = node.clock().tick_at_or_after(time);
        node.set_input_at(Pin::D3, level, cycle);
    }
}

/// A read that is always answered with [`alive`].
fn request() -> Vec<u8> {
    words(UNIT, 4, 2, 1)
}

fn alive() -> Vec<u8> {
    data(UNIT, 4, &[0x10, 0x02])
}

/// `tenths` of a character.
fn tenths(line: Line, tenths: u64) -> Time {
    line.character() * tenths / 10
}

/// A counter of FC 08.
fn counter(rig: &mut Rig, sub: u8) -> u16 {
    let answer = rig.ask(&adu(&[UNIT, 8, 0, sub, 0, 0]));
    assert_eq!(answer.len(), 8, "{answer:02x?}");
    u16::from_be_bytes([answer[4], answer[5]])
}

const BUS_ERRORS: u8 = 0x0C;
const OVERRUNS: u8 = 0x12;

/// The events of FC 0C, the newest first; its own is not among them.
fn events(rig: &mut Rig) -> Vec<u8> {
    let answer = rig.ask(&adu(&[UNIT, 0x0C]));
    assert_eq!(answer[9], 0x80, "{answer:02x?}");
    answer[10..answer.len() - 2].to_vec()
}

/// Asks, with interrupts off meanwhile: from and to so many tenths of a character after the first start bit.
fn ask_held(rig: &mut Rig, from: u64, to: u64) -> Vec<u8> {
    rig.pause(Time::from_ms(5));
    let line = rig.line;
    // Time for the pin before the first character.
    let pause = AHEAD * 2;
    let start = rig.bus.now() + pause;
    hold(rig, start + tenths(line, from), start + tenths(line, to));
    rig.ask_each(with_pause(request(), 0, pause))
}

#[test]
fn a_character_that_is_lost_is_counted_once_for_its_frame() {
    for line in [LINE, Line::n81(115_200)] {
        let mut rig = rig(line);
        let mut overruns = 0;
        // Two characters wait in the FIFO and one in the shift register; the start bit of a fourth is one too many, with its
        // sample 10 of 16.
        for (from, to, lost) in [
            (27, 39, false),
            (27, 49, false),
            (27, 53, true),
            (27, 63, true),
            (7, 29, false),
            (7, 33, true),
            (47, 69, false),
            (47, 73, true),
            (7, 79, true),
        ] {
            let heard = ask_held(&mut rig, from, to);
            let what = format!("interrupts off from {from} to {to} tenths at {}", line.baud);
            assert_eq!(heard, if lost { vec![] } else { alive() }, "{what}");
            rig.expect(&request(), &alive());
            overruns += u16::from(lost);
            assert_eq!(counter(&mut rig, OVERRUNS), overruns, "{what}");
            assert_eq!(counter(&mut rig, BUS_ERRORS), overruns, "{what}");
            // Two counters were asked for, and the request; each is received and answered.
            let event = events(&mut rig)[6];
            assert_eq!(event, if lost { 0x92 } else { 0x40 }, "{what}");
        }
        rig.expect(
            &adu(&[UNIT, 8, 0, 0x14, 0, 0]),
            &adu(&[UNIT, 8, 0, 0x14, 0, 0]),
        );
        assert_eq!(counter(&mut rig, OVERRUNS), 0);
    }
}

/// Asks, with interrupts off from and to these times after the request's end.
fn answer_held(rig: &mut Rig, from: Time, to: Time) -> Option<Answer> {
    rig.pause(Time::from_ms(5));
    let end = rig.bus.host(rig.host).send(&request());
    hold(rig, end + from, end + to);
    rig.bus.run_to(end);
    let mut answer = rig.exchange(&[])?;
    answer.request_end = end;
    Some(answer)
}

#[test]
fn an_alarm_that_waits_moves_no_other() {
    for line in [LINE, Line::n81(9_600), Line::n81(115_200)] {
        let mut rig = rig(line);
        let (t1_5, t3_5, margin) = (line.t15(), line.t35(), line.t35() / 24);
        let (before, character) = (Time::from_us(60), line.character());
        for (from, to) in [
            // The end of t1.5; also for longer than a character.
            (t1_5 - before, t1_5 + before),
            (t1_5 - before, t1_5 + character),
            (t1_5 - before, t1_5 + Time::from_us(500)),
            // The judgement.
            (t3_5 - margin - before, t3_5 - margin + Time::from_us(30)),
        ] {
            let answer = answer_held(&mut rig, from, to).expect("an answer");
            assert_eq!(answer.bytes, alive());
            let beyond = answer.turnaround() - t3_5;
            let what = format!("interrupts off from {from} to {to} at {}", line.baud);
            assert!(beyond < LINE.bits(1), "{beyond}: {what}");
        }
    }
}

#[test]
fn alarms_that_have_passed_are_handled_when_interrupts_are_on_again() {
    for line in [LINE, Line::n81(9_600), Line::n81(115_200)] {
        let mut rig = rig(line);
        let (t1_5, t3_5) = (line.t15(), line.t35());
        let before = Time::from_us(60);
        // An answer that is worked out waits for nothing; else it is worked out first.
        let (soon, later) = (Time::from_us(60), Time::from_us(700));
        for (from, late, within) in [
            (t3_5 - before, Time::from_us(60), soon),
            (t3_5 - before, Time::from_ms(5), soon),
            (t3_5 - t3_5 / 24 - before, Time::from_ms(1), soon),
            (t1_5 - before, Time::from_ms(1), later),
            (t1_5 - before, Time::from_ms(30), later),
        ] {
            rig.slack = late + Time::from_ms(3);
            let to = t3_5 + late;
            let what = format!("interrupts off from {from} to {to} at {}", line.baud);
            let answer = answer_held(&mut rig, from, to).expect(&what);
            assert_eq!(answer.bytes, alive(), "{what}");
            let after = answer.turnaround() - to;
            assert!(after < within, "{after}: {what}");
        }
    }
}

/// Characters with this pause before one of them.
fn with_pause(bytes: Vec<u8>, place: usize, pause: Time) -> impl Iterator<Item = Tx> {
    let pause = move |at| if at == place { pause } else { Time::ZERO };
    let characters = bytes.into_iter().enumerate();
    characters.map(move |(at, byte)| Tx::byte(byte).after(pause(at)))
}

/// Sends characters with this pause before one of them, and interrupts off from shortly before an alarm in it until so long after
/// that one's end.
fn ask_past(
    rig: &mut Rig,
    bytes: Vec<u8>,
    (place, pause): (usize, Time),
    alarm: Time,
    late: Time,
) -> Vec<u8> {
    rig.pause(Time::from_ms(5));
    let silence = rig.bus.now() + rig.line.character() * place as u64;
    let from = silence + alarm - Time::from_us(30);
    let to = silence + pause + rig.line.character() + late;
    hold(rig, from, to);
    rig.ask_each(with_pause(bytes, place, pause))
}

/// Parts of a character, while the FIFO has room.
fn parts(line: Line) -> impl Iterator<Item = Time> {
    (0..45).map(move |part| line.character() * part / 30)
}

#[test]
fn a_character_that_waits_beside_an_alarm_is_handled_first() {
    for line in [LINE, Line::n81(9_600), Line::n81(115_200)] {
        let mut rig = rig(line);
        let (t1_5, t3_5) = (line.t15(), line.t35());
        for late in parts(line) {
            let what = format!("interrupts off for {late} longer at {}", line.baud);
            let allowed = (4, t1_5 * 9 / 10);
            let heard = ask_past(&mut rig, request(), allowed, t1_5, late);
            assert_eq!(heard, alive(), "{what}");
            let too_long = (4, t3_5 * 9 / 10);
            let heard = ask_past(&mut rig, request(), too_long, t3_5 * 23 / 24, late);
            assert_eq!(heard, [], "{what}");
        }
    }
}

#[test]
fn an_answer_does_not_go_over_a_character_that_waits() {
    let two = [words(UNIT, 4, 3, 1), request()].concat();
    for line in [LINE, Line::n81(9_600), Line::n81(115_200)] {
        let mut rig = rig(line);
        let t3_5 = line.t35();
        for late in parts(line) {
            // It begins a frame. Where the answer that is withheld still has the buffer when the next one comes, that is lost.
            let begins = (8, t3_5 * 98 / 100);
            let heard = ask_past(&mut rig, two.clone(), begins, t3_5, late);
            let is_soon = late < line.character() / 2 && line.baud <= 38_400;
            let what = format!("interrupts off for {late} longer at {}", line.baud);
            assert!(
                heard == alive() || heard.is_empty() && !is_soon,
                "{what}: {heard:02x?}"
            );
        }
    }
}

/// Interrupts are held off until the alarm that follows an overdue one is just due as well. The character that came meanwhile is
/// looked at before that alarm.
#[test]
fn an_alarm_that_is_just_due_waits_for_a_character() {
    let two = [words(UNIT, 4, 3, 1), request()].concat();
    let line = Line::n81(115_200);
    let mut rig = rig(line);
    let t3_5 = line.t35();
    let begins = (8, t3_5 * 98 / 100);
    // The alarm is due a character after t3.5. The timer counts in ticks of half a microsecond.
    let heard: Vec<_> = (0..80)
        .map(|tick| {
            ask_past(
                &mut rig,
                two.clone(),
                begins,
                t3_5,
                Time::from_ns(500) * tick,
            )
        })
        .collect();
    // Behind some moment the buffer is free too late for the request. There is no gap before.
    let answered = heard.iter().take_while(|heard| **heard == alive()).count();
    assert!(answered > 50, "{heard:02x?}");
    let none = heard[answered..].iter().all(Vec::is_empty);
    assert!(none, "an answer behind none: {heard:02x?}");
}

/// Asks, with interrupts off from and to so many tenths of a character after the answer's first start bit. Gives when DE went up and
/// down, and the answer.
fn answer_held_in(rig: &mut Rig, from: u64, to: u64) -> (Time, Time, Answer) {
    rig.pause(Time::from_ms(5));
    let line = rig.line;
    let end = rig.bus.host(rig.host).send(&request());
    let start = end + line.t35();
    hold(rig, start + tenths(line, from), start + tenths(line, to));
    let answer = rig.bus.transact(rig.host, &[], Time::from_ms(20));
    let answer = answer.expect("an answer");
    rig.bus.run_for(Time::from_ms(5));
    let edges = rig.bus.record().de_edges();
    assert_eq!(edges.len(), 2, "{from} to {to} tenths: {edges:?}");
    let (up, down) = (edges[0].time, edges[1].time);
    let node = rig.node();
    let sent = rig.bus.record().sent_by(node.into());
    assert!(
        sent.last().is_some_and(|last| last.end <= down),
        "{from} to {to} tenths"
    );
    rig.bus.clear_record();
    (up, down, answer)
}

#[test]
fn a_transmitter_that_runs_dry_ends_no_answer() {
    let mut rig = rig(LINE);
    for place in 2..alive().len() as u64 {
        // The character at this place is to be given when the one before begins, and is when that is over.
        let (from, to) = (10 * place - 16, 10 * place + 4);
        let (_, down, answer) = answer_held_in(&mut rig, from, to);
        assert_eq!(answer.bytes, alive(), "character {place}");
        assert!(answer.is_clean(), "{answer:?}");
        let lag = down - answer.end;
        assert!(lag < Time::from_us(10), "{lag}: character {place}");
    }
}

#[test]
fn what_is_left_of_a_transmission_ends_no_other() {
    let mut rig = rig(LINE);
    for _ in 0..3 {
        // The answer is out, and what bounds its time is past too, before either is seen to.
        let (_, _, answer) = answer_held_in(&mut rig, 65, 95);
        assert_eq!(answer.bytes, alive());
        rig.pause(Time::from_ms(5));
        let node = rig.node();
        rig.bus.node_mut(node).clear_stats();
        rig.expect(&request(), &alive());
        let stats = rig.bus.node(node).stats();
        assert_eq!(stats.vectors[SENT].count, 1);
    }
}
