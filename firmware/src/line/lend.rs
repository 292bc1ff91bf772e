//! The buffer of a line and its loan to a frame: which code may change the bytes, and until when.
//!
//! All unsafe code for frames is here. Only this module makes a [`Frame`] or a [`Released`], one each time that the line lends its
//! buffer. The methods of a line that only frames may call take a [`Key`], which only this crate has.
#![allow(unsafe_code)]

use core::cell::UnsafeCell;
use core::future::{Future, poll_fn};
use core::marker::PhantomData;
use core::ptr::NonNull;
use core::task::{Context, Poll};

use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::line::{Chip, LineMachine, Waiting};
use multidrop_protocol::server::Access;

use super::{Adu, Line};

/// The proof that this crate calls a line: other crates cannot make a key.
#[derive(Clone, Copy)]
pub struct Key(());

impl Key {
    /// The key of this crate, which keeps the order that [`Line`] demands.
    pub(crate) const THIS_CRATE: Key = Key(());
}

/// The methods of a line for the frames that it lends, which call them with a [`Key`]. [`ChipLine`] has them for every chip.
///
/// # Safety
/// A line has one buffer. The buffer is lent when [`poll_received`](Lend::poll_received) gives a length or
/// [`poll_lent`](Lend::poll_lent) is ready, and neither happens again before [`give_back`](Lend::give_back). While the buffer is
/// lent nothing is written to it, and nothing is read from it before [`release`](Lend::release).
pub unsafe trait Lend {
    /// Lends a received frame, for [`receive`](Line::receive); ready with its length, 2..=254.
    ///
    /// # Errors
    /// The errors that [`receive`](Line::receive) gives.
    fn poll_received(&self, context: &mut Context<'_>, key: Key)
    -> Poll<Result<u8, ReceiveErrors>>;

    /// Lends the buffer, for [`lend`](Line::lend).
    fn poll_lent(&self, context: &mut Context<'_>, key: Key) -> Poll<()>;

    /// The buffer of the line.
    fn buffer(&self, key: Key) -> NonNull<Adu>;

    /// Releases the frame, for [`Frame::release`].
    fn release(&self, len: u8, key: Key);

    /// Waits until the frame stands or is void, for [`Frame::settle`].
    fn poll_settled(&self, context: &mut Context<'_>, key: Key) -> Poll<bool>;

    /// Waits for the end of the transmission, for [`Released::sent`].
    fn poll_sent(&self, context: &mut Context<'_>, key: Key) -> Poll<bool>;

    /// Takes the buffer back from a frame that was dropped. An answer that has not started is withdrawn. An answer that has started
    /// is cut off after the character in flight.
    fn give_back(&self, key: Key);
}

/// One loan of the buffer. Dropping it gives the buffer back.
struct Lent<'l, L: Line> {
    line: &'l L,
    len: u8,
    _adu: PhantomData<&'l mut Adu>,
}

impl<'l, L: Line> Lent<'l, L> {
    /// # Safety
    /// The line has lent its buffer just now, and to nothing else.
    #[inline(always)]
    unsafe fn new(line: &'l L, len: u8) -> Self {
        Self {
            line,
            len,
            _adu: PhantomData,
        }
    }

    #[inline(always)]
    fn adu(&self) -> &Adu {
        // SAFETY: the buffer is lent to this value, so nothing writes to it; the line may read it, to send it.
        unsafe { self.line.buffer(Key(())).as_ref() }
    }
}

impl<L: Line> Drop for Lent<'_, L> {
    fn drop(&mut self) {
        self.line.give_back(Key(()));
    }
}

/// A frame lent by its line. Dropping it gives the buffer back.
///
/// The bytes of a frame may be changed until the frame is [released](Frame::release):
///
/// ```compile_fail,E0382
/// use multidrop::{Frame, Line};
///
/// async fn answer<L: Line>(mut frame: Frame<'_, L>) {
///     let mut answer = frame.release(5);
///     frame.adu()[2] = 0; // It may be on the wire already.
///     answer.sent().await;
/// }
/// ```
///
/// Only a line lends a frame, and only a dropped frame gives the buffer back.
pub struct Frame<'l, L: Line>(Lent<'l, L>);

impl<'l, L: Line> Frame<'l, L> {
    /// Polls for the frame that [`Line::receive`] gives.
    #[inline(always)]
    pub(super) fn poll_received(
        line: &'l L,
        context: &mut Context<'_>,
    ) -> Poll<Result<Frame<'l, L>, ReceiveErrors>> {
        line.poll_received(context, Key(()))
            // SAFETY: a line that gives a length has lent its buffer with it.
            .map_ok(|len| Frame(unsafe { Lent::new(line, len) }))
    }

