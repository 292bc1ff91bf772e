//! USART0 as a [`Line`]: frames out of silence, answers at t3.5, DE.
//!
//! The receive interrupt stores byte and CRC and sets Timer1's compare B to the end of the silence
//! that would complete the frame; no task is woken per byte. Compare B completes the frame at t1.5,
//! judges it when 23/24 of t3.5 are over, and at t3.5 starts an answer that is ready by then from within
//! the interrupt.
//!
//! RXC comes at the end of a character, so by itself it tells only a whole character late that one
//! began within t1.5. The pin-change flag of RXD is used as a start-bit detector: polled when compare B
//! matches, never as an interrupt, but while a task waits for an edge on port D by [`edge`](crate::edge). PCIE2 enabled
//! otherwise is not supported: start bits are no longer seen then.
//!
//! ASCII is there where the type asks for it ([`RtuAndAscii`]): characters begin and end a frame, each is
//! decided in Rust, and compare B counts the second between them in parts of 25 ms, since Timer1 has 16
//! bits.
//!
//! DE_LEAD and RESPONSE_DELAY are there where the type asks for them ([`Delayed`]): a delay beyond the timer's 16 bits is
//! counted in parts.
//!
//! Silences of more than 65535 ticks, of slow lines and of gaps that end a frame, are counted in parts where the type asks
//! for it ([`Slow`]); a line without pays nothing.
//!
//! An application may keep interrupts off for the time of two characters. What is longer may lose one: its frame is dropped and told
//! as an overrun. An answer that would have begun meanwhile begins behind it.
//!
//! Its interrupts wake tasks through [`executor::run`](crate::executor::run), which has to be the one that
//! runs them. They are bound by `USART0` in [`bind_interrupts!`](crate::bind_interrupts).

mod character;
mod registers;
mod settings;
mod state;

use core::future::{Future, poll_fn};
use core::marker::PhantomData;
use core::ptr::NonNull;
use core::task::{Context, Poll};

use multidrop::line::{Adu, Key, Lend, Line, LineConfig, LineError};
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::port_registers::Duplex;

use crate::executor;
use crate::gpio::{DriverEnable, PD0, PD1, hold_rxd_high};
use crate::pac::{TC1, USART0};
use crate::timer1;
pub(crate) use character::set_attention;
pub use settings::{Delayed, Delaying, Delays, Framings, RtuAndAscii, RtuOnly, Settings, Slow};
use state::{SHARED, State};

/// With interrupts off.
#[inline(always)]
fn with<R>(f: impl FnOnce(&mut State) -> R) -> R {
    critical_section::with(|_| {
        // SAFETY: interrupts are off and `with` is never called from within `f`.
        f(unsafe { &mut *SHARED.get() })
    })
}

/// Says that the interrupts of USART0 are bound to the line `L`. [`bind_interrupts!`](crate::bind_interrupts) implements it.
///
/// # Safety
/// The handlers of `L` have to be in the binary.
#[diagnostic::on_unimplemented(
    message = "the interrupts of USART0 are not bound to this type of line: name it in bind_interrupts!, `USART0 => TYPE;`",
    label = "`{Self}` does not bind them to `{L}`"
)]
pub unsafe trait Bound<L> {}

/// USART0 on RXD and TXD, with a DE pin (or [`NoDe`](crate::gpio::NoDe)), at a CPU clock of `CLOCK_HZ`, for
/// the framings `F`: [`RtuOnly`] if not said otherwise, or [`RtuAndAscii`].
pub struct Usart0<DE, const CLOCK_HZ: u32, F = RtuOnly> {
    _types: PhantomData<*const (DE, F)>,
}

