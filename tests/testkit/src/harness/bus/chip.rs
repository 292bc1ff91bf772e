//! The USART and the timer, as the state machine drives them.

use super::{Char, FORTIETH, Settings, TIMER_ROUND, Talk};
use multidrop_protocol::Adu;
use multidrop_protocol::frame::Received;
use multidrop_protocol::line::{Ascii, Interval, Wire};
use multidrop_protocol::rtu::Reception;

pub(super) struct Sending {
    /// Where the character in the shift register is over; none in it if `None`.
    pub(super) shifted: Option<u64>,
    pub(super) holding: Option<u8>,
    /// When the ready interrupt comes.
    pub(super) ready: Option<u64>,
    pub(super) ready_enabled: bool,
    /// All was sent while the ready interrupt was late; told after it.
    pub(super) done: bool,
}

/// The chip with its machine.
pub struct Chip {
    pub settings: Settings,
    pub now: u64,
    pub chars: Vec<Char>,
    /// Edges that are no character.
    pub glitches: Vec<u64>,
    pub talks: Vec<Talk>,
    pub receiver_woken: bool,
    pub user_woken: bool,
    /// The first character of the frame that comes in, of the one that is complete, and of the one with the tasks.
    pub incoming: usize,
    pub complete: usize,
    pub lent: Option<usize>,
    /// The complete frame, to check that it is unchanged when it is read.
    pub(super) kept: Option<(u8, Adu)>,
    pub ascii: Option<Ascii>,
    pub(super) adu: Adu,
    pub(super) reception: Reception,
    pub(super) stored: usize,
    pub(super) next: usize,
    pub(super) next_glitch: usize,
    pub(super) last_edge: u64,
    pub(super) cleared: u64,
    pub(super) compare: u64,
    /// How often the alarm went off since it was set.
    pub(super) rounds: u64,
    pub(super) alarm_enabled: bool,
    pub(super) sending: Option<Sending>,
    /// A character that was not read from the receiver.
    pub(super) waiting: Option<u8>,
}

impl Chip {
    pub(super) fn next_reception(&self) -> Option<u64> {
        let next = self.chars.get(self.next)?;
        Some(next.start + self.settings.to_receive())
    }

    pub(super) fn next_alarm(&self) -> u64 {
        self.compare + self.rounds * TIMER_ROUND
    }

    pub(super) fn set_compare(&mut self, at: u64) {
        self.compare = at;
        // What is reached already is reached again a round later.
        self.rounds = u64::from(at <= self.now);
    }

    pub(super) fn is_due(&self, when: fn(&Sending) -> Option<u64>) -> bool {
        let at = self.sending.as_ref().and_then(when);
        at.is_some_and(|at| at <= self.now)
    }

    pub(super) fn store(&mut self, byte: u8) {
        assert_eq!(self.lent, None, "stored while the buffer is lent");
        assert!(self.kept.is_none(), "stored over a frame");
        assert!(self.sending.is_none(), "stored over an answer");
        assert!(self.stored < 256, "stored beyond the buffer");
        self.reception.push(&mut self.adu, byte);
        self.stored += 1;
    }

    /// Takes in the edges up to now.
    pub(super) fn note_edges(&mut self) {
        while let Some(&at) = self.glitches.get(self.next_glitch)
            && at <= self.now
        {
            self.last_edge = self.last_edge.max(at);
            self.next_glitch += 1;
        }
        let Some(&Char { start, byte, .. }) = self.chars.get(self.next) else {
            return;
        };
        let bit = self.settings.character / 10;
        let levels = 0x200 | u32::from(byte) << 1;
        for index in 0..10u32 {
            let before = if index == 0 {
                1
            } else {
                levels >> (index - 1) & 1
            };
            let at = start + u64::from(index) * bit;
            if levels >> index & 1 != before && at <= self.now {
                self.last_edge = self.last_edge.max(at);
            }
        }
    }

    pub(super) fn shift_in(&mut self, byte: u8) {
        let latency = self.settings.ready_latency;
        let sending = self.sending.as_mut().unwrap();
        sending.shifted = Some(self.now + self.settings.character);
        if sending.ready_enabled {
            sending.ready = Some(self.now + latency);
        }
        self.talks.last_mut().unwrap().bytes.push(byte);
    }
}

