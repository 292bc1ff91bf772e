//! What differs between the chip and QEMU's idea of it: clocks, the alarms of the ports, and when the
//! transmitter is ready or done. Everything else is the same source in both.
//!
//! Both modules have the same functions. Those about ports are called from interrupts of the line, which
//! do not nest, or with interrupts off; `port` is the place in [`WIRING`](crate::ports::WIRING).

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
