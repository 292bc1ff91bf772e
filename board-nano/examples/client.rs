// ANCHOR: main
//! The smallest client.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use board_nano::{CLOCK_HZ, Rs485, bind_interrupts, settings};
use multidrop::prelude::*;

const PORT: PortConfig = PortConfig::new("RS4").client().baud(38_400);

bind_interrupts!(struct Irqs { USART0 => Rs485; TIME => CLOCK_HZ, tasks = [ask]; });

multidrop::client! {
    static ROLL: Roll<Irqs>;
    fn client(line: Rs485, ClientConfig::new().timeout_ms(150)) = copy;
}

/// Copies four registers of unit 1 to unit 2, again and again.
async fn copy(client: Client<Rs485, 1>) -> ! {
    let mut levels = [0; 4];
    loop {
        if let Ok(()) = client.read_holding_registers(1, 0, &mut levels).await {
            // What fails is tried again with the next levels.
            let _ = client.write_registers(2, 0, &levels).await;
        }
    }
}

#[avr_device::entry]
fn main() -> ! {
    let board = board_nano::init(Irqs);
    let line = board.rs4.open(Irqs, const { settings(&PORT) });
    board_nano::run(&ROLL, client(line))
}
// ANCHOR_END: main
