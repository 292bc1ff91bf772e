//! The depth of a board's stack.

/// The use of a stack that was painted at the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stack {
    /// Size of the stack in bytes.
    pub size: usize,
    /// Bytes that have been in use since the start, counted from the deepest byte that was overwritten: a lower bound, since
    /// a deeper byte may have been reserved and never written.
    pub used: usize,
}
