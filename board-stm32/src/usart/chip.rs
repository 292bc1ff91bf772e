//! A port as the [`Chip`] of a line: its interrupts, where its [`State`] is, and how it is set up.

use core::cell::Cell;
use core::ptr::NonNull;
use core::task::Waker;

use embassy_stm32::interrupt;
use embassy_stm32::pac::Interrupt;
use multidrop::line::{Adu, ChipLine, LineBuffer, LineConfig, LineError};
use multidrop::protocol::line::{Chip, LineMachine, Observer, Waiting};
use multidrop::protocol::port_registers::{Duplex, Flow};

use super::registers;
use super::settings::Settings;
use super::state::{ADUS, Driver, SHARED, State};
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

/// Called `ms` milliseconds after the last call. Returns whether no port's frame is lent for longer than the longest frame takes, and
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
pub type Usart = ChipLine<UsartChip>;

/// The chip's side of a port's line.
pub struct UsartChip {
    adu: &'static LineBuffer,
    port: u8,
    /// RTS and CTS are the port's.
    has_handshake: bool,
    observer: Cell<Option<&'static dyn Observer>>,
}

/// Sets port `port` up: pins with DE low, then receiver and transmitter on. The bus is not driven. It
/// listens once the bus was silent for t3.5. A port whose rate `baud` the clock does not make stays off: with
/// pins and all, until it is configured for another. To be called once for each port.
pub(crate) fn open(port: usize, settings: Settings, baud: u32) -> Usart {
    let chip = UsartChip {
        adu: &ADUS[port],
        port: port as u8,
        has_handshake: settings.rts_cts,
        observer: Cell::new(None),
    };
    registers::connect(&WIRING[port]);
    let checked = settings.check_clock(WIRING[port].clock_hz, baud, platform::clock().error_ppm());
    if checked.is_err() {
        crate::info!(
            "{} stays off: the clock does not make {} baud",
            WIRING[port].name,
            baud
        );
    }
    // SAFETY: a port has one state and one buffer, which its interrupts use as the machine says; it is opened once.
    unsafe { ChipLine::new(chip, checked.is_ok().then_some(&settings)) }
}

impl UsartChip {
    /// With interrupts off.
    #[inline(always)]
    fn with_state<R>(&self, f: impl FnOnce(&mut State) -> R) -> R {
        critical_section::with(|_| {
            // SAFETY: interrupts are off and this is never called from within `f`.
            f(unsafe { &mut *SHARED[usize::from(self.port)].get() })
        })
    }
}

// ANCHOR: chip
impl Chip for UsartChip {
    type Wire = Driver;
    type Settings = Settings;

    const HAS_NEIGHBOURS: bool = true;

    #[inline(always)]
    fn with<R>(&self, f: impl FnOnce(&mut LineMachine, &mut Driver) -> R) -> R {
        self.with_state(|state| f(&mut state.machine, &mut state.driver))
    }

    #[inline(always)]
    fn with_waker<R>(
        &self,
        waiting: Waiting,
        waker: &Waker,
        f: impl FnOnce(&mut LineMachine, &mut Driver) -> R,
    ) -> R {
        self.with(|machine, driver| {
            match waiting {
                Waiting::ForFrame => driver.receiver.register(waker),
                Waiting::WithFrame => driver.user.register(waker),
            }
            f(machine, driver)
        })
    }

    fn buffer(&self) -> NonNull<Adu> {
        self.adu.pointer()
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

    fn set_up(&self, driver: &mut Driver, settings: &Settings) {
        driver.set_up(settings);
        if self.has_handshake {
            registers::connect_handshake(&WIRING[usize::from(self.port)], settings.rts_cts);
        }
    }

    fn set_delimiter(&self, delimiter: u8) {
        self.with(|_, driver| driver.set_delimiter(delimiter));
    }

    fn may_be(&self, duplex: Duplex) -> bool {
        duplex == Duplex::Half || WIRING[usize::from(self.port)].de.is_none()
    }

    fn observer(&self) -> Option<&Cell<Option<&'static dyn Observer>>> {
        Some(&self.observer)
    }
}
// ANCHOR_END: chip
