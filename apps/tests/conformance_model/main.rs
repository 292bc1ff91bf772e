//! The server over the conformance map against a plain model of it: random requests of all functions and damaged
//! frames. After each of them, answers, tables, counters and log must be equal.
//!
//! The model and the traffic are those of the tests on the simulated bus, and share nothing with the code under test.

mod rich;

use std::collections::BTreeSet;

use multidrop::protocol::Adu;
use multidrop::protocol::data::{CoilsOut, RegistersOut};
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::rtu::Reception;
use multidrop::protocol::server::{Counted, DataModel, Server};
use multidrop_apps::conformance::{Conformance, EVENTS};

use multidrop_testkit::plain::requests::{Requests, Step, audit};
use multidrop_testkit::plain::shrink::minimal;
use multidrop_testkit::plain::wire::{Character, Flaw, Way, heard};
use multidrop_testkit::plain::{Plain, UNIT};
use rich::Rich;

/// All ways in which a line can find a character wrong.
const FLAWS: [Flaw; 4] = [Flaw::Gap, Flaw::Parity, Flaw::Framing, Flaw::Overrun];

/// Random numbers from a seed (splitmix64).
fn random(seed: u64) -> impl FnMut(u32) -> u32 {
    let mut state = seed;
    move |end| {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) % u64::from(end)) as u32
    }
}

/// The server with what a port puts around it.
struct Unit<M> {
    server: Server<Counted<EVENTS>>,
    map: M,
    adu: Adu,
}

impl<M: DataModel> Unit<M> {
    fn new(map: M) -> Self {
        Unit {
            server: Server::counted(UNIT),
            map,
            // What a request leaves behind must not show.
            adu: [0xa5; 256],
        }
    }

    /// What a port does with what comes in between two silences of t3.5.
    fn hears(&mut self, characters: &[Character]) -> Option<Vec<u8>> {
        if let Some(at) = characters.iter().position(|one| one.flaw == Flaw::Gap) {
            // At t1.5 it may have looked like a frame.
            if let Some(len) = self.receive(&characters[..at]).ok()
                && self.server.is_concerned(self.adu[0])
            {
                self.server.prepare(&mut self.map, &mut self.adu, len);
            }
        }
        let len = match self.receive(characters) {
            Ok(len) => len,
            Err(errors) => {
                self.server.damaged(errors);
                return None;
            }
        };
        if !self.server.is_concerned(self.adu[0]) {
            return None;
        }
        let plan = self.server.prepare(&mut self.map, &mut self.adu, len);
        let early = plan.answer_at_once::<M>();
        let early = self.adu[..early.into()].to_vec();
        let answered = self.server.commit(&mut self.map, &mut self.adu, len, plan);
        let answer = &self.adu[..answered.into()];
        assert!(early.is_empty() || early == answer, "it was on its way");
        (answered > 0).then(|| answer.to_vec())
    }

    fn receive(&mut self, characters: &[Character]) -> Result<u8, ReceiveErrors> {
        let mut reception = Reception::new();
        for character in characters {
            reception.add(match character.flaw {
                Flaw::None => ReceiveErrors::NONE,
                Flaw::Gap => ReceiveErrors::GAP,
                Flaw::Parity => ReceiveErrors::PARITY,
                Flaw::Framing => ReceiveErrors::FRAMING,
                Flaw::Overrun => ReceiveErrors::OVERRUN,
            });
            reception.push(&mut self.adu, character.value);
        }
        let heard = reception.finish();
        match heard.errors.is_empty() {
            true => Ok(heard.len),
            false => Err(heard.errors),
        }
    }

    /// What is different in the tables.
    fn differs(&mut self, plain: &Plain) -> Option<String> {
        let mut words = Vec::new();
        for (first, count) in [(0, 125), (125, 3)] {
            let mut bytes = [0; 250];
            let bytes = &mut bytes[..2 * count];
            let read = self.map.holding_registers(first, RegistersOut::new(bytes));
            read.expect("they exist");
            words.extend(
                bytes
                    .chunks(2)
                    .map(|pair| u16::from_be_bytes([pair[0], pair[1]])),
            );
        }
        if let Some(at) = (0..128).find(|&at| words[at] != plain.tables.holding[at]) {
            let (is, must) = (words[at], plain.tables.holding[at]);
            return Some(format!(
                "holding register {at} is {is:#x}, must be {must:#x}"
            ));
        }
        for (first, count) in [(0, 128), (1000, 2000)] {
            let mut bytes = vec![0; usize::from(count).div_ceil(8)];
            let read = self.map.coils(first, CoilsOut::new(&mut bytes, count));
            read.expect("they exist");
            let is = |n: usize| bytes[n / 8] >> (n % 8) & 1 == 1;
            let must = &plain.tables.coils[first.into()..][..count.into()];
            if let Some(at) = (0..must.len()).find(|&at| is(at) != must[at]) {
                let address = usize::from(first) + at;
                return Some(format!(
                    "coil {address} is {}, must be {}",
                    is(at),
                    must[at]
                ));
            }
        }
        let mut bytes = vec![0; 2 * plain.records.len()];
        if !bytes.is_empty() {
            let read = self.map.file_records(4, 0, RegistersOut::new(&mut bytes));
            read.expect("they exist");
        }
        let is = bytes
            .chunks(2)
            .map(|pair| u16::from_be_bytes([pair[0], pair[1]]));
        let at = is.zip(&plain.records).position(|(is, &must)| is != must);
        at.map(|record| format!("record {record} differs"))
    }
}

