//! The rules by which a line turns silence into frames and sends answers (SER 2.5.1.1): a state machine without a clock.
//!
//! This page describes RTU, [`ascii`] the differences of ASCII. A frame is the run of characters between two silences of t3.5.
//!
//! The driver of a USART tells the machine what happened: a character came, the alarm went off, the transmitter is ready or done.
//! The machine tells the driver what to do through [`Wire`]. Interrupts call the `on_...` methods. Futures call the other methods
//! with interrupts off; they reach the machine through the [`Chip`].
//!
//! A USART reports a character when it is over. A character that has *begun* within t1.5 or t3.5 shows only a whole character
//! later, unless the driver can see start bits ([`Wire::start_bit_seen`]). The machine checks for a start bit at t1.5 and at t3.5.
//! If a character is under way, the machine waits for its end before it decides.
//!
//! A client may send its next request exactly t3.5 after another server's answer, measured by its own clock. A driver therefore has
//! a frame judged before t3.5, by [`margin`](crate::timing::margin). A request that begins in this margin does not void the frame:
//! the frame stands (is accepted) and is carried out, and its answer is withdrawn. Answers still start at t3.5. An edge on RXD may
//! be noise until its character is complete, so an answer waits for that character. A task still has the buffer with the frame
//! then, so the machine keeps the first character of the next frame until the second character comes.
//!
//! | phase | a character | the alarm |
//! |---|---|---|
//! | a frame comes in | is stored | t1.5: the frame is complete, lent as provisional |
//! | complete | voids the frame | t3.5 less the margin: the frame stands |
//! | settled | begins a frame | t3.5: a released answer starts, or waits while a start bit becomes a character |
//! | silent | begins a frame | - |
//! | sending | - (the receiver is off) | the transmission takes too long: the driver leaves the bus |
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
    /// The frame stands, and t3.5 is near.
    Settled,
    Silent,
    /// DE is up, and the first character has not started yet.
    Leading,
    Sending,
    Sent,
}

/// The verdict over the frame that is lent, or is about to be lent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Verdict {
    None,
    Pending,
    Stands,
    /// The frame stands, but an answer comes too late: another station has sent since.
    Late,
    /// The frame stands, and the released bytes were cut off.
    Cut,
    /// The frame stands, and the released bytes are on the wire or have been sent.
    Sent,
    Void,
}

/// The owner of the buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Buffer {
    /// The line owns the buffer and may store the next frame.
    Free,
    /// The line owns the buffer, which holds a complete frame.
    Full,
    /// A task owns the buffer.
    Lent,
}

/// The state machine of one line, as the [module](self) describes it.
#[derive(Debug)]
pub struct LineMachine {
    phase: Phase,
    verdict: Verdict,
    buffer: Buffer,
    /// Length of the frame until a task fetches it, then of the answer that starts at t3.5; 0 for no answer.
    len: u8,
    /// Errors of the frame on the wire.
    errors: ReceiveErrors,
    /// Errors of all damaged frames that no task has fetched yet, and the number of these frames.
    damaged: ReceiveErrors,
    damaged_count: u8,
    /// The first byte of the answer, taken from `transmission` ahead of time. With [`ReceiveErrors::KEPT`] the first byte of the
    /// frame on the wire.
    first: u8,
    /// A future waits for the verdict or for silence. No other task needs to be woken at t3.5.
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

    /// Begins to listen, at start or with new settings. An RTU line accepts no frame before t3.5 of silence, since a frame may be
    /// half over. A pending frame becomes void, and a frame that stands is no longer answered.
    pub fn reset<W: Wire>(&mut self, wire: &mut W) {
        self.errors = ReceiveErrors::NONE;
        self.void(wire);
        // The client that sent the request may have left the line.
        self.withhold(wire);
        if W::HAS_DELAYS {
            wire.end_delay();
        }
        // An ASCII frame begins with a character, so the line needs no silence first.
        self.phase = if wire.ascii().is_some() {
            Phase::Settled
        } else {
            Phase::Complete
        };
        wire.clear_start_bit();
        wire.alarm(Interval::T3_5);
        wire.alarm_on();
    }

    /// Whether the next good character of an RTU frame only goes to the buffer, if the buffer has room. A driver may store it
    /// without a call of [`on_character`](LineMachine::on_character).
    #[inline(always)]
    pub fn is_collecting(&self) -> bool {
        self.phase == Phase::Collecting && self.errors.is_empty()
    }

