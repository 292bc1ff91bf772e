//! Edges and levels of port D's pins for which a task can wait, as [`embedded_hal_async::digital::Wait`].
//!
//! | pin | by | detects |
//! |---|---|---|
//! | PD2, PD3 | INT0, INT1 (DS 13.1) | every edge of more than a clock cycle |
//! | PD4 to PD7 | PCINT2 (DS 13.1) | a level that lasts until the interrupt reads it: longer than 20 us |
//!
//! The pin-change flag of port D is the line's start-bit detector too (see [`usart`](crate::usart)), and an interrupt
//! clears it. So the interrupt keeps what it has detected on RXD in a byte, which the line reads. While a task waits
//! on one of PD4 to PD7, each character on the bus costs one more interrupt and takes the slower path. The line then
//! loses nothing up to 115200 baud (`cargo xtask bench` shows the limit); an answer may start, and DE fall, later by
//! the 11 us of this interrupt at 16 MHz. Without such a wait, or with INT0 and INT1 alone, nothing changes. A pulse
//! on PD4 to PD7 that ends before the interrupt reads it may be taken for the beginning of a character.
//!
//! An application must not enable PCIE2 itself: the line then misses start bits, and takes frames with permitted gaps
//! for damaged ones. The application may use the interrupts of ports B and C.
//!
//! The application binds the interrupts of its pins by [`bind_interrupts!`](crate::bind_interrupts), which defines a token, gives
//! that token and an [`Input`] to [`EdgeInput::new`], and awaits edges and levels: see the example `changes`.

mod external;
mod port_d;

use core::cell::{Cell, UnsafeCell};
use core::convert::Infallible;
use core::future::poll_fn;
use core::marker::PhantomData;
use core::task::{Poll, Waker};

use embassy_sync::waitqueue::WakerRegistration;
use embedded_hal::digital::{ErrorType, InputPin};
use embedded_hal_async::digital::Wait;

use crate::executor::EDGE;
use crate::gpio::{Input, PD2, PD3, PD4, PD5, PD6, PD7, Pin};
pub use external::{Int0, Int1};
pub use port_d::PortD;
#[cfg(feature = "modbus")]
pub(crate) use port_d::{clear_start_bit, has_waits, on_character, start_bit_seen};

/// The edges that end a wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub enum Edge {
    /// From low to high.
    Rising,
    /// From high to low.
    Falling,
    /// Rising and falling edges.
    Any,
}

/// The source of a pin's edges. Sealed: [`Int0`], [`Int1`] and [`PortD`] implement it.
pub trait Source: sealed::Sealed {
    /// Begins to wait for an edge on the pins of `mask`. With interrupts off.
    #[doc(hidden)]
    fn arm(mask: u8, edge: Edge);
    /// Ends the wait. With interrupts off.
    #[doc(hidden)]
    fn disarm(mask: u8);
    /// Whether the edge is still to come. With interrupts off.
    #[doc(hidden)]
    fn is_armed(mask: u8) -> bool;
    /// Registers the task that an edge wakes. From a task.
    #[doc(hidden)]
    fn register(mask: u8, waker: &Waker);
}

mod sealed {
    pub trait Sealed {}
}

/// Marks that the interrupt of a source is bound. [`bind_interrupts!`](crate::bind_interrupts) implements it.
///
/// # Safety
/// The handler of `S` must be in the binary.
#[diagnostic::on_unimplemented(
    message = "the interrupt of {S} is not bound: name INT0 for PD2, INT1 for PD3, PCINT2 for PD4 to PD7 in bind_interrupts!",
    label = "this pin needs an interrupt that `{Self}` does not bind"
)]
pub unsafe trait Bound<S: Source> {}

/// A pin whose edges can be waited for.
pub trait EdgePin: Pin {
    /// The source of its edges.
    type Source: Source;
}

impl EdgePin for PD2 {
    type Source = Int0;
}
impl EdgePin for PD3 {
    type Source = Int1;
}
impl EdgePin for PD4 {
    type Source = PortD;
}
impl EdgePin for PD5 {
    type Source = PortD;
}
impl EdgePin for PD6 {
    type Source = PortD;
}
impl EdgePin for PD7 {
    type Source = PortD;
}

/// A byte that interrupts and code with interrupts off share.
struct Shared(Cell<u8>);

// SAFETY: interrupts do not nest, and everybody else has them off.
unsafe impl Sync for Shared {}

