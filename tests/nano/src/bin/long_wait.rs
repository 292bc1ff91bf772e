//! PB0 changes every 1100 s, which is more than an alarm is set ahead; `embassy-time` begins a second before its lower half
//! is full.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use embassy_avr_hal::gpio::{Output, PB0, Pins};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use embassy_time::{Duration, Ticker};
use embedded_hal::digital::StatefulOutputPin;

bind_interrupts!(struct Irqs { TIME => 16_000_000, slots = 1, begin = (1 << 32) - 1_000_000; });

#[embassy_executor::task]
async fn wait(mut out: Output<PB0>) {
    let mut ticker = Ticker::every(Duration::from_secs(1_100));
    loop {
        ticker.next().await;
        let Ok(()) = out.toggle();
    }
}

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    let pins = Pins::new(chip.PORTB, chip.PORTC, chip.PORTD);
    executor::run(Irqs, |spawner| {
        spawner.spawn(wait(Output::new(pins.PB0, false)).unwrap())
    })
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Never linked: `panic = "immediate-abort"`.
    loop {}
}
