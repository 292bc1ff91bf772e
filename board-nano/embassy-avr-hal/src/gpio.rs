//! Pins of ports B, C and D (DS 14), with the `embedded-hal` 1.0 traits, and whole ports as outputs.
//!
//! Each pin is a type. Changing a pin is one `sbi` or `cbi`, which no interrupt can split (DS, note to the register
//! summary).

use core::convert::Infallible;

use embedded_hal::digital::{ErrorType, InputPin, OutputPin, StatefulOutputPin};

/// A pin of the chip. Sealed: the types in this module implement it.
pub trait Pin: sealed::Sealed {
    /// The address of its PIN register; DDR and PORT follow it (DS 14.4).
    #[doc(hidden)]
    const PIN: usize;
    /// The mask of its bit in these registers.
    #[doc(hidden)]
    const MASK: u8;
}

mod sealed {
    pub trait Sealed {}
}

#[inline(always)]
fn set(register: usize, mask: u8) {
    let register = register as *mut u8;
    // SAFETY: an I/O register of a port; with one constant bit this is a single `sbi`.
    unsafe { register.write_volatile(register.read_volatile() | mask) }
}

#[inline(always)]
fn clear(register: usize, mask: u8) {
    let register = register as *mut u8;
    // SAFETY: an I/O register of a port; with one constant bit this is a single `cbi`.
    unsafe { register.write_volatile(register.read_volatile() & !mask) }
}

#[inline(always)]
fn get(register: usize) -> u8 {
    // SAFETY: reading a port register has no effect.
    unsafe { (register as *const u8).read_volatile() }
}

/// A pin as push-pull output.
pub struct Output<P: Pin>(P);

impl<P: Pin> Output<P> {
    /// Takes the pin and drives it low, or high: without a glitch in between (DS 14.2.3).
    pub fn new(pin: P, high: bool) -> Self {
        if high {
            set(P::PIN + 2, P::MASK)
        } else {
            clear(P::PIN + 2, P::MASK)
        }
        set(P::PIN + 1, P::MASK);
        Self(pin)
    }

    /// Drives the pin high.
    #[inline(always)]
    pub fn high(&mut self) {
        set(P::PIN + 2, P::MASK);
    }

    /// Drives the pin low.
    #[inline(always)]
    pub fn low(&mut self) {
        clear(P::PIN + 2, P::MASK);
    }

    /// Gives the pin back as a floating input.
    pub fn release(self) -> P {
        clear(P::PIN + 1, P::MASK);
        clear(P::PIN + 2, P::MASK);
        self.0
    }
}

impl<P: Pin> ErrorType for Output<P> {
    type Error = Infallible;
}

impl<P: Pin> OutputPin for Output<P> {
    #[inline(always)]
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.low();
        Ok(())
    }

    #[inline(always)]
    fn set_high(&mut self) -> Result<(), Infallible> {
        self.high();
        Ok(())
    }
}

impl<P: Pin> StatefulOutputPin for Output<P> {
    fn is_set_high(&mut self) -> Result<bool, Infallible> {
        Ok(get(P::PIN + 2) & P::MASK != 0)
    }

    fn is_set_low(&mut self) -> Result<bool, Infallible> {
        Ok(get(P::PIN + 2) & P::MASK == 0)
    }

    /// One write to PINx, which toggles (DS 14.2.2).
    fn toggle(&mut self) -> Result<(), Infallible> {
        // SAFETY: writing a one to a PIN register toggles that pin and no other.
        unsafe { (P::PIN as *mut u8).write_volatile(P::MASK) };
        Ok(())
    }
}

/// A pin as input.
pub struct Input<P: Pin>(P);

impl<P: Pin> Input<P> {
    /// Takes the pin as input, floating or with its pull-up (20 to 50 kOhm, DS 29.2).
    pub fn new(pin: P, pull_up: bool) -> Self {
        clear(P::PIN + 1, P::MASK);
        if pull_up {
            set(P::PIN + 2, P::MASK)
        } else {
            clear(P::PIN + 2, P::MASK)
        }
        Self(pin)
    }

    /// Gives the pin back.
    pub fn release(self) -> P {
        self.0
    }
}

impl<P: Pin> ErrorType for Input<P> {
    type Error = Infallible;
}

