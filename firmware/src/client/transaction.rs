//! One request, from its turn to its end.
//!
//! The future is written by hand: there is one for each port and each task that makes requests, and an `async` block
//! would keep everything twice. [`Asking`] decides what is done next.

use core::future::Future;
use core::pin::{Pin, pin};
use core::task::{Context, Poll, ready};

use multidrop_protocol::client::{
    AnswerError, Asking, Event, Moment, Next, Request, encode, judge,
};
use multidrop_protocol::frame::ReceiveErrors;

use super::destination::Take;
use super::exchange::Expected;
use super::time::{now, poll_over};
use super::turns::{How, Turn, Wait};
use super::{Client, ClientError};
use crate::line::{Frame, Line, Released};

/// An answer that stands, in the buffer of the line. As long as it lives, the line receives nothing and no other task
/// can send: read it and drop it, and do not keep it over an await.
pub struct Reply<L: Line + 'static, const N: usize> {
    frame: Released<'static, L>,
    // Dropped after the frame, so that the next task finds the buffer free.
    _turn: Turn<N>,
}

impl<L: Line + 'static, const N: usize> Reply<L, N> {
    /// Unit id, function code and data.
    pub fn bytes(&self) -> &[u8] {
        self.frame.heard()
    }
}

/// The stage of a request.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// Waits for its turn.
    Turn,
    /// Has the line, and waits until the line is silent.
    Silence,
    /// Is being sent.
    Sending,
    /// Waits for the answer.
    Answer,
    /// Has no answer; waits for the turnaround delay.
    Pause,
    /// Is about to wait for another turn.
    Later,
    /// It has ended.
    Over,
}

/// Future of [`Client::run`].
pub(crate) struct Run<'a, L: Line + 'static, const N: usize> {
    client: &'a Client<L, N>,
    request: &'a dyn Request,
    /// Takes the data at t1.5, before the answer stands.
    into: Option<&'a mut dyn Take>,
    asking: Asking,
    /// Its `until` is the end of the stage, too.
    wait: Wait,
    stage: Stage,
    /// Whether the end of the wait for silence is set.
    is_timed: bool,
    is_answered: bool,
    /// Whether the request is that of a started transaction, whose progress STATUS shows.
    is_started: bool,
    /// Length of the request in bytes.
    len: u8,
    unit: u8,
    function: u8,
    judged: Result<(), AnswerError>,
    /// The request, or the answer that was received and does not stand yet.
    frame: Option<Released<'static, L>>,
}

impl<L: Line + 'static, const N: usize> Client<L, N> {
    /// Sends any request to `unit` (1..=247, or 0 for a broadcast where the function allows it) and waits for its
    /// answer. Returns `None` if the request has no answer: after a broadcast, and after Force Listen Only Mode.
    ///
    /// The methods named after functions send their requests in this way and return the data.
    ///
    /// # Errors
    /// [`ClientError`].
    ///
    /// # Cancellation
    /// Safe, see [`Client`].
    pub fn transact<'a>(
        &'a self,
        unit: u8,
        request: &'a dyn Request,
    ) -> impl Future<Output = Result<Option<Reply<L, N>>, ClientError>> + 'a {
        self.run(unit, request, None)
    }

    /// Sends the request of a transaction that the registers of a managed port have started: STATUS shows its
    /// progress, and it waits if the queue is full.
    pub(crate) fn start<'a>(&'a self, unit: u8, request: &'a dyn Request) -> Run<'a, L, N> {
        let mut run = self.run(unit, request, None);
        run.is_started = true;
        run.wait.is_patient = true;
        run
    }

    /// Sends a request, and passes the data to `into` at t1.5, before the answer stands, so that the next request is
    /// sent in time.
    #[inline(never)]
    pub(super) fn run<'a>(
        &'a self,
        unit: u8,
        request: &'a dyn Request,
        into: Option<&'a mut dyn Take>,
    ) -> Run<'a, L, N> {
        Run {
            client: self,
            request,
            into,
            asking: Asking::new(unit, self.config().retries),
            wait: Wait::new(How::Asked, 0),
            stage: Stage::Turn,
            is_timed: false,
            is_answered: false,
            is_started: false,
            len: 0,
            unit,
            function: 0,
            judged: Ok(()),
            frame: None,
        }
    }

    /// Sends a request for a task that has the turn.
    pub(crate) fn run_with<'a>(
        &'a self,
        unit: u8,
        request: &'a dyn Request,
        turn: Turn<N>,
    ) -> Run<'a, L, N> {
        turn.keep();
        let mut run = self.run(unit, request, None);
        run.stage = Stage::Silence;
        run
    }

    /// The present time with the times of this client.
    #[inline(never)]
    fn moment(&self) -> Moment {
        self.config().moment()
    }
}

