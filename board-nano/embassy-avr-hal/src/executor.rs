//! An Embassy executor that sleeps.
//!
//! embassy-executor's own one for AVR tests its flag between `sei` and `sleep` and never sets
//! SMCR.SE: a wake-up that falls between the two is lost, and the CPU never sleeps. Here the flag is
//! tested with interrupts off, and `sei` stands right before `sleep`: the instruction after `sei` is
//! executed before any pending interrupt (DS 7.7), so an interrupt either is seen by the test or
//! wakes the CPU.

use core::arch::asm;

use embassy_executor::{Spawner, raw};

/// GPIOR0 (DS 8.6.6) is in reach of `sbi` and `sbic`: setting the flag is one instruction, in
/// interrupts too.
const WORK: *mut u8 = 0x3E as *mut u8;
const WORK_BIT: u8 = 1 << 0;

/// SMCR: sleep mode idle, sleep enabled (DS 10.11.1). Idle stops the CPU only; USART and timer run.
const SMCR: *mut u8 = 0x53 as *mut u8;
const IDLE_ENABLED: u8 = 0b0000_0001;

#[unsafe(export_name = "__pender")]
fn pender(_context: *mut ()) {
    // SAFETY: GPIOR0 is a plain storage register; `sbi` is atomic.
    unsafe { WORK.write_volatile(WORK.read_volatile() | WORK_BIT) }
}

/// Runs tasks for ever. `init` spawns the first of them; interrupts are enabled after it.
///
/// To be called once, from `main`.
pub fn run(init: impl FnOnce(Spawner)) -> ! {
    let executor = raw::Executor::new(core::ptr::null_mut());
    // SAFETY: this function never returns, so what lives in its frame lives for ever.
    let executor: &'static raw::Executor = unsafe { core::mem::transmute(&executor) };
    init(executor.spawner());
    // SAFETY: SMCR holds the sleep mode only.
    unsafe { SMCR.write_volatile(IDLE_ENABLED) };
    // SAFETY: every interrupt that is enabled has its handler bound.
    unsafe { avr_device::interrupt::enable() };
    loop {
        avr_device::interrupt::disable();
        // SAFETY: reads a plain storage register; interrupts are off.
        let work = unsafe { WORK.read_volatile() } & WORK_BIT != 0;
        if work {
            // SAFETY: as above.
            unsafe {
                WORK.write_volatile(WORK.read_volatile() & !WORK_BIT);
                avr_device::interrupt::enable();
                // SAFETY: called from this one place, never from within itself.
                executor.poll();
            }
        } else {
            // SAFETY: enables interrupts and waits for one; memory may be changed by it.
            unsafe { asm!("sei", "sleep") };
        }
    }
}
