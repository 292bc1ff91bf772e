//! A driver for `embassy-time` on Timer1's compare A.
//!
//! It is linked only into a binary that binds it with [`bind_time!`](crate::bind_time). Alarms are
//! kept in a few slots; 64-bit arithmetic is left to the conversions that `embassy-time` itself makes.
//! The tick of `embassy-time` (its `tick-hz-...` feature) is scaled from the timer's with a
//! remainder, so no time is lost at clocks such as 11.0592 MHz.

use core::cell::{Cell, RefCell};
use core::task::Waker;

use critical_section::{CriticalSection, Mutex};
use embassy_time_driver::{Driver, TICK_HZ};

use crate::timer1::{self, OCF1A, PRESCALER, TOV1};

/// Alarms at a time. A task that finds no free slot is woken at once and tries again: it costs time
/// asleep, not correctness.
const SLOTS: usize = 4;

/// How far ahead an alarm is set at most, in ticks of `embassy-time`. A later one wakes its task early,
/// and the task asks again.
const HORIZON: u32 = 1 << 30;

/// A compare value this near might be passed before it is written.
const NEAR: u16 = 16;

struct Alarm {
    at: u32,
    waker: Waker,
}

/// The driver for a CPU clock of `CLOCK_HZ`.
pub struct TimeDriver<const CLOCK_HZ: u32> {
    /// Time at the last overflow of Timer1, in ticks of `embassy-time`.
    base: Mutex<Cell<u64>>,
    /// What of it was not a whole tick, in parts of `DENOMINATOR`.
    remainder: Mutex<Cell<u32>>,
    alarms: Mutex<RefCell<[Option<Alarm>; SLOTS]>>,
}

impl<const CLOCK_HZ: u32> TimeDriver<CLOCK_HZ> {
    const NUMERATOR: u32 = TICK_HZ as u32 / common(TICK_HZ as u32, CLOCK_HZ / PRESCALER);
    const DENOMINATOR: u32 = CLOCK_HZ / PRESCALER / common(TICK_HZ as u32, CLOCK_HZ / PRESCALER);
    /// `embassy-time` must not tick faster than the timer, and a whole turn of the timer, scaled,
    /// must fit 32 bits.
    const SCALE_FITS: () = assert!(
        Self::NUMERATOR <= Self::DENOMINATOR && Self::NUMERATOR < 1 << 15,
        "embassy-time's tick-hz must be at most an eighth of the clock, and a simple fraction of it"
    );

    /// A driver for a `static`; see [`bind_time!`](crate::bind_time).
    #[doc(hidden)]
    pub const fn new() -> Self {
        const { Self::SCALE_FITS }
        Self {
            base: Mutex::new(Cell::new(0)),
            remainder: Mutex::new(Cell::new(0)),
            alarms: Mutex::new(RefCell::new([const { None }; SLOTS])),
        }
    }

    /// Starts the time. To be called once, before the first use of `embassy-time`.
    pub fn start(&self) {
        timer1::start();
        critical_section::with(|_| timer1::enable(TOV1));
    }

    /// One turn of the timer is over.
    ///
    /// # Safety
    /// From the TIMER1_OVF interrupt only.
    #[doc(hidden)]
    pub unsafe fn on_overflow(&self) {
        critical_section::with(|cs| {
            self.turn(cs);
            self.serve_alarms(cs);
        });
    }

    /// # Safety
    /// From the TIMER1_COMPA interrupt only.
    #[doc(hidden)]
    pub unsafe fn on_alarm(&self) {
        critical_section::with(|cs| self.serve_alarms(cs));
    }

    fn turn(&self, cs: CriticalSection) {
        let parts = 0x1_0000 * Self::NUMERATOR + self.remainder.borrow(cs).get();
        self.remainder.borrow(cs).set(parts % Self::DENOMINATOR);
        let base = self.base.borrow(cs);
        base.set(base.get() + u64::from(parts / Self::DENOMINATOR));
    }

    /// Ticks since the last turn, and the timer's own count.
    fn since_turn(&self, cs: CriticalSection) -> (u32, u16) {
        let mut count = timer1::now();
        if timer1::registers().tifr1().read().bits() & TOV1 != 0 {
            // The turn is over but its interrupt has not run; the count may be from before it.
            timer1::clear(TOV1);
            self.turn(cs);
            count = timer1::now();
        }
        let parts = u32::from(count) * Self::NUMERATOR + self.remainder.borrow(cs).get();
        (parts / Self::DENOMINATOR, count)
    }

