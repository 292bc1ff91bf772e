//! The exchange: what the clients of one port share.

use core::cell::{Cell, RefCell, RefMut};
use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::{Context, Poll};

use multidrop_protocol::client::{Asking, LateAnswers};
use multidrop_protocol::frame::ReceiveErrors;

use super::time::now;
use super::transaction::heard_bytes;
use super::turns::{How, Turn, Turns, Wait};
use super::{ClientConfig, ClientError};
use crate::line::{Frame, Key, Line};
use crate::slot::Slot;

/// A frame that was received, lent and provisional, or the errors of a damaged one.
pub(super) type Incoming<L> = Result<Frame<'static, L>, ReceiveErrors>;

/// The request whose answer the line waits for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Expected {
    Nobodys,
    /// No request: the frame that is kept came too late, and may not stand.
    Late,
    /// The request of a client.
    Clients,
    /// The request of a transaction which the registers of a managed port have started.
    Started,
}

/// The queue of the clients of one port, the late answers of the line, and the frame for the request that waits. `N`
/// tasks, 1 to 254, may make requests. A task that was just answered and makes another request goes to the end of the
/// queue, where it keeps a place.
pub struct Exchange<L: Line + 'static, const N: usize> {
    pub(super) turns: Turns<N>,
    /// The times of clients that have none of their own.
    times: Cell<ClientConfig>,
    pub(super) heard: Slot<Incoming<L>>,
    expected: Cell<Expected>,
    late_answers: RefCell<LateAnswers>,
}

impl<L: Line + 'static, const N: usize> Exchange<L, N> {
    /// An exchange without requests.
    pub const fn new() -> Self {
        Self {
            turns: Turns::new(),
            times: Cell::new(ClientConfig::new()),
            heard: Slot::new(),
            expected: Cell::new(Expected::Nobodys),
            late_answers: RefCell::new(LateAnswers::new()),
        }
    }

    /// Waits for the next frame from the line, lent and provisional, or for the errors of a damaged one. For the
    /// receive task of the port. Between two frames it also watches whether a late answer stands.
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

    /// Ends the wait for a late answer when the line has told whether it stands.
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

    /// Whether a late answer has the buffer of the line until it stands or is void. The task that has the turn is
    /// woken after that. It makes no use of the line before, since another task waits there.
    pub(super) fn has_late(&self, context: &Context<'_>) -> bool {
        let has_late = self.expected.get() == Expected::Late;
        if has_late {
            self.heard.waiter.wait(context);
        }
        has_late
    }

    /// Passes what was [received](Self::receive) to the request that waits for it. If no request waits, a frame may
    /// be a late answer; otherwise it is given back to the line.
    pub fn offer(&self, heard: Result<Frame<'static, L>, ReceiveErrors>) {
        let is_late = |frame: &Frame<'static, L>| self.is_late_answer(heard_bytes(frame));
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

    /// Whether the request of a started transaction was sent and its answer is waited for.
    pub(crate) fn awaits_started(&self) -> bool {
        self.expected.get() == Expected::Started
    }

    /// The times of clients that have none of their own.
    pub(super) fn times(&self) -> ClientConfig {
        self.times.get()
    }

    /// Sets these times for the next wait on.
    pub(crate) fn set_times(&self, times: ClientConfig) {
        self.times.set(times);
    }

    /// Refuses all requests from now on, including those that wait.
    pub(crate) fn close(&self) {
        self.turns.close();
    }

    /// Accepts requests again.
    pub(crate) fn open(&self) {
        self.turns.open();
    }

    /// Waits until no request is under way, and keeps all others from beginning as long as the result lives. Never
    /// fails.
    pub(crate) fn hold(&'static self) -> impl Future<Output = Result<Turn<N>, ClientError>> {
        self.turns.turn(Wait::new(How::Held, 0))
    }

    /// Whether a late answer of the kind of this frame is expected.
    pub(super) fn is_late_answer(&self, frame: &[u8]) -> bool {
        self.late_answers.borrow_mut().is_expected(frame)
    }

    /// The late answers of the line.
    pub(super) fn late_answers(&self) -> RefMut<'_, LateAnswers> {
        self.late_answers.borrow_mut()
    }

    /// The time until which late answers hold up a request with this function code; `None` if it may be sent.
    pub(super) fn parked(&self, asking: &Asking, function: u8) -> Option<u32> {
        let mut late_answers = self.late_answers.borrow_mut();
        // After an answer there is no time to read the clock.
        if late_answers.is_empty() {
            return None;
        }
        let now = now();
        match asking.wait(&mut late_answers, function, now) {
            0 => None,
            wait => Some(now.wrapping_add(wait)),
        }
    }

    /// Sets whose answer the line waits for.
    pub(super) fn expect(&self, whose: Expected) {
        self.expected.set(whose);
    }

    /// Ends the wait for an answer.
    #[inline(never)]
    pub(super) fn expect_nothing(&self) {
        self.expected.set(Expected::Nobodys);
        // A frame that was received and not read goes back to the line.
        self.heard.take();
    }
}

impl<L: Line + 'static, const N: usize> Default for Exchange<L, N> {
    fn default() -> Self {
        Self::new()
    }
}
