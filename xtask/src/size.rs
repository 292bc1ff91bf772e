//! Flash and static RAM of an image, from the sections of its ELF file.

use crate::error::Error;
use crate::image::Board;
use object::{Object, ObjectSection, SectionFlags, elf};
use std::path::Path;

/// Flash of the ATmega328P less the 2 KB boot loader that most Nanos are sold with (DS40002061B
/// table 27-7); the newer one leaves 1536 bytes more.
const FLASH: u64 = 32 * 1024 - 2048;

/// Flash that is left by the newer, 512-byte boot loader.
const FLASH_NEW_BOOTLOADER: u64 = 32 * 1024 - 512;

/// SRAM of the ATmega328P (DS40002061B section 8.3).
const RAM: u64 = 2048;

/// Flash and SRAM of the STM32F405RG; 64 KB more are coupled to the core and not used (RM0090 3.3, 2.3.1).
const STM32_FLASH: u64 = 1024 * 1024;
const STM32_RAM: u64 = 128 * 1024;

/// The addresses of its flash and SRAM (RM0090 2.3).
const STM32_FLASH_SPACE: std::ops::Range<u64> = 0x0800_0000..0x0900_0000;
const STM32_RAM_SPACE: std::ops::Range<u64> = 0x2000_0000..0x3000_0000;

/// The addresses at which avr-gcc's linker puts data memory and, above it, EEPROM, fuses and the like.
const DATA_SPACE: std::ops::Range<u64> = 0x80_0000..0x81_0000;

/// The memory that an image takes, in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Size {
    /// Code, and the initial values of data.
    pub flash: u64,
    /// Data with and without initial value; the stack has what is left.
    pub ram: u64,
}

/// Reads the sizes of the image in `path`.
///
/// # Errors
/// [`Error::failed`] if it is not an ELF file.
pub fn of(path: &Path) -> Result<Size, Error> {
    let bytes = std::fs::read(path).map_err(|error| Error::io(path.display(), error))?;
    let file = object::File::parse(&*bytes)
        .map_err(|error| Error::failed(format!("{}: {error}", path.display())))?;
    let mut size = Size::default();
    for section in file.sections() {
        let SectionFlags::Elf { sh_flags } = section.flags() else {
            continue;
        };
        if sh_flags & u64::from(elf::SHF_ALLOC) != 0 {
            let in_file = section.file_range().is_some();
            size.add(section.address(), section.size(), in_file);
        }
    }
    Ok(size)
}

impl Size {
    fn add(&mut self, address: u64, bytes: u64, in_file: bool) {
        let in_data = DATA_SPACE.contains(&address) || STM32_RAM_SPACE.contains(&address);
        if in_data {
            self.ram += bytes;
        }
        // EEPROM and fuses lie above the AVR's data.
        let in_code = address < DATA_SPACE.start || STM32_FLASH_SPACE.contains(&address);
        if in_file && (in_data || in_code) {
            self.flash += bytes;
        }
    }
}

impl Size {
    /// As text, with what is left on this board.
    pub fn shown(self, board: Board) -> String {
        let Self { flash, ram } = self;
        match board {
            Board::Nano => format!(
                "flash: {flash} bytes used, {} free of {FLASH} beside the 2 KB boot loader ({} free of \
                 {FLASH_NEW_BOOTLOADER} beside the 512-byte one)\n\
                 static RAM: {ram} bytes used, {} free of {RAM} for the stack\n",
                left(FLASH, flash),
                left(FLASH_NEW_BOOTLOADER, flash),
                left(RAM, ram)
            ),
            Board::Stm32 => format!(
                "flash: {flash} bytes used, {} free of {STM32_FLASH}\n\
                 static RAM: {ram} bytes used, {} free of {STM32_RAM} for the stack\n",
                left(STM32_FLASH, flash),
                left(STM32_RAM, ram)
            ),
        }
    }
}

/// Negative when the image is too big: the message then says by how much.
fn left(all: u64, used: u64) -> i64 {
    all as i64 - used as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_counts_twice_bss_in_ram_and_eeprom_nowhere() {
        let mut size = Size::default();
        size.add(0, 4000, true);
        size.add(0x80_0100, 10, true);
        size.add(0x80_010A, 300, false);
        size.add(0x81_0000, 64, true);
        assert_eq!(
            size,
            Size {
                flash: 4010,
                ram: 310
            }
        );
    }

    #[test]
    fn what_is_free_is_printed_for_both_boot_loaders() {
        let text = Size {
            flash: 30_820,
            ram: 500,
        }
        .shown(Board::Nano);
        assert!(
            text.contains("30820 bytes used, -100 free of 30720"),
            "{text}"
        );
        assert!(text.contains("1436 free of 32256"), "{text}");
        assert!(text.contains("500 bytes used, 1548 free of 2048"), "{text}");
    }
}
