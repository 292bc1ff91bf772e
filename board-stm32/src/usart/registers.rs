//! The registers of one USART, its pins, and the pending bit of EXTI that serves as a start-bit detector. The code is the same for
//! QEMU, which ignores what it does not model.

use embassy_stm32::pac::gpio::{Gpio, vals::Moder, vals::Ospeedr, vals::Pupdr};
use embassy_stm32::pac::{self, EXTI, SYSCFG, usart::Usart};
use multidrop::protocol::frame::ReceiveErrors;

use super::settings::Settings;
use crate::ports::{PORTS, Pin, WIRING, Wiring};

/// Bits of SR (RM0090 30.6.1).
const PE: u32 = 1 << 0;
const FE: u32 = 1 << 1;
const NF: u32 = 1 << 2;
pub(crate) const ORE: u32 = 1 << 3;
/// The bits for errors of a character.
pub(crate) const ERRORS: u32 = PE | FE | NF | ORE;
pub(crate) const RXNE: u32 = 1 << 5;
/// All bits have left the transmitter, stop bits included.
pub(crate) const TC: u32 = 1 << 6;
/// The transmitter takes another character.
pub(crate) const TXE: u32 = 1 << 7;

/// Bits of CR1 (RM0090 30.6.4). Each interrupt enable has the bit position that its flag has in SR.
const RE: u32 = 1 << 2;
const TE: u32 = 1 << 3;
const RXNEIE: u32 = RXNE;
const UE: u32 = 1 << 13;

/// Bits of CR3 (RM0090 30.6.6).
const RTSE: u32 = 1 << 8;
const CTSE: u32 = 1 << 9;

/// Bits of CR1 that are the same while a port listens and while it sends.
const ALWAYS: u32 = UE | TE;

/// One USART with its DE pin.
#[derive(Clone, Copy)]
pub(crate) struct Registers {
    port: u8,
    usart: Usart,
    /// The EXTI line of RXD, as a bit.
    line: u32,
}

impl Registers {
    /// The registers of this port.
    pub const fn of(port: usize) -> Self {
        let usart = match port {
            0 => pac::USART1,
            1 => pac::USART2,
            2 => pac::USART3,
            _ => pac::UART4,
        };
        Self {
            port: port as u8,
            usart,
            line: 1 << WIRING[port].rx.number,
        }
    }

    /// The status register SR.
    #[inline(always)]
    pub fn status(&self) -> u32 {
        self.usart.sr().read().0
    }

    /// Takes the received character. After a read of SR this clears RXNE and the errors (RM0090 30.6.1).
    #[inline(always)]
    pub fn take(&self) -> u8 {
        self.usart.dr().read().0 as u8
    }

    /// Hands a character to the transmitter. A 0 clears TC (RM0090 30.6.1) after the write: if this call is late, an earlier
    /// character has ended just before, and its TC must not be taken for the TC of this character.
    #[inline(always)]
    pub fn put(&self, character: u8) {
        self.usart
            .dr()
            .write_value(pac::usart::regs::Dr(character.into()));
        self.usart.sr().write_value(pac::usart::regs::Sr(!TC));
    }

    /// Resets the USART as a reset of the chip does, for [`set_up`](Self::set_up) (RM0090 7.3.8, 7.3.9). The manual names no other
    /// way to drop the character that the transmitter holds.
    pub fn reset(&self) {
        let rcc = pac::RCC;
        for on in [true, false] {
            match self.port {
                0 => rcc.apb2rstr().modify(|w| w.set_usart1rst(on)),
                1 => rcc.apb1rstr().modify(|w| w.set_usart2rst(on)),
                2 => rcc.apb1rstr().modify(|w| w.set_usart3rst(on)),
                _ => rcc.apb1rstr().modify(|w| w.set_uart4rst(on)),
            }
        }
    }

