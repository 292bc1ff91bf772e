//! The roll of the tasks that have to be alive: the watchdog is fed only when each of them was polled.
//!
//! Twice within the watchdog's time the board [calls](Roll::call) the roll, which wakes every task on it. Each signs when it is
//! polled; one that waits for the bus signs and waits on. With the last signature the board's watchdog is
//! [fed](Watchdog::feed). A task that does not come back, or one that keeps all others from running, ends at the reset.
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

/// The watchdog of a board, and how its executor knows tasks.
pub trait Watchdog: 'static {
    /// Whether it runs. Where it does not a roll takes no flash and no RAM.
    const IS_ON: bool;

    /// What keeps the roll to one user at a time.
    type Lock: RawMutex;

    /// What a task is woken by: smaller than a waker where the board can.
    type Task: Copy + Send;

    /// The task of a waker.
    fn task(waker: &Waker) -> Self::Task;

    /// Wakes it.
    fn wake(task: Self::Task);

    /// The roll is about to be called: whether there is nothing else that is stuck. If there is, nobody is asked to sign.
    fn may_live() -> bool;

    /// All tasks have signed: gives the board its time anew.
    fn feed();
}

/// Those that have signed since the last call.
type Signed<W, const N: usize> = [Cell<Option<<W as Watchdog>::Task>>; N];

/// The roll of `N` tasks. With none the watchdog is fed as long as the executor runs.
pub struct Roll<W: Watchdog, const N: usize> {
    signed: Mutex<W::Lock, Signed<W, N>>,
}

impl<W: Watchdog, const N: usize> Roll<W, N> {
    /// Nobody has signed.
    pub const fn new() -> Self {
        Self {
            signed: Mutex::const_new(W::Lock::INIT, [const { Cell::new(None) }; N]),
        }
    }

    /// Signs for task `PLACE`, which is woken by the next call.
    ///
    /// # Panics
    /// At compile time, for a place that the roll does not have.
    #[inline(always)]
    pub fn sign<const PLACE: usize>(&self, task: &Waker) {
        const { assert!(PLACE < N, "the roll has no such place") };
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

    /// Wakes every task that has signed, and wants its signature anew. For the board.
    #[inline(always)]
    pub fn call(&self) {
        if !W::may_live() {
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
    /// [`signed`].
    pub struct Signing<S, F> {
        sign: S,
        #[pin]
        future: F,
    }
}

/// `future`, and `sign` is called with the task's waker each time it is polled.
///
/// # Cancellation
/// As `future`.
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
