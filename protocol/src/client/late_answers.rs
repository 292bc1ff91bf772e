//! What a line still owes: answers that were waited for in vain and may come all the same.
//!
//! Nothing in a Modbus frame says which request it answers. An answer that comes behind its time is therefore told from
//! those to later requests by not asking what it could be taken for: a unit that owes the answer to a function is not asked
//! for that function before the answer has come, or a guard time is over. An exception carries no length and a read none of
//! its addresses, so same unit and same function is what can be mistaken; all else is asked meanwhile.

use super::Moment;
use crate::exception::Exception;
use crate::function::EXCEPTION_BIT;

/// Answers owed by one unit to one function. None if `count` is 0.
#[derive(Clone, Copy, Debug)]
struct LateAnswer {
    unit: u8,
    function: u8,
    count: u8,
    until: u32,
}

/// What one line owes: up to four units and functions at a time. Where there are as many, the whole line waits for one of
/// them, as it does [after a broadcast](LateAnswers::pause).
///
/// Time is in ticks that wrap, of any length, such as ms; no time given here is more than 2^31 of them. A late answer that nobody
/// has asked about for nearly 2^32 ticks may count once more, for no longer than it did.
#[derive(Debug)]
pub struct LateAnswers {
    table: [LateAnswer; LateAnswers::PLACES],
    /// Nothing at all is asked until then, or until this unit has answered this function; 0 is none.
    is_paused: bool,
    paused_by: (u8, u8),
    paused_until: u32,
    /// The longest time that anything here has had: what seems to have more left is over.
    longest: u32,
}

impl LateAnswers {
    /// How many units and functions it has room for.
    pub const PLACES: usize = 4;

    /// Nothing is owed.
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

    /// Whether no request has to wait, whatever it is.
    pub fn is_empty(&self) -> bool {
        !self.is_paused && self.table.iter().all(|late_answer| late_answer.count == 0)
    }

    /// How long a request to `unit` with `function` has to wait, in ticks; 0 if it may go out. It may be less than that: look
    /// again when something was [heard](LateAnswers::heard). At the end of that time ask again.
    pub fn wait(&mut self, unit: u8, function: u8, now: u32) -> u32 {
        self.wait_but_for(unit, function, now, None)
    }

    /// The same for a request that went out before and owes this: its own late answer does not hold it up.
    #[inline(never)]
    pub(super) fn wait_but_for(
        &mut self,
        unit: u8,
        function: u8,
        now: u32,
        own: Option<u32>,
    ) -> u32 {
        let mut has_room = false;
        for place in 0..LateAnswers::PLACES {
            if self.left(self.table[place].until, now) == 0 {
                self.table[place].count = 0;
            }
            has_room |= self.table[place].count == 0;
        }
        let wait = match self.find(unit, function) {
            Some(late_answer) if own == Some(late_answer.until) => 0,
            Some(&mut LateAnswer { until, .. }) => self.left(until, now),
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
            let pause = self.left(self.paused_until, now);
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
    fn left(&self, until: u32, now: u32) -> u32 {
        let left = until.wrapping_sub(now);
        if left > self.longest { 0 } else { left }
    }

    /// So many answers more are owed, and all of this kind until then.
    #[inline(never)]
    pub(super) fn note(&mut self, unit: u8, function: u8, more: u8, until: u32, now: u32) {
        self.notice(until, now);
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

    /// Nothing at all is to be asked for `ticks` from `now`: after a broadcast, so that all servers are done with it (SER 2.4.1),
    /// or where units need a pause behind an answer. None if `ticks` is 0.
    pub fn pause(&mut self, ticks: u32, now: u32) {
        self.pause_for((0, 0), ticks, now);
    }

    /// The same; the answer of this unit to this function ends it.
    #[inline(never)]
    pub(super) fn pause_for(&mut self, by: (u8, u8), ticks: u32, now: u32) {
        if ticks > 0 {
            self.is_paused = true;
            self.paused_by = by;
            self.paused_until = now.wrapping_add(ticks);
            self.notice(self.paused_until, now);
        }
    }

    #[inline(never)]
    fn notice(&mut self, until: u32, now: u32) {
        self.longest = self.longest.max(until.wrapping_sub(now));
    }

    /// Whether a frame, unit id and PDU, is an answer that is owed: if it stands, [`heard`](LateAnswers::heard) is to be told.
    #[inline(never)]
    pub fn is_owed(&mut self, frame: &[u8]) -> bool {
        match *frame {
            [unit, function, ..] => self.find(unit, function & !EXCEPTION_BIT).is_some(),
            _ => false,
        }
    }

    /// A good frame that nobody waits for, unit id and PDU: whether that was owed. An exception counts as the answer, but for
    /// 05: the answer is still to come.
    pub fn heard(&mut self, frame: &[u8], at: &Moment) -> bool {
        let was_owed = self.pay(frame, 0);
        self.pause(at.gap, at.now);
        was_owed
    }

    /// The same; this many answers stay owed at least.
    #[inline(never)]
    pub(super) fn pay(&mut self, frame: &[u8], rest: u8) -> bool {
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