impl<DE: DriverEnable, const CLOCK_HZ: u32, F: Framings> Usart0<DE, CLOCK_HZ, F> {
    /// Sets the line up: DE low, then receiver and transmitter on. The bus is not driven. It listens
    /// once interrupts are enabled and the bus was silent for t3.5.
    ///
    /// The peripherals are taken so that nobody else has them, the token so that the interrupts are bound to this type.
    pub fn new(
        _: USART0,
        _: &TC1,
        _: PD0,
        _: PD1,
        _: DE,
        _: impl Bound<Self>,
        settings: Settings<F>,
    ) -> Self {
        timer1::start();
        DE::init();
        // The output of the transceiver's receiver floats while DE is up. The pull-up stays the port's with RXEN on (DS 14.3.3,
        // RXD).
        hold_rxd_high();
        with(|state| state.apply::<DE, F>(&settings));
        Self {
            _types: PhantomData,
        }
    }

    /// For [`bind_interrupts!`](crate::bind_interrupts).
    ///
    /// # Safety
    /// From the interrupt of this name only.
    #[doc(hidden)]
    #[inline(always)]
    pub unsafe fn on_character() {
        // SAFETY: demanded of the caller.
        unsafe { character::on_character::<DE, F>() }
    }

    /// For [`bind_interrupts!`](crate::bind_interrupts).
    ///
    /// # Safety
    /// From the interrupt of this name only.
    #[doc(hidden)]
    #[inline(always)]
    pub unsafe fn on_silence() {
        // SAFETY: in an interrupt, see `Shared`.
        unsafe { &mut *SHARED.get() }.on_alarm::<DE, F>();
    }

    /// For [`bind_interrupts!`](crate::bind_interrupts).
    ///
    /// # Safety
    /// From the interrupt of this name only.
    #[doc(hidden)]
    #[inline(always)]
    pub unsafe fn on_ready() {
        // SAFETY: in an interrupt, see `Shared`.
        let (machine, mut wire) = unsafe { &mut *SHARED.get() }.parts::<DE, F>();
        machine.on_ready(&mut wire);
    }

    /// For [`bind_interrupts!`](crate::bind_interrupts).
    ///
    /// # Safety
    /// From the interrupt of this name only.
    #[doc(hidden)]
    #[inline(always)]
    pub unsafe fn on_sent() {
        // SAFETY: in an interrupt, see `Shared`.
        let (machine, mut wire) = unsafe { &mut *SHARED.get() }.parts::<DE, F>();
        machine.on_sent(&mut wire);
    }

    /// For [`bind_interrupts!`](crate::bind_interrupts).
    #[doc(hidden)]
    #[cfg(not(feature = "bare"))]
    #[inline(always)]
    pub fn abort() -> ! {
        crate::fault::abort::<DE>()
    }

    /// The CPU clock, for who binds the watchdog.
    #[doc(hidden)]
    pub const CLOCK_HZ: u32 = CLOCK_HZ;

    /// Half of the watchdog's time is over: whether no frame is lent for too long. For who binds the watchdog.
    #[doc(hidden)]
    #[inline(always)]
    pub fn half_is_over(half: u16) -> bool {
        #[cfg(not(feature = "bare"))]
        {
            let (is_lent, longest) = with(|state| (state.machine.is_lent(), state.longest::<F>()));
            crate::watchdog::half_is_over(half, is_lent, longest)
        }
        #[cfg(feature = "bare")]
        {
            let _ = half;
            true
        }
    }
}

// Not inlined: one copy of each serves every await of the tasks. The waker is registered first: what comes
// between that and the look at the machine wakes.
#[inline(never)]
fn poll_settle(context: &Context) -> Poll<bool> {
    executor::USER.register(context.waker());
    match with(|state| state.machine.verdict()) {
        Some(stands) => Poll::Ready(stands),
        None => Poll::Pending,
    }
}

#[inline(never)]
fn poll_sent(context: &Context) -> Poll<bool> {
    executor::USER.register(context.waker());
    match with(|state| state.machine.sent()) {
        Some(whole) => Poll::Ready(whole),
        None => Poll::Pending,
    }
}

