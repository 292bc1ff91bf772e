//! A peer that answers by the book, but the first request.

use super::{Heard, Registers, SENDS};
use multidrop::ClientConfig;

pub const TIMEOUT: u64 = 100;
pub const CONFIG: ClientConfig = ClientConfig::new().timeout_ms(TIMEOUT as u16);
/// From the request's end to the answer's.
pub const DELAY: u64 = 10;
/// A request that is not answered.
pub const FOR_NOTHING: u64 = SENDS + TIMEOUT;

/// A peer that answers by the book, but the first request as `first` makes it of the right answer.
pub fn once(
    mut first: impl FnMut(Vec<u8>) -> Vec<(u64, Heard)> + 'static,
) -> impl FnMut(&[u8]) -> Vec<(u64, Heard)> + 'static {
    let mut registers = Registers::default();
    let mut asked = false;
    move |request| {
        let Some(answer) = registers.answer(request) else {
            return vec![];
        };
        if asked {
            vec![(DELAY, Heard::Frame(answer))]
        } else {
            asked = true;
            first(answer)
        }
    }
}
