//! The course of one request: how long it must wait for late answers, what ends its wait, and when it is sent again.
//!
//! There is one [`LateAnswers`] for each line and one [`Asking`] for each request. Both are state machines without a
//! clock: the driver reports what happened and when, and gets back what to do. `multidrop::client` drives them on a
//! microcontroller.
//!
//! 1. The line is free and the request is encoded. [`Asking::wait`] returns how long it must wait; other requests may
//!    go first.
//! 2. The last character was sent: call [`Asking::sent`], or [`LateAnswers::pause`] if the request has no answer. A
//!    request that is given up while it is being sent may be complete on the bus; call [`Asking::sent`] for it, too.
//! 3. A frame was received: call [`Asking::heard`]. At [`Asking::deadline`], call it with [`Event::Nothing`]; if a
//!    frame is being received at that moment, call [`Asking::receives_last_frame`] instead.
//! 4. [`Next`] is what to do then. If the request is given up in step 3, call [`Asking::given_up`].
//!
//! ```
//! use multidrop_protocol::client::{Asking, LateAnswers, Failure, Event, Moment, Next};
//!
//! // Times are in ms.
//! let at = |now| Moment { now, timeout: 100, guard: 100, gap: 0 };
//! let mut late_answers = LateAnswers::new();
//! let mut first = Asking::new(17, 0);
//! assert_eq!(first.wait(&mut late_answers, 3, 0), 0);
//! first.sent(&mut late_answers, 3, &at(0));
//! let next = first.heard(&mut late_answers, Event::Nothing, &at(100));
//! assert_eq!(next, Next::Failed(Failure::Timeout));
//!
//! // Another request with that unit and function must wait for the late answer, or for 100 ms.
//! let second = Asking::new(17, 0);
//! assert_eq!(second.wait(&mut late_answers, 3, 110), 90);
//! assert_eq!(second.wait(&mut late_answers, 4, 110), 0);
//! assert!(late_answers.heard(&[17, 3, 2, 0xBE, 0xEF], &at(115)));
//! assert_eq!(second.wait(&mut late_answers, 3, 120), 0);
//! ```

use super::{AnswerError, LateAnswers};
use crate::exception::Exception;
use crate::frame::ReceiveErrors;
use crate::function::EXCEPTION_BIT;

/// The present time, and how long a request waits from now on; in the ticks of [`LateAnswers`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Moment {
    /// The present time.
    pub now: u32,
    /// From the end of the request to the first character of the answer (SER 2.4.1).
    pub timeout: u32,
    /// From the end of the wait to the time at which a late answer is no longer expected.
    pub guard: u32,
    /// From an answer to the next request of any kind.
    pub gap: u32,
}

/// The event that a request has waited for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event<'a> {
    /// A good frame that stands, unit id and PDU, and the result of [`judge`](super::judge) for it.
    Frame(&'a [u8], Result<(), AnswerError>),
    /// A damaged frame.
    Damaged(ReceiveErrors),
    /// The deadline has passed, and no frame is being received.
    Nothing,
}

/// Why there was no valid answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Failure {
    /// No frame was received.
    Timeout,
    /// The unit returned an exception, or an answer was received that does not fit the request.
    Answer(AnswerError),
    /// A damaged frame was received.
    Damaged(ReceiveErrors),
}

/// The unit has accepted the request and will answer later.
const ACCEPTED: Failure = Failure::Answer(AnswerError::Exception(Exception::Acknowledge));

/// What to do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// Wait until the deadline, which may have changed.
    Wait,
    /// Nothing: the frame was the answer.
    Answered,
    /// Send the request again at once, behind those of others.
    Again,
    /// Send the request again one timeout later, since the unit is busy.
    Later,
    /// Nothing: the request has failed.
    Failed(Failure),
}

/// The state of one request. See the module for how to drive it.
#[derive(Clone, Copy, Debug)]
pub struct Asking {
    unit: u8,
    function: u8,
    retries: u8,
    /// Whether the unit has accepted the request: exception 05.
    is_accepted: bool,
    /// Whether the deadline has passed while a frame was being received.
    is_last: bool,
    /// The error to report if no valid answer comes.
    end: Failure,
    deadline: u32,
    /// Whether the request was sent, and until when the answer to the last try is expected.
    was_sent: bool,
    expected_until: u32,
}

impl Asking {
    /// A request to `unit` with this number of retries.
    pub const fn new(unit: u8, retries: u8) -> Asking {
        Asking {
            unit,
            function: 0,
            retries,
            is_accepted: false,
            is_last: false,
            end: Failure::Timeout,
            deadline: 0,
            was_sent: false,
            expected_until: 0,
        }
    }

