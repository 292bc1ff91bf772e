//! The yardstick image: N of each table from address 0, on RS4 at 38400 8N1, unless built for others.
#![no_std]
#![no_main]

use board_stm32::{Dog, PortSetup, Usart, Watchdog, options};
use multidrop::prelude::*;
use multidrop_apps::yardstick::yardstick;

/// Items in each table.
const COUNT: usize = options::count(16);

const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(1)
    .baud(options::baud(38_400))
    .format(options::format(LineFormat::F8N1));

multidrop::server! {
    static ROLL: Roll<Dog>;
    fn server(line: Usart, PORT) = yardstick::<COUNT, { COUNT.div_ceil(8) }>();
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board_stm32::init(Watchdog::DEFAULT);
    let line = board.rs4.open(const { PortSetup::new(&PORT) });
    board_stm32::run(&ROLL, server(line))
}
