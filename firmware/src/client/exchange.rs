//! What the tasks of a port share to ask and to be answered.

use core::cell::{Cell, RefCell, RefMut};
use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::{Context, Poll};

use multidrop_protocol::client::{Asking, LateAnswers};
use multidrop_protocol::rtu::ReceiveErrors;

use super::time::now;
use super::transaction::heard_bytes;
use super::turns::{How, Turn, Turns, Wait};
use super::{ClientConfig, ClientError};
use crate::line::{Frame, Key, Line};
use crate::slot::Slot;

/// What was heard: a frame, lent and provisional, or what was wrong with one.
pub(super) type Incoming<L> = Result<Frame<'static, L>, ReceiveErrors>;

/// Whose answer is waited for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Expected {
    Nobodys,
    /// Nobody's any more: one that came too late, and may not stand.
    Late,
    /// That of a client.
    Clients,
    /// That of the transaction which the registers of a managed port have started.
    Started,
}

/// The turns of the clients of one port, what the line owes them, and the way of what is heard to the one that waits for it.
/// `N` tasks may ask, 1 to 254: one that has just been answered and asks again waits behind those that wait, and one
/// of them still has its place in the queue.
pub struct Exchange<L: Line + 'static, const N: usize> {
    pub(super) turns: Turns<N>,
    /// Of clients that have none of their own.
    times: Cell<ClientConfig>,
    pub(super) heard: Slot<Incoming<L>>,
    expected: Cell<Expected>,
    late_answers: RefCell<LateAnswers>,
}

impl<L: Line + 'static, const N: usize> Exchange<L, N> {
    /// Nobody asks.
    pub const fn new() -> Self {
        Self {
            turns: Turns::new(),
            times: Cell::new(ClientConfig::new()),
            heard: Slot::new(),
            expected: Cell::new(Expected::Nobodys),
            late_answers: RefCell::new(LateAnswers::new()),
        }
    }

    /// For the task that takes frames from the line: waits for the next one, lent and provisional, or for what was wrong with one.
    /// Between two of them it sees whether an answer that came too late stands.
    ///
    /// # Cancellation
    /// Safe: the frame stays with the line until the next call.
    pub fn receive(
        &self,
        line: &'static L,
    ) -> impl Future<Output = Result<Frame<'static, L>, ReceiveErrors>> {
        poll_fn(move |context| {
            if self.expected.get() == Expected::Late {
                self.poll_late(line, context);
            }
            pin!(line.receive()).poll(context)
        })
    }

    /// The frame that is kept came too late for a request; whether it stands says the line.
    fn poll_late(&self, line: &L, context: &mut Context<'_>) {
        let Poll::Ready(stands) = line.poll_settled(context, Key::THIS_CRATE) else {
            return;
        };
        self.expected.set(Expected::Nobodys);
        if let Some(Ok(frame)) = self.heard.take()
            && stands
        {
            let at = self.times.get().moment();
            self.late_answers().heard(heard_bytes(&frame), &at);
            self.turns.unpark();
        }
        self.heard.waiter.wake();
    }

    /// Whether the buffer of the line is with an answer that came too late, and may not stand. The task that has the turn is woken
    /// when it is not: it asks the line for nothing as long as another task waits for the line's verdict.
    pub(super) fn has_late(&self, context: &Context<'_>) -> bool {
        let has_late = self.expected.get() == Expected::Late;
        if has_late {
            self.heard.waiter.wait(context);
        }
        has_late
    }

    /// Hands on what was [received](Self::receive) to the request that waits; if none does, a frame is looked at for an answer
    /// that comes too late, and given back to the line.
    pub fn offer(&self, heard: Result<Frame<'static, L>, ReceiveErrors>) {
        let is_late = |frame: &Frame<'static, L>| self.is_owed(heard_bytes(frame));
        match self.expected.get() {
            Expected::Nobodys | Expected::Late => {
                if heard.as_ref().is_ok_and(is_late) {
                    self.expected.set(Expected::Late);
                    self.heard.put(heard);
                }
            }
            _ => self.heard.put(heard),
        }
    }

    /// Whether a request is under way or waits for its turn.
    pub fn is_busy(&self) -> bool {
        self.turns.is_busy()
    }

    /// Whether the request of a started transaction is out and its answer waited for.
    pub(crate) fn awaits_started(&self) -> bool {
        self.expected.get() == Expected::Started
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
        self.turns.close();
    }

    /// All may ask.
    pub(crate) fn open(&self) {
        self.turns.open();
    }

    /// Waits until no request is under way; none begins as long as the result lives. It never fails.
    pub(crate) fn hold(&'static self) -> impl Future<Output = Result<Turn<N>, ClientError>> {
        self.turns.turn(Wait::new(How::Held, 0))
    }

    /// Whether an answer of this kind is owed to a request before.
    pub(super) fn is_owed(&self, frame: &[u8]) -> bool {
        self.late_answers.borrow_mut().is_owed(frame)
    }

    /// What the line owes, to be changed.
    pub(super) fn late_answers(&self) -> RefMut<'_, LateAnswers> {
        self.late_answers.borrow_mut()
    }

    /// Until when the answers that are owed hold up a request with this function code; `None` if it may go out.
    pub(super) fn parked(&self, asking: &Asking, function: u8) -> Option<u32> {
        let mut late_answers = self.late_answers.borrow_mut();
        // Right behind an answer there is no time to look at the clock.
        if late_answers.is_empty() {
            return None;
        }
        let now = now();
        match asking.wait(&mut late_answers, function, now) {
            0 => None,
            wait => Some(now.wrapping_add(wait)),
        }
    }

    /// Begins to wait for what is heard.
    pub(super) fn expect(&self, whose: Expected) {
        self.expected.set(whose);
    }

    /// Nobody waits for what is heard.
    #[inline(never)]
    pub(super) fn expect_nothing(&self) {
        self.expected.set(Expected::Nobodys);
        // A frame that came and was not looked at goes back to the line.
        self.heard.take();
    }
}

impl<L: Line + 'static, const N: usize> Default for Exchange<L, N> {
    fn default() -> Self {
        Self::new()
    }
}
