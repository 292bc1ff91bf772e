//! Checks what the HAL has in place of the compiler's own division and `memmove`: B0 goes high if all is right, B1 if not.
#![no_std]
#![no_main]

use core::hint::black_box;

use embassy_avr_hal::gpio::PortBOut;
use embassy_avr_hal::{bind_interrupts, executor};

bind_interrupts!(
    struct Irqs {}
);

/// Numbers at the ends of the range, and by chance.
const PAIRS: u16 = 3_000;

struct Chance(u32);

impl Chance {
    /// The next one of 32 bits, and of fewer every other time (xorshift).
    fn next(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        self.0 >> (self.0 & 0x1F)
    }
}

/// A quotient and a remainder are right if and only if they make the dividend again and the remainder is smaller than the divisor.
fn divides(dividend: u32, divisor: u32) -> bool {
    let (dividend, divisor) = (black_box(dividend), black_box(divisor));
    let (quotient, remainder) = (dividend / divisor, dividend % divisor);
    let product = quotient.checked_mul(divisor);
    remainder < divisor
        && product.and_then(|product| product.checked_add(remainder)) == Some(dividend)
}

fn all_divide() -> bool {
    let ends = [
        1,
        2,
        3,
        0xFF,
        0x100,
        0xFFFF,
        0x1_0000,
        0x7FFF_FFFF,
        0x8000_0000,
        0x8000_0001,
        u32::MAX,
    ];
    let mut chance = Chance(2_463_534_242);
    ends.iter().all(|divisor| {
        divides(0, *divisor) && ends.iter().all(|dividend| divides(*dividend, *divisor))
    }) && (0..PAIRS).all(|_| {
        let dividend = chance.next();
        divides(dividend, chance.next().max(1))
    })
}

/// Moves `len` bytes of 0, 1, 2 ... and looks at each place afterwards.
fn moves(from: usize, to: usize, len: usize) -> bool {
    let mut bytes = [0_u8; 24];
    for (place, byte) in (0..).zip(&mut bytes) {
        *byte = place;
    }
    black_box(&mut bytes).copy_within(from..from + len, to);
    bytes.iter().enumerate().all(|(place, byte)| {
        let moved = place >= to && place < to + len;
        usize::from(*byte) == if moved { place - to + from } else { place }
    })
}

fn all_move() -> bool {
    [0, 1, 2, 7, 16].iter().all(|len| {
        [0, 1, 5, 8].iter().all(|from| {
            [0, 1, 4, 6, 8]
                .iter()
                .all(|to| moves(black_box(*from), black_box(*to), black_box(*len)))
        })
    })
}

#[avr_device::entry]
fn main() -> ! {
    let mut show = PortBOut::new(0b11);
    show.write(if all_divide() && all_move() {
        0b01
    } else {
        0b10
    });
    executor::run(Irqs, |_| {})
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Never linked: `panic = "immediate-abort"`.
    loop {}
}
