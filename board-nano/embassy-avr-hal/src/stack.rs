//! The stack: painted by the start-up code, measured on request, and checked with each feeding of the watchdog.
//!
//! The static variables lie below the stack. A stack that grows into them overwrites the paint at its end first. The
//! next feeding of the watchdog detects that, and the program ends as by a panic ([`fault`](crate::fault)). If the
//! watchdog is off, there is no check.

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

/// The byte that fills the free RAM at the start.
const PAINT: u8 = 0xC5;

/// One past the last byte of RAM, as an address.
const END: usize = 0x900;

unsafe extern "C" {
    /// The end of the static variables, by the linker.
    static _end: u8;
    /// Ends the program, see [`fault`](crate::fault).
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

/// The byte at this distance above the end of the stack.
#[inline(always)]
fn byte(offset: usize) -> u8 {
    // SAFETY: reading RAM has no effect; the callers stay below [`END`].
    unsafe { (&raw const _end).add(offset).read_volatile() }
}

/// Ends the program as by a panic if the stack has reached its end.
#[inline(always)]
pub(crate) fn check() {
    if byte(0) != PAINT || byte(1) != PAINT {
        // SAFETY: `bind_interrupts!` defines it so that it can be called anywhere.
        unsafe { abort() }
    }
}

/// The depth of the stack since the start. Takes about 5 cycles for each byte that has not been in use.
pub fn stack() -> Stack {
    let size = END - (&raw const _end).addr();
    let free = (0..size).take_while(|&offset| byte(offset) == PAINT);
    Stack {
        size,
        used: size - free.count(),
    }
}
