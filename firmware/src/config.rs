//! The configuration of a port, fixed and checked at compile time.

use multidrop_protocol::format::{Framing, LineFormat};
use multidrop_protocol::message::Message;
use multidrop_protocol::port_registers::{Duplex, Flow, Mode, PortSettings};
use multidrop_protocol::registers::{Bank, CoilBank};

use crate::client::ClientConfig;
use crate::line::{InterCharacter, LineConfig};

/// Configuration of one port, built in a `const`: a wrong value stops the build with a message that
/// names port, field and value. Fields are named after the registers `MB_xxx` of a
/// [managed port](crate::managed), which begins with them; each is checked against those set before it.
///
/// ```
/// use multidrop::PortConfig;
/// const PORT: PortConfig = PortConfig::new("RS4").slave_id(17).baud(38_400);
/// ```
///
/// ```compile_fail
/// # use multidrop::PortConfig;
/// // error: port RS4: slave_id is 248, must be 1..=247
/// const PORT: PortConfig = PortConfig::new("RS4").slave_id(248);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct PortConfig {
    name: &'static str,
    settings: PortSettings,
}

impl PortConfig {
    /// A slave with unit id 1 at 19200 baud 8E1, the standard's default (SER 2.5.1).
    ///
    /// `name` appears in messages, such as `"RS4"`.
    pub const fn new(name: &'static str) -> Self {
        Self {
            name,
            settings: PortSettings::DEFAULT,
        }
    }

    /// Master, slave, sniffer, or off.
    ///
    /// # Panics
    /// At compile time, with port and value, for a slave whose `slave_id` is 0, and for a master or slave with
    /// framing text.
    pub const fn mode(mut self, mode: Mode) -> Self {
        if matches!(mode, Mode::Slave) && self.settings.slave_id == 0 {
            self.wrong("slave_id", 0, "must be 1..=247 for a slave", None);
        }
        self.settings.mode = mode;
        self.check_text()
    }

    /// A client, in place of a server: mode master. `slave_id` is that of the slave it asks.
    pub const fn client(self) -> Self {
        self.mode(Mode::Master)
    }

    /// The unit id that a slave answers to: 1..=247 (SER 2.2). Of a master the unit that it asks: 0..=247, 0
    /// for a broadcast.
    ///
    /// # Panics
    /// At compile time, with port and value, if it is out of range.
    pub const fn slave_id(mut self, id: u32) -> Self {
        match self.settings.mode {
            Mode::Slave if id < 1 || id > 247 => {
                self.wrong("slave_id", id, "must be 1..=247", None);
            }
            _ if id > 247 => self.wrong("slave_id", id, "must be 0..=247", None),
            _ => {}
        }
        self.settings.slave_id = id as u8;
        self
    }

    /// The address of the first item of the port's dense arrays. Set it before [`bank`](Self::bank) and
    /// [`coil_bank`](Self::coil_bank).
    ///
    /// # Panics
    /// At compile time, with port and value, above 65535.
    pub const fn base(mut self, base: u32) -> Self {
        if base > 65_535 {
            self.wrong("base", base, "must be 0..=65535", None);
        }
        self.settings.base = base as u16;
        self
    }

    /// How long a master waits for the beginning of an answer, in ms.
    ///
    /// # Panics
    /// At compile time, with port and value, outside of 1..=65535.
    pub const fn timeout_ms(mut self, ms: u32) -> Self {
        if ms < 1 || ms > 65_535 {
            self.wrong("timeout_ms", ms, "must be 1..=65535", None);
        }
        self.settings.timeout_ms = ms as u16;
        self
    }

    /// How often a master asks again.
    ///
    /// # Panics
    /// At compile time, with port and value, above 255.
    pub const fn retries(mut self, retries: u32) -> Self {
        if retries > 255 {
            self.wrong("retries", retries, "must be 0..=255", None);
        }
        self.settings.retries = retries as u8;
        self
    }

