//! How the board is wired.

use super::PORTS;
use super::gpio::{Pin, pin};

/// What a port of the board is wired to: where its registers are, and the pins that go to its transceiver with their
/// alternate function (DS, table of alternate functions).
pub(super) struct Wiring {
    pub(super) usart: u32,
    /// Offset and bit of its reset in RCC (RM0090 7.3.8, 7.3.9).
    pub(super) reset: (u32, u32),
    pub(super) function: u8,
    pub(super) tx: Pin,
    pub(super) rx: Pin,
    pub(super) cts: Option<Pin>,
    pub(super) rts: Option<Pin>,
    pub(super) de: Option<Pin>,
}

/// AS1, AS2, RS2, RS4.
pub(super) const WIRING: [Wiring; PORTS] = [
    Wiring {
        usart: 0x4001_1000,
        reset: (0x24, 4),
        function: 7,
        tx: pin('A', 9),
        rx: pin('A', 10),
        cts: Some(pin('A', 11)),
        rts: Some(pin('A', 12)),
        de: None,
    },
    Wiring {
        usart: 0x4000_4400,
        reset: (0x20, 17),
        function: 7,
        tx: pin('A', 2),
        rx: pin('A', 3),
        cts: None,
        rts: None,
        de: None,
    },
    Wiring {
        usart: 0x4000_4800,
        reset: (0x20, 18),
        function: 7,
        tx: pin('B', 10),
        rx: pin('B', 11),
        cts: Some(pin('B', 13)),
        rts: Some(pin('B', 14)),
        de: None,
    },
    Wiring {
        usart: 0x4000_4C00,
        reset: (0x20, 19),
        function: 8,
        tx: pin('A', 0),
        rx: pin('A', 1),
        cts: None,
        rts: None,
        de: Some(pin('A', 4)),
    },
];
