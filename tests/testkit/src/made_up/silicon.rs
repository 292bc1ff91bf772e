//! What a real chip has in silicon.

use multidrop_protocol::frame::ReceiveErrors;

/// An interrupt of the USART.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Awaited {
    /// A character has come.
    Received,
    /// The transmitter takes another one.
    Ready,
    /// All has left.
    Sent,
}

/// Registers, and what goes on behind them.
#[derive(Debug)]
pub(super) struct Hardware {
    /// The count of the timer.
    pub now: u32,
    pub compare: u32,
    pub compare_interrupt: bool,
    pub compare_matched: bool,
    /// Ticks of a character, as the divider makes them.
    pub character: u32,
    pub receiver_on: bool,
    /// What was received and not read yet.
    pub received: Option<(u8, ReceiveErrors)>,
    pub start_bit: bool,
    pub interrupt: Awaited,
    /// The next character, while one is on its way.
    pub waiting: Option<u8>,
    /// When the one on its way ends.
    pub ends: Option<u32>,
    /// The one on its way never ends.
    pub stands_still: bool,
    pub all_sent: bool,
    pub de: bool,
    pub sent: Vec<(u32, u8)>,
    pub de_changes: Vec<(u32, bool)>,
}

impl Hardware {
    /// Behind a reset.
    pub fn new() -> Self {
        Self {
            // The timer goes round in the first frame.
            now: 0_u32.wrapping_sub(20_000),
            compare: 0,
            compare_interrupt: false,
            compare_matched: false,
            character: 0,
            receiver_on: false,
            received: None,
            start_bit: false,
            interrupt: Awaited::Received,
            waiting: None,
            ends: None,
            stands_still: false,
            all_sent: false,
            de: false,
            sent: Vec::new(),
            de_changes: Vec::new(),
        }
    }

    pub fn set_de(&mut self, level: bool) {
        if self.de != level {
            self.de_changes.push((self.now, level));
        }
        self.de = level;
    }

    /// The data register, to read.
    pub fn read(&mut self) -> u8 {
        self.received.take().map_or(0, |(byte, _)| byte)
    }

    /// The data register, to write.
    pub fn write(&mut self, byte: u8) {
        self.all_sent = false;
        if self.ends.is_some() {
            self.waiting = Some(byte);
        } else {
            self.begin(byte);
        }
    }

    pub fn begin(&mut self, byte: u8) {
        self.sent.push((self.now, byte));
        self.ends = Some(self.now.wrapping_add(self.character));
    }

    // ANCHOR: compare
    pub fn set_compare(&mut self, at: u32) {
        self.compare = at;
        // One that has passed already is not missed.
        self.compare_matched = self.now.wrapping_sub(at) as i32 >= 0;
    }
    // ANCHOR_END: compare

    /// What happens next, and no later than at `at`.
    pub fn next_event(&self, at: u32) -> u32 {
        let left = |event: u32| event.wrapping_sub(self.now);
        let mut next = at;
        if !self.compare_matched && left(self.compare) < left(next) {
            next = self.compare;
        }
        if let Some(ends) = self.ends.filter(|_| !self.stands_still)
            && left(ends) < left(next)
        {
            next = ends;
        }
        next
    }

    /// Time goes on to a tick at which something happens.
    pub fn go_to(&mut self, tick: u32) {
        self.now = tick;
        if tick == self.compare {
            self.compare_matched = true;
        }
        if self.ends == Some(tick) && !self.stands_still {
            self.ends = None;
            match self.waiting.take() {
                Some(byte) => self.begin(byte),
                None => self.all_sent = true,
            }
        }
    }
}
