//! The watchdog (DS 11.8, 11.9.2).
//!
//! It runs in its interrupt-and-reset mode with half of its time: after each half, its interrupt lets the executor call the
//! function that [`run_watched`](crate::executor::run_watched) was given, and [`feed`] arms the interrupt again. If that was not
//! called by the end of the next half, or if interrupts are off, the chip is reset. This needs no timer, and costs an interrupt
//! of some cycles in each half.
//!
//! A task may keep a frame for the time of the longest frame plus the watchdog's time; after that the watchdog is not
//! fed.
//!
//! The old boot loader of Nanos (ATmegaBOOT) does not turn off the watchdog that runs after its reset, and loops for
//! ever: the watchdog must not be used with it.

use multidrop_protocol::message::Message;

use crate::timer1::PRESCALER;

#[cfg(not(feature = "bare"))]
pub use running::feed;
#[cfg(not(feature = "bare"))]
pub(crate) use running::hasten;
#[cfg(all(feature = "modbus", not(feature = "bare")))]
pub(crate) use running::{frame_is_back, half_is_over};

/// Does nothing: there is no watchdog to feed.
#[cfg(feature = "bare")]
pub fn feed() {}

/// Whether there is a watchdog: not in an image that is built bare.
pub const CAN_RUN: bool = !cfg!(feature = "bare");

/// Marks that the watchdog's interrupt is bound. [`bind_interrupts!`](crate::bind_interrupts) implements it.
///
/// # Safety
/// The handler must be in the binary.
#[diagnostic::on_unimplemented(
    message = "the interrupt of the watchdog is not bound: name WATCHDOG in bind_interrupts!",
    label = "`{Self}` does not bind it"
)]
pub unsafe trait Bound {}

/// The times of the watchdog, in ms.
const TIMES_MS: [u32; 9] = [32, 64, 125, 250, 500, 1000, 2000, 4000, 8000];

/// The time of the watchdog.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Watchdog {
    /// Half of the time is 16 ms shifted by this.
    step: u8,
}

impl Watchdog {
    /// The default of two seconds.
    pub const DEFAULT: Self = Self::ms::<2000>();

    /// A time in ms: 32, 64, 125, 250, 500, 1000, 2000, 4000 or 8000, by an oscillator that is off by about 10 % (DS
    /// 30.9).
    ///
    /// # Panics
    /// At compile time, for any other value.
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

    /// Starts the watchdog, whose interrupt the token binds. To be called at the start of `main`, where interrupts are off, behind
    /// [`keep_cause`](crate::fault::keep_cause).
    #[cfg(not(feature = "bare"))]
    #[inline(always)]
    pub fn start(self, _: impl Bound) {
        running::start(self.step);
    }
}

/// Turns off the watchdog, which runs on after it has reset the chip (DS 11.9.2, WDE). To be called as [`Watchdog::start`].
#[cfg(not(feature = "bare"))]
#[inline(always)]
pub fn stop() {
    running::set(0);
}

#[cfg(not(feature = "bare"))]
mod running {
    #[cfg(feature = "modbus")]
    use core::cell::Cell;

    /// WDTCSR and its bits.
    const WDTCSR: *mut u8 = 0x60 as *mut u8;
    const WDIE: u8 = 1 << 6;
    const WDP3: u8 = 1 << 5;
    const WDCE: u8 = 1 << 4;
    const WDE: u8 = 1 << 3;

    /// Sets WDTCSR, which can be changed only within four cycles of WDCE. Interrupts must be off.
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

    /// Lets the watchdog reset the chip in 16 ms, if it runs.
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

    /// How long a frame has been lent, counted at each half of the watchdog's time: in units of 1024 ticks.
    #[cfg(feature = "modbus")]
    static LENT: Lent = Lent(Cell::new(0));

    #[cfg(feature = "modbus")]
    struct Lent(Cell<u16>);

    // SAFETY: tasks and the executor's loop use it, one after the other.
    #[cfg(feature = "modbus")]
    unsafe impl Sync for Lent {}

    /// Counts a half of the time, in units of 1024 ticks. Returns whether no frame is lent for longer than the
    /// longest frame takes, plus the watchdog's time, which is two halves, plus the half in which it was lent.
    #[cfg(feature = "modbus")]
    #[inline(always)]
    pub fn half_is_over(half: u16, is_lent: bool, longest: u16) -> bool {
        // `frame_is_back` has set the time to 0.
        if !is_lent {
            return true;
        }
        let lent = LENT.0.get() + half;
        LENT.0.set(lent);
        lent <= longest + half * 3
    }

    /// The frame was given back.
    #[cfg(feature = "modbus")]
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

    /// WATCHDOG (DS 12.4: vector 6, counted from 0): lets the executor call what feeds it.
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
