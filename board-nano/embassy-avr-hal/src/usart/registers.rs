//! USART0 as the line uses it, and the pin-change flag that serves as a start-bit detector.

use multidrop_protocol::frame::ReceiveErrors;

use super::settings::{Framings, Kept, Settings};
use crate::edge;
use crate::pac::EXINT;
use crate::usart0::{DOR, FE, RXCIE, RXEN, TXCIE, TXEN, UDRIE, UPE, Usart};

/// PCINT16 of PCMSK2, the bit of RXD (DS 13.2.6). The start-bit detector is in [`edge`](crate::edge).
const PCINT16: u8 = 1 << 0;

fn exint() -> &'static crate::pac::exint::RegisterBlock {
    // SAFETY: as for the USART; PCMSK2 is changed bit by bit.
    unsafe { &*EXINT::ptr() }
}

/// The receive errors that the error bits of UCSR0A report.
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

/// Sets baud rate and format, and turns receiver and transmitter on.
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

/// Turns the receiver on. An edge on RXD while the receiver was off is no start bit: a transceiver may have heard itself.
#[inline(always)]
pub(super) fn listen() {
    edge::clear_start_bit();
    Usart::control(RXCIE | RXEN | TXEN);
}

/// Turns the receiver off, and the transmitter on with its interrupts. Clears TXC of an earlier character.
#[inline(always)]
pub(super) fn send(kept: &Kept) {
    clear_sent(kept);
    Usart::control(TXCIE | UDRIE | TXEN);
}

/// Turns the receiver off, and the transmitter on without interrupts.
#[inline(always)]
pub(super) fn hold() {
    Usart::control(TXEN);
}

/// Clears the flag TXC.
#[inline(always)]
pub(super) fn clear_sent(kept: &Kept) {
    Usart::clear_sent(kept.ucsra);
}

/// Turns the interrupt UDRE off, which would never end: the last byte is in the USART.
#[inline(always)]
pub(super) fn nothing_more() {
    Usart::control(TXCIE | TXEN);
}
