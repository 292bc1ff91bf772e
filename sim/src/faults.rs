//! Things that go wrong on a bus, drawn by a seed, so that a failure is replayed by its number.
//!
//! ```no_run
//! # use multidrop_bus::{Bus, Campaign, HostId, Line, NodeId};
//! # fn example(a_bus: fn() -> (Bus, HostId, HostId, Vec<NodeId>)) {
//! let line = Line::n81(38_400);
//! Campaign::each(0..300, |mut campaign| {
//!     let (mut bus, client, neighbour, nodes) = a_bus();
//!     let request = [0x01, 0x03, 0x00, 0x00, 0x00, 0x01, 0x84, 0x0a];
//!     let fault = campaign.draw(line, &request, &nodes);
//!     let heard = fault.strike(&mut bus, client, neighbour, &request);
//!     // Hold what was heard, the record and what the nodes hold now against what should be.
//! });
//! # }
//! ```

use std::ops::Range;

use crate::bus::Bus;
use crate::host::{RxByte, Tx};
use crate::line::{Line, Parity};
use crate::record::{HostId, NodeId};
use crate::time::Time;

/// The environment variable that names the one seed to run.
const REPLAY: &str = "BUS_SEED";

/// A generator that gives the same numbers everywhere: splitmix64 (Steele, Lea, Flood: "Fast
/// splittable pseudorandom number generators").
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Random(u64);

impl Random {
    /// Its numbers depend on `seed` alone.
    pub fn new(seed: u64) -> Self {
        Random(seed)
    }

    /// A number of 64 bits.
    pub fn any(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// A number below `end`, which is not 0.
    pub fn below(&mut self, end: u64) -> u64 {
        self.any() % end.max(1)
    }

    /// An index into something of `len` items.
    pub fn index(&mut self, len: usize) -> usize {
        self.below(len as u64) as usize
    }

    /// True once in `n` times.
    pub fn one_in(&mut self, n: u64) -> bool {
        self.below(n) == 0
    }

    /// One of `choices`, which are not empty.
    pub fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.index(choices.len())]
    }

    /// A span from `least` to just below `most`, in steps of 62.5 ns: a cycle at 16 MHz.
    pub fn span(&mut self, least: Time, most: Time) -> Time {
        const STEP: u64 = 62_500;
        let steps = most.saturating_sub(least).ps() / STEP;
        least + Time::from_ps(STEP * self.below(steps))
    }

    /// A clock's error: 0 to `limit` ppm either way.
    pub fn clock_ppm(&mut self, limit: u32) -> i32 {
        self.below(2 * u64::from(limit) + 1) as i32 - limit as i32
    }
}

/// What goes wrong with one character of a frame. `at` is its index in the frame; one past the last
/// stands for the end of the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// Data bits are inverted, the parity bit is not mended.
    Flipped {
        /// The index of the character.
        at: usize,
        /// The bits to be inverted.
        mask: u8,
    },
    /// It never comes, and the rest moves up.
    Missing {
        /// The index of the character.
        at: usize,
    },
    /// It never comes, and its time passes.
    Hole {
        /// The index of the character.
        at: usize,
    },
    /// Another one comes before it.
    Inserted {
        /// The index of the character, or the end.
        at: usize,
        /// The other one.
        value: u8,
    },
    /// A pause before it.
    Pause {
        /// The index of the character.
        at: usize,
        /// The length of the gap.
        length: Time,
    },
    /// The wrong parity bit, in formats that have one.
    BadParity {
        /// The index of the character.
        at: usize,
    },
    /// A low stop bit.
    BadStop {
        /// The index of the character.
        at: usize,
    },
}

