//! The names of the register set.

use core::fmt;

/// One register of a port, `MB_<port>_<name>` in iDevOS. Those that are arrays have an index, from 0.
///
/// | register | values |
/// |---|---|
/// | MODE | 0 master, 1 slave, 2 off, 3 sniffer; 4 sensor node is not in this version |
/// | FRAMING | 0 RTU, 1 ASCII, 2 text: a sniffer that prints |
/// | BASE | 0..=65535, address of the first item of dense REGS and COILS |
/// | REGS, COILS | the items: 0..=65535; 0 and 1, 255 too for on |
/// | SLAVEID | slave 1..=247; master 0..=247, 0 for a broadcast |
/// | FUNC | 1, 2, 3, 4, 5, 6, 15, 16, 23 |
/// | REGOFF, REGCNT | 0..=65535; 1..=125, to write 1..=123, with FUNC 6 1, with FUNC 23 1..=121 |
/// | COILOFF, COILCNT | 0..=65535; 1..=2000, to write 1..=1968, with FUNC 5 1 |
/// | STATUS, ERROR | read only, see [`Status`](super::Status); exception code or 0 |
/// | TIMEOUT | 1..=65535 ms from the end of a request to the beginning of its answer |
/// | RETRIES | 0..=255 |
/// | TURNAROUND | 0..=65535 ms after a broadcast |
/// | DATAOK, DATAERR | read only: transactions that ended well, and badly, modulo 65536 |
/// | VALID_DATA, VALID_REG, DISABLE_REG | read only: the registers of a rule, the first times 65536 plus the last |
/// | DISABLE_FLG | 0 enables, 1 disables |
/// | BAUD | bits per second |
/// | FORMAT | 0 8N1, 1 8E1, 2 8O1, 3 8N2, 4 7E1, 5 7O1, 6 7N2; 7 bits with ASCII only |
/// | DUPLEX | 0 half, 1 full; as the port is wired |
/// | FLOW | 0 none, 1 RTS/CTS; where the chip has it |
/// | INTER_CHARACTER | 0 strict, 1 off, 2..=50 ms of silence end a frame |
/// | START | 1 starts a transaction, `LOAD(RS4, 1)`; reads 1 while it runs |
/// | LATE_GUARD | 0..=65535 ms after a timeout in which a late answer is told from others; 0 is TIMEOUT |
/// | CTS_TIMEOUT | 1..=65535 ms that a frame waits for CTS |
/// | REQUEST_GAP | 0..=65535 ms between an answer and the next request of a master |
/// | DE_LEAD | 0..=10000 us between DE and the first start bit |
/// | RESPONSE_DELAY | 0..=1000 ms that a slave's answer waits after t3.5 |
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "the table says what each is")]
pub enum Register {
    Mode,
    Framing,
    Base,
    Regs(u16),
    Coils(u16),
    SlaveId,
    Func,
    RegOff,
    RegCnt,
    CoilOff,
    CoilCnt,
    Status,
    Error,
    Timeout,
    Retries,
    Turnaround,
    DataOk,
    DataErr,
    ValidData(u8),
    ValidReg(u8),
    DisableReg(u8),
    DisableFlg(u8),
    Baud,
    Format,
    Duplex,
    Flow,
    InterCharacter,
    Start,
    LateGuard,
    CtsTimeout,
    RequestGap,
    DeLead,
    ResponseDelay,
}

impl Register {
    /// How many names there are: numbers are 0..=32.
    pub const COUNT: u8 = 33;

    /// The number of its name, the same in all versions.
    pub const fn number(self) -> u8 {
        match self {
            Register::Mode => 0,
            Register::Framing => 1,
            Register::Base => 2,
            Register::Regs(_) => 3,
            Register::Coils(_) => 4,
            Register::SlaveId => 5,
            Register::Func => 6,
            Register::RegOff => 7,
            Register::RegCnt => 8,
            Register::CoilOff => 9,
            Register::CoilCnt => 10,
            Register::Status => 11,
            Register::Error => 12,
            Register::Timeout => 13,
            Register::Retries => 14,
            Register::Turnaround => 15,
            Register::DataOk => 16,
            Register::DataErr => 17,
            Register::ValidData(_) => 18,
            Register::ValidReg(_) => 19,
            Register::DisableReg(_) => 20,
            Register::DisableFlg(_) => 21,
            Register::Baud => 22,
            Register::Format => 23,
            Register::Duplex => 24,
            Register::Flow => 25,
            Register::InterCharacter => 26,
            Register::Start => 27,
            Register::LateGuard => 28,
            Register::CtsTimeout => 29,
            Register::RequestGap => 30,
            Register::DeLead => 31,
            Register::ResponseDelay => 32,
        }
    }

