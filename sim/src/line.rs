//! The format of a character on the line.

use std::fmt;
use std::str::FromStr;

use crate::time::{Clock, Time};

/// Parity of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parity {
    /// No parity bit.
    None,
    /// An even number of ones, the parity bit included.
    Even,
    /// An odd number of ones, the parity bit included.
    Odd,
}

/// Data bits, parity and stop bits of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Format {
    pub(crate) data_bits: u8,
    pub(crate) parity: Parity,
    pub(crate) stop_bits: u8,
}

impl Format {
    /// Eight data bits, no parity, one stop bit.
    pub const N81: Format = Format::new(8, Parity::None, 1);
    /// Eight data bits, even parity, one stop bit: Modbus' default (SER 2.5.1).
    pub const E81: Format = Format::new(8, Parity::Even, 1);
    /// Eight data bits, odd parity, one stop bit.
    pub const O81: Format = Format::new(8, Parity::Odd, 1);
    /// Eight data bits, no parity, two stop bits.
    pub const N82: Format = Format::new(8, Parity::None, 2);
    /// Seven data bits, even parity, one stop bit: Modbus ASCII's default (SER 2.5.2).
    pub const E71: Format = Format::new(7, Parity::Even, 1);
    /// Seven data bits, odd parity, one stop bit.
    pub const O71: Format = Format::new(7, Parity::Odd, 1);
    /// Seven data bits, no parity, two stop bits.
    pub const N72: Format = Format::new(7, Parity::None, 2);

    /// A format from its three parts. Fewer than 5 or more than 9 data bits count as 5 and 9, and
    /// so do stop bits outside 1 and 2.
    pub const fn new(data_bits: u8, parity: Parity, stop_bits: u8) -> Self {
        Format {
            data_bits: match data_bits {
                0..=4 => 5,
                5..=9 => data_bits,
                _ => 9,
            },
            parity,
            stop_bits: if stop_bits < 2 { 1 } else { 2 },
        }
    }

    /// Data bits, 5 to 9.
    pub const fn data_bits(self) -> u8 {
        self.data_bits
    }

    /// The parity bit, if any.
    pub const fn parity(self) -> Parity {
        self.parity
    }

    /// Stop bits, 1 or 2.
    pub const fn stop_bits(self) -> u8 {
        self.stop_bits
    }

    /// Bits of one character, start and stop bits included.
    pub const fn bits(self) -> u32 {
        1 + self.data_bits as u32 + self.has_parity() as u32 + self.stop_bits as u32
    }

    pub(crate) const fn has_parity(self) -> bool {
        !matches!(self.parity, Parity::None)
    }

    /// The character's bits in the order of the wire, the start bit in bit 0.
    pub(crate) fn encode(self, value: u16) -> u16 {
        let data = value & ((1 << self.data_bits) - 1);
        let mut bits = data << 1;
        let mut next = 1 + self.data_bits;
        if self.has_parity() {
            bits |= u16::from(self.parity_bit(data)) << next;
            next += 1;
        }
        for _ in 0..self.stop_bits {
            bits |= 1 << next;
            next += 1;
        }
        bits
    }

    /// The right parity bit for `data`.
    fn parity_bit(self, data: u16) -> bool {
        let odd = data.count_ones() % 2 == 1;
        odd == (self.parity == Parity::Even)
    }

    /// Takes a character apart whose bits were sampled in the order of the wire.
    pub(crate) fn decode(self, bits: u16) -> Decoded {
        let value = bits >> 1 & ((1 << self.data_bits) - 1);
        let mut next = 1 + self.data_bits;
        let mut parity_error = false;
        if self.has_parity() {
            parity_error = (bits >> next & 1 == 1) != self.parity_bit(value);
            next += 1;
        }
        // Receivers look at the first stop bit alone (DS40002061B, 20.8).
        Decoded {
            value,
            parity_error,
            framing_error: bits >> next & 1 == 0,
        }
    }
}

/// A sampled character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Decoded {
    pub value: u16,
    pub parity_error: bool,
    pub framing_error: bool,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parity = match self.parity {
            Parity::None => 'N',
            Parity::Even => 'E',
            Parity::Odd => 'O',
        };
        write!(f, "{}{parity}{}", self.data_bits, self.stop_bits)
    }
}

impl FromStr for Format {
    type Err = String;

    /// From a text like `8N1`.
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("{text}: a format is 5..8 data bits, N E or O, 1 or 2 stop bits");
        let [data, parity, stop] = text.as_bytes() else {
            return Err(wrong());
        };
        let parity = match parity.to_ascii_uppercase() {
            b'N' => Parity::None,
            b'E' => Parity::Even,
            b'O' => Parity::Odd,
            _ => return Err(wrong()),
        };
        match (data, stop) {
            (b'5'..=b'8', b'1'..=b'2') => Ok(Format::new(data - b'0', parity, stop - b'0')),
            _ => Err(wrong()),
        }
    }
}

/// A baud rate with a character format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line {
    /// Bits per second.
    pub baud: u32,
    /// The character format.
    pub format: Format,
}

impl Line {
    /// `baud` bits per second, 8N1.
    pub const fn n81(baud: u32) -> Self {
        Line {
            baud,
            format: Format::N81,
        }
    }

    /// The time of `count` bits.
    pub fn bits(self, count: u64) -> Time {
        Clock::new(self.baud, 0).time(count)
    }

    /// The time of one character.
    pub fn character(self) -> Time {
        self.bits(u64::from(self.format.bits()))
    }

    /// 1.5 character times, 750 us above 19200 baud (SER 2.5.1.1).
    pub fn t15(self) -> Time {
        if self.baud > 19_200 {
            Time::from_us(750)
        } else {
            self.bits(u64::from(self.format.bits()) * 3) / 2
        }
    }

    /// 3.5 character times, 1750 us above 19200 baud (SER 2.5.1.1).
    pub fn t35(self) -> Time {
        if self.baud > 19_200 {
            Time::from_us(1_750)
        } else {
            self.bits(u64::from(self.format.bits()) * 7) / 2
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encodes_in_wire_order() {
        // 0x55 8E1: start 0, data LSB first 1 0 1 0 1 0 1 0, four ones so parity 0, stop 1.
        assert_eq!(
            Format::E81.encode(0x55),
            0b10_0101_0101 << 1 & 0x7ff | 1 << 10 & 0x400
        );
        assert_eq!(Format::N81.encode(0x00), 0b10_0000_0000);
        assert_eq!(Format::O81.encode(0x00), 0b110_0000_0000);
        assert_eq!(Format::N72.encode(0x7f), 0b11_1111_1110);
    }

    #[test]
    fn decode_undoes_encode_and_sees_errors() {
        for format in [Format::N81, Format::E81, Format::O71, Format::N72] {
            for value in 0..(1 << format.data_bits) {
                let bits = format.encode(value);
                let decoded = format.decode(bits);
                assert_eq!(
                    decoded,
                    Decoded {
                        value,
                        parity_error: false,
                        framing_error: false
                    }
                );
            }
        }
        assert!(
            Format::E81
                .decode(Format::E81.encode(7) ^ 1 << 9)
                .parity_error
        );
        assert!(
            Format::N81
                .decode(Format::N81.encode(7) ^ 1 << 9)
                .framing_error
        );
    }

    #[test]
    fn parses() {
        assert_eq!("8e1".parse(), Ok(Format::E81));
        assert!("9N1".parse::<Format>().is_err());
        assert!("8N".parse::<Format>().is_err());
    }
}
