//! From a [`LineConfig`] to register contents and timer ticks, at compile time or at run time.

use multidrop::line::{InterCharacter, LineConfig, LineError, Role};
use multidrop::protocol::format::{Framing, LineFormat, Parity};
use multidrop::protocol::port_registers::Flow;
use multidrop::protocol::timing;

use super::baud;

/// Bits of CR1 (RM0090 30.6.4).
pub(crate) const OVER8: u16 = 1 << 15;
const M: u16 = 1 << 12;
const PCE: u16 = 1 << 10;
const PS: u16 = 1 << 9;

/// STOP of CR2 (RM0090 30.6.5): two stop bits.
const STOP_2: u16 = 0b10 << 12;

/// A client judges a frame this part of the time from t1.5 to t3.5 before t3.5: 250 us above 19200 baud, in
/// which it makes its next request.
const JUDGED_EARLY_CLIENT: u32 = 4;

/// Everything about a line that depends on its configuration and the clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    pub(crate) brr: u16,
    /// Format and oversampling.
    pub(crate) cr1: u16,
    /// Stop bits.
    pub(crate) cr2: u16,
    /// What of a received word is data.
    pub(crate) data: u8,
    /// What is added to a byte that is sent, and must be in one that is received.
    pub(crate) mark: u8,
    pub(crate) framing: Framing,
    pub(crate) rts_cts: bool,
    /// For how long the peer may hold a character.
    pub(crate) cts_timeout_ms: u16,
    /// Ticks from the moment in which a character is taken from the USART to the end of the silence that
    /// completes a frame; in ASCII a fortieth of a second.
    pub(crate) to_complete: u32,
    /// Ticks from the judgement of a frame to t3.5.
    pub(crate) to_start: u32,
    /// Ticks of one character.
    pub(crate) character: u32,
    /// Ticks of t3.5.
    pub(crate) t3_5: u32,
    /// DE_LEAD.
    pub(crate) de_lead_us: u16,
    /// RESPONSE_DELAY, where the port answers.
    pub(crate) response_delay_ms: u16,
}

impl Settings {
    /// Nothing set up yet.
    pub(crate) const NONE: Settings = Settings {
        brr: 0,
        cr1: 0,
        cr2: 0,
        data: 0,
        mark: 0,
        framing: Framing::Rtu,
        rts_cts: false,
        cts_timeout_ms: 0,
        to_complete: 0,
        to_start: 0,
        character: 0,
        t3_5: 0,
        de_lead_us: 0,
        response_delay_ms: 0,
    };

    /// Data bits of a character.
    pub(crate) const fn data_bits(&self) -> u8 {
        if self.data == 0x7F { 7 } else { 8 }
    }

    /// Ticks from the moment that completes an RTU frame to its judgement; 0 where they are the same.
    #[inline(always)]
    pub(crate) const fn silence_to_stand(&self) -> u32 {
        self.t3_5 - self.to_start - self.to_complete
    }

    /// Whether the rate `baud`, which these are for, is within 2.5 % if the clock may be off by `clock_ppm` parts per million.
    ///
    /// # Errors
    /// [`LineError::Baud`].
    pub(crate) const fn check_clock(
        &self,
        clock_hz: u32,
        baud: u32,
        clock_ppm: u32,
    ) -> Result<(), LineError> {
        let divisor = baud::Divisor {
            brr: self.brr,
            over8: self.cr1 & OVER8 != 0,
        };
        match divisor.check(clock_hz, baud, clock_ppm) {
            Ok(()) => Ok(()),
            Err(error) => Err(LineError::Baud {
                nearest: error.nearest,
            }),
        }
    }

