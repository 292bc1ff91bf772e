//! The serial line that a board makes and a port uses.
//!
//! [`Line`] is the interface of a line to its port. [`ChipLine`] is the line of every chip: a board gives it the chip, as a
//! [`Chip`](multidrop_protocol::line::Chip). The line owns the silent interval, because only the interrupt sees when a character
//! came. It owns the buffer, because only the interrupt fills it.
//!
//! A frame is complete when no character has begun within t1.5 of its last one, but it is still
//! *provisional*: the line lends the frame to the port, which may work out the answer in place. At t3.5 the
//! frame *stands*, unless a late character has *voided* it. Only then are writes carried out. An answer that
//! was [released](Frame::release) before starts on the wire at that very moment, without any task in
//! between.
//!
//! An ASCII frame ends with a character instead of a silence: it stands as soon as it is complete. Its answer still starts at t3.5,
//! so that the client has time to take its driver off the bus.

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
    /// The number of bytes of unit id, function code and data, which must be 2..=254.
    Length(usize),
}

/// One serial line of a board, half duplex.
///
/// Two tasks of one executor share a line. At most one task at a time waits for each of its futures.
pub trait Line: Lend + Sized {
    /// Whether the board has other lines beside this one. If so, a [managed port](crate::managed) on the line may be a sniffer, and
    /// may have a [router](mod@crate::route). If not, the code for these costs nothing.
    const HAS_NEIGHBOURS: bool = false;

    /// Waits for the next frame with a good CRC or LRC and lends the frame, which is provisional (see the module). No task is woken
    /// per byte.
    ///
    /// # Errors
    /// The errors of a damaged frame: once for each such frame, when the frame is over. The fault is the wire's; the bytes of the
    /// frame are lost.
    ///
    /// # Cancellation
    /// Safe: the frame stays with the line until the next call.
    fn receive(&self) -> impl Future<Output = Result<Frame<'_, Self>, ReceiveErrors>> {
        poll_fn(|context| Frame::poll_received(self, context))
    }

    /// Waits until no frame comes in that may be good: returns at once if none has begun. Gives the errors of a damaged frame that
    /// still comes in, no errors if there is none.
    ///
    /// # Cancellation
    /// Safe.
    fn quiet(&self) -> impl Future<Output = ReceiveErrors>;

    /// Waits until the buffer is free and the wire is silent, or about to be, and lends the buffer to send from.
    /// [Released](Frame::release) bytes start at t3.5 after the last character heard, at once if t3.5 has passed, and not at all if
    /// another node has begun to send: [`Released::sent`] gives the outcome.
    ///
    /// While the buffer is lent, no frame can be received into it.
    ///
    /// # Cancellation
    /// Safe: nothing is lent until the future completes.
    fn lend(&self) -> impl Future<Output = Frame<'_, Self>> {
        poll_fn(|context| Frame::poll_lent(self, context))
    }

    /// Sends `bytes` (unit id, function code, data: 2..=254 bytes) as a frame: not before t3.5 after the last character heard,
    /// DE up, characters without a gap, DE down. Waits while other nodes begin to send first. Returns when the wire is free
    /// again.
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

    /// Whether the line may be wired for `duplex`. A line that enables a driver is for one pair of wires. Nothing else depends on
    /// the wiring; the receiver is off while the line sends.
    fn may_be(&self, duplex: Duplex) -> bool {
        duplex == Duplex::Half
    }

    /// Whether [`configure`](Line::configure) can put these settings into effect.
    ///
    /// # Errors
    /// [`LineError`] if the chip cannot.
    fn check(&self, config: &LineConfig) -> Result<(), LineError>;

    /// Changes the settings. Waits until a transmission that is under way has ended. An incoming frame is given up, and the line
    /// listens anew after t3.5 of silence.
    ///
    /// # Errors
    /// [`LineError`] if the chip cannot do it; nothing is changed then.
    ///
    /// # Cancellation
    /// Safe: nothing is changed until the future completes.
    fn configure(&self, config: LineConfig) -> impl Future<Output = Result<(), LineError>>;

    /// Sets the character that ends an ASCII frame after CR in place of LF, in both directions, from the next frame on (APP 6.8,
    /// sub-function 03). Other settings do not change the delimiter; RTU has none.
    fn set_delimiter(&self, delimiter: u8);

    /// Shows traffic to the observer of this line: a request that the line's client has sent, and a frame that a [managed
    /// port](crate::managed) has heard as a master or sniffer. The observer sees unit id, function code and data, or the errors of
    /// a damaged frame. By default a line has no observer.
    #[inline(always)]
    fn show(&self, seen: Result<&[u8], ReceiveErrors>) {
        let _ = seen;
    }

    /// Whether the released bytes had begun and were cut off, after [`sent`](Released::sent) was false: the peer did not let
    /// them be sent ([`LineConfig::cts_timeout_ms`]), or the transmitter did not finish. By default a line does not find that
    /// out.
    fn was_cut(&self) -> bool {
        false
    }
}