#[inline(never)]
fn poll_quiet<DE: DriverEnable, F: Framings>(context: &Context) -> Poll<ReceiveErrors> {
    executor::USER.register(context.waker());
    let quiet = with(|state| {
        let (machine, mut wire) = state.parts::<DE, F>();
        machine.quiet(&mut wire)
    });
    match quiet {
        Some(errors) => Poll::Ready(errors),
        None => Poll::Pending,
    }
}

#[inline(never)]
fn poll_heard(context: &Context) -> Poll<Result<u8, ReceiveErrors>> {
    executor::RECEIVER.register(context.waker());
    match with(|state| state.machine.fetch()) {
        Some(heard) => Poll::Ready(heard),
        None => Poll::Pending,
    }
}

#[inline(never)]
fn give_back<DE: DriverEnable, F: Framings>() {
    with(|state| {
        let (machine, mut wire) = state.parts::<DE, F>();
        machine.give_back(&mut wire);
        #[cfg(not(feature = "bare"))]
        crate::watchdog::frame_is_back();
    });
}

#[inline(never)]
fn release<DE: DriverEnable, F: Framings>(len: u8) {
    with(|state| {
        let (machine, mut wire) = state.parts::<DE, F>();
        machine.release(&mut wire, len);
    });
}

// SAFETY: the machine lends the one buffer once until `give_back`, and keeps interrupts from it meanwhile; only `on_ready`
// reads it, after `release`.
unsafe impl<DE: DriverEnable, const CLOCK_HZ: u32, F: Framings> Lend for Usart0<DE, CLOCK_HZ, F> {
    fn poll_received(&self, context: &mut Context<'_>, _: Key) -> Poll<Result<u8, ReceiveErrors>> {
        poll_heard(context)
    }

    fn poll_lent(&self, context: &mut Context<'_>, _: Key) -> Poll<()> {
        executor::USER.register(context.waker());
        match with(|state| state.machine.take_buffer()) {
            true => Poll::Ready(()),
            false => Poll::Pending,
        }
    }

    fn buffer(&self, _: Key) -> NonNull<Adu> {
        state::ADU.buffer()
    }

    fn release(&self, len: u8, _: Key) {
        release::<DE, F>(len);
    }

    fn poll_settled(&self, context: &mut Context<'_>, _: Key) -> Poll<bool> {
        poll_settle(context)
    }

    fn poll_sent(&self, context: &mut Context<'_>, _: Key) -> Poll<bool> {
        poll_sent(context)
    }

    fn give_back(&self, _: Key) {
        give_back::<DE, F>();
    }
}

impl<DE: DriverEnable, const CLOCK_HZ: u32, F: Framings> Line for Usart0<DE, CLOCK_HZ, F> {
    fn may_be(&self, duplex: Duplex) -> bool {
        !DE::IS_ONE_PAIR || duplex == Duplex::Half
    }

    fn quiet(&self) -> impl Future<Output = ReceiveErrors> {
        poll_fn(|context| poll_quiet::<DE, F>(context))
    }

    fn check(&self, config: &LineConfig) -> Result<(), LineError> {
        Settings::<F>::new(config, CLOCK_HZ).map(drop)
    }

    async fn configure(&self, config: LineConfig) -> Result<(), LineError> {
        let settings = Settings::<F>::new(&config, CLOCK_HZ)?;
        poll_fn(|context| {
            executor::USER.register(context.waker());
            with(|state| {
                if state.machine.is_sending() {
                    return Poll::Pending;
                }
                state.apply::<DE, F>(&settings);
                Poll::Ready(Ok(()))
            })
        })
        .await
    }

    fn set_delimiter(&self, delimiter: u8) {
        if F::ASCII {
            critical_section::with(|_| state::set_delimiter(delimiter));
        }
    }

    fn was_cut(&self) -> bool {
        with(|state| state.machine.was_cut())
    }
}
