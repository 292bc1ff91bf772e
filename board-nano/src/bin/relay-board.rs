//! The unit with the relays: four of them on D4..D7, holding registers 1 to 4. Reads 0 or 1; takes the
//! commands of such boards, 0x0100 on, 0x0200 off, 0x0300 toggle.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use board_nano::{Rs485, bind_interrupts, options, settings};
use embassy_avr_hal::gpio::PortDOut;
use multidrop::protocol::data::{Registers, RegistersOut};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::format::LineFormat;
use multidrop::protocol::registers::within;
use multidrop::protocol::server::DataModel;
use multidrop::{PortConfig, Roll, ServerPort, Shared, signed};
use static_cell::StaticCell;

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

/// The tasks that have to be alive.
static ROLL: Roll<Irqs, 2> = Roll::new();

#[embassy_executor::task]
async fn receive(port: &'static ServerPort<Rs485>) -> ! {
    signed(|task| ROLL.sign::<0>(task), multidrop::receive(port)).await
}

#[embassy_executor::task]
async fn serve(port: &'static ServerPort<Rs485>) -> ! {
    let relays = Shared::new(Relays {
        on: 0,
        pins: PortDOut::new(0b1111 << PIN),
    });
    signed(|task| ROLL.sign::<1>(task), multidrop::serve(port, &relays)).await
}

#[avr_device::entry]
fn main() -> ! {
    let board = board_nano::init(Irqs);
    let line = board.rs4.open(Irqs, const { settings(&PORT) });

    static PORT_CELL: StaticCell<ServerPort<Rs485>> = StaticCell::new();
    let port = PORT_CELL.init(ServerPort::new(line, &PORT));
    board_nano::run(&ROLL, |spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(serve(port).unwrap());
    })
}
