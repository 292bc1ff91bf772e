//! Bytes between one writer and one reader, of which one is an interrupt and the other a task.
//!
//! `first` and `count` change with interrupts off only, so each side sees both as they belong together: the chip has one core and its
//! interrupts do not nest. The bytes themselves need no such care: the reader looks at those that are counted, the writer at those
//! that are not, and a byte goes from one to the other by [`Ring::commit`] or [`Ring::consume`].

/// The ring: where its bytes are, and which of them are full. It holds up to 255.
pub(super) struct Ring {
    bytes: *mut u8,
    len: u8,
    /// The place of the oldest byte.
    first: u8,
    /// Bytes that are full, from `first` on and round the end.
    count: u8,
}

impl Ring {
    pub const fn new() -> Self {
        Self {
            bytes: core::ptr::null_mut(),
            len: 0,
            first: 0,
            count: 0,
        }
    }

    /// Takes the bytes for good, 1 to 255 of them.
    pub fn take<const N: usize>(&mut self, bytes: &'static mut [u8; N]) {
        const { assert!(N > 0 && N < 256, "a buffer of the UART has 1 to 255 bytes") };
        self.bytes = bytes.as_mut_ptr();
        self.len = N as u8;
    }

    pub fn count(&self) -> u8 {
        self.count
    }

    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    pub fn is_full(&self) -> bool {
        self.count == self.len
    }

    /// Half of the room, rounded down.
    pub fn half(&self) -> u8 {
        self.len / 2
    }

    /// Returns the place `behind` bytes after `first`; `behind` is at most `len`.
    fn place(&self, behind: u8) -> u8 {
        let to_end = self.len - self.first;
        if behind >= to_end {
            behind - to_end
        } else {
            self.first + behind
        }
    }

    /// Returns where the oldest bytes are, and how many lie there one after the other, at most `most`.
    pub fn full(&self, most: u8) -> (*const u8, u8) {
        let len = most.min(self.count).min(self.len - self.first);
        // SAFETY: `first` is below `len`; before `take` it is 0, and so is the offset.
        (unsafe { self.bytes.add(usize::from(self.first)) }, len)
    }

    /// Returns where the next bytes go, and how many have room there one after the other.
    pub fn room(&self) -> (*mut u8, u8) {
        let place = self.place(self.count);
        let len = (self.len - self.count).min(self.len - place);
        // SAFETY: `place` is below `len`, or 0.
        (unsafe { self.bytes.add(usize::from(place)) }, len)
    }

    /// Adds `count` bytes, which were written to where [`room`](Self::room) said: at most as many as it said.
    pub fn commit(&mut self, count: u8) {
        self.count += count;
    }

    /// Removes the `count` oldest bytes, or all of them if there are fewer.
    pub fn consume(&mut self, count: u8) {
        let count = count.min(self.count);
        self.first = self.place(count);
        self.count -= count;
    }

    /// Adds one byte; whether it had room.
    #[inline(always)]
    pub fn push(&mut self, byte: u8) -> bool {
        if self.is_full() {
            return false;
        }
        let (at, _) = self.room();
        // SAFETY: there is room, and the reader does not look there before it is counted.
        unsafe { at.write(byte) };
        self.count += 1;
        true
    }

    /// Takes the oldest byte.
    #[inline(always)]
    pub fn pop(&mut self) -> Option<u8> {
        let (at, 1) = self.full(1) else { return None };
        // SAFETY: it is full, and the writer does not write there before it is consumed.
        let byte = unsafe { at.read() };
        self.consume(1);
        Some(byte)
    }
}
