//! From a [`LineConfig`] to register contents and timer ticks, at compile time or at run time.

use core::marker::PhantomData;

use multidrop_protocol::format::Framing;
use multidrop_protocol::line::{LineConfig, LineError, Role};
use multidrop_protocol::port_registers::Flow;
use multidrop_protocol::timing::{Intervals, Sight, first_part, further_parts, whole};

use crate::baud::{divisor, slowest};
use crate::timer1::PRESCALER;
use crate::usart0::{U2X, ucsrc};

/// Ticks that pass at least between RXC and the reading of the timer in one interrupt (26 cycles), and between the alarm and the
/// check of the start-bit detector in the other interrupt (45 cycles). 71 cycles make 8.9 ticks, of which one is left for the
/// timer's own resolution and one for good measure.
const LATENCY: u32 = 6;

/// A client judges a frame half way from t1.5 to t3.5: above 19200 baud it has 500 us to make its next request.
const JUDGED_EARLY_CLIENT: u32 = 2;

/// The framings, silences and delays that a line can be set up for, as a type. An image has no code for ASCII or slow lines if its
/// line does not use it.
pub trait Framings: 'static {
    /// Whether ASCII is among the framings; RTU always is.
    const ASCII: bool;
    /// Whether silences may be longer than Timer1's 65535 ticks, 32.7 ms at 16 MHz: t3.5 below some 1400 baud, gaps of
    /// [`InterCharacter::Gap`](multidrop_protocol::port_registers::InterCharacter::Gap) above 30 ms.
    const SLOW: bool = false;
    /// The type of DE_LEAD and RESPONSE_DELAY: [`Delays`], or `()` for a line without them.
    type Delays: Delaying;
}

/// Either [`Delays`] or `()`. Sealed.
pub trait Delaying: sealed::Sealed + Copy + core::fmt::Debug + PartialEq {
    /// Whether an answer can wait, and DE can go up before it.
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

/// Turns [`Delays`] into the wanted type, which is [`Delays`] or `()`.
union Made<D: Delaying> {
    given: Delays,
    wanted: D,
}

/// RTU and no other framing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RtuOnly {}

/// RTU or ASCII, as the line is set up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RtuAndAscii {}

/// The framings `F`, with settings that delay an answer: DE_LEAD and RESPONSE_DELAY.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Delayed<F>(PhantomData<F>);

impl<F: Framings> Framings for Delayed<F> {
    const ASCII: bool = F::ASCII;
    type Delays = Delays;
    const SLOW: bool = F::SLOW;
}

/// The framings `F`, on slow lines too: silences of any length that the settings allow.
pub struct Slow<F>(PhantomData<F>);

impl<F: Framings> Framings for Slow<F> {
    const ASCII: bool = F::ASCII;
    const SLOW: bool = true;
    type Delays = F::Delays;
}

impl Framings for RtuOnly {
    const ASCII: bool = false;
    type Delays = ();
}

impl Framings for RtuAndAscii {
    const ASCII: bool = true;
    type Delays = ();
}

/// All values of a line that follow from its configuration and the clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings<F: Framings> {
    pub(crate) ubrr: u16,
    pub(crate) ucsrc: u8,
    /// Data bits of a character, and the flag [`ASCII`].
    character: u8,
    /// The further parts of `to_complete` in the lower half, those of `kept.to_stand` in the upper half. The compiler keeps
    /// settings in RAM, so this struct has no values that follow from its others.
    parts: u8,
    /// Ticks from the moment in which a character is taken from the USART to the end of the silence
    /// that completes a frame; in ASCII a fortieth of a second.
    pub(crate) to_complete: u16,
    pub(crate) kept: Kept,
    pub(crate) delays: F::Delays,
    framings: PhantomData<F>,
}

/// The flag in `character` of [`Settings`]: the framing is ASCII.
const ASCII: u8 = 1 << 7;

/// The number of parts after the first one, for intervals that can have some, and the time to the judgement less one character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Long {
    pub(crate) to_complete: u8,
    pub(crate) to_stand: u8,
    pub(crate) to_stand_less_character: u8,
    /// The first part of the time to the judgement less one character.
    pub(crate) less_character: u16,
    pub(crate) t3_5: u8,
}

