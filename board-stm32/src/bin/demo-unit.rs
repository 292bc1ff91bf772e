// ANCHOR: main
//! The demonstration unit: a remote output module on RS4. Copy this file to begin a project of your own.
#![no_std]
#![no_main]

use board_stm32::{Dog, PortSetup, Usart, Watchdog, info, options, outputs};
use multidrop::prelude::*;
use multidrop_apps::demo_unit::DemoUnit;

// The settings of the port. A value that cannot work does not compile.
const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(options::unit(1))
    .baud(options::baud(38_400))
    .format(options::format(LineFormat::F8N1));

multidrop::server! {
    static ROLL: Roll<Dog>;
    fn server(line: Usart, PORT) = DemoUnit::new(outputs());
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board_stm32::init(Watchdog::DEFAULT);
    info!("demo-unit: unit {} on RS4", PORT.unit());
    let line = board.rs4.open(const { PortSetup::new(&PORT) });
    board_stm32::run(&ROLL, server(line))
}
// ANCHOR_END: main
