//! Sniffing: frames that are heard on one port go to the application, or to another port as lines of text.
//!
//! A [`Capture`] observes a [line](crate::Line::show), tells requests from answers, and keeps the frames with their
//! times. They are read by the application with [`Capture::next`], or by a [managed port](crate::managed) that is a
//! sniffer (MODE 3) with framing text (FRAMING 2) and prints them. A managed port that is a sniffer with another
//! framing listens and never transmits. A master shows its own requests and what it hears.
//!
//! ```
//! use multidrop::protocol::format::Framing;
//! use multidrop::protocol::port_registers::{Mode, PortRegisters};
//! use multidrop::protocol::registers::{Bank, NoCoils, NoRules};
//! use multidrop::sniff::Capture;
//! use multidrop::{Line, ManagedPort, PortConfig};
//!
//! const RS2: PortConfig = PortConfig::new("RS2")
//!     .mode(Mode::Sniffer)
//!     .framing(Framing::Text);
//! type Rs2<L> = ManagedPort<L, PortRegisters<Bank<1>, NoCoils, NoRules>>;
//!
//! /// Prints what the capture records of another line. A board connects a line to a capture; on the STM32, `observed_by` does.
//! fn printer<L: Line>(line: L, capture: &'static Capture<384>) -> Rs2<L> {
//!     ManagedPort::new(line, &RS2, RS2.bank(), NoCoils).printing(capture)
//! }
//! ```
//!
//! The time of a frame is the moment at which it stands, t3.5 after its end; the time of a request that the port
//! itself sends is its end. A master shows an answer before it stands. If a late character then voids the answer, it
//! is shown as damaged too.

use core::cell::{Cell, RefCell};
use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::{Context, Poll};

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Instant;
use heapless::Vec;
use multidrop_protocol::Adu;
use multidrop_protocol::frame::{LEN_MAX, ReceiveErrors};
pub use multidrop_protocol::line::Observer;
use multidrop_protocol::sniffer::{Counts, Direction, Sniffer, Text, write_damaged, write_frame};

/// Supplies text to a port that prints.
pub trait TextSource {
    /// Ready when there is text. Only the last task that polled is woken.
    fn poll_text(&self, context: &mut Context<'_>) -> Poll<()>;

    /// Copies the next characters to the beginning of `into`; returns their number, at most 254. Returns them again
    /// until they are reported as [`sent`](Self::sent).
    fn text(&self, into: &mut Adu) -> u8;

    /// Reports that `len` characters were sent.
    fn sent(&self, len: u8);
}

/// A frame that was observed on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen<'a> {
    /// A good frame: its direction, and unit id, function code and data.
    Frame(Direction, &'a [u8]),
    /// A damaged frame, with its errors.
    Damaged(ReceiveErrors),
}

/// Bytes of a record before those of the frame: time, kind, length.
const HEAD: usize = 10;
/// Kinds of records; a kind from [`DAMAGED`] on holds the errors of a damaged frame.
const REQUEST: u8 = 0;
const ANSWER: u8 = 1;
const EXCEPTION: u8 = 2;
const DAMAGED: u8 = 0x80;

/// Records, one after the other; the first one is at the beginning.
struct Records<const N: usize> {
    bytes: Vec<u8, N>,
}

/// The frames that were observed and not yet taken, in `N` bytes: each takes 10 bytes and its own length. `N` is at
/// least 264.
pub struct Capture<const N: usize> {
    records: RefCell<Records<N>>,
    sniffer: RefCell<Sniffer>,
    dropped: Cell<u32>,
    /// Characters of the first record's line that were printed.
    printed: Cell<u16>,
    came: Signal<NoopRawMutex, ()>,
}

impl<const N: usize> Capture<N> {
    /// An empty capture. Where a frame can be an answer or a repeated request, it is taken for an answer within [200
    /// ms](Sniffer::PATIENCE_MS) after the request.
    pub const fn new() -> Self {
        Self::within_ms(Sniffer::PATIENCE_MS)
    }

    /// An empty capture in which a frame counts as an answer within `patience_ms` after the request. Use no more than
    /// the client's timeout.
    pub const fn within_ms(patience_ms: u32) -> Self {
        const {
            assert!(
                N >= HEAD + LEN_MAX as usize,
                "a capture must have room for a whole frame"
            )
        };
        Self {
            records: RefCell::new(Records { bytes: Vec::new() }),
            sniffer: RefCell::new(Sniffer::new(patience_ms)),
            dropped: Cell::new(0),
            printed: Cell::new(0),
            came: Signal::new(),
        }
    }

    /// Counts of all observed frames, including the dropped ones.
    pub fn counts(&self) -> Counts {
        self.sniffer.borrow().counts()
    }

    /// The number of frames, damaged ones included, that were dropped for lack of room. Wraps around.
    pub fn dropped(&self) -> u32 {
        self.dropped.get()
    }

