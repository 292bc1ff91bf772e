//! The board for an application: [`init`] it, open the ports in use, [`run`] the tasks.

use core::marker::PhantomData;
use core::sync::atomic::{AtomicU8, Ordering};

#[cfg(feature = "defmt")]
use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_stm32::{Peri, Peripherals, peripherals};
use multidrop::ResetCause;
use multidrop::roll::Watchdog as _;

use crate::ports::{As1, As2, LEDS, Port, PortSetup, Rs2, Rs4, check_free, pin};
use crate::usart::{self, Usart, registers};
use crate::watchdog::{self, Dog, Roll, Watchdog};
use crate::{Clock, fault, platform, stack};

/// A port that is not opened yet: its pins are inputs.
pub struct Closed<P>(PhantomData<P>);

impl<P: Port> Closed<P> {
    /// Sets the port up: pins with DE low, then receiver and transmitter on. The bus is not driven. The port listens once the bus
    /// was silent for t3.5.
    ///
    /// Without the crystal ([`clock`]) a port whose rate would be off by more than 2.5 % stays off, until it is configured for
    /// another rate.
    pub fn open(self, settings: PortSetup<P>) -> Usart {
        usart::open(P::INDEX, settings.line, settings.baud)
    }
}

/// The board: its ports, and the peripherals and pins that the ports do not need.
pub struct Board {
    /// The port on USART1.
    pub as1: Closed<As1>,
    /// The port on USART2.
    pub as2: Closed<As2>,
    /// The port on USART3.
    pub rs2: Closed<Rs2>,
    /// The port on UART4, with DE.
    pub rs4: Closed<Rs4>,
    /// The peripherals and pins that the ports do not need.
    pub free: Free,
}

macro_rules! free {
    ($($letter:literal: $($number:literal $pin:ident)*;)* $($name:ident)*) => {
        /// Peripherals and pins that the ports do not need, as `embassy-stm32` names them. PC0 to PC12 also belong to the
        /// demonstration unit, see [`outputs`].
        #[expect(non_snake_case, reason = "named as in embassy-stm32")]
        pub struct Free {
            $($(#[doc = concat!("Pin ", stringify!($pin), ".")] pub $pin: Peri<'static, peripherals::$pin>,)*)*
            $(#[doc = stringify!($name)] pub $name: Peri<'static, peripherals::$name>,)*
        }

        impl Free {
            fn of(all: Peripherals) -> Self {
                Self { $($($pin: all.$pin,)*)* $($name: all.$name,)* }
            }
        }

        // A pin that `WIRING` gives to a port has to leave this list.
        const _: () = {
            $($(check_free(pin($letter, $number));)*)*
        };
    };
}

// Not here: SWD and JTAG (PA13 to PA15, PB3), the crystal (PH0, PH1), TIM2, TIM5, the watchdog, EXTI and clock control.
free! {
    'A': 5 PA5 6 PA6 7 PA7 8 PA8;
    'B': 0 PB0 1 PB1 2 PB2 4 PB4 5 PB5 6 PB6 7 PB7 8 PB8 9 PB9 12 PB12 15 PB15;
    'C': 0 PC0 1 PC1 2 PC2 3 PC3 4 PC4 5 PC5 6 PC6 7 PC7 8 PC8 9 PC9 10 PC10 11 PC11 12 PC12 13 PC13 14 PC14 15 PC15;
    PD2
    ADC1 ADC2 ADC3 CAN1 CAN2 CRC DAC1 I2C1 I2C2 I2C3 RNG RTC SDIO SPI1 SPI2 SPI3
    TIM1 TIM3 TIM4 TIM6 TIM7 TIM8 TIM9 TIM10 TIM11 TIM12 TIM13 TIM14
    UART5 USART6 USB_OTG_FS USB_OTG_HS
    DMA1_CH0 DMA1_CH1 DMA1_CH2 DMA1_CH3 DMA1_CH4 DMA1_CH5 DMA1_CH6 DMA1_CH7
    DMA2_CH0 DMA2_CH1 DMA2_CH2 DMA2_CH3 DMA2_CH4 DMA2_CH5 DMA2_CH6 DMA2_CH7
}

/// The cause of the board's start, as its number; 0 before [`init`].
static CAUSE: AtomicU8 = AtomicU8::new(0);

/// Starts the watchdog, clocks, timers and interrupts, and gives the ports and everything that they do not need. To be called first
/// in `main`.
///
/// # Panics
/// If it is called a second time.
#[inline(always)]
pub fn init(watchdog: Watchdog) -> Board {
    assert!(CAUSE.load(Ordering::Relaxed) == 0);
    let cause = fault::cause();
    CAUSE.store(cause as u8, Ordering::Relaxed);
    if Dog::IS_ON {
        watchdog::start(watchdog);
    }
    registers::enable_clocks();
    let peripherals = platform::init();
    if !cfg!(feature = "bare") {
        stack::paint_and_guard();
    }
    crate::info!("started: {}", cause.name());
    Board {
        as1: Closed(PhantomData),
        as2: Closed(PhantomData),
        rs2: Closed(PhantomData),
        rs4: Closed(PhantomData),
        free: Free::of(peripherals),
    }
}

/// The cause of the board's start. [`ResetCause::report`] puts it into the diagnostic register.
pub fn reset_cause() -> ResetCause {
    ResetCause::from_number(CAUSE.load(Ordering::Relaxed))
}

/// The source of the clocks, once [`init`] has started them.
pub fn clock() -> Clock {
    platform::clock()
}

/// Runs tasks for ever; the CPU sleeps between them, except in QEMU. `init` spawns the first of them. The watchdog is fed as long
/// as all tasks on the roll are alive.
///
/// # Panics
/// If it is called a second time.
pub fn run<const N: usize>(roll: &'static Roll<N>, init: impl FnOnce(Spawner)) -> ! {
    platform::run(|spawner| {
        if Dog::IS_ON {
            spawner.spawn(watchdog::call(roll).unwrap());
        }
        init(spawner);
    })
}

/// For tests in QEMU: TIM2, the timer of `embassy-time`, wraps after this number of us. To be called before [`run`].
#[cfg(feature = "qemu")]
#[doc(hidden)]
pub fn wrap_time_in(us: u32) {
    platform::wrap_time_in(us);
}

/// For tests in QEMU: TIM5, which measures the silence on the lines, wraps after this number of us, at most 80 s. To be called
/// while all lines are silent.
#[cfg(feature = "qemu")]
#[doc(hidden)]
pub fn wrap_line_timer_in(us: u32) {
    platform::wrap_line_timer_in(us);
}

/// Makes the demonstration unit's pins, [`LEDS`], outputs, all low. Returns a function that shows a register on them.
pub fn outputs() -> impl FnMut(u16) {
    let show = |outputs| registers::write_gpioc(LEDS, outputs);
    show(0);
    registers::outputs_on_gpioc(LEDS);
    show
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Never linked, because of `panic = "immediate-abort"`.
    loop {}
}
