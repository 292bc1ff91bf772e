//! Numbers of more than 16 bits, and text, in registers.
//!
//! The standard knows only registers of 16 bits. Devices differ in how they store a wider number in two or four
//! registers. Four orders are in use, named after the places of the bytes `ABCD` of a number, `A` being the highest
//! ([`Order`]).
//!
//! ```
//! use multidrop_protocol::number::Order;
//!
//! // 12.5 is 0x41480000.
//! assert_eq!(Order::Abcd.f32([0x4148, 0x0000]), 12.5);
//! assert_eq!(Order::Cdab.from_f32(12.5), [0x0000, 0x4148]);
//! ```

/// The order of the bytes of a number in registers, from the high byte of the first register on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Order {
    /// The high word first, the high byte of each first: `AB CD`, `AB CD EF GH`. The standard's order within a
    /// register, and that of iDevOS across two: `hi * 65536 + lo`.
    Abcd,
    /// The low word first, the high byte of each first: `CD AB`, `GH EF CD AB`.
    Cdab,
    /// The high word first, the low byte of each first: `BA DC`, `BA DC FE HG`.
    Badc,
    /// The low word first, the low byte of each first: `DC BA`, `HG FE DC BA`.
    Dcba,
}

impl Order {
    /// All orders of the enum, in its order.
    pub const ALL: [Order; 4] = [Order::Abcd, Order::Cdab, Order::Badc, Order::Dcba];

    const fn low_word_first(self) -> bool {
        matches!(self, Order::Cdab | Order::Dcba)
    }

    const fn low_byte_first(self) -> bool {
        matches!(self, Order::Badc | Order::Dcba)
    }

    /// Swaps the bytes of a word if this order demands it; the reverse is the same operation.
    const fn word(self, word: u16) -> u16 {
        if self.low_byte_first() {
            word.swap_bytes()
        } else {
            word
        }
    }

    /// The number in two registers.
    pub const fn u32(self, registers: [u16; 2]) -> u32 {
        let [first, second] = registers;
        let (high, low) = if self.low_word_first() {
            (second, first)
        } else {
            (first, second)
        };
        (self.word(high) as u32) << 16 | self.word(low) as u32
    }

    /// The two registers of a number.
    pub const fn from_u32(self, value: u32) -> [u16; 2] {
        let (high, low) = (self.word((value >> 16) as u16), self.word(value as u16));
        if self.low_word_first() {
            [low, high]
        } else {
            [high, low]
        }
    }

    /// The number in two registers, in two's complement.
    pub const fn i32(self, registers: [u16; 2]) -> i32 {
        self.u32(registers) as i32
    }

    /// The two registers of a number, in two's complement.
    pub const fn from_i32(self, value: i32) -> [u16; 2] {
        self.from_u32(value as u32)
    }

    /// The IEEE 754 single in two registers. Every bit pattern is one, among them infinities and NaN.
    pub const fn f32(self, registers: [u16; 2]) -> f32 {
        f32::from_bits(self.u32(registers))
    }

    /// The two registers of an IEEE 754 single, bit by bit.
    pub const fn from_f32(self, value: f32) -> [u16; 2] {
        self.from_u32(value.to_bits())
    }

    /// The number in four registers.
    pub const fn u64(self, registers: [u16; 4]) -> u64 {
        let [a, b, c, d] = registers;
        let (high, low) = if self.low_word_first() {
            ([c, d], [a, b])
        } else {
            ([a, b], [c, d])
        };
        (self.u32(high) as u64) << 32 | self.u32(low) as u64
    }

    /// The four registers of a number.
    pub const fn from_u64(self, value: u64) -> [u16; 4] {
        let [a, b] = self.from_u32((value >> 32) as u32);
        let [c, d] = self.from_u32(value as u32);
        if self.low_word_first() {
            [c, d, a, b]
        } else {
            [a, b, c, d]
        }
    }

