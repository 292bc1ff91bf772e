//! The stack: painted at the start, measured on request, with a guard below it that no code may access.
//!
//! The static variables lie below the stack. The guard is a region of the MPU without access (ARMv7-M B3.5): code that pushes into
//! it faults, and the board starts anew as after any fault.

use core::ptr::{read_volatile, write_volatile};

use cortex_m::peripheral::MPU;
use multidrop::Stack;

/// The byte that fills the free RAM at the start.
const PAINT: u32 = 0xC5C5_C5C5;

/// The size of the guard in bytes, a power of two: more than most functions take at once.
const GUARD: usize = 256;

unsafe extern "C" {
    /// The end of the static variables, and the other end of the stack, from the linker.
    static __sheap: u32;
    static _stack_start: u32;
}

/// Bytes below the stack pointer that painting leaves alone: an interrupt may use them meanwhile.
const SPARED: usize = 512;

/// The lowest address of the guard.
fn guard() -> usize {
    (&raw const __sheap).addr().next_multiple_of(GUARD)
}

/// Bits of MPU_CTRL (ARMv7-M B3.5.5): the MPU is on; outside of its regions access is as without it. In faults it is off.
const ENABLE: u32 = 1 << 0;
const PRIVDEFENA: u32 = 1 << 2;

/// MPU_RASR (ARMv7-M B3.5.9): no access (AP 0), nothing to execute (XN), a size of 2 to the power of SIZE + 1, on.
const NO_ACCESS: u32 = 1 << 28 | (GUARD.ilog2() - 1) << 1 | 1;

/// Paints the free RAM and puts up the guard. To be called once, at the start of the program.
pub(crate) fn paint_and_guard() {
    let from = guard() + GUARD;
    let to = cortex_m::register::msp::read() as usize - SPARED;
    for address in (from..to).step_by(size_of::<u32>()) {
        // SAFETY: RAM between the static variables and the used part of the stack; volatile, since it is only read by address.
        unsafe { write_volatile(core::ptr::with_exposed_provenance_mut(address), PAINT) };
    }
    // SAFETY: region 0 of eight is used only here; no static variable and no part of the stack lies in it.
    unsafe {
        let mpu = &*MPU::PTR;
        mpu.rnr.write(0);
        mpu.rbar.write(guard() as u32);
        mpu.rasr.write(NO_ACCESS);
        mpu.ctrl.write(ENABLE | PRIVDEFENA);
    }
    // The guard takes effect from the next instruction on (ARMv7-M B3.5.1).
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

/// The size of the stack, and the most that has been in use.
pub fn stack() -> Stack {
    let from = guard() + GUARD;
    let to = (&raw const _stack_start).addr();
    let is_free = |address: &usize| {
        // SAFETY: as in `paint_and_guard`; reading RAM has no effect.
        unsafe { read_volatile(core::ptr::with_exposed_provenance::<u32>(*address)) == PAINT }
    };
    let free = (from..to).step_by(size_of::<u32>()).take_while(is_free);
    Stack {
        size: to - from,
        used: to - from - free.count() * size_of::<u32>(),
    }
}
