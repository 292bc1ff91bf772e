//! Text that is assembled at compile time: `panic!` in a `const` takes one complete `&str` and formats nothing.
//!
//! Configuration checks here, in the firmware and in boards use it for build errors that name the wrong value. An
//! image whose messages are all made in a `const` contains nothing of it.

const CAPACITY: usize = 160;

// Not a `heapless::String`: text cannot be pushed to one in a `const fn`.

/// A message under construction. Text beyond 160 bytes is cut.
#[derive(Clone, Copy, Debug)]
pub struct Message {
    text: [u8; CAPACITY],
    len: usize,
}

impl Message {
    /// A message without text.
    #[allow(clippy::new_without_default)]
    pub const fn new() -> Self {
        Self {
            text: [0; CAPACITY],
            len: 0,
        }
    }

    /// Appends this text.
    pub const fn text(mut self, text: &str) -> Self {
        let bytes = text.as_bytes();
        let mut i = 0;
        while i < bytes.len() && self.len < CAPACITY {
            self.text[self.len] = bytes[i];
            self.len += 1;
            i += 1;
        }
        self
    }

    /// Appends this number in decimal digits.
    pub const fn number(self, value: u32) -> Self {
        let mut digits = [0; 10];
        let mut start = digits.len();
        let mut rest = value;
        loop {
            start -= 1;
            digits[start] = b'0' + (rest % 10) as u8;
            rest /= 10;
            if rest == 0 {
                break;
            }
        }
        let (_, digits) = digits.split_at(start);
        match core::str::from_utf8(digits) {
            Ok(digits) => self.text(digits),
            Err(_) => self,
        }
    }

    /// Appends the range that a value must be in, both ends included: `must be LOW..=HIGH`.
    pub const fn range(self, low: u32, high: u32) -> Self {
        self.text("must be ").number(low).text("..=").number(high)
    }

    /// The text of the message.
    pub const fn as_str(&self) -> &str {
        let (text, _) = self.text.split_at(self.len);
        match core::str::from_utf8(text) {
            Ok(text) => text,
            Err(_) => "message cut inside a character",
        }
    }

    /// Stops the build with the message.
    ///
    /// # Panics
    ///
    /// Always.
    pub const fn fail(self) -> ! {
        panic!("{}", self.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_numbers_stand_in_order() {
        let message = Message::new()
            .text("baud is ")
            .number(0)
            .text("/")
            .number(4_294_967_295);
        assert_eq!(message.as_str(), "baud is 0/4294967295");
    }

    #[test]
    fn what_does_not_fit_is_cut() {
        let mut message = Message::new();
        for _ in 0..100 {
            message = message.text("four");
        }
        assert_eq!(message.as_str().len(), CAPACITY);
    }
}
