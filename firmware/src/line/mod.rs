//! The line: what a board gives and what a port gets.
//!
//! [`Line`] is what ports see of it, and [`ChipLine`] is the line of every chip: a board gives it the chip, as a
//! [`Chip`](multidrop_protocol::line::Chip). The line owns the silent interval, because only the
//! interrupt sees when a character came, and the buffer, because only the interrupt fills it.
//!
//! A frame passes three moments. When no character has begun within t1.5 of the last one the frame is
//! complete but *provisional*: it is lent to the port, which may work out its answer in place. At t3.5
//! it *stands*, unless a late character has *voided* it; only then are writes carried out, and an
//! answer that was [released](Frame::release) before starts on the wire at that very moment, without
//! any task in between.
//!
//! An ASCII frame ends with a character instead of a silence: it stands as soon as it is complete.
//! Answers start at t3.5 all the same, so that whoever asked has time to take its driver off the bus.

mod chip_line;
mod lend;

use core::future::{Future, poll_fn};

pub use lend::{ChipLine, Frame, Key, Lend, LineBuffer, Released};
pub use multidrop_protocol::Adu;
use multidrop_protocol::frame::{LEN_MAX, LEN_MIN, ReceiveErrors};
pub use multidrop_protocol::line::{LineConfig, LineError, Role};
use multidrop_protocol::port_registers::Duplex;
pub use multidrop_protocol::port_registers::InterCharacter;

/// Bytes that [`Line::transmit`] cannot send. The caller's error; nothing was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TransmitError {
    /// Unit id, function code and data are this many bytes, must be 2..=254.
    Length(usize),
}

/// One serial line of a board, half duplex.
///
/// Implementations are shared between two tasks of one executor: at most one task waits for each of them at a time.
pub trait Line: Lend + Sized {
    /// Whether the board has other lines beside it. If so a [managed port](crate::managed) on it may be a sniffer, and
    /// may have a [router](mod@crate::route). What is for that costs nothing where not.
    const HAS_NEIGHBOURS: bool = false;

    /// Waits for the next frame with a good CRC or LRC and lends it, provisional (see the module). No
    /// task is woken per byte.
    ///
    /// # Errors
    /// What was wrong with a frame that was heard damaged: one error for each such frame, told when it is
    /// over. The wire's fault; its bytes are gone.
    ///
    /// # Cancellation
    /// Safe: the frame stays with the line until the next call.
    fn receive(&self) -> impl Future<Output = Result<Frame<'_, Self>, ReceiveErrors>> {
        poll_fn(|context| Frame::poll_received(self, context))
    }

    /// Waits until no frame is coming in that may be a good one: at once if none has begun. Gives what is wrong with one that is
    /// still coming in, nothing if there is none.
    ///
    /// # Cancellation
    /// Safe.
    fn quiet(&self) -> impl Future<Output = ReceiveErrors>;

    /// Waits until the buffer is free and the wire silent, or about to be, and lends the buffer to send
    /// from. What is [released](Frame::release) starts at t3.5 after the last character heard, at once
    /// if that has passed, and not at all if somebody has begun to talk: [`Released::sent`] tells.
    ///
    /// While the buffer is lent nothing can be received into it.
    ///
    /// # Cancellation
    /// Safe: nothing is lent until the future completes.
    fn lend(&self) -> impl Future<Output = Frame<'_, Self>> {
        poll_fn(|context| Frame::poll_lent(self, context))
    }

    /// Sends `bytes` (unit id, function code, data: 2..=254 bytes) as a frame: not before t3.5 after
    /// the last character heard, DE up, characters without a gap, DE down. Waits for those who begin to
    /// talk first. Returns when the wire is free again.
    ///
    /// # Errors
    /// [`TransmitError`], at once.
    ///
    /// # Cancellation
    /// Safe: the character in flight is finished, DE goes down, the line listens.
    fn transmit(&self, bytes: &[u8]) -> impl Future<Output = Result<(), TransmitError>> {
        async move {
            let len = bytes.len();
            if !(usize::from(LEN_MIN)..=usize::from(LEN_MAX)).contains(&len) {
                return Err(TransmitError::Length(len));
            }
            loop {
                let mut frame = self.lend().await;
                frame.adu()[..len].copy_from_slice(bytes);
                if frame.release(len as u8).sent().await {
                    return Ok(());
                }
            }
        }
    }

    /// Whether the line may be wired so: one that enables a driver is for one pair of wires. Nothing else depends on
    /// it; the receiver is off while the line sends.
    fn may_be(&self, duplex: Duplex) -> bool {
        duplex == Duplex::Half
    }

    /// Whether [`configure`](Line::configure) would do it.
    ///
    /// # Errors
    /// [`LineError`] if the chip cannot.
    fn check(&self, config: &LineConfig) -> Result<(), LineError>;

    /// Changes the settings. Waits until a transmission that is under way has ended; what is being
    /// received is given up and the line listens anew after t3.5 of silence.
    ///
    /// # Errors
    /// [`LineError`] if the chip cannot do it; nothing is changed then.
    ///
    /// # Cancellation
    /// Safe: nothing is changed until the future completes.
    fn configure(&self, config: LineConfig) -> impl Future<Output = Result<(), LineError>>;

    /// The character that ends an ASCII frame behind CR in place of LF, in both directions, from the next
    /// frame on (APP 6.8, sub-function 03). Other settings leave it as it is; RTU has none.
    fn set_delimiter(&self, delimiter: u8);

    /// Shows traffic to whoever looks at this line: a request of its client that has gone out, and what a
    /// [managed port](crate::managed) has heard as a master or sniffer, unit id, function code and data or what was
    /// wrong. By default nobody looks.
    #[inline(always)]
    fn show(&self, seen: Result<&[u8], ReceiveErrors>) {
        let _ = seen;
    }

    /// Behind [`sent`](Released::sent) that was false: whether what was released had begun and was cut off, since the peer did not
    /// let it be sent ([`LineConfig::cts_timeout_ms`]) or the transmitter did not come to its end. By default a line does
    /// not find that out.
    fn was_cut(&self) -> bool {
        false
    }
}
