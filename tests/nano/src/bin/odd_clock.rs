//! `embassy-time` at 11.0592 MHz, of whose timer 864 ticks are 625 of its own: PB0 changes every second, and PB1 before and after
//! each wait of 1, 2 ... 400 us.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use embassy_avr_hal::gpio::{Output, PB0, PB1, Pins};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use embassy_time::{Duration, Ticker, Timer};
use embedded_hal::digital::StatefulOutputPin;

bind_interrupts!(struct Irqs { TIME => 11_059_200, slots = 2; });

#[embassy_executor::task]
async fn beat(mut out: Output<PB0>) {
    let mut ticker = Ticker::every(Duration::from_secs(1));
    loop {
        ticker.next().await;
        let Ok(()) = out.toggle();
    }
}

#[embassy_executor::task]
async fn wait(mut out: Output<PB1>) {
    for us in 1..=400 {
        let Ok(()) = out.toggle();
        Timer::after_micros(us).await;
        let Ok(()) = out.toggle();
        Timer::after_millis(1).await;
    }
}

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    let pins = Pins::new(chip.PORTB, chip.PORTC, chip.PORTD);
    executor::run(Irqs, |spawner| {
        spawner.spawn(beat(Output::new(pins.PB0, false)).unwrap());
        spawner.spawn(wait(Output::new(pins.PB1, false)).unwrap());
    })
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Never linked: `panic = "immediate-abort"`.
    loop {}
}
