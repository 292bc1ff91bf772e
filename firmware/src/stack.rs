//! How deep a board's stack has been.

/// The stack, as it was painted at the start and has been overwritten since.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stack {
    /// Bytes there are for it.
    pub size: usize,
    /// Bytes of them that have been in use since the board has started: a lower bound, since what was never written to inside
    /// of them shows only from above.
    pub used: usize,
}
