//! One task waits 40 ms, again and again, and changes PB0 each time; another one does nothing but read the clock.
//! The end of Timer1's turn is then often seen by the reader before its interrupt has run. A third task waits for two
//! times at once, of which the first has passed before it asks for the second, and changes PB1 when it goes on.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use embassy_avr_hal::gpio::{Output, PB0, PB1, Pins};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use embassy_futures::select::select;
use embassy_futures::yield_now;
use embassy_time::{Duration, Instant, Timer, block_for};
use embedded_hal::digital::StatefulOutputPin;

bind_interrupts!(struct Irqs { TIME => 16_000_000; });

#[embassy_executor::task]
async fn wait(mut out: Output<PB0>) {
    loop {
        // Longer than a turn of the timer, which is 32.768 ms: its end is a reason to look at the alarms.
        Timer::after_millis(40).await;
        let Ok(()) = out.toggle();
    }
}

#[embassy_executor::task]
async fn read() {
    loop {
        core::hint::black_box(Instant::now());
        yield_now().await;
    }
}

#[embassy_executor::task]
async fn wait_for_two(mut out: Output<PB1>) {
    loop {
        let second = async {
            block_for(Duration::from_micros(600));
            // More than half of what 31 bits hold.
            Timer::after_secs(1_200).await;
        };
        select(Timer::after_micros(300), second).await;
        let Ok(()) = out.toggle();
        Timer::after_millis(90).await;
    }
}

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    let pins = Pins::new(chip.PORTB, chip.PORTC, chip.PORTD);
    executor::run(Irqs, |spawner| {
        spawner.spawn(wait(Output::new(pins.PB0, false)).unwrap());
        spawner.spawn(read().unwrap());
        spawner.spawn(wait_for_two(Output::new(pins.PB1, false)).unwrap());
    })
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Never linked: `panic = "immediate-abort"`.
    loop {}
}
