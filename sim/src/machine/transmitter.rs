//! The transmitter of a USART: a data register before a shift register (RM0090 30.3.2).
//!
//! QEMU sends a character in the instant in which it is written and calls its transmitter ready and done ever after. This one takes
//! the time that the character has on the wire.

use super::{TC, TXE};
use crate::time::Time;

#[derive(Default)]
pub(super) struct Transmitter {
    /// The content of the data register, and since when.
    waiting: Option<(Time, u8)>,
    /// When the character in the shift register, or the last one that was there, has left with its stop bits.
    busy_until: Time,
}

impl Transmitter {
    /// A character is written to the data register. One that waits there is lost.
    pub fn put(&mut self, at: Time, byte: u8) {
        self.waiting = Some((at, byte));
    }

    /// It is switched on: an idle character goes first (RM0090 30.3.2).
    pub fn idle(&mut self, at: Time, character: Time) {
        self.busy_until = self.busy_until.max(at + character);
    }

    /// What waits may not begin before `at`.
    pub fn hold_until(&mut self, at: Time) {
        self.busy_until = self.busy_until.max(at);
    }

    /// What begins on the wire until `now`, and when, if a character takes so long.
    pub fn advance(&mut self, now: Time, character: Time) -> Option<(Time, u8)> {
        if self.busy_until > now {
            return None;
        }
        let (since, byte) = self.waiting.take()?;
        let begins = since.max(self.busy_until);
        self.busy_until = begins + character;
        Some((begins, byte))
    }

    /// Its flags in SR (RM0090 30.6.1).
    pub fn flags(&self, now: Time) -> u32 {
        match self.waiting {
            Some(_) => 0,
            None if self.busy_until > now => TXE,
            None => TXE | TC,
        }
    }

    /// When it does something by itself after `now`.
    pub fn due(&self, now: Time) -> Time {
        if self.busy_until > now {
            self.busy_until
        } else {
            Time::NEVER
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHARACTER: Time = Time::from_us(100);

    #[test]
    fn characters_follow_each_other_without_a_gap() {
        let mut transmitter = Transmitter::default();
        let at = Time::from_us;
        assert_eq!(transmitter.flags(at(7)), TXE | TC);
        transmitter.put(at(7), 1);
        assert_eq!(transmitter.advance(at(7), CHARACTER), Some((at(7), 1)));
        assert_eq!(transmitter.flags(at(7)), TXE);
        transmitter.put(at(8), 2);
        assert_eq!(transmitter.advance(at(8), CHARACTER), None);
        assert_eq!(transmitter.flags(at(8)), 0);
        assert_eq!(transmitter.due(at(8)), at(107));
        assert_eq!(transmitter.advance(at(109), CHARACTER), Some((at(107), 2)));
        assert_eq!(transmitter.flags(at(109)), TXE);
        assert_eq!(transmitter.flags(at(207)), TXE | TC);
        assert_eq!(transmitter.due(at(207)), Time::NEVER);
    }

    #[test]
    fn a_character_put_over_another_is_the_one_that_is_sent() {
        let mut transmitter = Transmitter::default();
        let at = Time::from_us;
        transmitter.put(at(0), 1);
        transmitter.advance(at(0), CHARACTER);
        transmitter.put(at(1), 2);
        transmitter.put(at(2), 3);
        assert_eq!(transmitter.advance(at(100), CHARACTER), Some((at(100), 3)));
        assert_eq!(transmitter.advance(at(200), CHARACTER), None);
    }
}
