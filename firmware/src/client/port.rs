//! A port that is only a client.

use super::{Client, ClientConfig, Exchange};
use crate::line::Line;

/// The line of a client, and what the tasks share that use it. `N` tasks, at least 1, may make requests.
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

    /// A client with these times. A port may have several clients, on one or more tasks.
    pub const fn client(&'static self, config: ClientConfig) -> Client<L, N> {
        Client::new(&self.line, &self.exchange, config)
    }
}

/// Takes frames from the line and passes them to the request that waits. Never returns.
///
/// # Cancellation
/// Safe: a frame that was not passed on is given back to the line.
pub async fn client_receive<L: Line, const N: usize>(port: &'static ClientPort<L, N>) -> ! {
    loop {
        let heard = port.exchange.receive(&port.line).await;
        port.exchange.offer(heard);
    }
}
