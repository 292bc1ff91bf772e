//! What the examples with a server on each of the four ports share: ports at the build's rate and format, and the registers that all
//! four serve.

use board_stm32::ports::PortSetup;
use board_stm32::usart::Usart;
use board_stm32::{Board, Roll, options};
use multidrop::PortConfig;
use multidrop::protocol::data::{Registers, RegistersOut};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::format::LineFormat;
use multidrop::protocol::registers::Bank;
use multidrop::protocol::server::DataModel;

const fn port(name: &'static str) -> PortConfig {
    PortConfig::new(name)
        .baud(options::baud(38_400))
        .format(options::format(LineFormat::F8N1))
}

pub const AS1: PortConfig = port("AS1");
pub const AS2: PortConfig = port("AS2");
pub const RS2: PortConfig = port("RS2");
pub const RS4: PortConfig = port("RS4");

/// The watchdog sees to the executor alone.
pub static ROLL: Roll<0> = Roll::new();

/// Holding registers from address 0 on.
pub struct Model<const N: usize>(pub Bank<N>);

impl<const N: usize> DataModel for Model<N> {
    const WRITES_MAY_FAIL: bool = false;

    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.0.read(first, out)
    }

    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.0.check(first, values)
    }

    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.0.write(first, values)
    }
}

/// All four lines, in the order of their names above.
pub fn open(board: Board) -> [Usart; 4] {
    [
        board.as1.open(const { PortSetup::new(&AS1) }),
        board.as2.open(const { PortSetup::new(&AS2) }),
        board.rs2.open(const { PortSetup::new(&RS2) }),
        board.rs4.open(const { PortSetup::new(&RS4) }),
    ]
}
