//! The rules by which a line turns silence into frames and sends answers (SER 2.5.1.1): a state machine without a clock.
//!
//! What is said here is true of RTU; [`ascii`] says what is different there.
//!
//! The driver of a USART tells it what happened: a character came, the alarm went off, the transmitter is ready or done. It
//! tells the driver what to do through [`Wire`]. Interrupts call the `on_...` methods, futures the others with interrupts
//! off: those of every chip, by what is its [`Chip`].
//!
//! A character is known to a USART when it is over. That one has *begun* within t1.5, or within t3.5, is known only a whole
//! character later, unless the driver can see start bits ([`Wire::start_bit_seen`]). At t1.5 and at t3.5 the machine looks;
//! if a character is under way it waits for it before it decides.
//!
//! A client may send its next request exactly t3.5 after another server's answer, by a clock that is not ours. A driver
//! therefore has the frame judged before t3.5 by [`margin`](crate::timing::margin), so that such a request is not taken for a
//! late part of the frame before: that one stands, is carried out, and its answer is withdrawn. Answers start at t3.5 all the
//! same. Only the character itself tells that it is one and no edge: an answer waits for it. The frame before has the buffer
//! then, so the machine keeps the first character until a second one comes.
//!
//! | phase | a character | the alarm |
//! |---|---|---|
//! | a frame comes in | is stored | t1.5: the frame is complete, lent as provisional |
//! | complete | voids the frame | t3.5 less the margin: the frame stands |
//! | settled | begins a frame | t3.5: a released answer starts; a start bit is waited for |
//! | silent | begins a frame | - |
//! | sending | - (the receiver is off) | what is sent takes too long: the bus is let go of |
//! | sent | begins a frame | t3.5: silent |

pub mod ascii;
mod chip;
mod config;
mod tasks;
mod wire;

pub use ascii::Ascii;
pub use chip::{Chip, Observer, Waiting};
pub use config::{LineConfig, LineError, Role};
pub use wire::{Interval, Wire};

use crate::frame::ReceiveErrors;
use crate::rtu::Transmission;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Phase {
    Collecting,
    /// A frame comes in, and a start bit was seen when the alarm went off.
    Begun,
    Complete,
    /// A frame is complete, and a start bit was seen when the alarm went off.
    CompleteBegun,
    /// The frame stands; t3.5 is near.
    Settled,
    Silent,
    /// DE is up, and the first character not on its way yet.
    Leading,
    Sending,
    Sent,
}

/// What became of the frame that is lent, or is about to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Verdict {
    None,
    Pending,
    Stands,
    /// The frame stands, but it is too late for an answer: another station has sent since.
    Late,
    /// It stood, and what was released was cut off.
    Cut,
    /// It stood, and what was released is on the wire, or has been.
    Sent,
    Void,
}

/// Who has the buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Buffer {
    /// The line: the next frame may be stored.
    Free,
    /// The line, with a complete frame in it.
    Full,
    /// A task has it.
    Lent,
}

/// One line. See the module.
#[derive(Debug)]
pub struct LineMachine {
    phase: Phase,
    verdict: Verdict,
    buffer: Buffer,
    /// Of the frame until it is fetched; then of the answer that starts at t3.5, 0 for none.
    len: u8,
    /// ReceiveErrors of the frame on the wire.
    errors: ReceiveErrors,
    /// ReceiveErrors of the damaged frames not yet fetched, and how many these are.
    damaged: ReceiveErrors,
    damaged_count: u8,
    /// The first byte of the answer, taken from `transmission` ahead of time; or, with [`ReceiveErrors::KEPT`], of the frame on the
    /// wire.
    first: u8,
    /// A future waits for the verdict or for silence; nobody else needs to be woken at t3.5.
    silence_awaited: bool,
    transmission: Transmission,
}

impl LineMachine {
    /// A line that has heard nothing yet; [`reset`](LineMachine::reset) starts it.
    pub const fn new() -> LineMachine {
        LineMachine {
            phase: Phase::Complete,
            verdict: Verdict::None,
            buffer: Buffer::Free,
            len: 0,
            errors: ReceiveErrors::NONE,
            damaged: ReceiveErrors::NONE,
            damaged_count: 0,
            first: 0,
            silence_awaited: false,
            transmission: Transmission::new(),
        }
    }

