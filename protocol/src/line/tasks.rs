//! What tasks ask of a line's machine, with the line's interrupts off.

use super::{Buffer, Interval, LineMachine, Phase, Verdict, Wire};
use crate::frame::ReceiveErrors;
use crate::rtu::Transmission;

impl LineMachine {
    /// A good frame, which is lent by this, as its length without check bytes; or a damaged one, as its errors.
    ///
    /// Each damaged frame is told once, up to 255 that wait to be fetched; where several do, each with the errors of all. They
    /// come first: whoever answers the good frame may be asked how many there were.
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

    /// Lends the buffer to somebody who wants to transmit, if the wire is silent, or about to be, and the buffer free; else
    /// [`Wire::wake_user`] is called when it may be.
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

    /// The verdict over the frame that is lent: `None` before t3.5, [`Wire::wake_user`] is called when it is there.
    #[inline]
    pub fn verdict(&mut self) -> Option<bool> {
        if self.verdict == Verdict::Pending {
            self.silence_awaited = true;
            return None;
        }
        Some(self.verdict != Verdict::Void)
    }

    /// Whether no frame is coming in that may be a good one, nor waits to be [fetched](LineMachine::fetch): then the errors of what is
    /// coming in, none if nothing is. `None` while there is such a frame; [`Wire::wake_user`] is called when that ends.
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
            // A character that has begun is there before t3.5 is over.
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

    /// Whether an answer is on the wire, or DE up for it.
    #[inline]
    pub fn is_sending(&self) -> bool {
        matches!(self.phase, Phase::Leading | Phase::Sending)
    }

    /// Whether a task has the buffer.
    #[inline]
    pub fn is_lent(&self) -> bool {
        self.buffer == Buffer::Lent
    }

    /// What became of the bytes released: whether they went out, all of them; `None` while they are on the wire or will be at
    /// t3.5, [`Wire::wake_user`] is called when that ends.
    #[inline]
    pub fn sent(&self) -> Option<bool> {
        if self.is_sending() || self.is_released() {
            return None;
        }
        Some(self.verdict == Verdict::Sent)
    }

    /// Whether what was released last was cut off, since the transmitter did not come to its end.
    #[inline]
    pub fn was_cut(&self) -> bool {
        self.verdict == Verdict::Cut
    }

    /// The first `len` bytes of the buffer are to be sent: at t3.5 if the frame stands then, at once if it does, and not at all
    /// if it is void or somebody has talked since: whoever asked has given up by then, and might take it for another's.
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
                // Somebody may have begun to talk: it waits until t3.5 has passed without.
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

    /// The buffer is the line's again. An answer that has not started is withdrawn, one that has ends with the bytes that the
    /// transmitter holds.
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
        self.tell_silence(wire);
        wire.frame_is_back();
    }
}
