//! Two clocks, and frames that are exactly t3.5 apart by the client's clock: a frame that begins slightly early by
//! the unit's clock is a new frame, on both boards.

use multidrop_bus::Line;
use multidrop_testkit::pair::Pair;
use multidrop_testkit::{Runner, on_both};

on_both! {
    an_stm32_loses_nothing_back_to_back_where_both_clocks_are_1_percent_off,
    an_stm32_withdraws_the_answer_to_a_frame_that_the_next_one_follows_early,
    an_stm32_at_2_percent_hears_every_character_and_a_client_that_leaves_2_percent_more_silence,
    an_stm32_keeps_a_first_character_that_is_over_before_t3_5,
}

const RATES: [u32; 5] = [9_600, 19_200, 38_400, 57_600, 115_200];
/// Rounds of each test.
const ROUNDS: u16 = 10;

/// 1 % in parts per million.
const ONE_PERCENT: i32 = 10_000;
/// What a Nano of 16 MHz survives at 57600 baud where the client is fast: it is 0.8 % slow by itself, and hears characters at
/// double speed, which end in the next one from 2.6 % on (DS40002061B table 20-3, less one sample).
const AT_57600: i32 = 8_500;

/// Both clocks off by so much in opposite directions, both ways.
fn nothing_is_lost(pair: impl Fn(Line, i32, i32) -> Pair, fast_client: impl Fn(u32) -> i32) {
    for baud in RATES {
        let fast = fast_client(baud);
        for (client, unit) in [(fast, -fast), (-ONE_PERCENT, ONE_PERCENT)] {
            let lost = pair(Line::n81(baud), client, unit).lost(ROUNDS);
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
        pair(Line::n81(baud), ppm(baud), -ppm(baud)).withdrawn(ROUNDS);
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
    assert_eq!(pair(line, -20_000, 20_000).lost(ROUNDS), 0);
    let mut pair = pair(line, 20_000, -20_000);
    // Back to back none of them gets through.
    assert_eq!(pair.lost(ROUNDS), 4 * usize::from(ROUNDS));
    pair.silence = pair.silence * 102 / 100;
    assert_eq!(pair.lost(ROUNDS), 0);
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
    assert_eq!(pair.lost(ROUNDS), 0);
    pair.withdrawn(ROUNDS);
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
    assert_eq!(pair.lost(ROUNDS), 4 * usize::from(ROUNDS));
    let mut pair = Pair::nano(Line::n81(57_600), ONE_PERCENT, 0);
    assert_eq!(pair.lost(ROUNDS), 0);
}
