//! What is in a node's memories: SRAM and its stack, variables by name, EEPROM.

use super::{Node, PAINT, RAM_START, pattern};
use crate::eeprom::Misuse;
use crate::elf::DataSymbol;
use crate::error::BusError;
use crate::ffi::DATA_BYTES;

impl Node {
    /// `N` bytes of data memory from `address` (0x100 is the first byte of SRAM); what is past
    /// its end (0x8ff) reads as 0.
    pub fn read<const N: usize>(&self, address: u16) -> [u8; N] {
        let data = self.core.data();
        std::array::from_fn(|i| data.get(usize::from(address) + i).copied().unwrap_or(0))
    }

    /// Writes to SRAM; what is outside it (0x100 ..= 0x8ff) is left alone.
    pub fn write(&mut self, address: u16, bytes: &[u8]) {
        let data = self.core.data_mut();
        for (at, byte) in (usize::from(address)..).zip(bytes) {
            if (RAM_START..data.len()).contains(&at) {
                data[at] = *byte;
            }
        }
    }

    /// A variable of the firmware by its name in the image.
    ///
    /// # Errors
    /// [`BusError::NoSymbol`].
    pub fn symbol(&self, name: &str) -> Result<&DataSymbol, BusError> {
        self.image.symbol(name)
    }

    /// All variables of the firmware.
    pub fn symbols(&self) -> &[DataSymbol] {
        &self.image.data_symbols
    }

    /// The EEPROM's 1024 bytes. They survive reset and power cuts, but for a byte that is being
    /// written when the power goes.
    pub fn eeprom(&self) -> &[u8] {
        &self.core.periph().eeprom.cells
    }

    /// The EEPROM's 1024 bytes.
    pub fn eeprom_mut(&mut self) -> &mut [u8] {
        &mut self.core.periph_mut().eeprom.cells
    }

    /// How often each byte of the EEPROM was erased or written since the bus was made: a cell stands 100 000 times (DS 8.4).
    pub fn eeprom_wear(&self) -> &[u32] {
        &self.core.periph().eeprom.wear
    }

    /// What the firmware did with the EEPROM that the data sheet does not allow for, since the bus was made.
    pub fn eeprom_misuses(&self) -> &[Misuse] {
        &self.core.periph().eeprom.misuses
    }

    /// One past the last static variable (the linker's `_end`), or the start of SRAM.
    fn static_end(&self) -> usize {
        self.image
            .symbol("_end")
            .or_else(|_| self.image.symbol("__heap_start"))
            .map_or(RAM_START, |symbol| usize::from(symbol.address))
    }

    /// Bytes of static RAM: data, bss and noinit.
    pub fn static_ram(&self) -> usize {
        self.static_end() - RAM_START
    }

    /// Fills the free SRAM below the stack with the power-up pattern, so that
    /// [`Node::stack_peak`] counts from here on. Power-up does it too.
    pub fn paint_stack(&mut self) {
        let (start, end) = (self.static_end(), usize::from(self.core.sp()));
        let fill = self.paint();
        if start < end {
            self.core.data_mut()[start..=end].copy_from_slice(&fill[start..=end]);
        }
    }

    /// What free SRAM holds: the power-up pattern, or what the firmware has painted it with.
    fn paint(&self) -> Vec<u8> {
        let start = self.static_end();
        if self.core.data()[start..].starts_with(&[PAINT; 2]) {
            return vec![PAINT; DATA_BYTES];
        }
        pattern(self.config.seed).take(DATA_BYTES).collect()
    }

    /// Bytes of stack used since power-up or [`Node::paint_stack`]: from the deepest byte that was
    /// overwritten to the end of SRAM. One byte in 256 is overwritten with what was there: the
    /// figure may then be a byte short.
    pub fn stack_peak(&self) -> usize {
        let start = self.static_end();
        let untouched = self.paint()[start..]
            .iter()
            .zip(&self.core.data()[start..])
            .take_while(|(painted, now)| painted == now)
            .count();
        DATA_BYTES - start - untouched
    }
}
