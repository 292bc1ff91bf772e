//! The settings of a line.

use crate::format::{Framing, LineFormat};
use crate::port_registers::{Flow, InterCharacter, LineSettings, Mode, PortSettings};

/// The part of a line in a transaction. It determines when a frame is judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// [As close to t3.5 as two clocks allow](crate::timing::margin): a late part of a frame voids the frame, and a character that
    /// begins at t3.5 begins the request of a client.
    Server,
    /// Earlier by a [part](crate::timing::Sight::client_part) of t1.5 to t3.5, so that there is time to make the next request,
    /// which starts at t3.5. No other node begins to send by itself. A node that does so before t3.5 holds the request back.
    Client,
}

/// The settings that a line gets, at start or later.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineConfig {
    /// Bits per second.
    pub baud: u32,
    /// RTU, ASCII, or text. Text is sent as it is, without a check.
    pub framing: Framing,
    /// Data bits, parity and stop bits of a character: eight data bits for RTU (SER 2.5.1), any number for ASCII (SER 2.5.2 has 7E1
    /// as default).
    pub format: LineFormat,
    /// The rule for gaps inside a frame. ASCII has its own rule: gaps up to a second (SER 2.5.2).
    pub inter_character: InterCharacter,
    /// Hardware flow control: with RTS/CTS the line sends nothing until the peer allows it.
    pub flow: Flow,
    /// Whether the line begins a transaction or answers.
    pub role: Role,
    /// With RTS/CTS: how long a frame waits for CTS before it is dropped, 1..=65535 ms.
    pub cts_timeout_ms: u16,
    /// How long DE is up before the first start bit, 0..=10000 us.
    pub de_lead_us: u16,
    /// How long a server's answer waits after t3.5, 0..=1000 ms.
    pub response_delay_ms: u16,
}

impl LineConfig {
    /// A server with the [default settings](PortSettings::DEFAULT).
    pub const DEFAULT: LineConfig = Self::of(Mode::Slave, &PortSettings::DEFAULT.line);

    /// The settings of a line for a port with this mode and these settings.
    pub const fn of(mode: Mode, line: &LineSettings) -> LineConfig {
        LineConfig {
            baud: line.baud,
            framing: line.framing,
            format: line.format,
            inter_character: line.inter_character,
            flow: line.flow,
            role: match mode {
                Mode::Master => Role::Client,
                Mode::Slave | Mode::Sniffer | Mode::Off => Role::Server,
            },
            cts_timeout_ms: line.cts_timeout_ms,
            de_lead_us: line.de_lead_us,
            response_delay_ms: line.response_delay_ms,
        }
    }
}

/// A [`LineConfig`] that the chip cannot do. The caller's error; the line keeps its settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LineError {
    /// The clock does not make this rate within 2.5 %.
    Baud {
        /// The nearest rate that the clock makes.
        nearest: u32,
    },
    /// The USART has no such character format, or the framing cannot use it: RTU needs eight data bits.
    Format(LineFormat),
    /// The line was built without this framing.
    Framing(Framing),
    /// The port has no RTS and CTS, or was not set up with them.
    Flow,
    /// The line was built without delays before an answer (DE_LEAD, RESPONSE_DELAY).
    Delay,
    /// t3.5 at this rate, or the gap that ends a frame, is longer than the line was built to count.
    Silence,
}
