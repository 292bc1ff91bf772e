//! USART0 as the [`Chip`] of a line: frames out of silence, answers at t3.5, DE. `multidrop::line::ChipLine` makes a line of it.
//!
//! The receive interrupt stores byte and CRC and sets compare B of Timer1 to the end of the silence that
//! would complete the frame; no task is woken per byte. Compare B completes the frame at t1.5 and judges it
//! when 23/24 of t3.5 are over. At t3.5 it starts an answer that is ready by then, from within the
//! interrupt.
//!
//! RXC comes at the end of a character, so by itself it shows only a whole character late that the character began within t1.5. The
//! pin-change flag of RXD serves as a start-bit detector. It is polled when compare B matches; it interrupts only while a task
//! waits for an edge on port D by [`edge`](crate::edge). PCIE2 enabled otherwise is not supported: start bits are no longer seen
//! then.
//!
//! A line has ASCII if its type asks for it ([`RtuAndAscii`]). Characters then begin and end a frame, and Rust code
//! handles each character. Compare B counts the second between two characters in parts of 25 ms, since Timer1 has 16
//! bits.
//!
//! A line has DE_LEAD and RESPONSE_DELAY if its type asks for them ([`Delayed`]). A delay beyond the timer's 16 bits is counted in
//! parts.
//!
//! Silences of more than 65535 ticks, on slow lines and for gaps that end a frame, are counted in parts if the type asks for it
//! ([`Slow`]). A line without [`Slow`] pays nothing.
//!
//! An application may keep interrupts off for the time of two characters. A longer time may lose a character: its frame is dropped
//! and reported as an overrun. An answer that was due meanwhile begins after that time.
//!
//! The interrupts wake tasks through [`executor::run`](crate::executor::run), which must run the tasks of the line.
//! [`bind_interrupts!`](crate::bind_interrupts) binds the interrupts by `USART0`.

mod character;
mod parts;
mod registers;
mod settings;
mod state;

use core::marker::PhantomData;
use core::ptr::NonNull;
use core::task::Waker;

use multidrop_protocol::Adu;
use multidrop_protocol::line::{Chip, LineConfig, LineError, LineMachine, Waiting};
use multidrop_protocol::port_registers::Duplex;

use crate::executor;
use crate::gpio::{DriverEnable, PD0, PD1, hold_rxd_high};
use crate::pac::{TC1, USART0};
use crate::timer1;
pub(crate) use character::set_attention;
pub use settings::{Delayed, Delaying, Delays, Framings, RtuAndAscii, RtuOnly, Settings, Slow};
use state::{Driven, SHARED, State};

/// Calls `f` with the state of the USART, with interrupts off.
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

/// USART0 on RXD and TXD, with a DE pin (or [`NoDe`](crate::gpio::NoDe)), at a CPU clock of `CLOCK_HZ`, for the framings `F`:
/// [`RtuOnly`] by default, or [`RtuAndAscii`].
pub struct Usart0<DE, const CLOCK_HZ: u32, F = RtuOnly> {
    _types: PhantomData<*const (DE, F)>,
}

impl<DE: DriverEnable, const CLOCK_HZ: u32, F: Framings> Usart0<DE, CLOCK_HZ, F> {
    /// Takes the USART with DE low: the bus is not driven. Receiver and transmitter stay off until the line is set up.
    ///
    /// The peripherals are taken so that no other code has them. The token proves that the interrupts are bound to this type.
    pub fn new(_: USART0, _: &TC1, _: PD0, _: PD1, _: DE, _: impl Bound<Self>) -> Self {
        timer1::start();
        DE::init();
        // The output of the transceiver's receiver floats while DE is up. With RXEN on, the port still controls the pull-up (DS
        // 14.3.3, RXD).
        hold_rxd_high();
        Self {
            _types: PhantomData,
        }
    }

