//! What a server remembers of its line, and the functions that tell of it (APP 6.8 to 6.10, SER appendix A).

use super::Plan;
use crate::Adu;
use crate::exception::Exception;
use crate::rtu::ReceiveErrors;

/// Whether a server counts what happens on its line: [`Uncounted`] or [`Counted`](super::Counted).
///
/// A server that counts has Diagnostics (FC 08), Get Comm Event Counter (0B) and Get Comm Event Log (0C), and can be forced to
/// listen only. One that does not answers them with exception 01, and takes no flash or RAM for them.
pub trait Diagnostics {
    /// Whether it does.
    const COUNTS: bool;

    /// Whether the request in `frame[..len]` is not to be looked at, since the server was told to listen only. The request
    /// that ends it is.
    fn is_deaf_to(&self, frame: &Adu, len: u8) -> bool;

    /// The answer to FC 08, 0B or 0C; `busy` if the application is.
    ///
    /// # Errors
    ///
    /// The exception to answer with.
    fn prepare(&self, frame: &mut Adu, len: u8, busy: bool) -> Result<Plan, Exception>;

    /// A request to this server is dealt with: `answer_len` is 0 if it is not answered, `refused` the exception it came to,
    /// whether or not that goes out.
    fn completed(&self, frame: &Adu, plan: Plan, answer_len: u8, refused: Option<Exception>);

    /// The answer to a request that was [dealt with](Diagnostics::completed) did not go out.
    fn cut_off(&self);

    /// A good frame for somebody else.
    fn overheard(&self);

    /// A damaged frame, whoever it was for.
    fn damaged(&self, errors: ReceiveErrors);

    /// The character that ends an ASCII frame behind CR.
    fn delimiter(&self) -> u8;
}

/// Line feed, the end of an ASCII frame until FC 08 changes it (SER 2.5.2.1).
pub(super) const LINE_FEED: u8 = 0x0A;

/// Nothing is counted.
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
        LINE_FEED
    }
}
