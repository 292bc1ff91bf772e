//! The four ports with their USARTs and pins. To move a pin, change its line in [`WIRING`]. The build stops if a pin is in use
//! twice.

use core::marker::PhantomData;

use multidrop::PortConfig;
use multidrop::line::LineError;
use multidrop::protocol::message::Message;
use multidrop::protocol::port_registers::{Duplex, Flow};

use crate::usart::Settings;

/// The clock of APB1 and the USARTs on it, in Hz: the highest that is allowed (DS, general operating conditions).
pub const APB1_HZ: u32 = 42_000_000;
/// The clock of APB2 and the USART on it, in Hz: half of the highest, so that AS1 too makes 1200 baud (RM0090 30.6.3).
pub const APB2_HZ: u32 = 42_000_000;

/// The number of ports.
pub const PORTS: usize = 4;

/// A pin of GPIOA, GPIOB or GPIOC, 0..=15.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pin {
    /// `'A'`, `'B'` or `'C'`.
    pub gpio: char,
    /// The number of the pin in its GPIO, 0..=15.
    pub number: u8,
}

/// Makes a pin from its name.
pub const fn pin(gpio: char, number: u8) -> Pin {
    assert!(matches!(gpio, 'A'..='C') && number < 16);
    Pin { gpio, number }
}

/// The pins of RTS/CTS flow control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Handshake {
    /// Clear to send, an input: the USART sends while it is low.
    pub cts: Pin,
    /// Ready to receive, an output: low while the USART takes characters. It is low while the port sends too, although the port
    /// hears nothing then (ES0182, RTS is active while RE or UE is 0).
    pub rts: Pin,
}

/// The wiring of a port.
#[derive(Clone, Copy, Debug)]
pub struct Wiring {
    /// The name of the port.
    pub name: &'static str,
    /// The transmit pin.
    pub tx: Pin,
    /// The receive pin. Its number is the EXTI line that sees start bits; no two ports may share a line.
    pub rx: Pin,
    /// The alternate function that connects these pins and those of the handshake to the USART (DS, alternate function mapping).
    pub function: u8,
    /// The driver enable pin of the RS-485 transceiver.
    pub de: Option<Pin>,
    /// The pins of flow control, where they are free.
    pub handshake: Option<Handshake>,
    /// The clock of the USART, in Hz.
    pub clock_hz: u32,
}

/// The pins of GPIOC that show the demonstration unit's register: bits 0 to 12 on PC0 to PC12. PC12 is the LED of the
/// STM32-H405, which is lit while the bit is off; PC13 to PC15 drive 3 mA, and no LED (DS, pin definitions).
pub const LEDS: u16 = 0x1FFF;

/// The ports, in the order AS1 (USART1), AS2 (USART2), RS2 (USART3), RS4 (UART4).
///
/// The pins PA0 and PA1, which USART2 would use for CTS and RTS, belong to RS4; UART4 has neither. DE is PA4, the next pin beside
/// RS4's that no port, LED, debugger or oscillator uses. DE is not PC12: there the LED of the STM32-H405 takes a pin high that is
/// not driven, so that the bus would be driven during reset. PA0 is the button of that board too, which drives the pin while it is
/// pressed.
pub const WIRING: [Wiring; PORTS] = [
    Wiring {
        name: "AS1",
        tx: pin('A', 9),
        rx: pin('A', 10),
        function: 7,
        de: None,
        handshake: Some(Handshake {
            cts: pin('A', 11),
            rts: pin('A', 12),
        }),
        clock_hz: APB2_HZ,
    },
    Wiring {
        name: "AS2",
        tx: pin('A', 2),
        rx: pin('A', 3),
        function: 7,
        de: None,
        handshake: None,
        clock_hz: APB1_HZ,
    },
    Wiring {
        name: "RS2",
        tx: pin('B', 10),
        rx: pin('B', 11),
        function: 7,
        de: None,
        handshake: Some(Handshake {
            cts: pin('B', 13),
            rts: pin('B', 14),
        }),
        clock_hz: APB1_HZ,
    },
    Wiring {
        name: "RS4",
        tx: pin('A', 0),
        rx: pin('A', 1),
        function: 8,
        de: Some(pin('A', 4)),
        handshake: None,
        clock_hz: APB1_HZ,
    },
];

const _: () = check(&WIRING);

/// A mask for [`check`]: one bit for each pin of the three GPIOs.
const fn bit(pin: Pin) -> u64 {
    1 << ((pin.gpio as u32 - 'A' as u32) * 16 + pin.number as u32)
}

