//! The watchdog (DS 11.8, 11.9.2).
//!
//! It runs in its interrupt-and-reset mode with half of its time: when a half is over its interrupt has the executor call what
//! [`run_watched`](crate::executor::run_watched) was given, and [`feed`] arms the interrupt again. If that was not called when the
//! next half is over, the chip is reset; so it is if interrupts are off. It needs no timer and costs an interrupt of some cycles
//! in each half.
//!
//! A frame that a task keeps for longer than the longest frame takes and the watchdog's time withholds the feeding.
//!
//! The old boot loader of Nanos (ATmegaBOOT) does not turn the watchdog off that runs after its reset, and loops for ever:
//! with that one it must not be used.

use multidrop_protocol::message::Message;

use crate::timer1::PRESCALER;

#[cfg(not(feature = "bare"))]
pub use running::feed;
#[cfg(not(feature = "bare"))]
pub(crate) use running::{frame_is_back, half_is_over, hasten};

/// Nothing to feed.
#[cfg(feature = "bare")]
pub fn feed() {}

/// Whether there is a watchdog: not where the image is built without guards.
pub const CAN_RUN: bool = !cfg!(feature = "bare");

/// Says that the watchdog's interrupt is bound. [`bind_interrupts!`](crate::bind_interrupts) implements it.
///
/// # Safety
/// The handler has to be in the binary.
#[diagnostic::on_unimplemented(
    message = "the interrupt of the watchdog is not bound: name WATCHDOG in bind_interrupts!",
    label = "`{Self}` does not bind it"
)]
pub unsafe trait Bound {}

/// The times that there are, in ms.
const TIMES_MS: [u32; 9] = [32, 64, 125, 250, 500, 1000, 2000, 4000, 8000];

/// The time of the watchdog.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Watchdog {
    /// Half of it is 16 ms shifted by this.
    step: u8,
}

impl Watchdog {
    /// Two seconds.
    pub const DEFAULT: Self = Self::ms::<2000>();

    /// A time in ms: 32, 64, 125, 250, 500, 1000, 2000, 4000 or 8000, by an oscillator that is off by some 10 % (DS 30.9).
    ///
    /// # Panics
    /// At compile time, for any other.
    pub const fn ms<const MS: u32>() -> Self {
        const { Self::of(MS) }
    }

    const fn of(ms: u32) -> Self {
        let mut step = 0;
        while step < TIMES_MS.len() {
            if TIMES_MS[step] == ms {
                return Self { step: step as u8 };
            }
            step += 1;
        }
        Message::new()
            .text("watchdog is ")
            .number(ms)
            .text(" ms, must be 32, 64, 125, 250, 500, 1000, 2000, 4000 or 8000")
            .fail()
    }

    /// Half of the time in units of 1024 ticks of Timer1, an eighth less: the oscillator may be too fast. At most 8750.
    pub const fn half(self, clock_hz: u32) -> u16 {
        (((clock_hz / PRESCALER / 1000 * 16 * 7 / 8) << self.step) / 1024) as u16
    }

    /// Starts the watchdog, whose interrupt the token binds. At the start of `main`, where interrupts are off, behind
    /// [`keep_cause`](crate::fault::keep_cause).
    #[cfg(not(feature = "bare"))]
    #[inline(always)]
    pub fn start(self, _: impl Bound) {
        running::start(self.step);
    }
}

/// Turns the watchdog off, which runs on after a reset of its own (DS 11.9.2, WDE). As [`Watchdog::start`].
#[cfg(not(feature = "bare"))]
#[inline(always)]
pub fn stop() {
    running::set(0);
}

#[cfg(not(feature = "bare"))]
mod running {
    use core::cell::Cell;

    /// WDTCSR and its bits.
    const WDTCSR: *mut u8 = 0x60 as *mut u8;
    const WDIE: u8 = 1 << 6;
    const WDP3: u8 = 1 << 5;
    const WDCE: u8 = 1 << 4;
    const WDE: u8 = 1 << 3;

    /// Sets WDTCSR, which takes a change within four cycles of WDCE only. Interrupts must be off.
    #[inline(always)]
    pub fn set(control: u8) {
        // SAFETY: the timed sequence of DS 11.8.2; the values are in registers before it.
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

    /// Has it reset the chip in 16 ms if it runs at all.
    #[inline(always)]
    pub fn hasten() {
        // SAFETY: reading has no effect.
        if unsafe { WDTCSR.read_volatile() } & WDE != 0 {
            set(WDE);
        }
    }

    #[inline(always)]
    pub fn start(step: u8) {
        set(WDIE | WDE | step & 7 | if step > 7 { WDP3 } else { 0 });
    }

    /// For how long a frame is lent, as is seen when halves of the watchdog's time are over: in units of 1024 ticks.
    static LENT: Lent = Lent(Cell::new(0));

    struct Lent(Cell<u16>);

    // SAFETY: tasks and the executor's loop use it, one after the other.
    unsafe impl Sync for Lent {}

    /// A half of the time, so many units, is over. Whether no frame is lent for longer than the longest takes, so many units, and
    /// the watchdog's time, which is two halves, and the half in which it was lent.
    #[inline(always)]
    pub fn half_is_over(half: u16, is_lent: bool, longest: u16) -> bool {
        // `frame_is_back` has set it to 0.
        if !is_lent {
            return true;
        }
        let lent = LENT.0.get() + half;
        LENT.0.set(lent);
        lent <= longest + half * 3
    }

    /// The frame is given back.
    #[inline(always)]
    pub fn frame_is_back() {
        LENT.0.set(0);
    }

    /// Arms the interrupt again.
    #[inline(always)]
    pub fn feed() {
        crate::stack::check();
        // SAFETY: without the timed sequence only WDIE changes (DS 11.9.2).
        unsafe { WDTCSR.write_volatile(WDTCSR.read_volatile() | WDIE) };
    }

    /// WATCHDOG (DS 12.4: vector 6, counted from 0): has the executor call what feeds it.
    #[unsafe(naked)]
    #[unsafe(no_mangle)]
    extern "C" fn __vector_6() {
        core::arch::naked_asm!(
            "sbi 0x1E, {bit}",
            "reti",
            bit = const crate::executor::WATCHDOG_BIT,
        )
    }
}