    /// How long a master sends nothing after a broadcast, in ms (SER 2.4.1).
    ///
    /// # Panics
    /// At compile time, with port and value, above 65535.
    pub const fn turnaround_ms(mut self, ms: u32) -> Self {
        if ms > 65_535 {
            self.wrong("turnaround_ms", ms, "must be 0..=65535", None);
        }
        self.settings.turnaround_ms = ms as u16;
        self
    }

    /// How long after a timeout an answer is still told from those to later requests, in ms; 0 is the timeout.
    ///
    /// # Panics
    /// At compile time, with port and value, above 65535.
    pub const fn late_guard_ms(mut self, ms: u32) -> Self {
        if ms > 65_535 {
            self.wrong("late_guard_ms", ms, "must be 0..=65535", None);
        }
        self.settings.late_guard_ms = ms as u16;
        self
    }

    /// How long a master sends nothing after an answer, in ms: for units that need a pause.
    ///
    /// # Panics
    /// At compile time, with port and value, above 65535.
    pub const fn request_gap_ms(mut self, ms: u32) -> Self {
        if ms > 65_535 {
            self.wrong("request_gap_ms", ms, "must be 0..=65535", None);
        }
        self.settings.request_gap_ms = ms as u16;
        self
    }

    /// Bits per second. Whether the clock makes it is checked by the board.
    ///
    /// # Panics
    /// At compile time, with port and value, below 300 or above 10 000 000.
    pub const fn baud(mut self, baud: u32) -> Self {
        if baud < PortSettings::BAUD.0 || baud > PortSettings::BAUD.1 {
            self.wrong("baud", baud, "must be 300..=10000000", None);
        }
        self.settings.line.baud = baud;
        self
    }

    /// RTU or ASCII, or text for a sniffer that prints. Set it before the format: seven data bits are not for
    /// RTU.
    ///
    /// # Panics
    /// At compile time, with port and value, for RTU with a format of 7 data bits, and for text with a mode that
    /// is master or slave.
    pub const fn framing(mut self, framing: Framing) -> Self {
        self.settings.line.framing = framing;
        self.check_text().check_data_bits()
    }

    /// Character format. RTU needs 8 data bits (SER 2.5.1), ASCII has 7E1 as default (SER 2.5.2).
    ///
    /// # Panics
    /// At compile time, with port and value, for a format of 7 data bits with RTU.
    pub const fn format(mut self, format: LineFormat) -> Self {
        self.settings.line.format = format;
        self.check_data_bits()
    }

    const fn check_text(self) -> Self {
        if matches!(self.settings.line.framing, Framing::Text) && self.settings.mode.talks() {
            self.wrong(
                "framing",
                2,
                "must be 0 (RTU) or 1 (ASCII) for a master or a slave",
                None,
            );
        }
        self
    }

    const fn check_data_bits(self) -> Self {
        let line = self.settings.line;
        if matches!(line.framing, Framing::Rtu) && line.format.data_bits() != 8 {
            self.wrong(
                "format: data bits",
                line.format.data_bits() as u32,
                "must be 8 for RTU",
                None,
            );
        }
        self
    }

    /// Half or full duplex. Whether the port is wired so is checked by the board.
    pub const fn duplex(mut self, duplex: Duplex) -> Self {
        self.settings.line.duplex = duplex;
        self
    }

    /// Hardware flow control. Whether the chip has it is checked by the board.
    pub const fn flow(mut self, flow: Flow) -> Self {
        self.settings.line.flow = flow;
        self
    }

    /// What ends an RTU frame, and which gaps it may have inside.
    ///
    /// # Panics
    /// At compile time, with port and value, for a gap outside of 2..=50 ms.
    pub const fn inter_character(mut self, rule: InterCharacter) -> Self {
        if let InterCharacter::Gap(ms) = rule {
            let ms = ms as u32;
            if ms < InterCharacter::GAP.0 || ms > InterCharacter::GAP.1 {
                self.wrong("inter_character gap", ms, "must be 2..=50 ms", None);
            }
        }
        self.settings.line.inter_character = rule;
        self
    }

