//! What the tasks of a port share to ask and to be answered.

use core::cell::Cell;
use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::{Context, Poll};

use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::semaphore::{FairSemaphore, Semaphore, SemaphoreReleaser};
use embassy_sync::signal::Signal;
use embassy_time::{Instant, Timer};
use multidrop_protocol::rtu::Flaws;

use super::{ClientConfig, ClientError, duration};
use crate::line::{Frame, Line};

/// What was heard: a frame, lent and provisional, or what was wrong with one.
pub(super) type Heard<L> = Result<Frame<'static, L>, Flaws>;

/// The right to the line, held by one request at a time.
pub(crate) type Turn<const N: usize> = SemaphoreReleaser<'static, FairSemaphore<NoopRawMutex, N>>;

/// The turns of the clients of one port, and the way of what is heard to the one that waits for it. `N` tasks may
/// ask, at least 1: one that has just been answered and asks again waits behind those that wait, and one
/// of them still has its place in the queue.
pub struct Exchange<L: Line + 'static, const N: usize> {
    turn: FairSemaphore<NoopRawMutex, N>,
    /// Nobody may ask.
    is_closed: Cell<bool>,
    /// Of clients that have none of their own.
    times: Cell<ClientConfig>,
    heard: Signal<NoopRawMutex, Heard<L>>,
    expecting: Cell<bool>,
    /// The answer to a request may come that nobody waits for any more, until then.
    is_owed: Cell<bool>,
    owed_until: Cell<Instant>,
}

impl<L: Line + 'static, const N: usize> Exchange<L, N> {
    /// Nobody asks.
    pub const fn new() -> Self {
        Self {
            turn: FairSemaphore::new(1),
            is_closed: Cell::new(false),
            times: Cell::new(ClientConfig::new()),
            heard: Signal::new(),
            expecting: Cell::new(false),
            is_owed: Cell::new(false),
            owed_until: Cell::new(Instant::MIN),
        }
    }

    /// For the task that takes frames from the line: hands on what it heard to the request that waits; if none
    /// does, a frame is given back to the line.
    pub fn offer(&self, heard: Result<Frame<'static, L>, Flaws>) {
        if self.expecting.get() {
            self.heard.signal(heard);
        } else if heard.is_ok() {
            self.is_owed.set(false);
        }
    }

    /// Whether a request is under way or waits for its turn.
    pub fn is_busy(&self) -> bool {
        self.turn.try_acquire(1).is_none()
    }

    /// Whether a request is out and its answer waited for.
    pub fn awaits_answer(&self) -> bool {
        self.expecting.get()
    }

    /// Waits for the line, behind those who asked before.
    pub(super) async fn turn(&'static self) -> Result<Turn<N>, ClientError> {
        if self.is_closed.get() {
            // Who tries again and again lets others run.
            yield_now().await;
            return Err(ClientError::NotMaster);
        }
        let turn = self.turn.acquire(1).await;
        let turn = turn.map_err(|_| ClientError::QueueFull)?;
        // Closed meanwhile: the next one is told the same.
        match self.is_closed.get() {
            true => Err(ClientError::NotMaster),
            false => Ok(turn),
        }
    }

    /// The times of clients that have none of their own.
    pub(super) fn times(&self) -> ClientConfig {
        self.times.get()
    }

    /// Other ones, from the next wait on.
    pub(crate) fn set_times(&self, times: ClientConfig) {
        self.times.set(times);
    }

    /// From now on nobody may ask; who waits is refused.
    pub(crate) fn close(&self) {
        self.is_closed.set(true);
    }

    /// All may ask.
    pub(crate) fn open(&self) {
        self.is_closed.set(false);
    }

    /// Waits until no request is under way; none begins as long as the result lives.
    pub(crate) async fn hold(&'static self) -> Turn<N> {
        loop {
            match self.turn.acquire(1).await {
                Ok(turn) => return turn,
                // More wait than there are places for.
                Err(_) => yield_now().await,
            }
        }
    }

    /// Whether the answer to a request that was given up may still come.
    pub(super) fn is_owed(&self) -> bool {
        self.is_owed.get()
    }

    /// Until when it may.
    pub(super) fn owed_until(&self) -> Instant {
        self.owed_until.get()
    }

    /// It came, or did not.
    pub(super) fn settle(&self) {
        self.is_owed.set(false);
    }

    /// Begins to wait for what is heard, as long as the result lives.
    pub(super) fn expect(&self) -> Expecting<'_, L, N> {
        self.expecting.set(true);
        Expecting(self)
    }

    /// A request goes out. If the result is dropped before [`Debt::settle`], the next request waits for so many
    /// ticks of `embassy-time` for its answer.
    pub(super) fn owe(&self, ticks: u32) -> Debt<'_, L, N> {
        Debt {
            exchange: self,
            ticks,
        }
    }
}

impl<L: Line + 'static, const N: usize> Default for Exchange<L, N> {
    fn default() -> Self {
        Self::new()
    }
}

/// What is heard goes to its holder.
pub(super) struct Expecting<'a, L: Line + 'static, const N: usize>(&'a Exchange<L, N>);

impl<L: Line + 'static, const N: usize> Expecting<'_, L, N> {
    /// Waits for something, and not longer than until `deadline`: `None`.
    //
    // As `with_deadline`, which keeps a timer beside what it waits for, in a future that is there once for each port.
    pub fn heard_until(&self, deadline: Instant) -> impl Future<Output = Option<Heard<L>>> {
        poll_fn(
            move |context| match pin!(self.0.heard.wait()).poll(context) {
                Poll::Ready(heard) => Poll::Ready(Some(heard)),
                Poll::Pending => poll_over(deadline, context).map(|()| None),
            },
        )
    }
}

/// Whether it is `at` or later; if not, the task is woken then.
#[inline(never)]
pub(super) fn poll_over(at: Instant, context: &mut Context<'_>) -> Poll<()> {
    if Instant::now() >= at {
        return Poll::Ready(());
    }
    // A timer asks to be woken when it is polled, and is not waited for itself.
    let _ = pin!(Timer::at(at)).poll(context);
    Poll::Pending
}

impl<L: Line + 'static, const N: usize> Drop for Expecting<'_, L, N> {
    fn drop(&mut self) {
        self.0.expecting.set(false);
        // A frame that came and was not looked at goes back to the line.
        self.0.heard.reset();
    }
}

/// An answer that is to come, or the time that servers take for a broadcast.
pub(super) struct Debt<'a, L: Line + 'static, const N: usize> {
    exchange: &'a Exchange<L, N>,
    ticks: u32,
}

impl<L: Line + 'static, const N: usize> Debt<'_, L, N> {
    /// It came, or will not; the time is over.
    pub fn settle(self) {
        core::mem::forget(self);
    }
}

impl<L: Line + 'static, const N: usize> Drop for Debt<'_, L, N> {
    fn drop(&mut self) {
        let until = Instant::now() + duration(self.ticks);
        self.exchange.owed_until.set(until);
        self.exchange.is_owed.set(true);
    }
}