impl Damage {
    /// Any damage to a character of a frame of `len`, which is not 0. Pauses keep a tenth away from
    /// t1.5 and t3.5, where clocks that are off may disagree, and the first character has none.
    pub fn draw(random: &mut Random, line: Line, len: usize) -> Self {
        let at = random.index(len);
        match random.below(8) {
            0 => Damage::Flipped {
                at,
                mask: 1 << random.below(8),
            },
            1 => Damage::Flipped {
                at,
                mask: 1 + random.below(255) as u8,
            },
            2 => Damage::Missing { at },
            3 => Damage::Hole { at },
            4 => Damage::Inserted {
                at: random.index(len + 1),
                value: random.any() as u8,
            },
            5 if line.format.parity() != Parity::None => Damage::BadParity { at },
            5 | 6 => Damage::BadStop { at },
            _ => {
                let tenth = |time: Time, tenths: u64| time * tenths / 10;
                let (least, most) = match random.below(3) {
                    0 => (Time::ZERO, tenth(line.t15(), 9)),
                    1 => (tenth(line.t15(), 11), tenth(line.t35(), 9)),
                    _ => (tenth(line.t35(), 11), line.t35() * 3),
                };
                Damage::Pause {
                    at: 1 + random.index(len.saturating_sub(1)),
                    length: random.span(least, most),
                }
            }
        }
    }

    /// Damages `characters`; an index beyond them does nothing.
    pub fn apply(self, characters: &mut Vec<Tx>, line: Line) {
        let mut change = |at: usize, how: &dyn Fn(Tx) -> Tx| {
            if let Some(character) = characters.get_mut(at) {
                *character = how(*character);
            }
        };
        match self {
            Damage::Flipped { at, mask } => change(at, &|character| {
                let bits = (0..8).filter(|bit| mask >> bit & 1 == 1);
                bits.fold(character, Tx::flip_bit)
            }),
            Damage::BadParity { at } => change(at, &Tx::bad_parity),
            Damage::BadStop { at } => change(at, &Tx::bad_stop),
            Damage::Pause { at, length } => {
                change(at, &|character| character.after(character.gap() + length))
            }
            Damage::Inserted { at, value } if at <= characters.len() => {
                characters.insert(at, Tx::byte(value))
            }
            Damage::Missing { at } | Damage::Hole { at } if at < characters.len() => {
                let gone = characters.remove(at);
                let mut pause = gone.gap();
                if matches!(self, Damage::Hole { .. }) {
                    pause += line.character();
                }
                if let Some(next) = characters.get_mut(at) {
                    *next = next.after(next.gap() + pause);
                }
            }
            _ => {}
        }
    }
}

/// What a receiver by the book takes from `characters`: for each frame that a silence of t3.5 ends
/// its bytes, or nothing where one of them or a pause over t1.5 is wrong (SER 2.5.1.1). The CRC is
/// not looked at.
pub fn received(characters: &[Tx], line: Line) -> Vec<Option<Vec<u8>>> {
    let mut frames: Vec<Option<Vec<u8>>> = Vec::new();
    for (index, character) in characters.iter().enumerate() {
        if index == 0 || character.gap() >= line.t35() {
            frames.push(Some(Vec::new()));
        } else if character.gap() > line.t15()
            && let Some(frame) = frames.last_mut()
        {
            *frame = None;
        }
        if let Some(frame) = frames.last_mut() {
            match (character.received(line.format), frame.as_mut()) {
                (Some(value), Some(bytes)) => bytes.push(value),
                _ => *frame = None,
            }
        }
    }
    frames
}

/// One thing that goes wrong while a request is sent, waited for and answered. `after` counts from
/// the request's first start bit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A character of the request is damaged on its way.
    Damage(Damage),
    /// The wire is forced to a level.
    Noise {
        /// The time from the beginning of the request.
        after: Time,
        /// The length of the noise.
        length: Time,
        /// The level of the wire; true is the idle level.
        level: bool,
    },
    /// A neighbour's driver pulls the wire low.
    StuckLow {
        /// The time from the beginning of the request.
        after: Time,
        /// How long, in characters.
        characters: usize,
    },
    /// A neighbour sends although it was not asked.
    Intrusion {
        /// The time from the beginning of the request.
        after: Time,
        /// The bytes that are sent.
        bytes: Vec<u8>,
    },
    /// A node's reset pin is pulled.
    Reset {
        /// The node in question.
        node: NodeId,
        /// The time from the beginning of the request.
        after: Time,
    },
    /// A node has no power for a while.
    PowerCut {
        /// The node in question.
        node: NodeId,
        /// The time from the beginning of the request.
        after: Time,
        /// How long the node stays off.
        off: Time,
    },
}