    /// The number in four registers, in two's complement.
    pub const fn i64(self, registers: [u16; 4]) -> i64 {
        self.u64(registers) as i64
    }

    /// The four registers of a number, in two's complement.
    pub const fn from_i64(self, value: i64) -> [u16; 4] {
        self.from_u64(value as u64)
    }

    /// The IEEE 754 double in four registers. Every bit pattern is one, among them infinities and NaN.
    pub const fn f64(self, registers: [u16; 4]) -> f64 {
        f64::from_bits(self.u64(registers))
    }

    /// The four registers of an IEEE 754 double, bit by bit.
    pub const fn from_f64(self, value: f64) -> [u16; 4] {
        self.from_u64(value.to_bits())
    }

    /// Writes text to registers, two bytes in each; `pad` fills the registers behind the text. Only the order of the
    /// bytes within a register counts: text has no high and low word, so `Abcd` and `Cdab` are equal, and so are
    /// `Badc` and `Dcba`.
    ///
    /// # Errors
    ///
    /// [`TextError::Room`]; `registers` is unchanged.
    pub const fn from_text(
        self,
        text: &str,
        pad: Pad,
        registers: &mut [u16],
    ) -> Result<(), TextError> {
        let text = text.as_bytes();
        let room = registers.len().saturating_mul(2);
        if text.len() > room {
            return Err(TextError::Room {
                needed: text.len(),
                room,
            });
        }
        let mut place = 0;
        while place < registers.len() {
            let high = byte_or(text, 2 * place, pad);
            let low = byte_or(text, 2 * place + 1, pad);
            registers[place] = self.word(u16::from_be_bytes([high, low]));
            place += 1;
        }
        Ok(())
    }

    /// Reads the text in registers to the start of `room`. The text ends where only padding follows.
    ///
    /// # Errors
    ///
    /// [`TextError`] if the text does not fit or is not UTF-8.
    pub const fn text<'a>(
        self,
        registers: &[u16],
        pad: Pad,
        room: &'a mut [u8],
    ) -> Result<&'a str, TextError> {
        let mut len = registers.len().saturating_mul(2);
        while len > 0 && self.byte_at(registers, len - 1) == pad.byte() {
            len -= 1;
        }
        if len > room.len() {
            return Err(TextError::Room {
                needed: len,
                room: room.len(),
            });
        }
        let mut place = 0;
        while place < len {
            room[place] = self.byte_at(registers, place);
            place += 1;
        }
        let (text, _) = room.split_at(len);
        match core::str::from_utf8(text) {
            Ok(text) => Ok(text),
            Err(error) => Err(TextError::Utf8 {
                place: error.valid_up_to(),
            }),
        }
    }

    /// The byte at this place of a text in registers.
    const fn byte_at(self, registers: &[u16], place: usize) -> u8 {
        self.word(registers[place / 2]).to_be_bytes()[place % 2]
    }
}

/// The byte at this place of a text, or a byte of padding behind its end.
const fn byte_or(text: &[u8], place: usize, pad: Pad) -> u8 {
    if place < text.len() {
        text[place]
    } else {
        pad.byte()
    }
}

/// The padding behind a text in registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Pad {
    /// Bytes with the value 0.
    Zero,
    /// Space characters. Spaces at the end of the text itself are lost when it is read.
    Space,
}

impl Pad {
    const fn byte(self) -> u8 {
        match self {
            Pad::Zero => 0,
            Pad::Space => b' ',
        }
    }
}

/// Why text cannot be written to registers, or read from them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TextError {
    /// The text is longer than the room for it, in bytes. The caller is to blame.
    Room {
        /// The bytes that there is room for.
        room: usize,
        /// The bytes that the text needs.
        needed: usize,
    },
    /// The content of the registers is not UTF-8. The peer is to blame.
    Utf8 {
        /// The place of the first byte that is not UTF-8.
        place: usize,
    },
}
