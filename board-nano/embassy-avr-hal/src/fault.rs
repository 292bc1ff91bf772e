//! The handling of panics and of interrupts without a handler, and the cause of the last reset.
//!
//! A panic calls `abort`. That of avr-libc loops for ever with interrupts off: if the interrupt that sends panics, DE
//! stays up. [`bind_interrupts!`](crate::bind_interrupts) defines another where it binds `USART0`: interrupts off, DE
//! low, and a reset by the watchdog 16 ms later; if the watchdog is off, the chip stays silent. An interrupt without a
//! handler calls it too, where avr-libc would restart the program without a reset of the peripherals.
//!
//! A boot loader that clears MCUSR may pass its value on in r2: Optiboot does from version 4.6 on. If it does not,
//! the cause is [`ResetCause::Other`], except after a fault, which is kept in RAM. Before version 6 Optiboot reports
//! a reset by the watchdog as one by the pin.

use core::arch::{asm, global_asm};

use multidrop_protocol::server::ResetCause;

use crate::gpio::DriverEnable;

/// MCUSR (DS 11.9.1) and its bits.
const MCUSR: *mut u8 = 0x54 as *mut u8;
const PORF: u8 = 1 << 0;
const EXTRF: u8 = 1 << 1;
const BORF: u8 = 1 << 2;
const WDRF: u8 = 1 << 3;

/// The state that outlives a reset: RAM keeps its contents, and the start-up code leaves `.noinit` alone.
#[repr(C)]
struct Kept {
    /// [`FAULT`] if the program has reset the chip; half of it after it was read once.
    fault: u8,
    /// The value of r2 at the start; then MCUSR if it had flags.
    flags: u8,
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

/// The value of [`Kept::fault`] after a fault.
const FAULT: u8 = 2;

/// The address of [`Kept::fault`].
#[inline(always)]
fn fault() -> *mut u8 {
    // SAFETY: the address only: there may be any byte.
    unsafe { &raw mut embassy_avr_hal_kept.fault }
}

/// The address of [`Kept::flags`].
#[inline(always)]
fn kept_flags() -> *mut u8 {
    // SAFETY: as above.
    unsafe { &raw mut embassy_avr_hal_kept.flags }
}

/// The `abort` of the program: takes DE down, records the fault, and lets the watchdog reset the chip in 16 ms if it
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
        // SAFETY: no effect; without it the compiler might change the empty loop.
        unsafe { asm!("", options(nomem, nostack)) };
    }
}

/// Records the cause of the last reset, for [`reset_cause`]. To be called once, at the start of `main`. Clears the
/// flags, so that the next start does not find them; the watchdog cannot be set or stopped before (DS 11.9.2, WDE).
#[inline(always)]
pub fn keep_cause() {
    // SAFETY: MCUSR holds nothing but these flags, and `Kept` is of this module; `main` is alone. Any byte may be there.
    unsafe {
        let flags = MCUSR.read_volatile();
        MCUSR.write_volatile(0);
        if flags != 0 {
            kept_flags().write_volatile(flags);
        }
        // It is 1 then, and 0 after the next start.
        fault().write_volatile(fault().read_volatile() >> 1);
    }
}

/// The cause of the last reset, as [`keep_cause`] has recorded it.
pub fn reset_cause() -> ResetCause {
    // SAFETY: RAM of this module, written by the start-up code and by `keep_cause`.
    let (flags, was_fault) = unsafe {
        (
            kept_flags().read_volatile(),
            fault().read_volatile() == FAULT / 2,
        )
    };
    // A random value of r2 is not a set of flags.
    let flags = if flags <= PORF | EXTRF | BORF | WDRF {
        flags
    } else {
        0
    };
    // After power-up RAM may have any content.
    if flags & PORF != 0 {
        ResetCause::Power
    } else if was_fault {
        ResetCause::Fault
    } else if flags & BORF != 0 {
        ResetCause::BrownOut
    } else if flags & EXTRF != 0 {
        // Optiboot uses the watchdog to end its wait after a reset by the pin.
        ResetCause::Pin
    } else if flags & WDRF != 0 {
        ResetCause::Watchdog
    } else {
        ResetCause::Other
    }
}
