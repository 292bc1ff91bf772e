//! What an application does with the board: [`init`], open the ports it uses, [`run`] its tasks.

use core::marker::PhantomData;
use core::sync::atomic::{AtomicU8, Ordering};

#[cfg(feature = "defmt")]
use defmt_rtt as _;
use embassy_executor::Spawner;
use multidrop::ResetCause;
use multidrop::roll::Watchdog as _;

use crate::ports::{As1, As2, LEDS, Port, PortSetup, Rs2, Rs4};
use crate::usart::{Usart, registers};
use crate::watchdog::{self, Dog, Roll, Watchdog};
use crate::{Clock, fault, platform, stack};

/// A port not opened yet: its pins are inputs.
pub struct Closed<P>(PhantomData<P>);

impl<P: Port> Closed<P> {
    /// Sets the port up: pins with DE low, then receiver and transmitter on. The bus is not driven. It
    /// listens once the bus was silent for t3.5.
    ///
    /// Without the crystal ([`clock`]) a port whose rate would be off by more than 2.5 % stays off, until it is configured
    /// for another.
    pub fn open(self, settings: PortSetup<P>) -> Usart {
        Usart::open(P::INDEX, settings.line, settings.baud)
    }
}

/// The four ports.
pub struct Board {
    /// USART1.
    pub as1: Closed<As1>,
    /// USART2.
    pub as2: Closed<As2>,
    /// USART3.
    pub rs2: Closed<Rs2>,
    /// UART4, with DE.
    pub rs4: Closed<Rs4>,
}

/// Why the board has started, as its number; 0 before [`init`].
static CAUSE: AtomicU8 = AtomicU8::new(0);

/// Starts the watchdog, clocks, timers and interrupts. The first thing in `main`.
///
/// # Panics
/// The second time.
pub fn init(watchdog: Watchdog) -> Board {
    assert!(CAUSE.load(Ordering::Relaxed) == 0);
    let cause = fault::cause();
    CAUSE.store(cause as u8, Ordering::Relaxed);
    if Dog::IS_ON {
        watchdog::start(watchdog);
    }
    registers::enable_clocks();
    platform::init();
    if !cfg!(feature = "bare") {
        stack::paint_and_guard();
    }
    crate::info!("started: {}", cause.name());
    Board {
        as1: Closed(PhantomData),
        as2: Closed(PhantomData),
        rs2: Closed(PhantomData),
        rs4: Closed(PhantomData),
    }
}

/// Why the board has started. [`ResetCause::report`] puts it into the diagnostic register.
pub fn reset_cause() -> ResetCause {
    ResetCause::from_number(CAUSE.load(Ordering::Relaxed))
}

/// What the clocks are made of, once [`init`] has started them.
pub fn clock() -> Clock {
    platform::clock()
}

/// Runs tasks for ever; the CPU sleeps between them, except in QEMU. `init` spawns the first of them. The watchdog is fed as long
/// as all tasks on the roll are alive.
///
/// # Panics
/// The second time.
pub fn run<const N: usize>(roll: &'static Roll<N>, init: impl FnOnce(Spawner)) -> ! {
    platform::run(|spawner| {
        if Dog::IS_ON {
            spawner.spawn(watchdog::call(roll).unwrap());
        }
        init(spawner);
    })
}

/// For tests in QEMU: TIM2, which `embassy-time` counts with, goes round in so many us. Before [`run`].
#[cfg(feature = "qemu")]
#[doc(hidden)]
pub fn wrap_time_in(us: u32) {
    platform::wrap_time_in(us);
}

/// For tests in QEMU: TIM5, which measures the silence on the lines, goes round in so many us, at most 80 s. While nothing
/// is on any line.
#[cfg(feature = "qemu")]
#[doc(hidden)]
pub fn wrap_line_timer_in(us: u32) {
    platform::wrap_line_timer_in(us);
}

/// Makes the demonstration unit's pins, [`LEDS`], outputs, all low, and returns what puts a register on them.
pub fn outputs() -> impl FnMut(u16) {
    let show = |outputs| registers::write_gpioc(LEDS, outputs);
    show(0);
    registers::outputs_on_gpioc(LEDS);
    show
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Never linked: `panic = "immediate-abort"`.
    loop {}
}
