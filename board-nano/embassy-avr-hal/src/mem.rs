//! `memcpy` and `memset` in a few bytes: the ones that come with the compiler are unrolled and take
//! 520 bytes of flash.
//!
//! Calling convention of avr-gcc: arguments in r25:r24, r23:r22 and r21:r20; r0, r26, r27, r30 and r31
//! are free to use; the result, the first argument, stays in r25:r24.

use core::arch::naked_asm;

/// C's `memcpy`.
///
/// # Safety
/// As in C.
#[unsafe(no_mangle)]
#[unsafe(naked)]
unsafe extern "C" fn memcpy(to: *mut u8, from: *const u8, len: usize) -> *mut u8 {
    naked_asm!(
        "movw r26, r24",
        "movw r30, r22",
        "1: subi r20, 1",
        "sbci r21, 0",
        "brcs 2f",
        "ld r0, Z+",
        "st X+, r0",
        "rjmp 1b",
        "2: ret",
    )
}

/// C's `memset`.
///
/// # Safety
/// As in C.
#[unsafe(no_mangle)]
#[unsafe(naked)]
unsafe extern "C" fn memset(to: *mut u8, byte: i16, len: usize) -> *mut u8 {
    naked_asm!(
        "movw r26, r24",
        "1: subi r20, 1",
        "sbci r21, 0",
        "brcs 2f",
        "st X+, r22",
        "rjmp 1b",
        "2: ret",
    )
}
