//! A port that is a client and nothing else.

use super::{Client, ClientConfig, Exchange};
use crate::line::Line;

/// The line of a client and what the tasks that use it share. `N` tasks may ask, at least 1.
pub struct ClientPort<L: Line + 'static, const N: usize> {
    line: L,
    exchange: Exchange<L, N>,
}

impl<L: Line + 'static, const N: usize> ClientPort<L, N> {
    /// A port on `line`.
    pub const fn new(line: L) -> Self {
        Self {
            line,
            exchange: Exchange::new(),
        }
    }

    /// A client with these times. There may be several, on one task or on more.
    pub const fn client(&'static self, config: ClientConfig) -> Client<L, N> {
        Client::new(&self.line, &self.exchange, config)
    }
}

/// Runs for ever: takes frames from the line and hands them to the request that waits.
///
/// # Cancellation
/// Safe: a frame not yet handed on is given back to the line.
pub async fn client_receive<L: Line, const N: usize>(port: &'static ClientPort<L, N>) -> ! {
    loop {
        let heard = port.exchange.receive(&port.line).await;
        port.exchange.offer(heard);
    }
}
