//! The client: async requests with any function code.
//!
//! The client has no task of its own: a request runs in the task that makes it. The tasks of one port share an
//! [`Exchange`], which gives the line to one request at a time, in the order of the requests, and passes the answer
//! to the request that waits. [`ClientPort`] is a port that is only a client; [`client_receive`] is its task.
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
//! The first valid answer or exception ends a request. A frame from another unit or with another function code, a
//! damaged frame, or a frame of a wrong length does not: the wait goes on. If no valid answer comes before the
//! timeout, the last such frame is the error, or [`ClientError::Timeout`] if there was none. The timeout applies to
//! the beginning of an answer: a frame that is being received when the timeout passes is received to its end, and is
//! the last one. Two exceptions mean *not yet*: 05 (acknowledge) extends the wait by one timeout, once; after 06
//! (busy) the request is sent again one timeout later, if retries are left. A frame is checked at t1.5, and the
//! result counts when the frame stands at t3.5.
//!
//! The next request of the same task is sent at that t3.5.
//!
//! # Answers that come too late
//!
//! A Modbus frame does not tell which request it answers. After a timeout the unit's answer may still come. Therefore
//! another request with the same function is not sent to the same unit before that late answer has come, or is [not
//! expected any more](ClientConfig::late_guard_ms). Such a request gives up its turn until then, and all others go
//! first. A retry does not wait for the late answer to its own first try: the first answer ends the request, and a
//! second one is then expected. A line keeps account of four pairs of unit and function at a time
//! ([`LateAnswers`](multidrop_protocol::client::LateAnswers)); if all four are in use, requests to other units and
//! functions wait as well. An answer that comes after the guard time may be taken for the answer to a later request.
//!
//! A request that is given up by dropping its future still has an answer to come. No other request is sent before
//! that answer has come or the timeout has passed; after that it counts as a late answer.

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

/// The times and the number of retries of a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClientConfig {
    /// In ms, as `guard` is. There is one in RAM for each client.
    timeout: NonZeroU16,
    /// In ms; 0 stands for the timeout.
    guard: u16,
    turnaround: u16,
    gap: u16,
    retries: u8,
}

impl ClientConfig {
    /// The defaults: a timeout of one second, the same time for late answers, no retries, 100 ms after a broadcast
    /// (SER 2.4.1), no gap.
    pub const fn new() -> Self {
        Self {
            timeout: NonZeroU16::new(1000).unwrap(),
            guard: 0,
            turnaround: 100,
            gap: 0,
            retries: 0,
        }
    }

    /// Sets the timeout in ms: from the end of the request to the beginning of the answer, 1..=65535. An answer that
    /// has begun is received to its end.
    ///
    /// # Panics
    /// If it is 0; in a `const` that is a build error.
    pub const fn timeout_ms(mut self, ms: u16) -> Self {
        self.timeout = NonZeroU16::new(ms).expect("timeout_ms is 0, must be 1..=65535");
        self
    }

    /// Sets how often a request is sent again after a timeout or exception 06.
    ///
    /// A server whose answer was lost executes the request once more: do not set it for requests that must
    /// not be executed twice.
    pub const fn retries(mut self, retries: u8) -> Self {
        self.retries = retries;
        self
    }

    /// Sets the turnaround delay in ms: the silence after a broadcast, in which all servers carry it out (SER 2.4.1).
    pub const fn turnaround_ms(mut self, ms: u16) -> Self {
        self.turnaround = ms;
        self
    }

    /// Sets the guard time in ms: how long after a timeout a late answer is expected, during which no other request
    /// with that function is sent to that unit. 0 stands for the timeout. A later answer may be taken for the answer
    /// to the next request.
    pub const fn late_guard_ms(mut self, ms: u16) -> Self {
        self.guard = ms;
        self
    }

    /// Sets the pause after an answer in ms, for units that need one.
    pub const fn request_gap_ms(mut self, ms: u16) -> Self {
        self.gap = ms;
        self
    }

    /// The present time with the times of this client.
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

    /// In ticks of `embassy-time`, as [`turnaround`](Self::turnaround).
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

/// The right to send requests on one port. Up to `N` tasks, at least 1, take turns in the order of their requests. If
/// more than `N` wait at once, a request may be refused with [`ClientError::QueueFull`].
///
/// Every method returns the data of the valid answer, or [`ClientError`].
///
/// # Cancellation
/// All methods may be dropped at any await. A request under way is given up: its last character is finished, the line
/// returns to receive, the turn passes to the next task, and the answer is not taken for that to another request.
/// Memory that a read was to fill may be filled in part.
pub struct Client<L: Line + 'static, const N: usize> {
    line: &'static L,
    exchange: &'static Exchange<L, N>,
    /// `None` for the times of the port.
    config: Option<ClientConfig>,
}

impl<L: Line + 'static, const N: usize> Clone for Client<L, N> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L: Line + 'static, const N: usize> Copy for Client<L, N> {}

impl<L: Line + 'static, const N: usize> Client<L, N> {
    /// A client on `line`. All that `line` receives must be [offered](Exchange::offer) to `exchange`, which serves no
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

    /// A client with the times of the port, as they are at the time of each request.
    pub(crate) const fn of_port(line: &'static L, exchange: &'static Exchange<L, N>) -> Self {
        Self {
            line,
            exchange,
            config: None,
        }
    }

    /// A client of this port with other times.
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

    /// Waits for the line; if `until` is given, until that time or the next late answer at least.
    pub(crate) fn turn(
        &self,
        until: Option<u32>,
    ) -> impl Future<Output = Result<Turn<N>, ClientError>> {
        self.exchange.turns.turn(match until {
            Some(until) => Wait::new(How::Parked, until),
            None => Wait::new(How::Asked, 0),
        })
    }

    /// The time until which late answers hold up a new request to `unit` with `function`; `None` if it may be sent.
    pub(crate) fn parked(&self, unit: u8, function: u8) -> Option<u32> {
        self.exchange.parked(&Asking::new(unit, 0), function)
    }

    /// Whether a request is under way or waits for its turn, so that another one would wait.
    pub fn is_busy(&self) -> bool {
        self.exchange.is_busy()
    }
}
