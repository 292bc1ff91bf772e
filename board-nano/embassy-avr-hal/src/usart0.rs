//! The registers of USART0 (DS 20.11), for whoever has the peripheral: a UART or a line.

use multidrop_protocol::format::{LineFormat, Parity};

use crate::pac::USART0;

/// Bits of UCSR0A (DS 20.11.2).
pub(crate) const RXC: u8 = 1 << 7;
pub(crate) const TXC: u8 = 1 << 6;
pub(crate) const UDRE: u8 = 1 << 5;
pub(crate) const FE: u8 = 1 << 4;
pub(crate) const DOR: u8 = 1 << 3;
pub(crate) const UPE: u8 = 1 << 2;
pub(crate) const U2X: u8 = 1 << 1;

/// Bits of UCSR0B (DS 20.11.3).
pub(crate) const RXCIE: u8 = 1 << 7;
pub(crate) const TXCIE: u8 = 1 << 6;
pub(crate) const UDRIE: u8 = 1 << 5;
pub(crate) const RXEN: u8 = 1 << 4;
pub(crate) const TXEN: u8 = 1 << 3;

/// The registers of USART0.
pub(crate) struct Usart;

impl Usart {
    #[inline(always)]
    pub fn block() -> &'static crate::pac::usart0::RegisterBlock {
        // SAFETY: the block exists at this address for the life of the program; it is touched by the interrupts of the one driver
        // that has taken the peripheral, and by its tasks.
        unsafe { &*USART0::ptr() }
    }

    #[inline(always)]
    pub fn status() -> u8 {
        Self::block().ucsr0a().read().bits()
    }

    /// The character that has come in; to be read once, and behind the status that belongs to it (DS 20.11.1).
    #[inline(always)]
    pub fn take() -> u8 {
        Self::block().udr0().read().bits()
    }

    #[inline(always)]
    pub fn put(byte: u8) {
        // SAFETY: any byte may be sent.
        Self::block().udr0().write(|w| unsafe { w.bits(byte) });
    }

    /// Sets the control register UCSR0B.
    #[inline(always)]
    pub fn control(bits: u8) {
        // SAFETY: enable bits only; their handlers are bound with the driver.
        Self::block().ucsr0b().write(|w| unsafe { w.bits(bits) });
    }

    /// Clears TXC, by writing a one. `u2x` is [`U2X`] or 0, which it keeps.
    #[inline(always)]
    pub fn clear_sent(u2x: u8) {
        // SAFETY: TXC and U2X only.
        Self::block()
            .ucsr0a()
            .write(|w| unsafe { w.bits(TXC | u2x) });
    }
}

/// Contents of UCSR0C (DS 20.11.4): parity in bits 5 and 4, stop bits in bit 3, data bits in 2 and 1.
pub(crate) const fn ucsrc(format: LineFormat) -> u8 {
    let parity = match format.parity() {
        Parity::None => 0b00,
        Parity::Even => 0b10,
        Parity::Odd => 0b11,
    };
    let stop = format.stop_bits() - 1;
    let size = format.data_bits() - 5;
    parity << 4 | stop << 3 | size << 1
}