    /// Polls for the buffer that [`Line::lend`] gives.
    #[inline(always)]
    pub(super) fn poll_lent(line: &'l L, context: &mut Context<'_>) -> Poll<Frame<'l, L>> {
        line.poll_lent(context, Key(()))
            // SAFETY: a line that is ready here has lent its buffer with it.
            .map(|()| Frame(unsafe { Lent::new(line, 0) }))
    }

    /// Number of bytes of unit id, function code and data: 2..=254, 0 in a buffer lent to send from.
    pub fn request_len(&self) -> u8 {
        self.0.len
    }

    /// The unit id that the frame is addressed to.
    pub fn unit(&self) -> u8 {
        self.0.adu()[0]
    }

    /// The buffer, to read.
    pub fn bytes(&self) -> &Adu {
        self.0.adu()
    }

    /// The buffer with the request in its first [`request_len`](Self::request_len) bytes. The answer replaces the
    /// request.
    #[inline(always)]
    pub fn adu(&mut self) -> &mut Adu {
        // SAFETY: the buffer is lent to this frame, and the line does not read it before it is released.
        unsafe { self.0.line.buffer(Key(())).as_mut() }
    }

    /// Hands the first `len` bytes of the buffer (2..=254, of text 1..=254) to the transmitter. They start at
    /// t3.5 if the frame stands, at once if t3.5 has passed and no node sends, and not at all if the frame is
    /// void.
    #[inline(always)]
    pub fn release(self, len: u8) -> Released<'l, L> {
        self.0.line.release(len, Key(()));
        Released {
            lent: self.0,
            is_released: true,
        }
    }

    /// Keeps the frame before any of its bytes are sent. [`access`](Released::access) tells how they may be used.
    #[inline(always)]
    pub fn hold(self) -> Released<'l, L> {
        Released {
            lent: self.0,
            is_released: false,
        }
    }

    /// Waits for t3.5: true if the frame stands, false as soon as a late character has voided it.
    ///
    /// # Cancellation
    /// Safe: the verdict stays with the line.
    pub fn settle(&mut self) -> impl Future<Output = bool> {
        poll_fn(|context| self.0.line.poll_settled(context, Key(())))
    }
}

/// A frame whose bytes are, or may be, on the wire: it can be read and waited for. Dropping it cuts the answer off after the
/// character in flight, and gives the buffer back.
#[must_use = "what is dropped is not sent"]
pub struct Released<'l, L: Line> {
    lent: Lent<'l, L>,
    is_released: bool,
}

impl<'l, L: Line> Released<'l, L> {
    /// The buffer, to read.
    pub fn bytes(&self) -> &Adu {
        self.lent.adu()
    }

    /// Number of bytes of unit id, function code and data of the frame that was heard: 2..=254, 0 in a buffer lent to send from.
    #[inline(always)]
    pub fn request_len(&self) -> u8 {
        self.lent.len
    }

    /// Unit id, function code and data of the frame that was heard. Empty for a buffer lent to send from.
    #[inline(always)]
    pub fn heard(&self) -> &[u8] {
        &self.lent.adu()[..usize::from(self.lent.len)]
    }

    /// The permitted access to the buffer: any access as long as no bytes were released.
    #[inline(always)]
    pub fn access(&mut self) -> Access<'_> {
        match self.is_released {
            true => Access::Released(self.lent.adu()),
            // SAFETY: the buffer is lent to this value, and the line does not read it before it is released.
            false => Access::Owned(unsafe { self.lent.line.buffer(Key(())).as_mut() }),
        }
    }

    /// Releases a frame that was [held](Frame::hold). Does nothing if `len` is 0, or bytes were released before.
    #[inline(always)]
    pub fn release(&mut self, len: u8) {
        if len > 0 && !self.is_released {
            self.is_released = true;
            self.lent.line.release(len, Key(()));
        }
    }

    /// Waits for t3.5: true if the frame stands, false as soon as a late character has voided it.
    ///
    /// # Cancellation
    /// Safe: the verdict stays with the line.
    pub fn settle(&mut self) -> impl Future<Output = bool> {
        poll_fn(|context| self.lent.line.poll_settled(context, Key(())))
    }

    /// Waits until all released bytes are on the wire and DE is down: true. False as soon as this cannot happen any more: nothing
    /// was released, the frame is void, or another node has begun to send.
    ///
    /// # Cancellation
    /// Safe. Dropping this cuts the answer off after the character in flight.
    pub fn sent(&mut self) -> impl Future<Output = bool> {
        poll_fn(|context| self.lent.line.poll_sent(context, Key(())))
    }
}