    /// Begins to listen, at start or with new settings: to nothing before t3.5 of silence, since a frame may be half over. A
    /// frame that was pending is void, and one that stands is no longer answered.
    pub fn reset<W: Wire>(&mut self, wire: &mut W) {
        self.errors = ReceiveErrors::NONE;
        self.void(wire);
        // Who asked may not be on the line any more.
        self.withhold(wire);
        if W::HAS_DELAYS {
            wire.end_delay();
        }
        // An ASCII frame says itself where it begins.
        self.phase = if wire.ascii().is_some() {
            Phase::Settled
        } else {
            Phase::Complete
        };
        wire.clear_start_bit();
        wire.alarm(Interval::T3_5);
        wire.alarm_on();
    }

    /// Whether the next good character of RTU just goes to the buffer, if that has room. A driver may take it without asking
    /// [`on_character`](LineMachine::on_character).
    #[inline(always)]
    pub fn is_collecting(&self) -> bool {
        self.phase == Phase::Collecting && self.errors.is_empty()
    }

    /// A character came, with what the USART found wrong with it; `full` if the buffer has no room for it. The driver has set
    /// the alarm to the end of the silence that would complete the frame. One that keeps a [`Reception`](crate::rtu::Reception)
    /// says `false`: that finds a frame too long itself.
    ///
    /// Returns a byte that is to be stored. Where that was not [taken](Wire::take), it is the character before: the one that
    /// came is in the USART still, and the driver comes here with it once more.
    #[inline]
    pub fn on_character<W: Wire>(
        &mut self,
        wire: &mut W,
        errors: ReceiveErrors,
        full: bool,
    ) -> Option<u8> {
        match self.phase {
            Phase::Collecting | Phase::Begun => {
                if self.errors == ReceiveErrors::KEPT {
                    self.errors = ReceiveErrors::NONE;
                    if self.buffer == Buffer::Free {
                        self.phase = Phase::Collecting;
                        return Some(self.first);
                    }
                    // The frame before is still being worked on.
                    self.errors = ReceiveErrors::OVERRUN;
                } else if full {
                    self.errors |= ReceiveErrors::LENGTH;
                }
            }
            Phase::Complete | Phase::CompleteBegun => {
                // Between t1.5 and t3.5: what was complete is void, and this belongs to it.
                self.errors |= ReceiveErrors::GAP;
                self.void(wire);
            }
            Phase::Settled | Phase::Silent | Phase::Sent => {
                wire.restart();
                self.withhold(wire);
                self.errors = ReceiveErrors::NONE;
                wire.alarm_on();
            }
            Phase::Leading | Phase::Sending => {
                // The receiver is off.
                wire.take();
                return None;
            }
        }
        self.phase = Phase::Collecting;
        self.errors |= errors;
        let byte = wire.take();
        // Only a frame without errors is stored: one that is damaged may come while the buffer is lent.
        if !self.errors.is_empty() {
            self.tell_silence(wire);
            return None;
        }
        if self.buffer != Buffer::Free {
            // Nothing is to be sent any more, so there is room for one here.
            self.first = byte;
            self.errors = ReceiveErrors::KEPT;
            return None;
        }
        Some(byte)
    }

    /// The frame that comes in has no room: for a driver that has stored a character without asking
    /// [`on_character`](LineMachine::on_character).
    #[inline(always)]
    pub fn on_too_long<W: Wire>(&mut self, wire: &mut W) {
        self.errors |= ReceiveErrors::LENGTH;
        self.tell_silence(wire);
    }

    /// Wakes whoever waits for the verdict, for silence, or for a good frame.
    #[inline(always)]
    fn tell_silence<W: Wire>(&mut self, wire: &mut W) {
        if self.silence_awaited {
            self.silence_awaited = false;
            wire.wake_user();
        }
    }

