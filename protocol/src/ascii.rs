//! The ASCII frame: `:`, then unit id, PDU and LRC as two hexadecimal digits for each byte, then CR LF (SER 2.5.2).
//!
//! As with RTU, [`Reception`] and [`Transmission`] run in the interrupt, character by character, and what they hand over and
//! take is `[unit, function, data...]` in the same [`Adu`]: what is above the line sees no difference. [`encode`] and
//! [`decode`] do the same for a frame that is there as a whole.
//!
//! LF can be replaced by another character (APP 6.8, sub-function 03). Any will do, since CR stands before it: one that is also
//! a digit, `:` or CR has its other meaning everywhere else.

use crate::Adu;
use crate::rtu::{EncodeError, ReceiveErrors, Received};

/// Characters of the shortest ASCII frame: unit id, function code, LRC.
pub const ADU_MIN: usize = 9;
/// Characters of the longest ASCII frame (SER 2.5.2.1).
pub const ADU_MAX: usize = 513;

/// The character that begins a frame (SER 2.5.2.1).
pub const START: u8 = b':';
/// The character that ends a frame, behind CR, unless it is changed (SER 2.5.2.1).
pub const DELIMITER: u8 = b'\n';

const CR: u8 = b'\r';

/// Bytes of the shortest frame with its LRC, and of the longest.
const BYTES_MIN: u8 = 3;
const BYTES_MAX: u8 = 255;

/// In place of a digit where there is none.
const NO_DIGIT: u8 = 0xFF;

/// The check over unit id and PDU: the two's complement of their sum (SER 6.2.1). Added up with it they are 0.
pub fn lrc(bytes: &[u8]) -> u8 {
    let sum = bytes.iter().fold(0u8, |sum, &byte| sum.wrapping_add(byte));
    sum.wrapping_neg()
}

/// The value of a hexadecimal digit, upper or lower case.
const fn digit(character: u8) -> Option<u8> {
    match character {
        b'0'..=b'9' => Some(character - b'0'),
        b'A'..=b'F' => Some(character - b'A' + 10),
        b'a'..=b'f' => Some(character - b'a' + 10),
        _ => None,
    }
}

/// The digit of a value of 0..=15, upper case as SER 2.5.2 demands.
const fn character(digit: u8) -> u8 {
    if digit < 10 {
        b'0' + digit
    } else {
        b'A' + digit - 10
    }
}

/// What a character has done to the frame that comes in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decoded {
    /// The frame goes on.
    More,
    /// The same, and a byte of it is whole.
    Byte {
        /// Its place in the buffer.
        at: u8,
        /// Its value.
        byte: u8,
    },
    /// A `:`: what came before is no frame, one begins here.
    Start,
    /// CR and delimiter: the frame is over.
    End,
}

/// Puts a frame together as its characters come in, those behind the `:`.
#[derive(Clone, Copy, Debug)]
pub struct Reception {
    sum: u8,
    len: u8,
    /// The first digit of a byte whose second has not come yet.
    digit: u8,
    after_cr: bool,
    delimiter: u8,
    errors: ReceiveErrors,
}

impl Reception {
    /// Ready for the first character behind the `:` of a frame that this delimiter ends.
    #[inline(always)]
    pub const fn new(delimiter: u8) -> Reception {
        Reception {
            sum: 0,
            len: 0,
            digit: NO_DIGIT,
            after_cr: false,
            delimiter,
            errors: ReceiveErrors::NONE,
        }
    }

    /// Takes the next character. A frame with a flaw is followed to its end and gives no more bytes.
    #[inline]
    pub fn push(&mut self, character: u8) -> Decoded {
        if core::mem::take(&mut self.after_cr) {
            if character == self.delimiter {
                return Decoded::End;
            }
            self.errors |= ReceiveErrors::CHARACTER;
        }
        match character {
            START => return Decoded::Start,
            CR => self.after_cr = true,
            _ => match digit(character) {
                None => self.errors |= ReceiveErrors::CHARACTER,
                Some(digit) => return self.push_digit(digit),
            },
        }
        Decoded::More
    }

    #[inline(always)]
    fn push_digit(&mut self, digit: u8) -> Decoded {
        let first = core::mem::replace(&mut self.digit, NO_DIGIT);
        if first == NO_DIGIT {
            self.digit = digit;
            return Decoded::More;
        }
        if self.len == BYTES_MAX {
            self.errors |= ReceiveErrors::LENGTH;
        }
        if !self.errors.is_empty() {
            return Decoded::More;
        }
        let byte = first << 4 | digit;
        let at = self.len;
        self.len += 1;
        self.sum = self.sum.wrapping_add(byte);
        Decoded::Byte { at, byte }
    }

    /// Notes a character that came with errors, whatever it was, or a byte that could not be stored.
    #[inline(always)]
    pub fn add(&mut self, errors: ReceiveErrors) {
        self.after_cr = false;
        self.errors |= errors;
    }

    /// What is wrong so far, apart from not being over.
    #[inline(always)]
    pub const fn errors(&self) -> ReceiveErrors {
        self.errors
    }

