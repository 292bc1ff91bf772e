//! A driver for `embassy-time` on Timer1's compare A.
//!
//! It is linked only into a binary that names `TIME` in [`bind_interrupts!`](crate::bind_interrupts). Alarms are kept in
//! slots, one for each task that waits ([`SLOTS`] by default). Only the conversions of `embassy-time` itself use 64-bit
//! arithmetic.
//! The tick of `embassy-time` (its `tick-hz-...` feature) is scaled from the timer's with a
//! remainder, so no time is lost at clocks such as 11.0592 MHz.
//!
//! Searching the alarms and waking tasks takes about 1000 cycles, which is longer than a character at fast rates. So
//! the interrupt of the alarm only sets a flag, and the executor's loop does the rest, with interrupts on.

use core::cell::{Cell, UnsafeCell};
use core::task::Waker;

use avr_device::interrupt;
use critical_section::{CriticalSection, Mutex};
use embassy_time_driver::{Driver, TICK_HZ};
use multidrop_protocol::message::Message;

use crate::executor::{self, TIME};
use crate::timer1::{self, OCF1A, PRESCALER, TOV1};

/// The number of tasks that may wait at a time, unless [`bind_interrupts!`](crate::bind_interrupts) sets another; 8 bytes
/// of RAM each. A task counts once, however many timers it waits for. A task that finds no free slot is woken at once and
/// tries again: it is still in time, but meanwhile the CPU does not sleep.
pub const SLOTS: usize = 4;

/// The maximum number of slots, since all are searched for each alarm.
pub const SLOTS_MAX: usize = 32;

/// How far ahead an alarm is set at most, in ticks of `embassy-time`. A later alarm wakes its task early, and the
/// task sets it again.
const HORIZON: u32 = 1 << 30;

struct Alarm {
    at: u32,
    waker: Waker,
}

/// The alarms. Tasks and the executor's loop use them, one after the other. A `heapless::Vec` of them takes 130 to 680 bytes
/// of flash more.
struct Alarms<const SLOTS: usize>(UnsafeCell<[Option<Alarm>; SLOTS]>);

// SAFETY: see above; interrupts stay away.
unsafe impl<const SLOTS: usize> Sync for Alarms<SLOTS> {}

/// A moment, as it is read with interrupts off.
struct Moment {
    /// The time at the last overflow of Timer1, in ticks of `embassy-time`, and the fraction of a tick beyond it.
    base: u64,
    remainder: u32,
    /// The timer's own count.
    count: u16,
}

/// The driver for a CPU clock of `CLOCK_HZ` and `SLOTS` tasks that wait at a time.
pub struct TimeDriver<const CLOCK_HZ: u32, const SLOTS: usize> {
    /// The time at the last overflow of Timer1, in ticks of `embassy-time`.
    base: Mutex<Cell<u64>>,
    /// The fraction of a tick beyond it, in parts of `DENOMINATOR`.
    remainder: Mutex<Cell<u32>>,
    alarms: Alarms<SLOTS>,
}

impl<const CLOCK_HZ: u32, const SLOTS: usize> TimeDriver<CLOCK_HZ, SLOTS> {
    const NUMERATOR: u32 = TICK_HZ as u32 / common(TICK_HZ as u32, CLOCK_HZ / PRESCALER);
    const DENOMINATOR: u32 = CLOCK_HZ / PRESCALER / common(TICK_HZ as u32, CLOCK_HZ / PRESCALER);
    /// `embassy-time` must not tick faster than the timer, and a whole turn of the timer, scaled,
    /// must fit 32 bits.
    const SCALE_FITS: () = assert!(
        Self::NUMERATOR <= Self::DENOMINATOR && Self::NUMERATOR < 1 << 15,
        "embassy-time's tick-hz must be at most an eighth of the clock, and a simple fraction of it"
    );

    /// A turn of the timer in ticks of `embassy-time`, and the remainder.
    const TURN: u32 = 0x1_0000 * Self::NUMERATOR / Self::DENOMINATOR;
    const TURN_REST: u32 = 0x1_0000 * Self::NUMERATOR % Self::DENOMINATOR;

    const SLOTS_FIT: () = if SLOTS == 0 || SLOTS > SLOTS_MAX {
        Message::new()
            .text("TIME: slots is ")
            .number(SLOTS as u32)
            .text(", must be 1..=")
            .number(SLOTS_MAX as u32)
            .fail()
    };

    /// A driver for a `static`, whose time begins at `begin` ticks of `embassy-time`; for
    /// [`bind_interrupts!`](crate::bind_interrupts).
    #[doc(hidden)]
    pub const fn new(begin: u64) -> Self {
        const { Self::SCALE_FITS }
        const { Self::SLOTS_FIT }
        Self {
            base: Mutex::new(Cell::new(begin)),
            remainder: Mutex::new(Cell::new(0)),
            alarms: Alarms(UnsafeCell::new([const { None }; SLOTS])),
        }
    }

    /// The time begins.
    #[doc(hidden)]
    #[inline(always)]
    pub fn start(&self) {
        timer1::start();
        critical_section::with(|_| timer1::enable(TOV1));
    }

