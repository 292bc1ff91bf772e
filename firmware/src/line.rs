//! The line: what a board gives and what a port gets.
//!
//! [`Line`] is the one trait between chip and firmware. It owns the silent interval, because only the
//! interrupt sees when a character came, and the buffer, because only the interrupt fills it.
//!
//! A frame passes three moments. When no character has begun within t1.5 of the last one the frame is
//! complete but *provisional*: it is lent to the port, which may work out its answer in place. At t3.5
//! it *stands*, unless a late character has *voided* it; only then are writes carried out, and an
//! answer that was [released](Frame::release) before starts on the wire at that very moment, without
//! any task in between.

use core::future::Future;

pub use multidrop_protocol::Adu;
use multidrop_protocol::format::LineFormat;
use multidrop_protocol::rtu::Flaws;

/// Whether a gap of more than 1.5 characters inside a frame makes it bad (SER 2.5.1.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InterCharacter {
    /// The standard: such a frame is dropped and counted.
    Strict,
    /// Only t3.5 ends a frame: for peers behind USB adapters, which pause inside frames.
    Off,
}

/// How a line is to be set up, at start or later.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineConfig {
    /// Bits per second.
    pub baud: u32,
    /// Data bits, parity and stop bits of a character.
    pub format: LineFormat,
    /// The rule for gaps inside a frame.
    pub inter_character: InterCharacter,
}

/// A [`LineConfig`] that the chip cannot do. The caller's error; the line keeps its settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineError {
    /// The clock does not make this rate within 2.5 %.
    Baud {
        /// The nearest rate that it does make.
        nearest: u32,
    },
    /// The USART has no such character format, or the framing cannot use it.
    Format(LineFormat),
}

/// One serial line of a board, half duplex.
///
/// Methods below the heading of [`Frame`] are called through it only. Implementations are shared
/// between two tasks of one executor: at most one future of each method exists at a time.
pub trait Line: Sized {
    /// Waits for the next frame with a good CRC and lends it, provisional (see the module). No task is
    /// woken per byte.
    ///
    /// # Errors
    /// What was wrong with a frame that was heard damaged, told after t3.5 so that it can be counted.
    /// The wire's fault; its bytes are gone.
    ///
    /// # Cancellation
    /// Safe: the frame stays with the line until the next call.
    fn receive(&self) -> impl Future<Output = Result<Frame<'_, Self>, Flaws>>;

    /// Sends `frame` (unit id, function code, data: 2..=254 bytes) with its CRC: not before t3.5 after
    /// the last character heard, DE up, characters without a gap, DE down. Returns when the wire is
    /// free again.
    ///
    /// # Cancellation
    /// Safe: the character in flight is finished, DE goes down, the line listens.
    fn transmit(&self, frame: &[u8]) -> impl Future<Output = ()>;

    /// Changes the settings. Waits until a transmission that is under way has ended; what is being
    /// received is given up and the line listens anew after t3.5 of silence.
    ///
    /// # Errors
    /// [`LineError`] if the chip cannot do it; nothing is changed then.
    ///
    /// # Cancellation
    /// Safe: nothing is changed until the future completes.
    fn configure(&self, config: LineConfig) -> impl Future<Output = Result<(), LineError>>;

    /// [`Frame::release`].
    fn release(&self, len: u8);

    /// [`Frame::settle`].
    fn settle(&self) -> impl Future<Output = bool>;

    /// [`Frame::sent`].
    fn sent(&self) -> impl Future<Output = ()>;

    /// The frame was dropped: the buffer is the line's again, an answer that has not started is
    /// withdrawn, one that has is cut off after the character in flight.
    fn give_back(&self);
}

/// A frame lent by its line. Dropping it gives the buffer back.
pub struct Frame<'l, L: Line> {
    line: &'l L,
    adu: &'l mut Adu,
    len: u8,
}

impl<'l, L: Line> Frame<'l, L> {
    /// For implementations of [`Line::receive`]: `len` bytes of unit id, function code and data.
    pub fn new(line: &'l L, adu: &'l mut Adu, len: u8) -> Self {
        Self { line, adu, len }
    }

    /// Number of bytes of unit id, function code and data: 2..=254.
    pub fn request_len(&self) -> u8 {
        self.len
    }

    /// The unit id that the frame is addressed to.
    pub fn unit(&self) -> u8 {
        self.adu[0]
    }

    /// The buffer, to read.
    pub fn bytes(&self) -> &Adu {
        self.adu
    }

    /// The buffer: the request in its first [`request_len`](Self::request_len) bytes, to be replaced
    /// by the answer.
    pub fn adu(&mut self) -> &mut Adu {
        self.adu
    }

    /// Hands the first `len` bytes of the buffer (2..=254) to the transmitter. It starts at t3.5 if
    /// the frame stands, at once if t3.5 has passed and nobody is talking, and not at all if the frame
    /// is void. From here on these bytes must not be changed.
    pub fn release(&mut self, len: u8) {
        self.line.release(len);
    }

    /// Waits for t3.5: true if the frame stands, false as soon as a late character has voided it.
    ///
    /// # Cancellation
    /// Safe: the verdict stays with the line.
    pub fn settle(&mut self) -> impl Future<Output = bool> {
        self.line.settle()
    }

    /// Waits until the released answer is on the wire whole and DE is down; returns at once if nothing
    /// was released or the frame is void.
    ///
    /// # Cancellation
    /// Safe. Dropping the frame itself cuts the answer off after the character in flight.
    pub fn sent(&mut self) -> impl Future<Output = ()> {
        self.line.sent()
    }
}

impl<L: Line> Drop for Frame<'_, L> {
    fn drop(&mut self) {
        self.line.give_back();
    }
}
