//! Two tasks on `embassy-time`: PB5, a Nano's LED, changes every 10 ms, PB4 every 7 ms.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use embassy_avr_hal::gpio::{Output, PB4, PB5, Pins};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use embassy_time::{Duration, Ticker, Timer};
use embedded_hal::digital::StatefulOutputPin;

bind_interrupts!(struct Irqs { TIME => 16_000_000; });

/// Keeps the beat: no drift.
#[embassy_executor::task]
async fn beat(mut led: Output<PB5>) {
    let mut ticker = Ticker::every(Duration::from_millis(10));
    loop {
        ticker.next().await;
        let Ok(()) = led.toggle();
    }
}

/// Waits between two changes: a little longer each time.
#[embassy_executor::task]
async fn wait(mut led: Output<PB4>) {
    loop {
        Timer::after_millis(7).await;
        let Ok(()) = led.toggle();
    }
}

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    let pins = Pins::new(chip.PORTB, chip.PORTC, chip.PORTD);
    executor::run(Irqs, |spawner| {
        spawner.spawn(beat(Output::new(pins.PB5, false)).unwrap());
        spawner.spawn(wait(Output::new(pins.PB4, false)).unwrap());
    })
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Never linked: `panic = "immediate-abort"`.
    loop {}
}
