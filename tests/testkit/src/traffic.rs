//! Traffic of the tests of faults: requests of every function, and reading back the data of a unit.

use multidrop_bus::Random;

use crate::frames::{block, words};
use crate::model::Model;

/// A request to `unit` that has `count` of each item: every function, mostly in order, now and then
/// to be refused.
pub fn request(random: &mut Random, unit: u8, count: u16) -> Vec<u8> {
    let below = |random: &mut Random, end: u16| random.below(u64::from(end)) as u16;
    let address = match random.below(20) {
        0 => count,
        1..=5 => 0,
        _ => below(random, count),
    };
    let room = count.saturating_sub(address).max(1);
    let function = random.below(9) as u8 + 1;
    let most = match function {
        3 | 4 => room.min(125),
        8 => room.min(123),
        _ => room,
    };
    let quantity = match random.below(3) {
        0 => most,
        _ => 1 + below(random, most),
    };
    match function {
        1..=4 => words(unit, function, address, quantity),
        5 => words(unit, 5, address, random.pick(&[0xff00, 0, 1])),
        6 => words(unit, 6, address, random.any() as u16),
        7 => {
            let bytes = bytes(random, quantity.div_ceil(8));
            block(unit, 0x0f, address, quantity, &bytes)
        }
        8 => {
            let bytes = bytes(random, 2 * quantity);
            block(unit, 0x10, address, quantity, &bytes)
        }
        _ => words(unit, 0x63, address, 0),
    }
}

fn bytes(random: &mut Random, count: u16) -> Vec<u8> {
    (0..count).map(|_| random.any() as u8).collect()
}

/// The requests that read everything of a unit with `count` of each item and what `model` answers.
pub fn everything(model: &Model, unit: u8, count: u16) -> Vec<(Vec<u8>, Vec<u8>)> {
    let mut model = model.clone();
    let mut reads = vec![words(unit, 1, 0, count)];
    let firsts = (0..count).step_by(125);
    reads.extend(firsts.map(|first| words(unit, 3, first, (count - first).min(125))));
    let answered = |read: Vec<u8>| {
        let answer = model.answer(&read);
        (read, answer)
    };
    reads.into_iter().map(answered).collect()
}
