//! The demonstration unit's data: one 16-bit register, seen through all four tables at address 0, its
//! bits on the LED pins.
//!
//! Bits 0 to 12 are PC0 to PC12. PC12 is the LED of the STM32-H405, which is lit while the bit is off. Bits
//! 13, 14 and 15 have no pin, since PC13 to PC15 can drive no LED; they can be written and read back.

use multidrop_firmware::protocol::data::{Coils, CoilsOut, Registers, RegistersOut};
use multidrop_firmware::protocol::exception::Exception;
use multidrop_firmware::protocol::registers::within;
use multidrop_firmware::protocol::server::DataModel;

/// The pins of GPIOC that show the register (DS, pin definitions: PC13 to PC15 drive 3 mA, and no LED).
pub const LEDS: u16 = 0x1FFF;

/// The register.
pub struct DemoUnit {
    outputs: u16,
    show: fn(u16),
}

impl DemoUnit {
    /// All outputs off. `show` puts the register on the pins.
    pub fn new(show: fn(u16)) -> Self {
        show(0);
        Self { outputs: 0, show }
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
        (self.show)(self.outputs);
        Ok(())
    }

    fn write_registers(&mut self, _first: u16, values: Registers<'_>) -> Result<(), Exception> {
        if let Some(outputs) = values.get(0) {
            self.outputs = outputs;
        }
        (self.show)(self.outputs);
        Ok(())
    }
}
