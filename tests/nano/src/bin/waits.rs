//! Five tasks that wait, with room for five. `embassy-time` begins a second before its lower half is full.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

mod beats;

use embassy_avr_hal::gpio::Pins;
use embassy_avr_hal::{bind_interrupts, executor, pac};

bind_interrupts!(struct Irqs { TIME => 16_000_000, slots = 5, begin = (1 << 32) - 1_000_000; });

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
