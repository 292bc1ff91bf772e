//! The yardstick image: N of each table from address 0, on RS4 at 38400 8N1 if not built otherwise.
#![no_std]
#![no_main]

use board_stm32::ports::PortSettings;
use board_stm32::usart::Usart;
use board_stm32::{info, options};
use multidrop_firmware::protocol::data::{Coils, CoilsOut, Registers, RegistersOut};
use multidrop_firmware::protocol::exception::Exception;
use multidrop_firmware::protocol::format::LineFormat;
use multidrop_firmware::protocol::registers::{Bank, CoilBank, within};
use multidrop_firmware::protocol::server::DataModel;
use multidrop_firmware::{Port, PortConfig, Shared};
use static_cell::StaticCell;

/// Items in each table.
const COUNT: usize = options::count(16);

const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(1)
    .baud(options::baud(38_400))
    .format(options::format(LineFormat::F8N1));

/// Holding registers and coils are kept; inputs follow from their address.
struct Model {
    registers: Bank<COUNT>,
    coils: CoilBank<{ COUNT.div_ceil(8) }>,
}

impl DataModel for Model {
    const WRITES_MAY_FAIL: bool = false;

    fn coils(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        self.coils.read(first, out)
    }

    fn discrete_inputs(&mut self, first: u16, mut out: CoilsOut<'_>) -> Result<(), Exception> {
        within(first, out.len(), COUNT as u16)?;
        out.fill_from((first..).map(|address| address % 3 == 0));
        Ok(())
    }

    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.registers.read(first, out)
    }

    fn input_registers(&mut self, first: u16, mut out: RegistersOut<'_>) -> Result<(), Exception> {
        within(first, out.len() as u16, COUNT as u16)?;
        out.fill_from((first..).map(|address| 0x1000 + address));
        Ok(())
    }

    fn check_coils(&self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        self.coils.check(first, values)
    }

    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.registers.check(first, values)
    }

    fn write_coils(&mut self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        self.coils.write(first, values)
    }

    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.registers.write(first, values)
    }
}

#[embassy_executor::task]
async fn receive(port: &'static Port<Usart>) -> ! {
    multidrop_firmware::receive(port).await
}

#[embassy_executor::task]
async fn serve(port: &'static Port<Usart>) -> ! {
    let model = Shared::new(Model {
        registers: Bank::new(0),
        coils: CoilBank::new(0, COUNT as u16),
    });
    multidrop_firmware::serve(port, &model).await
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board_stm32::init();
    let line = board.rs4.open(const { PortSettings::new(&PORT) });
    info!("registers: unit {} on RS4", PORT.unit());

    static PORT_CELL: StaticCell<Port<Usart>> = StaticCell::new();
    let port = PORT_CELL.init(Port::new(line, &PORT));
    board_stm32::run(|spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(serve(port).unwrap());
    })
}