const fn check(ports: &[Wiring; PORTS]) {
    // The demonstration unit's outputs; JTAG and SWD.
    let mut used = (LEDS as u64) << 32;
    let debugger = [pin('A', 13), pin('A', 14), pin('A', 15), pin('B', 3)];
    let mut i = 0;
    while i < debugger.len() {
        used |= bit(debugger[i]);
        i += 1;
    }
    let mut lines: u16 = 0;
    let mut port = 0;
    while port < PORTS {
        let wiring = &ports[port];
        let (de, handshake) = (wiring.de, wiring.handshake);
        used = take(wiring, used, wiring.tx);
        used = take(wiring, used, wiring.rx);
        if let Some(de) = de {
            used = take(wiring, used, de);
        }
        if let Some(handshake) = handshake {
            used = take(wiring, used, handshake.cts);
            used = take(wiring, used, handshake.rts);
        }
        if lines & 1 << wiring.rx.number != 0 {
            wrong(wiring, wiring.rx, "has the EXTI line of another rx pin");
        }
        lines |= 1 << wiring.rx.number;
        port += 1;
    }
}

/// Stops the build if a port uses the pin `free`, which is given to the application.
pub(crate) const fn check_free(free: Pin) {
    let mut port = 0;
    while port < PORTS {
        let wiring = &WIRING[port];
        let mut used = bit(wiring.tx) | bit(wiring.rx);
        if let Some(de) = wiring.de {
            used |= bit(de);
        }
        if let Some(handshake) = wiring.handshake {
            used |= bit(handshake.cts) | bit(handshake.rts);
        }
        if used & bit(free) != 0 {
            wrong(wiring, free, "is given to the application, in board.rs");
        }
        port += 1;
    }
}

const fn take(wiring: &Wiring, used: u64, pin: Pin) -> u64 {
    if used & bit(pin) != 0 {
        wrong(wiring, pin, "is in use already");
    }
    used | bit(pin)
}

const fn wrong(wiring: &Wiring, pin: Pin, what: &str) -> ! {
    Message::new()
        .text("port ")
        .text(wiring.name)
        .text(": pin P")
        .text(match pin.gpio {
            'A' => "A",
            'B' => "B",
            _ => "C",
        })
        .number(pin.number as u32)
        .text(" ")
        .text(what)
        .fail()
}

/// A port as a type, so that settings made for one port are not used for another.
pub trait Port {
    /// The place of the port in [`WIRING`].
    const INDEX: usize;
}

macro_rules! ports {
    ($($(#[$doc:meta])* $name:ident = $index:expr,)*) => {
        $(
            $(#[$doc])*
            #[derive(Clone, Copy, Debug)]
            pub struct $name;

            impl Port for $name {
                const INDEX: usize = $index;
            }
        )*
    };
}

ports! {
    /// The port on USART1.
    As1 = 0,
    /// The port on USART2.
    As2 = 1,
    /// The port on USART3.
    Rs2 = 2,
    /// The port on UART4, with DE.
    Rs4 = 3,
}

/// Settings of port `P`, made in a `const`: settings that the chip cannot do stop the build.
pub struct PortSetup<P> {
    pub(crate) line: Settings,
    pub(crate) baud: u32,
    port: PhantomData<P>,
}

impl<P: Port> PortSetup<P> {
    /// The settings of `port`.
    ///
    /// # Panics
    /// At compile time, with port, field and value: for a rate that the port's clock does not make within
    /// 2.5 %, for full duplex where there is a DE pin, and for flow control where there are no pins for it.
    pub const fn new(port: &PortConfig) -> Self {
        let wiring = &WIRING[P::INDEX];
        if matches!(port.settings().line.duplex, Duplex::Full) && wiring.de.is_some() {
            port.wrong("duplex", 1, "must be 0 (half): the port has a DE pin", None);
        }
        if matches!(port.settings().line.flow, Flow::RtsCts) && wiring.handshake.is_none() {
            port.wrong(
                "flow",
                1,
                "must be 0 (none): RTS and CTS are on AS1 and RS2 only",
                None,
            );
        }
        let line = port.line();
        match Settings::new(&line, wiring.clock_hz, crate::TICK_HZ) {
            Ok(settings) => Self {
                line: settings,
                baud: line.baud,
                port: PhantomData,
            },
            Err(LineError::Baud { nearest }) => port.wrong(
                "baud",
                line.baud,
                "the clock does not make it within 2.5 %, or the CPU cannot follow",
                Some(nearest),
            ),
            // `PortConfig` has checked the first; the line has all framings and delays, and the pins were checked above.
            Err(
                LineError::Format(_)
                | LineError::Framing(_)
                | LineError::Flow
                | LineError::Delay
                | LineError::Silence,
            ) => port.wrong(
                "format: data bits",
                line.format.data_bits() as u32,
                "must be 8 for RTU",
                None,
            ),
        }
    }
}
