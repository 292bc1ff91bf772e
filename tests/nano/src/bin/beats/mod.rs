//! Five tasks that wait, each for a time of its own, and change a pin of port B after it.

use embassy_avr_hal::gpio::{Output, PB0, PB1, PB2, PB3, PB4, Pins};
use embassy_executor::Spawner;
use embassy_time::{Duration, Ticker};
use embedded_hal::digital::StatefulOutputPin;

macro_rules! beats {
    ($($name:ident: $pin:ident, $ms:literal;)*) => {
        $(
            #[embassy_executor::task]
            pub async fn $name(mut out: Output<$pin>) {
                let mut ticker = Ticker::every(Duration::from_millis($ms));
                loop {
                    ticker.next().await;
                    let Ok(()) = out.toggle();
                }
            }
        )*

        /// Spawns the tasks of all beats.
        pub fn spawn(spawner: Spawner, pins: Pins) {
            $(spawner.spawn($name(Output::new(pins.$pin, false)).unwrap());)*
        }
    };
}

beats! {
    first: PB0, 7;
    second: PB1, 13;
    third: PB2, 40;
    fourth: PB3, 55;
    fifth: PB4, 70;
}
