//! The queue for the line: one request at a time, in the order of the requests. A request that must wait for a late
//! answer gives up its turn and is parked: it takes a new place in the queue, and those behind it go first as long as
//! it is parked.

use core::cell::RefCell;
use core::future::{Future, poll_fn};
use core::task::{Context, Poll, Waker};

use super::ClientError;
use super::time::poll_over;

/// The state of a place in the queue.
#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    Free,
    /// A task waits for the line.
    Waits,
    /// A task waits for the line, and those behind it go first.
    Parked,
}

struct Place {
    state: State,
    /// Lower for an earlier request, compared modulo 256.
    ticket: u8,
    waker: Option<Waker>,
}

impl Place {
    #[inline(never)]
    fn wake(&mut self) {
        if let Some(waker) = self.waker.take() {
            waker.wake();
        }
    }
}

/// Why a task waits.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum How {
    /// To send a request.
    Asked,
    /// To send a request, but not before some time or the next answer.
    Parked,
    /// To keep all requests from the line.
    Held,
    /// To be refused.
    Refused,
}

/// A task that waits for the line, or has it.
pub(super) struct Wait {
    /// The time at which a parked request may be sent.
    pub until: u32,
    pub how: How,
    /// Whether the task tries again if the queue is full.
    pub is_patient: bool,
    /// The place plus one; 0 for none.
    place: u8,
}

impl Wait {
    pub const fn new(how: How, until: u32) -> Self {
        Self {
            until,
            how,
            is_patient: matches!(how, How::Held),
            place: 0,
        }
    }
}

/// The line and those that wait for it. Used as a slice, so that the code exists once for all `N`.
struct Queue<P: ?Sized> {
    /// Whether a task has the line.
    is_taken: bool,
    /// Whether requests are refused.
    is_closed: bool,
    /// The last ticket that was given out.
    last: u8,
    places: P,
}

impl Queue<[Place]> {
    /// The place whose turn is next; 255 if no task waits.
    #[inline(never)]
    fn first(&self) -> u8 {
        let (mut first, mut longest, mut number) = (u8::MAX, 0, 0);
        for place in &self.places {
            let waits = self.last.wrapping_sub(place.ticket);
            if place.state == State::Waits && (first == u8::MAX || waits > longest) {
                (first, longest) = (number, waits);
            }
            number += 1;
        }
        first
    }

    /// Whether the line is free, and the turn is that of place `number`.
    fn is_for(&self, number: u8) -> bool {
        !self.is_taken && self.first() == number
    }

    fn enter(&mut self, how: How) -> Option<u8> {
        let mut number = 0;
        for place in &mut self.places {
            number += 1;
            if place.state == State::Free {
                self.last = self.last.wrapping_add(1);
                place.ticket = self.last;
                place.state = match how {
                    How::Parked => State::Parked,
                    _ => State::Waits,
                };
                return Some(number);
            }
        }
        None
    }

    /// Gives up the place of `wait`, and the line if it `was_taken`. The next task is woken.
    #[inline(never)]
    fn leave(&mut self, wait: &mut Wait, was_taken: bool) {
        self.is_taken &= !was_taken;
        self.free(wait);
        self.go_on();
    }

    fn give_back(&mut self) {
        self.is_taken = false;
        self.go_on();
    }

    #[inline(never)]
    fn go_on(&mut self) {
        if !self.is_taken
            && let Some(place) = self.places.get_mut(usize::from(self.first()))
        {
            place.wake();
        }
    }

    fn free(&mut self, wait: &mut Wait) {
        if let Some(place) = self.places.get_mut(usize::from(wait.place).wrapping_sub(1)) {
            place.state = State::Free;
        }
        wait.place = 0;
    }

    fn unpark(&mut self) {
        for place in &mut self.places {
            if place.state == State::Parked {
                place.state = State::Waits;
            }
            place.wake();
        }
    }

