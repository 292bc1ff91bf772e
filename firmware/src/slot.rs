//! Where one task leaves something for another.

use core::cell::Cell;
use core::task::{Context, Poll, Waker};

/// The task that waits for word from another.
pub(crate) struct Waiter(Cell<Option<Waker>>);

impl Waiter {
    /// None.
    pub const fn new() -> Self {
        Self(Cell::new(None))
    }

    /// This one is to be [woken](Self::wake), and no other.
    pub fn wait(&self, context: &Context<'_>) {
        self.0.set(Some(context.waker().clone()));
    }

    /// Wakes the task that waits.
    #[inline(never)]
    pub fn wake(&self) {
        if let Some(waker) = self.0.take() {
            waker.wake();
        }
    }
}

/// Room for one thing, and the task that waits for it. As a `Signal` of `embassy-sync`, but in half the code, and whoever leaves
/// word elsewhere may wake the task too.
pub(crate) struct Slot<T> {
    item: Cell<Option<T>>,
    pub waiter: Waiter,
}

impl<T> Slot<T> {
    /// Empty, and nobody waits.
    pub const fn new() -> Self {
        Self {
            item: Cell::new(None),
            waiter: Waiter::new(),
        }
    }

    /// Leaves something, in place of what is there.
    pub fn put(&self, item: T) {
        self.item.set(Some(item));
        self.waiter.wake();
    }

    /// Takes what is there.
    pub fn take(&self) -> Option<T> {
        self.item.take()
    }

    /// The same, or [waits](Waiter::wait) if nothing is there.
    pub fn poll(&self, context: &Context<'_>) -> Poll<T> {
        match self.take() {
            Some(item) => Poll::Ready(item),
            None => {
                self.waiter.wait(context);
                Poll::Pending
            }
        }
    }
}
