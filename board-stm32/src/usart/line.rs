//! [`Line`] for a port: futures on what its interrupts leave in [`State`].

use core::cell::Cell;
use core::future::{Future, poll_fn};
use core::marker::PhantomData;
use core::ptr::NonNull;
use core::task::{Context, Poll};

use embassy_stm32::interrupt;
use embassy_stm32::pac::Interrupt;
use multidrop::line::{Adu, Key, Lend, Line, LineConfig, LineError};
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::port_registers::{Duplex, Flow};
use multidrop::sniff::Observer;

use super::registers;
use super::settings::Settings;
use super::state::{ADUS, AduCell, SHARED, State};
use crate::platform;
use crate::ports::{PORTS, WIRING};

/// The interrupts of the ports, in their order.
pub(crate) const INTERRUPTS: [Interrupt; PORTS] = [
    Interrupt::USART1,
    Interrupt::USART2,
    Interrupt::USART3,
    Interrupt::UART4,
];

#[interrupt]
fn USART1() {
    on_usart::<0>();
}

#[interrupt]
fn USART2() {
    on_usart::<1>();
}

#[interrupt]
fn USART3() {
    on_usart::<2>();
}

#[interrupt]
fn UART4() {
    on_usart::<3>();
}

/// In each port's interrupt with the addresses of what is the port's.
#[inline(always)]
fn on_usart<const PORT: usize>() {
    // SAFETY: in an interrupt of the line, see `Shared`.
    unsafe { &mut *SHARED[PORT].get() }.on_usart();
}

/// The alarm of `port` went off. From an interrupt of the line only.
#[inline(never)]
pub(crate) fn on_alarm(port: usize) {
    // SAFETY: as demanded.
    unsafe { &mut *SHARED[port].get() }.on_alarm();
}

/// So many ms are over since this was last called: whether no port's frame is lent for longer than the longest frame takes, and
/// the watchdog's time.
pub(crate) fn no_frame_is_stuck(ms: u32, time_ms: u32) -> bool {
    critical_section::with(|_| {
        // Each port counts, also behind one that is stuck.
        let stuck = SHARED.iter().filter(|shared| {
            // SAFETY: interrupts are off and this is not called from where they are too.
            !unsafe { &mut *shared.get() }.may_keep_frame(ms, time_ms)
        });
        stuck.count() == 0
    })
}

/// The line of one port.
pub struct Usart {
    adu: &'static AduCell,
    port: u8,
    /// RTS and CTS are the port's.
    has_handshake: bool,
    observer: Cell<Option<&'static dyn Observer>>,
    /// Not to be used from an interrupt.
    _tasks: PhantomData<*const ()>,
}

impl Usart {
    /// Sets port `port` up: pins with DE low, then receiver and transmitter on. The bus is not driven. It
    /// listens once the bus was silent for t3.5. A port whose rate `baud` the clock does not make stays off: with
    /// pins and all, until it is configured for another. To be called once for each port.
    pub(crate) fn open(port: usize, settings: Settings, baud: u32) -> Self {
        let line = Self {
            adu: &ADUS[port],
            port: port as u8,
            has_handshake: settings.rts_cts,
            observer: Cell::new(None),
            _tasks: PhantomData,
        };
        registers::connect(&WIRING[port]);
        let checked =
            settings.check_clock(WIRING[port].clock_hz, baud, platform::clock().error_ppm());
        if checked.is_ok() {
            line.with(|state| line.apply(state, settings));
        } else {
            crate::info!(
                "{} stays off: the clock does not make {} baud",
                WIRING[port].name,
                baud
            );
        }
        line
    }

    fn apply(&self, state: &mut State, settings: Settings) {
        state.apply(settings);
        if self.has_handshake {
            registers::connect_handshake(&WIRING[usize::from(self.port)], settings.rts_cts);
        }
    }

    /// The same, and `observer` is [shown](Line::show) the traffic.
    pub fn observed_by(self, observer: &'static dyn Observer) -> Self {
        self.observer.set(Some(observer));
        self
    }

