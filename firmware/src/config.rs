//! The configuration of a port, fixed and checked at compile time.

use multidrop_protocol::format::{Framing, LineFormat};
use multidrop_protocol::message::Message;
// With the types of all values that are declared.
use multidrop_protocol::port_registers::*;
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

/// The builder's methods, one for each setting that the registers begin with.
macro_rules! setters {
    (
        typed {
            port { $(
                $(#[$doc:meta])*
                $number:literal $NAME:ident $register:ident: $type:ident
                    $(in $low:literal ..= $high:literal)? $(of $choices:literal)? => $field:ident = $default:expr;
            )* }
            line { $(
                $(#[$line_doc:meta])*
                $line_number:literal $LINE_NAME:ident $line_register:ident: $line_type:ident
                    $(in $line_low:literal ..= $line_high:literal)? $(of $line_choices:literal)?
                    => $line_field:ident = $line_default:expr;
            )* }
            $($others:tt)*
        }
        untyped $untyped:tt
    ) => {
        impl PortConfig {
            $( setter! {
                { $(#[$doc])* } $register [settings] $field: $type $(in $low ..= $high)? $(of $choices)?
            } )*
            $( setter! {
                { $(#[$line_doc])* } $line_register [settings.line] $line_field: $line_type
                    $(in $line_low ..= $line_high)? $(of $line_choices)?
            } )*
        }
    };
}

macro_rules! setter {
    // One of a few values.
    (
        { $(#[$doc:meta])* } $register:ident [$($owner:ident).+] $field:ident: $type:ident
            $(in $low:literal ..= $high:literal)? of $choices:literal
    ) => {
        $(#[$doc])*
        ///
        /// # Panics
        /// At compile time, with port and value, if it does not go with what was set before.
        pub const fn $field(mut self, $field: $type) -> Self {
            self.$($owner.)+$field = $field;
            self.checked()
        }
    };
    // A number of a range.
    (
        { $(#[$doc:meta])* } $register:ident [$($owner:ident).+] $field:ident: $type:ident
            in $low:literal ..= $high:literal
    ) => {
        $(#[$doc])*
        ///
        /// # Panics
        #[doc = concat!("At compile time, with port and value, outside of ", $low, "..=", $high, ".")]
        pub const fn $field(mut self, $field: u32) -> Self {
            self.check_range(stringify!($field), $field, Register::$register);
            self.$($owner.)+$field = $field as $type;
            self
        }
    };
}

multidrop_protocol::port_registers!(setters);

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

    /// A client, in place of a server: mode master. `slave_id` is that of the slave it asks.
    pub const fn client(self) -> Self {
        self.mode(Mode::Master)
    }

    const fn check_range(&self, field: &str, value: u32, register: Register) {
        if let Some((low, high)) = self.settings.range(register)
            && (value < low || value > high)
        {
            self.field(field, value).range(low, high).fail();
        }
    }

    /// Stops the build where a value does not go with the others.
    const fn checked(self) -> Self {
        let line = &self.settings.line;
        match self.settings.conflict() {
            Some(Reason::Text) => {
                let rule = "must be 0 (RTU) or 1 (ASCII) for a master or a slave";
                self.wrong("framing", line.framing as u32, rule, None);
            }
            Some(Reason::SlaveZero) => {
                if let Some((low, high)) = self.settings.range(Register::SlaveId) {
                    self.field("slave_id", 0)
                        .range(low, high)
                        .text(" for a slave")
                        .fail();
                }
            }
            Some(Reason::SevenBits) => {
                let data_bits = line.format.data_bits() as u32;
                self.wrong("format: data bits", data_bits, "must be 8 for RTU", None);
            }
            _ => {}
        }
        if let InterCharacter::Gap(ms) = line.inter_character {
            let (ms, (low, high)) = (ms as u32, InterCharacter::GAP);
            if ms < low || ms > high {
                self.field("inter_character gap", ms)
                    .range(low, high)
                    .text(" ms")
                    .fail();
            }
        }
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

    /// The settings of the port.
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
        let message = self.field(field, value).text(rule);
        match nearest {
            Some(nearest) => message.text(", nearest is ").number(nearest).fail(),
            None => message.fail(),
        }
    }

    /// The beginning of a message: `port NAME: FIELD is VALUE, `.
    const fn field(&self, field: &str, value: u32) -> Message {
        Message::new()
            .text("port ")
            .text(self.name)
            .text(": ")
            .text(field)
            .text(" is ")
            .number(value)
            .text(", ")
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
