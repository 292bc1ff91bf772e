//! The yardstick image: N of each table from address 0, at 38400 8N1 if not built otherwise.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use board_nano::{Rs485, bind_interrupts, options, settings};
use multidrop::protocol::format::LineFormat;
use multidrop::{PortConfig, Roll, ServerPort, Shared, signed};
use multidrop_apps::yardstick::Yardstick;
use static_cell::StaticCell;

/// Items in each table.
const COUNT: usize = options::count(16);

const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(1)
    .baud(options::baud(38_400))
    .format(options::format(LineFormat::F8N1));

bind_interrupts!(struct Irqs { USART0 => Rs485; });

/// The tasks that have to be alive.
static ROLL: Roll<Irqs, 2> = Roll::new();

#[embassy_executor::task]
async fn receive(port: &'static ServerPort<Rs485>) -> ! {
    signed(|task| ROLL.sign::<0>(task), multidrop::receive(port)).await
}

#[embassy_executor::task]
async fn serve(port: &'static ServerPort<Rs485>) -> ! {
    let model = Shared::new(Yardstick::<COUNT, { COUNT.div_ceil(8) }>::new());
    signed(|task| ROLL.sign::<1>(task), multidrop::serve(port, &model)).await
}

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