    /// The alarm went off: some silence is over.
    #[inline(always)]
    pub fn on_alarm<W: Wire>(&mut self, wire: &mut W) {
        match self.phase {
            Phase::Collecting | Phase::Begun if wire.ascii().is_some() => self.on_ascii_alarm(wire),
            Phase::Collecting | Phase::Begun => self.on_complete(wire),
            Phase::Complete | Phase::CompleteBegun => self.on_stand(wire),
            Phase::Settled => self.on_t3_5(wire),
            Phase::Leading if W::HAS_DELAYS => self.on_lead(wire),
            Phase::Sent => self.on_free(wire),
            Phase::Sending if W::IS_BOUNDED => {
                if wire.is_bound_over() {
                    self.cut_off(wire);
                }
            }
            Phase::Silent | Phase::Leading | Phase::Sending => wire.alarm_off(),
        }
    }

    #[inline(always)]
    fn on_complete<W: Wire>(&mut self, wire: &mut W) {
        let mut rest = Interval::ToStand;
        if self.phase == Phase::Begun {
            // The start bit was none: no character came of it.
            rest = Interval::ToStandLessCharacter;
        } else if wire.start_bit_seen() {
            self.phase = Phase::Begun;
            return self.await_character(wire);
        }
        self.phase = Phase::Complete;
        if self.errors.is_empty() {
            let heard = wire.finish();
            self.errors = heard.errors;
            if heard.errors.is_empty() {
                self.len = heard.len;
                self.buffer = Buffer::Full;
                self.verdict = Verdict::Pending;
            }
        }
        let pending = self.verdict == Verdict::Pending;
        if !wire.alarm(rest) {
            // Looked at, and waited for, just now.
            self.phase = Phase::CompleteBegun;
            self.on_stand(wire);
        }
        if pending {
            wire.wake_receiver();
        }
    }

    #[inline(always)]
    fn on_stand<W: Wire>(&mut self, wire: &mut W) {
        if self.phase == Phase::Complete && wire.start_bit_seen() {
            self.phase = Phase::CompleteBegun;
            return self.await_character(wire);
        }
        self.phase = Phase::Settled;
        if self.verdict == Verdict::Pending {
            self.verdict = Verdict::Stands;
        }
        if !self.errors.is_empty() {
            let errors = core::mem::take(&mut self.errors);
            self.tell(wire, errors);
        }
        if W::HAS_DELAYS {
            wire.begin_delay();
        }
        if !wire.alarm(Interval::ToStart) {
            self.on_t3_5(wire);
        }
        self.tell_silence(wire);
    }

    /// A start bit was seen: a character comes within the time of one, or it was none. One that begins from now on is another's,
    /// and seen as that.
    #[inline(always)]
    fn await_character<W: Wire>(&mut self, wire: &mut W) {
        wire.clear_start_bit();
        wire.alarm(Interval::Character);
    }

    /// A damaged frame is over.
    #[inline(always)]
    fn tell<W: Wire>(&mut self, wire: &mut W, errors: ReceiveErrors) {
        self.damaged |= errors;
        self.damaged_count = self.damaged_count.saturating_add(1);
        wire.wake_receiver();
    }

    /// t3.5 is over, and the delay behind it, if there is one, or a part of it.
    #[inline(always)]
    fn on_t3_5<W: Wire>(&mut self, wire: &mut W) {
        if W::HAS_DELAYS && !wire.is_delay_over() {
            return;
        }
        self.on_start(wire);
    }

    #[inline(always)]
    fn on_start<W: Wire>(&mut self, wire: &mut W) {
        if self.is_released() {
            if wire.start_bit_seen() {
                // An edge, or a character that has begun: which of them shows within one.
                return self.await_character(wire);
            }
            return self.start(wire);
        }
        self.on_free(wire);
    }

    /// A frame that is complete is none.
    #[inline(always)]
    fn void<W: Wire>(&mut self, wire: &mut W) {
        if self.verdict == Verdict::Pending {
            self.verdict = Verdict::Void;
            wire.wake_user();
        }
    }

    /// Where a frame stands, it is too late for an answer. Told at once: the buffer is needed for the frame that begins.
    #[inline(always)]
    fn withhold<W: Wire>(&mut self, wire: &mut W) {
        if self.verdict == Verdict::Stands {
            self.verdict = Verdict::Late;
            wire.wake_user();
        }
    }

    /// Whether an answer starts at t3.5, if nothing comes between.
    #[inline(always)]
    fn is_released(&self) -> bool {
        self.buffer == Buffer::Lent
            && self.len > 0
            && matches!(self.verdict, Verdict::Pending | Verdict::Stands)
    }

