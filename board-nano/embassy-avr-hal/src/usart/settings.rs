//! From a [`LineConfig`] to register contents and timer ticks, at compile time or at run time.

use core::marker::PhantomData;

use multidrop_firmware::line::{InterCharacter, LineConfig, LineError, Role};
use multidrop_firmware::protocol::format::{Framing, LineFormat, Parity};
use multidrop_firmware::protocol::port_registers::Flow;
use multidrop_firmware::protocol::timing;

use crate::baud::divisor;
use crate::timer1::PRESCALER;

/// Bits of UCSR0A (DS 20.11.2).
pub(crate) const U2X: u8 = 1 << 1;

/// Ticks that pass at least between RXC and the reading of the timer in one interrupt (26 cycles), and
/// between the alarm and the look at the start-bit detector in the other (45 cycles): 71 cycles make 8.9
/// ticks, of which one is left for the timer's own resolution and one for good measure.
const LATENCY: u32 = 6;

/// A client judges a frame half way from t1.5 to t3.5: above 19200 baud it has 500 us to make its next request.
const JUDGED_EARLY_CLIENT: u32 = 2;

/// The framings that a line can be set up for, as a type: what is for ASCII is not in an image whose line
/// has no use for it.
pub trait Framings: 'static {
    /// Whether ASCII is among them; RTU always is.
    const ASCII: bool;
    /// What there is for DE_LEAD and RESPONSE_DELAY: [`Delays`], or `()` for nothing.
    type Delays: Delaying;
}

/// [`Delays`], or `()`. Sealed.
pub trait Delaying: sealed::Sealed + Copy + core::fmt::Debug + PartialEq {
    /// Whether an answer can wait, and DE go up before it.
    const ARE_THERE: bool;
    #[doc(hidden)]
    fn get(self) -> Delays;
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for () {}
    impl Sealed for super::Delays {}
}

impl Delaying for () {
    const ARE_THERE: bool = false;
    fn get(self) -> Delays {
        Delays {
            lead: 0,
            response: 0,
        }
    }
}

impl Delaying for Delays {
    const ARE_THERE: bool = true;
    fn get(self) -> Delays {
        self
    }
}

/// Makes one of the two out of what may have to be dropped.
union Made<D: Delaying> {
    given: Delays,
    wanted: D,
}

/// RTU, for good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RtuOnly {}

/// RTU or ASCII, at any time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RtuAndAscii {}

/// The framings `F`, and settings that have an answer wait: DE_LEAD and RESPONSE_DELAY.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Delayed<F>(PhantomData<F>);

impl<F: Framings> Framings for Delayed<F> {
    const ASCII: bool = F::ASCII;
    type Delays = Delays;
}

impl Framings for RtuOnly {
    const ASCII: bool = false;
    type Delays = ();
}

impl Framings for RtuAndAscii {
    const ASCII: bool = true;
    type Delays = ();
}

/// Everything about a line that depends on its configuration and the clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings<F: Framings> {
    pub(crate) ubrr: u16,
    pub(crate) ucsrc: u8,
    pub(crate) is_ascii: bool,
    pub(crate) data_bits: u8,
    /// Ticks from the moment in which a character is taken from the USART to the end of the silence
    /// that completes a frame; in ASCII a fortieth of a second.
    pub(crate) to_complete: u16,
    pub(crate) kept: Kept,
    pub(crate) delays: F::Delays,
    framings: PhantomData<F>,
}

/// What of it is looked up later.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Kept {
    pub(crate) ucsra: u8,
    /// Ticks from there to the judgement; 0 where that is what completes a frame.
    pub(crate) to_stand: u16,
    /// Ticks from there to t3.5.
    pub(crate) to_start: u16,
    /// Ticks of one character.
    pub(crate) character: u16,
    /// Ticks of t3.5.
    pub(crate) t3_5: u16,
}

/// What an answer waits for, in ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Delays {
    /// From DE to the first start bit.
    pub(crate) lead: u16,
    /// From t3.5 to DE.
    pub(crate) response: u32,
}

