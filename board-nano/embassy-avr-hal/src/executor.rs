//! An Embassy executor that sleeps.
//!
//! The AVR executor of embassy-executor tests its flag between `sei` and `sleep` and never sets SMCR.SE: a wake-up
//! between the two is lost, and the CPU never sleeps. This executor tests the flag with interrupts off, and `sei`
//! stands right before `sleep`: the instruction after `sei` is executed before any pending interrupt (DS 7.7), so an
//! interrupt either is seen by the test or wakes the CPU.

use core::arch::asm;
use core::cell::UnsafeCell;

use embassy_executor::{Spawner, raw};
use embassy_sync::waitqueue::WakerRegistration;

use crate::interrupts::{Interrupts, Unwatched};
use crate::{edge, watchdog};

/// GPIOR0 (DS 8.6.6), which `sbi` and `sbic` can address: setting a flag is one instruction, in interrupts too.
const FLAGS: *mut u8 = 0x3E as *mut u8;
/// A task is in the queue.
const WORK: u8 = 1 << 0;
/// An alarm of `embassy-time` may be due; 1 and 2 are those of [`RECEIVER`] and [`USER`].
pub(crate) const TIME: u8 = 1 << 3;
/// An edge has come for which a task waits.
pub(crate) const EDGE: u8 = 1 << 4;

/// The bit of the flag by which the watchdog's interrupt reports that half of its time has passed.
#[cfg(not(feature = "bare"))]
pub(crate) const WATCHDOG_BIT: u8 = 4;

/// Sets one flag.
#[inline(always)]
pub(crate) fn set(flag: u8) {
    // SAFETY: GPIOR0 is a plain storage register; `sbi` is atomic.
    unsafe { FLAGS.write_volatile(FLAGS.read_volatile() | flag) }
}

/// A waker that an interrupt leaves to the executor. Waking a task takes about 200 cycles and all registers that a
/// function may change; setting a flag takes two cycles.
pub(crate) struct Deferred<const FLAG: u8>(UnsafeCell<WakerRegistration>);

// SAFETY: tasks register and the loop of `run` wakes, one after the other; interrupts only set the flag.
unsafe impl<const FLAG: u8> Sync for Deferred<FLAG> {}

/// The task that waits for a frame from the line.
pub(crate) static RECEIVER: Deferred<{ 1 << 1 }> = Deferred::new();
/// The task that has the frame, or waits to transmit.
pub(crate) static USER: Deferred<{ 1 << 2 }> = Deferred::new();

impl<const FLAG: u8> Deferred<FLAG> {
    const fn new() -> Self {
        Self(UnsafeCell::new(WakerRegistration::new()))
    }

    /// Registers the task to be woken. From a task, never from an interrupt.
    pub fn register(&self, waker: &core::task::Waker) {
        // SAFETY: see `Sync`; nothing called from here comes back here.
        unsafe { &mut *self.0.get() }.register(waker);
    }

    /// Requests the executor to wake the task.
    #[inline(always)]
    pub fn wake(&self) {
        set(FLAG);
    }

    /// Wakes the task if its flag is among these.
    fn wake_if(&self, flags: u8) {
        if flags & FLAG != 0 {
            // SAFETY: see `Sync`; waking puts a task into the queue and runs nothing.
            unsafe { &mut *self.0.get() }.wake();
        }
    }
}

/// SMCR: sleep mode idle, sleep enabled (DS 10.11.1). Idle stops the CPU only; USART and timer run.
const SMCR: *mut u8 = 0x53 as *mut u8;
const IDLE_ENABLED: u8 = 0b0000_0001;

#[unsafe(export_name = "__pender")]
fn pender(_context: *mut ()) {
    set(WORK);
}

/// Runs tasks for ever. `init` spawns the first of them; interrupts are enabled after it, and the time begins before it where the
/// token binds `TIME`.
///
/// To be called once, from `main`, with the token of [`bind_interrupts!`](crate::bind_interrupts). One that binds `WATCHDOG` is for
/// [`run_watched`].
#[inline(always)]
pub fn run<I: Interrupts + Unwatched>(_: I, init: impl FnOnce(Spawner)) -> ! {
    I::start();
    run_with(init, I::serve)
}

/// Runs tasks for ever like [`run`], with the watchdog: `on_half` is called whenever half of its time has passed, and must
/// have it [fed](watchdog::feed).
#[inline(always)]
pub fn run_watched<I: Interrupts + watchdog::Bound>(
    _: I,
    init: impl FnOnce(Spawner),
    on_half: impl Fn(),
) -> ! {
    I::start();
    run_with(init, |flags| {
        I::serve(flags);
        #[cfg(not(feature = "bare"))]
        if flags & 1 << WATCHDOG_BIT != 0 {
            on_half();
        }
        #[cfg(feature = "bare")]
        let _ = &on_half;
    })
}

/// Runs tasks for ever. `see_to` gets the flags before tasks are polled.
#[inline(always)]
fn run_with(init: impl FnOnce(Spawner), see_to: impl Fn(u8)) -> ! {
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
        // SAFETY: a plain storage register; interrupts are off.
        let flags = unsafe { FLAGS.read_volatile() };
        if flags == 0 {
            // SAFETY: enables interrupts and waits for one; memory may be changed by it.
            unsafe { asm!("sei", "sleep") };
            continue;
        }
        // SAFETY: as above; the flags that were set are handled below.
        unsafe {
            FLAGS.write_volatile(0);
            avr_device::interrupt::enable();
        }
        RECEIVER.wake_if(flags);
        USER.wake_if(flags);
        edge::wake_if(flags);
        see_to(flags);
        // SAFETY: called from this one place, never from within itself.
        unsafe { executor.poll() };
    }
}
