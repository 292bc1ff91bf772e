//! Four ports at once.
//!
//! | port | is |
//! |---|---|
//! | AS1 | slave 10, RTU 38400 8N1: tells a PC what was collected, routes units 1, 2 and 3 to RS4, and loads the other ports' registers |
//! | AS2 | slave 1, ASCII 19200 7E1: 16 registers and 16 coils of its own |
//! | RS2 | prints what RS4 asks and hears, 230400 8N1 |
//! | RS4 | master, RTU 38400 8N1: polls register 0 of units 1, 2 and 3 by scan list |
//!
//! What a PC finds on AS1 at unit 10:
//!
//! | table | address | is |
//! |---|---|---|
//! | input registers | 0, 1, 2 | register 0 of unit 1, 2, 3 |
//! | | 3, 4, 5 | good answers of each, up to 65535 |
//! | | 6, 7, 8 | other ends of its polls |
//! | | 9 | frames that found no room to be printed, modulo 65536 |
//! | holding registers | 1000 + 2 n | register n of AS2, high word first (`Register::number`; arrays are not there) |
//! | | 2000 + 2 n, 3000 + 2 n | the same of RS2, and of RS4 |
//!
//! Written is one of those at a time, both words by function 16; 03 if the port refuses it. So `BAUD` (22) of RS4 becomes
//! 9600 with 0 and 9600 written to 3044. AS1 itself is fixed: nobody locks himself out.
#![no_std]
#![no_main]

use board_stm32::info;
use board_stm32::ports::PortSettings;
use board_stm32::usart::Usart;
use multidrop_firmware::protocol::data::{Registers, RegistersOut};
use multidrop_firmware::protocol::exception::Exception;
use multidrop_firmware::protocol::format::{Framing, LineFormat};
use multidrop_firmware::protocol::port_registers::{Mode, PortRegisters, Register};
use multidrop_firmware::protocol::registers::{Bank, CoilBank, NoCoils, NoRules, within};
use multidrop_firmware::protocol::server::{DataModel, Uncounted};
use multidrop_firmware::scan::{Entry, Scan};
use multidrop_firmware::sniff::Tap;
use multidrop_firmware::{ManagedPort, Manager, Port, PortConfig, Route, Router, Shared, manager};
use static_cell::{ConstStaticCell, StaticCell};

/// Those that the manager has, in its order.
const PORTS: [PortConfig; 3] = manager::table([
    PortConfig::new("AS2")
        .slave_id(1)
        .baud(19_200)
        .framing(Framing::Ascii)
        .format(LineFormat::F7E1),
    PortConfig::new("RS2")
        .mode(Mode::Sniffer)
        .framing(Framing::Text)
        .baud(230_400)
        .format(LineFormat::F8N1),
    PortConfig::new("RS4")
        .client()
        .timeout_ms(50)
        .baud(38_400)
        .format(LineFormat::F8N1),
]);

const AS1: PortConfig = PortConfig::new("AS1")
    .slave_id(10)
    .baud(38_400)
    .format(LineFormat::F8N1);

/// Who asks on RS4 beside the registers of the port: the scan list and the router.
const ASKERS: usize = 3;

type As1 = Port<Usart>;
type As2 = ManagedPort<Usart, PortRegisters<Bank<16>, CoilBank<2>, NoRules>>;
type Rs2 = ManagedPort<Usart, PortRegisters<Bank<1>, NoCoils, NoRules>>;
type Rs4 = ManagedPort<Usart, PortRegisters<Bank<16>, NoCoils, NoRules>, Uncounted, ASKERS>;
type To = Router<Usart, ASKERS>;
type Polled = Scan<3, 3>;

/// Where the registers of the first managed port begin, and how far apart they are.
const SETTINGS: u16 = 1000;

/// What AS1 tells.
struct Told {
    polled: &'static Polled,
    tap: &'static Tap<384>,
    manager: Manager<3>,
}

/// The port, its register, and whether the address is that of the low word.
fn setting(address: u16) -> Result<(usize, Register, bool), Exception> {
    let port = (address / SETTINGS).checked_sub(1);
    let port = port.ok_or(Exception::IllegalDataAddress)?;
    let word = address % SETTINGS;
    let register = u8::try_from(word / 2).ok();
    let register = register.and_then(|number| Register::from_number(number, 0));
    match register {
        Some(register) if usize::from(port) < PORTS.len() && register.index().is_none() => {
            Ok((port.into(), register, !word.is_multiple_of(2)))
        }
        _ => Err(Exception::IllegalDataAddress),
    }
}