impl<L: Line + 'static, const N: usize> Run<'_, L, N> {
    /// Gives the line back. Other requests may go first, and this one not before `until` if it is
    /// [parked](How::Parked).
    #[inline(never)]
    fn leave(&mut self, stage: Stage, how: How, until: u32) {
        // The next task finds the buffer free.
        self.frame = None;
        self.client.exchange.turns.leave(&mut self.wait, true);
        self.wait.how = how;
        self.wait.until = until;
        self.stage = stage;
    }

    /// Sends the request from `frame`, the buffer of the line, which is silent, if no late answer forbids it.
    fn send(&mut self, mut frame: Frame<'static, L>) -> Result<(), ClientError> {
        let encoded = encode(self.request, self.unit, frame.adu())?;
        self.function = frame.bytes()[1];
        if let Some(until) = self.client.exchange.parked(&self.asking, self.function) {
            drop(frame);
            self.leave(Stage::Turn, How::Parked, until);
            return Ok(());
        }
        self.len = encoded.len;
        self.is_answered = encoded.answered;
        self.frame = Some(frame.release(encoded.len));
        self.stage = Stage::Sending;
        Ok(())
    }

    /// The request was sent, perhaps not to its end: waits for the answer, or for the turnaround delay of a
    /// broadcast.
    #[inline(never)]
    fn sent(&mut self) {
        let at = self.client.moment();
        let mut late_answers = self.client.exchange.late_answers();
        if self.is_answered {
            self.asking.sent(&mut late_answers, self.function, &at);
        } else {
            let turnaround = self.client.config().turnaround();
            self.wait.until = at.now.wrapping_add(turnaround);
            late_answers.pause(turnaround, at.now);
        }
    }

    /// Waits for a frame or the deadline. If the result is an answer, it is in `frame`.
    fn poll_answer(&mut self, context: &mut Context<'_>) -> Poll<Next> {
        let errors = match &mut self.frame {
            Some(frame) => match ready!(pin!(frame.settle()).poll(context)) {
                true => ReceiveErrors::NONE,
                false => ReceiveErrors::GAP,
            },
            None => match self.client.exchange.heard.poll(context) {
                Poll::Ready(Ok(frame)) => return Poll::Ready(self.judge_frame(frame)),
                Poll::Ready(Err(errors)) => errors,
                Poll::Pending => {
                    ready!(poll_over(self.asking.deadline(), context));
                    // An answer that has begun in time is received to its end, as long as it may be valid.
                    let quiet = pin!(self.client.line.quiet()).poll(context);
                    if quiet != Poll::Ready(ReceiveErrors::NONE) {
                        self.asking.receives_last_frame();
                    }
                    ready!(quiet)
                }
            },
        };
        Poll::Ready(self.heard(errors))
    }

    /// Checks a frame that was received and may not stand yet.
    fn judge_frame(&mut self, frame: Frame<'static, L>) -> Next {
        let bytes = heard_bytes(&frame);
        self.judged = judge(self.request, self.unit, self.function, bytes);
        if self.judged.is_ok()
            && let Some(into) = &mut self.into
        {
            into.take(bytes.get(3..).unwrap_or(&[]));
        }
        let must_stand = self.client.exchange.is_late_answer(bytes);
        self.frame = Some(frame.hold());
        match must_stand {
            true => Next::Wait,
            // No late answer is expected that it could be.
            false => self.heard(ReceiveErrors::NONE),
        }
    }

    /// Judges `frame`, or a frame with these errors; the timeout has passed if there is neither.
    #[inline(never)]
    fn heard(&mut self, errors: ReceiveErrors) -> Next {
        let exchange = self.client.exchange;
        let at = self.client.moment();
        let heard = match &self.frame {
            _ if !errors.is_empty() => Event::Damaged(errors),
            Some(frame) => Event::Frame(frame.heard(), self.judged),
            None => Event::Nothing,
        };
        let next = self.asking.heard(&mut exchange.late_answers(), heard, &at);
        if next != Next::Answered && self.frame.take().is_some() {
            // The frame may have been a late answer for which others wait.
            exchange.turns.unpark();
        }
        next
    }
}

