//! The wire, and a USART with a timer on it, in ticks.
//!
//! As on the chip: a character is received in the middle of its stop bit, the transmitter holds one byte more than it sends,
//! the alarm is a compare register that goes off again each time the timer has gone round, and start bits are seen as edges
//! on the wire, if at all.

mod chip;

pub use chip::Chip;

use multidrop_protocol::Adu;
use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::line::{Ascii, LineMachine, Wire};
use multidrop_protocol::rtu::Reception;

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

/// A character of another station.
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

    /// The end of the last character that was or will be sent.
    pub fn last_end(&self) -> u64 {
        let chip = &self.chip;
        let heard = chip
            .chars
            .last()
            .map_or(0, |last| last.start + chip.settings.character);
        let said = chip.talks.last().map_or(0, |talk| talk.end);
        // It is still being sent, and its end is unknown.
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

    /// Lends the buffer for a transmission, as with [`LineMachine::take_buffer`].
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
