//! DE_LEAD and RESPONSE_DELAY on both boards: an answer starts at the end of the delay after t3.5, and DE goes up
//! before it by its lead.

use multidrop_bus::{Time, Tx};
use multidrop_testkit::frames::adu;
use multidrop_testkit::{LINE, Rig, Runner, example, stm32_example};

/// What the examples `delays` send back.
const FRAME: [u8; 3] = [7, 1, 2];

/// How late DE may be: a bit, as an answer without any delay may.
const LATE: Time = Time::from_us(27);

/// Has the line set up with these.
fn set_up(rig: &mut Rig, lead_us: u16, delay_ms: u16) {
    let mut frame = vec![7, 0x42];
    frame.extend(lead_us.to_be_bytes());
    frame.extend(delay_ms.to_be_bytes());
    let patience = Time::from_ms(100) + Time::from_ms(2 * u64::from(delay_ms));
    let greeting = rig.bus.transact(rig.host, &adu(&frame), patience);
    assert_eq!(greeting.expect("a greeting").bytes, adu(b"here again"));
    rig.bus.run_for(Time::from_ms(20));
    rig.bus.clear_record();
}

fn answers_wait_as_long_as_they_are_to(mut rig: Rig) {
    for (lead_us, delay_ms) in [
        (0, 0),
        (500, 0),
        (0, 40),
        (250, 7),
        (10_000, 0),
        (0, 1_000),
        (0, 0),
    ] {
        set_up(&mut rig, lead_us, delay_ms);
        let what = format!("DE_LEAD {lead_us}, RESPONSE_DELAY {delay_ms}");
        for _ in 0..3 {
            rig.bus.clear_record();
            let request = adu(&FRAME);
            let patience = Time::from_ms(30) + Time::from_ms(delay_ms.into());
            let answer = rig.bus.transact(rig.host, &request, patience).expect(&what);
            assert_eq!(answer.bytes, request, "{what}");
            rig.bus.run_for(Time::from_ms(5));
            let edges = rig.bus.record().de_edges();
            assert_eq!(edges.len(), 2, "{what}: {edges:?}");
            let due = answer.request_end + rig.line.t35() + Time::from_ms(delay_ms.into());
            let (up, start) = (edges[0].time, answer.received[0].start);
            assert!(
                up >= due && up - due < LATE,
                "{what}: DE at {up}, not {due}"
            );
            let lead = start - up;
            let wanted = Time::from_us(lead_us.into());
            assert!(lead >= wanted && lead - wanted < LATE, "{what}: {lead}");
            let last = answer.received[answer.received.len() - 1].end;
            let lag = edges[1].time - last;
            assert!(lag < Time::from_us(10), "{what}: {lag}");
        }
    }
}

fn who_talks_while_an_answer_waits_gets_the_next_one_only(mut rig: Rig) {
    set_up(&mut rig, 300, 40);
    let (first, second) = (adu(&[7, 1, 1]), adu(&[7, 1, 2]));
    let characters = first.iter().chain(&second).enumerate().map(|(at, &byte)| {
        let pause = if at == first.len() { 20_000 } else { 0 };
        Tx::byte(byte).after(Time::from_us(pause))
    });
    let characters: Vec<_> = characters.collect();
    let end = rig.bus.host(rig.host).send_each(characters);
    rig.bus.run_to(end);
    let answer = rig.bus.transact(rig.host, &[], Time::from_ms(100));
    assert_eq!(answer.expect("an answer").bytes, second);
    rig.bus.run_for(Time::from_ms(100));
    assert_eq!(rig.bus.record().de_edges().len(), 2);
    assert_eq!(rig.bus.record().conflicts(), []);
}

fn nano() -> Rig {
    Rig::with(&[&example("delays")], LINE)
}

fn stm32(runner: Runner) -> Rig {
    let image = stm32_example(runner, "delays", LINE.baud);
    Rig::stm32(&image, runner, LINE)
}

#[test]
fn nano_answers_wait_for_de_lead_and_response_delay() {
    answers_wait_as_long_as_they_are_to(nano());
}

#[test]
fn stm32_in_qemu_answers_wait_for_de_lead_and_response_delay() {
    answers_wait_as_long_as_they_are_to(stm32(Runner::Qemu));
}

#[test]
fn stm32_as_flashed_answers_wait_for_de_lead_and_response_delay() {
    answers_wait_as_long_as_they_are_to(stm32(Runner::Core));
}

#[test]
fn nano_a_request_while_an_answer_waits_replaces_that_answer() {
    who_talks_while_an_answer_waits_gets_the_next_one_only(nano());
}

#[test]
fn stm32_in_qemu_a_request_while_an_answer_waits_replaces_that_answer() {
    who_talks_while_an_answer_waits_gets_the_next_one_only(stm32(Runner::Qemu));
}

#[test]
fn stm32_as_flashed_a_request_while_an_answer_waits_replaces_that_answer() {
    who_talks_while_an_answer_waits_gets_the_next_one_only(stm32(Runner::Core));
}
