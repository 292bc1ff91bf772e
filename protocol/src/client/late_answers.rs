//! Late answers of a line: answers that have not come within the timeout and may come later.
//!
//! A Modbus frame does not tell which request it answers. To tell a late answer from the answer to a later request, a
//! request is held back if the late answer could be taken for its own: while the answer of a unit to a function is
//! expected, no other request with that function is sent to that unit, until the answer has come or the guard time
//! has passed. An exception has no length and a read no address in its answer, so unit id and function code decide;
//! all other requests are sent meanwhile.

use super::Moment;
use crate::exception::Exception;
use crate::function::EXCEPTION_BIT;

/// The late answers of one unit to one function; none if `count` is 0.
#[derive(Clone, Copy, Debug)]
struct LateAnswer {
    unit: u8,
    function: u8,
    count: u8,
    until: u32,
}

/// The late answers of one line, of up to four pairs of unit and function at a time. If all four are in use, the
/// whole line waits for one of them, as it does [after a broadcast](LateAnswers::pause).
///
/// Time is in ticks of any length, such as ms, which wrap. No time passed here may be more than 2^31 ticks. A late
/// answer that is not looked at for nearly 2^32 ticks may count once more, for no longer than before.
#[derive(Debug)]
pub struct LateAnswers {
    table: [LateAnswer; LateAnswers::PLACES],
    /// Whether no request may be sent until `paused_until`, or until this unit has answered this function; (0, 0) is
    /// none.
    is_paused: bool,
    paused_by: (u8, u8),
    paused_until: u32,
    /// The longest time that was ever set: a longer time left means that it has passed.
    longest: u32,
}

impl LateAnswers {
    /// The number of pairs of unit and function.
    pub const PLACES: usize = 4;

    /// An account without late answers.
    pub const fn new() -> LateAnswers {
        LateAnswers {
            table: [LateAnswer {
                unit: 0,
                function: 0,
                count: 0,
                until: 0,
            }; LateAnswers::PLACES],
            is_paused: false,
            paused_by: (0, 0),
            paused_until: 0,
            longest: 0,
        }
    }

    /// Whether no request has to wait, whatever its unit and function.
    pub fn is_empty(&self) -> bool {
        !self.is_paused && self.table.iter().all(|late_answer| late_answer.count == 0)
    }

    /// How long a request to `unit` with `function` must wait, in ticks; 0 if it may be sent. The wait can end
    /// before: call this again after a frame was [heard](LateAnswers::heard), and at the end of that time.
    pub fn wait(&mut self, unit: u8, function: u8, now: u32) -> u32 {
        self.wait_except_own(unit, function, now, None)
    }

    /// How long a request must wait whose own last answer is expected until `own`: it does not wait for that one.
    #[inline(never)]
    pub(super) fn wait_except_own(
        &mut self,
        unit: u8,
        function: u8,
        now: u32,
        own: Option<u32>,
    ) -> u32 {
        let mut has_room = false;
        for place in 0..LateAnswers::PLACES {
            if self.remaining(self.table[place].until, now) == 0 {
                self.table[place].count = 0;
            }
            has_room |= self.table[place].count == 0;
        }
        let wait = match self.find(unit, function) {
            Some(late_answer) if own == Some(late_answer.until) => 0,
            Some(&mut LateAnswer { until, .. }) => self.remaining(until, now),
            None if has_room => 0,
            None => {
                let left = self
                    .table
                    .iter()
                    .map(|late_answer| late_answer.until.wrapping_sub(now));
                left.min().unwrap_or(0)
            }
        };
        if self.is_paused {
            let pause = self.remaining(self.paused_until, now);
            self.is_paused = pause > 0;
            return wait.max(pause);
        }
        wait
    }

    #[inline(never)]
    fn find(&mut self, unit: u8, function: u8) -> Option<&mut LateAnswer> {
        self.table.iter_mut().find(|late_answer| {
            late_answer.count > 0 && late_answer.unit == unit && late_answer.function == function
        })
    }

    #[inline(never)]
    fn remaining(&self, until: u32, now: u32) -> u32 {
        let left = until.wrapping_sub(now);
        if left > self.longest { 0 } else { left }
    }

    /// Expects `more` answers, and all of this unit and function until `until`.
    #[inline(never)]
    pub(super) fn expect(&mut self, unit: u8, function: u8, more: u8, until: u32, now: u32) {
        self.raise_longest(until, now);
        if self.find(unit, function).is_none() {
            let free = self
                .table
                .iter()
                .position(|late_answer| late_answer.count == 0);
            self.table[free.unwrap_or(0)] = LateAnswer {
                unit,
                function,
                count: more,
                until,
            };
        } else if let Some(late_answer) = self.find(unit, function) {
            late_answer.count = late_answer.count.saturating_add(more);
            late_answer.until = until;
        }
    }

    /// Holds back all requests for `ticks` from `now`: after a broadcast, so that all servers can execute it (SER
    /// 2.4.1), or where units need a pause after an answer. If `ticks` is 0, nothing changes.
    pub fn pause(&mut self, ticks: u32, now: u32) {
        self.pause_for((0, 0), ticks, now);
    }

    /// Holds back all requests for `ticks` from `now`, or until the unit in `by` has answered the function in `by`.
    #[inline(never)]
    pub(super) fn pause_for(&mut self, by: (u8, u8), ticks: u32, now: u32) {
        if ticks > 0 {
            self.is_paused = true;
            self.paused_by = by;
            self.paused_until = now.wrapping_add(ticks);
            self.raise_longest(self.paused_until, now);
        }
    }

    #[inline(never)]
    fn raise_longest(&mut self, until: u32, now: u32) {
        self.longest = self.longest.max(until.wrapping_sub(now));
    }

    /// Whether a frame, unit id and PDU, is a late answer; if it stands, call [`heard`](LateAnswers::heard).
    #[inline(never)]
    pub fn is_expected(&mut self, frame: &[u8]) -> bool {
        match *frame {
            [unit, function, ..] => self.find(unit, function & !EXCEPTION_BIT).is_some(),
            _ => false,
        }
    }

    /// Takes a good frame, unit id and PDU, for which no request waits; returns whether it was a late answer. An
    /// exception counts as the answer, except 05, after which the answer is still to come.
    pub fn heard(&mut self, frame: &[u8], at: &Moment) -> bool {
        let was_expected = self.arrived(frame, 0);
        self.pause(at.gap, at.now);
        was_expected
    }

    /// Takes an answer that has arrived; `rest` answers are still expected at least.
    #[inline(never)]
    pub(super) fn arrived(&mut self, frame: &[u8], rest: u8) -> bool {
        let [unit, code, ref data @ ..] = *frame else {
            return false;
        };
        let function = code & !EXCEPTION_BIT;
        if code != function && *data == [Exception::Acknowledge.code()] {
            return false;
        }
        match self.find(unit, function) {
            Some(late_answer) if late_answer.count > rest => late_answer.count -= 1,
            _ => return false,
        }
        self.is_paused &= self.paused_by != (unit, function);
        true
    }
}

impl Default for LateAnswers {
    fn default() -> LateAnswers {
        LateAnswers::new()
    }
}