    /// Settings for `config`, for a USART with a clock of `clock_hz` (up to 100 MHz) and a timer with one of
    /// `tick_hz` (up to 55 MHz).
    ///
    /// RXNE is set with the samples of the stop bit, of the first where there are two: not before sample 8
    /// of 16, or 4 of 8 (RM0090 30.3.3; for two stop bits it has the end of the first). The most that can be
    /// left of the character is added, rounded up: no interval is ever cut short.
    ///
    /// # Errors
    /// [`LineError::Format`] for RTU with seven data bits; [`LineError::Baud`] for a rate over 2 Mbaud, or
    /// one that is off by more than 2.5 %, or too slow for the divider (641 baud at 42 MHz).
    pub const fn new(config: &LineConfig, clock_hz: u32, tick_hz: u32) -> Result<Self, LineError> {
        let (baud, format) = (config.baud, config.format);
        let is_ascii = matches!(config.framing, Framing::Ascii);
        if matches!(config.framing, Framing::Rtu) && format.data_bits() != 8 {
            return Err(LineError::Format(format));
        }
        let divisor = match baud::divisor(clock_hz, baud) {
            Ok(divisor) => divisor,
            Err(error) => {
                return Err(LineError::Baud {
                    nearest: error.nearest,
                });
            }
        };
        let bits = Bits::of(format);
        let rest_of_stop = {
            let sixteenths =
                if divisor.over8 { 10 } else { 9 } + if bits.cr2 == STOP_2 { 16 } else { 0 };
            (sixteenths * tick_hz).div_ceil(16 * baud)
        };
        let mut silence = timing::t3_5(format, baud, tick_hz);
        if let InterCharacter::Gap(ms) = config.inter_character {
            let gap = timing::gap(ms, tick_hz);
            if gap > silence {
                silence = gap;
            }
        }
        let t1_5 = rest_of_stop + timing::t1_5(format, baud, tick_hz);
        let t3_5 = rest_of_stop + silence;
        let to_start = match (config.role, config.inter_character) {
            (Role::Client, InterCharacter::Strict) => (t3_5 - t1_5) / JUDGED_EARLY_CLIENT,
            _ => timing::margin(silence),
        };
        let to_complete = match config.inter_character {
            InterCharacter::Strict => t1_5,
            InterCharacter::Off | InterCharacter::Gap(_) => t3_5 - to_start,
        };
        Ok(Self {
            brr: divisor.brr,
            cr1: bits.cr1 | if divisor.over8 { OVER8 } else { 0 },
            cr2: bits.cr2,
            data: bits.data,
            mark: bits.mark,
            framing: config.framing,
            rts_cts: matches!(config.flow, Flow::RtsCts),
            cts_timeout_ms: config.cts_timeout_ms,
            to_complete: if is_ascii {
                tick_hz.div_ceil(40)
            } else {
                to_complete
            },
            to_start,
            character: timing::character(format, baud, tick_hz),
            t3_5,
            de_lead_us: config.de_lead_us,
            response_delay_ms: match config.role {
                Role::Server => config.response_delay_ms,
                Role::Client => 0,
            },
        })
    }
}

/// A character format in the registers of the USART. Its word is 8 or 9 bits with parity counted in
/// (RM0090 30.6.4, M), so that seven bits and parity are a word of 8, and seven bits without parity and two
/// stop bits are eight of which the last is always one.
struct Bits {
    cr1: u16,
    cr2: u16,
    data: u8,
    mark: u8,
}

