//! A server port: what its tasks share.

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use multidrop_protocol::server::{Counted, Server, Uncounted};

use crate::config::PortConfig;
use crate::line::{Frame, Line};

/// A port that is a server: its line, its server, and the channel from [`receive`](crate::receive()) to
/// [`serve`](crate::serve()).
///
/// `D` is [`Counted`] if the server counts what happens on the line, which functions 08, 0B and 0C need, and
/// [`Uncounted`] otherwise.
pub struct ServerPort<L: Line + 'static, D = Uncounted> {
    pub(crate) line: L,
    pub(crate) server: Server<D>,
    pub(crate) requests: Signal<NoopRawMutex, Frame<'static, L>>,
}

impl<L: Line + 'static> ServerPort<L> {
    /// A port on `line`, which the board has set up from the same `config`. Its server does not count.
    pub const fn new(line: L, config: &PortConfig) -> Self {
        Self::with(line, Server::new(config.unit()))
    }
}

impl<L: Line + 'static, const LOG: usize> ServerPort<L, Counted<LOG>> {
    /// A port on `line`, which the board has set up from the same `config`, with all counters and a log of
    /// the last `LOG` events, 0 to 64.
    pub const fn counted(line: L, config: &PortConfig) -> Self {
        Self::with(line, Server::counted(config.unit()))
    }
}

impl<L: Line + 'static, D> ServerPort<L, D> {
    /// A port on `line` with the given server.
    pub const fn with(line: L, server: Server<D>) -> Self {
        Self {
            line,
            server,
            requests: Signal::new(),
        }
    }

    /// The port's line.
    pub const fn line(&self) -> &L {
        &self.line
    }

    /// The port's server, with its unit id and counters.
    pub const fn server(&self) -> &Server<D> {
        &self.server
    }
}
