//! Functions that the compiler calls, in few bytes: the compiler's own `memcpy` and `memset` are unrolled and take
//! 520 bytes of flash, `memmove` 708, the 32-bit division 1208.

use core::arch::{asm, naked_asm};

/// The `memcpy` of C.
///
/// # Safety
/// As in C.
#[unsafe(no_mangle)]
unsafe extern "C" fn memcpy(to: *mut u8, from: *const u8, len: usize) -> *mut u8 {
    // SAFETY: copies `len` bytes, for which the caller is responsible.
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

/// The `memset` of C.
///
/// # Safety
/// As in C.
#[unsafe(no_mangle)]
unsafe extern "C" fn memset(to: *mut u8, byte: i16, len: usize) -> *mut u8 {
    // SAFETY: fills `len` bytes, for which the caller is responsible.
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

/// The `memmove` of C.
///
/// # Safety
/// As in C.
#[unsafe(no_mangle)]
unsafe extern "C" fn memmove(to: *mut u8, from: *const u8, len: usize) -> *mut u8 {
    if to.cast_const() <= from {
        // SAFETY: as this function's; copying upwards reads each byte before it is overwritten.
        return unsafe { memcpy(to, from, len) };
    }
    // SAFETY: copies `len` bytes from the last one down, for which the caller is responsible. Both pointers are at
    // most one past their objects, and wrap as addresses do.
    unsafe {
        asm!(
            "rjmp 3f",
            "2: ld {byte}, -Z",
            "st -X, {byte}",
            "3: sbiw {len}, 1",
            "brcc 2b",
            byte = out(reg) _,
            len = inout(reg_iw) len => _,
            inout("X") to.wrapping_add(len) => _,
            inout("Z") from.wrapping_add(len) => _,
        );
    }
    to
}

/// Quotient and remainder of 32 bits, bit by bit: about 640 cycles for any numbers, 74 bytes.
///
/// The dividend is in R25:R22, the divisor in R21:R18; the quotient goes to R21:R18, the remainder to R25:R22 (avr-gcc's calling
/// convention for this function, which LLVM shares). The caller checks for division by 0.
#[unsafe(no_mangle)]
#[unsafe(naked)]
unsafe extern "C" fn __udivmodsi4() {
    // `movw` would be shorter, but code of a naked function is assembled for the smallest AVR.
    naked_asm!(
        // The remainder so far is in R31:R30:R27:R26.
        "ldi r26, 32",
        "mov r0, r26",
        "clr r26",
        "clr r27",
        "clr r30",
        "clr r31",
        // The next bit of the dividend goes to the remainder; its place takes the next bit of the quotient.
        "2: lsl r22",
        "rol r23",
        "rol r24",
        "rol r25",
        "rol r26",
        "rol r27",
        "rol r30",
        "rol r31",
        "cp r26, r18",
        "cpc r27, r19",
        "cpc r30, r20",
        "cpc r31, r21",
        "brcs 3f",
        "sub r26, r18",
        "sbc r27, r19",
        "sbc r30, r20",
        "sbc r31, r21",
        "inc r22",
        "3: dec r0",
        "brne 2b",
        "mov r18, r22",
        "mov r19, r23",
        "mov r20, r24",
        "mov r21, r25",
        "mov r22, r26",
        "mov r23, r27",
        "mov r24, r30",
        "mov r25, r31",
        "ret",
    );
}