    /// Serves the alarms if the executor's flags say so.
    #[doc(hidden)]
    #[inline(always)]
    pub fn serve(&self, flags: u8) {
        if flags & TIME != 0 {
            self.serve_alarms();
        }
    }

    /// Counts a turn of the timer.
    ///
    /// # Safety
    /// From the TIMER1_OVF interrupt only.
    #[doc(hidden)]
    pub unsafe fn on_overflow(&self) {
        critical_section::with(|cs| self.turn(cs));
        executor::set(TIME);
    }

    /// # Safety
    /// From the TIMER1_COMPA interrupt only.
    #[doc(hidden)]
    #[inline(always)]
    pub unsafe fn on_alarm(&self) {
        executor::set(TIME);
    }

    fn turn(&self, cs: CriticalSection) {
        let mut ticks = Self::TURN;
        let mut remainder = self.remainder.borrow(cs).get() + Self::TURN_REST;
        if remainder >= Self::DENOMINATOR {
            remainder -= Self::DENOMINATOR;
            ticks += 1;
        }
        self.remainder.borrow(cs).set(remainder);
        let base = self.base.borrow(cs);
        base.set(base.get() + u64::from(ticks));
    }

    fn moment(&self) -> Moment {
        critical_section::with(|cs| {
            let mut count = timer1::now();
            if timer1::registers().tifr1().read().bits() & TOV1 != 0 {
                // The turn is over, but its interrupt has not been executed; the count may be from before it.
                timer1::clear(TOV1);
                self.turn(cs);
                executor::set(TIME);
                count = timer1::now();
            }
            Moment {
                base: self.base.borrow(cs).get(),
                remainder: self.remainder.borrow(cs).get(),
                count,
            }
        })
    }

    /// Ticks since the last turn.
    fn since_turn(moment: &Moment) -> u32 {
        let parts = u32::from(moment.count) * Self::NUMERATOR + moment.remainder;
        parts / Self::DENOMINATOR
    }

    /// Wakes the tasks whose alarms are due, and sets the timer for the next alarm. From a task or the executor's
    /// loop.
    #[inline(never)]
    fn serve_alarms(&self) {
        loop {
            let moment = self.moment();
            let now = (moment.base as u32).wrapping_add(Self::since_turn(&moment));
            let mut soonest = HORIZON;
            // SAFETY: see `Alarms`; to wake a task puts it into a queue and runs nothing.
            for slot in unsafe { &mut *self.alarms.0.get() } {
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
            // Rounded up, so that an alarm is never early; the count is slightly old already.
            let turns = soonest.checked_mul(Self::DENOMINATOR);
            let ticks = turns.and_then(|turns| u16::try_from(turns.div_ceil(Self::NUMERATOR)).ok());
            let is_passed = critical_section::with(|_| {
                let Some(ticks) = ticks else {
                    // The alarm is not in this turn; the end of the turn looks for it again.
                    timer1::disable(OCF1A);
                    return false;
                };
                let at = moment.count.wrapping_add(ticks);
                // SAFETY: any value is a valid compare value.
                timer1::registers().ocr1a().write(|w| unsafe { w.bits(at) });
                timer1::clear(OCF1A);
                timer1::enable(OCF1A);
                timer1::now().wrapping_sub(moment.count) >= ticks
            });
            if !is_passed {
                return;
            }
        }
    }
}

impl<const CLOCK_HZ: u32, const SLOTS: usize> Driver for TimeDriver<CLOCK_HZ, SLOTS> {
    fn now(&self) -> u64 {
        let moment = self.moment();
        moment.base + u64::from(Self::since_turn(&moment))
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        if !interrupt::is_enabled() {
            // This may be an interrupt, while the alarms are in use.
            return waker.wake_by_ref();
        }
        let moment = self.moment();
        let since = Self::since_turn(&moment);
        let left = at.saturating_sub(moment.base + u64::from(since));
        let left = u32::try_from(left).unwrap_or(HORIZON).min(HORIZON);
        let now = (moment.base as u32).wrapping_add(since);
        let at = now.wrapping_add(left);
        {
            // SAFETY: see `Alarms`; nothing that is called here comes back here.
            let alarms = unsafe { &mut *self.alarms.0.get() };
            let own = |slot: &&mut Option<Alarm>| matches!(slot, Some(alarm) if alarm.waker.will_wake(waker));
            let slot = match alarms.iter_mut().find(own) {
                Some(slot) => {
                    // A task may wait for several times at once: the soonest counts, and then the task sets the
                    // others again. An alarm that is due and was not handled is sooner than any.
                    if let Some(alarm) = slot {
                        let before = alarm.at.wrapping_sub(now);
                        if before <= left || before > HORIZON {
                            return;
                        }
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
        self.serve_alarms();
    }
}

/// The greatest common divisor.
const fn common(mut a: u32, mut b: u32) -> u32 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// Stops the build if more tasks are named than there are slots.
#[doc(hidden)]
pub const fn check_slots(slots: usize, tasks: usize) {
    if tasks > slots {
        Message::new()
            .text("TIME: slots is ")
            .number(slots as u32)
            .text(", must be at least ")
            .number(tasks as u32)
            .text(", for that many tasks are named")
            .fail()
    }
}

#[doc(hidden)]
pub use embassy_time_driver::time_driver_impl;