/// A unit and the model of it, as they are at boot.
type Pair<M> = fn() -> (M, Plain);

fn without_files() -> (Conformance<0>, Plain) {
    let plain = Plain::new("nano", env!("CARGO_PKG_VERSION"), 0);
    (Conformance::new("nano"), plain)
}

fn with_files() -> (Conformance<32>, Plain) {
    let plain = Plain::new("stm32", env!("CARGO_PKG_VERSION"), 32);
    (Conformance::new("stm32"), plain)
}

fn with_extras() -> (Rich, Plain) {
    let (map, plain) = with_files();
    (Rich(map), plain.with_extras())
}

/// Goes through `steps` from boot; what differs first.
fn run<M: DataModel>(at_boot: Pair<M>, steps: &[Step]) -> Option<(usize, String)> {
    let (map, mut plain) = at_boot();
    let mut unit = Unit::new(map);
    for (number, step) in steps.iter().enumerate() {
        let characters = step.characters(Way::Rtu, plain.delimiter);
        let must = plain.hears(&heard(Way::Rtu, plain.delimiter, &characters));
        let is = unit.hears(&characters);
        if is != must {
            return Some((number, step.answered(is, must)));
        }
        if let Some(differs) = unit.differs(&plain) {
            return Some((number, format!("{step:?}: {differs}")));
        }
    }
    None
}

/// Random traffic, and now and then everything read back.
fn traffic(seed: u64, requests: usize) -> Vec<Step> {
    let mut below = random(seed);
    let mut random = Requests::new(&mut below, &FLAWS);
    let mut steps = Vec::new();
    for number in 0..requests {
        steps.push(random.step());
        if number % 100 == 99 {
            steps.extend(audit());
        }
    }
    steps
}

fn holds<M: DataModel>(at_boot: Pair<M>, seeds: std::ops::Range<u64>, requests: usize) {
    for seed in seeds {
        let steps = traffic(seed, requests);
        if let Some((number, said)) = run(at_boot, &steps) {
            let fails = |steps: &[Step]| run(at_boot, steps).map(|(_, said)| said);
            let (least, still) = minimal(&steps[..=number], fails);
            panic!("seed {seed}, step {number}: {said}\nthe least that fails: {still}\n{least:#?}");
        }
    }
}

#[test]
fn random_requests_without_files() {
    holds(without_files, 0..10, 5_000);
}

#[test]
fn random_requests_with_files() {
    holds(with_files, 10..20, 5_000);
}

#[test]
fn random_requests_that_reach_every_limit_and_every_exception() {
    holds(with_extras, 20..24, 5_000);
}

/// What each function comes to: its code, and 0 for an answer or the exception.
#[test]
fn the_traffic_reaches_every_answer_and_every_refusal() {
    let mut seen = BTreeSet::new();
    let mut listened = 0;
    let steps = traffic(1, 5_000);
    let (_, mut plain) = with_extras();
    for step in &steps {
        let characters = step.characters(Way::Rtu, plain.delimiter);
        listened += usize::from(plain.listening_only);
        if let Some(answer) = plain.hears(&heard(Way::Rtu, plain.delimiter, &characters)) {
            let refused = answer[1] & 0x80 != 0;
            seen.insert((answer[1] & 0x7f, if refused { answer[2] } else { 0 }));
        }
    }
    let outcomes = |function: u8| -> &[u8] {
        match function {
            1..=5 | 0x0f | 0x14 | 0x15 | 0x18 => &[0, 2, 3],
            6 | 0x10 | 0x16 | 0x17 => &[0, 2, 3, 7],
            8 => &[0, 1, 3],
            0x2b => &[0, 1, 2, 3],
            7 | 0x0b | 0x0c | 0x11 => &[0, 3],
            0x41 => &[0],
            0x44 => &[0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 11],
            _ => &[1],
        }
    };
    let functions = (1..=8).chain([0x0b, 0x0c]).chain(0x0f..=0x11);
    for function in functions.chain(0x14..=0x18).chain([0x2b, 0x41, 0x42, 0x44]) {
        for outcome in outcomes(function) {
            let is_seen = seen.contains(&(function, *outcome));
            assert!(is_seen, "function {function:02X} never came to {outcome}");
        }
    }
    let part = steps.len() / listened.max(1);
    assert!((4..50).contains(&part), "listens only in one of {part}");
}