    /// What has come in so far, taken for a whole frame.
    #[inline]
    pub const fn finish(&self) -> Received {
        let mut errors = self.errors;
        if self.sum != 0 {
            errors = errors.union(ReceiveErrors::CHECK);
        }
        if self.len < BYTES_MIN || self.digit != NO_DIGIT {
            errors = errors.union(ReceiveErrors::LENGTH);
        }
        Received {
            len: self.len.saturating_sub(1),
            errors,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Part {
    Start,
    FirstDigit,
    SecondDigit,
    Cr,
    Delimiter,
    Over,
}

/// Hands a frame out character by character.
#[derive(Clone, Copy, Debug)]
pub struct Transmission {
    part: Part,
    sum: u8,
    position: u8,
    len: u8,
    delimiter: u8,
}

impl Transmission {
    /// Nothing to send.
    #[inline(always)]
    pub const fn new() -> Transmission {
        Transmission {
            part: Part::Over,
            sum: 0,
            position: 0,
            len: 0,
            delimiter: DELIMITER,
        }
    }

    /// Begins a frame of `len` bytes of unit id and PDU, 2..=254, to be ended by this delimiter.
    #[inline(always)]
    pub fn start(&mut self, len: u8, delimiter: u8) {
        *self = Transmission {
            part: Part::Start,
            sum: 0,
            position: 0,
            len,
            delimiter,
        };
    }

    /// The place of the byte that [`next`](Transmission::next) needs.
    #[inline(always)]
    pub const fn position(&self) -> u8 {
        self.position
    }

    /// The next character to send, `None` when the frame is over. `byte` is what stands at [`position`](Transmission::position);
    /// behind the last byte it does not matter.
    #[inline]
    pub fn next(&mut self, byte: u8) -> Option<u8> {
        let is_lrc = self.position == self.len;
        let byte = if is_lrc {
            self.sum.wrapping_neg()
        } else {
            byte
        };
        let (next, part) = match self.part {
            Part::Start => (START, Part::FirstDigit),
            Part::FirstDigit => (character(byte >> 4), Part::SecondDigit),
            Part::SecondDigit => (
                character(byte & 0x0F),
                if is_lrc {
                    Part::Cr
                } else {
                    self.sum = self.sum.wrapping_add(byte);
                    self.position += 1;
                    Part::FirstDigit
                },
            ),
            Part::Cr => (CR, Part::Delimiter),
            Part::Delimiter => (self.delimiter, Part::Over),
            Part::Over => return None,
        };
        self.part = part;
        Some(next)
    }

    /// Whether [`next`](Transmission::next) has nothing more to give.
    #[inline(always)]
    pub const fn is_over(&self) -> bool {
        matches!(self.part, Part::Over)
    }
}

impl Default for Transmission {
    fn default() -> Transmission {
        Transmission::new()
    }
}

/// Makes a frame of unit id and PDU at the start of `out`, `delimiter` at its end.
///
/// # Errors
///
/// [`EncodeError`]; `out` is untouched then.
pub fn encode<'a>(
    unit_pdu: &[u8],
    delimiter: u8,
    out: &'a mut [u8],
) -> Result<&'a [u8], EncodeError> {
    let Some(len @ 2..=254) = u8::try_from(unit_pdu.len()).ok() else {
        return Err(EncodeError::Length);
    };
    let frame = out
        .get_mut(..2 * usize::from(len) + 5)
        .ok_or(EncodeError::Room)?;
    let mut transmission = Transmission::new();
    transmission.start(len, delimiter);
    for place in frame.iter_mut() {
        let byte = unit_pdu.get(usize::from(transmission.position()));
        if let Some(next) = transmission.next(byte.copied().unwrap_or(0)) {
            *place = next;
        }
    }
    Ok(frame)
}

/// Unit id and PDU of a whole frame, from `:` to `delimiter`, at the start of `out`.
///
/// # Errors
///
/// The [`ReceiveErrors`] of the frame: [`ReceiveErrors::CHARACTER`] too where it does not begin with `:`, has one inside, or goes on behind its
/// delimiter, [`ReceiveErrors::LENGTH`] where it has none. What is in `out` has no meaning then.
pub fn decode<'a>(adu: &[u8], delimiter: u8, out: &'a mut Adu) -> Result<&'a [u8], ReceiveErrors> {
    let mut reception = Reception::new(delimiter);
    let Some((&START, rest)) = adu.split_first() else {
        return Err(ReceiveErrors::CHARACTER);
    };
    for (index, &character) in rest.iter().enumerate() {
        match reception.push(character) {
            Decoded::More => {}
            Decoded::Byte { at, byte } => out[usize::from(at)] = byte,
            Decoded::End if index + 1 == rest.len() => {
                let heard = reception.finish();
                return if heard.errors.is_empty() {
                    Ok(&out[..usize::from(heard.len)])
                } else {
                    Err(heard.errors)
                };
            }
            Decoded::Start | Decoded::End => reception.add(ReceiveErrors::CHARACTER),
        }
    }
    Err(reception.errors() | ReceiveErrors::LENGTH)
}
