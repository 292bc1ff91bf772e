//! The unit with the relays: four of them on D4..D7, holding registers 1 to 4. Reads 0 or 1; takes the
//! commands of such boards, 0x0100 on, 0x0200 off, 0x0300 toggle.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use board_nano::{Rs485, bind_interrupts, options, settings};
use embassy_avr_hal::gpio::PortDOut;
use multidrop::prelude::*;

const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(options::unit(1))
    .baud(options::baud(38_400))
    .format(options::format(LineFormat::F8N1));

/// Relays, and the register of the first.
const COUNT: u16 = 4;
const FIRST: u16 = 1;
/// The pin of the first in port D.
const PIN: u8 = 4;

const ON: u16 = 0x0100;
const OFF: u16 = 0x0200;
const TOGGLE: u16 = 0x0300;

/// One bit for each relay.
struct Relays {
    on: u8,
    pins: PortDOut,
}

impl DataModel for Relays {
    const WRITES_MAY_FAIL: bool = false;

    fn holding_registers(
        &mut self,
        first: u16,
        mut out: RegistersOut<'_>,
    ) -> Result<(), Exception> {
        let relay = relay(first, out.len())?;
        out.fill_from((relay..).map(|relay| u16::from(self.on >> relay & 1)));
        Ok(())
    }

    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        relay(first, values.len())?;
        if values
            .iter()
            .all(|value| matches!(value, ON | OFF | TOGGLE))
        {
            Ok(())
        } else {
            Err(Exception::IllegalDataValue)
        }
    }

    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        for (relay, command) in (relay(first, values.len())?..).zip(values.iter()) {
            let bit = 1 << relay;
            match command {
                ON => self.on |= bit,
                OFF => self.on &= !bit,
                _ => self.on ^= bit,
            }
        }
        self.pins.write(self.on << PIN);
        Ok(())
    }
}

/// The relay of the first register of a block.
fn relay(first: u16, count: usize) -> Result<u8, Exception> {
    let relay = first
        .checked_sub(FIRST)
        .ok_or(Exception::IllegalDataAddress)?;
    within(relay, count as u16, COUNT)?;
    Ok(relay as u8)
}

bind_interrupts!(struct Irqs { USART0 => Rs485; });

multidrop::server! {
    static ROLL: Roll<Irqs>;
    fn server(line: Rs485, PORT) = Relays {
        on: 0,
        pins: PortDOut::new(0b1111 << PIN),
    };
}

#[avr_device::entry]
fn main() -> ! {
    let board = board_nano::init(Irqs);
    let line = board.rs4.open(Irqs, const { settings(&PORT) });
    board_nano::run(&ROLL, server(line))
}