impl Shared {
    const fn new() -> Self {
        Self(Cell::new(0))
    }

    #[inline(always)]
    fn get(&self) -> u8 {
        self.0.get()
    }

    #[inline(always)]
    fn set(&self, value: u8) {
        self.0.set(value);
    }
}

/// The tasks that wait: an interrupt sets a flag, and the executor's loop wakes them.
struct Waiting<const N: usize>(UnsafeCell<[WakerRegistration; N]>);

// SAFETY: tasks register and the executor's loop wakes, one after the other.
unsafe impl<const N: usize> Sync for Waiting<N> {}

impl<const N: usize> Waiting<N> {
    const fn new() -> Self {
        Self(UnsafeCell::new([const { WakerRegistration::new() }; N]))
    }

    fn register(&self, index: usize, waker: &Waker) {
        // SAFETY: see `Sync`; nothing that is called here comes back here.
        if let Some(registration) = unsafe { &mut *self.0.get() }.get_mut(index) {
            registration.register(waker);
        }
    }

    /// Wakes the tasks for whose index `is_over` returns true.
    fn wake(&self, is_over: impl Fn(usize) -> bool) {
        // SAFETY: see `Sync`; waking puts a task into the queue and runs nothing.
        let registrations = unsafe { &mut *self.0.get() }.iter_mut().enumerate();
        for (index, registration) in registrations {
            if is_over(index) {
                registration.wake();
            }
        }
    }
}

/// Wakes the tasks whose waits are over. From the executor's loop.
#[inline(always)]
pub(crate) fn wake_if(flags: u8) {
    if flags & EDGE != 0 {
        Int0::wake();
        Int1::wake();
        PortD::wake();
    }
}

/// An input whose edges and levels can be waited for.
///
/// # Cancellation
/// A dropped wait is over; an edge between two waits is not detected.
pub struct EdgeInput<P: EdgePin>(Input<P>);

impl<P: EdgePin> EdgeInput<P> {
    /// Takes an input, and the token that the interrupt of its pin is bound.
    pub fn new(input: Input<P>, _: impl Bound<P::Source>) -> Self {
        Self(input)
    }

    /// Gives the input back.
    pub fn release(self) -> Input<P> {
        self.0
    }

    /// Waits for one edge, which may have come after `armed` was made.
    async fn edge(&mut self, armed: Armed<P>) {
        poll_fn(|context| {
            P::Source::register(P::MASK, context.waker());
            match critical_section::with(|_| P::Source::is_armed(P::MASK)) {
                true => Poll::Pending,
                false => Poll::Ready(()),
            }
        })
        .await;
        drop(armed);
    }
}

/// A wait for an edge, which ends when this is dropped.
struct Armed<P: EdgePin>(PhantomData<P>);

impl<P: EdgePin> Armed<P> {
    fn new(edge: Edge) -> Self {
        critical_section::with(|_| P::Source::arm(P::MASK, edge));
        Self(PhantomData)
    }
}

impl<P: EdgePin> Drop for Armed<P> {
    fn drop(&mut self) {
        critical_section::with(|_| P::Source::disarm(P::MASK));
    }
}

impl<P: EdgePin> ErrorType for EdgeInput<P> {
    type Error = Infallible;
}

impl<P: EdgePin> InputPin for EdgeInput<P> {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        self.0.is_high()
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        self.0.is_low()
    }
}

impl<P: EdgePin> Wait for EdgeInput<P> {
    async fn wait_for_high(&mut self) -> Result<(), Infallible> {
        // The wait begins before the level is read: an edge between the two ends the wait.
        let armed = Armed::new(Edge::Rising);
        if !self.0.is_high()? {
            self.edge(armed).await;
        }
        Ok(())
    }

    async fn wait_for_low(&mut self) -> Result<(), Infallible> {
        let armed = Armed::new(Edge::Falling);
        if !self.0.is_low()? {
            self.edge(armed).await;
        }
        Ok(())
    }

    async fn wait_for_rising_edge(&mut self) -> Result<(), Infallible> {
        self.edge(Armed::new(Edge::Rising)).await;
        Ok(())
    }

    async fn wait_for_falling_edge(&mut self) -> Result<(), Infallible> {
        self.edge(Armed::new(Edge::Falling)).await;
        Ok(())
    }

    async fn wait_for_any_edge(&mut self) -> Result<(), Infallible> {
        self.edge(Armed::new(Edge::Any)).await;
        Ok(())
    }
}