    /// How long the request must wait for late answers, in ticks from `now`; 0 if it may be sent with this function
    /// code. It does not wait for the late answer to its own last try: the first answer ends it, and the second one
    /// is then expected.
    pub fn wait(&self, late_answers: &mut LateAnswers, function: u8, now: u32) -> u32 {
        let own = self.was_sent.then_some(self.expected_until);
        late_answers.wait_except_own(self.unit, function, now, own)
    }

    /// Begins the wait: the last character was sent, with this function code.
    pub fn sent(&mut self, late_answers: &mut LateAnswers, function: u8, at: &Moment) {
        self.function = function;
        self.was_sent = true;
        self.is_accepted = false;
        self.end = Failure::Timeout;
        self.begin(late_answers, 1, at);
    }

    /// Begins a wait, after which `more` answers than before are expected.
    fn begin(&mut self, late_answers: &mut LateAnswers, more: u8, at: &Moment) {
        self.is_last = false;
        self.deadline = at.now.wrapping_add(at.timeout);
        self.expect_answer(late_answers, more, self.deadline, at);
    }

    /// Expects the answer until the guard time after `behind` has passed.
    #[inline(never)]
    fn expect_answer(
        &mut self,
        late_answers: &mut LateAnswers,
        more: u8,
        behind: u32,
        at: &Moment,
    ) {
        self.expected_until = behind.wrapping_add(at.guard);
        late_answers.expect(self.unit, self.function, more, self.expected_until, at.now);
    }

    /// Gives up the request before its end. No other request may be sent before its answer has come or its timeout
    /// has passed, since both would be on the bus at once. After that the answer counts as a late one.
    pub fn given_up(&self, late_answers: &mut LateAnswers, now: u32) {
        let left = self.deadline.wrapping_sub(now);
        if left <= u32::MAX / 2 {
            late_answers.pause_for((self.unit, self.function), left, now);
        }
    }

    /// The end of the wait, unless a frame is being received then.
    pub const fn deadline(&self) -> u32 {
        self.deadline
    }

    /// Tells that a frame is being received at the deadline: it is received to its end as long as it may be valid,
    /// and is the last one.
    pub fn receives_last_frame(&mut self) {
        self.is_last = true;
    }

    /// Takes what was received, and returns what to do next.
    #[inline(never)]
    pub fn heard(&mut self, late_answers: &mut LateAnswers, heard: Event<'_>, at: &Moment) -> Next {
        let failure = match heard {
            Event::Frame(frame, judged) => {
                // If the frame is not the answer to this request, its answer is still to come.
                let is_other = judged.is_err_and(|error| !error.is_exception());
                let is_own = matches!(*frame, [unit, function, ..]
                    if unit == self.unit && function & !EXCEPTION_BIT == self.function);
                late_answers.arrived(frame, (is_other && is_own).into());
                late_answers.pause(at.gap, at.now);
                match judged {
                    Ok(()) => return Next::Answered,
                    Err(error) => Some(Failure::Answer(error)),
                }
            }
            Event::Damaged(errors) => Some(Failure::Damaged(errors)),
            Event::Nothing => None,
        };
        let mut is_over = self.is_last || failure.is_none();
        match failure {
            Some(failure) if failure == ACCEPTED => {
                is_over = self.is_accepted;
                self.end = failure;
                self.is_accepted = true;
                if !is_over {
                    self.begin(late_answers, 0, at);
                }
            }
            Some(Failure::Answer(error)) if error.is_exception() => {
                self.end = Failure::Answer(error);
                return match error {
                    AnswerError::Exception(Exception::ServerDeviceBusy) if self.retry() => {
                        Next::Later
                    }
                    _ => Next::Failed(self.end),
                };
            }
            // After the unit has accepted the request, that is the error to report.
            Some(failure) if !self.is_accepted => self.end = failure,
            _ => {}
        }
        if !is_over {
            return Next::Wait;
        }
        // From now on the answer may come within the guard time.
        self.expect_answer(late_answers, 0, at.now, at);
        if !self.is_accepted && self.retry() {
            Next::Again
        } else {
            Next::Failed(self.end)
        }
    }

    /// Uses up one retry; returns whether there was one. For a driver that could not send the request.
    pub fn retry(&mut self) -> bool {
        let left = self.retries.checked_sub(1);
        self.retries = left.unwrap_or(0);
        left.is_some()
    }
}
