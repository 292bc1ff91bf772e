//! The demonstration unit: a remote output module on RS4. Copy this file to begin a project of your own.
#![no_std]
#![no_main]

use board_stm32::ports::PortSetup;
use board_stm32::usart::Usart;
use board_stm32::{Roll, Watchdog, info, options, outputs};
use multidrop::protocol::format::LineFormat;
use multidrop::{PortConfig, ServerPort, Shared, signed};
use multidrop_apps::demo_unit::DemoUnit;
use static_cell::StaticCell;

// Everything there is to set. A value that cannot work does not compile.
const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(options::unit(1))
    .baud(options::baud(38_400))
    .format(options::format(LineFormat::F8N1));

/// The tasks that have to be alive.
static ROLL: Roll<2> = Roll::new();

/// Takes frames from the line.
#[embassy_executor::task]
async fn receive(port: &'static ServerPort<Usart>) -> ! {
    signed(|task| ROLL.sign::<0>(task), multidrop::receive(port)).await
}

/// Answers requests.
#[embassy_executor::task]
async fn serve(port: &'static ServerPort<Usart>) -> ! {
    let unit = Shared::new(DemoUnit::new(outputs()));
    signed(|task| ROLL.sign::<1>(task), multidrop::serve(port, &unit)).await
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board_stm32::init(Watchdog::DEFAULT);
    let line = board.rs4.open(const { PortSetup::new(&PORT) });
    info!("demo-unit: unit {} on RS4", PORT.unit());

    static PORT_CELL: StaticCell<ServerPort<Usart>> = StaticCell::new();
    let port = PORT_CELL.init(ServerPort::new(line, &PORT));
    board_stm32::run(&ROLL, |spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(serve(port).unwrap());
    })
}
