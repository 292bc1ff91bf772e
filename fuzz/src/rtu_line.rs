//! Characters in time, and what else befalls a line, on the simulated USART of the harness.

use multidrop_protocol::frame::ReceiveErrors;

use crate::input::Input;
use multidrop_testkit::harness::book::{self, Book};
use multidrop_testkit::harness::bus::Settings;
use multidrop_testkit::harness::script::{self, Config, Op, frame};

/// More takes time and shows nothing new.
const OPS_MAX: usize = 24;

/// Two bytes for line, model and tasks; then what happens, each a byte that says what and some for how.
pub fn rtu_line(data: &[u8]) {
    let mut input = Input(data);
    let kind = input.byte();
    let (t1_5, t3_5) = [(150, 350), (288, 672), (864, 2016)][usize::from(kind % 3)];
    let bit = |number: u8| kind >> number & 1 == 0;
    let tasks = input.byte();
    let settings = Settings {
        character: 100,
        t1_5,
        t3_5,
        early: if tasks & 8 == 0 { 0 } else { t3_5 / 24 },
        strict: bit(3) || bit(4),
        sees_start_bits: bit(5),
        short_cut: bit(6),
        ready_latency: if bit(4) { 0 } else { 130 },
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
    if bit(7) {
        script::run::<false>(&config, &ops, &mut book);
    } else {
        script::run::<true>(&config, &ops, &mut book);
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
    let before = if bit(0) {
        settings.t3_5 + 1
    } else {
        gap(input, settings)
    };
    let len = usize::from(input.byte());
    let body = input.bytes(len);
    let bytes = if bit(1) && body.len() >= 2 {
        book::framed(body)
    } else {
        body.to_vec()
    };
    let mut chars = frame(before, &bytes);
    if !bit(2) && !chars.is_empty() {
        let at = usize::from(input.byte()) % chars.len();
        chars[at].gap = gap(input, settings);
    }
    if !bit(3) && !chars.is_empty() {
        let how = input.byte();
        let at = usize::from(how) % chars.len();
        chars[at].errors = [
            ReceiveErrors::PARITY,
            ReceiveErrors::FRAMING,
            ReceiveErrors::OVERRUN,
        ][usize::from(how % 3)];
    }
    if !bit(4) {
        // Leaves a right CRC right.
        chars.extend(frame(gap(input, settings), &[0]));
    }
    Op::Talk {
        polite: bit(5),
        chars,
    }
}

/// A silence: within two ticks of one that matters, or of any length up to t3.5 and two characters.
fn gap(input: &mut Input, settings: &Settings) -> u64 {
    let what = input.byte();
    let Settings {
        character,
        t1_5,
        t3_5,
        ..
    } = *settings;
    let centres = [
        2,
        t1_5,
        t3_5,
        t3_5 - character,
        t3_5 + character,
        t1_5 + character,
    ];
    match centres.get(usize::from(what / 5)) {
        Some(centre) => centre + u64::from(what % 5) - 2,
        None => u64::from(what) * (t3_5 + 2 * character) / 255,
    }
}
