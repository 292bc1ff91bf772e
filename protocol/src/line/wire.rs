//! The interface of the line's state machine to a board.

use super::Ascii;
use crate::Adu;
use crate::frame::Received;

/// An interval for which the machine sets an alarm. Its ticks depend on the line's settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interval {
    /// From t1.5 to the judgement of the frame, which is t3.5 of the same silence less [the
    /// margin](crate::timing::margin). 0 where a gap over t1.5 is allowed, since the frame is then complete at its
    /// judgement.
    ToStand,
    /// [`ToStand`](Self::ToStand) less one character, which the machine has already waited for; at least 0.
    ToStandLessCharacter,
    /// From the judgement of the frame to t3.5; 0 if both are at the same time.
    ToStart,
    /// The time of one character.
    Character,
    /// The time t3.5, from now.
    T3_5,
    /// The time t3.5, from the moment in which the alarm went off: used after a transmission that was cut off.
    T3_5Then,
    /// A fortieth of a second, 25 ms, since a small timer cannot count the second that ASCII allows between
    /// characters.
    Fortieth,
}

/// A USART, a timer, and two tasks, as the machine uses them.
pub trait Wire {
    /// Whether the driver limits the time of a transmission. If not, the limit costs nothing.
    const IS_BOUNDED: bool = false;
    /// Whether the driver can delay an answer after t3.5, and raise DE before the first character. If not, the delays
    /// cost nothing.
    const HAS_DELAYS: bool = false;
    /// The line's state for ASCII, if the line is set up for ASCII now. A driver without ASCII does not implement
    /// this, and ASCII costs it nothing.
    #[inline(always)]
    fn ascii(&mut self) -> Option<&mut Ascii> {
        None
    }
    /// Whether the line sends bytes without a check ([`Framing::Text`](crate::format::Framing::Text)). A driver without text does
    /// not implement this.
    #[inline(always)]
    fn is_text(&self) -> bool {
        false
    }
    /// Reads the character that was received from the USART.
    fn take(&mut self) -> u8;
    /// Stores a byte of an ASCII frame in the buffer, which is not lent.
    #[inline(always)]
    fn store(&mut self, at: u8, byte: u8) {
        let _ = (at, byte);
    }
    /// Whether a start bit was seen since [`clear_start_bit`](Wire::clear_start_bit); `false` if the driver cannot tell.
    fn start_bit_seen(&mut self) -> bool;
    /// Clears the detector of start bits.
    fn clear_start_bit(&mut self);
    /// Sets the alarm to `interval` after the moment for which it last went off; for [`Interval::T3_5`] from now. If that moment
    /// has passed, the alarm goes off at once. Returns whether there is an interval to wait for.
    ///
    /// This does not enable the alarm: [`alarm_on`](Wire::alarm_on) does.
    fn alarm(&mut self, interval: Interval) -> bool;
    /// Enables the alarm. [`alarm`](Wire::alarm) has set it, or the driver, which sets it with each character.
    fn alarm_on(&mut self);
    /// Disables the alarm until [`alarm_on`](Wire::alarm_on), [`bound`](Wire::bound) or [`lead`](Wire::lead). The driver still sets
    /// it with each character, but the alarm does not go off.
    fn alarm_off(&mut self);
    /// Begins a new RTU frame, and drops the incoming one.
    fn restart(&mut self);
    /// The RTU frame that was received.
    fn finish(&mut self) -> Received;
    /// The buffer of the line.
    fn adu(&self) -> &Adu;
    /// Begins a transmission: receiver off, DE up, first character out.
    fn talk(&mut self, first: u8);
    /// Limits the time of a transmission, which has begun, of `len` bytes of unit id, function code and data, or of text: the alarm
    /// goes off after the time of their [characters](crate::format::Framing::characters) and of one more, or earlier. Enables the
    /// alarm.
    #[inline(always)]
    fn bound(&mut self, len: u8) {
        let _ = len;
    }
    /// Called when the alarm goes off during a transmission. Returns whether the limit has passed. If not, sets the alarm to the
    /// rest.
    #[inline(always)]
    fn is_bound_over(&mut self) -> bool {
        false
    }
    /// Begins the delay of an answer, counted from t3.5. Called when a frame stands or is over.
    #[inline(always)]
    fn begin_delay(&mut self) {}
    /// Ends the delay.
    #[inline(always)]
    fn end_delay(&mut self) {}
    /// Called at t3.5, and after each part of the delay. Returns whether the delay has passed. If not, sets the alarm to the rest,
    /// or to a part of it.
    #[inline(always)]
    fn is_delay_over(&mut self) -> bool {
        true
    }
    /// Called when an answer is about to start. If DE must be up for some time before the first character: turns the
    /// receiver off, raises DE, sets the alarm to the end of that time, enables it, and returns `true`.
    #[inline(always)]
    fn lead(&mut self) -> bool {
        false
    }
    /// Whether the transmitter accepts another byte.
    fn is_ready(&mut self) -> bool;
    /// Gives the transmitter a byte, the last one if `last`. After the last byte the driver also does what [`end`](Wire::end) does.
    fn put(&mut self, byte: u8, last: bool);
    /// Notes that there are no more bytes to send: the next interrupt is the end of the transmission.
    fn end(&mut self);
    /// Takes DE down and turns the receiver on. Forgets characters that wait in the USART, and start bits.
    fn listen(&mut self);
    /// Does what [`listen`](Self::listen) does, and drops the character that the transmitter holds.
    #[inline(always)]
    fn cut(&mut self) {
        self.listen();
    }
    /// Notes that the lent frame was given back, for a driver that limits how long a frame is kept.
    #[inline(always)]
    fn frame_is_back(&mut self) {}
    /// Wakes the task that waits for a frame.
    fn wake_receiver(&mut self);
    /// Wakes the task that has the frame, or waits to transmit.
    fn wake_user(&mut self);
}
