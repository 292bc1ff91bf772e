//! Sniffing: what is heard on one port goes to the application, or to another port as lines of text.
//!
//! A [`Capture`] takes what a line [shows](crate::Line::show), says which frame is a request and which its answer, and
//! keeps both with their time until somebody takes them: the application by [`Capture::next`], or a
//! [managed port](crate::managed) that is a sniffer (MODE 3) with framing text (FRAMING 2), which prints them. A
//! managed port that is a sniffer with another framing listens and never talks; as a master it shows its own
//! requests and what it hears.
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
//! /// What the capture takes from another line is printed by this one. A board shows a line to a capture: the STM32's by `observed_by`.
//! fn printer<L: Line>(line: L, capture: &'static Capture<384>) -> Rs2<L> {
//!     ManagedPort::new(line, &RS2, RS2.bank(), NoCoils).printing(capture)
//! }
//! ```
//!
//! The time of a frame is that in which it stands, t3.5 behind its end; of a request that the port makes itself, its end.
//! A master shows an answer before it stands; one that is voided by a late character is shown as damaged too.

use core::cell::{Cell, RefCell};
use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::{Context, Poll};

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Instant;
use multidrop_protocol::Adu;
use multidrop_protocol::rtu::ReceiveErrors;
use multidrop_protocol::sniffer::{Counts, Direction, Sniffer, Text, write_damaged, write_frame};

/// Somebody who looks at a line.
pub trait Observer {
    /// A good frame (unit id, function code, data), or what was wrong with a damaged one.
    fn hear(&self, seen: Result<&[u8], ReceiveErrors>);
}

/// Somebody who has text to be printed.
pub trait TextSource {
    /// Whether there is any. The last one to ask is woken when there is.
    fn poll_text(&self, context: &mut Context<'_>) -> Poll<()>;

    /// Puts the next characters at the beginning of `into`; returns how many, up to 254. The same ones until they
    /// are [`spoken`](Self::spoken).
    fn text(&self, into: &mut Adu) -> u8;

    /// So many are out.
    fn spoken(&self, len: u8);
}

/// What was seen on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen<'a> {
    /// A good frame: which way it goes, and unit id, function code and data.
    Frame(Direction, &'a [u8]),
    /// A damaged one.
    Damaged(ReceiveErrors),
}

/// Bytes that a record has before those of the frame: time, kind, length.
const HEAD: usize = 10;
/// Kinds of records; others are the errors of a damaged frame, above [`DAMAGED`].
const REQUEST: u8 = 0;
const ANSWER: u8 = 1;
const EXCEPTION: u8 = 2;
const DAMAGED: u8 = 0x80;

/// Records one behind the other; the first one is at the beginning.
struct Records<const N: usize> {
    bytes: [u8; N],
    len: usize,
}

/// What was seen and not taken yet, in `N` bytes: each frame takes 10 and its own; at least 264.
pub struct Capture<const N: usize> {
    records: RefCell<Records<N>>,
    sniffer: RefCell<Sniffer>,
    dropped: Cell<u32>,
    /// Characters of the first record's line that are printed.
    printed: Cell<u16>,
    came: Signal<NoopRawMutex, ()>,
}

impl<const N: usize> Capture<N> {
    /// Nothing seen. Where a frame may be an answer or a request once more, it is an answer within
    /// [200 ms](Sniffer::PATIENCE_MS).
    pub const fn new() -> Self {
        Self::within_ms(Sniffer::PATIENCE_MS)
    }

    /// The same, within so many ms of the request: no longer than the client's timeout.
    pub const fn within_ms(patience_ms: u32) -> Self {
        const {
            assert!(
                N >= HEAD + 254,
                "a capture must have room for a whole frame"
            )
        };
        Self {
            records: RefCell::new(Records {
                bytes: [0; N],
                len: 0,
            }),
            sniffer: RefCell::new(Sniffer::new(patience_ms)),
            dropped: Cell::new(0),
            printed: Cell::new(0),
            came: Signal::new(),
        }
    }

    /// What was seen, counted, whether it was dropped or not.
    pub fn counts(&self) -> Counts {
        self.sniffer.borrow().counts()
    }

    /// How many frames, damaged ones included, found no room and are in no record. Goes round.
    pub fn dropped(&self) -> u32 {
        self.dropped.get()
    }

    /// Waits for something and gives what `f` makes of it and of its time in microseconds since the start; it is gone
    /// then. For one task, and not beside a port that prints.
    ///
    /// # Cancellation
    /// Safe: nothing is taken until the future completes.
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
        let Some(place) = self.bytes[self.len..].get_mut(..HEAD + frame.len()) else {
            return false;
        };
        let (head, bytes) = place.split_at_mut(HEAD);
        head[..8].copy_from_slice(&time.to_le_bytes());
        head[8] = kind;
        head[9] = frame.len() as u8;
        bytes.copy_from_slice(frame);
        self.len += HEAD + frame.len();
        true
    }

    /// The first record, of which there is one, and its length.
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
            Some(errors) => Seen::Damaged(ReceiveErrors::from_bits(errors)),
            None => Seen::Frame(direction, &rest[..len]),
        };
        (u64::from_le_bytes(time), seen, HEAD + len)
    }

    fn take(&mut self, len: usize) {
        self.bytes.copy_within(len..self.len, 0);
        self.len -= len;
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
            if self.records.borrow().len > 0 {
                return Poll::Ready(());
            }
            if came.is_pending() {
                return Poll::Pending;
            }
        }
    }

    fn text(&self, into: &mut Adu) -> u8 {
        let records = self.records.borrow();
        if records.len == 0 {
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

    fn spoken(&self, len: u8) {
        let mut records = self.records.borrow_mut();
        if records.len == 0 {
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

/// Characters that are printed at once. A line ends with two, and no line is one longer than a number of these.
const CHUNK: usize = 254;

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
