//! Blocks of coils and registers as they are encoded in a frame.
//!
//! A data model gets references into the frame itself, so a value is copied once: from the application's memory to
//! the frame, or back.

/// Registers of a write request: big endian in the frame (APP 4.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Registers<'a> {
    pairs: &'a [[u8; 2]],
}

impl<'a> Registers<'a> {
    /// The registers in `bytes`, high byte first; an odd last byte is ignored.
    #[inline]
    pub const fn new(bytes: &'a [u8]) -> Registers<'a> {
        Registers {
            pairs: bytes.as_chunks().0,
        }
    }

    /// The number of registers.
    #[inline]
    pub const fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Whether there are no registers. A request has at least one.
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// The register at this index in the block, from 0.
    #[inline]
    pub fn get(&self, index: usize) -> Option<u16> {
        self.pairs.get(index).map(|pair| u16::from_be_bytes(*pair))
    }

    /// Up to `count` registers from this index of the block on.
    #[inline]
    pub fn part(&self, index: usize, count: usize) -> Registers<'a> {
        let pairs = self.pairs.get(index..).unwrap_or(&[]);
        Registers {
            pairs: pairs.get(..count).unwrap_or(pairs),
        }
    }

    /// Iterates over the registers in order.
    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = u16> + 'a {
        self.pairs.iter().map(|pair| u16::from_be_bytes(*pair))
    }

    /// Copies the registers to `cells`, up to the shorter of both.
    #[inline]
    pub fn copy_to(&self, cells: &mut [u16]) {
        for (cell, pair) in cells.iter_mut().zip(self.pairs) {
            *cell = u16::from_be_bytes(*pair);
        }
    }
}

/// Registers of an answer: big endian in the frame (APP 4.2), 0 unless they are set.
#[derive(Debug)]
pub struct RegistersOut<'a> {
    pairs: &'a mut [[u8; 2]],
}

impl<'a> RegistersOut<'a> {
    /// Registers in `bytes`, high byte first; an odd last byte is ignored.
    #[inline]
    pub const fn new(bytes: &'a mut [u8]) -> RegistersOut<'a> {
        RegistersOut {
            pairs: bytes.as_chunks_mut().0,
        }
    }

    /// The number of registers that were requested.
    #[inline]
    pub const fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Whether no register was requested. A request has at least one.
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Sets the register at this index in the block, from 0.
    ///
    /// # Panics
    ///
    /// Unless `index` is below [`len`](RegistersOut::len).
    #[inline]
    pub fn set(&mut self, index: usize, value: u16) {
        self.pairs[index] = value.to_be_bytes();
    }

    /// Sets the registers in order from `values`, up to the shorter of both.
    #[inline]
    pub fn fill_from(&mut self, values: impl IntoIterator<Item = u16>) {
        for (pair, value) in self.pairs.iter_mut().zip(values) {
            *pair = value.to_be_bytes();
        }
    }

    /// Sets the registers in order from `cells`, up to the shorter of both.
    #[inline]
    pub fn copy_from(&mut self, cells: &[u16]) {
        for (pair, cell) in self.pairs.iter_mut().zip(cells) {
            *pair = cell.to_be_bytes();
        }
    }
}

/// Coils of a write request: eight to a byte, the first in the lowest bit (APP 6.11).
#[derive(Clone, Copy, Debug)]
pub struct Coils<'a> {
    bytes: &'a [u8],
    count: u16,
}

impl<'a> Coils<'a> {
    /// The `count` coils in `bytes`.
    ///
    /// # Panics
    ///
    /// Unless `bytes` is exactly as long as `count` coils need.
    #[inline]
    pub const fn new(bytes: &'a [u8], count: u16) -> Coils<'a> {
        assert!(bytes.len() == bytes_for(count));
        Coils { bytes, count }
    }

    /// Like [`new`](Coils::new) without the check, for the server, which has checked the length before.
    #[inline(always)]
    pub(crate) const fn of(bytes: &'a [u8], count: u16) -> Coils<'a> {
        Coils { bytes, count }
    }

    /// The number of coils.
    #[inline]
    pub const fn len(&self) -> u16 {
        self.count
    }

    /// Whether there are no coils. A request has at least one.
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The coil at this index in the block, from 0.
    #[inline]
    pub fn get(&self, index: u16) -> Option<bool> {
        if index >= self.count {
            return None;
        }
        self.bytes
            .get(usize::from(index >> 3))
            .map(|byte| byte >> (index & 7) & 1 != 0)
    }

    /// Iterates over the coils in order.
    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = bool> + 'a {
        let coils = *self;
        (0..self.count).map_while(move |index| coils.get(index))
    }

    /// The bytes as they are in the frame. Bits behind the last coil have no meaning and may be set.
    #[inline]
    pub const fn bytes(&self) -> &'a [u8] {
        self.bytes
    }
}

