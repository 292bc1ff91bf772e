//! The methods of a line's machine for tasks. They are called with the line's interrupts off.

use super::{Buffer, Interval, LineMachine, Phase, Verdict, Wire};
use crate::frame::ReceiveErrors;
use crate::rtu::Transmission;

impl LineMachine {
    /// Fetches and lends a good frame, as its length without check bytes, or fetches a damaged frame, as its errors.
    ///
    /// Each damaged frame is reported once. Up to 255 damaged frames wait to be fetched; if several wait, each has the errors of
    /// all. Damaged frames come first: the good frame may ask for their number.
    #[inline]
    pub fn fetch(&mut self) -> Option<Result<u8, ReceiveErrors>> {
        if self.damaged_count > 0 {
            self.damaged_count -= 1;
            let errors = ReceiveErrors::from_bits_truncate(self.damaged.bits());
            if self.damaged_count == 0 {
                self.damaged = ReceiveErrors::NONE;
            }
            return Some(Err(errors));
        }
        if self.buffer == Buffer::Full {
            self.buffer = Buffer::Lent;
            return Some(Ok(core::mem::take(&mut self.len)));
        }
        None
    }

    /// Lends the buffer to a task that wants to transmit, if the wire is silent, or about to be, and the buffer is free. Otherwise
    /// [`Wire::wake_user`] is called when this may be so.
    #[inline]
    pub fn take_buffer(&mut self) -> bool {
        if matches!(self.phase, Phase::Settled | Phase::Silent) && self.buffer == Buffer::Free {
            self.buffer = Buffer::Lent;
            self.len = 0;
            self.verdict = Verdict::Stands;
            return true;
        }
        self.silence_awaited = true;
        false
    }

    /// The verdict over the lent frame: `None` before t3.5, and [`Wire::wake_user`] is called when the verdict is known.
    #[inline]
    pub fn verdict(&mut self) -> Option<bool> {
        if self.verdict == Verdict::Pending {
            self.silence_awaited = true;
            return None;
        }
        Some(self.verdict != Verdict::Void)
    }

    /// The errors of the incoming frame, none if no frame comes in. `None` while a frame that may be good comes in or waits to be
    /// [fetched](LineMachine::fetch); [`Wire::wake_user`] is called when that ends.
    #[inline]
    pub fn quiet<W: Wire>(&mut self, wire: &mut W) -> Option<ReceiveErrors> {
        let errors = match self.phase {
            Phase::Collecting | Phase::Begun | Phase::Complete | Phase::CompleteBegun => {
                match wire.ascii() {
                    Some(ascii) => ascii.errors(),
                    None if self.errors == ReceiveErrors::KEPT => ReceiveErrors::NONE,
                    None => self.errors,
                }
            }
            // A character that has begun is received before t3.5 is over.
            Phase::Settled | Phase::Silent if wire.start_bit_seen() => {
                wire.clear_start_bit();
                self.phase = Phase::Sent;
                wire.alarm(Interval::T3_5);
                wire.alarm_on();
                ReceiveErrors::NONE
            }
            Phase::Settled | Phase::Silent if self.is_fetched() => {
                return Some(ReceiveErrors::NONE);
            }
            _ => ReceiveErrors::NONE,
        };
        if errors.is_empty() {
            self.silence_awaited = true;
            None
        } else {
            Some(errors)
        }
    }

    fn is_fetched(&self) -> bool {
        self.buffer != Buffer::Full && self.damaged_count == 0
    }

    /// Whether an answer is on the wire, or DE is up for an answer.
    #[inline]
    pub fn is_sending(&self) -> bool {
        matches!(self.phase, Phase::Leading | Phase::Sending)
    }

    /// Whether a task has the buffer.
    #[inline]
    pub fn is_lent(&self) -> bool {
        self.buffer == Buffer::Lent
    }

    /// Whether all released bytes were sent. `None` while they are on the wire or wait for t3.5; [`Wire::wake_user`] is called when
    /// that ends.
    #[inline]
    pub fn sent(&self) -> Option<bool> {
        if self.is_sending() || self.is_released() {
            return None;
        }
        Some(self.verdict == Verdict::Sent)
    }

    /// Whether the last released bytes were cut off because the transmitter did not finish.
    #[inline]
    pub fn was_cut(&self) -> bool {
        self.verdict == Verdict::Cut
    }

    /// Releases the first `len` bytes of the buffer: sent at t3.5 if the frame stands then, at once if t3.5 has passed. Not sent if
    /// the frame is void or another node has sent since: the client has given up, and might mistake them for another answer.
    #[inline]
    pub fn release<W: Wire>(&mut self, wire: &mut W, len: u8) {
        match self.verdict {
            Verdict::Pending => self.prepare(wire, len),
            Verdict::Stands if self.phase == Phase::Settled => self.prepare(wire, len),
            Verdict::Stands if self.phase == Phase::Silent => {
                if !wire.start_bit_seen() {
                    self.prepare(wire, len);
                    return self.start(wire);
                }
                // Another node may have begun to send: the answer waits until t3.5 has passed in silence.
                wire.clear_start_bit();
                self.prepare(wire, len);
                self.phase = Phase::Settled;
                if W::HAS_DELAYS {
                    wire.end_delay();
                }
                wire.alarm(Interval::T3_5);
                wire.alarm_on();
            }
            _ => {}
        }
    }

    /// Gives the buffer back to the line. An answer that has not started is withdrawn. An answer that has started ends with the
    /// bytes that the transmitter holds.
    #[inline]
    pub fn give_back<W: Wire>(&mut self, wire: &mut W) {
        self.verdict = Verdict::None;
        self.buffer = Buffer::Free;
        if self.phase == Phase::Sending {
            match wire.ascii() {
                Some(ascii) => ascii.transmission = crate::ascii::Transmission::new(),
                None => self.transmission = Transmission::new(),
            }
        }
        self.wake_waiting(wire);
        wire.frame_is_back();
    }
}
