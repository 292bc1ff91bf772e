//! A data model shared between the serve task and the application's own tasks.

use core::cell::RefCell;

/// A value that the tasks of one executor share.
///
/// Access is through a closure, which cannot await. So each access is atomic towards all other tasks: a block write
/// by a client as well as an update by the application.
pub struct Shared<M> {
    value: RefCell<M>,
}

impl<M> Shared<M> {
    /// Wraps a value.
    pub const fn new(value: M) -> Self {
        Self {
            value: RefCell::new(value),
        }
    }

    /// Calls `f` with the value, and returns its result.
    ///
    /// # Panics
    /// If `f` itself calls `with` on this value.
    pub fn with<R>(&self, f: impl FnOnce(&mut M) -> R) -> R {
        f(&mut self.value.borrow_mut())
    }
}
