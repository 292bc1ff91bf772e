//! The chip's watchdog as that of a [`Roll`](multidrop::Roll).

use core::task::Waker;

use embassy_avr_hal::interrupts::Interrupts;
use embassy_avr_hal::watchdog;
use embassy_executor::raw::{TaskRef, task_from_waker, wake_task};
use embassy_sync::blocking_mutex::raw::RawMutex;

use crate::Watchdog;

/// Says that line and watchdog are bound. [`bind_interrupts!`](crate::bind_interrupts) implements it.
#[diagnostic::on_unimplemented(
    message = "`{Self}` has no watchdog for a roll: define it by board_nano::bind_interrupts!",
    label = "not a token of board_nano::bind_interrupts!"
)]
pub trait Bound: Interrupts + watchdog::Bound + multidrop::roll::Watchdog {
    /// The time of the watchdog.
    const TIME: Watchdog;
}

/// Keeps what tasks and the executor's loop use, one after the other, and no interrupt.
#[doc(hidden)]
pub struct OneExecutor;

// SAFETY: there is one executor, and its tasks do not run within each other. `lock` is called by tasks and by the executor's
// loop alone, and what it calls does not come back to it: see `Roll`.
unsafe impl RawMutex for OneExecutor {
    const INIT: Self = Self;

    #[inline(always)]
    fn lock<R>(&self, f: impl FnOnce() -> R) -> R {
        f()
    }
}

/// A task, in half the room of a waker.
#[doc(hidden)]
#[derive(Clone, Copy)]
pub struct Task(TaskRef);

impl Task {
    /// The task of a waker, which is one of embassy-executor's.
    #[inline(always)]
    pub fn of(waker: &Waker) -> Self {
        Self(task_from_waker(waker))
    }

    /// Wakes the task.
    #[inline(always)]
    pub fn wake(self) {
        wake_task(self.0);
    }
}

/// Binds the interrupts of the board and defines the token that says so, which [`init`](crate::init) and
/// [`open`](crate::Closed::open) ask for. It is the watchdog of a [`Roll`](multidrop::Roll) too.
///
/// ```text
/// board_nano::bind_interrupts!(struct Irqs { USART0 => Rs485; });
/// ```
///
/// | written | gives |
/// |---|---|
/// | `USART0 => Rs485;` | the interrupts of the line, which is of this type; always, and first |
/// | `WATCHDOG => Watchdog::ms::<500>();` | another time of the watchdog than [`Watchdog::DEFAULT`]; second |
/// | `TIME => CLOCK_HZ, tasks = [poll, blink];`, `EEPROM;`, `INT0;` and so on | as in [`hal::bind_interrupts!`](crate::hal::bind_interrupts) |
#[macro_export]
macro_rules! bind_interrupts {
    ($vis:vis struct $name:ident { USART0 => $line:ty; WATCHDOG => $time:expr; $($rest:tt)* }) => {
        $crate::hal::bind_interrupts! {
            /// What is bound, and the watchdog.
            $vis struct $name { USART0 => <$line as $crate::OfUsart>::Usart; WATCHDOG; $($rest)* }
        }

        impl $crate::Bound for $name {
            const TIME: $crate::Watchdog = $time;
        }

        impl $crate::RollWatchdog for $name {
            const IS_ON: bool = $crate::options::watchdog() && $crate::hal::watchdog::CAN_RUN;

            type Lock = $crate::OneExecutor;
            type Task = $crate::Task;

            #[inline(always)]
            fn task(waker: &core::task::Waker) -> Self::Task {
                $crate::Task::of(waker)
            }

            #[inline(always)]
            fn wake(task: Self::Task) {
                task.wake();
            }

            #[inline(always)]
            fn is_healthy() -> bool {
                <<$line as $crate::OfUsart>::Usart>::half_is_over(
                    const { <$name as $crate::Bound>::TIME.half($crate::CLOCK_HZ) },
                )
            }

            #[inline(always)]
            fn feed() {
                $crate::hal::watchdog::feed();
            }
        }
    };
    ($vis:vis struct $name:ident { USART0 => $line:ty; $($rest:tt)* }) => {
        $crate::bind_interrupts! {
            $vis struct $name {
                USART0 => $line;
                WATCHDOG => $crate::Watchdog::DEFAULT;
                $($rest)*
            }
        }
    };
    ($($wrong:tt)*) => {
        compile_error!(
            "board_nano::bind_interrupts! begins with the line: `struct Irqs { USART0 => Rs485; }`"
        );
    };
}
