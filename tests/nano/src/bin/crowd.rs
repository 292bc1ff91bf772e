//! Five tasks that wait, and room for four: all are in time all the same.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

mod beats;

use embassy_avr_hal::gpio::Pins;
use embassy_avr_hal::{bind_interrupts, executor, pac};

bind_interrupts!(struct Irqs { TIME => 16_000_000, slots = 4; });

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    let pins = Pins::new(chip.PORTB, chip.PORTC, chip.PORTD);
    executor::run(Irqs, |spawner| beats::spawn(spawner, pins))
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Never linked: `panic = "immediate-abort"`.
    loop {}
}
