//! Blocks of coils and registers in the shape they have in a frame.
//!
//! A data model is lent the bytes of the frame itself, so a value is copied once: from the application's memory to the wire,
//! or back.

/// Registers of a write request, to be read: big endian in the frame (APP 4.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Registers<'a> {
    pairs: &'a [[u8; 2]],
}

impl<'a> Registers<'a> {
    /// The registers in `bytes`, high byte first; an odd last byte is left out.
    #[inline]
    pub const fn new(bytes: &'a [u8]) -> Registers<'a> {
        Registers {
            pairs: bytes.as_chunks().0,
        }
    }

    /// How many there are.
    #[inline]
    pub const fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Whether there are none. In a request there always is one.
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// The register at this place in the block, from 0.
    #[inline]
    pub fn get(&self, index: usize) -> Option<u16> {
        self.pairs.get(index).map(|pair| u16::from_be_bytes(*pair))
    }

    /// The `count` registers from this place in the block on, as far as there are any.
    #[inline]
    pub fn part(&self, index: usize, count: usize) -> Registers<'a> {
        let pairs = self.pairs.get(index..).unwrap_or(&[]);
        Registers {
            pairs: pairs.get(..count).unwrap_or(pairs),
        }
    }

    /// All of them in order.
    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = u16> + 'a {
        self.pairs.iter().map(|pair| u16::from_be_bytes(*pair))
    }

    /// Copies them to `cells`, as far as both go.
    #[inline]
    pub fn copy_to(&self, cells: &mut [u16]) {
        for (cell, pair) in cells.iter_mut().zip(self.pairs) {
            *cell = u16::from_be_bytes(*pair);
        }
    }
}

/// Registers of an answer, to be filled in: big endian in the frame (APP 4.2), 0 as long as nothing is set.
#[derive(Debug)]
pub struct RegistersOut<'a> {
    pairs: &'a mut [[u8; 2]],
}

impl<'a> RegistersOut<'a> {
    /// Registers to be written to `bytes`, high byte first; an odd last byte is left out.
    #[inline]
    pub const fn new(bytes: &'a mut [u8]) -> RegistersOut<'a> {
        RegistersOut {
            pairs: bytes.as_chunks_mut().0,
        }
    }

    /// How many are asked for.
    #[inline]
    pub const fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Whether none is asked for. In a request it always is at least one.
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Sets the register at this place in the block, from 0.
    ///
    /// # Panics
    ///
    /// If `index` is not under [`len`](RegistersOut::len).
    #[inline]
    pub fn set(&mut self, index: usize, value: u16) {
        self.pairs[index] = value.to_be_bytes();
    }

    /// Sets all of them in order from `values`, as far as both go.
    #[inline]
    pub fn fill_from(&mut self, values: impl IntoIterator<Item = u16>) {
        for (pair, value) in self.pairs.iter_mut().zip(values) {
            *pair = value.to_be_bytes();
        }
    }

    /// Copies `cells` to them, as far as both go.
    #[inline]
    pub fn copy_from(&mut self, cells: &[u16]) {
        for (pair, cell) in self.pairs.iter_mut().zip(cells) {
            *pair = cell.to_be_bytes();
        }
    }
}

/// Coils of a write request, to be read: eight to a byte, the first in the lowest bit (APP 6.11).
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
    /// Unless `bytes` is as long as so many coils need, and no longer.
    #[inline]
    pub const fn new(bytes: &'a [u8], count: u16) -> Coils<'a> {
        assert!(bytes.len() == bytes_for(count));
        Coils { bytes, count }
    }

    /// Without the check of [`new`](Coils::new), for the server, which has checked already.
    #[inline(always)]
    pub(crate) const fn of(bytes: &'a [u8], count: u16) -> Coils<'a> {
        Coils { bytes, count }
    }

    /// How many there are.
    #[inline]
    pub const fn len(&self) -> u16 {
        self.count
    }

    /// Whether there are none. In a request there always is one.
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The coil at this place in the block, from 0.
    #[inline]
    pub fn get(&self, index: u16) -> Option<bool> {
        if index >= self.count {
            return None;
        }
        self.bytes
            .get(usize::from(index >> 3))
            .map(|byte| byte >> (index & 7) & 1 != 0)
    }

    /// All of them in order.
    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = bool> + 'a {
        let coils = *self;
        (0..self.count).map_while(move |index| coils.get(index))
    }

    /// The bytes as they are in the frame. Bits behind the last coil mean nothing and may be set.
    #[inline]
    pub const fn bytes(&self) -> &'a [u8] {
        self.bytes
    }
}

