//! What RTU and ASCII frames share: the limits of their length, and the errors of one.

use core::fmt;

/// Bytes of the shortest unit id and PDU: unit id and function code (SER 2.3).
pub const LEN_MIN: u8 = 2;
/// Bytes of the longest unit id and PDU: unit id and a PDU of 253 bytes (SER 2.3, APP 4.1).
pub const LEN_MAX: u8 = 254;

bitflags::bitflags! {
    /// The errors of a received frame; empty for a good frame.
    ///
    /// A frame with an error is dropped and never answered (SER 2.5.1.1, 2.5.1.3, 2.5.2). Displayed, the errors are a
    /// list of names, as in `gap, parity error`.
    #[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
    pub struct ReceiveErrors: u8 {
        /// A silence over t1.5 inside an RTU frame, over a second inside an ASCII frame (SER 2.5.1.1, 2.5.2).
        const GAP = 1 << 0;
        /// A character with wrong parity.
        const PARITY = 1 << 1;
        /// A character without its stop bit.
        const FRAMING = 1 << 2;
        /// A character was lost because the one before was not read in time.
        const OVERRUN = 1 << 3;
        /// Under 4 or over 256 bytes; in ASCII under 9 or over 513 characters, or an odd number of digits.
        const LENGTH = 1 << 4;
        /// The CRC or LRC does not match.
        const CHECK = 1 << 5;
        /// A character that ASCII does not allow where it stands.
        const CHARACTER = 1 << 6;
    }
}

impl ReceiveErrors {
    /// No error: the frame is good.
    pub const NONE: ReceiveErrors = ReceiveErrors::empty();

    /// The frame is too short so far, but its first character is kept elsewhere until the buffer is free. Only the
    /// line uses this bit.
    pub(crate) const KEPT: ReceiveErrors =
        ReceiveErrors::from_bits_retain(1 << 7 | ReceiveErrors::LENGTH.bits());
}

/// The names of the errors, in the order in which they are displayed.
const NAMES: [(ReceiveErrors, &str); 7] = [
    (ReceiveErrors::GAP, "gap"),
    (ReceiveErrors::PARITY, "parity error"),
    (ReceiveErrors::FRAMING, "framing error"),
    (ReceiveErrors::OVERRUN, "overrun"),
    (ReceiveErrors::LENGTH, "wrong length"),
    (ReceiveErrors::CHECK, "CRC or LRC error"),
    (ReceiveErrors::CHARACTER, "invalid character"),
];

impl fmt::Display for ReceiveErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
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

impl fmt::Debug for ReceiveErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ReceiveErrors({self})")
    }
}

impl core::error::Error for ReceiveErrors {}

#[cfg(feature = "defmt")]
impl defmt::Format for ReceiveErrors {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "{}", defmt::Display2Format(self));
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

/// Why a frame cannot be encoded. The caller is to blame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum EncodeError {
    /// Unit id and PDU are not 2..=254 bytes.
    Length,
    /// The output is too small for the frame.
    Room,
}

impl fmt::Display for EncodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            EncodeError::Length => "unit id and PDU must be 2..=254 bytes",
            EncodeError::Room => "the output is too small for the frame",
        })
    }
}

impl core::error::Error for EncodeError {}

/// The length of unit id and PDU, if a frame can be encoded of them.
pub(crate) fn len_of(unit_pdu: &[u8]) -> Result<u8, EncodeError> {
    match u8::try_from(unit_pdu.len()) {
        Ok(len @ LEN_MIN..=LEN_MAX) => Ok(len),
        _ => Err(EncodeError::Length),
    }
}
