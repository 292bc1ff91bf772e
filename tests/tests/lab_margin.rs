//! Two clocks, and frames that are exactly t3.5 apart by the client's: what begins a little early by the unit's is a frame of
//! its own, on both boards.

mod common;

use common::frames::{block, data, words};
use common::{Runner, on_both, registers, stm32_registers_at};
use multidrop_bus::{
    Bus, BusConfig, Emulator, HostId, HostPort, Line, Nano, Station, Stm32, Time, Tx, WireId,
};

on_both! {
    an_stm32_loses_nothing_back_to_back_where_both_clocks_are_1_percent_off,
    an_stm32_withdraws_the_answer_to_a_frame_that_the_next_one_follows_early,
    an_stm32_at_2_percent_hears_every_character_and_a_client_that_leaves_2_percent_more_silence,
    an_stm32_keeps_a_first_character_that_is_over_before_t3_5,
}

const RATES: [u32; 5] = [9_600, 19_200, 38_400, 57_600, 115_200];
const ROUNDS: u16 = 10;

/// 1 % in parts per million.
const ONE_PERCENT: i32 = 10_000;
/// What a Nano of 16 MHz survives at 57600 baud where the client is fast: it is 0.8 % slow by itself, and hears characters at
/// double speed, which end in the next one from 2.6 % on (DS40002061B table 20-3, less one sample).
const AT_57600: i32 = 8_500;

/// A client and a unit on one line.
struct Pair {
    bus: Bus,
    client: HostId,
    line: Line,
    /// t3.5 by the client's clock.
    silence: Time,
    /// How far the unit's clock is off.
    unit_ppm: i32,
}

/// A span of the clock that is off by this much.
fn by_clock(span: Time, ppm: i32) -> Time {
    Time::from_ps(span.ps() * 1_000_000 / 1_000_000u64.strict_add_signed(ppm.into()))
}

impl Pair {
    fn new(mut bus: Bus, line: Line, client_ppm: i32, unit_ppm: i32) -> Self {
        let mut port = HostPort::new(line);
        port.clock_ppm = client_ppm;
        let client = bus.add_host(port);
        bus.run_for(Time::from_ms(20));
        Self {
            bus,
            client,
            line,
            silence: by_clock(line.t35(), client_ppm),
            unit_ppm,
        }
    }

