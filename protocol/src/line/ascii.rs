//! The rules of an ASCII line (SER 2.5.2): characters begin and end a frame, and silence only says when to give one up and when
//! to answer.
//!
//! | phase | a character | the alarm |
//! |---|---|---|
//! | a frame comes in | `:` begins it anew, CR and delimiter end it: it stands | a second: it is damaged |
//! | settled | `:` begins a frame, else t3.5 begins anew | t3.5: a released answer starts; silent |
//! | silent, or sent | `:` begins a frame, else settled | t3.5: silent |
//! | sending | - (the receiver is off) | - |
//!
//! What the standard leaves open:
//!
//! - A character that comes with a flaw is never a `:`, CR or delimiter. Outside a frame it is noise like any other.
//! - A `:` inside a frame begins it anew. What came before was no frame and is not told, unless it was damaged already: a frame
//!   whose end was damaged is told then, or when its second is over.
//! - The buffer must be free when the first byte of a frame is whole, three characters after whatever was before.
//! - Characters outside a frame put an answer off and do not prevent it; a `:` does, since somebody asks anew.

use super::{Buffer, Interval, LineMachine, Phase, Verdict, Wire};
use crate::ascii::{DELIMITER, Decoded, Reception, START, Transmission};
use crate::frame::ReceiveErrors;

/// [`Interval::Fortieth`]s of the second that may pass between two characters (SER 2.5.2.1), behind the first of them.
const FORTIETHS: u8 = 39;

/// What a line keeps for ASCII. Where it stands is the driver's choice: one that knows RTU only has none.
#[derive(Debug)]
pub struct Ascii {
    pub(super) reception: Reception,
    pub(super) transmission: Transmission,
    /// Fortieths of a second left after the one that runs.
    fortieths: u8,
    delimiter: u8,
    /// The data bits of a character.
    mask: u8,
}

impl Ascii {
    /// With LF for delimiter.
    pub const fn new() -> Ascii {
        Ascii {
            reception: Reception::new(DELIMITER),
            transmission: Transmission::new(),
            fortieths: 0,
            delimiter: DELIMITER,
            mask: 0xFF,
        }
    }

    /// Characters have 7 or 8 data bits; a delimiter has no more.
    pub fn set_data_bits(&mut self, data_bits: u8) {
        self.mask = if data_bits == 7 { 0x7F } else { 0xFF };
    }

    /// Changes the delimiter from the next frame on. One that comes in or is released already keeps its own.
    pub fn set_delimiter(&mut self, delimiter: u8) {
        self.delimiter = delimiter;
    }

    /// Those of the frame that comes in.
    pub(super) fn errors(&self) -> ReceiveErrors {
        self.reception.errors()
    }

    fn delimiter(&self) -> u8 {
        self.delimiter & self.mask
    }

    /// An answer of `len` bytes is to be sent: its first character.
    pub(super) fn prepare(&mut self, len: u8) -> u8 {
        let delimiter = self.delimiter();
        self.transmission.start(len, delimiter);
        self.transmission.next(0).unwrap_or(START)
    }
}

impl Default for Ascii {
    fn default() -> Ascii {
        Ascii::new()
    }
}

impl LineMachine {
    /// A character came on a line that is set up for ASCII, with what the USART found wrong with it. The driver has set the alarm
    /// to [`Interval::Fortieth`] from now.
    #[inline]
    pub fn on_ascii_character<W: Wire>(
        &mut self,
        wire: &mut W,
        character: u8,
        errors: ReceiveErrors,
    ) {
        let Some(ascii) = wire.ascii() else { return };
        let step = match self.phase {
            Phase::Leading | Phase::Sending => return,
            Phase::Collecting | Phase::Begun => {
                ascii.fortieths = FORTIETHS;
                self.phase = Phase::Collecting;
                if errors.is_empty() {
                    ascii.reception.push(character)
                } else {
                    ascii.reception.add(errors);
                    Decoded::More
                }
            }
            _ if errors.is_empty() && character == START => Decoded::Start,
            _ => {
                self.phase = Phase::Settled;
                wire.alarm(Interval::T3_5);
                wire.alarm_on();
                return;
            }
        };
        match step {
            Decoded::More if ascii.errors().is_empty() => {}
            Decoded::More => self.tell_silence(wire),
            Decoded::Byte { at, byte } => {
                if self.buffer == Buffer::Free {
                    wire.store(at, byte);
                } else {
                    // The frame before is still being worked on.
                    ascii.reception.add(ReceiveErrors::OVERRUN);
                }
            }
            Decoded::Start => self.on_ascii_start(wire),
            Decoded::End => self.on_ascii_end(wire),
        }
    }

    fn on_ascii_start<W: Wire>(&mut self, wire: &mut W) {
        let Some(ascii) = wire.ascii() else { return };
        let mut damaged = ReceiveErrors::NONE;
        if self.phase == Phase::Collecting {
            damaged = ascii.reception.errors();
        }
        ascii.fortieths = FORTIETHS;
        ascii.reception = Reception::new(ascii.delimiter());
        self.phase = Phase::Collecting;
        wire.alarm_on();
        self.withhold(wire);
        if !damaged.is_empty() {
            self.tell(wire, damaged);
        }
    }

    fn on_ascii_end<W: Wire>(&mut self, wire: &mut W) {
        let Some(ascii) = wire.ascii() else { return };
        let heard = ascii.reception.finish();
        self.phase = Phase::Settled;
        if W::HAS_DELAYS {
            wire.begin_delay();
        }
        wire.alarm(Interval::T3_5);
        if heard.errors.is_empty() {
            self.len = heard.len;
            self.buffer = Buffer::Full;
            self.verdict = Verdict::Stands;
            wire.wake_receiver();
        } else {
            self.tell(wire, heard.errors);
        }
    }

    /// A part of the second is over in which another character may come.
    pub(super) fn on_ascii_alarm<W: Wire>(&mut self, wire: &mut W) {
        let Some(ascii) = wire.ascii() else { return };
        if self.phase == Phase::Begun {
            let errors = ascii.reception.errors() | ReceiveErrors::GAP;
            self.tell(wire, errors);
            return self.on_free(wire);
        }
        let rest = match ascii.fortieths.checked_sub(1) {
            Some(left) => {
                ascii.fortieths = left;
                Interval::Fortieth
            }
            None => {
                // One that has begun by now is received within a character.
                self.phase = Phase::Begun;
                Interval::Character
            }
        };
        wire.alarm(rest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_delimiter_has_as_many_bits_as_a_character() {
        for (data_bits, delimiter) in [(7, 0x23), (8, 0xA3)] {
            let mut ascii = Ascii::default();
            assert!(ascii.errors().is_empty());
            ascii.set_data_bits(data_bits);
            ascii.set_delimiter(0xA3);
            assert_eq!(ascii.prepare(2), b':');
            for character in *b"42427C\r" {
                assert_eq!(ascii.transmission.next(0x42), Some(character));
            }
            assert_eq!(ascii.transmission.next(0), Some(delimiter));
            assert_eq!(ascii.transmission.next(0), None);
        }
    }
}
