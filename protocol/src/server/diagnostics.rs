//! The counters of a server, and the functions that read them (APP 6.8 to 6.10, SER appendix A).

use super::Plan;
use crate::Adu;
use crate::ascii::DELIMITER;
use crate::exception::Exception;
use crate::frame::ReceiveErrors;

/// Whether a server counts the events of its line: [`Uncounted`] or [`Counted`](super::Counted).
///
/// A server with counters has Diagnostics (FC 08), Get Comm Event Counter (0B) and Get Comm Event Log (0C), and can
/// be put in listen-only mode. A server without counters answers them with exception 01, and they take no flash or
/// RAM.
pub trait Diagnostics {
    /// Whether the server has counters.
    const COUNTS: bool;

    /// Whether the request in `frame[..len]` must be ignored, since the server is in listen-only mode. The request
    /// that ends the mode is not ignored.
    fn is_deaf_to(&self, frame: &Adu, len: u8) -> bool;

    /// Makes the answer to FC 08, 0B or 0C; `busy` if the application is.
    ///
    /// # Errors
    ///
    /// The exception of the answer.
    fn prepare(&self, frame: &mut Adu, len: u8, busy: bool) -> Result<Plan, Exception>;

    /// Counts a request to this server that was handled: `answer_len` is 0 if it has no answer, `refused` is its
    /// exception, even if that is not sent.
    fn completed(&self, frame: &Adu, plan: Plan, answer_len: u8, refused: Option<Exception>);

    /// Counts an answer that was not sent, to a request that was [handled](Diagnostics::completed).
    fn cut_off(&self);

    /// Counts a good frame for another unit.
    fn overheard(&self);

    /// Counts a damaged frame for any unit.
    fn damaged(&self, errors: ReceiveErrors);

    /// The character behind CR that ends an ASCII frame.
    fn delimiter(&self) -> u8;
}

/// A server without counters.
#[derive(Clone, Copy, Debug, Default)]
pub struct Uncounted;

impl Diagnostics for Uncounted {
    const COUNTS: bool = false;

    #[inline(always)]
    fn is_deaf_to(&self, _: &Adu, _: u8) -> bool {
        false
    }

    #[inline(always)]
    fn prepare(&self, _: &mut Adu, _: u8, _: bool) -> Result<Plan, Exception> {
        Err(Exception::IllegalFunction)
    }

    #[inline(always)]
    fn completed(&self, _: &Adu, _: Plan, _: u8, _: Option<Exception>) {}

    #[inline(always)]
    fn cut_off(&self) {}

    #[inline(always)]
    fn overheard(&self) {}

    #[inline(always)]
    fn damaged(&self, _: ReceiveErrors) {}

    #[inline(always)]
    fn delimiter(&self) -> u8 {
        DELIMITER
    }
}
