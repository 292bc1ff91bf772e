//! What the tests of routes to units on RS4 share.
#![allow(dead_code, reason = "each test binary uses a part")]
use multidrop_bus::Time;
use multidrop_testkit::four::units::{Played, Reply, Told};
use multidrop_testkit::four::{RS4, setting};
use multidrop_testkit::plain::wire::Way;
use multidrop_testkit::{Runner, ports};

/// What a unit that is up to date takes.
pub const FAST: Time = Time::from_ms(3);

/// Where what is routed is asked for; the scan list asks for register 0.
pub const ROUTED: u16 = 100;

/// AS1's unit, and AS2's.
pub const OWN: [u8; 2] = [10, 1];

pub fn played<'a>(runner: Runner, script: impl FnMut(&[u8]) -> Vec<Reply> + 'a) -> Played<'a> {
    Played::new(&ports(runner), runner.emulator(), script).expect("a valid image")
}

pub fn body(unit: u8, function: u8, first: u16, second: u16) -> Vec<u8> {
    let words = [first.to_be_bytes(), second.to_be_bytes()];
    [&[unit, function], words.as_flattened()].concat()
}

/// FC 03 of `count` registers from `first`.
pub fn read(unit: u8, first: u16, count: u16) -> Vec<u8> {
    body(unit, 3, first, count)
}

/// What a unit answers: a write of a register as it came, a read with bytes made of its id, the address and `mark`.
pub fn values(request: &[u8], mark: u8) -> Vec<u8> {
    if request[1] == 6 {
        return request.to_vec();
    }
    let [unit, function, _, first, _, count] = *request else {
        panic!("{request:02x?} is no read");
    };
    let mut answer = vec![unit, function, 2 * count];
    answer.extend((0..2 * count).map(|place| unit.wrapping_mul(31) ^ first ^ place ^ mark));
    answer
}

pub fn first(request: &[u8]) -> u16 {
    u16::from_be_bytes([request[2], request[3]])
}

/// The exception that a request is answered with.
pub fn exception(request: &[u8], code: u8) -> Vec<u8> {
    vec![request[0], request[1] | 0x80, code]
}

/// A reply at once.
pub fn at_once(body: Vec<u8>) -> Vec<Reply> {
    vec![(FAST, body)]
}

#[track_caller]
pub fn expect(played: &mut Played, way: Way, request: &[u8], answer: &[u8]) -> Told {
    let told = played.ask(way, request);
    assert_eq!(told.body, answer, "{request:02x?}");
    told
}

/// Of each unit: good answers to polls, and other ends of them.
pub fn health(played: &mut Played) -> ([u16; 3], [u16; 3]) {
    let told = played.ask(Way::Rtu, &body(10, 4, 3, 6)).body;
    assert_eq!(told[..3], [10, 4, 12]);
    let word = |place: usize| u16::from_be_bytes([told[3 + 2 * place], told[4 + 2 * place]]);
    ([0, 1, 2].map(word), [3, 4, 5].map(word))
}

/// Registers of RS4: their numbers.
pub const SLAVEID: u16 = 5;
pub const STATUS: u16 = 11;
pub const START: u16 = 27;

/// Loads a register of RS4; whether it took the value.
pub fn load(played: &mut Played, number: u16, value: u32) -> bool {
    let mut request = body(OWN[0], 16, setting(RS4, number), 2);
    let answer = request.clone();
    request.push(4);
    request.extend(value.to_be_bytes());
    played.ask(Way::Rtu, &request).body == answer
}
