//! The event log of Get Comm Event Log (APP 6.10).

use core::cell::Cell;

use crate::exception::Exception;
use crate::frame::ReceiveErrors;

/// The bit of a receive event.
pub(super) const RECEIVE: u8 = 0x80;
/// The bit of a broadcast in a receive event.
pub(super) const BROADCAST_RECEIVED: u8 = 0x40;
/// The bit of a send event.
pub(super) const SEND: u8 = 0x40;
/// The bit of listen-only mode in a receive or send event.
pub(super) const LISTENS_ONLY: u8 = 0x20;
/// The event of entering listen-only mode.
pub(super) const ENTERED_LISTEN_ONLY: u8 = 0x04;
/// The event of a communication restart.
pub(super) const RESTARTED: u8 = 0x00;

/// The receive event of a damaged frame.
pub(super) fn damaged(errors: ReceiveErrors) -> u8 {
    const COMMUNICATION_ERROR: u8 = 0x02;
    const CHARACTER_OVERRUN: u8 = 0x10;
    let overrun = if errors.contains(ReceiveErrors::OVERRUN) {
        CHARACTER_OVERRUN
    } else {
        0
    };
    RECEIVE | COMMUNICATION_ERROR | overrun
}

/// The send event of an answer with this exception.
pub(super) fn sent(exception: Exception) -> u8 {
    SEND | match exception {
        Exception::IllegalFunction
        | Exception::IllegalDataAddress
        | Exception::IllegalDataValue => 0x01,
        Exception::ServerDeviceFailure => 0x02,
        Exception::Acknowledge | Exception::ServerDeviceBusy => 0x04,
        Exception::NegativeAcknowledge => 0x08,
        _ => 0,
    }
}

/// The last `N` events, of which an answer holds at most 64.
#[derive(Debug)]
pub(super) struct EventLog<const N: usize> {
    events: [Cell<u8>; N],
    /// The place of the next event.
    next: Cell<u8>,
    len: Cell<u8>,
}

impl<const N: usize> EventLog<N> {
    pub(super) const fn new() -> EventLog<N> {
        EventLog {
            events: [const { Cell::new(0) }; N],
            next: Cell::new(0),
            len: Cell::new(0),
        }
    }

    #[inline(never)]
    pub(super) fn push(&self, event: u8) {
        let next = self.next.get();
        if let Some(cell) = self.events.get(usize::from(next)) {
            cell.set(event);
        }
        let after = next.wrapping_add(1);
        self.next
            .set(if usize::from(after) < N { after } else { 0 });
        if usize::from(self.len.get()) < N {
            self.len.set(self.len.get() + 1);
        }
    }

    pub(super) fn clear(&self) {
        self.len.set(0);
    }

    /// Copies the events to `out`, the newest first, as far as there is room; returns their number.
    pub(super) fn copy_to(&self, out: &mut [u8]) -> u8 {
        let mut at = self.next.get();
        let mut count = 0;
        for byte in out.iter_mut().take(usize::from(self.len.get())) {
            at = if at == 0 { N as u8 } else { at }.wrapping_sub(1);
            *byte = self.events.get(usize::from(at)).map_or(0, Cell::get);
            count += 1;
        }
        count
    }
}
