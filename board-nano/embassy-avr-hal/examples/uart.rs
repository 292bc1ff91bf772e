//! Gives back what comes in, asleep between two characters.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use embassy_avr_hal::gpio::Pins;
use embassy_avr_hal::uart::{BufferedUart, Config, LineFormat};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use embedded_io_async::{Read, Write};
use static_cell::ConstStaticCell;

// ANCHOR: uart
bind_interrupts!(struct Irqs { UART; });

/// A rate that the clock does not make does not compile.
const CONFIG: Config = Config::fixed(16_000_000, 115_200, LineFormat::F8N1);

#[embassy_executor::task]
async fn echo(mut uart: BufferedUart) {
    let mut bytes = [0; 32];
    loop {
        // What was lost or damaged is told once, and left out.
        if let Ok(count) = uart.read(&mut bytes).await {
            let _ = uart.write_all(&bytes[..count]).await;
        }
    }
}

#[avr_device::entry]
fn main() -> ! {
    static TX: ConstStaticCell<[u8; 64]> = ConstStaticCell::new([0; 64]);
    static RX: ConstStaticCell<[u8; 64]> = ConstStaticCell::new([0; 64]);

    let chip = pac::Peripherals::take().unwrap();
    let pins = Pins::new(chip.PORTB, chip.PORTC, chip.PORTD);
    let uart = BufferedUart::new(
        chip.USART0,
        pins.PD0,
        pins.PD1,
        Irqs,
        CONFIG,
        TX.take(),
        RX.take(),
    );
    executor::run(Irqs, |spawner| spawner.spawn(echo(uart).unwrap()))
}
// ANCHOR_END: uart

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Never linked: `panic = "immediate-abort"`.
    loop {}
}
