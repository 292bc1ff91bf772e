//! The roll call of tasks: the watchdog is fed only if each task on the roll was polled.
//!
//! Twice within the watchdog's time the board [calls](Roll::call) the roll, which wakes every task on it. Each task
//! signs when it is polled; a task that waits for the bus signs and goes on waiting. The last signature
//! [feeds](Watchdog::feed) the watchdog. If a task does not return from its poll, or keeps the others from running,
//! the watchdog resets the board.
//!
//! ```
//! use multidrop_apps::demo_unit::DemoUnit;
//! use multidrop::roll::Watchdog;
//! use multidrop::{Line, ServerPort, Roll, Shared, signed};
//!
//! /// The body of the second of two tasks.
//! async fn serve<L: Line, W: Watchdog>(roll: &Roll<W, 2>, port: &'static ServerPort<L>) -> ! {
//!     let unit = Shared::new(DemoUnit::new(|_outputs| {}));
//!     signed(|task| roll.sign::<1>(task), multidrop::serve(port, &unit)).await
//! }
//! ```

use core::cell::Cell;
use core::future::Future;
use core::pin::Pin;
use core::task::{Context, Poll, Waker};

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::RawMutex;
use pin_project_lite::pin_project;

/// The watchdog of a board, and the way in which its executor refers to tasks.
pub trait Watchdog: 'static {
    /// Whether the watchdog is used. If not, a roll takes no flash and no RAM.
    const IS_ON: bool;

    /// The mutex that guards the roll.
    type Lock: RawMutex;

    /// Reference to a task, by which it is woken; smaller than a waker where the executor allows.
    type Task: Copy + Send;

    /// The task of a waker.
    fn task(waker: &Waker) -> Self::Task;

    /// Wakes the task.
    fn wake(task: Self::Task);

    /// Called before the roll is. Returns whether everything else of the board works; if not, the roll is not called
    /// and the watchdog resets the board.
    fn is_healthy() -> bool;

    /// Feeds the watchdog: all tasks have signed.
    fn feed();
}

/// The tasks that have signed since the last call.
type Signed<W, const N: usize> = [Cell<Option<<W as Watchdog>::Task>>; N];

/// The roll of `N` tasks. If `N` is 0, the watchdog is fed as long as the executor runs.
pub struct Roll<W: Watchdog, const N: usize> {
    signed: Mutex<W::Lock, Signed<W, N>>,
}

impl<W: Watchdog, const N: usize> Roll<W, N> {
    /// A roll that no task has signed.
    pub const fn new() -> Self {
        Self {
            signed: Mutex::const_new(W::Lock::INIT, [const { Cell::new(None) }; N]),
        }
    }

    /// Signs for the task with number `PLACE`, from 0; the next call wakes that task.
    ///
    /// # Panics
    /// At compile time, if `PLACE` is not below `N`.
    #[inline(always)]
    pub fn sign<const PLACE: usize>(&self, task: &Waker) {
        const {
            assert!(
                PLACE < N,
                "PLACE must be below N, the number of tasks on the roll"
            )
        };
        if W::IS_ON {
            self.signed
                .lock(|signed| Self::sign_in(signed, &signed[PLACE], task));
        }
    }

    #[inline(never)]
    fn sign_in(signed: &Signed<W, N>, own: &Cell<Option<W::Task>>, task: &Waker) {
        if own.get().is_none() {
            own.set(Some(W::task(task)));
            if signed.iter().all(|task| task.get().is_some()) {
                W::feed();
            }
        }
    }

    /// Wakes every task that has signed, and asks for its signature again. For the board.
    #[inline(always)]
    pub fn call(&self) {
        if !W::is_healthy() {
            return;
        }
        if N == 0 {
            W::feed();
        }
        for place in 0..N {
            if let Some(task) = self.signed.lock(|signed| signed[place].take()) {
                W::wake(task);
            }
        }
    }
}

impl<W: Watchdog, const N: usize> Default for Roll<W, N> {
    fn default() -> Self {
        Self::new()
    }
}

pin_project! {
    /// Future of [`signed`].
    pub struct Signing<S, F> {
        sign: S,
        #[pin]
        future: F,
    }
}

/// Wraps `future`: `sign` is called with the task's waker each time the future is polled.
///
/// # Cancellation
/// As safe as that of `future`.
#[inline(always)]
pub fn signed<S: Fn(&Waker), F: Future>(sign: S, future: F) -> Signing<S, F> {
    Signing { sign, future }
}

impl<S: Fn(&Waker), F: Future> Future for Signing<S, F> {
    type Output = F::Output;

    #[inline(always)]
    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<F::Output> {
        let this = self.project();
        (this.sign)(context.waker());
        this.future.poll(context)
    }
}
