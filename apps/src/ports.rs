//! The data of the application `ports`: what its port AS1 tells of all ports.
//!
//! What a PC finds there:
//!
//! | table | address | is |
//! |---|---|---|
//! | input registers | 0, 1, 2 | register 0 of unit 1, 2, 3 |
//! | | 3, 4, 5 | good answers of each, up to 65535 |
//! | | 6, 7, 8 | other ends of its polls |
//! | | 9 | frames that found no room to be printed, modulo 65536 |
//! | holding registers | 1000 + 2 n | register n of AS1, high word first (`Register::number`; arrays are not there) |
//! | | 2000, 3000, 4000 + 2 n | the same of AS2, RS2 and RS4 |
//!
//! Written is one of those at a time, both words by function 16; 03 if the port refuses it. So `BAUD` (22) of RS4 becomes
//! 9600 with 0 and 9600 written to 4044. What is written of AS1 itself holds as soon as the write is answered; a reset
//! brings everything back to what is below.

use multidrop::Manager;
use multidrop::poll::PollList;
use multidrop::protocol::data::{Registers, RegistersOut};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::port_registers::Register;
use multidrop::protocol::registers::within;
use multidrop::protocol::server::DataModel;
use multidrop::sniff::Capture;

/// How many ports there are.
const PORTS: usize = 4;

/// Where the registers of the first port begin, and how far apart they are.
const SETTINGS: u16 = 1000;

/// What AS1 tells.
pub struct Told {
    /// The polls of RS4: an entry for each unit.
    pub polled: &'static PollList<3, 3>,
    /// What RS4 hears.
    pub capture: &'static Capture<384>,
    /// The manager of all ports.
    pub manager: Manager<PORTS>,
}

/// The port, its register, and whether the address is that of the low word.
fn setting(address: u16) -> Result<(usize, Register, bool), Exception> {
    let port = (address / SETTINGS).checked_sub(1);
    let port = port.ok_or(Exception::IllegalDataAddress)?;
    let word = address % SETTINGS;
    let register = u8::try_from(word / 2).ok();
    let register = register.and_then(|number| Register::from_number(number, 0));
    match register {
        Some(register) if usize::from(port) < PORTS && register.index().is_none() => {
            Ok((port.into(), register, !word.is_multiple_of(2)))
        }
        _ => Err(Exception::IllegalDataAddress),
    }
}

impl DataModel for Told {
    fn input_registers(&mut self, first: u16, mut out: RegistersOut<'_>) -> Result<(), Exception> {
        within(first, out.len() as u16, 10)?;
        out.fill_from((usize::from(first)..).map(|address| match address {
            0..3 => self.polled.with_cells(address, |cells| cells[0]),
            3..6 => self.polled.health(address - 3).answers,
            6..9 => {
                let health = self.polled.health(address - 6);
                let (timeouts, others) = (health.timeouts, health.others);
                timeouts
                    .saturating_add(health.exceptions)
                    .saturating_add(others)
            }
            _ => self.capture.dropped() as u16,
        }));
        Ok(())
    }

    fn holding_registers(
        &mut self,
        first: u16,
        mut out: RegistersOut<'_>,
    ) -> Result<(), Exception> {
        for place in 0..out.len() {
            let address = first.checked_add(place as u16);
            let (port, register, is_low) = setting(address.ok_or(Exception::IllegalDataAddress)?)?;
            let value = self.manager.read(port, register);
            let value = value.map_err(|_| Exception::IllegalDataAddress)?;
            out.set(place, if is_low { value } else { value >> 16 } as u16);
        }
        Ok(())
    }

    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        let (_, _, is_low) = setting(first)?;
        if is_low || values.len() != 2 {
            return Err(Exception::IllegalDataAddress);
        }
        Ok(())
    }

    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        let (port, register, _) = setting(first)?;
        let word = |place| u32::from(values.get(place).unwrap_or(0));
        let loaded = self
            .manager
            .load_raw(port, register, word(0) << 16 | word(1));
        loaded.map_err(|_| Exception::IllegalDataValue)
    }
}
