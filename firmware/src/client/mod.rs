//! The client: requests of any function, awaited.
//!
//! There is no task for it. A request runs in the task that asks; what the tasks of one port share is an
//! [`Exchange`], which gives the line to one of them at a time, in the order in which they asked, and
//! carries what the port hears to the one that waits. [`ClientPort`] is a port that is a client and nothing
//! else; [`client_receive`] is its task.
//!
//! ```
//! use multidrop::{ClientConfig, ClientError, ClientPort, Line, client_receive};
//!
//! /// The body of the port's task.
//! async fn receive<L: Line>(port: &'static ClientPort<L, 1>) -> ! {
//!     client_receive(port).await
//! }
//!
//! async fn ask<L: Line>(port: &'static ClientPort<L, 1>) -> Result<(), ClientError> {
//!     let client = port.client(ClientConfig::new().timeout_ms(150).retries(1));
//!     let mut levels = [0; 4];
//!     client.read_holding_registers(17, 100, &mut levels).await?;
//!     client.write_register(17, 110, 2).await
//! }
//! ```
//!
//! # What ends a request
//!
//! The first good answer or exception. A frame from another unit or with another function, a damaged one, or
//! one of a wrong length does not: the wait goes on, and if nothing better comes, the last of them is the
//! error at the timeout; [`ClientError::Timeout`] if there was none. The timeout bounds the beginning of an answer: a frame
//! that is being heard then is heard to its end, and is the last one. The exceptions that mean *not yet* are
//! waited for: 05 extends the wait by one timeout, once; 06 is tried again a timeout later if retries are
//! left. A frame that is over at t1.5 is judged then; it is believed when it stands at t3.5.
//!
//! The next request of the same task starts at that t3.5.
//!
//! # Answers that come too late
//!
//! There is nothing in a Modbus frame that says which request it answers. So the same unit is not asked for the same function
//! by another request before an answer that was waited for in vain has come, or is
//! [not expected any more](ClientConfig::late_guard_ms); such a request gives its turn up until then, and all others go first.
//! A retry does not wait for what it owes itself: the first answer ends it, and a second one is expected then. A line keeps
//! account of four units and functions at a time ([`LateAnswers`](multidrop_protocol::client::LateAnswers)); where more owe an answer, all
//! wait. What cannot be helped is an answer that comes behind the guard time.
//!
//! A request that is given up by dropping its future still has an answer to come. Nothing else is asked before it comes, or its
//! timeout is over; from then on it is owed like others.

mod destination;
mod error;
mod exchange;
mod functions;
mod port;
mod time;
mod transaction;
mod turns;

pub use error::{Blame, ClientError};
pub use exchange::Exchange;
pub use port::{ClientPort, client_receive};
pub(crate) use time::{duration, now, ticks};
pub use transaction::Reply;
pub(crate) use turns::Turn;

use core::future::Future;
use core::num::NonZeroU16;

use multidrop_protocol::client::{Asking, Moment};

use crate::line::Line;
use turns::{How, Wait};

/// How long a client waits, and how often it tries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClientConfig {
    /// In ms, like the next. One is in RAM for each client.
    timeout: NonZeroU16,
    /// 0 for the timeout.
    guard: u16,
    turnaround: u16,
    gap: u16,
    retries: u8,
}

impl ClientConfig {
    /// One second for an answer and another for one that is late, no retries, 100 ms after a broadcast (SER 2.4.1), no gap.
    pub const fn new() -> Self {
        Self {
            timeout: NonZeroU16::new(1000).unwrap(),
            guard: 0,
            turnaround: 100,
            gap: 0,
            retries: 0,
        }
    }

    /// How long to wait for an answer, in ms: from the end of the request to the beginning of the answer. One that has begun is
    /// heard to its end.
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

    /// How long after a timeout an answer may still come, in ms, before the same unit is asked for the same function by another
    /// request; 0 is the timeout. An answer that comes behind that may be taken for the next one's.
    pub const fn late_guard_ms(mut self, ms: u16) -> Self {
        self.guard = ms;
        self
    }

    /// How long nothing is sent after an answer, in ms: for units that need a pause.
    pub const fn request_gap_ms(mut self, ms: u16) -> Self {
        self.gap = ms;
        self
    }

    /// Now, and the times from now on.
    #[inline(never)]
    fn moment(&self) -> Moment {
        let guard = match self.guard {
            0 => self.timeout.get(),
            ms => ms,
        };
        Moment {
            now: now(),
            timeout: self.timeout(),
            guard: ticks(guard),
            gap: ticks(self.gap),
        }
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

    /// Waits for the line; with `until`, not before then, or before an answer has come.
    pub(crate) fn turn(
        &self,
        until: Option<u32>,
    ) -> impl Future<Output = Result<Turn<N>, ClientError>> {
        self.exchange.turns.turn(match until {
            Some(until) => Wait::new(How::Parked, until),
            None => Wait::new(How::Asked, 0),
        })
    }

    /// Until when answers that are owed hold up a new request to `unit` with `function`; `None` if it may go out.
    pub(crate) fn parked(&self, unit: u8, function: u8) -> Option<u32> {
        self.exchange.parked(&Asking::new(unit, 0), function)
    }

    /// Whether a request is under way or waits for its turn: another one would wait.
    pub fn is_busy(&self) -> bool {
        self.exchange.is_busy()
    }
}