    /// With a Nano.
    fn nano(line: Line, client_ppm: i32, unit_ppm: i32) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let nano = Nano {
            clock_ppm: unit_ppm,
            ..Nano::new("unit 1", registers(16, line))
        };
        bus.add_nano(nano).expect("a valid image");
        Self::new(bus, line, client_ppm, unit_ppm)
    }

    /// With an STM32. QEMU's clock is exact, so the client's is off by as much as both are apart.
    fn stm32(runner: Runner, line: Line, client_ppm: i32, unit_ppm: i32) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let mut emulator = runner.emulator();
        let (client_ppm, unit_ppm) = match &mut emulator {
            Emulator::Core { clock_ppm, .. } => {
                *clock_ppm = unit_ppm;
                (client_ppm, unit_ppm)
            }
            Emulator::Qemu { .. } => {
                let apart = i64::from(client_ppm - unit_ppm) * 1_000_000;
                ((apart / i64::from(1_000_000 + unit_ppm)) as i32, 0)
            }
        };
        bus.add_stm32(Stm32 {
            name: "stm32".to_owned(),
            image: stm32_registers_at(runner, line),
            emulator,
            wires: [None, None, None, Some(WireId::default())],
        })
        .expect("a valid image");
        Self::new(bus, line, client_ppm, unit_ppm)
    }

    /// Sends frames, t3.5 after what was last on the line and t3.5 apart; the answer to the last.
    fn say(&mut self, frames: &[&[u8]]) -> Vec<u8> {
        let last = self.bus.record().bytes().last();
        let begin = last.map_or(Time::ZERO, |byte| byte.end) + self.silence;
        let first = begin.saturating_sub(self.bus.now());
        let mut characters = Vec::new();
        for frame in frames {
            let before = if characters.is_empty() {
                first
            } else {
                self.silence
            };
            let (head, tail) = frame.split_first().expect("no frame is empty");
            characters.push(Tx::byte(*head).after(before));
            characters.extend(tail.iter().map(|&byte| Tx::byte(byte)));
        }
        let client = self.client;
        self.bus.host(client).take();
        let end = self.bus.host(client).send_each(characters);
        self.bus.run_to(end);
        let mut patience = self.line.t35() + Time::from_ms(1);
        let mut count = self.bus.host(client).heard().len();
        loop {
            let heard = |bus: &mut Bus| bus.host(client).heard().len() > count;
            if !self.bus.run_until(heard, patience + self.line.character()) {
                break;
            }
            count += 1;
            patience = self.line.bits(1);
        }
        let heard = self.bus.host(client).take();
        heard.iter().map(|byte| byte.value).collect()
    }

    /// Rounds of frames back to back, to all, to another unit and from it, and to ours: how many had no effect, or not their
    /// answer.
    fn lost(&mut self) -> usize {
        let mut lost = 0;
        let read = words(1, 3, 3, 1);
        for round in 0..ROUNDS {
            let value = 0x1000 + round;
            let many = [value.to_be_bytes(); 16].concat();
            let broadcast = words(0, 6, 3, value);
            let others = [words(2, 3, 0, 2), data(2, 3, &[1, 2, 3, 4])];
            let write = block(1, 16, 0, 16, &many);
            let got = data(1, 3, &many[..2]);
            let exchanges: [(&[&[u8]], &[u8]); 4] = [
                (&[&broadcast, &read], &got),
                (&[&others[0], &others[1], &read], &got),
                (&[&others[0], &write], &words(1, 16, 0, 16)),
                (&[&read], &got),
            ];
            for (frames, expected) in exchanges {
                lost += usize::from(self.say(frames) != expected);
                self.assert_not_early();
            }
        }
        lost
    }

    /// Frames that begin before the answer to the one before: that one's write is carried out, its answer withdrawn.
    fn withdrawn(&mut self) {
        let baud = self.line.baud;
        for round in 0..ROUNDS {
            let bytes = (0x2000 + round).to_be_bytes();
            let (read, got) = (words(1, 3, 3, 1), data(1, 3, &bytes));
            let write = words(1, 6, 3, 0x2000 + round);
            assert_eq!(self.say(&[&write, &read]), got, "{baud} baud, a write");
            let many = block(1, 16, 0, 16, &[round as u8; 32]);
            let got = data(1, 3, &[round as u8; 2]);
            assert_eq!(self.say(&[&many, &read]), got, "{baud} baud, a long write");
            assert_eq!(self.say(&[&read, &read]), got, "{baud} baud, a read");
        }
        self.assert_not_early();
    }

    /// The unit answered no earlier than t3.5 after the character before, by its own clock, which times that from the start
    /// bit on.
    fn assert_not_early(&self) {
        let bytes = self.bus.record().bytes();
        let pairs = bytes.windows(2);
        for pair in pairs.filter(|pair| pair[0].from == Station::Host(self.client)) {
            let due = by_clock(self.line.character() + self.line.t35(), self.unit_ppm);
            if pair[1].from != pair[0].from {
                assert!(pair[1].start - pair[0].start >= due, "{:?}", pair[1]);
            }
        }
        assert_eq!(self.bus.record().conflicts(), []);
    }
}

/// Both clocks off by so much in opposite directions, both ways.
fn nothing_is_lost(pair: impl Fn(Line, i32, i32) -> Pair, fast_client: impl Fn(u32) -> i32) {
    for baud in RATES {
        let fast = fast_client(baud);
        for (client, unit) in [(fast, -fast), (-ONE_PERCENT, ONE_PERCENT)] {
            let lost = pair(Line::n81(baud), client, unit).lost();
            assert_eq!(lost, 0, "{baud} baud, client {client} ppm, unit {unit} ppm");
        }
    }
}

