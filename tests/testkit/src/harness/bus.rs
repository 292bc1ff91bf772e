//! The wire, and a USART with a timer on it, in ticks.
//!
//! As on the chip: a character is received in the middle of its stop bit, the transmitter holds one byte more than it sends,
//! the alarm is a compare register that goes off again each time the timer has gone round, and start bits are seen as edges
//! on the wire, if at all.

use multidrop_protocol::Adu;
use multidrop_protocol::line::{Ascii, Interval, LineMachine, Wire};
use multidrop_protocol::rtu::{ReceiveErrors, Received, Reception};

/// The timer has 16 bits.
const TIMER_ROUND: u64 = 1 << 16;

/// 25 ms in ticks, where a character of 100 ticks is one of ten bits at 9600 baud.
const FORTIETH: u64 = 2400;
/// The second that may pass between characters of an ASCII frame.
pub const SECOND: u64 = 40 * FORTIETH;

/// How a line is set up. All times are in ticks.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Ten bits; a multiple of 20.
    pub character: u64,
    pub t1_5: u64,
    pub t3_5: u64,
    /// By how much a frame is judged before t3.5.
    pub early: u64,
    /// Whether a gap over t1.5 makes a frame bad.
    pub strict: bool,
    /// Whether the driver sees start bits. One that cannot waits a character longer everywhere.
    pub sees_start_bits: bool,
    /// Whether the driver stores the next good character of a frame without asking the machine.
    pub short_cut: bool,
    /// From the transmitter's being ready to its interrupt.
    pub ready_latency: u64,
}

impl Settings {
    fn half_stop(&self) -> u64 {
        self.character / 20
    }

    fn to_receive(&self) -> u64 {
        self.character - self.half_stop()
    }

    /// The silence a frame is complete after.
    fn complete(&self) -> u64 {
        if self.strict {
            self.t1_5
        } else {
            self.judged()
        }
    }

    /// What a driver that sees no start bits waits for in addition: until a character is received that has begun by then.
    fn blind(&self) -> u64 {
        if self.sees_start_bits {
            0
        } else {
            self.to_receive()
        }
    }

    /// The silence that a frame is over after.
    pub fn judged(&self) -> u64 {
        self.t3_5 - self.early
    }

    /// From the end of a frame to the moment it stands.
    pub fn to_stand(&self) -> u64 {
        self.judged() + self.blind()
    }

    /// From the end of a frame to the moment an answer starts that is ready by then.
    pub fn to_answer(&self) -> u64 {
        self.t3_5 + self.blind()
    }
}

/// A character that somebody else sends.
#[derive(Clone, Copy, Debug)]
pub struct Char {
    /// Where its start bit begins.
    pub start: u64,
    pub byte: u8,
    pub errors: ReceiveErrors,
}

/// What the unit has sent in one piece.
#[derive(Clone, Debug)]
pub struct Talk {
    pub start: u64,
    /// Where DE goes down.
    pub end: u64,
    pub bytes: Vec<u8>,
    /// The first character of the request that it answers.
    pub request: usize,
    /// The most bytes it may have, if the task let go of the buffer before it was over.
    pub cut: Option<usize>,
}

struct Sending {
    /// Where the character in the shift register is over; none in it if `None`.
    shifted: Option<u64>,
    holding: Option<u8>,
    /// When the ready interrupt comes.
    ready: Option<u64>,
    ready_enabled: bool,
    /// All was sent while the ready interrupt was late; told after it.
    done: bool,
}

/// The chip.
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
    /// What was complete, to see that nobody has touched it when it is fetched.
    kept: Option<(u8, Adu)>,
    pub ascii: Option<Ascii>,
    adu: Adu,
    reception: Reception,
    stored: usize,
    next: usize,
    next_glitch: usize,
    last_edge: u64,
    cleared: u64,
    compare: u64,
    /// How often the alarm went off since it was set.
    rounds: u64,
    alarm_enabled: bool,
    sending: Option<Sending>,
    /// A character that nobody has taken out of the receiver.
    waiting: Option<u8>,
}

/// The chip and the machine.
pub struct Bus {
    pub chip: Chip,
    pub machine: LineMachine,
}

