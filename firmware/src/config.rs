//! The configuration of a port, fixed and checked at compile time.

use multidrop_protocol::format::{Framing, LineFormat};
use multidrop_protocol::message::Message;

use crate::line::{InterCharacter, LineConfig, Role};

/// Configuration of one port, built in a `const`: a wrong value stops the build with a message that
/// names port, field and value.
///
/// ```
/// use multidrop_firmware::PortConfig;
/// const PORT: PortConfig = PortConfig::new("RS4").slave_id(17).baud(38_400);
/// ```
///
/// ```compile_fail
/// # use multidrop_firmware::PortConfig;
/// // error: port RS4: slave_id is 248, must be 1..=247
/// const PORT: PortConfig = PortConfig::new("RS4").slave_id(248);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct PortConfig {
    name: &'static str,
    slave_id: u8,
    line: LineConfig,
}

impl PortConfig {
    /// A slave with unit id 1 at 19200 baud 8E1, the standard's default (SER 2.5.1).
    ///
    /// `name` appears in messages, such as `"RS4"`.
    pub const fn new(name: &'static str) -> Self {
        Self {
            name,
            slave_id: 1,
            line: LineConfig {
                baud: 19_200,
                framing: Framing::Rtu,
                format: LineFormat::F8E1,
                inter_character: InterCharacter::Strict,
                role: Role::Server,
            },
        }
    }

    /// The unit id that a slave answers to: 1..=247 (SER 2.2).
    ///
    /// # Panics
    /// At compile time, with port and value, if it is out of range.
    pub const fn slave_id(mut self, id: u32) -> Self {
        if id < 1 || id > 247 {
            self.wrong("slave_id", id, "must be 1..=247", None);
        }
        self.slave_id = id as u8;
        self
    }

    /// Bits per second. Whether the clock makes it is checked by the board.
    ///
    /// # Panics
    /// At compile time, with port and value, below 300 or above 10 000 000.
    pub const fn baud(mut self, baud: u32) -> Self {
        if baud < 300 || baud > 10_000_000 {
            self.wrong("baud", baud, "must be 300..=10000000", None);
        }
        self.line.baud = baud;
        self
    }

    /// Character format. RTU needs 8 data bits (SER 2.5.1).
    ///
    /// # Panics
    /// At compile time, with port and value, for a format of 7 data bits.
    pub const fn format(mut self, format: LineFormat) -> Self {
        if format.data_bits() != 8 {
            self.wrong(
                "format: data bits",
                format.data_bits() as u32,
                "must be 8 for RTU",
                None,
            );
        }
        self.line.format = format;
        self
    }

    /// The rule for gaps inside a frame.
    pub const fn inter_character(mut self, rule: InterCharacter) -> Self {
        self.line.inter_character = rule;
        self
    }

    /// A client, in place of a server: the unit id is that of the unit it asks.
    pub const fn client(mut self) -> Self {
        self.line.role = Role::Client;
        self
    }

    /// The port's name.
    pub const fn name(&self) -> &'static str {
        self.name
    }

    /// The unit id of a slave, or of the slave that a master asks.
    pub const fn unit(&self) -> u8 {
        self.slave_id
    }

    /// The line settings.
    pub const fn line(&self) -> LineConfig {
        self.line
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