    /// With interrupts off.
    fn with<R>(&self, f: impl FnOnce(&mut State) -> R) -> R {
        critical_section::with(|_| {
            // SAFETY: interrupts are off and `with` is never called from within `f`.
            f(unsafe { &mut *SHARED[usize::from(self.port)].get() })
        })
    }

    /// What the machine has to tell the task that works with a frame, or waits to send. The waker is
    /// registered first: what comes after wakes.
    fn poll_user<R>(
        &self,
        context: &Context,
        look: impl FnOnce(&mut State) -> Option<R>,
    ) -> Poll<R> {
        self.with(|state| {
            state.chip.user.register(context.waker());
            look(state).map_or(Poll::Pending, Poll::Ready)
        })
    }

    fn settings(&self, config: &LineConfig) -> Result<Settings, LineError> {
        if config.flow == Flow::RtsCts && !self.has_handshake {
            return Err(LineError::Flow);
        }
        let clock_hz = WIRING[usize::from(self.port)].clock_hz;
        let settings = Settings::new(config, clock_hz, crate::TICK_HZ)?;
        settings.check_clock(clock_hz, config.baud, platform::clock().error_ppm())?;
        Ok(settings)
    }
}

// ANCHOR: lend
// SAFETY: the machine lends the port's one buffer once until `give_back`, and keeps interrupts from it meanwhile; only the
// transmitter's interrupt reads it, after `release`.
unsafe impl Lend for Usart {
    fn poll_received(&self, context: &mut Context<'_>, _: Key) -> Poll<Result<u8, ReceiveErrors>> {
        self.with(|state| {
            state.chip.receiver.register(context.waker());
            state.machine.fetch().map_or(Poll::Pending, Poll::Ready)
        })
    }

    fn poll_lent(&self, context: &mut Context<'_>, _: Key) -> Poll<()> {
        self.poll_user(context, |state| state.machine.take_buffer().then_some(()))
    }

    fn buffer(&self, _: Key) -> NonNull<Adu> {
        self.adu.buffer()
    }

    fn release(&self, len: u8, _: Key) {
        self.with(|state| state.machine.release(&mut state.chip, len));
    }

    fn poll_settled(&self, context: &mut Context<'_>, _: Key) -> Poll<bool> {
        self.poll_user(context, |state| state.machine.verdict())
    }

    fn poll_sent(&self, context: &mut Context<'_>, _: Key) -> Poll<bool> {
        self.poll_user(context, |state| state.machine.sent())
    }

    fn give_back(&self, _: Key) {
        self.with(State::give_back);
    }
}
// ANCHOR_END: lend

impl Line for Usart {
    const HAS_NEIGHBOURS: bool = true;

    fn quiet(&self) -> impl Future<Output = ReceiveErrors> {
        poll_fn(|context| self.poll_user(context, |state| state.machine.quiet(&mut state.chip)))
    }

    fn may_be(&self, duplex: Duplex) -> bool {
        duplex == Duplex::Half || WIRING[usize::from(self.port)].de.is_none()
    }

    fn check(&self, config: &LineConfig) -> Result<(), LineError> {
        self.settings(config).map(drop)
    }

    async fn configure(&self, config: LineConfig) -> Result<(), LineError> {
        let settings = self.settings(&config)?;
        poll_fn(|context| {
            self.poll_user(context, |state| {
                (!state.machine.is_sending()).then(|| self.apply(state, settings))
            })
        })
        .await;
        Ok(())
    }

    fn set_delimiter(&self, delimiter: u8) {
        self.with(|state| state.set_delimiter(delimiter));
    }

    fn show(&self, seen: Result<&[u8], ReceiveErrors>) {
        if let Some(observer) = self.observer.get() {
            observer.hear(seen);
        }
    }

    fn was_cut(&self) -> bool {
        self.with(|state| state.machine.was_cut())
    }
}