    fn serve_alarms(&self, cs: CriticalSection) {
        loop {
            let (since, count) = self.since_turn(cs);
            let now = (self.base.borrow(cs).get() as u32).wrapping_add(since);
            let mut soonest = HORIZON;
            for slot in self.alarms.borrow(cs).borrow_mut().iter_mut() {
                let Some(alarm) = slot else { continue };
                let left = alarm.at.wrapping_sub(now);
                if left == 0 || left > HORIZON {
                    if let Some(alarm) = slot.take() {
                        alarm.waker.wake();
                    }
                } else {
                    soonest = soonest.min(left);
                }
            }
            timer1::disable(OCF1A);
            let Some(turns) = soonest.checked_mul(Self::DENOMINATOR) else {
                return;
            };
            // Never early: rounded up, and the count is a little old already.
            let Ok(ticks) = u16::try_from(turns.div_ceil(Self::NUMERATOR)) else {
                return;
            };
            let ticks = ticks.max(NEAR);
            // SAFETY: any value is a valid compare value.
            timer1::registers()
                .ocr1a()
                .write(|w| unsafe { w.bits(count.wrapping_add(ticks)) });
            timer1::clear(OCF1A);
            timer1::enable(OCF1A);
            if timer1::now().wrapping_sub(count) < ticks {
                return;
            }
        }
    }
}

impl<const CLOCK_HZ: u32> Default for TimeDriver<CLOCK_HZ> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const CLOCK_HZ: u32> Driver for TimeDriver<CLOCK_HZ> {
    fn now(&self) -> u64 {
        critical_section::with(|cs| {
            let (since, _) = self.since_turn(cs);
            self.base.borrow(cs).get() + u64::from(since)
        })
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|cs| {
            let (since, _) = self.since_turn(cs);
            let left = at.saturating_sub(self.base.borrow(cs).get() + u64::from(since));
            let left = u32::try_from(left).unwrap_or(HORIZON).min(HORIZON);
            let at = (self.base.borrow(cs).get() as u32)
                .wrapping_add(since)
                .wrapping_add(left);
            {
                let mut alarms = self.alarms.borrow(cs).borrow_mut();
                let own = |slot: &&mut Option<Alarm>| matches!(slot, Some(alarm) if alarm.waker.will_wake(waker));
                let slot = match alarms.iter_mut().find(own) {
                    Some(slot) => {
                        // A task may wait for several times at once: the soonest counts, at that one
                        // it asks for the others again.
                        if let Some(alarm) = slot
                            && at.wrapping_sub(alarm.at) < HORIZON
                        {
                            return;
                        }
                        slot
                    }
                    None => match alarms.iter_mut().find(|slot| slot.is_none()) {
                        Some(slot) => slot,
                        None => return waker.wake_by_ref(),
                    },
                };
                *slot = Some(Alarm {
                    at,
                    waker: waker.clone(),
                });
            }
            self.serve_alarms(cs);
        });
    }
}

/// The greatest common divisor.
const fn common(mut a: u32, mut b: u32) -> u32 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// Makes `embassy-time` work in this binary, at a CPU clock of the given Hz: defines the driver and binds its
/// two interrupts (DS 12.4: vectors 11 and 13, counted from 0). Call `start_time()`, which it defines,
/// before the first use.
#[macro_export]
macro_rules! bind_time {
    ($clock_hz:expr) => {
        use time_interrupts::start_time;

        #[doc(hidden)]
        mod time_interrupts {
            use super::*;

            $crate::time::time_driver_impl!(
                static DRIVER: $crate::time::TimeDriver<{ $clock_hz }> = $crate::time::TimeDriver::new()
            );

            pub fn start_time() {
                DRIVER.start();
            }

            #[unsafe(no_mangle)]
            extern "avr-interrupt" fn __vector_11() {
                // SAFETY: TIMER1_COMPA.
                unsafe { DRIVER.on_alarm() }
            }

            #[unsafe(no_mangle)]
            extern "avr-interrupt" fn __vector_13() {
                // SAFETY: TIMER1_OVF.
                unsafe { DRIVER.on_overflow() }
            }
        }
    };
}

pub use embassy_time_driver::time_driver_impl;