impl Bits {
    const fn of(format: LineFormat) -> Self {
        let seven = format.data_bits() == 7;
        let parity = match format.parity() {
            Parity::None => 0,
            Parity::Even => PCE,
            Parity::Odd => PCE | PS,
        };
        let nine = if parity != 0 && !seven { M } else { 0 };
        let marked = seven && parity == 0;
        Self {
            cr1: parity | nine,
            cr2: if format.stop_bits() == 2 && !marked {
                STOP_2
            } else {
                0
            },
            data: if seven { 0x7F } else { 0xFF },
            mark: if marked { 0x80 } else { 0 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: LineConfig = LineConfig {
        baud: 38_400,
        framing: Framing::Ascii,
        format: LineFormat::F8N1,
        inter_character: InterCharacter::Strict,
        flow: Flow::None,
        role: Role::Server,
        ..LineConfig::DEFAULT
    };
    const CLOCK_HZ: u32 = 42_000_000;

    fn settings(config: LineConfig) -> Settings {
        Settings::new(&config, CLOCK_HZ, CLOCK_HZ).unwrap()
    }

    #[test]
    fn formats_are_those_of_the_frame_format_table() {
        // RM0090 30.3.7, frame formats: M and PCE, then PS, and STOP of CR2.
        let expected = [
            (LineFormat::F8N1, 0x0000, 0x0000, 0xFF, 0x00),
            (LineFormat::F8E1, 0x1400, 0x0000, 0xFF, 0x00),
            (LineFormat::F8O1, 0x1600, 0x0000, 0xFF, 0x00),
            (LineFormat::F8N2, 0x0000, 0x2000, 0xFF, 0x00),
            (LineFormat::F7E1, 0x0400, 0x0000, 0x7F, 0x00),
            (LineFormat::F7O1, 0x0600, 0x0000, 0x7F, 0x00),
            (LineFormat::F7N2, 0x0000, 0x0000, 0x7F, 0x80),
        ];
        for (format, cr1, cr2, data, mark) in expected {
            let made = settings(LineConfig { format, ..CONFIG });
            assert_eq!(
                (made.cr1, made.cr2, made.data, made.mark),
                (cr1, cr2, data, mark),
                "{}",
                format.name()
            );
            assert_eq!(made.data_bits(), format.data_bits());
        }
    }

    #[test]
    fn seven_data_bits_are_for_ascii() {
        let config = LineConfig {
            framing: Framing::Rtu,
            format: LineFormat::F7E1,
            ..CONFIG
        };
        assert_eq!(
            Settings::new(&config, CLOCK_HZ, CLOCK_HZ),
            Err(LineError::Format(LineFormat::F7E1))
        );
    }

    #[test]
    fn eight_samples_are_set_in_cr1() {
        let config = LineConfig {
            baud: 2_000_000,
            ..CONFIG
        };
        let made = Settings::new(&config, 16_000_000, 16_000_000).unwrap();
        assert_eq!((made.brr, made.cr1), (0x10, 0x8000));
    }

    #[test]
    fn silences_worked_by_hand() {
        // At 38400 baud a bit has 1093.75 ticks; 9 sixteenths of the stop bit are left, 615.2.
        let rtu = LineConfig {
            framing: Framing::Rtu,
            ..CONFIG
        };
        let made = settings(rtu);
        assert_eq!(made.to_complete, 31_500 + 616);
        let t3_5 = 73_500 + 616;
        assert_eq!(made.t3_5, t3_5);
        assert_eq!(made.to_start, 73_500 / 24);
        assert_eq!(
            made.to_complete + made.silence_to_stand() + made.to_start,
            t3_5
        );
        assert_eq!(made.character, 10_938);
        // With two stop bits there is a whole one more.
        let made = settings(LineConfig {
            format: LineFormat::F8N2,
            ..rtu
        });
        assert_eq!(made.t3_5, 73_500 + 1_709);
        // Where gaps are allowed there is one silence, which completes and judges the frame.
        let made = settings(LineConfig {
            inter_character: InterCharacter::Off,
            ..rtu
        });
        assert_eq!(
            (made.to_complete, made.silence_to_stand()),
            (t3_5 - 73_500 / 24, 0)
        );
        // A client has a quarter of the time between t1.5 and t3.5 for its next request.
        let made = settings(LineConfig {
            role: Role::Client,
            ..rtu
        });
        assert_eq!((made.to_start, made.silence_to_stand()), (10_500, 31_500));
        assert_eq!(settings(CONFIG).to_complete, 1_050_000);
    }

    #[test]
    fn nothing_overflows_at_the_ends_of_the_range() {
        for format in LineFormat::ALL {
            for clock_hz in [CLOCK_HZ, 84_000_000] {
                for baud in [1_282, 2_400, 19_200, 19_201, 2_000_000] {
                    let config = LineConfig {
                        baud,
                        format,
                        ..CONFIG
                    };
                    let made = Settings::new(&config, clock_hz, timing::TICK_HZ_MAX).unwrap();
                    assert!(made.t3_5 > made.to_start && made.t3_5 < 1 << 28);
                }
            }
        }
    }
}
