//! Requests, gaps and scripts by number: equal numbers give equal scripts.

use multidrop_protocol::frame::ReceiveErrors;

use super::book::{self, UNIT};
use super::bus::Settings;
use super::script::{self, Config, Op, Sent};

/// The generator SplitMix64.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Random {
        Random(seed)
    }

    /// A number of 64 bits.
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = self.0;
        let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number under `end`.
    pub fn below(&mut self, end: u64) -> u64 {
        self.next() % end
    }

    pub fn byte(&mut self) -> u8 {
        self.next() as u8
    }

    /// True once in `times` calls on average.
    pub fn once_in(&mut self, times: u64) -> bool {
        self.below(times) == 0
    }

    pub fn pick<T: Clone>(&mut self, from: &[T]) -> T {
        from[self.below(from.len() as u64) as usize].clone()
    }
}

/// Unit id and PDU of something that a client may ask: mostly right, mostly of us.
pub fn request(random: &mut Random) -> Vec<u8> {
    let unit = random.pick(&[UNIT, UNIT, UNIT, UNIT, 0, 5]);
    let word = |random: &mut Random, most: u64| (random.below(most) as u16).to_be_bytes();
    let mut body = vec![unit];
    match random.below(11) {
        0 => body.extend([3, 0, random.below(140) as u8, 0, random.below(127) as u8]),
        1 => body.extend([
            4,
            0xFF,
            0xFA + random.below(6) as u8,
            0,
            random.below(7) as u8,
        ]),
        2 => body.extend([1, 0, random.below(52) as u8, 0, random.below(45) as u8]),
        3 => {
            body.push(2);
            body.extend(word(random, 2200));
            body.extend(word(random, 2004));
        }
        4 => body.extend([
            5,
            0,
            random.below(52) as u8,
            random.pick(&[0, 0xFF, 0xFF, 1]),
            0,
        ]),
        5 | 6 => body.extend([6, 0, random.below(140) as u8, random.byte(), random.byte()]),
        7 => {
            let count = 1 + random.below(43);
            body.extend([15, 0, random.below(52) as u8, 0, count as u8]);
            body.push(count.div_ceil(8) as u8);
            body.extend((0..count.div_ceil(8)).map(|_| random.byte()));
        }
        8 => {
            let count = if random.once_in(20) {
                123
            } else {
                1 + random.below(9) as u8
            };
            body.extend([16, 0, random.below(140) as u8, 0, count, 2 * count]);
            body.extend((0..2 * count).map(|_| random.byte()));
        }
        9 => {
            let functions = [
                book::REVERSE,
                book::COUNT,
                book::TOO_LONG,
                book::BUSY,
                book::MUTE,
            ];
            body.push(random.pick(&functions));
            body.extend((0..random.below(4)).map(|_| random.byte()));
        }
        _ => body.extend((0..1 + random.below(30)).map(|_| random.byte())),
    }
    body
}

/// A silence, mostly near one that matters.
pub fn gap(random: &mut Random, settings: &Settings) -> u64 {
    let Settings {
        character,
        t1_5,
        t3_5,
        ..
    } = *settings;
    let (from, span) = random.pick(&[
        (0, 1),
        (1, 1),
        (0, t1_5),
        (t1_5 - 1, 3),
        (t1_5 - 1, 3),
        (t3_5 - 1, 3),
        (settings.judged() - 1, 3),
        (t1_5, character),
        (t1_5, t3_5 - t1_5),
        (t3_5, character),
        (t3_5, 4 * character),
    ]);
    from + random.below(span)
}

/// 9600 baud or less, 38400 and 115200, as a character of 100 ticks sees them; drivers of every kind.
pub fn settings(random: &mut Random) -> Settings {
    let (t1_5, t3_5) = random.pick(&[(150, 350), (288, 672), (864, 2016)]);
    Settings {
        character: 100,
        t1_5,
        t3_5,
        early: random.pick(&[0, t3_5 / 24]),
        strict: !random.once_in(4),
        sees_start_bits: !random.once_in(4),
        short_cut: random.once_in(2),
        ready_latency: random.pick(&[0, 0, 40, 130]),
    }
}

/// A frame of some station, right or with an error.
fn talk(random: &mut Random, settings: &Settings) -> Op {
    let body = request(random);
    let silence = settings.t3_5 + 1 + random.below(300);
    let mut chars = script::frame(silence, &book::framed(&body));
    if random.once_in(5) {
        chars[0].gap = gap(random, settings);
    }
    let at = |random: &mut Random, chars: &[Sent]| random.below(chars.len() as u64) as usize;
    if random.once_in(4) {
        let at = at(random, &chars);
        chars[at].gap = gap(random, settings);
    }
    if random.once_in(9) {
        let at = at(random, &chars);
        chars[at].errors = random.pick(&[
            ReceiveErrors::PARITY,
            ReceiveErrors::FRAMING,
            ReceiveErrors::OVERRUN,
        ]);
    }
    if random.once_in(9) {
        let at = at(random, &chars);
        chars[at].byte ^= 1 << random.below(8);
    }
    if random.once_in(12) {
        // Leaves a right CRC right.
        chars.push(Sent {
            gap: gap(random, settings),
            byte: 0,
            errors: ReceiveErrors::NONE,
        });
    }
    Op::Talk {
        polite: !random.once_in(4),
        chars,
    }
}

/// A line whose tasks are fast, and frames.
pub fn orderly(random: &mut Random) -> (Config, Vec<Op>) {
    let settings = settings(random);
    let most = if settings.sees_start_bits {
        random.pick(&[1, 1, 26])
    } else {
        1
    };
    let latencies = (0..5).map(|_| random.below(most)).collect();
    let ops = (0..random.below(30))
        .map(|_| talk(random, &settings))
        .collect();
    (
        Config {
            settings,
            latencies,
        },
        ops,
    )
}

/// A script like that of [`orderly`], with slow tasks, edges that are no characters, and futures dropped at any
/// moment.
pub fn rough(random: &mut Random) -> (Config, Vec<Op>) {
    let (mut config, mut ops) = orderly(random);
    let most = random.pick(&[1, 26, 200, 1000, 20_000]);
    config.latencies = (0..5).map(|_| random.below(most)).collect();
    for _ in 0..random.below(12) {
        let op = match random.below(3) {
            0 => Op::Glitch(gap(random, &config.settings)),
            1 => Op::Cancel(random.below(4000)),
            _ => Op::Reset(random.below(4000)),
        };
        ops.insert(random.below(ops.len() as u64 + 1) as usize, op);
    }
    (config, ops)
}
