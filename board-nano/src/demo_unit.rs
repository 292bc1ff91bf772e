//! The demonstration unit's data: one 16-bit register, seen through all four tables at address 0, its
//! bits on the LED pins.
//!
//! Bits 0 to 7 are port D, bits 8 to 15 port B. Bits 0, 1 and 2 have no pin, since RXD, TXD and DE are
//! there, nor have 14 and 15, where the crystal is; all of them can be written and read back.

use embassy_avr_hal::gpio::{PortBOut, PortDOut};
use multidrop_firmware::protocol::data::{Coils, CoilsOut, Registers, RegistersOut};
use multidrop_firmware::protocol::exception::Exception;
use multidrop_firmware::protocol::registers::within;
use multidrop_firmware::protocol::server::DataModel;

use crate::DE_MASK;

/// RXD and TXD.
const USART_MASK: u8 = 0b0000_0011;
/// PB6 and PB7.
const CRYSTAL_MASK: u8 = 0b1100_0000;

/// The register and its pins.
pub struct DemoUnit {
    outputs: u16,
    port_b: PortBOut,
    port_d: PortDOut,
}

impl DemoUnit {
    /// All outputs off.
    pub fn new() -> Self {
        Self {
            outputs: 0,
            port_b: PortBOut::new(!CRYSTAL_MASK),
            port_d: PortDOut::new(!(USART_MASK | DE_MASK)),
        }
    }

    fn show(&mut self) {
        let [high, low] = self.outputs.to_be_bytes();
        self.port_b.write(high);
        self.port_d.write(low);
    }
}

impl Default for DemoUnit {
    fn default() -> Self {
        Self::new()
    }
}

impl DataModel for DemoUnit {
    const WRITES_MAY_FAIL: bool = false;

    fn coils(&mut self, first: u16, mut out: CoilsOut<'_>) -> Result<(), Exception> {
        within(first, out.len(), 16)?;
        out.fill_from((first..).map(|bit| self.outputs >> bit & 1 != 0));
        Ok(())
    }

    fn discrete_inputs(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        self.coils(first, out)
    }

    fn holding_registers(
        &mut self,
        first: u16,
        mut out: RegistersOut<'_>,
    ) -> Result<(), Exception> {
        within(first, out.len() as u16, 1)?;
        out.set(0, self.outputs);
        Ok(())
    }

    fn input_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.holding_registers(first, out)
    }

    fn check_coils(&self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        within(first, values.len(), 16)
    }

    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        within(first, values.len() as u16, 1)
    }

    fn write_coils(&mut self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        for (bit, on) in (first..).zip(values.iter()) {
            let mask = 1 << bit;
            self.outputs = if on {
                self.outputs | mask
            } else {
                self.outputs & !mask
            };
        }
        self.show();
        Ok(())
    }

    fn write_registers(&mut self, _first: u16, values: Registers<'_>) -> Result<(), Exception> {
        if let Some(outputs) = values.get(0) {
            self.outputs = outputs;
        }
        self.show();
        Ok(())
    }
}