    /// Handles a character with the errors that the USART found in it. `full`: the buffer has no room for it; a driver with a
    /// [`Reception`](crate::rtu::Reception), which finds that out itself, passes `false`. The driver has set the alarm to the end
    /// of the silence that would complete the frame.
    ///
    /// Returns a byte to store. If this did not [take](Wire::take) the character, the byte is the character before: the new
    /// character is still in the USART, and the driver calls this for it once more.
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
                    // A task still works on the frame before.
                    self.errors = ReceiveErrors::OVERRUN;
                } else if full {
                    self.errors |= ReceiveErrors::LENGTH;
                }
            }
            Phase::Complete | Phase::CompleteBegun => {
                // Between t1.5 and t3.5: the complete frame is void, and this character belongs to it.
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
        // Only a frame without errors is stored: a damaged frame may come while the buffer is lent.
        if !self.errors.is_empty() {
            self.wake_waiting(wire);
            return None;
        }
        if self.buffer != Buffer::Free {
            // No answer will be sent now, so `first` has room for the character.
            self.first = byte;
            self.errors = ReceiveErrors::KEPT;
            return None;
        }
        Some(byte)
    }

    /// Notes that the incoming frame is too long, for a driver that stores without [`on_character`](LineMachine::on_character).
    #[inline(always)]
    pub fn on_too_long<W: Wire>(&mut self, wire: &mut W) {
        self.errors |= ReceiveErrors::LENGTH;
        self.wake_waiting(wire);
    }

    /// Wakes the task that waits for the verdict, for silence, or for a good frame.
    #[inline(always)]
    fn wake_waiting<W: Wire>(&mut self, wire: &mut W) {
        if self.silence_awaited {
            self.silence_awaited = false;
            wire.wake_user();
        }
    }

    /// Handles the alarm: an interval is over.
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
            // The start bit was noise: no character followed it.
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
            // The start bit was checked, and its character waited for, just now.
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
            self.count_damaged(wire, errors);
        }
        if W::HAS_DELAYS {
            wire.begin_delay();
        }
        if !wire.alarm(Interval::ToStart) {
            self.on_t3_5(wire);
        }
        self.wake_waiting(wire);
    }

    /// Waits for the character of a start bit: it comes within the time of one character, or the start bit was noise. A start bit
    /// that begins from now on belongs to another character, and is seen as such.
    #[inline(always)]
    fn await_character<W: Wire>(&mut self, wire: &mut W) {
        wire.clear_start_bit();
        wire.alarm(Interval::Character);
    }

    /// Reports a damaged frame that is over.
    #[inline(always)]
    fn count_damaged<W: Wire>(&mut self, wire: &mut W, errors: ReceiveErrors) {
        self.damaged |= errors;
        self.damaged_count = self.damaged_count.saturating_add(1);
        wire.wake_receiver();
    }

    /// Handles the end of t3.5, and of each part of the delay after it.
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
                // Noise, or the start bit of a character: the time of one character shows which.
                return self.await_character(wire);
            }
            return self.start(wire);
        }
        self.on_free(wire);
    }

    /// Voids a complete frame whose verdict is pending.
    #[inline(always)]
    fn void<W: Wire>(&mut self, wire: &mut W) {
        if self.verdict == Verdict::Pending {
            self.verdict = Verdict::Void;
            wire.wake_user();
        }
    }

    /// Gives up the answer to a frame that stands: it is too late. Wakes the task at once, since the next frame needs the buffer.
    #[inline(always)]
    fn withhold<W: Wire>(&mut self, wire: &mut W) {
        if self.verdict == Verdict::Stands {
            self.verdict = Verdict::Late;
            wire.wake_user();
        }
    }

    /// Whether an answer starts at t3.5, if no character comes before.
    #[inline(always)]
    fn is_released(&self) -> bool {
        self.buffer == Buffer::Lent
            && self.len > 0
            && matches!(self.verdict, Verdict::Pending | Verdict::Stands)
    }

    /// Handles a wire that has been silent for t3.5.
    #[inline(always)]
    fn on_free<W: Wire>(&mut self, wire: &mut W) {
        wire.alarm_off();
        self.phase = Phase::Silent;
        if self.silence_awaited {
            self.silence_awaited = false;
            wire.wake_user();
        }
    }

    /// Prepares an answer of `len` bytes for its start.
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

    /// Handles the end of the lead time of DE. The task that released the answer may have given it up meanwhile.
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

    /// Leaves the bus because the transmitter does not finish. The released bytes are lost.
    #[inline(always)]
    fn cut_off<W: Wire>(&mut self, wire: &mut W) {
        self.verdict = Verdict::Cut;
        wire.cut();
        self.be_sent(wire);
    }

    /// Ends a transmission before its first character.
    #[inline(always)]
    fn let_go<W: Wire>(&mut self, wire: &mut W) {
        wire.listen();
        self.be_sent(wire);
    }

    /// Ends a transmission when the alarm has gone off. The alarm is on.
    #[inline(always)]
    fn be_sent<W: Wire>(&mut self, wire: &mut W) {
        self.phase = Phase::Sent;
        wire.alarm(Interval::T3_5Then);
        wire.wake_user();
    }

    /// Gives the transmitter its next byte.
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

    /// Whether the transmitter has been given all bytes.
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

    /// Handles a transmitter that has sent all its bytes, stop bit included. The transmission is not over if the transmitter did
    /// not get the next byte in time: before the last byte is given, this does nothing.
    ///
    /// A driver that finds the transmitter ready and done calls [`on_ready`](LineMachine::on_ready) first, then reads the USART's
    /// status again. If the USART has got a byte, the transmission is not complete any more, and the driver does not call this.
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