/// Silence after which nothing more comes of a request: many times what a node needs to begin its
/// answer once t3.5 is over.
const QUIET: Time = Time::from_ms(5);

impl Fault {
    /// The characters of `frame`, damaged where this fault is one of characters.
    pub fn characters(&self, frame: &[u8], line: Line) -> Vec<Tx> {
        let mut characters = frame.iter().map(|&byte| Tx::byte(byte)).collect();
        if let Fault::Damage(damage) = self {
            damage.apply(&mut characters, line);
        }
        characters
    }

    /// The client sends `request`, this goes wrong, and the bus runs until it is silent. Returns
    /// what the client heard, damaged characters included.
    ///
    /// Both hosts are silent and the bus is idle when it begins. A node that lost its power has it
    /// back and has had 5 ms to boot when it ends.
    pub fn strike(
        &self,
        bus: &mut Bus,
        client: HostId,
        neighbour: HostId,
        request: &[u8],
    ) -> Vec<RxByte> {
        let start = bus.now();
        let line = bus.host(client).line();
        bus.host(client).take();
        bus.host(neighbour).take();
        let characters = self.characters(request, line);
        let mut end = bus.host(client).send_each(characters);
        let later = |character: Tx, index: usize, after: Time| match index {
            0 => character.after(after),
            _ => character,
        };
        match *self {
            Fault::Damage(_) => {}
            Fault::Noise {
                after,
                length,
                level,
            } => {
                bus.noise(start + after, length, level);
                end = end.max(start + after + length);
            }
            Fault::StuckLow { after, characters } => {
                let low = match line.format.parity() {
                    Parity::Odd => Tx::byte(0).bad_stop().bad_parity(),
                    _ => Tx::byte(0).bad_stop(),
                };
                let all = (0..characters).map(|index| later(low, index, after));
                end = end.max(bus.host(neighbour).send_each(all));
            }
            Fault::Intrusion { after, ref bytes } => {
                let all = bytes.iter().enumerate();
                let all = all.map(|(index, &byte)| later(Tx::byte(byte), index, after));
                end = end.max(bus.host(neighbour).send_each(all));
            }
            Fault::Reset { node, after } => {
                bus.run_to(start + after);
                bus.reset(node);
            }
            Fault::PowerCut { node, after, off } => {
                bus.run_to(start + after);
                bus.power_cut(node);
                bus.run_for(off);
                bus.power_up(node);
            }
        }
        bus.run_to(end);
        let mut edges = usize::MAX;
        while edges != bus.record().wire_edges().len() {
            edges = bus.record().wire_edges().len();
            bus.run_for(line.t35() + QUIET);
        }
        bus.host(client).take()
    }
}

/// A run under one seed. Where it ends in a panic, it says how to replay it.
#[derive(Debug)]
pub struct Campaign {
    seed: u64,
    /// The numbers that this seed gives.
    pub random: Random,
}

impl Campaign {
    /// The run of one seed.
    pub fn new(seed: u64) -> Self {
        Campaign {
            seed,
            random: Random::new(seed),
        }
    }

    /// A run for each of `seeds`, or for the one that the environment variable `BUS_SEED` names.
    pub fn each(seeds: Range<u64>, mut run: impl FnMut(Campaign)) {
        match std::env::var(REPLAY)
            .ok()
            .and_then(|seed| seed.parse().ok())
        {
            Some(seed) => run(Campaign::new(seed)),
            None => seeds.for_each(|seed| run(Campaign::new(seed))),
        }
    }

