//! Thousands of requests with one in a hundred bytes damaged: flipped, lost, inserted, delayed.
//!
//! The plain reading of the standard in the harness judges the wire, and the model is compared after each batch: only
//! good frames have written to it.

use multidrop_protocol::frame::ReceiveErrors;
use multidrop_testkit::harness::book::{self, Book, UNIT};
use multidrop_testkit::harness::bus::Settings;
use multidrop_testkit::harness::random::{self, Random};
use multidrop_testkit::harness::script::{self, Config, Op, Sent};

const REQUESTS: u64 = 100_000;
const BATCH: u64 = 100;

/// Whether anything was done to the characters.
fn damage(random: &mut Random, settings: &Settings, chars: &mut Vec<Sent>) -> bool {
    let mut damaged = false;
    let mut at = 0;
    while at < chars.len() {
        if random.once_in(100) {
            damaged = true;
            match random.below(6) {
                0 => chars[at].byte ^= 1 << random.below(8),
                1 => chars[at].byte ^= 1 + random.below(255) as u8,
                2 => {
                    // The silence stays.
                    let lost = chars.remove(at);
                    if let Some(next) = chars.get_mut(at) {
                        next.gap += lost.gap;
                        if at > 0 {
                            next.gap += settings.character;
                        }
                    }
                    continue;
                }
                3 => {
                    let byte = random.byte();
                    chars.insert(at, Sent { byte, ..chars[at] });
                    at += 1;
                    chars[at].gap = 0;
                }
                4 => chars[at].gap += settings.t1_5 + 1 + random.below(settings.t3_5),
                _ => {
                    chars[at].errors = random.pick(&[ReceiveErrors::PARITY, ReceiveErrors::FRAMING])
                }
            }
        }
        at += 1;
    }
    damaged
}

/// Whether a damaged request came out as another good frame.
fn is_good_by_chance(settings: &Settings, chars: &[Sent], body: &[u8]) -> bool {
    let whole = chars.iter().all(|it| it.errors.is_empty())
        && chars.iter().skip(1).all(|it| it.gap <= settings.t1_5);
    let bytes: Vec<u8> = chars.iter().map(|it| it.byte).collect();
    whole && book::unframed(&bytes).is_some_and(|other| other != body)
}

fn soak<const MAY_FAIL: bool>(seed: u64) {
    let mut random = Random::new(seed);
    let mut book = Book::new();
    let (mut damaged, mut by_chance, mut answered, mut executed) = (0, 0, 0, 0);
    for _ in 0..REQUESTS / 2 / BATCH {
        let mut settings = random::settings(&mut random);
        settings.strict = true;
        let mut ops = Vec::new();
        for _ in 0..BATCH {
            let mut body = random::request(&mut random);
            if random.once_in(4) {
                body[0] = UNIT;
            }
            let silence = settings.t3_5 + 1 + random.below(500);
            let mut chars = script::frame(silence, &book::framed(&body));
            if damage(&mut random, &settings, &mut chars) {
                damaged += 1;
                by_chance += u64::from(is_good_by_chance(&settings, &chars, &body));
            }
            let polite = true;
            ops.push(Op::Talk { polite, chars });
        }
        let config = Config {
            settings,
            latencies: vec![0],
        };
        let verdict = script::run::<MAY_FAIL>(&config, &ops, &mut book);
        answered += verdict.answered;
        executed += verdict.executed;
    }
    println!(
        "seed {seed}: {} requests, {damaged} damaged, {answered} answered, {executed} executed, \
         {by_chance} damaged with a right CRC",
        REQUESTS / 2
    );
    assert!(damaged > REQUESTS / 40 && answered > 20_000 && executed > 10_000);
    // One in 65536 of the damaged ones, in the mean.
    assert!(by_chance < 10);
}

#[test]
fn damaged_requests_are_neither_answered_nor_executed_where_writes_may_fail() {
    soak::<true>(1);
}

#[test]
fn damaged_requests_are_neither_answered_nor_executed_where_writes_do_not_fail() {
    soak::<false>(2);
}