/// The settings that the line reads after its setup.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Kept {
    pub(crate) ucsra: u8,
    /// Ticks from the completion of a frame to its judgement; 0 where both are the same moment. In ASCII t3.5.
    pub(crate) to_stand: u16,
    /// Ticks from the judgement of a frame to t3.5.
    pub(crate) to_start: u16,
    /// Ticks of one character.
    pub(crate) character: u16,
    /// Ticks of t3.5.
    pub(crate) t3_5: u16,
}

/// The delays of an answer, in ticks.
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
    /// RXC is set with sample 10 of the first stop bit, at double speed with sample 6 of 8 (DS 20.8.2), and sample 1 is at most one
    /// sample late. The most that can be left of the character is added, rounded up. The least that the interrupts need is
    /// subtracted. So no interval is ever cut short.
    ///
    /// # Errors
    /// [`LineError::Delay`] for a delayed answer on a line without [`Delayed`]; [`LineError::Framing`] for ASCII on a line without
    /// ASCII, and for text; [`LineError::Format`] for RTU with seven data bits; [`LineError::Flow`] for RTS/CTS;
    /// [`LineError::Baud`] for a rate that is off by more than 2.5 %, or [too slow](crate::baud::slowest): below 154 baud at 8 MHz,
    /// 307 at 16, in ASCII twice that; [`LineError::Silence`] for t3.5 and a character over 65535 ticks without [`Slow`].
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
        let sight = Sight {
            tick_hz,
            rest: 16 * (format.stop_bits() as u32 - 1) + 7,
            latency: LATENCY,
            client_part: JUDGED_EARLY_CLIENT,
        };
        let intervals = Intervals::new(config, &sight);
        let (character, t3_5) = (intervals.character, intervals.t3_5);
        let slowest = slowest(clock_hz, format.character_bits() as u32, is_ascii);
        if baud < slowest {
            return Err(LineError::Baud { nearest: slowest });
        }
        if !F::SLOW && t3_5 + character > u16::MAX as u32 {
            return Err(LineError::Silence);
        }
        let given = Delays {
            // 10 ms are 25 000 ticks at 20 MHz, 1 s are 2.5 million.
            lead: (config.de_lead_us as u32 * (tick_hz / 1_000) / 1_000) as u16,
            response: match config.role {
                Role::Server => config.response_delay_ms as u32 * tick_hz.div_ceil(1_000),
                Role::Client => 0,
            },
        };
        // SAFETY: `F::Delays` is `Delays`, or `()`, which has no bytes.
        let delays = unsafe { Made { given }.wanted };
        let to_complete = intervals.to_complete;
        let to_stand = if is_ascii { t3_5 } else { intervals.to_stand() };
        Ok(Self {
            ubrr: divisor.ubrr,
            ucsrc: ucsrc(format),
            character: format.data_bits() | if is_ascii { ASCII } else { 0 },
            parts: further_parts(to_complete) | further_parts(to_stand) << 4,
            to_complete: first_part(to_complete),
            kept: Kept {
                ucsra: if divisor.u2x { U2X } else { 0 },
                to_stand: first_part(to_stand),
                to_start: intervals.to_start as u16,
                character: character as u16,
                t3_5: first_part(t3_5),
            },
            delays,
            framings: PhantomData,
        })
    }

    pub(crate) const fn is_ascii(&self) -> bool {
        self.character & ASCII != 0
    }

    pub(crate) const fn data_bits(&self) -> u8 {
        self.character & !ASCII
    }

    /// The additional values that a slow line keeps.
    pub(crate) const fn long(&self) -> Long {
        let (of_complete, of_stand) = (self.parts & 0x0F, self.parts >> 4);
        let kept = &self.kept;
        let to_stand = whole(kept.to_stand, of_stand);
        let t3_5 = if self.is_ascii() {
            to_stand
        } else {
            whole(self.to_complete, of_complete) + to_stand + kept.to_start as u32
        };
        let less_character = to_stand.saturating_sub(kept.character as u32);
        Long {
            to_complete: of_complete,
            to_stand: of_stand,
            to_stand_less_character: further_parts(less_character),
            less_character: first_part(less_character),
            t3_5: further_parts(t3_5),
        }
    }
}