/// The line of a chip: all operations of its tasks, for every [`Chip`].
///
/// One task at a time waits for each of its futures. The line is not to be used from an interrupt.
pub struct ChipLine<C> {
    pub(super) chip: C,
    /// Makes the line neither `Send` nor `Sync`: it is not to be used from an interrupt.
    _tasks: PhantomData<*const ()>,
}

impl<C: Chip> ChipLine<C> {
    /// Sets the line up and begins to listen; without settings it stays off until it is [configured](Line::configure).
    ///
    /// # Safety
    /// The chip keeps the rules of [`with`](Chip::with), [`with_waker`](Chip::with_waker) and [`buffer`](Chip::buffer). It writes
    /// to the buffer only where the machine has it store a character. The chip has one line.
    #[inline(always)]
    pub unsafe fn new(chip: C, settings: Option<&C::Settings>) -> Self {
        if let Some(settings) = settings {
            chip.with(|machine, wire| {
                chip.set_up(wire, settings);
                machine.reset(wire);
            });
        }
        Self {
            chip,
            _tasks: PhantomData,
        }
    }

    pub(super) fn poll_quiet(&self, context: &Context<'_>) -> Poll<ReceiveErrors> {
        self.poll(context, |machine, wire| machine.quiet(wire))
    }

    /// Asks the machine for a result. The caller is the task that works with a frame, or waits to send.
    #[inline(always)]
    fn poll<R>(
        &self,
        context: &Context<'_>,
        look: impl FnOnce(&mut LineMachine, &mut C::Wire) -> Option<R>,
    ) -> Poll<R> {
        match self
            .chip
            .with_waker(Waiting::WithFrame, context.waker(), look)
        {
            Some(told) => Poll::Ready(told),
            None => Poll::Pending,
        }
    }
}

// Not inlined: one copy of each method serves every await of the tasks.
//
// SAFETY: the machine, which is always the same one, lends the one buffer once until `give_back`. It stores nothing meanwhile, and
// only the transmitter reads the buffer, after `release`. `ChipLine::new` demands that the chip keeps to this.
unsafe impl<C: Chip> Lend for ChipLine<C> {
    fn poll_received(&self, context: &mut Context<'_>, _: Key) -> Poll<Result<u8, ReceiveErrors>> {
        let waker = context.waker();
        match self
            .chip
            .with_waker(Waiting::ForFrame, waker, |machine, _| machine.fetch())
        {
            Some(heard) => Poll::Ready(heard),
            None => Poll::Pending,
        }
    }

    #[inline(always)]
    fn poll_lent(&self, context: &mut Context<'_>, _: Key) -> Poll<()> {
        self.poll(context, |machine, _| machine.take_buffer().then_some(()))
    }

    #[inline(always)]
    fn buffer(&self, _: Key) -> NonNull<Adu> {
        self.chip.buffer()
    }

    fn release(&self, len: u8, _: Key) {
        self.chip.with(|machine, wire| machine.release(wire, len));
    }

    fn poll_settled(&self, context: &mut Context<'_>, _: Key) -> Poll<bool> {
        self.poll(context, |machine, _| machine.verdict())
    }

    fn poll_sent(&self, context: &mut Context<'_>, _: Key) -> Poll<bool> {
        self.poll(context, |machine, _| machine.sent())
    }

    fn give_back(&self, _: Key) {
        self.chip.with(|machine, wire| machine.give_back(wire));
    }
}

/// A buffer for [`Chip::buffer`], as a static: all zero, so that it takes no flash.
pub struct LineBuffer(UnsafeCell<Adu>);

// SAFETY: the cell gives a pointer and no reference: the code that uses the pointer keeps the rules of its use.
unsafe impl Sync for LineBuffer {}

impl LineBuffer {
    /// A buffer of zeros.
    pub const fn new() -> Self {
        Self(UnsafeCell::new([0; size_of::<Adu>()]))
    }

    /// The address of the buffer.
    pub const fn pointer(&self) -> NonNull<Adu> {
        // SAFETY: a reference is never null.
        unsafe { NonNull::new_unchecked(self.0.get()) }
    }
}

impl Default for LineBuffer {
    fn default() -> Self {
        Self::new()
    }
}
