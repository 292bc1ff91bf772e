//! Timer1, free-running at an eighth of the CPU clock: the time base of line and time driver.

use crate::pac::TC1;

/// CPU cycles in one tick.
pub(crate) const PRESCALER: u32 = 8;

/// The registers of Timer1.
#[inline(always)]
pub(crate) fn registers() -> &'static crate::pac::tc1::RegisterBlock {
    // SAFETY: the block exists at this address for the life of the program; every access to a
    // register shared with an interrupt is made in an interrupt or a critical section.
    unsafe { &*TC1::ptr() }
}

/// Starts the timer: normal mode, clock / 8 (DS 16.11.1, 16.11.2). Calling it again changes nothing.
pub(crate) fn start() {
    // SAFETY: all bit patterns are valid for these registers; 0b010 selects clk/8.
    registers().tccr1b().write(|w| unsafe { w.bits(0b010) });
}

/// The present tick. Reading TCNT1 goes through the TEMP register that all 16-bit accesses share
/// (DS 16.3), so interrupts must be off.
#[inline(always)]
pub(crate) fn now() -> u16 {
    registers().tcnt1().read().bits()
}

/// Bits of TIMSK1 and TIFR1 (DS 16.11.8, 16.11.9).
pub(crate) const TOV1: u8 = 1 << 0;
pub(crate) const OCF1A: u8 = 1 << 1;
#[cfg(feature = "modbus")]
pub(crate) const OCF1B: u8 = 1 << 2;

/// Clears flags of TIFR1, by writing ones.
#[inline(always)]
pub(crate) fn clear(flags: u8) {
    // SAFETY: writing a one clears that flag and no other.
    registers().tifr1().write(|w| unsafe { w.bits(flags) });
}

/// Enables interrupts of Timer1. Interrupts must be off: TIMSK1 is shared.
#[inline(always)]
pub(crate) fn enable(interrupts: u8) {
    // SAFETY: only interrupt enable bits of Timer1 are in this register.
    registers()
        .timsk1()
        .modify(|r, w| unsafe { w.bits(r.bits() | interrupts) });
}

/// Disables interrupts of Timer1. Interrupts must be off: TIMSK1 is shared.
#[inline(always)]
pub(crate) fn disable(interrupts: u8) {
    // SAFETY: as in `enable`.
    registers()
        .timsk1()
        .modify(|r, w| unsafe { w.bits(r.bits() & !interrupts) });
}
