//! The RTU frame: unit id, PDU, CRC (SER 2.5.1).
//!
//! On a microcontroller [`Reception`] and [`Transmission`] run in the interrupt. The CRC is computed byte by byte
//! while the frame is received or sent, so nothing is left to compute in the silence after it. They take and give the
//! frame without the CRC, `[unit, function, data...]`, in an [`Adu`]. [`encode`] and [`decode`] convert a whole
//! frame.

use core::fmt;
use core::ops::{BitOr, BitOrAssign};

use crate::Adu;
use crate::crc::{self, Sum};

/// Bytes of the shortest RTU frame (SER 2.5.1): unit id, function code, CRC.
pub const ADU_MIN: usize = 4;
/// Bytes of the longest RTU frame (SER 2.5.1).
pub const ADU_MAX: usize = 256;

/// Bytes of the CRC behind unit id and PDU.
const CRC_LEN: u8 = 2;

/// The errors of a received frame; empty for a good frame.
///
/// A frame with an error is dropped and never answered (SER 2.5.1.1, 2.5.1.3, 2.5.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ReceiveErrors(u8);

impl ReceiveErrors {
    /// No error: the frame is good.
    pub const NONE: ReceiveErrors = ReceiveErrors(0);
    /// A silence over t1.5 inside an RTU frame, over a second inside an ASCII frame (SER 2.5.1.1, 2.5.2).
    pub const GAP: ReceiveErrors = ReceiveErrors(1 << 0);
    /// A character with wrong parity.
    pub const PARITY: ReceiveErrors = ReceiveErrors(1 << 1);
    /// A character without its stop bit.
    pub const FRAMING: ReceiveErrors = ReceiveErrors(1 << 2);
    /// A character was lost because the one before was not read in time.
    pub const OVERRUN: ReceiveErrors = ReceiveErrors(1 << 3);
    /// Under 4 or over 256 bytes; in ASCII under 9 or over 513 characters, or an odd number of digits.
    pub const LENGTH: ReceiveErrors = ReceiveErrors(1 << 4);
    /// The CRC or LRC does not match.
    pub const CHECK: ReceiveErrors = ReceiveErrors(1 << 5);
    /// A character that ASCII does not allow where it stands.
    pub const CHARACTER: ReceiveErrors = ReceiveErrors(1 << 6);

    /// The frame is too short so far, but its first character is kept elsewhere until the buffer is free. Only the
    /// line uses this bit.
    pub(crate) const KEPT: ReceiveErrors = ReceiveErrors(1 << 7 | ReceiveErrors::LENGTH.0);

    /// Whether the frame is good.
    #[inline(always)]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether these errors include all of `other`.
    #[inline(always)]
    pub const fn contains(self, other: ReceiveErrors) -> bool {
        self.0 & other.0 == other.0
    }

    /// The errors of both.
    #[inline(always)]
    pub const fn union(self, other: ReceiveErrors) -> ReceiveErrors {
        ReceiveErrors(self.0 | other.0)
    }

    /// One bit for each error, for a log or an atomic.
    #[inline(always)]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// The errors of [`bits`](ReceiveErrors::bits); unknown bits are ignored.
    #[inline(always)]
    pub const fn from_bits(bits: u8) -> ReceiveErrors {
        ReceiveErrors(bits & 0x7F)
    }
}

impl BitOr for ReceiveErrors {
    type Output = ReceiveErrors;
    #[inline(always)]
    fn bitor(self, other: ReceiveErrors) -> ReceiveErrors {
        self.union(other)
    }
}

impl BitOrAssign for ReceiveErrors {
    #[inline(always)]
    fn bitor_assign(&mut self, other: ReceiveErrors) {
        *self = self.union(other);
    }
}

/// The names of the errors, as in `gap, parity error`.
impl fmt::Display for ReceiveErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const NAMES: [(ReceiveErrors, &str); 7] = [
            (ReceiveErrors::GAP, "gap"),
            (ReceiveErrors::PARITY, "parity error"),
            (ReceiveErrors::FRAMING, "framing error"),
            (ReceiveErrors::OVERRUN, "overrun"),
            (ReceiveErrors::LENGTH, "wrong length"),
            (ReceiveErrors::CHECK, "CRC or LRC error"),
            (ReceiveErrors::CHARACTER, "invalid character"),
        ];
        if self.is_empty() {
            return f.write_str("no error");
        }
        let found = NAMES.iter().filter(|(error, _)| self.contains(*error));
        for (index, (_, name)) in found.enumerate() {
            f.write_str(if index > 0 { ", " } else { "" })?;
            f.write_str(name)?;
        }
        Ok(())
    }
}

/// The result of a reception.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received {
    /// Bytes of unit id and PDU at the start of the buffer, without CRC or LRC: 2..=254 in a good frame, 0..=254 in a
    /// damaged one.
    pub len: u8,
    /// The errors of the frame.
    pub errors: ReceiveErrors,
}

/// Assembles a frame from its bytes.
///
/// The bytes go to a buffer of the caller, so that it can be lent on without a copy.
#[derive(Clone, Copy, Debug)]
pub struct Reception {
    sum: Sum,
    len: u8,
    full: bool,
    errors: ReceiveErrors,
}

impl Reception {
    /// An empty frame, ready for its first byte.
    #[inline(always)]
    pub const fn new() -> Reception {
        Reception {
            sum: Sum::INIT,
            len: 0,
            full: false,
            errors: ReceiveErrors::NONE,
        }
    }