impl Bus {
    /// Listens from tick 1 on, to RTU.
    pub fn new(settings: Settings) -> Bus {
        Bus::with(settings, None)
    }

    /// Listens from tick 1 on, to ASCII.
    pub fn ascii(settings: Settings) -> Bus {
        Bus::with(settings, Some(Ascii::new()))
    }

    fn with(settings: Settings, ascii: Option<Ascii>) -> Bus {
        assert!(settings.character.is_multiple_of(20));
        assert!(settings.t3_5 + 2 * settings.character < TIMER_ROUND);
        let mut bus = Bus {
            chip: Chip {
                settings,
                now: 1,
                chars: Vec::new(),
                glitches: Vec::new(),
                talks: Vec::new(),
                receiver_woken: false,
                user_woken: false,
                incoming: 0,
                complete: 0,
                lent: None,
                kept: None,
                ascii,
                adu: [0; 256],
                reception: Reception::new(),
                stored: 0,
                next: 0,
                next_glitch: 0,
                last_edge: 0,
                cleared: 0,
                compare: 0,
                rounds: 0,
                alarm_enabled: false,
                sending: None,
                waiting: None,
            },
            machine: LineMachine::new(),
        };
        bus.reset();
        bus
    }

    /// The end of the last character that anybody has sent or is going to.
    pub fn last_end(&self) -> u64 {
        let chip = &self.chip;
        let heard = chip
            .chars
            .last()
            .map_or(0, |last| last.start + chip.settings.character);
        let said = chip.talks.last().map_or(0, |talk| talk.end);
        // Not over yet: nobody knows when it will be.
        heard.max(if said == u64::MAX { 0 } else { said })
    }

    /// New settings, which here are the old ones; as a driver does it, not while an answer is on the wire.
    pub fn reset(&mut self) {
        if !self.machine.is_sending() {
            self.machine.reset(&mut self.chip);
        }
    }

    /// A good frame is lent by this, as with [`LineMachine::fetch`].
    pub fn fetch(&mut self) -> Option<Result<u8, ReceiveErrors>> {
        let fetched = self.machine.fetch();
        if let Some(Ok(len)) = fetched {
            assert_eq!(self.chip.lent, None, "lent twice");
            if self.chip.ascii.is_none() {
                let (kept_len, kept) = self.chip.kept.take().expect("no frame was complete");
                assert_eq!(len, kept_len);
                assert!(kept == self.chip.adu, "changed before it was fetched");
            }
            self.chip.lent = Some(self.chip.complete);
        }
        fetched
    }

    /// Lends the buffer to somebody who wants to transmit, as with [`LineMachine::take_buffer`].
    pub fn take_buffer(&mut self) -> bool {
        let taken = self.machine.take_buffer();
        if taken {
            assert_eq!(self.chip.lent, None, "lent twice");
            self.chip.lent = Some(self.chip.chars.len());
        }
        taken
    }

    /// Lets pass what happens of itself until `end`.
    pub fn pass(&mut self, end: u64) {
        loop {
            while self.step() {}
            match self.next_event() {
                Some(at) if at <= end => self.chip.now = at,
                _ => break,
            }
        }
        self.chip.now = end;
    }

    /// The buffer, for the task it is lent to.
    pub fn adu(&mut self) -> &mut Adu {
        assert!(self.chip.lent.is_some(), "the buffer is not lent");
        &mut self.chip.adu
    }

    pub fn release(&mut self, len: u8) {
        assert!(self.chip.lent.is_some());
        self.machine.release(&mut self.chip, len);
    }

    pub fn give_back(&mut self) {
        let chip = &mut self.chip;
        assert!(chip.lent.take().is_some(), "given back twice");
        if let Some(sending) = &chip.sending
            && let Some(talk) = chip.talks.last_mut()
        {
            let held = usize::from(sending.holding.is_some());
            talk.cut = Some(talk.bytes.len() + held);
        }
        self.machine.give_back(&mut self.chip);
    }

