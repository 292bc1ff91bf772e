//! A port as the [`Chip`] of a line: its interrupts, its [`State`] and its setup.

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

/// The interrupts of the ports, in the order of the ports.
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

/// Handles the interrupt of port `PORT`. Inlined in each interrupt, so that the addresses of the port's state are constants.
#[inline(always)]
fn on_usart<const PORT: usize>() {
    // SAFETY: in an interrupt of the line, see `Shared`.
    unsafe { &mut *SHARED[PORT].get() }.on_usart();
}

/// Handles the alarm of `port`. To be called from an interrupt of the line only.
#[inline(never)]
pub(crate) fn on_alarm(port: usize) {
    // SAFETY: the caller is an interrupt of the line.
    unsafe { &mut *SHARED[port].get() }.on_alarm();
}

/// Returns whether no port's frame is lent for longer than the longest frame takes plus the watchdog's time. Called `ms`
/// milliseconds after the last call.
pub(crate) fn no_frame_is_stuck(ms: u32, time_ms: u32) -> bool {
    critical_section::with(|_| {
        // Every port counts its time, even after a port that is stuck.
        let stuck = SHARED.iter().filter(|shared| {
            // SAFETY: interrupts are off, and no code that has them off calls this.
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
    /// RTS and CTS belong to the port.
    has_handshake: bool,
    observer: Cell<Option<&'static dyn Observer>>,
}

/// Sets port `port` up: pins with DE low, then receiver and transmitter on. The bus is not driven. The port listens once the bus
/// was silent for t3.5. If the clock does not make the rate `baud`, the port stays off, with its pins set up, until it is
/// configured for another rate. To be called once for each port.
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
    // SAFETY: a port has one state and one buffer, and its interrupts use them as the machine says. A port is opened once.
    unsafe { ChipLine::new(chip, checked.is_ok().then_some(&settings)) }
}

impl UsartChip {
    /// Calls `f` with the state of the port, with interrupts off.
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
