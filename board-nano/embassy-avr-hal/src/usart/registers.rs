//! USART0 as the line uses it, and the pin-change flag that stands in for a start-bit detector.

use multidrop_protocol::frame::ReceiveErrors;

use super::settings::{Framings, Kept, Settings};
use crate::edge;
use crate::pac::EXINT;
use crate::usart0::{DOR, FE, RXCIE, RXEN, TXCIE, TXEN, UDRIE, UPE, Usart};

/// PCINT16, which is RXD, of PCMSK2 (DS 13.2.6): the start-bit detector is [`edge`](crate::edge)'s.
const PCINT16: u8 = 1 << 0;

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
    Usart::clear_sent(kept.ucsra);
}

/// The last byte is in the USART: UDRE would interrupt for ever.
#[inline(always)]
pub(super) fn nothing_more() {
    Usart::control(TXCIE | TXEN);
}
