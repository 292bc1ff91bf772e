//! The RTU frame: unit id, PDU, CRC (SER 2.5.1).
//!
//! On a microcontroller [`Reception`] and [`Transmission`] run in the interrupt. The CRC is computed byte by byte
//! while the frame is received or sent, so nothing is left to compute in the silence after it. They take and give the
//! frame without the CRC, `[unit, function, data...]`, in an [`Adu`]. [`encode`] and [`decode`] convert a whole
//! frame.

use crate::Adu;
use crate::crc::{self, Sum};
use crate::frame::{EncodeError, ReceiveErrors, Received, len_of};

/// Bytes of the shortest RTU frame (SER 2.5.1): unit id, function code, CRC.
pub const ADU_MIN: usize = 4;
/// Bytes of the longest RTU frame (SER 2.5.1).
pub const ADU_MAX: usize = 256;

/// Bytes of the CRC behind unit id and PDU.
const CRC_LEN: u8 = 2;

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
        if let Some(byte) = self.next_text(adu) {
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

/// Encodes unit id and PDU as a frame with its CRC, at the start of `out`.
///
/// # Errors
///
/// [`EncodeError`]; `out` is unchanged.
pub fn encode<'a>(unit_pdu: &[u8], out: &'a mut [u8]) -> Result<&'a [u8], EncodeError> {
    let len = usize::from(len_of(unit_pdu)?);
    let frame = out
        .get_mut(..len + usize::from(CRC_LEN))
        .ok_or(EncodeError::Room)?;
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