    /// Ready when the task has the line.
    #[inline(never)]
    fn poll(
        &mut self,
        wait: &mut Wait,
        context: &mut Context<'_>,
    ) -> Poll<Result<(), ClientError>> {
        if self.is_closed && wait.how != How::Held {
            if wait.place != 0 || wait.how == How::Refused {
                return Poll::Ready(Err(ClientError::NotMaster));
            }
            // A task that tries again and again lets others run.
            wait.how = How::Refused;
            context.waker().wake_by_ref();
            return Poll::Pending;
        }
        if wait.place == 0 && !(wait.how != How::Parked && self.is_for(u8::MAX)) {
            match self.enter(wait.how) {
                Some(place) => wait.place = place,
                None if !wait.is_patient => return Poll::Ready(Err(ClientError::QueueFull)),
                None => {
                    context.waker().wake_by_ref();
                    return Poll::Pending;
                }
            }
        }
        if let Some(place) = self.places.get_mut(usize::from(wait.place).wrapping_sub(1)) {
            if place.state == State::Parked && poll_over(wait.until, context).is_ready() {
                place.state = State::Waits;
            }
            place.waker = Some(context.waker().clone());
            if !self.is_for(wait.place - 1) {
                return Poll::Pending;
            }
            self.free(wait);
        }
        self.is_taken = true;
        Poll::Ready(Ok(()))
    }
}

/// The queue of one line, with `N` places.
pub(super) struct Turns<const N: usize>(RefCell<Queue<[Place; N]>>);

impl<const N: usize> Turns<N> {
    pub const fn new() -> Self {
        const { assert!(N >= 1 && N < 255, "N must be 1..=254") };
        Self(RefCell::new(Queue {
            is_taken: false,
            is_closed: false,
            last: 0,
            places: [const {
                Place {
                    state: State::Free,
                    ticket: 0,
                    waker: None,
                }
            }; N],
        }))
    }

    fn with<R>(&self, look: impl FnOnce(&mut Queue<[Place]>) -> R) -> R {
        look(&mut *self.0.borrow_mut())
    }

    /// Whether a task has the line or waits for it.
    pub fn is_busy(&self) -> bool {
        self.with(|queue| !queue.is_for(u8::MAX))
    }

    /// Waits for the line, behind earlier requests. A task that waits, or has the line, must [leave](Self::leave).
    ///
    /// # Errors
    /// [`ClientError::QueueFull`], [`ClientError::NotMaster`]; none for a task that [holds](How::Held) the line.
    #[inline(never)]
    pub fn poll(
        &self,
        wait: &mut Wait,
        context: &mut Context<'_>,
    ) -> Poll<Result<(), ClientError>> {
        self.with(|queue| queue.poll(wait, context))
    }

    /// Gives up the place of `wait`, and the line if it `was_taken`.
    #[inline(never)]
    pub fn leave(&self, wait: &mut Wait, was_taken: bool) {
        self.with(|queue| queue.leave(wait, was_taken));
    }

    /// Gives up the line.
    #[inline(never)]
    fn give_back(&self) {
        self.with(|queue| queue.give_back());
    }

    /// Waits for the line as [`poll`](Self::poll) does, as a future.
    pub fn turn(&'static self, wait: Wait) -> impl Future<Output = Result<Turn<N>, ClientError>> {
        let mut waiting = Waiting { turns: self, wait };
        poll_fn(move |context| {
            let polled = self.poll(&mut waiting.wait, context);
            polled.map_ok(|()| Turn(self))
        })
    }

    /// Ends the wait of all parked requests.
    #[inline(never)]
    pub fn unpark(&self) {
        self.with(|queue| queue.unpark());
    }

    /// Refuses all requests from now on, including those that wait.
    pub fn close(&self) {
        self.with(|queue| queue.is_closed = true);
        self.unpark();
    }

    /// Accepts requests again.
    pub fn open(&self) {
        self.with(|queue| queue.is_closed = false);
    }
}

/// Leaves the queue when it is dropped.
struct Waiting<const N: usize> {
    turns: &'static Turns<N>,
    wait: Wait,
}

impl<const N: usize> Drop for Waiting<N> {
    fn drop(&mut self) {
        self.turns.leave(&mut self.wait, false);
    }
}

/// The right to the line, which one request has at a time.
pub(crate) struct Turn<const N: usize>(&'static Turns<N>);

impl<const N: usize> Turn<N> {
    /// The turn of a task that has the line and has not given it back.
    pub(super) fn taken(turns: &'static Turns<N>) -> Self {
        Self(turns)
    }

    /// Keeps the line for the holder, who gives it back.
    pub(super) fn keep(self) {
        core::mem::forget(self);
    }
}

impl<const N: usize> Drop for Turn<N> {
    fn drop(&mut self) {
        self.0.give_back();
    }
}
