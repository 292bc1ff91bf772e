//! The firmware image: what goes into flash and EEPROM, and where the symbols are.
//!
//! AVR ELF files keep the address spaces apart by offset (avr-libc, "Memory Sections"): flash from
//! 0, data from 0x80_0000, EEPROM from 0x81_0000.

use std::path::Path;

use object::elf::EM_AVR;
use object::read::elf::{ElfFile32, FileHeader, ProgramHeader};
use object::{LittleEndian, Object, ObjectSymbol};

use crate::error::BusError;

/// Bytes of flash (DS40002061B, 8.2).
pub const FLASH_BYTES: usize = 32 * 1024;
/// Bytes of EEPROM (DS40002061B, 8.4).
pub const EEPROM_BYTES: usize = 1024;

const DATA_OFFSET: u64 = 0x80_0000;
const EEPROM_OFFSET: u64 = 0x81_0000;
/// `EF_AVR_MACH` and `E_AVR_MACH_AVR5` of the binutils: the ATmega328P's instruction set.
const MACH_MASK: u32 = 0x7f;
const MACH_AVR5: u32 = 5;

/// A symbol in data memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DataSymbol {
    /// Its name as the linker sees it (mangled, for Rust).
    pub name: String,
    /// Its address in data memory (0x100 is the first byte of SRAM).
    pub address: u16,
    /// Its size in bytes; 0 for a label.
    pub size: u16,
}

/// A loaded image.
#[derive(Clone, Debug)]
pub(crate) struct Image {
    pub flash: Vec<u8>,
    pub eeprom: Vec<u8>,
    pub data_symbols: Vec<DataSymbol>,
}

impl Image {
    pub fn read(path: &Path) -> Result<Self, BusError> {
        let bytes = std::fs::read(path).map_err(|source| BusError::Read {
            path: path.to_owned(),
            source,
        })?;
        Self::parse(path, &bytes)
    }

    fn parse(path: &Path, bytes: &[u8]) -> Result<Self, BusError> {
        let not_elf = |reason: object::Error| BusError::NotElf {
            path: path.to_owned(),
            reason: reason.to_string(),
        };
        let wrong = |found: String| BusError::WrongMcu {
            path: path.to_owned(),
            found,
        };
        if bytes.len() > 5 && bytes[..4] == *b"\x7fELF" && (bytes[4] != 1 || bytes[5] != 1) {
            return Err(wrong("not a 32-bit little-endian image".to_owned()));
        }
        let elf = ElfFile32::<LittleEndian>::parse(bytes).map_err(not_elf)?;
        let header = elf.elf_header();
        let machine = header.e_machine(LittleEndian);
        if machine != EM_AVR {
            return Err(wrong(format!(
                "its ELF machine is {machine}, not {EM_AVR} (AVR)"
            )));
        }
        let mach = header.e_flags(LittleEndian) & MACH_MASK;
        if mach != MACH_AVR5 {
            return Err(wrong(format!("its AVR family is {mach}, not {MACH_AVR5}")));
        }

        let mut image = Image {
            flash: vec![0xff; FLASH_BYTES],
            eeprom: vec![0xff; EEPROM_BYTES],
            data_symbols: Vec::new(),
        };
        for segment in elf.elf_program_headers() {
            let data = segment.data(LittleEndian, bytes).unwrap_or_default();
            if segment.p_type(LittleEndian) != object::elf::PT_LOAD || data.is_empty() {
                continue;
            }
            let address = u64::from(segment.p_paddr(LittleEndian));
            let (memory, name, start) = match address {
                EEPROM_OFFSET.. => (&mut image.eeprom, "EEPROM", address - EEPROM_OFFSET),
                DATA_OFFSET.. => continue,
                _ => (&mut image.flash, "flash", address),
            };
            let end = start + data.len() as u64;
            memory
                .get_mut(start as usize..end as usize)
                .ok_or(BusError::TooLarge {
                    path: path.to_owned(),
                    memory: name,
                    end,
                })?
                .copy_from_slice(data);
        }
        for symbol in elf.symbols() {
            let (Ok(name), address) = (symbol.name(), symbol.address()) else {
                continue;
            };
            if (DATA_OFFSET..EEPROM_OFFSET).contains(&address) && !name.is_empty() {
                image.data_symbols.push(DataSymbol {
                    name: name.to_owned(),
                    address: (address - DATA_OFFSET) as u16,
                    size: symbol.size() as u16,
                });
            }
        }
        Ok(image)
    }

    pub fn symbol(&self, name: &str) -> Result<&DataSymbol, BusError> {
        self.data_symbols
            .iter()
            .find(|symbol| symbol.name == name)
            .ok_or_else(|| BusError::NoSymbol(name.to_owned()))
    }
}