    /// Waits for a frame, removes it, and returns the result of `f`, which gets its time in microseconds since the
    /// start. For one task, and not while a port prints the capture.
    ///
    /// # Cancellation
    /// Safe: no frame is removed before the future completes.
    pub async fn next<R>(&self, f: impl FnOnce(u64, Seen<'_>) -> R) -> R {
        poll_fn(|context| self.poll_text(context)).await;
        let mut records = self.records.borrow_mut();
        let (time, seen, len) = records.first();
        let result = f(time, seen);
        records.take(len);
        result
    }
}

impl<const N: usize> Default for Capture<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Records<N> {
    fn push(&mut self, time: u64, kind: u8, frame: &[u8]) -> bool {
        let mut head = [0; HEAD];
        head[..8].copy_from_slice(&time.to_le_bytes());
        head[8] = kind;
        head[9] = frame.len() as u8;
        HEAD + frame.len() <= N - self.bytes.len()
            && self.bytes.extend_from_slice(&head).is_ok()
            && self.bytes.extend_from_slice(frame).is_ok()
    }

    /// The first record, which must exist, and its length.
    fn first(&self) -> (u64, Seen<'_>, usize) {
        let (head, rest) = self.bytes.split_at(HEAD);
        let mut time = [0; 8];
        time.copy_from_slice(&head[..8]);
        let len = usize::from(head[9]);
        let direction = match head[8] {
            REQUEST => Direction::Request,
            ANSWER => Direction::Answer,
            _ => Direction::Exception,
        };
        let seen = match head[8].checked_sub(DAMAGED) {
            Some(errors) => Seen::Damaged(ReceiveErrors::from_bits_truncate(errors)),
            None => Seen::Frame(direction, &rest[..len]),
        };
        (u64::from_le_bytes(time), seen, HEAD + len)
    }

    fn take(&mut self, len: usize) {
        self.bytes.drain(..len);
    }
}

impl<const N: usize> Observer for Capture<N> {
    fn hear(&self, seen: Result<&[u8], ReceiveErrors>) {
        let time = Instant::now().as_micros();
        let mut sniffer = self.sniffer.borrow_mut();
        let (kind, frame) = match seen {
            Ok(frame) => {
                let kind = match sniffer.frame(frame, time) {
                    Direction::Request => REQUEST,
                    Direction::Answer => ANSWER,
                    Direction::Exception => EXCEPTION,
                };
                (kind, frame)
            }
            Err(errors) => {
                sniffer.damaged();
                (DAMAGED | errors.bits(), &[][..])
            }
        };
        if self.records.borrow_mut().push(time, kind, frame) {
            self.came.signal(());
        } else {
            self.dropped.set(self.dropped.get().wrapping_add(1));
        }
    }
}

impl<const N: usize> TextSource for Capture<N> {
    fn poll_text(&self, context: &mut Context<'_>) -> Poll<()> {
        loop {
            let came = pin!(self.came.wait()).poll(context);
            if !self.records.borrow().bytes.is_empty() {
                return Poll::Ready(());
            }
            if came.is_pending() {
                return Poll::Pending;
            }
        }
    }

    fn text(&self, into: &mut Adu) -> u8 {
        let records = self.records.borrow();
        if records.bytes.is_empty() {
            return 0;
        }
        let mut window = Window {
            skip: self.printed.get(),
            into: &mut into[..CHUNK],
            len: 0,
        };
        window.write(records.first());
        window.len
    }

    fn sent(&self, len: u8) {
        let mut records = self.records.borrow_mut();
        if records.bytes.is_empty() {
            return;
        }
        let printed = self.printed.get() + u16::from(len);
        let first = records.first();
        let mut rest = Window {
            skip: printed,
            into: &mut [0],
            len: 0,
        };
        rest.write(first);
        if rest.len > 0 {
            self.printed.set(printed);
            return;
        }
        let (.., len) = first;
        self.printed.set(0);
        records.take(len);
    }
}

/// Characters that are printed in one call. A line ends with two characters, and no line is one character longer than
/// a multiple of this.
const CHUNK: usize = LEN_MAX as usize;

/// A part of a line of text.
struct Window<'a> {
    skip: u16,
    into: &'a mut [u8],
    len: u8,
}

impl Window<'_> {
    fn write(&mut self, (time, seen, _): (u64, Seen<'_>, usize)) {
        match seen {
            Seen::Frame(direction, frame) => write_frame(self, time, direction, frame),
            Seen::Damaged(errors) => write_damaged(self, time, errors),
        }
    }
}

impl Text for Window<'_> {
    fn push(&mut self, character: u8) {
        if self.skip > 0 {
            self.skip -= 1;
        } else if let Some(place) = self.into.get_mut(usize::from(self.len)) {
            *place = character;
            self.len += 1;
        }
    }
}
