//! The stack: painted by the start-up code, measured when it is asked for, and its end looked at with each feeding of the
//! watchdog.
//!
//! What lies below it are the static variables. A stack that grows into them overwrites the paint at its end first, and is
//! found out at the latest when the watchdog is fed: the program ends as by a panic, and so does it start anew
//! ([`fault`](crate::fault)). Where the watchdog is off nobody looks.

use core::arch::global_asm;

/// The stack, as it was painted at the start and has been overwritten since.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stack {
    /// Bytes there are for it.
    pub size: usize,
    /// Bytes of them that have been in use since the board has started: a lower bound, since what was never written to inside
    /// of them shows only from above.
    pub used: usize,
}

/// What the free RAM is filled with.
const PAINT: u8 = 0xC5;

/// One past the last byte of RAM, as an address.
const END: usize = 0x900;

unsafe extern "C" {
    /// The end of the static variables, by the linker.
    static _end: u8;
    /// [`fault`](crate::fault) has what it does.
    fn abort() -> !;
}

// Part of the start-up code, which runs on into its next part; nothing is on the stack yet. The word is `st Z+, r24`, which
// the assembler does not know here.
global_asm!(
    ".section .init3, \"ax\", @progbits",
    "ldi r30, lo8(_end)",
    "ldi r31, hi8(_end)",
    "ldi r24, {paint}",
    "1: .word 0x9381",
    "cpi r31, {end}",
    "brne 1b",
    ".text",
    paint = const PAINT,
    end = const END >> 8,
);

/// The byte so far above the end of the stack.
#[inline(always)]
fn byte(offset: usize) -> u8 {
    // SAFETY: reading RAM has no effect; the callers stay below [`END`].
    unsafe { (&raw const _end).add(offset).read_volatile() }
}

/// Ends the program as by a panic if the stack has been at its end.
#[inline(always)]
pub(crate) fn check() {
    if byte(0) != PAINT || byte(1) != PAINT {
        // SAFETY: `bind_interrupts!` defines it so that it can be called anywhere.
        unsafe { abort() }
    }
}

/// How deep the stack has been. It takes some 5 cycles for each byte that has not been in use.
pub fn stack() -> Stack {
    let size = END - (&raw const _end).addr();
    let free = (0..size).take_while(|&offset| byte(offset) == PAINT);
    Stack {
        size,
        used: size - free.count(),
    }
}
