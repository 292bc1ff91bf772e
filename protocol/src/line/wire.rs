//! What the line's state machine needs of a board.

use super::Ascii;
use crate::Adu;
use crate::frame::Received;

/// An interval that the machine asks an alarm for. How many ticks it has depends on the line's settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interval {
    /// From t1.5 to the moment in which the frame is judged, t3.5 of the same silence less [the margin](crate::timing::margin);
    /// nothing where a gap over t1.5 is allowed, since that moment completes a frame there.
    ToStand,
    /// As long as [`ToStand`](Self::ToStand) less one character, which was waited for already; at least 0.
    ToStandLessCharacter,
    /// From the moment in which the frame is judged to t3.5; nothing if they are the same.
    ToStart,
    /// The time of one character.
    Character,
    /// t3.5, from now.
    T3_5,
    /// t3.5, from the moment in which the alarm went off: behind a transmission that was cut off.
    T3_5Then,
    /// A fortieth of a second, 25 ms: a small timer cannot count the second that ASCII allows between characters.
    Fortieth,
}

/// What the machine needs of a USART, a timer, and two tasks.
pub trait Wire {
    /// Whether the driver bounds the time for which it sends. What is for that costs one that does not nothing.
    const IS_BOUNDED: bool = false;
    /// Whether the driver can have an answer wait after t3.5, and DE go up before the first character. What is for that costs one
    /// that cannot nothing.
    const HAS_DELAYS: bool = false;
    /// What the line keeps for ASCII, if it is set up for that now. A driver that never is has nothing to do, and what is for
    /// ASCII costs it nothing.
    #[inline(always)]
    fn ascii(&mut self) -> Option<&mut Ascii> {
        None
    }
    /// Whether what is sent are bytes without a check ([`Framing::Text`](crate::format::Framing::Text)). A driver that never
    /// does so has nothing to do.
    #[inline(always)]
    fn is_text(&self) -> bool {
        false
    }
    /// The character that came, out of the USART.
    fn take(&mut self) -> u8;
    /// Stores a byte of an ASCII frame in the buffer, which is not lent.
    #[inline(always)]
    fn store(&mut self, at: u8, byte: u8) {
        let _ = (at, byte);
    }
    /// Whether a start bit was seen since [`clear_start_bit`](Wire::clear_start_bit); `false` if the driver cannot tell.
    fn start_bit_seen(&mut self) -> bool;
    /// Forgets start bits.
    fn clear_start_bit(&mut self);
    /// Sets the alarm to `interval` after the moment it last went off for, or from now for [`Interval::T3_5`]. Returns
    /// whether there is anything to wait for.
    fn alarm(&mut self, interval: Interval) -> bool;
    /// Lets the alarm that the driver sets with each character go off.
    fn alarm_on(&mut self);
    /// No alarm until the next is set.
    fn alarm_off(&mut self);
    /// The RTU frame coming in starts anew.
    fn restart(&mut self);
    /// The RTU frame that has come in.
    fn finish(&mut self) -> Received;
    /// The buffer of the line.
    fn adu(&self) -> &Adu;
    /// Receiver off, DE up, first character out.
    fn talk(&mut self, first: u8);
    /// A transmission of `len` bytes of unit id, function code and data, or of text, has begun: has the alarm go off when the time
    /// of the characters that these take, and of one more, is over. It may go off before.
    #[inline(always)]
    fn bound(&mut self, len: u8) {
        let _ = len;
    }
    /// The alarm went off while the driver sends: whether that time is over. If not the alarm is set for what is left.
    #[inline(always)]
    fn is_bound_over(&mut self) -> bool {
        false
    }
    /// A frame stands, or is over: an answer to it waits for the delay that is set, counted from t3.5.
    #[inline(always)]
    fn begin_delay(&mut self) {}
    /// Nothing is left of the delay.
    #[inline(always)]
    fn end_delay(&mut self) {}
    /// t3.5, or a part of the delay, is over: whether nothing is left of it. If there is, the alarm is set for that or a part of it.
    #[inline(always)]
    fn is_delay_over(&mut self) -> bool {
        true
    }
    /// An answer is to start. Where DE has to be up for some time before the first character: receiver off, DE up, the alarm on and
    /// set to the end of that time, and `true`.
    #[inline(always)]
    fn lead(&mut self) -> bool {
        false
    }
    /// Whether the transmitter takes another byte.
    fn is_ready(&mut self) -> bool;
    /// One more byte; the last one if `last`.
    fn put(&mut self, byte: u8, last: bool);
    /// Nothing more to put.
    fn end(&mut self);
    /// DE down, receiver on.
    fn listen(&mut self);
    /// Does what [`listen`](Self::listen) does, and drops the character that the transmitter holds.
    #[inline(always)]
    fn cut(&mut self) {
        self.listen();
    }
    /// The frame that was lent is given back: for a driver that bounds how long one is kept.
    #[inline(always)]
    fn frame_is_back(&mut self) {}
    /// Wakes the task that waits for a frame.
    fn wake_receiver(&mut self);
    /// Wakes the task that has the frame, or waits to transmit.
    fn wake_user(&mut self);
}
