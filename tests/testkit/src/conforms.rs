//! The image `conformance` of a board on the bus against the plain model of its unit.

use multidrop_bus::{Format, Line, Tx};

use super::plain::Plain;
use super::plain::requests::{Requests, Step, audit};
use super::plain::shrink::minimal;
use super::plain::wire::{Character, Flaw, Way, from_ascii, from_rtu, heard, hex};
use super::random::Random;
use super::{LINE, Rig, Runner, conformance};

/// What runs the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Board {
    /// An ATmega328P in simavr.
    Nano,
    /// An STM32F405 in this runner.
    Stm32(Runner),
}

impl Board {
    fn boot(self, way: Way, line: Line) -> (Rig, Plain) {
        let image = conformance(self, way, line);
        let version = env!("CARGO_PKG_VERSION");
        let (rig, plain) = match self {
            Board::Nano => (Rig::with(&[&image], line), Plain::new("nano", version, 0)),
            Board::Stm32(runner) => (
                Rig::stm32(&image, runner, line),
                Plain::new("stm32", version, 32),
            ),
        };
        match way {
            Way::Rtu => (rig, plain),
            Way::Ascii => (rig.ascii(), plain),
        }
    }
}

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
fn run(board: Board, way: Way, line: Line, steps: &[Step]) -> Option<(usize, String)> {
    let (mut rig, mut plain) = board.boot(way, line);
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

/// Random requests and damage, with errors of characters among these; state and counters are read back every 50 steps.
fn holds(board: Board, way: Way, line: Line, errors: &[Flaw], seed: u64, requests: usize) {
    let mut random = Random::new(seed);
    let mut below = |end: u32| (random.next() % u64::from(end)) as u32;
    let mut traffic = Requests::new(&mut below, errors);
    let mut steps = Vec::new();
    for number in 1..=requests {
        steps.push(traffic.step());
        if number % 50 == 0 {
            steps.extend(audit());
        }
    }
    if let Some((number, said)) = run(board, way, line, &steps) {
        // Finding it takes long.
        eprintln!("seed {seed}, step {number}: {said}\nlooking for the least that fails");
        let fails = |steps: &[Step]| run(board, way, line, steps).map(|(_, said)| said);
        let (least, still) = minimal(&steps[..=number], fails);
        panic!("seed {seed}, step {number}: {said}\nthe least that fails: {still}\n{least:#?}");
    }
}

const FAST: Line = Line::n81(115_200);

/// RTU at 115200 8N1.
pub fn at_115200(board: Board) {
    for seed in 1..=2 {
        holds(
            board,
            Way::Rtu,
            FAST,
            &[Flaw::Gap, Flaw::Framing],
            seed,
            850,
        );
    }
}

/// RTU at 38400 8E1.
pub fn with_parity(board: Board) {
    let format = Format::E81;
    let errors = [Flaw::Gap, Flaw::Framing, Flaw::Parity];
    holds(board, Way::Rtu, Line { format, ..LINE }, &errors, 3, 300);
}

/// ASCII at 115200 7E1.
pub fn in_ascii(board: Board) {
    let format = Format::E71;
    let errors = [Flaw::Framing, Flaw::Parity];
    holds(board, Way::Ascii, Line { format, ..FAST }, &errors, 4, 300);
}
