//! The yardstick image: N of each table from address 0, on RS4 at 38400 8N1 if not built otherwise.
#![no_std]
#![no_main]

use board_stm32::ports::PortSettings;
use board_stm32::usart::Usart;
use board_stm32::{Roll, Watchdog, info, options};
use multidrop_firmware::protocol::format::LineFormat;
use multidrop_firmware::yardstick::Yardstick;
use multidrop_firmware::{Port, PortConfig, Shared, signed};
use static_cell::StaticCell;

/// Items in each table.
const COUNT: usize = options::count(16);

const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(1)
    .baud(options::baud(38_400))
    .format(options::format(LineFormat::F8N1));

/// The tasks that have to be alive.
static ROLL: Roll<2> = Roll::new();

#[embassy_executor::task]
async fn receive(port: &'static Port<Usart>) -> ! {
    signed(
        |task| ROLL.sign::<0>(task),
        multidrop_firmware::receive(port),
    )
    .await
}

#[embassy_executor::task]
async fn serve(port: &'static Port<Usart>) -> ! {
    let model = Shared::new(Yardstick::<COUNT, { COUNT.div_ceil(8) }>::new());
    signed(
        |task| ROLL.sign::<1>(task),
        multidrop_firmware::serve(port, &model),
    )
    .await
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board_stm32::init(Watchdog::DEFAULT);
    let line = board.rs4.open(const { PortSettings::new(&PORT) });
    info!("registers: unit {} on RS4", PORT.unit());

    static PORT_CELL: StaticCell<Port<Usart>> = StaticCell::new();
    let port = PORT_CELL.init(Port::new(line, &PORT));
    board_stm32::run(&ROLL, |spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(serve(port).unwrap());
    })
}
