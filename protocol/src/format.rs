//! The format of a character on the line, and the framing of bytes.

/// The framing: how bytes are encoded as characters, and what delimits a frame (SER 2.5). The numbers are those of the register FRAMING.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Framing {
    /// A byte is one character, a silence ends the frame, a CRC checks it; eight data bits (SER 2.5.1).
    Rtu = 0,
    /// A byte is two hexadecimal digits, `:` begins and CR LF ends the frame, an LRC checks it (SER 2.5.2).
    Ascii = 1,
    /// Bytes are sent as they are, without a check: lines of text for a terminal. Received bytes are ignored.
    Text = 2,
}

impl Framing {
    /// The number of characters in a frame with `len` bytes of unit id, function code and data, or in `len` bytes of
    /// text.
    pub const fn characters(self, len: u8) -> u16 {
        let len = len as u16;
        match self {
            // Two bytes of CRC (SER 2.5.1.2).
            Framing::Rtu => len + 2,
            // `:`, two digits for each byte and for the LRC, CR and LF (SER 2.5.2.2).
            Framing::Ascii => 2 * len + 5,
            Framing::Text => len,
        }
    }
}

/// The parity of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Parity {
    /// No parity bit is sent.
    None,
    /// The number of ones is even, parity bit included.
    Even,
    /// The number of ones is odd, parity bit included.
    Odd,
}

/// Data bits, parity and stop bits, as a common short name.
///
/// RTU needs eight data bits. The standard has 8E1 as its default, and 8N2 without parity (SER 2.5.1); most devices
/// in the field use 8N1. Seven data bits are for ASCII (SER 2.5.2). The numbers are those of the register FORMAT.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LineFormat {
    /// Eight data bits, no parity, one stop bit.
    F8N1 = 0,
    /// Eight data bits, even parity, one stop bit.
    F8E1 = 1,
    /// Eight data bits, odd parity, one stop bit.
    F8O1 = 2,
    /// Eight data bits, no parity, two stop bits.
    F8N2 = 3,
    /// Seven data bits, even parity, one stop bit.
    F7E1 = 4,
    /// Seven data bits, odd parity, one stop bit.
    F7O1 = 5,
    /// Seven data bits, no parity, two stop bits.
    F7N2 = 6,
}

impl LineFormat {
    /// All formats of the enum, in its order.
    pub const ALL: [LineFormat; 7] = [
        LineFormat::F8N1,
        LineFormat::F8E1,
        LineFormat::F8O1,
        LineFormat::F8N2,
        LineFormat::F7E1,
        LineFormat::F7O1,
        LineFormat::F7N2,
    ];

    /// The number of data bits: 7 or 8.
    pub const fn data_bits(self) -> u8 {
        match self {
            LineFormat::F8N1 | LineFormat::F8E1 | LineFormat::F8O1 | LineFormat::F8N2 => 8,
            LineFormat::F7E1 | LineFormat::F7O1 | LineFormat::F7N2 => 7,
        }
    }

    /// The parity of the format.
    pub const fn parity(self) -> Parity {
        match self {
            LineFormat::F8N1 | LineFormat::F8N2 | LineFormat::F7N2 => Parity::None,
            LineFormat::F8E1 | LineFormat::F7E1 => Parity::Even,
            LineFormat::F8O1 | LineFormat::F7O1 => Parity::Odd,
        }
    }

    /// The number of stop bits: 1 or 2.
    pub const fn stop_bits(self) -> u8 {
        match self {
            LineFormat::F8N2 | LineFormat::F7N2 => 2,
            _ => 1,
        }
    }

    /// The bit times of a whole character with start, data, parity and stop bits: 10 or 11.
    pub const fn character_bits(self) -> u8 {
        let parity = match self.parity() {
            Parity::None => 0,
            Parity::Even | Parity::Odd => 1,
        };
        1 + self.data_bits() + parity + self.stop_bits()
    }

    /// The format with this name, such as `"8E1"`, in upper case; `None` for any other text.
    pub const fn from_name(name: &str) -> Option<LineFormat> {
        Some(match name.as_bytes() {
            b"8N1" => LineFormat::F8N1,
            b"8E1" => LineFormat::F8E1,
            b"8O1" => LineFormat::F8O1,
            b"8N2" => LineFormat::F8N2,
            b"7E1" => LineFormat::F7E1,
            b"7O1" => LineFormat::F7O1,
            b"7N2" => LineFormat::F7N2,
            _ => return None,
        })
    }

    /// The name of the format, such as `"8E1"`.
    pub const fn name(self) -> &'static str {
        match self {
            LineFormat::F8N1 => "8N1",
            LineFormat::F8E1 => "8E1",
            LineFormat::F8O1 => "8O1",
            LineFormat::F8N2 => "8N2",
            LineFormat::F7E1 => "7E1",
            LineFormat::F7O1 => "7O1",
            LineFormat::F7N2 => "7N2",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_match_the_bits() {
        for format in LineFormat::ALL {
            let name = format.name().as_bytes();
            assert_eq!(LineFormat::from_name(format.name()), Some(format));
            assert_eq!(format.data_bits(), name[0] - b'0');
            let parity = match name[1] {
                b'N' => Parity::None,
                b'E' => Parity::Even,
                _ => Parity::Odd,
            };
            assert_eq!(format.parity(), parity);
            assert_eq!(format.stop_bits(), name[2] - b'0');
        }
        assert_eq!(
            LineFormat::ALL.map(LineFormat::character_bits),
            [10, 11, 11, 11, 10, 10, 10]
        );
    }

    #[test]
    fn other_names_are_refused() {
        for name in ["", "8N", "8N3", "8e1", "7N1", "9N1", "8N1 "] {
            assert_eq!(LineFormat::from_name(name), None, "{name}");
        }
    }
}
