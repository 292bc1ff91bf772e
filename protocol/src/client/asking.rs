//! One request from its first try to its end: what may be asked while an answer is owed, what ends the wait, and what is tried
//! again.
//!
//! [`LateAnswers`] is there once for each line, an [`Asking`] for each request. Neither waits nor has a clock: whoever drives them
//! says what happened and when, and is told what to do. `multidrop::client` drives them on a microcontroller.
//!
//! 1. The line is ours and the request written: [`Asking::wait`] says how long it has to wait, and lets others go first.
//! 2. Its last character is out: [`Asking::sent`], or [`LateAnswers::pause`] if nobody answers it. One that is given up while it goes
//!    out, and may be whole all the same, is [owed](LateAnswers::owe) too.
//! 3. What is heard goes to [`Asking::heard`]. At [`Asking::deadline`] that is [`Event::Nothing`], unless a frame has begun:
//!    [`Asking::hears_out`].
//! 4. [`Next`] says how it goes on. A request that is given up at 3 is [`Asking::given_up`].
//!
//! ```
//! use multidrop_protocol::client::{Asking, LateAnswers, Failure, Event, Moment, Next};
//!
//! // In ms.
//! let at = |now| Moment { now, timeout: 100, guard: 100, gap: 0 };
//! let mut late_answers = LateAnswers::new();
//! let mut first = Asking::new(17, 0);
//! assert_eq!(first.wait(&mut late_answers, 3, 0), 0);
//! first.sent(&mut late_answers, 3, &at(0));
//! let next = first.heard(&mut late_answers, Event::Nothing, &at(100));
//! assert_eq!(next, Next::Failed(Failure::Timeout));
//!
//! // The same unit and function: not before the late answer has come, or 100 ms are over.
//! let second = Asking::new(17, 0);
//! assert_eq!(second.wait(&mut late_answers, 3, 110), 90);
//! assert_eq!(second.wait(&mut late_answers, 4, 110), 0);
//! assert!(late_answers.heard(&[17, 3, 2, 0xBE, 0xEF], &at(115)));
//! assert_eq!(second.wait(&mut late_answers, 3, 120), 0);
//! ```

use super::{AnswerError, LateAnswers};
use crate::exception::Exception;
use crate::function::EXCEPTION_BIT;
use crate::rtu::ReceiveErrors;

/// What time it is, and how long a request waits from now on; in the ticks of [`LateAnswers`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Moment {
    /// Now.
    pub now: u32,
    /// From the end of the request to the first character of the answer (SER 2.4.1).
    pub timeout: u32,
    /// From the end of the wait to the moment from which a late answer is not expected any more.
    pub guard: u32,
    /// From an answer to the next request, whatever it is.
    pub gap: u32,
}

/// What was heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event<'a> {
    /// A good frame that stands, unit id and PDU, and what [`judge`](super::judge) says of it.
    Frame(&'a [u8], Result<(), AnswerError>),
    /// A damaged one.
    Damaged(ReceiveErrors),
    /// The deadline has come, and nothing is being heard.
    Nothing,
}

/// Why there was no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// Nothing was heard.
    Timeout,
    /// The unit refused, or nothing better was heard than this.
    Answer(AnswerError),
    /// Nothing better was heard than a damaged frame.
    Damaged(ReceiveErrors),
}

/// The unit will answer later.
const ACCEPTED: Failure = Failure::Answer(AnswerError::Exception(Exception::Acknowledge));

/// How it goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// Wait for what else is heard, until the deadline, which may be another one.
    Wait,
    /// It was the answer.
    Answered,
    /// Ask again, at once but behind others.
    Again,
    /// Ask again a timeout later: the unit is busy.
    Later,
    /// It is over.
    Failed(Failure),
}

