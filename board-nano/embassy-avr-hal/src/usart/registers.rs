//! The registers of USART0 (DS 20.11) and the pin-change flag that stands in for a start-bit detector.

use multidrop_protocol::frame::ReceiveErrors;

use super::settings::{Framings, Kept, Settings};
use crate::edge;
use crate::pac::{EXINT, USART0};

/// Bits of UCSR0A.
const TXC: u8 = 1 << 6;
pub(super) const UDRE: u8 = 1 << 5;
const FE: u8 = 1 << 4;
const DOR: u8 = 1 << 3;
const UPE: u8 = 1 << 2;

/// Bits of UCSR0B.
const RXCIE: u8 = 1 << 7;
const TXCIE: u8 = 1 << 6;
const UDRIE: u8 = 1 << 5;
const RXEN: u8 = 1 << 4;
const TXEN: u8 = 1 << 3;

/// PCINT16, which is RXD, of PCMSK2 (DS 13.2.6): the start-bit detector is [`edge`](crate::edge)'s.
const PCINT16: u8 = 1 << 0;

/// The registers of USART0.
pub(super) struct Usart;

impl Usart {
    #[inline(always)]
    fn block() -> &'static crate::pac::usart0::RegisterBlock {
        // SAFETY: the block exists at this address for the life of the program; it is touched by the
        // interrupts of the line and, with interrupts off, by its futures.
        unsafe { &*USART0::ptr() }
    }

    #[inline(always)]
    pub fn status() -> u8 {
        Self::block().ucsr0a().read().bits()
    }

    /// The character that has come in; to be read once.
    #[inline(always)]
    pub fn take() -> u8 {
        Self::block().udr0().read().bits()
    }

    #[inline(always)]
    pub fn put(byte: u8) {
        // SAFETY: any byte may be sent.
        Self::block().udr0().write(|w| unsafe { w.bits(byte) });
    }

    #[inline(always)]
    fn control(bits: u8) {
        // SAFETY: enable bits only; their handlers are bound with the line.
        Self::block().ucsr0b().write(|w| unsafe { w.bits(bits) });
    }
}

fn exint() -> &'static crate::pac::exint::RegisterBlock {
    // SAFETY: as for the USART; PCMSK2 is changed bit by bit.
    unsafe { &*EXINT::ptr() }
}

/// What the error bits of UCSR0A mean.
#[inline(always)]
pub(super) fn errors(status: u8) -> ReceiveErrors {
    let mut errors = ReceiveErrors::NONE;
    if status & FE != 0 {
        errors |= ReceiveErrors::FRAMING;
    }
    if status & DOR != 0 {
        errors |= ReceiveErrors::OVERRUN;
    }
    if status & UPE != 0 {
        errors |= ReceiveErrors::PARITY;
    }
    errors
}

/// Baud rate, format, receiver and transmitter on.
pub(super) fn set_up<F: Framings>(settings: &Settings<F>) {
    // SAFETY: the values come from `Settings`, which makes valid ones only.
    unsafe {
        Usart::block().ubrr0().write(|w| w.bits(settings.ubrr));
        Usart::block()
            .ucsr0a()
            .write(|w| w.bits(settings.kept.ucsra));
        Usart::block().ucsr0c().write(|w| w.bits(settings.ucsrc));
        exint().pcmsk2().modify(|r, w| w.bits(r.bits() | PCINT16));
    }
    listen();
}

/// Receiver on. What RXD did while it was off is no start bit: a transceiver may have heard itself.
#[inline(always)]
pub(super) fn listen() {
    edge::clear_start_bit();
    Usart::control(RXCIE | RXEN | TXEN);
}

/// Receiver off, transmitter with its interrupts on, TXC of an earlier character cleared.
#[inline(always)]
pub(super) fn send(kept: &Kept) {
    clear_sent(kept);
    Usart::control(TXCIE | UDRIE | TXEN);
}

/// Receiver off, transmitter without interrupts.
#[inline(always)]
pub(super) fn hold() {
    Usart::control(TXEN);
}

/// Clears the flag TXC.
#[inline(always)]
pub(super) fn clear_sent(kept: &Kept) {
    // SAFETY: TXC is cleared by writing a one; U2X keeps its value.
    Usart::block()
        .ucsr0a()
        .write(|w| unsafe { w.bits(TXC | kept.ucsra) });
}

/// The last byte is in the USART: UDRE would interrupt for ever.
#[inline(always)]
pub(super) fn nothing_more() {
    Usart::control(TXCIE | TXEN);
}
