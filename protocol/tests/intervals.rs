//! The intervals of a line in ticks, for all chips and at the limits of the settings.

use multidrop_protocol::format::{Framing, LineFormat};
use multidrop_protocol::line::{LineConfig, Role};
use multidrop_protocol::port_registers::InterCharacter;
use multidrop_protocol::timing::{
    Intervals, PART, Sight, TICK_HZ_MAX, first_part, further_parts, margin, t1_5, t3_5, whole,
};

const CONFIG: LineConfig = LineConfig {
    baud: 38_400,
    format: LineFormat::F8N1,
    ..LineConfig::DEFAULT
};

/// The USART samples the stop bit in its middle; the timer is as fast as the USART.
const STM32: Sight = Sight {
    tick_hz: 42_000_000,
    rest: 9,
    latency: 0,
    client_part: 4,
};

/// Timer1 counts in half microseconds, and interrupts take some of them.
const NANO: Sight = Sight {
    tick_hz: 2_000_000,
    rest: 7,
    latency: 6,
    client_part: 2,
};

#[test]
fn silences_of_a_fast_timer_worked_by_hand() {
    // At 38400 baud a bit has 1093.75 ticks; 9 sixteenths of the stop bit are left, 615.2.
    let made = Intervals::new(&CONFIG, &STM32);
    assert_eq!(made.to_complete, 31_500 + 616);
    let t3_5 = 73_500 + 616;
    assert_eq!(made.t3_5, t3_5);
    assert_eq!(made.to_start, 73_500 / 24);
    assert_eq!(made.to_complete + made.to_stand() + made.to_start, t3_5);
    assert_eq!(made.character, 10_938);
    // With two stop bits there is a whole one more.
    let two = LineConfig {
        format: LineFormat::F8N2,
        ..CONFIG
    };
    let more = Sight { rest: 25, ..STM32 };
    assert_eq!(Intervals::new(&two, &more).t3_5, 73_500 + 1_709);
}

#[test]
fn where_gaps_are_allowed_one_silence_completes_and_judges_a_frame() {
    let off = LineConfig {
        inter_character: InterCharacter::Off,
        ..CONFIG
    };
    let made = Intervals::new(&off, &STM32);
    let t3_5 = 73_500 + 616;
    assert_eq!(made.to_complete, t3_5 - 73_500 / 24);
    assert_eq!((made.to_stand(), made.t3_5), (0, t3_5));
}

#[test]
fn a_gap_in_ms_takes_the_place_of_a_shorter_t3_5_only() {
    let with = |ms, baud| LineConfig {
        baud,
        inter_character: InterCharacter::Gap(ms),
        ..CONFIG
    };
    let made = Intervals::new(&with(5, 38_400), &NANO);
    // 7 sixteenths of 52.08 ticks are 23, less 6.
    assert_eq!(made.t3_5, 10_000 + 17);
    assert_eq!(made.to_start, margin(10_000));
    assert_eq!(made.to_complete, made.t3_5 - made.to_start);
    // 3.5 characters of ten bits at 2400 baud are 14.6 ms, and the rest of the stop bit 365 ticks.
    let made = Intervals::new(&with(5, 2_400), &NANO);
    assert_eq!(made.t3_5, 29_167 + 365 - 6);
}

#[test]
fn the_time_of_interrupts_is_subtracted() {
    let made = Intervals::new(&CONFIG, &NANO);
    assert_eq!(made.to_complete, 1_500 + 23 - 6);
    assert_eq!(made.t3_5, 3_500 + 23 - 6);
    assert_eq!(made.to_start, 3_500 / 24);
    assert_eq!(made.to_stand(), 2_000 - 145);
    assert_eq!(made.character, 521);
}

#[test]
fn a_client_judges_its_part_of_the_time_before_t3_5() {
    let config = LineConfig {
        role: Role::Client,
        ..CONFIG
    };
    let made = Intervals::new(&config, &STM32);
    assert_eq!((made.to_start, made.to_stand()), (10_500, 31_500));
    let made = Intervals::new(&config, &NANO);
    assert_eq!((made.to_start, made.to_stand()), (1_000, 1_000));
    // Where gaps are allowed it is the margin for a client too.
    let off = LineConfig {
        inter_character: InterCharacter::Off,
        ..config
    };
    assert_eq!(Intervals::new(&off, &NANO).to_start, margin(3_500));
}

#[test]
fn ascii_waits_in_fortieths_of_a_second_and_answers_at_t3_5() {
    let config = LineConfig {
        framing: Framing::Ascii,
        ..CONFIG
    };
    let rtu = Intervals::new(&CONFIG, &STM32);
    let made = Intervals::new(&config, &STM32);
    assert_eq!(made.to_complete, 1_050_000);
    assert_eq!((made.t3_5, made.character), (rtu.t3_5, rtu.character));
    let uneven = Sight {
        tick_hz: 1_382_399,
        ..STM32
    };
    assert_eq!(Intervals::new(&config, &uneven).to_complete, 34_560);
}

#[test]
fn no_interval_is_cut_short_or_overflows_at_the_ends_of_the_range() {
    for format in LineFormat::ALL {
        for baud in [300, 1_282, 2_400, 19_200, 19_201, 2_000_000] {
            for tick_hz in [1_000_000, 2_500_000, 42_000_000, TICK_HZ_MAX] {
                for role in [Role::Server, Role::Client] {
                    for rest in [0, 7, 26, 48] {
                        let config = LineConfig {
                            baud,
                            format,
                            role,
                            ..CONFIG
                        };
                        let sight = Sight {
                            tick_hz,
                            rest,
                            latency: 0,
                            client_part: 2,
                        };
                        let made = Intervals::new(&config, &sight);
                        let left = (u64::from(rest) * u64::from(tick_hz))
                            .div_ceil(16 * u64::from(baud))
                            as u32;
                        assert_eq!(made.to_complete, left + t1_5(format, baud, tick_hz));
                        assert_eq!(made.t3_5, left + t3_5(format, baud, tick_hz));
                        assert_eq!(
                            made.to_complete + made.to_stand() + made.to_start,
                            made.t3_5
                        );
                        assert!(made.to_stand() > 0 && made.to_start > 0);
                    }
                }
            }
        }
    }
}

#[test]
fn a_long_interval_is_counted_in_parts_that_a_timer_of_16_bits_holds() {
    let part = u32::from(PART);
    let edges = (1..=9).flat_map(|n| [n * part - 1, n * part, n * part + 1]);
    for ticks in edges.chain([0, 1, 65_535, 65_536, 5 * 65_535]) {
        let (first, further) = (first_part(ticks), further_parts(ticks));
        assert_eq!(whole(first, further), ticks);
        assert_eq!(further > 0, ticks >= 2 * part, "{ticks}");
        // Another part is set behind the one that runs, so none of them is over at once.
        assert!(further == 0 || first >= PART, "{ticks}");
    }
}
