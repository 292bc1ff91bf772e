//! The watchdog (DS 11.8, 11.9.2).

/// WDTCSR and its bits.
const WDTCSR: *mut u8 = 0x60 as *mut u8;
const WDCE: u8 = 1 << 4;
const WDE: u8 = 1 << 3;

/// Sets WDTCSR, which takes a change within four cycles of WDCE only.
///
/// Interrupts must be off.
#[inline(always)]
fn set(control: u8) {
    // SAFETY: the timed sequence of DS 11.8.2; both instructions of two cycles follow each other, since the values are
    // worked out before.
    unsafe {
        core::arch::asm!(
            "wdr",
            "sts 0x60, {change}",
            "sts 0x60, {control}",
            change = in(reg) WDCE | WDE,
            control = in(reg) control,
            options(nostack),
        );
    }
}

/// Has it reset the chip in 16 ms if it runs at all. Interrupts must be off.
#[inline(always)]
pub(crate) fn hasten() {
    // SAFETY: reading has no effect.
    if unsafe { WDTCSR.read_volatile() } & WDE != 0 {
        set(WDE);
    }
}
