//! Characters of ASCII in time, and what else befalls a line, on the simulated USART of the harness.

use multidrop_protocol::frame::ReceiveErrors;

use crate::input::Input;
use multidrop_testkit::harness::ascii::{self, framed};
use multidrop_testkit::harness::book::Book;
use multidrop_testkit::harness::bus::{SECOND, Settings};
use multidrop_testkit::harness::script::{Config, Op, frame};

/// More takes time and shows nothing new.
const OPS_MAX: usize = 24;

/// Two bytes for line, model and tasks; then what happens, each a byte that says what and some for how.
pub fn ascii_line(data: &[u8]) {
    let mut input = Input(data);
    let kind = input.byte();
    let tasks = input.byte();
    let settings = Settings {
        character: 100,
        t1_5: 150,
        t3_5: [350, 672, 2016][usize::from(kind % 3)],
        early: 2,
        strict: true,
        sees_start_bits: true,
        short_cut: false,
        ready_latency: if kind & 16 == 0 { 0 } else { 130 },
    };
    let most = [0, 0, 25, 25, 200, 1000, 5000, 20_000][usize::from(tasks % 8)];
    let latencies = (1..=4).map(|part| u64::from(tasks) * most * part / (4 * 255));
    let config = Config {
        latencies: latencies.collect(),
        settings,
    };
    let mut ops = Vec::new();
    while !input.is_over() && ops.len() < OPS_MAX {
        ops.push(op(&mut input, &config.settings));
    }
    let mut book = Book::new();
    if kind & 32 == 0 {
        ascii::run::<false>(&config, &ops, &mut book);
    } else {
        ascii::run::<true>(&config, &ops, &mut book);
    }
}

fn op(input: &mut Input, settings: &Settings) -> Op {
    let what = input.byte();
    match what {
        0..=9 => return Op::Glitch(gap(input, settings)),
        10..=19 => return Op::Cancel(u64::from(input.byte()) * 16 + u64::from(what % 10)),
        20..=29 => return Op::Reset(u64::from(input.byte()) * 16 + u64::from(what % 10)),
        _ => {}
    }
    let bit = |number: u8| what >> number & 1 == 0;
    let len = usize::from(input.byte());
    let body = input.bytes(len);
    let mut text = if bit(0) && body.len() >= 2 {
        framed(body)
    } else {
        body.to_vec()
    };
    if !bit(1) {
        text.make_ascii_lowercase();
    }
    if !bit(2) && !text.is_empty() {
        // Something else in place of a character, in front of it, or nothing more.
        let (at, how) = (usize::from(input.byte()) % text.len(), input.byte());
        match how {
            0..=63 => text.truncate(at),
            64..=127 => text.insert(at, how - 64),
            _ => text[at] = how - 128,
        }
    }
    let mut chars = frame(gap(input, settings), &text);
    if !bit(3) && !chars.is_empty() {
        let at = usize::from(input.byte()) % chars.len();
        chars[at].gap = gap(input, settings);
    }
    if !bit(4) && !chars.is_empty() {
        let how = input.byte();
        let at = usize::from(how) % chars.len();
        chars[at].errors = [
            ReceiveErrors::PARITY,
            ReceiveErrors::FRAMING,
            ReceiveErrors::OVERRUN,
        ][usize::from(how % 3)];
    }
    Op::Talk {
        polite: bit(5),
        chars,
    }
}

/// A silence: within some ticks of one that matters, none, or of any length up to t3.5 and two characters.
fn gap(input: &mut Input, settings: &Settings) -> u64 {
    let what = input.byte();
    let Settings {
        character, t3_5, ..
    } = *settings;
    let centres = [
        2,
        t3_5,
        t3_5 - character,
        t3_5 + character,
        SECOND,
        SECOND + 5,
    ];
    match centres.get(usize::from(what / 5)) {
        Some(centre) => centre + u64::from(what % 5) - 2,
        None if what.is_multiple_of(2) => 0,
        None => u64::from(what) * (t3_5 + 2 * character) / 255,
    }
}
