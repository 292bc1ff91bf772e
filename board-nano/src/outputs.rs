//! The outputs of the demonstration unit's register.
//!
//! Bits 0 to 7 are port D, bits 8 to 15 port B. Bits 0, 1 and 2 have no pin, since RXD, TXD and DE are
//! there, nor have 14 and 15, where the crystal is.

use embassy_avr_hal::gpio::{PortBOut, PortDOut};

use crate::DE_MASK;

/// The pins RXD and TXD.
const USART_MASK: u8 = 0b0000_0011;
/// The pins of the crystal, PB6 and PB7.
const CRYSTAL_MASK: u8 = 0b1100_0000;

/// Makes the pins outputs, all low, and returns a closure that puts a register on them.
pub fn outputs() -> impl FnMut(u16) {
    let mut port_b = PortBOut::new(!CRYSTAL_MASK);
    let mut port_d = PortDOut::new(!(USART_MASK | DE_MASK));
    move |outputs: u16| {
        let [high, low] = outputs.to_be_bytes();
        port_b.write(high);
        port_d.write(low);
    }
}