/// A request. See the module.
#[derive(Clone, Copy, Debug)]
pub struct Asking {
    unit: u8,
    function: u8,
    retries: u8,
    /// The unit has accepted it: exception 05.
    is_accepted: bool,
    /// The deadline has passed while a frame was being heard.
    is_last: bool,
    /// What there is to tell if nothing better comes.
    end: Failure,
    deadline: u32,
    /// Whether it was sent, and until when the answer to the last try is owed.
    was_sent: bool,
    owed_until: u32,
}

impl Asking {
    /// A request to `unit` that is tried again so often.
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
            owed_until: 0,
        }
    }

    /// How long it has to wait for answers that are owed, in ticks from `now`; 0 if it may go out, with this function code.
    /// For that of its own last try it does not wait: the first answer ends it, and the second is what is owed then.
    pub fn wait(&self, late_answers: &mut LateAnswers, function: u8, now: u32) -> u32 {
        let own = self.was_sent.then_some(self.owed_until);
        late_answers.wait_but_for(self.unit, function, now, own)
    }

    /// Its last character is out, with this function code: the wait begins.
    pub fn sent(&mut self, late_answers: &mut LateAnswers, function: u8, at: &Moment) {
        self.function = function;
        self.was_sent = true;
        self.is_accepted = false;
        self.end = Failure::Timeout;
        self.begin(late_answers, 1, at);
    }

    /// A wait begins for the answer, which is owed, as `more` answers than before.
    fn begin(&mut self, late_answers: &mut LateAnswers, more: u8, at: &Moment) {
        self.is_last = false;
        self.deadline = at.now.wrapping_add(at.timeout);
        self.owe(late_answers, more, self.deadline, at);
    }

    /// The answer is owed until the guard time behind this is over.
    #[inline(never)]
    fn owe(&mut self, late_answers: &mut LateAnswers, more: u8, behind: u32, at: &Moment) {
        self.owed_until = behind.wrapping_add(at.guard);
        late_answers.note(self.unit, self.function, more, self.owed_until, at.now);
    }

    /// It is given up before its end: nobody asks anything before its answer has come, or its time is over, since both would be on
    /// the bus at once. Behind that the answer is owed as others are.
    pub fn given_up(&self, late_answers: &mut LateAnswers, now: u32) {
        let left = self.deadline.wrapping_sub(now);
        if left <= u32::MAX / 2 {
            late_answers.pause_for((self.unit, self.function), left, now);
        }
    }

    /// When the wait is over, unless the answer is being heard then.
    pub const fn deadline(&self) -> u32 {
        self.deadline
    }

    /// The deadline has come while a frame is being heard: that one is waited for, as long as it may be a good one, and is the
    /// last one.
    pub fn hears_out(&mut self) {
        self.is_last = true;
    }

    /// How it goes on when this was heard.
    #[inline(never)]
    pub fn heard(&mut self, late_answers: &mut LateAnswers, heard: Event<'_>, at: &Moment) -> Next {
        let failure = match heard {
            Event::Frame(frame, judged) => {
                // If it is not the answer, its own one is still to come.
                let is_other = judged.is_err_and(|error| !error.is_exception());
                let is_own = matches!(*frame, [unit, function, ..]
                    if unit == self.unit && function & !EXCEPTION_BIT == self.function);
                late_answers.pay(frame, (is_other && is_own).into());
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
            // Once the unit has accepted the request, that is what is to be told.
            Some(failure) if !self.is_accepted => self.end = failure,
            _ => {}
        }
        if !is_over {
            return Next::Wait;
        }
        // The answer may come from now on, for the guard time.
        self.owe(late_answers, 0, at.now, at);
        if !self.is_accepted && self.retry() {
            Next::Again
        } else {
            Next::Failed(self.end)
        }
    }

    /// Whether it may be tried once more, which counts. For a driver that could not send it.
    pub fn retry(&mut self) -> bool {
        let left = self.retries.checked_sub(1);
        self.retries = left.unwrap_or(0);
        left.is_some()
    }
}