/// Coils or discrete inputs of an answer: eight to a byte, the first in the lowest bit (APP 6.1), off unless they are
/// set.
#[derive(Debug)]
pub struct CoilsOut<'a> {
    bytes: &'a mut [u8],
    count: u16,
}

impl<'a> CoilsOut<'a> {
    /// A block of `count` coils in `bytes`.
    ///
    /// # Panics
    ///
    /// Unless `bytes` is exactly as long as `count` coils need.
    #[inline]
    pub const fn new(bytes: &'a mut [u8], count: u16) -> CoilsOut<'a> {
        assert!(bytes.len() == bytes_for(count));
        CoilsOut { bytes, count }
    }

    /// Like [`new`](CoilsOut::new) without the check, for the server, which has checked the length before.
    #[inline(always)]
    pub(crate) const fn of(bytes: &'a mut [u8], count: u16) -> CoilsOut<'a> {
        CoilsOut { bytes, count }
    }

    /// The number of coils that were requested.
    #[inline]
    pub const fn len(&self) -> u16 {
        self.count
    }

    /// Whether no coil was requested. A request has at least one.
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Sets the coil at this index in the block, from 0.
    ///
    /// # Panics
    ///
    /// Unless `index` is below [`len`](CoilsOut::len).
    #[inline]
    pub fn set(&mut self, index: u16, on: bool) {
        assert!(index < self.count);
        let byte = &mut self.bytes[usize::from(index >> 3)];
        let bit = 1 << (index & 7);
        *byte = if on { *byte | bit } else { *byte & !bit };
    }

    /// Sets the coils in order from `values`, up to the shorter of both.
    #[inline]
    pub fn fill_from(&mut self, values: impl IntoIterator<Item = bool>) {
        let mut values = values.into_iter();
        let mut left = self.count;
        for byte in self.bytes.iter_mut() {
            let mut bit = 1;
            let mut bits = left.min(8) as u8;
            left = left.saturating_sub(8);
            while bits > 0 {
                match values.next() {
                    Some(true) => *byte |= bit,
                    Some(false) => *byte &= !bit,
                    None => return,
                }
                // AVR shifts by one bit at a time.
                bit <<= 1;
                bits -= 1;
            }
        }
    }

    /// The bytes as they are in the frame, one for each eight coils begun. Bits behind the last coil are cleared
    /// before the answer is sent.
    #[inline]
    pub const fn bytes_mut(&mut self) -> &mut [u8] {
        self.bytes
    }
}

/// Bytes of an answer, which are appended one by one.
#[derive(Debug)]
pub struct BytesOut<'a> {
    bytes: &'a mut [u8],
    len: u8,
    overflows: bool,
}

impl<'a> BytesOut<'a> {
    /// An empty block of bytes at the start of `bytes`, of which the first 255 are used.
    #[inline]
    pub const fn new(bytes: &'a mut [u8]) -> BytesOut<'a> {
        BytesOut {
            bytes,
            len: 0,
            overflows: false,
        }
    }

    /// Appends a byte. If there is no room for it, it is dropped, and so are all bytes after it.
    #[inline(never)]
    pub fn push(&mut self, byte: u8) {
        match self.bytes.get_mut(usize::from(self.len)) {
            Some(place) if !self.overflows && self.len < u8::MAX => {
                *place = byte;
                self.len += 1;
            }
            _ => self.overflows = true,
        }
    }

    /// Appends bytes, such as `b"text"`. Bytes without room are dropped.
    pub fn extend(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.push(byte);
        }
    }

    /// The number of bytes that were appended.
    #[inline]
    pub const fn len(&self) -> u8 {
        self.len
    }

    /// Whether no byte was appended.
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Whether a byte was dropped for lack of room.
    #[inline]
    pub const fn overflows(&self) -> bool {
        self.overflows
    }
}

/// The number of bytes that `count` coils take.
#[inline(always)]
pub(crate) const fn bytes_for(count: u16) -> usize {
    // A sum such as `count + 7` could overflow.
    (count >> 3) as usize + (count & 7 != 0) as usize
}
