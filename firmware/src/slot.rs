//! A slot in which one task leaves an item for another.

use core::cell::Cell;
use core::task::{Context, Poll, Waker};

/// The task that waits for another task.
pub(crate) struct Waiter(Cell<Option<Waker>>);

impl Waiter {
    /// No task waits.
    pub const fn new() -> Self {
        Self(Cell::new(None))
    }

    /// Registers this task to be [woken](Self::wake), in place of any other.
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

/// Holds one item, and the task that waits for it. Like a `Signal` of `embassy-sync`, but half the code; another
/// event may wake the task too.
pub(crate) struct Slot<T> {
    item: Cell<Option<T>>,
    pub waiter: Waiter,
}

impl<T> Slot<T> {
    /// An empty slot for which no task waits.
    pub const fn new() -> Self {
        Self {
            item: Cell::new(None),
            waiter: Waiter::new(),
        }
    }

    /// Puts an item in the slot, in place of the old one.
    pub fn put(&self, item: T) {
        self.item.set(Some(item));
        self.waiter.wake();
    }

    /// Takes the item.
    pub fn take(&self) -> Option<T> {
        self.item.take()
    }

    /// Takes the item, or [waits](Waiter::wait) if the slot is empty.
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
