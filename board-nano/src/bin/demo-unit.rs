// ANCHOR: main
//! The demonstration unit: a remote output module. Copy this file to begin a project of your own.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use board_nano::outputs::outputs;
use board_nano::{Rs485, bind_interrupts, options, settings};
use multidrop::prelude::*;
use multidrop_apps::demo_unit::DemoUnit;

// The settings of the port. A value that cannot work does not compile.
const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(options::unit(1))
    .baud(options::baud(38_400))
    .format(options::format(LineFormat::F8N1));

bind_interrupts!(struct Irqs { USART0 => Rs485; });

multidrop::server! {
    static ROLL: Roll<Irqs>;
    fn server(line: Rs485, PORT) = DemoUnit::new(outputs());
}

#[avr_device::entry]
fn main() -> ! {
    let board = board_nano::init(Irqs);
    let line = board.rs4.open(Irqs, const { settings(&PORT) });
    board_nano::run(&ROLL, server(line))
}
// ANCHOR_END: main
