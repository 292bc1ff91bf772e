//! The conformance map with additions that no image has, so that every limit and every exception is reached: the
//! counterpart of `Plain::with_extras`.

use multidrop::protocol::data::{BytesOut, Coils, CoilsOut, Registers, RegistersOut};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::server::{ApplicationFunction, Conformity, DataModel, FunctionSet};
use multidrop_apps::conformance::Conformance;

/// The map, and more.
pub struct Rich(pub Conformance<32>);

impl Rich {
    /// Function 44, which always fails.
    fn fail(&mut self, pdu: &mut [u8], len: usize) -> Result<usize, Exception> {
        match pdu[1..len] {
            [code] => Exception::from_code(code).map_or(Ok(len), Err),
            _ => Ok(len),
        }
    }
}

impl DataModel for Rich {
    // All that the map promises, but that writes succeed.
    const WRITES_MAY_FAIL: bool = true;
    const FUNCTIONS: FunctionSet = FunctionSet::ALL;
    const CONFORMITY: Conformity = <Conformance<32> as DataModel>::CONFORMITY;
    const APPLICATION: &'static [ApplicationFunction<Self>] = &[
        ApplicationFunction {
            code: 0x41,
            broadcast: false,
            run: |_, pdu, len| {
                pdu[1..len].reverse();
                Ok(len)
            },
        },
        ApplicationFunction {
            code: 0x44,
            broadcast: true,
            run: Rich::fail,
        },
    ];

    fn coils(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        self.0.coils(first, out)
    }
    fn discrete_inputs(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        self.0.discrete_inputs(first, out)
    }
    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.0.holding_registers(first, out)
    }
    fn input_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.0.input_registers(first, out)
    }
    fn check_coils(&self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        self.0.check_coils(first, values)
    }
    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.0.check_registers(first, values)
    }
    fn write_coils(&mut self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        self.0.write_coils(first, values)
    }
    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        if (first..)
            .zip(values.iter())
            .any(|pair| pair == (127, 0xdead))
        {
            return Err(Exception::ServerDeviceFailure);
        }
        self.0.write_registers(first, values)
    }
    fn check_holding_registers(&mut self, first: u16, count: u16) -> Result<(), Exception> {
        self.0.check_holding_registers(first, count)
    }
    fn exception_status(&mut self) -> u8 {
        self.0.exception_status()
    }
    fn server_id(&mut self, out: &mut BytesOut<'_>) {
        self.0.server_id(out);
    }
    fn fifo_queue(&mut self, pointer: u16, mut out: RegistersOut<'_>) -> Result<u16, Exception> {
        if let 0x1000..=0x1030 = pointer {
            out.fill_from(0x1000..pointer);
            return Ok(pointer - 0x1000);
        }
        self.0.fifo_queue(pointer, out)
    }
    fn device_object(&mut self, id: u8, out: &mut BytesOut<'_>) -> bool {
        self.0.device_object(id, out)
    }
    fn file_records(
        &mut self,
        file: u16,
        record: u16,
        mut out: RegistersOut<'_>,
    ) -> Result<(), Exception> {
        // It has more than the 10000 that can be asked for.
        if file == 5 && record >= 9_990 {
            out.fill_from(record..);
            return Ok(());
        }
        self.0.file_records(file, record, out)
    }
    fn check_file_records(
        &self,
        file: u16,
        record: u16,
        values: Registers<'_>,
    ) -> Result<(), Exception> {
        self.0.check_file_records(file, record, values)
    }
    fn write_file_records(
        &mut self,
        file: u16,
        record: u16,
        values: Registers<'_>,
    ) -> Result<(), Exception> {
        self.0.write_file_records(file, record, values)
    }
}
