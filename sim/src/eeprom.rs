//! The EEPROM as the data sheet describes it (ATmega328P, DS40002061B, 8.4 and 8.6).
//!
//! A byte is in place when its programming time is over. Losing power before that leaves the byte
//! erased; a reset does not disturb it (8.4.2).
//!
//! The data sheet tells in which order the registers are to be used, and not what comes of another one. What a firmware
//! does beside it is kept as a [`Misuse`].

use crate::elf::EEPROM_BYTES;

// EECR, 8.6.3
const EERIE: u8 = 1 << 3;
const EEMPE: u8 = 1 << 2;
const EEPE: u8 = 1 << 1;
const EERE: u8 = 1 << 0;
const EEPM: u8 = 3 << 4;

/// Cycles in which EEPE must follow EEMPE.
const MASTER_ENABLE: u64 = 4;
/// Cycles the CPU is halted when a read or a write starts (8.4.1).
const READ_HALT: u64 = 4;
const WRITE_HALT: u64 = 2;

/// Something that the data sheet does not allow for: what silicon does then is not known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Misuse {
    /// The cycle of the node's clock in which it was done.
    pub at: u64,
    /// What was done.
    pub what: MisuseKind,
}

/// The kind of a [`Misuse`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MisuseKind {
    /// A 0 was written to EEPE while a byte was being written (8.6.3: hardware clears it).
    WriteEnableCleared,
    /// EEAR was written while a byte was being written (8.6.3, EERE).
    AddressChanged,
    /// A byte was read while another was being written (8.6.3, EERE).
    ReadWhileWriting,
    /// EEPE was set without EEMPE in the four cycles before it (8.6.3, EEMPE).
    NotEnabled,
}

#[derive(Debug)]
pub(crate) struct Eeprom {
    pub cells: Vec<u8>,
    hz: u64,
    address: u16,
    data: u8,
    /// EEPM and EERIE.
    control: u8,
    enabled_until: Option<u64>,
    /// The write in progress: when it ends, where, what.
    writing: Option<(u64, usize, u8)>,
    /// How often each cell was erased, written or both.
    pub wear: Vec<u32>,
    pub misuses: Vec<Misuse>,
}

impl Eeprom {
    pub fn new(hz: u32, cells: &[u8]) -> Self {
        Eeprom {
            cells: cells.to_vec(),
            hz: u64::from(hz),
            address: 0,
            data: 0,
            control: 0,
            enabled_until: None,
            writing: None,
            wear: vec![0; cells.len()],
            misuses: Vec::new(),
        }
    }

    pub fn reset(&mut self) {
        self.address = 0;
        self.data = 0;
        self.control = 0;
        self.enabled_until = None;
    }

    pub fn lose_power(&mut self, at: u64) {
        self.sync(at);
        if let Some((_, cell, _)) = self.writing.take() {
            self.cells[cell] = 0xff;
        }
    }

    pub fn sync(&mut self, t: u64) {
        if let Some((end, cell, value)) = self.writing
            && end <= t
        {
            self.cells[cell] = value;
            self.writing = None;
        }
    }

    pub fn next_event(&self) -> u64 {
        self.writing.map_or(u64::MAX, |(end, ..)| end)
    }

    pub fn read(&mut self, address: u16, at: u64) -> u8 {
        self.sync(at);
        match address {
            0x3f => {
                let enabled = self.enabled_until.is_some_and(|until| at < until);
                self.control
                    | if enabled { EEMPE } else { 0 }
                    | if self.writing.is_some() { EEPE } else { 0 }
            }
            0x40 => self.data,
            0x41 => self.address as u8,
            0x42 => (self.address >> 8) as u8,
            _ => 0,
        }
    }

    /// A write; returns for how many cycles the CPU is halted.
    pub fn write(&mut self, address: u16, value: u8, at: u64) -> u64 {
        self.sync(at);
        match address {
            0x3f => {
                if value & EEPE == 0 && self.writing.is_some() {
                    self.misuse(at, MisuseKind::WriteEnableCleared);
                }
                return self.command(value, at);
            }
            0x40 => self.data = value,
            0x41 | 0x42 if self.writing.is_some() => self.misuse(at, MisuseKind::AddressChanged),
            0x41 => self.address = self.address & 0xff00 | u16::from(value),
            0x42 => self.address = self.address & 0xff | u16::from(value) << 8,
            _ => {}
        }
        0
    }

    /// `sbi` or `cbi` on EECR, which change one bit and no other (note to the register summary).
    pub fn write_bit(&mut self, bit: u8, set: bool, at: u64) -> u64 {
        self.sync(at);
        let mask = 1 << bit;
        match mask {
            EEMPE | EEPE | EERE if set => return self.command(self.control | mask, at),
            EEMPE => self.enabled_until = None,
            EEPE if self.writing.is_some() => self.misuse(at, MisuseKind::WriteEnableCleared),
            EEPE | EERE => {}
            _ if set => self.control |= mask & (EEPM | EERIE),
            _ => self.control &= !mask,
        }
        0
    }

    fn misuse(&mut self, at: u64, what: MisuseKind) {
        self.misuses.push(Misuse { at, what });
    }

    fn command(&mut self, value: u8, at: u64) -> u64 {
        let kept = if self.writing.is_some() {
            // 8.6.3: while EEPE is set, writes to EEPM are ignored.
            self.control & EEPM | value & EERIE
        } else {
            value & (EEPM | EERIE)
        };
        self.control = kept;
        let cell = usize::from(self.address) % EEPROM_BYTES;
        let enabled = self.enabled_until.take().is_some_and(|until| at <= until);
        if value & EEPE != 0 && enabled && self.writing.is_none() {
            // Table 8-1: erase and write in one, erase alone, write alone (which clears bits).
            let (tenths_of_ms, result) = match value >> 4 & 3 {
                1 => (18, 0xff),
                2 => (18, self.cells[cell] & self.data),
                _ => (34, self.data),
            };
            let end = at + self.hz * tenths_of_ms / 10_000;
            self.wear[cell] += 1;
            self.writing = Some((end, cell, result));
            return WRITE_HALT;
        }
        if value & EEPE != 0 && self.writing.is_none() {
            self.misuse(at, MisuseKind::NotEnabled);
        }
        if value & EEMPE != 0 {
            self.enabled_until = Some(at + MASTER_ENABLE);
        }
        // 8.6.3: no reading while a write is in progress.
        if value & EERE != 0 {
            if self.writing.is_some() {
                self.misuse(at, MisuseKind::ReadWhileWriting);
                return 0;
            }
            self.data = self.cells[cell];
            return READ_HALT;
        }
        0
    }

    /// EE READY (22) asks as long as nothing is being written.
    pub fn vector(&self) -> Option<u8> {
        (self.control & EERIE != 0 && self.writing.is_none()).then_some(22)
    }
}