/// How far a Nano may be off.
fn of_a_nano(baud: u32) -> i32 {
    if baud == 57_600 {
        AT_57600
    } else {
        ONE_PERCENT
    }
}

#[test]
fn a_nano_loses_nothing_back_to_back_where_both_clocks_are_1_percent_off() {
    nothing_is_lost(Pair::nano, of_a_nano);
}

fn an_stm32_loses_nothing_back_to_back_where_both_clocks_are_1_percent_off(runner: Runner) {
    nothing_is_lost(
        |line, client, unit| Pair::stm32(runner, line, client, unit),
        |_| ONE_PERCENT,
    );
}

fn answers_are_withdrawn(pair: impl Fn(Line, i32, i32) -> Pair, ppm: impl Fn(u32) -> i32) {
    for baud in RATES {
        pair(Line::n81(baud), ppm(baud), -ppm(baud)).withdrawn();
    }
}

#[test]
fn a_nano_withdraws_the_answer_to_a_frame_that_the_next_one_follows_early() {
    answers_are_withdrawn(Pair::nano, of_a_nano);
}

fn an_stm32_withdraws_the_answer_to_a_frame_that_the_next_one_follows_early(runner: Runner) {
    answers_are_withdrawn(
        |line, client, unit| Pair::stm32(runner, line, client, unit),
        |_| ONE_PERCENT,
    );
}

/// At 2 % each, 38400 8N1, one side still hears every frame. On the other the characters are whole, but t3.5 of a fast client is
/// 4 % short by the unit's clock, and the end of a character seems 0.4 bits late to it: together more than the margin.
fn two_percent(pair: impl Fn(Line, i32, i32) -> Pair) {
    let line = Line::n81(38_400);
    assert_eq!(pair(line, -20_000, 20_000).lost(), 0);
    let mut pair = pair(line, 20_000, -20_000);
    // Back to back none of them gets through.
    assert_eq!(pair.lost(), 4 * usize::from(ROUNDS));
    pair.silence = pair.silence * 102 / 100;
    assert_eq!(pair.lost(), 0);
}

#[test]
fn a_nano_at_2_percent_hears_every_character_and_a_client_that_leaves_2_percent_more_silence() {
    two_percent(Pair::nano);
}

fn an_stm32_at_2_percent_hears_every_character_and_a_client_that_leaves_2_percent_more_silence(
    runner: Runner,
) {
    two_percent(|line, client, unit| Pair::stm32(runner, line, client, unit));
}

/// At 250000 baud a character that begins early is over before the answer to the frame before was due: the line keeps it until
/// that one's task has let go of the buffer.
fn a_first_character_is_kept(pair: impl Fn(Line, i32, i32) -> Pair) {
    let mut pair = pair(Line::n81(250_000), ONE_PERCENT, -ONE_PERCENT);
    assert_eq!(pair.lost(), 0);
    pair.withdrawn();
}

#[test]
fn a_nano_keeps_a_first_character_that_is_over_before_t3_5() {
    a_first_character_is_kept(Pair::nano);
}

fn an_stm32_keeps_a_first_character_that_is_over_before_t3_5(runner: Runner) {
    a_first_character_is_kept(|line, client, unit| Pair::stm32(runner, line, client, unit));
}

/// What a Nano's characters no longer survive: at 57600 baud, 2.8 % in all.
#[test]
fn a_nano_at_57600_baud_loses_characters_of_a_client_that_is_1_percent_fast_when_it_is_1_percent_slow()
 {
    let mut pair = Pair::nano(Line::n81(57_600), ONE_PERCENT, -ONE_PERCENT);
    pair.silence = pair.silence * 2;
    assert_eq!(pair.lost(), 4 * usize::from(ROUNDS));
    let mut pair = Pair::nano(Line::n81(57_600), ONE_PERCENT, 0);
    assert_eq!(pair.lost(), 0);
}