    /// When something happens next; `None` if nothing will of itself.
    pub fn next_event(&self) -> Option<u64> {
        let chip = &self.chip;
        [
            chip.alarm_enabled.then(|| chip.next_alarm()),
            chip.next_reception(),
            chip.sending.as_ref().and_then(|sending| sending.ready),
            chip.sending.as_ref().and_then(|sending| sending.shifted),
        ]
        .into_iter()
        .flatten()
        .min()
    }

    /// Lets happen what is due now, one thing at a time; whether there was any.
    pub fn step(&mut self) -> bool {
        let chip = &mut self.chip;
        let alarm = chip.alarm_enabled && chip.next_alarm() <= chip.now;
        let received = chip.next_reception().is_some_and(|at| at <= chip.now);
        // A driver that sees no start bits has to give way to a character that comes with the alarm.
        if alarm && (chip.settings.sees_start_bits || !received) {
            chip.rounds += 1;
            self.machine.on_alarm(chip);
        } else if received {
            self.receive();
        } else if chip.is_due(|sending| sending.shifted) {
            self.shift();
        } else if chip.is_due(|sending| sending.ready) {
            self.ready();
        } else {
            return false;
        }
        true
    }

    fn receive(&mut self) {
        let chip = &mut self.chip;
        chip.note_edges();
        let index = chip.next;
        chip.next += 1;
        let Char {
            start,
            byte,
            errors,
        } = chip.chars[index];
        let talk = chip.talks.last();
        if chip.sending.is_some() || talk.is_some_and(|talk| start < talk.end) {
            // The receiver was off for all or a part of it.
            return;
        }
        if chip.ascii.is_some() {
            chip.set_compare(chip.now + chip.settings.half_stop() + FORTIETH);
            chip.clear_start_bit();
            return self.machine.on_ascii_character(chip, byte, errors);
        }
        let silence = chip.settings.complete() + chip.settings.blind();
        chip.set_compare(chip.now + chip.settings.half_stop() + silence);
        chip.clear_start_bit();
        chip.waiting = Some(byte);
        while let Some(byte) = chip.waiting {
            let full = chip.stored == 256;
            let plain = self.machine.is_collecting() && errors.is_empty() && !full;
            let store = if chip.settings.short_cut && plain {
                chip.waiting = None;
                Some(byte)
            } else {
                self.machine.on_character(chip, errors, full)
            };
            if let Some(byte) = store {
                chip.store(byte);
            }
        }
    }

    /// A character has left the shift register.
    fn shift(&mut self) {
        let chip = &mut self.chip;
        let sending = chip.sending.as_mut().unwrap();
        sending.shifted = None;
        match sending.holding.take() {
            Some(byte) => chip.shift_in(byte),
            None if sending.ready.is_some() => sending.done = true,
            None => self.machine.on_sent(chip),
        }
    }

    fn ready(&mut self) {
        let chip = &mut self.chip;
        chip.sending.as_mut().unwrap().ready = None;
        self.machine.on_ready(chip);
        let sending = chip.sending.as_mut();
        if sending.is_some_and(|sending| std::mem::take(&mut sending.done)) {
            self.machine.on_sent(chip);
        }
    }
}

impl Chip {
    fn next_reception(&self) -> Option<u64> {
        let next = self.chars.get(self.next)?;
        Some(next.start + self.settings.to_receive())
    }

    fn next_alarm(&self) -> u64 {
        self.compare + self.rounds * TIMER_ROUND
    }

    fn set_compare(&mut self, at: u64) {
        self.compare = at;
        // What is reached already is reached again a round later.
        self.rounds = u64::from(at <= self.now);
    }

    fn is_due(&self, when: fn(&Sending) -> Option<u64>) -> bool {
        let at = self.sending.as_ref().and_then(when);
        at.is_some_and(|at| at <= self.now)
    }

    fn store(&mut self, byte: u8) {
        assert_eq!(self.lent, None, "stored while the buffer is lent");
        assert!(self.kept.is_none(), "stored over a frame");
        assert!(self.sending.is_none(), "stored over an answer");
        assert!(self.stored < 256, "stored beyond the buffer");
        self.reception.push(&mut self.adu, byte);
        self.stored += 1;
    }

    /// Takes in the edges up to now.
    fn note_edges(&mut self) {
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

    fn shift_in(&mut self, byte: u8) {
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
