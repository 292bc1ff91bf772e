//! The smallest client, on RS4.
#![no_std]
#![no_main]

use board_stm32::{Dog, PortSetup, Usart, Watchdog};
use multidrop::prelude::*;

const PORT: PortConfig = PortConfig::new("RS4").client().baud(38_400);

multidrop::client! {
    static ROLL: Roll<Dog>;
    fn client(line: Usart, ClientConfig::new().timeout_ms(150)) = copy;
}

/// Copies four registers of unit 1 to unit 2, again and again.
async fn copy(client: Client<Usart, 1>) -> ! {
    let mut levels = [0; 4];
    loop {
        if let Ok(()) = client.read_holding_registers(1, 0, &mut levels).await {
            // What fails is tried again with the next levels.
            let _ = client.write_registers(2, 0, &levels).await;
        }
    }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board_stm32::init(Watchdog::DEFAULT);
    let line = board.rs4.open(const { PortSetup::new(&PORT) });
    board_stm32::run(&ROLL, client(line))
}
