//! From a [`LineConfig`] to register contents and timer ticks, at compile time or at run time.

use multidrop::line::{LineConfig, LineError, Role};
use multidrop::protocol::format::{Framing, LineFormat, Parity};
use multidrop::protocol::port_registers::Flow;
use multidrop::protocol::timing::{Intervals, Sight};

use super::baud;

/// Bits of CR1 (RM0090 30.6.4).
pub(crate) const OVER8: u16 = 1 << 15;
const M: u16 = 1 << 12;
const PCE: u16 = 1 << 10;
const PS: u16 = 1 << 9;

/// STOP of CR2 (RM0090 30.6.5): two stop bits.
const STOP_2: u16 = 0b10 << 12;

/// A client judges a frame before t3.5 by this part of the time from t1.5 to t3.5: 250 us above 19200 baud. The client makes its
/// next request in that time.
const JUDGED_EARLY_CLIENT: u32 = 4;

/// All values of a line that follow from its configuration and the clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    pub(crate) brr: u16,
    /// Format and oversampling.
    pub(crate) cr1: u16,
    /// The stop bits of CR2.
    pub(crate) cr2: u16,
    /// The data bits of a received word, as a mask.
    pub(crate) data: u8,
    /// The bits that are added to a byte that is sent, and must be set in a byte that is received.
    pub(crate) mark: u8,
    pub(crate) framing: Framing,
    pub(crate) rts_cts: bool,
    /// For how long the peer may hold back a character.
    pub(crate) cts_timeout_ms: u16,
    /// The intervals of the line, in ticks of the ports' timer.
    pub(crate) intervals: Intervals,
    /// The value of the register DE_LEAD.
    pub(crate) de_lead_us: u16,
    /// RESPONSE_DELAY, or 0 where the port is a client.
    pub(crate) response_delay_ms: u16,
}

impl Settings {
    /// The settings of a port that is not set up yet.
    pub(crate) const NONE: Settings = Settings {
        brr: 0,
        cr1: 0,
        cr2: 0,
        data: 0,
        mark: 0,
        framing: Framing::Rtu,
        rts_cts: false,
        cts_timeout_ms: 0,
        intervals: Intervals::NONE,
        de_lead_us: 0,
        response_delay_ms: 0,
    };

    /// Data bits of a character.
    pub(crate) const fn data_bits(&self) -> u8 {
        if self.data == 0x7F { 7 } else { 8 }
    }

    /// Checks that the rate `baud` of these settings is within 2.5 %, if the clock may be off by `clock_ppm` parts per million.
    ///
    /// # Errors
    /// [`LineError::Baud`] if the rate is off by more.
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

    /// Settings for `config`, for a USART with a clock of `clock_hz` (up to 100 MHz) and a timer with a clock of `tick_hz` (up to
    /// 55 MHz).
    ///
    /// RXNE is set with the samples of the stop bit, of the first one of two: not before sample 8 of 16, or 4 of 8 (RM0090 30.3.3;
    /// for two stop bits the manual has the end of the first). The most that can be left of the character is added, rounded up, so
    /// that no interval is ever cut short.
    ///
    /// # Errors
    /// [`LineError::Format`] for RTU with seven data bits; [`LineError::Baud`] for a rate over 2 Mbaud, off by more than 2.5 %, or
    /// too slow for the divider (641 baud at 42 MHz).
    pub const fn new(config: &LineConfig, clock_hz: u32, tick_hz: u32) -> Result<Self, LineError> {
        let (baud, format) = (config.baud, config.format);
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
        let sight = Sight {
            tick_hz,
            rest: if divisor.over8 { 10 } else { 9 } + if bits.cr2 == STOP_2 { 16 } else { 0 },
            latency: 0,
            client_part: JUDGED_EARLY_CLIENT,
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
            intervals: Intervals::new(config, &sight),
            de_lead_us: config.de_lead_us,
            response_delay_ms: match config.role {
                Role::Server => config.response_delay_ms,
                Role::Client => 0,
            },
        })
    }
}

/// A character format in the registers of the USART. The USART's word has 8 or 9 bits, parity included (RM0090 30.6.4, M). So seven
/// bits with parity are a word of 8 bits. Seven bits without parity and with two stop bits are eight bits, of which the last is
/// always one.
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

/// Compares the formats with RM0090 30.3.7, frame formats: M and PCE, then PS, and STOP of CR2; the data bits, and the bit that is
/// always one. A difference stops the build.
const _: () = {
    let expected = [
        (LineFormat::F8N1, 0x0000, 0x0000, 0xFF, 0x00),
        (LineFormat::F8E1, 0x1400, 0x0000, 0xFF, 0x00),
        (LineFormat::F8O1, 0x1600, 0x0000, 0xFF, 0x00),
        (LineFormat::F8N2, 0x0000, 0x2000, 0xFF, 0x00),
        (LineFormat::F7E1, 0x0400, 0x0000, 0x7F, 0x00),
        (LineFormat::F7O1, 0x0600, 0x0000, 0x7F, 0x00),
        (LineFormat::F7N2, 0x0000, 0x0000, 0x7F, 0x80),
    ];
    let mut i = 0;
    while i < expected.len() {
        let (format, cr1, cr2, data, mark) = expected[i];
        let made = made(38_400, Framing::Ascii, format, 42_000_000);
        assert!(made.cr1 == cr1 && made.cr2 == cr2);
        assert!(made.data == data && made.mark == mark);
        assert!(made.data_bits() == format.data_bits());
        i += 1;
    }
    // OVER8 takes eight samples a bit.
    let fast = made(2_000_000, Framing::Rtu, LineFormat::F8N1, 16_000_000);
    assert!(fast.brr == 0x10 && fast.cr1 == OVER8);
    // The rest of a character is 9 sixteenths of its stop bit, 10 with eight samples.
    let slow = made(38_400, Framing::Rtu, LineFormat::F8N1, 42_000_000);
    assert!(slow.intervals.t3_5 == 73_500 + 616);
    assert!(fast.intervals.t3_5 == 28_000 + 5);
    // A client has a quarter of the time between t1.5 and t3.5 for its next request.
    let client = LineConfig {
        baud: 38_400,
        format: LineFormat::F8N1,
        role: Role::Client,
        ..LineConfig::DEFAULT
    };
    let client = Settings::new(&client, 42_000_000, 42_000_000);
    assert!(matches!(client, Ok(made) if made.intervals.to_start == 10_500));
    // Seven data bits are for ASCII.
    let seven = LineConfig {
        format: LineFormat::F7E1,
        ..LineConfig::DEFAULT
    };
    let seven = Settings::new(&seven, 42_000_000, 42_000_000);
    assert!(matches!(seven, Err(LineError::Format(LineFormat::F7E1))));
};

/// Settings of a server, with a timer as fast as the USART.
const fn made(baud: u32, framing: Framing, format: LineFormat, clock_hz: u32) -> Settings {
    let config = LineConfig {
        baud,
        framing,
        format,
        ..LineConfig::DEFAULT
    };
    match Settings::new(&config, clock_hz, clock_hz) {
        Ok(made) => made,
        Err(_) => panic!("the settings are good"),
    }
}
