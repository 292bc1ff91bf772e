//! The handling of panics, faults of the CPU and interrupts without a handler: every DE goes down, the cause is kept, and the chip
//! is reset. Otherwise the CPU would stop with DE as it was, and block the bus.

use core::arch::naked_asm;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;

use cortex_m::peripheral::SCB;
use cortex_m_rt::exception;
use embassy_stm32::pac::RCC;
use multidrop::ResetCause;

use crate::platform::PRIORITY_GROUPS;
use crate::usart::registers;

/// The data that a reset keeps: RAM keeps its contents, and the start-up code leaves `.uninit` alone.
#[repr(C)]
struct Kept {
    mark: u32,
}

struct KeptCell(UnsafeCell<MaybeUninit<Kept>>);

// SAFETY: written where no other code runs any more, read once at the start.
unsafe impl Sync for KeptCell {}

#[unsafe(link_section = ".uninit.fault")]
static KEPT: KeptCell = KeptCell(UnsafeCell::new(MaybeUninit::uninit()));

/// Marks a reset by this code. RAM has other contents, by chance, after power-up.
const MARK: u32 = 0xDEAD_FA17;

/// Takes every driver off the bus, keeps a fault as the cause, and resets the chip.
pub(crate) fn reset() -> ! {
    cortex_m::interrupt::disable();
    registers::lower_all_de();
    let kept = KEPT.0.get().cast::<Kept>();
    // SAFETY: interrupts are off; the mark may be any word. Volatile, since this program does not read it.
    unsafe { (&raw mut (*kept).mark).write_volatile(MARK) };
    // The mark has to be in RAM, and DE down, before the reset (PM0214 4.4.5 demands the key; SYSRESETREQ is bit 2).
    cortex_m::asm::dsb();
    const VECTKEY: u32 = 0x05FA << 16;
    const SYSRESETREQ: u32 = 1 << 2;
    // SAFETY: the reset is wanted; the priority groups stay as they are until then.
    unsafe {
        (*SCB::PTR)
            .aircr
            .write(VECTKEY | PRIORITY_GROUPS | SYSRESETREQ)
    };
    cortex_m::asm::dsb();
    loop {
        cortex_m::asm::nop();
    }
}

/// The cause of the chip's start. Reading it clears the flags, so that the next start does not find them: to be called once.
pub(crate) fn cause() -> ResetCause {
    // RM0090 7.3.21: an internal reset pulls the pin too, so PINRSTF says least. Power-up sets BORRSTF as well.
    let flags = RCC.csr().read();
    RCC.csr().modify(|w| w.set_rmvf(true));
    let kept = KEPT.0.get().cast::<Kept>();
    // SAFETY: as in `reset`; before the first write the mark may be any word.
    let is_fault = unsafe {
        let mark = (&raw const (*kept).mark).read_volatile();
        (&raw mut (*kept).mark).write_volatile(0);
        mark == MARK
    };
    if is_fault {
        ResetCause::Fault
    } else if flags.porrstf() {
        ResetCause::Power
    } else if flags.borrstf() {
        ResetCause::BrownOut
    } else if flags.wdgrstf() || flags.wwdgrstf() {
        ResetCause::Watchdog
    } else if flags.sftrstf() || flags.lpwrrstf() || !flags.padrstf() {
        ResetCause::Other
    } else {
        ResetCause::Pin
    }
}

/// Handles panics (they are compiled to `udf`), and all faults that have no handler of their own. The stack begins anew: the stack
/// itself may be the fault.
///
/// # Safety
/// Only the vector table may refer to this.
#[unsafe(naked)]
#[unsafe(export_name = "HardFault")]
unsafe extern "C" fn hard_fault() -> ! {
    naked_asm!("ldr r0, =_stack_start", "mov sp, r0", "b {reset}", reset = sym fault)
}

extern "C" fn fault() -> ! {
    reset()
}

/// Handles every other exception and interrupt without a handler.
#[exception]
unsafe fn DefaultHandler(_interrupt: i16) -> ! {
    reset()
}