    /// A reception from the values that a driver keeps: the CRC over all bytes, their number modulo 256, and whether
    /// the buffer is full.
    #[inline(always)]
    pub const fn from_parts(crc: u16, len: u8, full: bool) -> Reception {
        Reception {
            sum: Sum::new(crc),
            len,
            full,
            errors: ReceiveErrors::NONE,
        }
    }

    /// Drops what was received.
    #[inline(always)]
    pub fn restart(&mut self) {
        *self = Reception::new();
    }

    /// Whether nothing was received since the start: neither a byte nor an error.
    #[inline(always)]
    pub const fn is_empty(&self) -> bool {
        self.len == 0 && !self.full && self.errors.is_empty()
    }

    /// Takes the next byte; returns whether it fits into the buffer. A byte that does not fit is dropped and makes
    /// the frame bad.
    #[inline(always)]
    pub fn push(&mut self, adu: &mut Adu, byte: u8) -> bool {
        if self.full {
            self.errors |= ReceiveErrors::LENGTH;
            return false;
        }
        adu[usize::from(self.len)] = byte;
        self.len = self.len.wrapping_add(1);
        if self.len == 0 {
            self.full = true;
        }
        self.sum.push(byte);
        true
    }

    /// Adds errors that the line has found.
    #[inline(always)]
    pub fn add(&mut self, errors: ReceiveErrors) {
        self.errors |= errors;
    }

    /// The frame as received so far, as if it were complete.
    #[inline]
    pub const fn finish(&self) -> Received {
        let mut errors = self.errors;
        if !self.sum.matches() {
            errors = errors.union(ReceiveErrors::CHECK);
        }
        if self.len < ADU_MIN as u8 && !self.full {
            return Received {
                len: self.len.saturating_sub(CRC_LEN),
                errors: errors.union(ReceiveErrors::LENGTH),
            };
        }
        // The length of a full buffer has wrapped to 0, and 0 - 2 wraps to 254.
        Received {
            len: self.len.wrapping_sub(CRC_LEN),
            errors,
        }
    }
}

impl Default for Reception {
    fn default() -> Reception {
        Reception::new()
    }
}

/// Gives the bytes of a frame one by one, and then its CRC.
#[derive(Clone, Copy, Debug)]
pub struct Transmission {
    sum: Sum,
    position: u8,
    len: u8,
    crc_left: u8,
}

impl Transmission {
    /// A transmission without a frame.
    #[inline(always)]
    pub const fn new() -> Transmission {
        Transmission {
            sum: Sum::INIT,
            position: 0,
            len: 0,
            crc_left: 0,
        }
    }

    /// Begins a frame of `len` bytes of unit id and PDU, 2..=254.
    #[inline(always)]
    pub fn start(&mut self, len: u8) {
        *self = Transmission {
            sum: Sum::INIT,
            position: 0,
            len,
            crc_left: CRC_LEN,
        };
    }

    /// The next byte to send, or `None` after the last one.
    #[inline(always)]
    pub fn next(&mut self, adu: &Adu) -> Option<u8> {
        if self.position != self.len {
            let byte = adu[usize::from(self.position)];
            self.position = self.position.wrapping_add(1);
            self.sum.push(byte);
            return Some(byte);
        }
        if self.crc_left == 0 {
            return None;
        }
        self.crc_left -= 1;
        Some(self.sum.take_check_byte())
    }

    /// The next byte of text, which has no CRC, or `None` after the last one.
    #[inline(always)]
    pub fn next_text(&mut self, adu: &Adu) -> Option<u8> {
        if self.is_text_over() {
            return None;
        }
        let byte = adu[usize::from(self.position)];
        self.position = self.position.wrapping_add(1);
        Some(byte)
    }

    /// Whether all bytes of text have been sent.
    #[inline(always)]
    pub const fn is_text_over(&self) -> bool {
        self.position == self.len
    }

    /// Whether all bytes of the frame have been sent.
    #[inline(always)]
    pub const fn is_over(&self) -> bool {
        // The CRC comes last.
        self.crc_left == 0
    }
}

impl Default for Transmission {
    fn default() -> Transmission {
        Transmission::new()
    }
}

/// Why a frame cannot be encoded. The caller is to blame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EncodeError {
    /// Unit id and PDU are not 2..=254 bytes.
    Length,
    /// The output is too small for the frame.
    Room,
}

/// Encodes unit id and PDU as a frame with its CRC, at the start of `out`.
///
/// # Errors
///
/// [`EncodeError`]; `out` is unchanged.
pub fn encode<'a>(unit_pdu: &[u8], out: &'a mut [u8]) -> Result<&'a [u8], EncodeError> {
    let len = unit_pdu.len();
    if !(ADU_MIN - 2..=ADU_MAX - 2).contains(&len) {
        return Err(EncodeError::Length);
    }
    let frame = out.get_mut(..len + 2).ok_or(EncodeError::Room)?;
    let (body, check) = frame.split_at_mut(len);
    body.copy_from_slice(unit_pdu);
    check.copy_from_slice(&crc::checksum(unit_pdu).to_le_bytes());
    Ok(frame)
}

/// Decodes a whole frame to unit id and PDU.
///
/// # Errors
///
/// [`ReceiveErrors::LENGTH`], [`ReceiveErrors::CHECK`] or both.
pub fn decode(adu: &[u8]) -> Result<&[u8], ReceiveErrors> {
    let mut errors = ReceiveErrors::NONE;
    if crc::checksum(adu) != 0 {
        errors |= ReceiveErrors::CHECK;
    }
    if !(ADU_MIN..=ADU_MAX).contains(&adu.len()) {
        errors |= ReceiveErrors::LENGTH;
    }
    if errors.is_empty() {
        Ok(&adu[..adu.len() - 2])
    } else {
        Err(errors)
    }
}