    /// The interrupt handler, called by [`bind_interrupts!`](crate::bind_interrupts).
    ///
    /// # Safety
    /// Only the interrupt of this name may call this.
    #[doc(hidden)]
    #[inline(always)]
    pub unsafe fn on_character() {
        // SAFETY: demanded of the caller.
        unsafe { character::on_character::<DE, F>() }
    }

    /// The interrupt handler, called by [`bind_interrupts!`](crate::bind_interrupts).
    ///
    /// # Safety
    /// Only the interrupt of this name may call this.
    #[doc(hidden)]
    #[inline(always)]
    pub unsafe fn on_silence() {
        // SAFETY: in an interrupt, see `Shared`.
        unsafe { &mut *SHARED.get() }.on_alarm::<DE, F>();
    }

    /// The interrupt handler, called by [`bind_interrupts!`](crate::bind_interrupts).
    ///
    /// # Safety
    /// Only the interrupt of this name may call this.
    #[doc(hidden)]
    #[inline(always)]
    pub unsafe fn on_ready() {
        // SAFETY: in an interrupt, see `Shared`.
        let (machine, wire) = unsafe { &mut *SHARED.get() }.parts::<DE, F>();
        machine.on_ready(wire);
    }

    /// The interrupt handler, called by [`bind_interrupts!`](crate::bind_interrupts).
    ///
    /// # Safety
    /// Only the interrupt of this name may call this.
    #[doc(hidden)]
    #[inline(always)]
    pub unsafe fn on_sent() {
        // SAFETY: in an interrupt, see `Shared`.
        let (machine, wire) = unsafe { &mut *SHARED.get() }.parts::<DE, F>();
        machine.on_sent(wire);
    }

    /// The interrupt handler, called by [`bind_interrupts!`](crate::bind_interrupts).
    #[doc(hidden)]
    #[cfg(not(feature = "bare"))]
    #[inline(always)]
    pub fn abort() -> ! {
        crate::fault::abort::<DE>()
    }

    /// The CPU clock, for the code that binds the watchdog.
    #[doc(hidden)]
    pub const CLOCK_HZ: u32 = CLOCK_HZ;

    /// Whether no frame is lent for too long. The code that binds the watchdog calls this after half of the watchdog's time.
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

impl<DE: DriverEnable, const CLOCK_HZ: u32, F: Framings> Chip for Usart0<DE, CLOCK_HZ, F> {
    type Wire = Driven<DE, F>;
    type Settings = Settings<F>;

    #[inline(always)]
    fn with<R>(&self, f: impl FnOnce(&mut LineMachine, &mut Driven<DE, F>) -> R) -> R {
        with(|state| {
            let (machine, wire) = state.parts();
            f(machine, wire)
        })
    }

    #[inline(always)]
    fn with_waker<R>(
        &self,
        waiting: Waiting,
        waker: &Waker,
        f: impl FnOnce(&mut LineMachine, &mut Driven<DE, F>) -> R,
    ) -> R {
        match waiting {
            Waiting::ForFrame => executor::RECEIVER.register(waker),
            Waiting::WithFrame => executor::USER.register(waker),
        }
        self.with(f)
    }

    #[inline(always)]
    fn buffer(&self) -> NonNull<Adu> {
        state::ADU.buffer()
    }

    #[inline(always)]
    fn settings(&self, config: &LineConfig) -> Result<Settings<F>, LineError> {
        Settings::new(config, CLOCK_HZ)
    }

    #[inline(always)]
    fn set_up(&self, wire: &mut Driven<DE, F>, settings: &Settings<F>) {
        wire.set_up(settings);
    }

    fn set_delimiter(&self, delimiter: u8) {
        if F::ASCII {
            critical_section::with(|_| parts::set_delimiter(delimiter));
        }
    }

    fn may_be(&self, duplex: Duplex) -> bool {
        !DE::IS_ONE_PAIR || duplex == Duplex::Half
    }
}
