//! What an application does with the board: [`init`], open the port, [`run`] its tasks.

use embassy_avr_hal::gpio::{self, PD0, PD1};
use embassy_avr_hal::usart::{self, Framings, Settings, Usart0};
use embassy_avr_hal::{executor, pac};
use embassy_executor::Spawner;
use multidrop::Roll;
use multidrop::line::ChipLine;

use crate::{Bound, CLOCK_HZ, De, line};

/// The serial port, not opened yet: its pins are inputs.
pub struct Closed {
    usart: pac::USART0,
    timer: pac::TC1,
    rxd: PD0,
    txd: PD1,
    de: De,
}

impl Closed {
    /// Sets the port up: DE low, then receiver and transmitter on. The bus is not driven. It listens once interrupts are enabled
    /// and the bus was silent for t3.5.
    ///
    /// The token says that the interrupts of the line are bound to its type.
    #[inline(always)]
    pub fn open<F: Framings>(
        self,
        irqs: impl usart::Bound<Usart0<De, CLOCK_HZ, F>>,
        settings: Settings<F>,
    ) -> ChipLine<Usart0<De, CLOCK_HZ, F>> {
        let usart = Usart0::new(self.usart, &self.timer, self.rxd, self.txd, self.de, irqs);
        line(usart, &settings)
    }
}

macro_rules! pins {
    ($($name:ident)*) => {
        /// The pins that the port does not use.
        #[expect(non_snake_case, reason = "pins are named as in the data sheet")]
        pub struct Pins {
            $(#[doc = concat!("Pin ", stringify!($name), ".")] pub $name: gpio::$name,)*
        }

        impl Pins {
            #[inline(always)]
            fn new(pins: gpio::Pins) -> (Self, PD0, PD1, De) {
                (Self { $($name: pins.$name,)* }, pins.PD0, pins.PD1, pins.PD2)
            }
        }
    };
}

// PB6 and PB7 have the crystal, PC6 is reset.
pins! {
    PB0 PB1 PB2 PB3 PB4 PB5
    PC0 PC1 PC2 PC3 PC4 PC5
    PD3 PD4 PD5 PD6 PD7
}

/// The board: its port, and the peripherals that the port does not use.
#[expect(non_snake_case, reason = "peripherals are named as in the data sheet")]
pub struct Board {
    /// The serial port, with DE.
    pub rs4: Closed,
    /// The pins of the board.
    pub pins: Pins,
    /// The analog comparator.
    pub AC: pac::AC,
    /// The analog-to-digital converter.
    pub ADC: pac::ADC,
    /// EEPROM, for [`Eeprom`](embassy_avr_hal::eeprom::Eeprom).
    pub EEPROM: pac::EEPROM,
    /// The SPI peripheral.
    pub SPI: pac::SPI,
    /// Timer0, 8 bits.
    pub TC0: pac::TC0,
    /// Timer2, 8 bits.
    pub TC2: pac::TC2,
    /// Two-wire interface, I2C.
    pub TWI: pac::TWI,
}

/// Records the cause of the last reset, starts the watchdog, and returns the port and the peripherals that the port does not use. The first
/// thing in `main`.
///
/// In a build for the old boot loader, which does not work with a watchdog, the watchdog stays off.
///
/// # Panics
/// The second time.
#[inline(always)]
pub fn init<I: Bound>(irqs: I) -> Board {
    #[cfg(not(feature = "bare"))]
    {
        embassy_avr_hal::fault::keep_cause();
        if crate::options::watchdog() {
            I::TIME.start(irqs);
        } else {
            // Perhaps the boot loader has used it.
            embassy_avr_hal::watchdog::stop();
        }
    }
    let _ = irqs;
    let chip = pac::Peripherals::take().unwrap();
    let (pins, rxd, txd, de) = Pins::new(gpio::Pins::new(chip.PORTB, chip.PORTC, chip.PORTD));
    Board {
        rs4: Closed {
            usart: chip.USART0,
            timer: chip.TC1,
            rxd,
            txd,
            de,
        },
        pins,
        AC: chip.AC,
        ADC: chip.ADC,
        EEPROM: chip.EEPROM,
        SPI: chip.SPI,
        TC0: chip.TC0,
        TC2: chip.TC2,
        TWI: chip.TWI,
    }
}

/// Runs tasks for ever; the CPU sleeps between them. `init` spawns the first of them. The watchdog is fed as long as all tasks on
/// the roll are alive.
///
/// To be called once, from `main`.
#[inline(always)]
pub fn run<I: Bound, const N: usize>(roll: &'static Roll<I, N>, init: impl FnOnce(Spawner)) -> ! {
    executor::run_watched(I::TOKEN, init, || {
        if I::IS_ON {
            roll.call();
        }
    })
}
