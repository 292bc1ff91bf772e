//! The registers of a slave as the data model of its server.

use super::PortRegisters;
use crate::data::{Coils, CoilsOut, Registers, RegistersOut};
use crate::exception::Exception;
use crate::function::{
    MASK_WRITE_REGISTER, READ_COILS, READ_DISCRETE_INPUTS, READ_WRITE_REGISTERS,
    WRITE_MULTIPLE_COILS, WRITE_SINGLE_COIL,
};
use crate::registers::{Items, Rules, items};
use crate::server::{DataModel, FunctionSet};

impl<R, C, V> DataModel for PortRegisters<R, C, V>
where
    R: Items<Item = u16> + 'static,
    C: Items<Item = bool> + 'static,
    V: Rules + 'static,
{
    const FUNCTIONS: FunctionSet = {
        let functions = FunctionSet::EIGHT
            .with(MASK_WRITE_REGISTER)
            .with(READ_WRITE_REGISTERS);
        if C::NONE {
            functions
                .without(READ_COILS)
                .without(READ_DISCRETE_INPUTS)
                .without(WRITE_SINGLE_COIL)
                .without(WRITE_MULTIPLE_COILS)
        } else {
            functions
        }
    };
    const WRITES_MAY_FAIL: bool = false;

    fn coils(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        items::read_coils(&self.coils, first, out)
    }

    fn discrete_inputs(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        items::read_coils(&self.coils, first, out)
    }

    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        V::check_read(first, out.len() as u16)?;
        items::read_registers(&self.regs, first, out)
    }

    fn input_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.holding_registers(first, out)
    }

    fn check_coils(&self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        items::check(&self.coils, first, values.len())
    }

    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        items::check(&self.regs, first, values.len() as u16)?;
        V::check_write(first, values, self.flags)
    }

    fn write_coils(&mut self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        items::write_coils(&mut self.coils, first, values)
    }

    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        items::write_registers(&mut self.regs, first, values)
    }

    fn check_holding_registers(&mut self, first: u16, count: u16) -> Result<(), Exception> {
        V::check_read(first, count)?;
        items::check(&self.regs, first, count)
    }
}
