//! The Arduino Nano: its clock, its pins, and the options of a build.
//!
//! | pin | use |
//! |---|---|
//! | D0, D1 (PD0, PD1) | RXD, TXD |
//! | D2 (PD2) | DE of the RS-485 transceiver, [`De`] |
//! | D3..D7, D8..D13 | free; the demonstration unit's LEDs |
#![no_std]

mod board;
pub mod outputs;
mod watchdog;

pub use board::{Board, Closed, Pins, init, run};
pub use embassy_avr_hal as hal;
use embassy_avr_hal::baud;
use embassy_avr_hal::gpio::DriverEnable;
use embassy_avr_hal::usart::{Delayed, Framings, RtuAndAscii, RtuOnly, Settings, Slow, Usart0};
pub use embassy_avr_hal::watchdog::Watchdog;
use multidrop::PortConfig;
pub use multidrop::ResetCause;
use multidrop::line::{ChipLine, InterCharacter, LineError};
use multidrop::protocol::format::Framing;
use multidrop::protocol::message::Message;
use multidrop::protocol::port_registers::Duplex;
use multidrop::protocol::timing;
#[doc(hidden)]
pub use multidrop::roll::Watchdog as RollWatchdog;
pub use multidrop_apps::options;
pub use watchdog::Bound;
#[doc(hidden)]
pub use watchdog::{OneExecutor, Task};

/// The CPU clock: the Nano's 16 MHz crystal, unless the build sets another.
pub const CLOCK_HZ: u32 = options::clock(16_000_000);

/// The pin that enables the driver of the RS-485 transceiver. To move it, change this line and [`DE_MASK`], and swap the two pins
/// in [`Pins`].
pub type De = embassy_avr_hal::gpio::PD2;

/// The mask of [`De`] in its port.
pub const DE_MASK: u8 = 1 << 2;

/// Whether `MULTIDROP_BAUD` is so slow that Timer1 cannot count t3.5 and a character of some format in one turn.
const fn is_slow() -> bool {
    const TICK_HZ: u32 = CLOCK_HZ / 8;
    // Five characters of 12 bits.
    60 * TICK_HZ / options::baud(115_200) > u16::MAX as u32
}

/// The Nano's one serial port, as RS-485, for RTU; for slow lines too where `MULTIDROP_BAUD` asks for one.
pub type Rs485 = ChipLine<Usart0<De, CLOCK_HZ, Rtu>>;

/// The Nano's serial port for RTU and ASCII, as RS-485.
pub type Rs485Ascii = ChipLine<Usart0<De, CLOCK_HZ, RtuAndAscii>>;

/// The line [`Rs485`] with DE_LEAD, which raises DE before the answer, and RESPONSE_DELAY, which delays the answer.
pub type Rs485Delayed = ChipLine<Usart0<De, CLOCK_HZ, Delayed<RtuOnly>>>;

/// The line [`Rs485`] for slow rates too: t3.5, or the gap that ends a frame, may be longer than 65535 ticks, 32.7 ms
/// at 16 MHz.
pub type Rs485Slow = ChipLine<Usart0<De, CLOCK_HZ, Slow<RtuOnly>>>;

/// The line [`Rs485Ascii`] for slow rates too.
pub type Rs485AsciiSlow = ChipLine<Usart0<De, CLOCK_HZ, Slow<RtuAndAscii>>>;

/// The framings of [`Rs485`].
pub enum Rtu {}

impl Framings for Rtu {
    const ASCII: bool = false;
    const SLOW: bool = is_slow();
    type Delays = ();
}

/// The line of an application that can be built for RTU or for ASCII, by [`options::ascii`].
pub type Rs485Option = ChipLine<Usart0<De, CLOCK_HZ, OptionFramings>>;

/// The framings of [`Rs485Option`].
pub enum OptionFramings {}

impl Framings for OptionFramings {
    const ASCII: bool = options::ascii();
    type Delays = ();
    const SLOW: bool = is_slow();
}

