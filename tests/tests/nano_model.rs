//! The image `conformance` in the simulator against the plain model of its unit: random requests of all functions and damaged
//! frames on the wire, and each time the same answer. All tables, counters and the log are read back again and again.

mod common;

use common::plain::Plain;
use common::plain::requests::{Requests, Step, audit};
use common::plain::shrink::minimal;
use common::plain::wire::{Character, Flaw, Way, from_ascii, from_rtu, heard, hex};
use common::random::Random;
use common::{LINE, Rig, conformance};
use multidrop_bus::{Format, Line, Time, Tx};

/// What is on the wire of a character that is wrong in this way.
fn sent(character: &Character, line: Line) -> Tx {
    let sound = Tx::byte(character.value);
    match character.flaw {
        Flaw::None => sound,
        Flaw::Gap => sound.after((line.t15() + line.t35()) / 2),
        Flaw::Parity => sound.bad_parity(),
        Flaw::Framing => sound.bad_stop(),
        Flaw::Overrun => unreachable!("nothing on the wire makes an overrun"),
    }
}

/// Goes through `steps` from boot; which answer is not as it must be, and how.
fn run(way: Way, line: Line, steps: &[Step]) -> Option<(usize, String)> {
    let mut rig = Rig::with(&[&conformance(way, line)], line);
    // 2000 discrete inputs are worked out one by one, which takes 11 ms.
    rig.slack = Time::from_ms(15);
    let mut plain = Plain::new("nano", env!("CARGO_PKG_VERSION"), 0);
    for (number, step) in steps.iter().enumerate() {
        let delimiter = plain.delimiter;
        let characters = step.characters(way, delimiter);
        let must = plain.hears(&heard(way, delimiter, &characters));
        let bytes = rig.ask_each(characters.iter().map(|one| sent(one, line)));
        let is = match way {
            Way::Rtu => from_rtu(&bytes),
            Way::Ascii => from_ascii(&bytes, delimiter),
        };
        if is.is_none() && !bytes.is_empty() {
            return Some((number, format!("{step:?}: no frame: {}", hex(&bytes))));
        }
        if is != must {
            return Some((number, step.answered(is, must)));
        }
    }
    None
}

fn holds(way: Way, line: Line, flaws: &[Flaw], seed: u64, requests: usize) {
    let mut random = Random::new(seed);
    let mut below = |end: u32| (random.next() % u64::from(end)) as u32;
    let mut traffic = Requests::new(&mut below, flaws);
    let mut steps = Vec::new();
    for number in 1..=requests {
        steps.push(traffic.step());
        if number % 50 == 0 {
            steps.extend(audit());
        }
    }
    if let Some((number, said)) = run(way, line, &steps) {
        let fails = |steps: &[Step]| run(way, line, steps).map(|(_, said)| said);
        let (least, still) = minimal(&steps[..=number], fails);
        panic!("seed {seed}, step {number}: {said}\nthe least that fails: {still}\n{least:#?}");
    }
}

const FAST: Line = Line::n81(115_200);

#[test]
fn random_requests_at_115200() {
    for seed in 1..=2 {
        holds(Way::Rtu, FAST, &[Flaw::Gap, Flaw::Framing], seed, 850);
    }
}

#[test]
fn random_requests_with_parity() {
    let line = Line {
        format: Format::E81,
        ..LINE
    };
    let flaws = [Flaw::Gap, Flaw::Framing, Flaw::Parity];
    holds(Way::Rtu, line, &flaws, 3, 300);
}

#[test]
fn random_requests_in_ascii() {
    let line = Line {
        format: Format::E71,
        ..FAST
    };
    holds(Way::Ascii, line, &[Flaw::Framing, Flaw::Parity], 4, 300);
}
