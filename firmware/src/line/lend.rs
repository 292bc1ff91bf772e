//! The buffer of a line as it is lent: who may change its bytes, and until when.
//!
//! All that is unsafe about a frame is here. A [`Frame`] and a [`Released`] are made here alone, each for one time that the
//! line has lent its buffer, and what only they may ask of a line takes a [`Key`], which only this crate has.
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

/// Shows a line that it is asked by this crate: others cannot make one.
#[derive(Clone, Copy)]
pub struct Key(());

impl Key {
    /// For this crate, which keeps the order that [`Line`] demands.
    pub(crate) const THIS_CRATE: Key = Key(());
}

/// What a line does for the frames that it lends: [`ChipLine`] does it for every chip. Frames call it, which have the [`Key`].
///
/// # Safety
/// A line has one buffer. It is lent when [`poll_received`](Lend::poll_received) gives a length or
/// [`poll_lent`](Lend::poll_lent) is ready, and neither happens again before [`give_back`](Lend::give_back). While it is lent
/// nothing is written to it, and nothing read before [`release`](Lend::release).
pub unsafe trait Lend {
    /// Lends a received frame, for [`receive`](Line::receive); ready with its length, 2..=254.
    ///
    /// # Errors
    /// As `receive`.
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

    /// The frame was dropped: the buffer is the line's again, an answer that has not started is
    /// withdrawn, one that has is cut off after the character in flight.
    fn give_back(&self, key: Key);
}

/// The buffer, lent once. Dropping it gives it back.
struct Lent<'l, L: Line> {
    line: &'l L,
    len: u8,
    _adu: PhantomData<&'l mut Adu>,
}

impl<'l, L: Line> Lent<'l, L> {
    /// # Safety
    /// The line has lent its buffer just now, and not to anybody else.
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
        // SAFETY: it is lent to this, so that nobody writes to it; the line may read it, to send it.
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
/// Its bytes may be changed until it is [released](Frame::release):
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
/// Nobody but a line lends one, and nobody but this gives it back.
pub struct Frame<'l, L: Line>(Lent<'l, L>);

impl<'l, L: Line> Frame<'l, L> {
    /// What [`Line::receive`] gives.
    #[inline(always)]
    pub(super) fn poll_received(
        line: &'l L,
        context: &mut Context<'_>,
    ) -> Poll<Result<Frame<'l, L>, ReceiveErrors>> {
        line.poll_received(context, Key(()))
            // SAFETY: a line that gives a length has lent its buffer with it.
            .map_ok(|len| Frame(unsafe { Lent::new(line, len) }))
    }

    /// What [`Line::lend`] gives.
    #[inline(always)]
    pub(super) fn poll_lent(line: &'l L, context: &mut Context<'_>) -> Poll<Frame<'l, L>> {
        line.poll_lent(context, Key(()))
            // SAFETY: as above.
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

    /// The buffer: the request in its first [`request_len`](Self::request_len) bytes, to be replaced
    /// by the answer.
    #[inline(always)]
    pub fn adu(&mut self) -> &mut Adu {
        // SAFETY: it is lent to this, and the line does not read it before it is released.
        unsafe { self.0.line.buffer(Key(())).as_mut() }
    }

    /// Hands the first `len` bytes of the buffer (2..=254, of text 1..=254) to the transmitter. It starts at t3.5 if
    /// the frame stands, at once if t3.5 has passed and nobody is talking, and not at all if the frame
    /// is void.
    #[inline(always)]
    pub fn release(self, len: u8) -> Released<'l, L> {
        self.0.line.release(len, Key(()));
        Released {
            lent: self.0,
            is_released: true,
        }
    }

    /// Waits with the frame before anything of it is sent: [`access`](Released::access) says what may be done with it.
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

/// A frame whose bytes are on the wire, or may be: it can be read and waited for. Dropping it cuts an answer off after the
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

    /// Bytes of unit id, function code and data of the frame that was heard: 2..=254, 0 in a buffer lent to send from.
    #[inline(always)]
    pub fn request_len(&self) -> u8 {
        self.lent.len
    }

    /// Unit id, function code and data of the frame that was heard; nothing of a buffer that was lent to send from.
    #[inline(always)]
    pub fn heard(&self) -> &[u8] {
        &self.lent.adu()[..usize::from(self.lent.len)]
    }

    /// What may be done with the buffer: everything as long as nothing was released.
    #[inline(always)]
    pub fn access(&mut self) -> Access<'_> {
        match self.is_released {
            true => Access::Released(self.lent.adu()),
            // SAFETY: it is lent to this, and the line does not read it before it is released.
            false => Access::Owned(unsafe { self.lent.line.buffer(Key(())).as_mut() }),
        }
    }

    /// [`Frame::release`] for a frame that was [held](Frame::hold). Nothing if `len` is 0, or something was released before.
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

    /// Waits until what was released is on the wire whole and DE is down: true. False as soon as it is
    /// known that it will not be: nothing was released, the frame is void, or somebody has begun to talk.
    ///
    /// # Cancellation
    /// Safe. Dropping this cuts the answer off after the character in flight.
    pub fn sent(&mut self) -> impl Future<Output = bool> {
        poll_fn(|context| self.lent.line.poll_sent(context, Key(())))
    }
}

/// The line of a chip: everything that its tasks do, for every [`Chip`] there is.
///
/// One task at a time waits for each of its futures; it is not to be used from an interrupt.
pub struct ChipLine<C> {
    pub(super) chip: C,
    /// Not to be used from an interrupt.
    _tasks: PhantomData<*const ()>,
}

impl<C: Chip> ChipLine<C> {
    /// Sets the line up and begins to listen; without settings it stays off until it is [configured](Line::configure).
    ///
    /// # Safety
    /// A chip keeps what [`Chip`] says of [`with`](Chip::with), [`with_waker`](Chip::with_waker) and [`buffer`](Chip::buffer); it
    /// writes to the buffer where the machine has it store a character, and nowhere else. There is one line of it.
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

    /// What the machine has to tell the task that works with a frame, or waits to send.
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

// Not inlined: one copy of each serves every await of the tasks.
//
// SAFETY: the machine, which is always the same one, lends the one buffer once until `give_back`. It has nothing stored meanwhile,
// and only the transmitter reads, after `release`. That the chip keeps to it was demanded when the line was made.
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

// SAFETY: it gives a pointer and no reference: who may use it is the business of those that do.
unsafe impl Sync for LineBuffer {}

impl LineBuffer {
    /// A buffer of zeros.
    pub const fn new() -> Self {
        Self(UnsafeCell::new([0; size_of::<Adu>()]))
    }

    /// Where it is.
    pub const fn pointer(&self) -> NonNull<Adu> {
        // SAFETY: a static is somewhere.
        unsafe { NonNull::new_unchecked(self.0.get()) }
    }
}

impl Default for LineBuffer {
    fn default() -> Self {
        Self::new()
    }
}
