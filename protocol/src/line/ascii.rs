//! The rules of an ASCII line (SER 2.5.2): characters begin and end a frame. Silence only says when to give up a frame and when to
//! answer.
//!
//! | phase | a character | the alarm |
//! |---|---|---|
//! | a frame comes in | `:` begins it anew, CR and delimiter end it: it stands | a second: it is damaged |
//! | settled | `:` begins a frame, any other starts t3.5 anew | t3.5: a released answer starts; silent |
//! | silent, or sent | `:` begins a frame, any other leads to settled | t3.5: silent |
//! | sending | - (the receiver is off) | - |
//!
//! The standard leaves these cases open:
//!
//! - A character with a receive error never counts as `:`, CR or delimiter. Outside a frame it is noise like any other.
//! - A `:` inside a frame begins the frame anew. The characters before it are no frame and are not reported, unless an error was
//!   found in them: then the damaged frame is reported at the `:`, or when its second is over.
//! - The buffer must be free when the first byte of a frame is whole, three characters after the end of the frame before.
//! - Characters outside a frame delay an answer and do not prevent it. A `:` prevents it, since a client asks anew.

use super::{Buffer, Interval, LineMachine, Phase, Verdict, Wire};
use crate::ascii::{DELIMITER, Decoded, Reception, START, Transmission};
use crate::frame::ReceiveErrors;

/// [`Interval::Fortieth`]s of the second that may pass between two characters (SER 2.5.2.1), after the first one.
const FORTIETHS: u8 = 39;

/// The state of a line for ASCII. The driver chooses where to keep it: a driver for RTU only has none.
#[derive(Debug)]
pub struct Ascii {
    pub(super) reception: Reception,
    pub(super) transmission: Transmission,
    /// Fortieths of a second that are left after the current one.
    fortieths: u8,
    delimiter: u8,
    /// Mask of the data bits of a character.
    mask: u8,
}

impl Ascii {
    /// Makes a state with LF as delimiter.
    pub const fn new() -> Ascii {
        Ascii {
            reception: Reception::new(DELIMITER),
            transmission: Transmission::new(),
            fortieths: 0,
            delimiter: DELIMITER,
            mask: 0xFF,
        }
    }

    /// Sets the data bits of a character, 7 or 8. The delimiter has no more bits than a character.
    pub fn set_data_bits(&mut self, data_bits: u8) {
        self.mask = if data_bits == 7 { 0x7F } else { 0xFF };
    }

    /// Changes the delimiter from the next frame on. A frame that comes in, or is released already, keeps its delimiter.
    pub fn set_delimiter(&mut self, delimiter: u8) {
        self.delimiter = delimiter;
    }

    /// The errors of the frame that comes in.
    pub(super) fn errors(&self) -> ReceiveErrors {
        self.reception.errors()
    }

    fn delimiter(&self) -> u8 {
        self.delimiter & self.mask
    }

    /// Prepares an answer of `len` bytes. Returns its first character.
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
    /// Handles a character on a line that is set up for ASCII, with the errors that the USART found in it. The driver has set the
    /// alarm to [`Interval::Fortieth`] from now.
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
            Decoded::More => self.wake_waiting(wire),
            Decoded::Byte { at, byte } => {
                if self.buffer == Buffer::Free {
                    wire.store(at, byte);
                } else {
                    // A task still works on the frame before.
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
            self.count_damaged(wire, damaged);
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
            self.count_damaged(wire, heard.errors);
        }
    }

    /// Handles the end of a part of the second in which another character may come.
    pub(super) fn on_ascii_alarm<W: Wire>(&mut self, wire: &mut W) {
        let Some(ascii) = wire.ascii() else { return };
        if self.phase == Phase::Begun {
            let errors = ascii.reception.errors() | ReceiveErrors::GAP;
            self.count_damaged(wire, errors);
            return self.on_free(wire);
        }
        let rest = match ascii.fortieths.checked_sub(1) {
            Some(left) => {
                ascii.fortieths = left;
                Interval::Fortieth
            }
            None => {
                // A character that has begun by now is received within the time of one character.
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
