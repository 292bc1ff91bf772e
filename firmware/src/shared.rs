//! A data model shared between the serve task and the application's own tasks.

use core::cell::RefCell;

/// A value that several tasks of one executor use, one at a time and never across an await.
///
/// Access is through a closure, which cannot await: what one task does in it is atomic towards every
/// other task, a block write by a client as much as the application's own updates.
pub struct Shared<M> {
    value: RefCell<M>,
}

impl<M> Shared<M> {
    /// Takes the value.
    pub const fn new(value: M) -> Self {
        Self {
            value: RefCell::new(value),
        }
    }

    /// Runs `f` with the value.
    ///
    /// # Panics
    /// If called from within `f` on the same value.
    pub fn with<R>(&self, f: impl FnOnce(&mut M) -> R) -> R {
        f(&mut self.value.borrow_mut())
    }
}