impl DataModel for Told {
    fn input_registers(&mut self, first: u16, mut out: RegistersOut<'_>) -> Result<(), Exception> {
        within(first, out.len() as u16, 10)?;
        out.fill_from((usize::from(first)..).map(|address| match address {
            0..3 => self.polled.look(address, |cells| cells[0]),
            3..6 => self.polled.health(address - 3).answers,
            6..9 => {
                let health = self.polled.health(address - 6);
                let (timeouts, others) = (health.timeouts, health.others);
                timeouts
                    .saturating_add(health.exceptions)
                    .saturating_add(others)
            }
            _ => self.tap.dropped() as u16,
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
        let loaded = self.manager.load(port, register, word(0) << 16 | word(1));
        loaded.map_err(|_| Exception::IllegalDataValue)
    }
}

#[embassy_executor::task]
async fn as1_receive(port: &'static As1, router: &'static To) -> ! {
    multidrop_firmware::receive_and_route(port, router).await
}

#[embassy_executor::task]
async fn as1_serve(port: &'static As1, told: &'static Shared<Told>) -> ! {
    multidrop_firmware::serve(port, told).await
}

#[embassy_executor::task]
async fn as1_route(port: &'static As1, router: &'static To) -> ! {
    multidrop_firmware::route(port.line(), router).await
}

/// The two tasks of a managed port.
macro_rules! managed {
    ($($port:ident: $receive:ident, $run:ident;)*) => { $(
        #[embassy_executor::task]
        async fn $receive(port: &'static $port) -> ! {
            multidrop_firmware::managed_receive(port).await
        }

        #[embassy_executor::task]
        async fn $run(port: &'static $port) -> ! {
            multidrop_firmware::managed_run(port).await
        }
    )* };
}

managed! {
    As2: as2_receive, as2_run;
    Rs2: rs2_receive, rs2_run;
    Rs4: rs4_receive, rs4_run;
}

#[embassy_executor::task]
async fn poll(port: &'static Rs4, polled: &'static Polled) -> ! {
    polled.run(port.client(PORTS[2].times())).await
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board_stm32::init();
    let lines = (
        board.as1.open(const { PortSettings::new(&AS1) }),
        board.as2.open(const { PortSettings::new(&PORTS[0]) }),
        board.rs2.open(const { PortSettings::new(&PORTS[1]) }),
        board.rs4.open(const { PortSettings::new(&PORTS[2]) }),
    );
    info!("ports: AS1, AS2, RS2, RS4");

    static TAP: ConstStaticCell<Tap<384>> = ConstStaticCell::new(Tap::new());
    static POLLED: ConstStaticCell<Polled> = ConstStaticCell::new(Scan::new([
        Entry::holding_registers(1, 0, 1).period_ms(100),
        Entry::holding_registers(2, 0, 1).period_ms(100),
        Entry::holding_registers(3, 0, 1).period_ms(100),
    ]));
    let tap: &'static _ = TAP.take();
    let polled: &'static _ = POLLED.take();

    static AS1_CELL: StaticCell<As1> = StaticCell::new();
    let as1: &'static _ = AS1_CELL.init(Port::new(lines.0, &AS1));
    static AS2_CELL: StaticCell<As2> = StaticCell::new();
    let as2: &'static _ = AS2_CELL.init(ManagedPort::new(
        lines.1,
        &PORTS[0],
        PORTS[0].bank(),
        PORTS[0].coil_bank(16),
    ));
    static RS2_CELL: StaticCell<Rs2> = StaticCell::new();
    let rs2 = ManagedPort::new(lines.2, &PORTS[1], PORTS[1].bank(), NoCoils);
    let rs2: &'static _ = RS2_CELL.init(rs2.voiced(tap));
    static RS4_CELL: StaticCell<Rs4> = StaticCell::new();
    let rs4: &'static _ = RS4_CELL.init(ManagedPort::with(
        lines.3.shown_to(tap),
        &PORTS[2],
        PORTS[2].bank(),
        NoCoils,
        Uncounted,
    ));

    static ROUTES: StaticCell<[Route<Usart, ASKERS>; 3]> = StaticCell::new();
    let routes = ROUTES.init([1, 2, 3].map(|unit| Route {
        unit,
        target: unit,
        through: rs4.client(PORTS[2].times()),
    }));
    static ROUTER: StaticCell<To> = StaticCell::new();
    let router: &'static _ = ROUTER.init(Router::new(routes));
    static TOLD: StaticCell<Shared<Told>> = StaticCell::new();
    let told: &'static _ = TOLD.init(Shared::new(Told {
        polled,
        tap,
        manager: Manager::new([as2, rs2, rs4]),
    }));
    board_stm32::run(|spawner| {
        spawner.spawn(as1_receive(as1, router).unwrap());
        spawner.spawn(as1_serve(as1, told).unwrap());
        spawner.spawn(as1_route(as1, router).unwrap());
        spawner.spawn(as2_receive(as2).unwrap());
        spawner.spawn(as2_run(as2).unwrap());
        spawner.spawn(rs2_receive(rs2).unwrap());
        spawner.spawn(rs2_run(rs2).unwrap());
        spawner.spawn(rs4_receive(rs4).unwrap());
        spawner.spawn(rs4_run(rs4).unwrap());
        spawner.spawn(poll(rs4, polled).unwrap());
    })
}