    /// How long a frame waits for CTS before it is dropped, in ms. Without RTS/CTS it has no effect.
    ///
    /// # Panics
    /// At compile time, with port and value, outside of 1..=65535.
    pub const fn cts_timeout_ms(mut self, ms: u32) -> Self {
        if ms < PortSettings::CTS_TIMEOUT.0 || ms > PortSettings::CTS_TIMEOUT.1 {
            self.wrong("cts_timeout_ms", ms, "must be 1..=65535", None);
        }
        self.settings.line.cts_timeout_ms = ms as u16;
        self
    }

    /// How long DE is up before the first start bit, in us: for transceivers and repeaters that need time to turn on. DE goes up at
    /// t3.5.
    ///
    /// # Panics
    /// At compile time, with port and value, above 10000.
    pub const fn de_lead_us(mut self, us: u32) -> Self {
        if us > PortSettings::DE_LEAD.1 {
            self.wrong("de_lead_us", us, "must be 0..=10000", None);
        }
        self.settings.line.de_lead_us = us as u16;
        self
    }

    /// How long a slave's answer waits after t3.5, in ms: for masters that let go of the bus late.
    ///
    /// # Panics
    /// At compile time, with port and value, above 1000.
    pub const fn response_delay_ms(mut self, ms: u32) -> Self {
        if ms > PortSettings::RESPONSE_DELAY.1 {
            self.wrong("response_delay_ms", ms, "must be 0..=1000", None);
        }
        self.settings.line.response_delay_ms = ms as u16;
        self
    }

    /// `N` registers from `base` on.
    ///
    /// # Panics
    /// At compile time, with port and value, if they run past address 65535.
    pub const fn bank<const N: usize>(&self) -> Bank<N> {
        self.check_end(N as u32, " registers");
        Bank::new(self.settings.base)
    }

    /// `count` coils from `base` on, in `BYTES` bytes.
    ///
    /// # Panics
    /// At compile time, with port and value, if they run past address 65535, or there are none, or more than
    /// there are bits.
    pub const fn coil_bank<const BYTES: usize>(&self, count: u16) -> CoilBank<BYTES> {
        self.check_end(count as u32, " coils");
        CoilBank::new(self.settings.base, count)
    }

    const fn check_end(&self, count: u32, items: &str) {
        let base = self.settings.base as u32;
        if count > 65_536 - base {
            Message::new()
                .text("port ")
                .text(self.name)
                .text(": base is ")
                .number(base)
                .text(", must be at most ")
                .number(65_536_u32.saturating_sub(count))
                .text(" for ")
                .number(count)
                .text(items)
                .fail();
        }
    }

    /// The port's name.
    pub const fn name(&self) -> &'static str {
        self.name
    }

    /// The unit id of a slave, or of the slave that a master asks.
    pub const fn unit(&self) -> u8 {
        self.settings.slave_id
    }

    /// All settings.
    pub const fn settings(&self) -> &PortSettings {
        &self.settings
    }

    /// The line settings.
    pub const fn line(&self) -> LineConfig {
        LineConfig::of(self.settings.mode, &self.settings.line)
    }

    /// How long the port's client waits, and how often it tries.
    pub const fn times(&self) -> ClientConfig {
        client_config(&self.settings)
    }

    /// Stops the build: `port NAME: FIELD is VALUE, RULE`, and `, nearest is N` if there is one. For the
    /// checks of a board, such as a baud that its clock does not make.
    pub const fn wrong(&self, field: &str, value: u32, rule: &str, nearest: Option<u32>) -> ! {
        let message = Message::new()
            .text("port ")
            .text(self.name)
            .text(": ")
            .text(field)
            .text(" is ")
            .number(value)
            .text(", ")
            .text(rule);
        match nearest {
            Some(nearest) => message.text(", nearest is ").number(nearest).fail(),
            None => message.fail(),
        }
    }
}

/// The times of a client with these settings.
pub(crate) const fn client_config(settings: &PortSettings) -> ClientConfig {
    ClientConfig::new()
        .timeout_ms(settings.timeout_ms)
        .retries(settings.retries)
        .turnaround_ms(settings.turnaround_ms)
        .late_guard_ms(settings.late_guard_ms)
        .request_gap_ms(settings.request_gap_ms)
}
