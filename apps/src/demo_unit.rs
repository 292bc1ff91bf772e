//! The data model of the application `demo-unit` on every board: one 16-bit register, seen through all four tables at
//! address 0. The board decides what its bits switch.

use multidrop::protocol::data::{Coils, CoilsOut, Registers, RegistersOut};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::registers::within;
use multidrop::protocol::server::DataModel;

// ANCHOR: model
/// The register, and the closure that shows it on the pins.
pub struct DemoUnit<S> {
    outputs: u16,
    show: S,
}

impl<S: FnMut(u16)> DemoUnit<S> {
    /// A unit with all outputs off. `show` is called with the register after each write.
    pub fn new(show: S) -> Self {
        Self { outputs: 0, show }
    }
}

impl<S: FnMut(u16) + 'static> DataModel for DemoUnit<S> {
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
// ANCHOR_END: model