/// The line of a USART, which listens once interrupts are enabled and the bus was silent for t3.5.
#[inline(always)]
pub fn line<DE: DriverEnable, const CLOCK_HZ: u32, F: Framings>(
    usart: Usart0<DE, CLOCK_HZ, F>,
    settings: &Settings<F>,
) -> ChipLine<Usart0<DE, CLOCK_HZ, F>> {
    // SAFETY: there is one USART, made of the one set of its registers, with one machine and one buffer; its interrupts use both as
    // the machine demands.
    unsafe { ChipLine::new(usart, Some(settings)) }
}

/// The chip's side of a line, to which its interrupts are bound.
#[doc(hidden)]
pub trait OfUsart {
    /// The type of the USART.
    type Usart;
}

impl<DE, const CLOCK_HZ: u32, F> OfUsart for ChipLine<Usart0<DE, CLOCK_HZ, F>> {
    type Usart = Usart0<DE, CLOCK_HZ, F>;
}

/// The rule for a silence that only a slow line can count.
const TOO_LONG: &str = "a silence is too long for one turn of Timer1: the line must be of type Rs485Slow or Rs485AsciiSlow";

/// The line settings of a port at the Nano's clock, for a `const`. A setting that the chip does not support stops the
/// build.
pub const fn settings<F: Framings>(port: &PortConfig) -> Settings<F> {
    let line = &port.settings().line;
    if matches!(line.duplex, Duplex::Full) {
        port.wrong("duplex", 1, "must be 0 (half): the line has a DE pin", None);
    }
    let is_ascii = matches!(line.framing, Framing::Ascii);
    match Settings::new(&port.line(), CLOCK_HZ) {
        Ok(settings) => settings,
        Err(LineError::Baud { nearest }) => port.wrong(
            "baud",
            port.line().baud,
            if port.line().baud
                < baud::slowest(CLOCK_HZ, line.format.character_bits() as u32, is_ascii)
            {
                "too slow: a character is too long for Timer1"
            } else {
                "the clock does not make it within 2.5 %"
            },
            Some(nearest),
        ),
        Err(LineError::Silence) => {
            let t3_5 = timing::t3_5(line.format, line.baud, CLOCK_HZ / 8);
            match line.inter_character {
                InterCharacter::Gap(ms) if timing::gap(ms, CLOCK_HZ / 8) > t3_5 => {
                    port.wrong("inter_character gap", ms as u32, TOO_LONG, None)
                }
                _ => port.wrong("baud", line.baud, TOO_LONG, None),
            }
        }
        Err(LineError::Format(format)) => port.wrong(
            "format: data bits",
            format.data_bits() as u32,
            "must be 8 for RTU",
            None,
        ),
        Err(LineError::Flow) => port.wrong(
            "flow",
            1,
            "must be 0 (none): the ATmega328P has no RTS and CTS",
            None,
        ),
        Err(LineError::Delay) => Message::new()
            .text("port ")
            .text(port.name())
            .text(": de_lead_us and response_delay_ms must be 0 on a line of type Rs485; Rs485Delayed has both")
            .fail(),
        Err(LineError::Framing(_)) => Message::new()
            .text("port ")
            .text(port.name())
            .text(": framing is ASCII, must be RTU on a line of type Rs485; Rs485Ascii has both")
            .fail(),
    }
}

/// The depth of the stack since the start. Not in an image that is built bare.
#[cfg(not(feature = "bare"))]
pub fn stack() -> multidrop::Stack {
    let embassy_avr_hal::stack::Stack { size, used } = embassy_avr_hal::stack::stack();
    multidrop::Stack { size, used }
}

/// The cause of the last reset; [`ResetCause::Other`] in an image that is built bare. [`ResetCause::report`] puts it
/// into the diagnostic register.
pub fn reset_cause() -> ResetCause {
    #[cfg(not(feature = "bare"))]
    return embassy_avr_hal::fault::reset_cause();
    #[cfg(feature = "bare")]
    ResetCause::Other
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Never linked: `panic = "immediate-abort"`.
    loop {}
}