impl<L: Line + 'static, const N: usize> Future for Run<'_, L, N> {
    type Output = Result<Option<Reply<L, N>>, ClientError>;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        let run = &mut *self;
        let Client { line, exchange, .. } = *run.client;
        let end = loop {
            match run.stage {
                Stage::Turn => {
                    if let Err(error) = ready!(exchange.turns.poll(&mut run.wait, context)) {
                        return Poll::Ready(Err(error));
                    }
                    run.is_timed = false;
                    run.stage = Stage::Silence;
                }
                Stage::Silence if exchange.has_late(context) => return Poll::Pending,
                Stage::Silence => {
                    if let Poll::Ready(frame) = pin!(line.lend()).poll(context) {
                        if let Err(error) = run.send(frame) {
                            break Err(error);
                        }
                        continue;
                    }
                    // A request that follows an answer must be sent at once: the clock is read only if there is
                    // anything to wait for.
                    if !run.is_timed {
                        run.is_timed = true;
                        run.wait.until = now().wrapping_add(run.client.config().timeout());
                    }
                    ready!(poll_over(run.wait.until, context));
                    if !run.asking.retry() {
                        break Err(ClientError::NoSilence);
                    }
                    run.leave(Stage::Turn, How::Asked, 0);
                }
                Stage::Sending => {
                    if let Some(frame) = &mut run.frame {
                        let is_out = ready!(pin!(frame.sent()).poll(context));
                        if is_out {
                            line.show(Ok(&frame.bytes()[..usize::from(run.len)]));
                        }
                        let was_cut = !is_out && line.was_cut();
                        run.frame = None;
                        if was_cut {
                            if !run.asking.retry() {
                                break Err(ClientError::CutOff);
                            }
                            run.leave(Stage::Turn, How::Asked, 0);
                            continue;
                        }
                        // Otherwise another station has begun to send.
                        run.stage = Stage::Silence;
                        if is_out {
                            run.sent();
                            run.stage = Stage::Pause;
                        }
                        if is_out && run.is_answered {
                            exchange.expect(match run.is_started {
                                true => Expected::Started,
                                false => Expected::Clients,
                            });
                            run.stage = Stage::Answer;
                        }
                    }
                }
                Stage::Answer => {
                    let next = ready!(run.poll_answer(context));
                    if next == Next::Wait {
                        continue;
                    }
                    exchange.expect_nothing();
                    match next {
                        Next::Failed(failure) => break Err(failure.into()),
                        Next::Later => {
                            let until = now().wrapping_add(run.client.config().timeout());
                            run.leave(Stage::Later, How::Asked, until);
                        }
                        Next::Answered => {
                            run.stage = Stage::Over;
                            let turn = Turn::taken(&exchange.turns);
                            return Poll::Ready(Ok(run
                                .frame
                                .take()
                                .map(|frame| Reply { frame, _turn: turn })));
                        }
                        _ => run.leave(Stage::Turn, How::Asked, 0),
                    }
                }
                Stage::Pause => {
                    ready!(poll_over(run.wait.until, context));
                    break Ok(None);
                }
                Stage::Later => {
                    ready!(poll_over(run.wait.until, context));
                    run.stage = Stage::Turn;
                }
                Stage::Over => return Poll::Pending,
            }
        };
        run.leave(Stage::Over, How::Asked, 0);
        Poll::Ready(end)
    }
}

impl<L: Line + 'static, const N: usize> Drop for Run<'_, L, N> {
    fn drop(&mut self) {
        let exchange = self.client.exchange;
        let is_out = match self.stage {
            Stage::Over => return,
            // The request may have been sent whole.
            Stage::Sending => {
                self.sent();
                self.is_answered
            }
            Stage::Answer => {
                exchange.expect_nothing();
                true
            }
            _ => false,
        };
        if is_out {
            self.asking.given_up(&mut exchange.late_answers(), now());
        }
        let has_line = !matches!(self.stage, Stage::Turn | Stage::Later);
        self.frame = None;
        exchange.turns.leave(&mut self.wait, has_line);
    }
}

/// The bytes of a frame that was received.
pub(super) fn heard_bytes<'a, L: Line>(frame: &'a Frame<'static, L>) -> &'a [u8] {
    &frame.bytes()[..usize::from(frame.request_len())]
}
