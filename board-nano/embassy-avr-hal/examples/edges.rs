//! An interrupt of one's own that wakes a task: every edge on PB0 changes PB1.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]
#![allow(missing_docs)]

use core::cell::Cell;
use core::future::poll_fn;
use core::task::Poll;

use critical_section::Mutex;
use embassy_avr_hal::gpio::{Input, Output, PB0, PB1, Pins};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use embassy_sync::waitqueue::AtomicWaker;
use embedded_hal::digital::StatefulOutputPin;

bind_interrupts!(
    struct Irqs {}
);

static EDGES: Mutex<Cell<u8>> = Mutex::new(Cell::new(0));
static EDGE: AtomicWaker = AtomicWaker::new();

// PCINT0 (DS 12.4).
#[avr_device::interrupt(atmega328p)]
fn PCINT0() {
    critical_section::with(|cs| {
        let edges = EDGES.borrow(cs);
        edges.set(edges.get().wrapping_add(1));
    });
    EDGE.wake();
}

#[embassy_executor::task]
async fn follow(_edges: Input<PB0>, mut out: Output<PB1>) {
    let mut seen = 0;
    loop {
        poll_fn(|context| {
            EDGE.register(context.waker());
            if critical_section::with(|cs| EDGES.borrow(cs).get()) == seen {
                Poll::Pending
            } else {
                Poll::Ready(())
            }
        })
        .await;
        seen = seen.wrapping_add(1);
        let Ok(()) = out.toggle();
    }
}

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    // PCINT0 of port B, and its interrupt (DS 13.2.4, 13.2.8).
    chip.EXINT.pcmsk0().write(|w| w.pcint().set(1));
    chip.EXINT.pcicr().write(|w| w.pcie().set(1));
    let pins = Pins::new(chip.PORTB, chip.PORTC, chip.PORTD);
    executor::run(Irqs, |spawner| {
        spawner.spawn(follow(Input::new(pins.PB0, true), Output::new(pins.PB1, false)).unwrap());
    })
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Never linked: `panic = "immediate-abort"`.
    loop {}
}