impl Wire for Chip {
    fn ascii(&mut self) -> Option<&mut Ascii> {
        self.ascii.as_mut()
    }

    fn take(&mut self) -> u8 {
        self.waiting.take().expect("taken twice")
    }

    fn store(&mut self, at: u8, byte: u8) {
        assert_eq!(self.lent, None, "stored while the buffer is lent");
        assert!(self.sending.is_none(), "stored over an answer");
        if at == 0 {
            // The two digits of this byte, and the `:` before them.
            self.complete = self.next - 3;
        }
        self.adu[usize::from(at)] = byte;
    }

    fn start_bit_seen(&mut self) -> bool {
        self.note_edges();
        self.settings.sees_start_bits && self.last_edge > self.cleared
    }

    fn clear_start_bit(&mut self) {
        self.cleared = self.now;
    }

    fn alarm(&mut self, interval: Interval) -> bool {
        let settings = &self.settings;
        let to_stand = settings.judged() - settings.complete();
        let less_character = to_stand.saturating_sub(settings.character);
        let (from, ticks) = match interval {
            // Judged at t3.5 itself: nothing is left to wait for.
            Interval::ToStart => (self.compare, settings.early),
            Interval::ToStand => (self.compare, to_stand),
            Interval::ToStandLessCharacter => (self.compare, less_character),
            Interval::Character => (self.compare, settings.character),
            Interval::Fortieth => (self.compare, FORTIETH),
            Interval::T3_5Then => unreachable!("no bound on what is sent"),
            Interval::T3_5 => (
                self.now,
                settings.half_stop() + settings.t3_5 + settings.blind(),
            ),
        };
        self.set_compare(from + ticks);
        ticks > 0
    }

    fn alarm_on(&mut self) {
        assert!(self.compare > self.now, "an alarm that is past already");
        self.alarm_enabled = true;
    }

    fn alarm_off(&mut self) {
        self.alarm_enabled = false;
    }

    fn restart(&mut self) {
        self.incoming = self.next - 1;
        self.reception.restart();
        self.stored = 0;
    }

    fn finish(&mut self) -> Received {
        let heard = self.reception.finish();
        if heard.errors.is_empty() {
            assert_eq!(self.lent, None, "complete while the buffer is lent");
            self.complete = self.incoming;
            self.kept = Some((heard.len, self.adu));
        }
        heard
    }

    fn adu(&self) -> &Adu {
        &self.adu
    }

    fn talk(&mut self, first: u8) {
        assert!(self.sending.is_none(), "talks twice");
        self.talks.push(Talk {
            start: self.now,
            end: u64::MAX,
            bytes: Vec::new(),
            request: self.lent.expect("talks without a request"),
            cut: None,
        });
        self.sending = Some(Sending {
            shifted: None,
            holding: None,
            ready: None,
            ready_enabled: true,
            done: false,
        });
        self.shift_in(first);
    }

    fn is_ready(&mut self) -> bool {
        let sending = self.sending.as_ref();
        sending.is_some_and(|sending| sending.holding.is_none())
    }

    fn put(&mut self, byte: u8, last: bool) {
        let sending = self.sending.as_mut().expect("puts without talking");
        assert!(sending.holding.is_none(), "puts over a byte");
        sending.ready = None;
        // Of the byte before.
        sending.done &= !last;
        if sending.shifted.is_some() {
            sending.holding = Some(byte);
        } else {
            self.shift_in(byte);
        }
    }

    fn end(&mut self) {
        if let Some(sending) = &mut self.sending {
            sending.ready = None;
            sending.ready_enabled = false;
        }
    }

    fn listen(&mut self) {
        let sending = self.sending.take().expect("listens while it does");
        assert!(
            sending.shifted.is_none() && sending.holding.is_none(),
            "DE down over a character"
        );
        self.talks.last_mut().unwrap().end = self.now;
    }

    fn wake_receiver(&mut self) {
        self.receiver_woken = true;
    }

    fn wake_user(&mut self) {
        self.user_woken = true;
    }
}
