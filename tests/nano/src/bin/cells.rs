//! Reads and writes the EEPROM as `ORDER` in SRAM says, which a test fills from outside. INT0 interrupts at any edge of D2.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use core::future::poll_fn;
use core::pin::pin;
use core::sync::atomic::{AtomicU8, Ordering::Relaxed};
use core::task::Poll;

use embassy_avr_hal::eeprom::Eeprom;
use embassy_avr_hal::{bind_interrupts, executor, pac};
use embedded_storage::{ReadStorage, Storage};

bind_interrupts!(struct Irqs { EEPROM; });

/// The most bytes of one order.
const ROOM: usize = 32;

/// What to do: 1 reads, 2 writes, 3 begins to write and gives up. 4 reads and 5 writes, blocking; 6 and 7 do so 65536 bytes further on.
/// 0 where it is done.
#[unsafe(no_mangle)]
static ORDER: AtomicU8 = AtomicU8::new(0);
/// 1: it was done. 2: the range was refused.
#[unsafe(no_mangle)]
static RESULT: AtomicU8 = AtomicU8::new(0);
/// The first address, low byte first.
#[unsafe(no_mangle)]
static ADDRESS: [AtomicU8; 2] = [const { AtomicU8::new(0) }; 2];
/// How many bytes, at most [`ROOM`].
#[unsafe(no_mangle)]
static LEN: AtomicU8 = AtomicU8::new(0);
/// The bytes of an order.
#[unsafe(no_mangle)]
static BYTES: [AtomicU8; ROOM] = [const { AtomicU8::new(0) }; ROOM];

/// INT0 (DS 12.4: vector 1) takes its time, and does nothing else.
#[unsafe(no_mangle)]
extern "avr-interrupt" fn __vector_1() {}

/// Waits for an order, awake.
async fn order() -> u8 {
    poll_fn(|context| match ORDER.load(Relaxed) {
        0 => {
            context.waker().wake_by_ref();
            Poll::Pending
        }
        order => Poll::Ready(order),
    })
    .await
}

#[embassy_executor::task]
async fn obey(mut eeprom: Eeprom) {
    loop {
        let order = order().await;
        let address = u16::from_le_bytes([ADDRESS[0].load(Relaxed), ADDRESS[1].load(Relaxed)]);
        let mut room: [u8; ROOM] = core::array::from_fn(|i| BYTES[i].load(Relaxed));
        let bytes = &mut room[..usize::from(LEN.load(Relaxed)).min(ROOM)];
        let done = match order {
            1 => eeprom.read(address, bytes).await,
            2 => eeprom.write(address, bytes).await,
            4 => ReadStorage::read(&mut eeprom, address.into(), bytes),
            5 => Storage::write(&mut eeprom, address.into(), bytes),
            6 => ReadStorage::read(&mut eeprom, u32::from(address) + 0x1_0000, bytes),
            7 => Storage::write(&mut eeprom, u32::from(address) + 0x1_0000, bytes),
            _ => {
                let mut write = pin!(eeprom.write(address, bytes));
                match poll_fn(|context| Poll::Ready(write.as_mut().poll(context))).await {
                    Poll::Ready(done) => done,
                    Poll::Pending => Ok(()),
                }
            }
        };
        for (cell, byte) in BYTES.iter().zip(room) {
            cell.store(byte, Relaxed);
        }
        RESULT.store(if done.is_ok() { 1 } else { 2 }, Relaxed);
        ORDER.store(0, Relaxed);
    }
}

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    // Any edge (DS 13.2.1, EICRA; 13.2.2, EIMSK).
    chip.EXINT.eicra().write(|w| w.isc0().val_0x01());
    chip.EXINT.eimsk().write(|w| w.int0().set_bit());
    executor::run(Irqs, |spawner| {
        spawner.spawn(obey(Eeprom::new(chip.EEPROM, Irqs)).unwrap())
    })
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Never linked: `panic = "immediate-abort"`.
    loop {}
}
