//! Counts its starts in the EEPROM and shows the count, modulo 64, on port B.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use embassy_avr_hal::eeprom::Eeprom;
use embassy_avr_hal::gpio::PortBOut;
use embassy_avr_hal::{bind_interrupts, executor, pac};

bind_interrupts!(struct Irqs { EEPROM; });

/// Where the count is kept, two bytes, little endian.
const ADDRESS: u16 = 16;

#[embassy_executor::task]
async fn count(mut eeprom: Eeprom) {
    let mut show = PortBOut::new(0b0011_1111);
    let mut bytes = [0; 2];
    if eeprom.read(ADDRESS, &mut bytes).await.is_ok() {
        // An erased cell reads 0xFF: the first start makes 0 of it.
        let count = u16::from_le_bytes(bytes).wrapping_add(1);
        if eeprom.write(ADDRESS, &count.to_le_bytes()).await.is_ok() {
            show.write(count as u8);
        }
    }
}

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    executor::run(Irqs, |spawner| {
        spawner.spawn(count(Eeprom::new(chip.EEPROM, Irqs)).unwrap())
    })
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Never linked: `panic = "immediate-abort"`.
    loop {}
}