    /// Sets baud rate and format. The transmitter stays on from here: with TE it sends an idle character first (RM0090 30.3.2),
    /// which would delay each frame. It does not drive the bus while DE is down.
    pub fn set_up(&self, settings: &Settings) {
        let usart = self.usart;
        // UE off: rate and format must not change under way (RM0090 30.3.4, 30.6.4).
        usart.cr1().write_value(pac::usart::regs::Cr1(0));
        usart
            .brr()
            .write_value(pac::usart::regs::Brr(settings.brr.into()));
        usart
            .cr2()
            .write_value(pac::usart::regs::Cr2Usart(settings.cr2.into()));
        let handshake = if settings.rts_cts { RTSE | CTSE } else { 0 };
        usart
            .cr3()
            .write_value(pac::usart::regs::Cr3Usart(handshake));
        self.listen(settings);
    }

    /// Turns the receiver on, with its interrupt.
    #[inline(always)]
    pub fn listen(&self, settings: &Settings) {
        // Reading SR and DR clears the characters received up to now. The edges of RXD are cleared too: a transceiver may have
        // heard itself.
        self.status();
        self.take();
        self.clear_start_bit();
        self.control(settings, RE | RXNEIE);
    }

    /// Turns the receiver off, so that a transceiver that hears itself is not heard. Enables the interrupt of the flags `interrupt`
    /// of SR.
    #[inline(always)]
    pub fn send(&self, settings: &Settings, interrupt: u32) {
        self.control(settings, interrupt);
    }

    #[inline(always)]
    fn control(&self, settings: &Settings, bits: u32) {
        self.usart.cr1().write_value(pac::usart::regs::Cr1(
            u32::from(settings.cr1) | ALWAYS | bits,
        ));
    }

    /// Whether RXD has fallen since [`clear_start_bit`](Self::clear_start_bit). After a complete character only a start bit, or
    /// noise, makes it fall.
    #[inline(always)]
    pub fn start_bit_seen(&self) -> bool {
        EXTI.pr(0).read().0 & self.line != 0
    }

    /// Clears the start-bit detector, by writing a one (RM0090 12.3.6).
    #[inline(always)]
    pub fn clear_start_bit(&self) {
        EXTI.pr(0).write_value(pac::exti::regs::Lines(self.line));
    }

    /// The DE pin. It is looked up once for each frame, which costs no RAM.
    fn de(&self) -> Option<Pin> {
        WIRING[usize::from(self.port) % PORTS].de
    }

    /// Whether there is a DE pin.
    pub fn has_de(&self) -> bool {
        self.de().is_some()
    }

    /// Takes DE up. The upper half of BSRR clears, the lower half sets (RM0090 8.4.7).
    #[inline(always)]
    pub fn raise_de(&self) {
        if let Some(pin) = self.de() {
            let bits = 1 << pin.number;
            gpio(pin).bsrr().write_value(pac::gpio::regs::Bsrr(bits));
        }
    }

    /// Takes DE down.
    #[inline(always)]
    pub fn lower_de(&self) {
        if let Some(pin) = self.de() {
            let bits = 1 << (16 + pin.number);
            gpio(pin).bsrr().write_value(pac::gpio::regs::Bsrr(bits));
        }
    }
}

/// The receive errors that the error bits of SR report. A character on which the three samples of a bit disagree counts as damaged:
/// an LRC would let one such character in 256 pass.
#[inline(always)]
pub(crate) fn errors(status: u32) -> ReceiveErrors {
    let mut errors = ReceiveErrors::NONE;
    if status & (FE | NF) != 0 {
        errors |= ReceiveErrors::FRAMING;
    }
    if status & ORE != 0 {
        errors |= ReceiveErrors::OVERRUN;
    }
    if status & PE != 0 {
        errors |= ReceiveErrors::PARITY;
    }
    errors
}

/// Enables the clocks of all ports' USARTs and GPIOs, and of SYSCFG (RM0090 7.3.10, 7.3.13, 7.3.14).
pub(crate) fn enable_clocks() {
    pac::RCC.ahb1enr().modify(|w| {
        w.set_gpioaen(true);
        w.set_gpioben(true);
        w.set_gpiocen(true);
    });
    pac::RCC.apb1enr().modify(|w| {
        w.set_usart2en(true);
        w.set_usart3en(true);
        w.set_uart4en(true);
    });
    pac::RCC.apb2enr().modify(|w| {
        w.set_usart1en(true);
        w.set_syscfgen(true);
    });
    // A clock runs some cycles after it is enabled (ES0182, delay after an RCC peripheral clock
    // enabling): reading back waits for it.
    pac::RCC.apb2enr().read();
}

