//! The RTU frame: unit id, PDU, CRC (SER 2.5.1).
//!
//! On a microcontroller [`Reception`] and [`Transmission`] run in the interrupt: the CRC is computed byte by byte while the
//! frame is on its way, so that nothing is left to compute in the silence behind it. What they hand over and take is the
//! frame without the CRC, `[unit, function, data...]` in an [`Adu`]. [`encode`] and [`decode`] do the same for a frame that
//! is there as a whole.

use core::ops::{BitOr, BitOrAssign};

use crate::Adu;
use crate::crc::{self, Sum};

/// Bytes of the shortest RTU frame (SER 2.5.1): unit id, function code, CRC.
pub const ADU_MIN: usize = 4;
/// Bytes of the longest RTU frame (SER 2.5.1).
pub const ADU_MAX: usize = 256;

/// Bytes that the CRC adds behind unit id and PDU.
const CRC_LEN: u8 = 2;

/// What is wrong with a frame; empty if nothing is.
///
/// A frame with any flaw is dropped and never answered (SER 2.5.1.1, 2.5.1.3, 2.5.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ReceiveErrors(u8);

impl ReceiveErrors {
    /// Nothing is wrong.
    pub const NONE: ReceiveErrors = ReceiveErrors(0);
    /// A silence over t1.5 inside an RTU frame, over a second inside an ASCII frame (SER 2.5.1.1, 2.5.2).
    pub const GAP: ReceiveErrors = ReceiveErrors(1 << 0);
    /// A character with wrong parity.
    pub const PARITY: ReceiveErrors = ReceiveErrors(1 << 1);
    /// A character without its stop bit.
    pub const FRAMING: ReceiveErrors = ReceiveErrors(1 << 2);
    /// A character lost because the one before was not fetched in time.
    pub const OVERRUN: ReceiveErrors = ReceiveErrors(1 << 3);
    /// Under 4 or over 256 bytes; in ASCII under 9 or over 513 characters, or an odd number of digits.
    pub const LENGTH: ReceiveErrors = ReceiveErrors(1 << 4);
    /// The CRC or LRC does not match.
    pub const CHECK: ReceiveErrors = ReceiveErrors(1 << 5);
    /// A character that ASCII does not allow where it stands.
    pub const CHARACTER: ReceiveErrors = ReceiveErrors(1 << 6);

    /// As it is the frame is too short, but its first character is kept elsewhere until the buffer is free. Nobody but the
    /// line sees the bit without a name.
    pub(crate) const KEPT: ReceiveErrors = ReceiveErrors(1 << 7 | ReceiveErrors::LENGTH.0);

    /// Whether the frame is good.
    #[inline(always)]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether all of `other` is among these.
    #[inline(always)]
    pub const fn contains(self, other: ReceiveErrors) -> bool {
        self.0 & other.0 == other.0
    }

    /// These and `other`.
    #[inline(always)]
    pub const fn union(self, other: ReceiveErrors) -> ReceiveErrors {
        ReceiveErrors(self.0 | other.0)
    }

    /// One bit per flaw, for a log or an atomic.
    #[inline(always)]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// The errors of [`bits`](ReceiveErrors::bits); bits without a meaning are dropped.
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

/// A frame that is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received {
    /// Bytes of unit id and PDU at the start of the buffer, without CRC or LRC: 2..=254 in a frame without errors, 0..=254 in
    /// one with.
    pub len: u8,
    /// What was wrong with it.
    pub errors: ReceiveErrors,
}

/// Puts a frame together as its bytes come in.
///
/// The bytes go to a buffer the caller keeps, so that it can be lent on without a copy.
#[derive(Clone, Copy, Debug)]
pub struct Reception {
    sum: Sum,
    len: u8,
    full: bool,
    errors: ReceiveErrors,
}

impl Reception {
    /// Ready for the first byte of a frame.
    #[inline(always)]
    pub const fn new() -> Reception {
        Reception {
            sum: Sum::INIT,
            len: 0,
            full: false,
            errors: ReceiveErrors::NONE,
        }
    }

    /// What a driver has kept in a shape of its own: the CRC over all bytes, their number modulo 256, and whether the buffer
    /// is full.
    #[inline(always)]
    pub const fn from_parts(crc: u16, len: u8, full: bool) -> Reception {
        Reception {
            sum: Sum::new(crc),
            len,
            full,
            errors: ReceiveErrors::NONE,
        }
    }

    /// Forgets what has come in.
    #[inline(always)]
    pub fn restart(&mut self) {
        *self = Reception::new();
    }

    /// Whether nothing has come in since the start: no byte and no flaw.
    #[inline(always)]
    pub const fn is_empty(&self) -> bool {
        self.len == 0 && !self.full && self.errors.is_empty()
    }

    /// Takes the next byte. Those that no longer fit are dropped and make the frame bad: returns whether it did fit.
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

    /// Notes what the line found wrong.
    #[inline(always)]
    pub fn add(&mut self, errors: ReceiveErrors) {
        self.errors |= errors;
    }

    /// What has come in so far, taken for a whole frame.
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
        // A full buffer has gone round to 0, and 0 - 2 is 254 as it should be.
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

/// Hands a frame out byte by byte, and its CRC behind it.
#[derive(Clone, Copy, Debug)]
pub struct Transmission {
    sum: Sum,
    position: u8,
    len: u8,
    crc_left: u8,
}

impl Transmission {
    /// Nothing to send.
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

    /// The next byte to send, `None` when the frame is over.
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

    /// The next byte without a check behind them, `None` when there is no more.
    #[inline(always)]
    pub fn next_text(&mut self, adu: &Adu) -> Option<u8> {
        if self.is_text_over() {
            return None;
        }
        let byte = adu[usize::from(self.position)];
        self.position = self.position.wrapping_add(1);
        Some(byte)
    }

    /// Whether [`next_text`](Transmission::next_text) has nothing more to give.
    #[inline(always)]
    pub const fn is_text_over(&self) -> bool {
        self.position == self.len
    }

    /// Whether [`next`](Transmission::next) has nothing more to give.
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

/// Why a frame cannot be made: the caller's fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EncodeError {
    /// Unit id and PDU are not 2..=254 bytes.
    Length,
    /// The output is too small for the frame.
    Room,
}

/// Makes a frame of unit id and PDU: the same bytes with their CRC behind them, at the start of `out`.
///
/// # Errors
///
/// [`EncodeError`]; `out` is untouched then.
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

/// Unit id and PDU of a whole frame.
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