/// Coils or discrete inputs of an answer, to be filled in: eight to a byte, the first in the lowest bit (APP 6.1), off as
/// long as nothing is set.
#[derive(Debug)]
pub struct CoilsOut<'a> {
    bytes: &'a mut [u8],
    count: u16,
}

impl<'a> CoilsOut<'a> {
    /// `count` coils to be written to `bytes`.
    ///
    /// # Panics
    ///
    /// Unless `bytes` is as long as so many coils need, and no longer.
    #[inline]
    pub const fn new(bytes: &'a mut [u8], count: u16) -> CoilsOut<'a> {
        assert!(bytes.len() == bytes_for(count));
        CoilsOut { bytes, count }
    }

    /// Without the check of [`new`](CoilsOut::new), for the server, which has checked already.
    #[inline(always)]
    pub(crate) const fn of(bytes: &'a mut [u8], count: u16) -> CoilsOut<'a> {
        CoilsOut { bytes, count }
    }

    /// How many are asked for.
    #[inline]
    pub const fn len(&self) -> u16 {
        self.count
    }

    /// Whether none is asked for. In a request it always is at least one.
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Sets the coil at this place in the block, from 0.
    ///
    /// # Panics
    ///
    /// If `index` is not under [`len`](CoilsOut::len).
    #[inline]
    pub fn set(&mut self, index: u16, on: bool) {
        assert!(index < self.count);
        let byte = &mut self.bytes[usize::from(index >> 3)];
        let bit = 1 << (index & 7);
        *byte = if on { *byte | bit } else { *byte & !bit };
    }

    /// Sets all of them in order from `values`, as far as both go.
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
                // By one at a time, which is what AVR shifts by.
                bit <<= 1;
                bits -= 1;
            }
        }
    }

    /// The bytes as they will be in the frame, one for each eight coils begun. What is set behind the last coil is cleared
    /// before the answer goes out.
    #[inline]
    pub const fn bytes_mut(&mut self) -> &mut [u8] {
        self.bytes
    }
}

/// Bytes of an answer, to be written one behind the other.
#[derive(Debug)]
pub struct BytesOut<'a> {
    bytes: &'a mut [u8],
    len: u8,
    overflows: bool,
}

impl<'a> BytesOut<'a> {
    /// Bytes to be written to the start of `bytes`, of which the first 255 are used.
    #[inline]
    pub const fn new(bytes: &'a mut [u8]) -> BytesOut<'a> {
        BytesOut {
            bytes,
            len: 0,
            overflows: false,
        }
    }

    /// One more. Without room it is left out, and so is all that follows.
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

    /// These too, such as `b"text"`. What has no room is left out.
    pub fn extend(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.push(byte);
        }
    }

    /// How many are written.
    #[inline]
    pub const fn len(&self) -> u8 {
        self.len
    }

    /// Whether none is written.
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Whether something had no room.
    #[inline]
    pub const fn overflows(&self) -> bool {
        self.overflows
    }
}

/// Bytes that hold so many coils.
#[inline(always)]
pub(crate) const fn bytes_for(count: u16) -> usize {
    // Without the sum that could overflow.
    (count >> 3) as usize + (count & 7 != 0) as usize
}
