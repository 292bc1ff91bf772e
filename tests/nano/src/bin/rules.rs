//! What rules cost: writes of 16 registers are judged by 32 rules, and by none. PB0 is high while a
//! write is judged, PB1 tells before it falls whether the write is allowed.
#![no_std]
#![no_main]
#![allow(missing_docs)]

use core::hint::black_box;

use embassy_avr_hal::gpio::{Output, PB0, PB1, Pins};
use embassy_avr_hal::pac;
use embedded_hal::digital::OutputPin;
use multidrop::protocol::data::Registers;
use multidrop::protocol::exception::Exception;
use multidrop::protocol::registers::{NoRules, Rules};
use multidrop::protocol::rules;

// ANCHOR: rules
rules! {
    /// 20 rules on values, 8 valid ranges and 4 that can be disabled.
    struct Rules32: "RS4";
    VALID_REG {
        0..=3, 4..=7, 8..=11, 12..=15, 16..=31, 40..=49, 60..=69, 1000..=1063
    }
    VALID_DATA {
        0..=0 => list(1, 2, 3, 500),
        1..=1 => list(1, 20, 300, 4000),
        2..=2 => list(1, 2, 3, 500),
        3..=3 => list(1, 2, 3, 500),
        4..=4 => list(1, 2, 3, 500),
        5..=5 => list(1, 2, 3, 500),
        6..=6 => list(1, 2, 3, 500),
        7..=7 => list(1, 2, 3, 500),
        8..=8 => range(100..=200),
        9..=9 => range(100..=200),
        10..=10 => range(100..=200),
        11..=11 => range(100..=200),
        12..=12 => range(100..=200),
        13..=13 => range(100..=200),
        14..=14 => range(100..=200),
        15..=15 => range(100..=200),
        16..=31 => range(0..=1000),
        40..=49 => range(100..=200),
        60..=69 => list(0, 1),
        1000..=1063 => range(0..=9999),
    }
    DISABLE_REG { 100..=109, 120..=125, 140..=149, 200..=255 }
}
// ANCHOR_END: rules

rules! {
    /// 32 rules on values, eight of which are for two registers of the block each.
    struct Pairs: "RS4";
    VALID_DATA {
        100..=100 => list(1), 101..=101 => list(1), 102..=102 => list(1), 103..=103 => list(1),
        104..=104 => list(1), 105..=105 => list(1), 106..=106 => list(1), 107..=107 => list(1),
        0..=1 => list(1, 2, 3, 500, 4000),
        2..=3 => list(1, 2, 3, 500),
        4..=5 => list(1, 2, 3, 500),
        6..=7 => list(1, 2, 3, 500),
        8..=9 => range(100..=200),
        10..=11 => range(100..=200),
        12..=13 => range(100..=200),
        14..=15 => list(100, 200),
        110..=110 => list(1), 111..=111 => list(1), 112..=112 => list(1), 113..=113 => list(1),
        114..=114 => list(1), 115..=115 => list(1), 116..=116 => list(1), 117..=117 => list(1),
        120..=120 => list(1), 121..=121 => list(1), 122..=122 => list(1), 123..=123 => list(1),
        124..=124 => list(1), 125..=125 => list(1), 126..=126 => list(1), 127..=127 => list(1),
    }
}

const BYTES: usize = 32;

fn judge(
    (busy, allowed): &mut (Output<PB0>, Output<PB1>),
    check: fn(u16, Registers<'_>, u32) -> Result<(), Exception>,
    first: u16,
    bytes: &[u8; BYTES],
) {
    let values = Registers::new(bytes);
    let Ok(()) = busy.set_high();
    let judged = check(black_box(first), black_box(values), black_box(u32::MAX));
    let Ok(()) = allowed.set_state(judged.is_ok().into());
    let Ok(()) = busy.set_low();
}

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    let pins = Pins::new(chip.PORTB, chip.PORTC, chip.PORTD);
    let mut out = (Output::new(pins.PB0, false), Output::new(pins.PB1, false));

    let mut each_its_rule = [0; BYTES];
    for (index, pair) in each_its_rule.as_chunks_mut().0.iter_mut().enumerate() {
        // The last of each list. Not known to the compiler: it would keep the block in RAM.
        let value: u16 = match black_box(index) {
            1 => 4000,
            0..8 => 500,
            _ => 200,
        };
        *pair = value.to_be_bytes();
    }
    judge(&mut out, NoRules::check_write, 0, &each_its_rule);
    judge(&mut out, Rules32::check_write, 0, &each_its_rule);
    judge(&mut out, Pairs::check_write, 0, &each_its_rule);
    let zeros = black_box([0; BYTES]);
    judge(&mut out, Rules32::check_write, 16, &zeros);
    judge(&mut out, Rules32::check_write, 1048, &zeros);
    // The last register has a value that its rule does not allow; the next block is partly disabled.
    each_its_rule[BYTES - 1] = 201;
    judge(&mut out, Rules32::check_write, 0, &each_its_rule);
    judge(&mut out, Rules32::check_write, 50, &each_its_rule);
    loop {
        avr_device::asm::sleep();
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Never linked: `panic = "immediate-abort"`.
    loop {}
}
