//! The differences between the chip and its model in QEMU: clocks and the alarms of the ports. All other source code is the same
//! for both.
//!
//! Both modules have the same functions. The functions for ports are called from interrupts of the line, which do not nest, or with
//! interrupts off; `port` is the place in [`WIRING`](crate::ports::WIRING).

#[cfg(feature = "hardware")]
mod hardware;
#[cfg(feature = "hardware")]
pub(crate) use hardware::*;

#[cfg(feature = "qemu")]
mod qemu;
#[cfg(feature = "qemu")]
pub(crate) use qemu::*;

#[cfg(all(feature = "hardware", feature = "qemu"))]
compile_error!(
    "features hardware and qemu: an image is for one of the two; --no-default-features --features qemu"
);
#[cfg(not(any(feature = "hardware", feature = "qemu")))]
compile_error!("an image needs feature hardware or qemu");

use embassy_stm32::interrupt::Priority;

/// The priority of the USART interrupts. Interrupts of the line are in one group, so that they do not nest: each port waits for at
/// most one interrupt of each other port. Pending characters go before alarms, which take slightly longer.
const CHARACTERS: Priority = Priority::P0;
/// The priority of the alarm interrupts, in one group with [`CHARACTERS`].
const ALARMS: Priority = Priority::P1;
/// The priority of interrupts that the line's interrupts may interrupt.
#[cfg(feature = "hardware")]
const OTHERS: Priority = Priority::P8;

/// PRIGROUP of AIRCR: the highest bit of a priority is its group, the other three bits say which interrupt goes first (ARMv7-M
/// B3.2.6; PM0214 4.4.5).
pub(crate) const PRIORITY_GROUPS: u32 = 6 << 8;

fn group_priorities() {
    const VECTKEY: u32 = 0x05FA << 16;
    // SAFETY: AIRCR has no other field that keeps a value.
    unsafe {
        (*cortex_m::peripheral::SCB::PTR)
            .aircr
            .write(VECTKEY | PRIORITY_GROUPS);
    }
}