    /// The seed of the campaign.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Any fault while `request` is sent, waited for and answered; resets and power cuts are of one
    /// of `nodes`, where there is one.
    pub fn draw(&mut self, line: Line, request: &[u8], nodes: &[NodeId]) -> Fault {
        let random = &mut self.random;
        let len = request.len() as u64;
        // An answer may be longer; that is but a matter of how often it is hit.
        let least = line.bits(1) / 8;
        let most = line.character() * (2 * len + 4) + line.t35();
        let after = random.span(least, most);
        match random.below(if nodes.is_empty() { 7 } else { 10 }) {
            0..=2 => Fault::Damage(Damage::draw(random, line, request.len())),
            3 => Fault::Noise {
                after,
                length: random.span(line.bits(1) / 50, line.bits(1)),
                level: random.one_in(3),
            },
            4 => Fault::Noise {
                after,
                length: random.span(line.bits(1), line.character() * 3 / 2),
                level: random.one_in(3),
            },
            5 => Fault::StuckLow {
                after,
                characters: 1 + random.index(20),
            },
            6 => Fault::Intrusion {
                after,
                bytes: neighbours_answer(random),
            },
            7 | 8 => Fault::Reset {
                node: random.pick(nodes),
                after,
            },
            _ => Fault::PowerCut {
                node: random.pick(nodes),
                after,
                off: random.span(Time::from_us(10), Time::from_ms(3)),
            },
        }
    }
}

/// A good answer of unit 40 to a read of up to eight registers.
fn neighbours_answer(random: &mut Random) -> Vec<u8> {
    let count = 2 + 2 * random.index(8);
    let mut body = vec![40, 3, count as u8];
    body.extend((0..count).map(|_| random.any() as u8));
    crate::frames::with_crc(&body)
}

impl Drop for Campaign {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let seed = self.seed;
            eprintln!("seed {seed}: set {REPLAY}={seed} to run it alone");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINE: Line = Line::n81(38_400);

    fn plain(bytes: &[u8]) -> Vec<Tx> {
        bytes.iter().map(|&byte| Tx::byte(byte)).collect()
    }

    fn damaged(damage: Damage) -> Vec<Option<Vec<u8>>> {
        let mut characters = plain(&[1, 2, 3]);
        damage.apply(&mut characters, LINE);
        received(&characters, LINE)
    }

    #[test]
    fn each_damage_does_what_it_says() {
        let whole = |bytes: &[u8]| vec![Some(bytes.to_vec())];
        assert_eq!(received(&plain(&[1, 2, 3]), LINE), whole(&[1, 2, 3]));
        let mask = 0x81;
        assert_eq!(
            damaged(Damage::Flipped { at: 1, mask }),
            whole(&[1, 0x83, 3])
        );
        assert_eq!(damaged(Damage::Missing { at: 0 }), whole(&[2, 3]));
        assert_eq!(damaged(Damage::Hole { at: 1 }), whole(&[1, 3]));
        let value = 9;
        assert_eq!(
            damaged(Damage::Inserted { at: 3, value }),
            whole(&[1, 2, 3, 9])
        );
        assert_eq!(damaged(Damage::BadStop { at: 2 }), [None]);
        let pause = |length| damaged(Damage::Pause { at: 2, length });
        assert_eq!(pause(LINE.t15() * 9 / 10), whole(&[1, 2, 3]));
        assert_eq!(pause(LINE.t15() * 11 / 10), [None]);
        assert_eq!(pause(LINE.t35()), [Some(vec![1, 2]), Some(vec![3])]);
    }

    #[test]
    fn a_seed_gives_the_same_faults_again() {
        let draw = |seed| {
            let mut campaign = Campaign::new(seed);
            [(); 20].map(|()| campaign.draw(LINE, &[0; 8], &[NodeId(0), NodeId(1)]))
        };
        assert_eq!(draw(7), draw(7));
        assert_ne!(draw(7), draw(8));
    }
}
