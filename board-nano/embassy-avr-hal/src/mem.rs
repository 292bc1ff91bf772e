//! `memcpy` and `memset` in a few bytes: the ones that come with the compiler are unrolled and take
//! 520 bytes of flash.

use core::arch::asm;

/// C's `memcpy`.
///
/// # Safety
/// As in C.
#[unsafe(no_mangle)]
unsafe extern "C" fn memcpy(to: *mut u8, from: *const u8, len: usize) -> *mut u8 {
    // SAFETY: copies `len` bytes, which the caller answers for.
    unsafe {
        asm!(
            "rjmp 3f",
            "2: ld {byte}, Z+",
            "st X+, {byte}",
            "3: sbiw {len}, 1",
            "brcc 2b",
            byte = out(reg) _,
            len = inout(reg_iw) len => _,
            inout("X") to => _,
            inout("Z") from => _,
        );
    }
    to
}

/// C's `memset`.
///
/// # Safety
/// As in C.
#[unsafe(no_mangle)]
unsafe extern "C" fn memset(to: *mut u8, byte: i16, len: usize) -> *mut u8 {
    // SAFETY: fills `len` bytes, which the caller answers for.
    unsafe {
        asm!(
            "rjmp 3f",
            "2: st X+, {byte}",
            "3: sbiw {len}, 1",
            "brcc 2b",
            byte = in(reg) byte as u8,
            len = inout(reg_iw) len => _,
            inout("X") to => _,
        );
    }
    to
}