/// Connects the pins of a port except those of the handshake, and its RXD to EXTI. DE is low before it becomes an output.
pub(crate) fn connect(wiring: &Wiring) {
    let line = usize::from(wiring.rx.number);
    // Falling edges only: a start bit begins with one (RM0090 9.2.3 to 9.2.6, 12.3.4).
    SYSCFG
        .exticr(line / 4)
        .modify(|w| w.set_exti(line % 4, wiring.rx.gpio as u8 - b'A'));
    EXTI.ftsr(0).modify(|w| w.set_line(line, true));
    // The manual promises the pending bit only with this bit set; the interrupt stays off in the NVIC (RM0090 12.2.4, 12.3.1).
    EXTI.imr(0).modify(|w| w.set_line(line, true));
    if let Some(de) = wiring.de {
        output(de);
    }
    connect_pin(wiring.tx, wiring.function);
    connect_pin(wiring.rx, wiring.function);
}

/// Connects RTS and CTS of a port, or makes them inputs again. To be called when the USART is on: an earlier RTS would report a
/// receiver that does not listen yet (ES0182, RTS is active while RE or UE is 0).
pub(crate) fn connect_handshake(wiring: &Wiring, on: bool) {
    for pin in wiring
        .handshake
        .iter()
        .flat_map(|pins| [pins.cts, pins.rts])
    {
        if on {
            connect_pin(pin, wiring.function);
        } else {
            let mode = gpio(pin).moder();
            mode.modify(|w| w.set_moder(pin.number.into(), Moder::INPUT));
        }
    }
}

/// Makes a pin an output, low. The other pins of its GPIO stay as they are.
fn output(pin: Pin) {
    let (gpio, n) = (gpio(pin), usize::from(pin.number));
    gpio.bsrr().write(|w| w.set_br(n, true));
    gpio.moder().modify(|w| w.set_moder(n, Moder::OUTPUT));
}

/// Connects a pin to the USART (RM0090 8.3.2): function first, then mode, so that the pin never has another function. The pull-up
/// keeps an open line idle, and TX while the USART is off for its setup. Edges are one step faster than the slowest, so that they
/// take little of a bit at 2 Mbaud (DS, I/O AC characteristics).
fn connect_pin(pin: Pin, function: u8) {
    let (gpio, n) = (gpio(pin), usize::from(pin.number));
    gpio.afr(n / 8).modify(|w| w.set_afr(n % 8, function));
    gpio.pupdr().modify(|w| w.set_pupdr(n, Pupdr::PULL_UP));
    gpio.ospeedr()
        .modify(|w| w.set_ospeedr(n, Ospeedr::MEDIUM_SPEED));
    gpio.moder().modify(|w| w.set_moder(n, Moder::ALTERNATE));
}

/// Takes every driver off the bus, whatever state its port is in (RM0090 8.4.7).
pub(crate) fn lower_all_de() {
    for de in WIRING.iter().filter_map(|wiring| wiring.de) {
        gpio(de).bsrr().write(|w| w.set_br(de.number.into(), true));
    }
}

/// The registers of a pin's port.
const fn gpio(pin: Pin) -> Gpio {
    match pin.gpio {
        'A' => pac::GPIOA,
        'B' => pac::GPIOB,
        _ => pac::GPIOC,
    }
}

/// Makes those of `pins` on GPIOC outputs, low: the outputs of the demonstration unit.
pub(crate) fn outputs_on_gpioc(pins: u16) {
    for n in 0..16 {
        if pins >> n & 1 != 0 {
            output(Pin {
                gpio: 'C',
                number: n,
            });
        }
    }
}

/// Sets those of `pins` on GPIOC that are on in `levels`, clears the others of `pins`, in one step (RM0090 8.4.7).
pub(crate) fn write_gpioc(pins: u16, levels: u16) {
    let set = u32::from(levels & pins);
    let clear = u32::from(!levels & pins) << 16;
    pac::GPIOC
        .bsrr()
        .write_value(pac::gpio::regs::Bsrr(set | clear));
}
