//! The client: requests of any function, awaited.
//!
//! There is no task for it. A request runs in the task that asks; what the tasks of one port share is an
//! [`Exchange`], which gives the line to one of them at a time, in the order in which they asked, and
//! carries what the port hears to the one that waits. [`ClientPort`] is a port that is a client and nothing
//! else; [`client_receive`] is its task.
//!
//! ```ignore
//! static PORT: StaticCell<ClientPort<Rs485, 1>> = StaticCell::new();
//! let port = PORT.init(ClientPort::new(line));
//! spawner.spawn(receive(port).unwrap()); // client_receive(port).await
//! let client = port.client(ClientConfig::new().timeout_ms(150).retries(1));
//!
//! let mut levels = [0; 4];
//! client.read_holding_registers(17, 100, &mut levels).await?;
//! client.write_register(17, 110, 2).await?;
//! ```
//!
//! # What ends a request
//!
//! The first good answer or exception. A frame from another unit or with another function, a damaged one, or
//! one of a wrong length does not: the wait goes on, and if nothing better comes, the last of them is the
//! error at the timeout; [`ClientError::Timeout`] if there was none. The exceptions that mean *not yet* are
//! waited for: 05 extends the wait by one timeout, once; 06 is tried again a timeout later if retries are
//! left. A frame that is over at t1.5 is judged then; it is believed when it stands at t3.5.
//!
//! The next request of the same task starts at that t3.5.
//!
//! # Answers that come too late
//!
//! What is heard while nobody waits is dropped, and no request starts before the line is silent. An answer
//! that comes after its timeout, or a second time, *and* after the next request has gone out can be told from
//! the answer to that one only by what it is: unit, function, length, echo. There is nothing else in a Modbus
//! frame. Where that is not enough, make the timeout longer than the server ever takes.
//!
//! A request that is given up by dropping its future still has an answer to come. The next one, from
//! whatever task, waits for it: until it comes or its timeout is over.

mod error;
mod exchange;
mod functions;
mod port;
mod transaction;

pub use error::{Blame, ClientError};
pub use exchange::Exchange;
pub use port::{ClientPort, client_receive};
pub use transaction::Reply;

use core::num::NonZeroU16;

use embassy_time::{Duration, TICK_HZ};

use crate::line::Line;

/// How long a client waits, and how often it tries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClientConfig {
    /// In ms, like the next. One is in RAM for each client.
    timeout: NonZeroU16,
    turnaround: u16,
    retries: u8,
}

impl ClientConfig {
    /// One second, no retries, 100 ms after a broadcast (SER 2.4.1).
    pub const fn new() -> Self {
        Self {
            timeout: NonZeroU16::new(1000).unwrap(),
            turnaround: 100,
            retries: 0,
        }
    }

    /// How long to wait for an answer, in ms: from the end of the request to the end of the answer.
    ///
    /// # Panics
    /// If it is 0; in a `const` that is a build error.
    pub const fn timeout_ms(mut self, ms: u16) -> Self {
        self.timeout = NonZeroU16::new(ms).expect("timeout_ms is 0, must be 1..=65535");
        self
    }

    /// How often a request is sent again that was not answered, or answered with exception 06.
    ///
    /// A server whose answer was lost executes the request once more: do not set it for requests that must
    /// not be executed twice.
    pub const fn retries(mut self, retries: u8) -> Self {
        self.retries = retries;
        self
    }

    /// How long nothing is sent after a broadcast, in ms, so that all servers are done with it (SER 2.4.1).
    pub const fn turnaround_ms(mut self, ms: u16) -> Self {
        self.turnaround = ms;
        self
    }

    /// In ticks of `embassy-time`, like the next.
    pub(crate) const fn timeout(&self) -> u32 {
        ticks(self.timeout.get())
    }

    pub(crate) const fn turnaround(&self) -> u32 {
        ticks(self.turnaround)
    }
}

impl Default for ClientConfig {
    fn default() -> Self {
        Self::new()
    }
}

/// A time in ticks of `embassy-time`.
pub(crate) const fn ticks(ms: u16) -> u32 {
    const PER_MS: u32 = {
        assert!(
            TICK_HZ >= 1000 && TICK_HZ / 1000 <= u32::MAX as u64,
            "embassy-time must tick every millisecond"
        );
        (TICK_HZ / 1000) as u32
    };
    (ms as u32).saturating_mul(PER_MS)
}

/// So many ticks.
pub(crate) const fn duration(ticks: u32) -> Duration {
    Duration::from_ticks(ticks as u64)
}

/// The right to send requests on one port, for `N` tasks, at least 1: they take turns in the order in which
/// they ask. If more than `N` want the line at once, one may be refused ([`ClientError::QueueFull`]).
///
/// Every method gives the right answer's data, or [`ClientError`].
///
/// # Cancellation
/// All methods are safe to drop at any await. A request under way is given up: its last character is
/// finished, the line listens, the turn goes to the next task, and its answer is not taken for another's. What a
/// read was to fill may be filled in part.
pub struct Client<L: Line + 'static, const N: usize> {
    line: &'static L,
    exchange: &'static Exchange<L, N>,
    /// `None` for those of the port.
    config: Option<ClientConfig>,
}

impl<L: Line + 'static, const N: usize> Clone for Client<L, N> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L: Line + 'static, const N: usize> Copy for Client<L, N> {}

impl<L: Line + 'static, const N: usize> Client<L, N> {
    /// A client on `line`. What `line` hears has to be [offered](Exchange::offer) to `exchange`, which has no
    /// other line.
    pub const fn new(
        line: &'static L,
        exchange: &'static Exchange<L, N>,
        config: ClientConfig,
    ) -> Self {
        Self {
            line,
            exchange,
            config: Some(config),
        }
    }

    /// One with the times of the port, whatever they are when it asks.
    pub(crate) const fn of_port(line: &'static L, exchange: &'static Exchange<L, N>) -> Self {
        Self {
            line,
            exchange,
            config: None,
        }
    }

    /// The same with other times.
    pub const fn with(self, config: ClientConfig) -> Self {
        Self {
            config: Some(config),
            ..self
        }
    }

    #[inline(never)]
    fn config(&self) -> ClientConfig {
        match self.config {
            Some(config) => config,
            None => self.exchange.times(),
        }
    }

    /// Whether a request is under way or waits for its turn: another one would wait.
    pub fn is_busy(&self) -> bool {
        self.exchange.is_busy()
    }
}