    /// The register of this number; `None` for a number there is not, or an index that it cannot have.
    pub const fn from_number(number: u8, index: u16) -> Option<Register> {
        let small = index as u8;
        let register = match number {
            0 => Register::Mode,
            1 => Register::Framing,
            2 => Register::Base,
            3 => return Some(Register::Regs(index)),
            4 => return Some(Register::Coils(index)),
            5 => Register::SlaveId,
            6 => Register::Func,
            7 => Register::RegOff,
            8 => Register::RegCnt,
            9 => Register::CoilOff,
            10 => Register::CoilCnt,
            11 => Register::Status,
            12 => Register::Error,
            13 => Register::Timeout,
            14 => Register::Retries,
            15 => Register::Turnaround,
            16 => Register::DataOk,
            17 => Register::DataErr,
            18 => Register::ValidData(small),
            19 => Register::ValidReg(small),
            20 => Register::DisableReg(small),
            21 => Register::DisableFlg(small),
            22 => Register::Baud,
            23 => Register::Format,
            24 => Register::Duplex,
            25 => Register::Flow,
            26 => Register::InterCharacter,
            27 => Register::Start,
            28 => Register::LateGuard,
            29 => Register::CtsTimeout,
            30 => Register::RequestGap,
            31 => Register::DeLead,
            32 => Register::ResponseDelay,
            _ => return None,
        };
        let indices = match register.index() {
            Some(_) => 256,
            None => 1,
        };
        if index < indices {
            Some(register)
        } else {
            None
        }
    }

    /// The index in an array; `None` for a register that is none.
    pub const fn index(self) -> Option<u16> {
        match self {
            Register::Regs(index) | Register::Coils(index) => Some(index),
            Register::ValidData(index)
            | Register::ValidReg(index)
            | Register::DisableReg(index)
            | Register::DisableFlg(index) => Some(index as u16),
            _ => None,
        }
    }

    /// Its name, without `MB_<port>_` and without an index.
    pub const fn name(self) -> &'static str {
        match self {
            Register::Mode => "MODE",
            Register::Framing => "FRAMING",
            Register::Base => "BASE",
            Register::Regs(_) => "REGS",
            Register::Coils(_) => "COILS",
            Register::SlaveId => "SLAVEID",
            Register::Func => "FUNC",
            Register::RegOff => "REGOFF",
            Register::RegCnt => "REGCNT",
            Register::CoilOff => "COILOFF",
            Register::CoilCnt => "COILCNT",
            Register::Status => "STATUS",
            Register::Error => "ERROR",
            Register::Timeout => "TIMEOUT",
            Register::Retries => "RETRIES",
            Register::Turnaround => "TURNAROUND",
            Register::DataOk => "DATAOK",
            Register::DataErr => "DATAERR",
            Register::ValidData(_) => "VALID_DATA",
            Register::ValidReg(_) => "VALID_REG",
            Register::DisableReg(_) => "DISABLE_REG",
            Register::DisableFlg(_) => "DISABLE_FLG",
            Register::Baud => "BAUD",
            Register::Format => "FORMAT",
            Register::Duplex => "DUPLEX",
            Register::Flow => "FLOW",
            Register::InterCharacter => "INTER_CHARACTER",
            Register::Start => "START",
            Register::LateGuard => "LATE_GUARD",
            Register::CtsTimeout => "CTS_TIMEOUT",
            Register::RequestGap => "REQUEST_GAP",
            Register::DeLead => "DE_LEAD",
            Register::ResponseDelay => "RESPONSE_DELAY",
        }
    }

    /// The register of this name, such as `"BAUD"`, or `"REGS.3"`: an array without an index is its first element. `None` for
    /// any other text.
    pub fn from_name(text: &str) -> Option<Register> {
        let (name, index) = match text.split_once('.') {
            // A sign is no part of an index.
            Some((_, digits)) if !digits.starts_with(|c: char| c.is_ascii_digit()) => return None,
            Some((name, digits)) => (name, Some(digits.parse().ok()?)),
            None => (text, None),
        };
        let number = (0..Register::COUNT).find(|number| {
            Register::from_number(*number, 0).is_some_and(|register| register.name() == name)
        })?;
        let register = Register::from_number(number, index.unwrap_or(0))?;
        (register.index().is_some() || index.is_none()).then_some(register)
    }
}

/// As [`Register::from_name`] takes it.
impl fmt::Display for Register {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())?;
        match self.index() {
            Some(index) => write!(f, ".{index}"),
            None => Ok(()),
        }
    }
}
