//! What the tasks of a port share.

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;

use crate::config::PortConfig;
use crate::line::{Frame, Line};

/// What the tasks of one port share: its line and the channel from [`receive`](crate::receive()) to
/// [`serve`](crate::serve()).
pub struct Port<L: Line + 'static> {
    pub(crate) line: L,
    pub(crate) unit: u8,
    pub(crate) requests: Signal<NoopRawMutex, Frame<'static, L>>,
}

impl<L: Line + 'static> Port<L> {
    /// A port on `line`, which the board has set up from the same `config`.
    pub const fn new(line: L, config: &PortConfig) -> Self {
        Self {
            line,
            unit: config.unit(),
            requests: Signal::new(),
        }
    }
}