impl<F: Framings> Settings<F> {
    /// Settings for `config` at a CPU clock of `clock_hz` (8 to 20 MHz).
    ///
    /// RXC is set with sample 10 of the first stop bit, at double speed with sample 6 of 8 (DS 20.8.2), and
    /// sample 1 is at most one sample late. The most that can be left of the character is added, rounded
    /// up, and the least that the interrupts need is taken off: no interval is ever cut short.
    ///
    /// # Errors
    /// [`LineError::Delay`] for an answer that has to wait on a line that has no [`Delayed`];
    /// [`LineError::Framing`] for ASCII on a line that has none, and for text; [`LineError::Format`] for RTU with seven
    /// data bits; [`LineError::Flow`] for RTS/CTS; [`LineError::Baud`] for a rate that is off by more than 2.5 % or so
    /// slow that t3.5 exceeds the 16 bits of the timer (below 1400 baud at 16 MHz).
    pub const fn new(config: &LineConfig, clock_hz: u32) -> Result<Self, LineError> {
        let tick_hz = clock_hz / PRESCALER;
        let (baud, format) = (config.baud, config.format);
        let is_ascii = matches!(config.framing, Framing::Ascii);
        if is_ascii && !F::ASCII || matches!(config.framing, Framing::Text) {
            return Err(LineError::Framing(config.framing));
        }
        if !is_ascii && format.data_bits() != 8 {
            return Err(LineError::Format(format));
        }
        if matches!(config.flow, Flow::RtsCts) {
            return Err(LineError::Flow);
        }
        if !F::Delays::ARE_THERE && (config.de_lead_us > 0 || config.response_delay_ms > 0) {
            return Err(LineError::Delay);
        }
        let divisor = match divisor(clock_hz, baud) {
            Ok(divisor) => divisor,
            Err(error) => {
                return Err(LineError::Baud {
                    nearest: error.nearest,
                });
            }
        };
        let rest_of_stop = {
            let sixteenths = 16 * (format.stop_bits() as u32 - 1) + 7;
            (sixteenths * tick_hz).div_ceil(16 * baud)
        };
        let silence = timing::t3_5(format, baud, tick_hz);
        let t1_5 = rest_of_stop + timing::t1_5(format, baud, tick_hz) - LATENCY;
        let t3_5 = rest_of_stop + silence - LATENCY;
        let character = timing::character(format, baud, tick_hz);
        if t3_5 + character > u16::MAX as u32 {
            return Err(LineError::Baud { nearest: 2400 });
        }
        let to_start = match (config.role, config.inter_character) {
            (Role::Client, InterCharacter::Strict) => (t3_5 - t1_5) / JUDGED_EARLY_CLIENT,
            _ => timing::margin(silence),
        };
        let to_complete = match config.inter_character {
            InterCharacter::Strict => t1_5,
            InterCharacter::Off | InterCharacter::Gap(_) => t3_5 - to_start,
        };
        let given = Delays {
            // 10 ms are 25 000 ticks at 20 MHz, 1 s are 2.5 million.
            lead: (config.de_lead_us as u32 * (tick_hz / 1_000) / 1_000) as u16,
            response: match config.role {
                Role::Server => config.response_delay_ms as u32 * tick_hz.div_ceil(1_000),
                Role::Client => 0,
            },
        };
        // SAFETY: `F::Delays` is `Delays`, or of no size.
        let delays = unsafe { Made { given }.wanted };
        Ok(Self {
            ubrr: divisor.ubrr,
            ucsrc: ucsrc(format),
            is_ascii,
            data_bits: format.data_bits(),
            to_complete: if is_ascii {
                tick_hz.div_ceil(40) as u16
            } else {
                to_complete as u16
            },
            kept: Kept {
                ucsra: if divisor.u2x { U2X } else { 0 },
                to_stand: (t3_5 - to_start - to_complete) as u16,
                to_start: to_start as u16,
                character: character as u16,
                t3_5: t3_5 as u16,
            },
            delays,
            framings: PhantomData,
        })
    }
}

/// Contents of UCSR0C (DS 20.11.4): parity in bits 5 and 4, stop bits in bit 3, data bits in 2 and 1.
const fn ucsrc(format: LineFormat) -> u8 {
    let parity = match format.parity() {
        Parity::None => 0b00,
        Parity::Even => 0b10,
        Parity::Odd => 0b11,
    };
    let stop = format.stop_bits() - 1;
    let size = format.data_bits() - 5;
    parity << 4 | stop << 3 | size << 1
}
