//! What a port is set to, and what its settings may be.

use crate::format::{Framing, LineFormat};

/// What a port does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Mode {
    /// It asks: client.
    Master = 0,
    /// It answers: server.
    Slave = 1,
    /// It does neither, and leaves the bus alone.
    Off = 2,
    /// It listens to others, or with framing text prints what another port hears; it never asks or answers.
    Sniffer = 3,
}

/// How the wires of a port are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Duplex {
    /// One pair for both directions: the driver is enabled (DE) only while the port talks. RS-485.
    Half = 0,
    /// A pair for each direction, and no driver to enable. RS-232, RS-422.
    Full = 1,
}

/// Hardware flow control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Flow {
    /// None.
    None = 0,
    /// RTS and CTS.
    RtsCts = 1,
}

/// What ends an RTU frame, and which gaps it may have inside (SER 2.5.1.1). ASCII has a rule of its own: up to a second
/// between characters (SER 2.5.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InterCharacter {
    /// The standard: a silence of t3.5 ends a frame; one with a gap of more than t1.5 is dropped and counted.
    Strict,
    /// A silence of t3.5, less [the margin for two clocks](crate::timing::margin), ends a frame, and shorter gaps do no harm.
    Off,
    /// A silence of so many ms ends a frame, 2..=50, and shorter gaps do no harm: for peers behind USB adapters,
    /// which pause for 16 ms inside frames. Where t3.5 is longer, t3.5 ends it.
    Gap(u8),
}

impl InterCharacter {
    /// Bounds of [`Gap`](Self::Gap) in ms, both ends included.
    pub const GAP: (u32, u32) = (2, 50);
}

/// The line of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineSettings {
    /// Bits per second.
    pub baud: u32,
    /// RTU, ASCII, or text.
    pub framing: Framing,
    /// Data bits, parity and stop bits.
    pub format: LineFormat,
    /// How the wires are used.
    pub duplex: Duplex,
    /// Hardware flow control.
    pub flow: Flow,
    /// What ends an RTU frame.
    pub inter_character: InterCharacter,
    /// CTS_TIMEOUT: how long a frame waits for CTS, 1..=65535 ms.
    pub cts_timeout_ms: u16,
    /// DE_LEAD: between DE and the first start bit, 0..=10000 us.
    pub de_lead_us: u16,
    /// RESPONSE_DELAY: how long a slave's answer waits after t3.5, 0..=1000 ms.
    pub response_delay_ms: u16,
}

/// The settings of a port that registers begin with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PortSettings {
    /// MODE.
    pub mode: Mode,
    /// BASE.
    pub base: u16,
    /// SLAVEID: 1..=247 for a slave, 0..=247 for a master.
    pub slave_id: u8,
    /// TIMEOUT, 1..=65535 ms.
    pub timeout_ms: u16,
    /// RETRIES.
    pub retries: u8,
    /// TURNAROUND.
    pub turnaround_ms: u16,
    /// LATE_GUARD, 0 for [`timeout_ms`](Self::timeout_ms).
    pub late_guard_ms: u16,
    /// REQUEST_GAP.
    pub request_gap_ms: u16,
    /// BAUD, FRAMING, FORMAT, DUPLEX, FLOW, INTER_CHARACTER, CTS_TIMEOUT, DE_LEAD, RESPONSE_DELAY.
    pub line: LineSettings,
}

impl Mode {
    /// Whether it takes part in transactions, for which [`Framing::Text`] is of no use.
    pub const fn talks(self) -> bool {
        matches!(self, Mode::Master | Mode::Slave)
    }
}

impl PortSettings {
    /// BAUD, both ends included. What the clock makes of it is the board's business.
    pub const BAUD: (u32, u32) = (300, 10_000_000);
    /// TIMEOUT in ms.
    pub const TIMEOUT: (u32, u32) = (1, 65_535);
    /// CTS_TIMEOUT in ms.
    pub const CTS_TIMEOUT: (u32, u32) = (1, 65_535);
    /// DE_LEAD in us.
    pub const DE_LEAD: (u32, u32) = (0, 10_000);
    /// RESPONSE_DELAY in ms.
    pub const RESPONSE_DELAY: (u32, u32) = (0, 1000);

    /// A slave with id 1 at 19200 baud 8E1, the standard's default (SER 2.5.1); as a master a timeout of one second, no
    /// retries, and 100 ms after a broadcast (SER 2.4.1).
    pub const DEFAULT: PortSettings = PortSettings {
        mode: Mode::Slave,
        base: 0,
        slave_id: 1,
        timeout_ms: 1000,
        retries: 0,
        turnaround_ms: 100,
        late_guard_ms: 0,
        request_gap_ms: 0,
        line: LineSettings {
            baud: 19_200,
            framing: Framing::Rtu,
            format: LineFormat::F8E1,
            duplex: Duplex::Half,
            flow: Flow::None,
            inter_character: InterCharacter::Strict,
            cts_timeout_ms: 1000,
            de_lead_us: 0,
            response_delay_ms: 0,
        },
    };
}

/// STATUS: how the transaction under way stands, or how the last one ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Status {
    /// None is under way; the last one ended well, or with an exception: see ERROR.
    Idle = 0,
    /// The request is being sent, or waits for a silence.
    Transmitting = 1,
    /// The answer is being waited for.
    Receiving = 2,
    /// An answer with another function code was the last thing heard before the timeout.
    WrongFunction = 3,
    /// An answer from another slave was.
    WrongSlave = 4,
    /// A damaged frame was.
    WrongCrc = 5,
    /// Nothing of the kind was heard.
    Timeout = 6,
    /// The request cannot be made: a read from slave id 0.
    InvalidRequest = 7,
}