impl<P: Pin> InputPin for Input<P> {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(get(P::PIN) & P::MASK != 0)
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(get(P::PIN) & P::MASK == 0)
    }
}

/// The pull-up of PD0, which is an input: its PORT register is 0x2B.
#[inline(always)]
pub(crate) fn hold_rxd_high() {
    set(0x2B, 1 << 0);
}

/// The DE pin of an RS-485 transceiver, which the line's interrupts drive; or [`NoDe`].
pub trait DriverEnable {
    /// Whether both directions share one pair of wires, since there is a driver to enable.
    const IS_ONE_PAIR: bool = true;
    /// Makes the pin an output, low.
    fn init();
    /// Enables the driver of the transceiver.
    fn raise();
    /// Disables the driver of the transceiver.
    fn lower();
}

impl<P: Pin> DriverEnable for P {
    fn init() {
        clear(P::PIN + 2, P::MASK);
        set(P::PIN + 1, P::MASK);
    }

    #[inline(always)]
    fn raise() {
        set(P::PIN + 2, P::MASK);
    }

    #[inline(always)]
    fn lower() {
        clear(P::PIN + 2, P::MASK);
    }
}

/// No DE pin: RS-232, or a transceiver that switches by itself.
pub struct NoDe;

impl DriverEnable for NoDe {
    const IS_ONE_PAIR: bool = false;

    fn init() {}
    #[inline(always)]
    fn raise() {}
    #[inline(always)]
    fn lower() {}
}

/// Pins of one port as outputs that are written together.
pub struct PortOut<const PIN: usize> {
    mask: u8,
}

/// Port B as outputs.
pub type PortBOut = PortOut<0x23>;
/// Port C as outputs.
pub type PortCOut = PortOut<0x26>;
/// Port D as outputs.
pub type PortDOut = PortOut<0x29>;

impl<const PIN: usize> PortOut<PIN> {
    /// Takes the pins of `mask` as outputs, low. All other pins are never changed, so RX, TX, DE or a crystal may
    /// share the port.
    pub fn new(mask: u8) -> Self {
        let mut port = Self { mask };
        port.write(0);
        critical_section::with(|_| set(PIN + 1, mask));
        port
    }

    /// Sets the pins to the bits of `value`; bits outside of the mask are ignored.
    pub fn write(&mut self, value: u8) {
        critical_section::with(|_| {
            // Without the critical section, an interrupt that switches DE in between would be undone.
            let others = get(PIN + 2) & !self.mask;
            // SAFETY: the PORT register of a port; pins outside of the mask keep their level.
            unsafe { ((PIN + 2) as *mut u8).write_volatile(others | value & self.mask) }
        });
    }
}

macro_rules! pins {
    ($($name:ident: $pin:literal, $bit:literal;)*) => {
        $(
            #[doc = concat!("Pin ", stringify!($name), ".")]
            pub struct $name(());
            impl sealed::Sealed for $name {}
            impl Pin for $name {
                const PIN: usize = $pin;
                const MASK: u8 = 1 << $bit;
            }
        )*

        /// All pins, of which there is one set.
        #[allow(non_snake_case)]
        pub struct Pins {
            $(#[doc = concat!("Pin ", stringify!($name), ".")] pub $name: $name,)*
        }

        impl Pins {
            /// Takes the ports apart into pins.
            pub fn new(_: crate::pac::PORTB, _: crate::pac::PORTC, _: crate::pac::PORTD) -> Self {
                Self { $($name: $name(()),)* }
            }
        }
    };
}

pins! {
    PB0: 0x23, 0; PB1: 0x23, 1; PB2: 0x23, 2; PB3: 0x23, 3;
    PB4: 0x23, 4; PB5: 0x23, 5; PB6: 0x23, 6; PB7: 0x23, 7;
    PC0: 0x26, 0; PC1: 0x26, 1; PC2: 0x26, 2; PC3: 0x26, 3;
    PC4: 0x26, 4; PC5: 0x26, 5; PC6: 0x26, 6;
    PD0: 0x29, 0; PD1: 0x29, 1; PD2: 0x29, 2; PD3: 0x29, 3;
    PD4: 0x29, 4; PD5: 0x29, 5; PD6: 0x29, 6; PD7: 0x29, 7;
}