    /// t3.5 has passed on the wire.
    #[inline(always)]
    fn on_free<W: Wire>(&mut self, wire: &mut W) {
        wire.alarm_off();
        self.phase = Phase::Silent;
        if self.silence_awaited {
            self.silence_awaited = false;
            wire.wake_user();
        }
    }

    /// Gets an answer of `len` bytes ready to be started.
    fn prepare<W: Wire>(&mut self, wire: &mut W, len: u8) {
        self.len = len;
        if let Some(ascii) = wire.ascii() {
            self.first = ascii.prepare(len);
            return;
        }
        self.transmission.start(len);
        self.first = self.transmission.next(wire.adu()).unwrap_or(0);
    }

    #[inline(never)]
    fn start<W: Wire>(&mut self, wire: &mut W) {
        if W::HAS_DELAYS && wire.lead() {
            self.verdict = Verdict::Sent;
            self.phase = Phase::Leading;
            return;
        }
        self.talk(wire);
    }

    /// DE has been up for long enough. Who released the answer may have given up meanwhile.
    #[inline(always)]
    fn on_lead<W: Wire>(&mut self, wire: &mut W) {
        if self.verdict == Verdict::Sent {
            wire.alarm_off();
            return self.talk(wire);
        }
        self.let_go(wire);
    }

    #[inline(always)]
    fn talk<W: Wire>(&mut self, wire: &mut W) {
        wire.talk(self.first);
        if W::IS_BOUNDED {
            wire.bound(self.len);
        }
        self.verdict = Verdict::Sent;
        self.phase = Phase::Sending;
        if wire.is_ready() {
            self.on_ready(wire);
        }
    }

    /// The transmitter does not come to its end: the bus is let go of, and what was released is lost.
    #[inline(always)]
    fn cut_off<W: Wire>(&mut self, wire: &mut W) {
        self.verdict = Verdict::Cut;
        wire.cut();
        self.be_sent(wire);
    }

    /// What is being sent ends before its first character.
    #[inline(always)]
    fn let_go<W: Wire>(&mut self, wire: &mut W) {
        wire.listen();
        self.be_sent(wire);
    }

    /// The alarm, which is on, has ended what is being sent.
    #[inline(always)]
    fn be_sent<W: Wire>(&mut self, wire: &mut W) {
        self.phase = Phase::Sent;
        wire.alarm(Interval::T3_5Then);
        wire.wake_user();
    }

    /// The transmitter takes another byte.
    #[inline(always)]
    pub fn on_ready<W: Wire>(&mut self, wire: &mut W) {
        let next = if wire.is_text() {
            self.transmission.next_text(wire.adu())
        } else if let Some(ascii) = wire.ascii() {
            let position = ascii.transmission.position();
            let byte = wire.adu()[usize::from(position)];
            wire.ascii().and_then(|ascii| ascii.transmission.next(byte))
        } else {
            self.transmission.next(wire.adu())
        };
        match next {
            Some(byte) => {
                let last = self.is_over(wire);
                wire.put(byte, last);
            }
            None => wire.end(),
        }
    }

    /// Whether the transmitter has been given all there is.
    #[inline(always)]
    fn is_over<W: Wire>(&self, wire: &mut W) -> bool {
        if wire.is_text() {
            return self.transmission.is_text_over();
        }
        match wire.ascii() {
            Some(ascii) => ascii.transmission.is_over(),
            None => self.transmission.is_over(),
        }
    }

    /// The transmitter has sent all it had, stop bit included. That is not the end if it was not given the next byte in time:
    /// before the last byte is given this does nothing.
    ///
    /// A driver that has both to tell calls [`on_ready`](LineMachine::on_ready) first, and looks at the USART again: if that has
    /// got a byte, the transmission is not complete any more, and this is not called.
    #[inline(always)]
    pub fn on_sent<W: Wire>(&mut self, wire: &mut W) {
        if !self.is_over(wire) {
            return;
        }
        wire.listen();
        self.phase = Phase::Sent;
        wire.alarm(Interval::T3_5);
        wire.alarm_on();
        wire.wake_user();
    }
}

impl Default for LineMachine {
    fn default() -> LineMachine {
        LineMachine::new()
    }
}
