//! The ASCII frame: `:`, then unit id, PDU and LRC as two hexadecimal digits for each byte, then CR LF (SER 2.5.2).
//!
//! [`Reception`] and [`Transmission`] run in the interrupt, character by character. They take and give `[unit,
//! function, data...]` in an [`Adu`], as those of RTU do, so the layers above the line see no difference. [`encode`]
//! and [`decode`] convert a whole frame.
//!
//! LF can be replaced by another character (APP 6.8, sub-function 03). Any character will do, since CR precedes it; a
//! digit, `:` or CR keeps its meaning everywhere else.

use crate::Adu;
use crate::frame::{self, EncodeError, ReceiveErrors, Received, len_of};

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
const BYTES_MIN: u8 = frame::LEN_MIN + 1;
const BYTES_MAX: u8 = frame::LEN_MAX + 1;

/// The value of a digit that has not been received.
const NO_DIGIT: u8 = 0xFF;

/// The LRC of unit id and PDU: the two's complement of the sum of the bytes (SER 6.2.1). The sum of all bytes and
/// their LRC is 0.
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

/// The hexadecimal digit of a value of 0..=15, in upper case (SER 2.5.2).
const fn character(digit: u8) -> u8 {
    if digit < 10 {
        b'0' + digit
    } else {
        b'A' + digit - 10
    }
}

/// The effect of a received character on the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decoded {
    /// The frame goes on.
    More,
    /// The second digit of a byte was received.
    Byte {
        /// The place of the byte in the buffer.
        at: u8,
        /// The value of the byte.
        byte: u8,
    },
    /// A `:` was received: a frame begins, and what was received before it is dropped.
    Start,
    /// CR and delimiter were received: the frame is complete.
    End,
}

/// Assembles a frame from the characters behind the `:`.
#[derive(Clone, Copy, Debug)]
pub struct Reception {
    sum: u8,
    len: u8,
    /// The first digit of a byte whose second digit has not been received.
    digit: u8,
    after_cr: bool,
    delimiter: u8,
    errors: ReceiveErrors,
}

impl Reception {
    /// An empty frame that this delimiter will end.
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

    /// Takes the next character. After an error the frame is followed to its end, but gives no more bytes.
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

    /// Adds the errors of a character, whatever its value, or of a byte that could not be stored.
    #[inline(always)]
    pub fn add(&mut self, errors: ReceiveErrors) {
        self.after_cr = false;
        self.errors |= errors;
    }

    /// The errors so far, apart from the missing end.
    #[inline(always)]
    pub const fn errors(&self) -> ReceiveErrors {
        self.errors
    }

    /// The frame as received so far, as if it were complete.
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

/// Gives the characters of a frame one by one.
#[derive(Clone, Copy, Debug)]
pub struct Transmission {
    part: Part,
    sum: u8,
    position: u8,
    len: u8,
    delimiter: u8,
}

impl Transmission {
    /// A transmission without a frame.
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

    /// Begins a frame of `len` bytes of unit id and PDU, 2..=254, which `delimiter` will end.
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

    /// The next character to send, or `None` after the last one. `byte` is the byte at
    /// [`position`](Transmission::position); after the last byte any value will do.
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

    /// Whether all characters have been sent.
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

/// Encodes unit id and PDU as a frame at the start of `out`, ended by `delimiter`.
///
/// # Errors
///
/// [`EncodeError`]; `out` is unchanged.
pub fn encode<'a>(
    unit_pdu: &[u8],
    delimiter: u8,
    out: &'a mut [u8],
) -> Result<&'a [u8], EncodeError> {
    let len = len_of(unit_pdu)?;
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

/// Decodes a whole frame, from `:` to `delimiter`, to unit id and PDU at the start of `out`.
///
/// # Errors
///
/// The [`ReceiveErrors`] of the frame. These include [`ReceiveErrors::CHARACTER`] if the frame does not begin with
/// `:`, contains another one, or goes on behind its delimiter, and [`ReceiveErrors::LENGTH`] if it has no delimiter.
/// The content of `out` is undefined.
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
