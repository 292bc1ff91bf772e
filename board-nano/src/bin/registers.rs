//! The yardstick image: N of each table from address 0, at 38400 8N1 if not built otherwise.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use board_nano::{Rs485, bind_interrupts, options, settings};
use multidrop::prelude::*;
use multidrop_apps::yardstick::yardstick;

/// Items in each table.
const COUNT: usize = options::count(16);

const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(1)
    .baud(options::baud(38_400))
    .format(options::format(LineFormat::F8N1));

bind_interrupts!(struct Irqs { USART0 => Rs485; });

multidrop::server! {
    static ROLL: Roll<Irqs>;
    fn server(line: Rs485, PORT) = yardstick::<COUNT, { COUNT.div_ceil(8) }>();
}

#[avr_device::entry]
fn main() -> ! {
    let board = board_nano::init(Irqs);
    let line = board.rs4.open(Irqs, const { settings(&PORT) });
    board_nano::run(&ROLL, server(line))
}
