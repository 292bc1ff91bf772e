//! The demonstration unit: a remote output module. Copy this file to begin a project of your own.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use board_nano::outputs::outputs;
use board_nano::{Rs485, bind_interrupts, options, settings};
use multidrop::protocol::format::LineFormat;
use multidrop::{PortConfig, Roll, ServerPort, Shared, signed};
use multidrop_apps::demo_unit::DemoUnit;
use static_cell::StaticCell;

// ANCHOR: node
// Everything there is to set. A value that cannot work does not compile.
const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(options::unit(1))
    .baud(options::baud(38_400))
    .format(options::format(LineFormat::F8N1));

bind_interrupts!(struct Irqs { USART0 => Rs485; });

/// The tasks that have to be alive.
static ROLL: Roll<Irqs, 2> = Roll::new();

/// Takes frames from the line.
#[embassy_executor::task]
async fn receive(port: &'static ServerPort<Rs485>) -> ! {
    signed(|task| ROLL.sign::<0>(task), multidrop::receive(port)).await
}

/// Answers requests.
#[embassy_executor::task]
async fn serve(port: &'static ServerPort<Rs485>) -> ! {
    let unit = Shared::new(DemoUnit::new(outputs()));
    signed(|task| ROLL.sign::<1>(task), multidrop::serve(port, &unit)).await
}
// ANCHOR_END: node

// ANCHOR: main
#[avr_device::entry]
fn main() -> ! {
    let board = board_nano::init(Irqs);
    let line = board.rs4.open(Irqs, const { settings(&PORT) });

    static PORT_CELL: StaticCell<ServerPort<Rs485>> = StaticCell::new();
    let port = PORT_CELL.init(ServerPort::new(line, &PORT));
    board_nano::run(&ROLL, |spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(serve(port).unwrap());
    })
}
// ANCHOR_END: main
