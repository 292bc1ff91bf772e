//! What becomes of a panic and of an interrupt that nobody handles, and why the chip has started.
//!
//! A panic is a call of `abort`, avr-libc's of which stands still for ever: with interrupts off, where the interrupt panics
//! that sends, DE stays up. [`bind_usart0!`](crate::bind_usart0) defines another: interrupts off, DE low, and a reset by the
//! watchdog 16 ms later; if the watchdog is off, silence for ever. An interrupt without a handler comes there too, where
//! avr-libc starts the program anew with the peripherals as they are.
//!
//! A boot loader that clears MCUSR may leave in r2 what was there: Optiboot does from version 4.6 on. One that tells
//! nobody makes the cause [`ResetCause::Other`], but for a fault, which is kept in RAM.

use core::arch::{asm, global_asm};

use multidrop_firmware::ResetCause;

use crate::gpio::DriverEnable;

/// MCUSR (DS 11.9.1) and its bits.
const MCUSR: *mut u8 = 0x54 as *mut u8;
const PORF: u8 = 1 << 0;
const EXTRF: u8 = 1 << 1;
const BORF: u8 = 1 << 2;
const WDRF: u8 = 1 << 3;

/// What is kept through a reset: RAM keeps its contents, and the start-up code leaves `.noinit` alone.
#[repr(C)]
struct Kept {
    /// [`FAULT`] if the program has reset the chip.
    fault: u8,
    /// r2 at the start; once it was looked at the number of the [`ResetCause`].
    cause: u8,
}

unsafe extern "C" {
    static mut embassy_avr_hal_kept: Kept;
}

// Part of the start-up code, which runs on into its next part: r2 is kept before anything else uses it. The two words are
// `sts embassy_avr_hal_kept+1, r2`, which the assembler does not know here. In Rust the section would be one with contents,
// which would be flashed.
global_asm!(
    ".section .noinit, \"aw\", @nobits",
    ".globl embassy_avr_hal_kept",
    "embassy_avr_hal_kept: .zero 2",
    ".section .init3, \"ax\", @progbits",
    ".word 0x9220, embassy_avr_hal_kept+1",
    ".text",
);

/// Not what RAM has by chance after power-up, where that can be told.
const FAULT: u8 = 0xFA;

/// [`Kept::fault`].
#[inline(always)]
fn fault() -> *mut u8 {
    // SAFETY: the address only: there may be any byte.
    unsafe { &raw mut embassy_avr_hal_kept.fault }
}

/// [`Kept::cause`].
#[inline(always)]
fn kept_cause() -> *mut u8 {
    // SAFETY: as above.
    unsafe { &raw mut embassy_avr_hal_kept.cause }
}

/// `abort`: takes the driver off the bus, keeps that this was why, and has the watchdog reset the chip in 16 ms if it
/// runs.
#[doc(hidden)]
#[inline(always)]
pub fn abort<DE: DriverEnable>() -> ! {
    avr_device::interrupt::disable();
    DE::lower();
    // SAFETY: RAM of this module; interrupts are off.
    unsafe { fault().write_volatile(FAULT) };
    crate::watchdog::hasten();
    loop {
        // SAFETY: changes nothing; keeps the loop, which has no other effect, what it is.
        unsafe { asm!("", options(nomem, nostack)) };
    }
}

/// Finds out why the chip has started, for [`reset_cause`]. Once, at the start of `main`. Clears the flags, so that the next
/// start does not find them; the watchdog cannot be set or stopped before (DS 11.9.2, WDE).
pub fn find_cause() {
    // SAFETY: MCUSR holds nothing but these flags; `main` is alone.
    let flags = unsafe {
        let flags = MCUSR.read_volatile();
        MCUSR.write_volatile(0);
        flags
    };
    // SAFETY: RAM of this module, written by the start-up code; any byte may be there.
    let (passed, was_fault) = unsafe {
        (
            kept_cause().read_volatile(),
            fault().read_volatile() == FAULT,
        )
    };
    let flags = match flags {
        0 if passed <= PORF | EXTRF | BORF | WDRF => passed,
        flags => flags,
    };
    // After power-up RAM may be anything.
    let cause = if flags & PORF != 0 {
        ResetCause::Power
    } else if was_fault {
        ResetCause::Fault
    } else if flags & BORF != 0 {
        ResetCause::BrownOut
    } else if flags & WDRF != 0 {
        ResetCause::Watchdog
    } else if flags & EXTRF != 0 {
        ResetCause::Pin
    } else {
        ResetCause::Other
    };
    // SAFETY: RAM of this module.
    unsafe {
        fault().write_volatile(0);
        kept_cause().write_volatile(cause as u8);
    }
}

/// Why the chip has started, once [`find_cause`] has found it.
pub fn reset_cause() -> ResetCause {
    // SAFETY: RAM of this module, initialised by `find_cause`, or any byte.
    ResetCause::from_number(unsafe { kept_cause().read_volatile() })
}
