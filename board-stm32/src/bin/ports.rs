//! Four ports at once.
//!
//! | port | is |
//! |---|---|
//! | AS1 | slave 10, RTU 38400 8N1: tells a PC what was collected, loads all ports' registers, and routes units 1, 2 and 3 to RS4 |
//! | AS2 | slave 1, ASCII 19200 7E1: 16 registers and 16 coils of its own; routes units 11, 12 and 13 to 1, 2 and 3 on RS4 |
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
//! | holding registers | 1000 + 2 n | register n of AS1, high word first (`Register::number`; arrays are not there) |
//! | | 2000, 3000, 4000 + 2 n | the same of AS2, RS2 and RS4 |
//!
//! Written is one of those at a time, both words by function 16; 03 if the port refuses it. So `BAUD` (22) of RS4 becomes
//! 9600 with 0 and 9600 written to 4044. What is written of AS1 itself holds as soon as the write is answered; a reset
//! brings everything back to what is below.
#![no_std]
#![no_main]

use board_stm32::ports::PortSetup;
use board_stm32::usart::Usart;
use board_stm32::{Roll, Watchdog, info};
use multidrop::poll::{PollEntry, PollList};
use multidrop::protocol::data::{Registers, RegistersOut};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::format::{Framing, LineFormat};
use multidrop::protocol::port_registers::{Mode, PortRegisters, Register};
use multidrop::protocol::registers::{Bank, CoilBank, NoCoils, NoRules, within};
use multidrop::protocol::server::{DataModel, Uncounted};
use multidrop::sniff::Capture;
use multidrop::{ManagedPort, Manager, PortConfig, Route, Router, Shared, manager, signed};
use static_cell::{ConstStaticCell, StaticCell};

// ANCHOR: table
const PORTS: [PortConfig; 4] = manager::table([
    PortConfig::new("AS1")
        .slave_id(10)
        .baud(38_400)
        .format(LineFormat::F8N1),
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
        .timeout_ms(TIMEOUT_MS)
        .baud(38_400)
        .format(LineFormat::F8N1),
]);
// ANCHOR_END: table

/// How long RS4 waits for a unit at first, and what the printer takes for one's answer.
const TIMEOUT_MS: u32 = 50;

/// Who asks on RS4: its registers, the scan list, the routers.
const CLIENTS: usize = 4;

type As1 = ManagedPort<Usart, PortRegisters<Bank<1>, NoCoils, NoRules>>;
type As2 = ManagedPort<Usart, PortRegisters<Bank<16>, CoilBank<2>, NoRules>>;
type Rs2 = ManagedPort<Usart, PortRegisters<Bank<1>, NoCoils, NoRules>>;
type Rs4 = ManagedPort<Usart, PortRegisters<Bank<16>, NoCoils, NoRules>, Uncounted, CLIENTS>;
type To = Router<Usart, CLIENTS>;
type Polled = PollList<3, 3>;

/// Where the registers of the first port begin, and how far apart they are.
const SETTINGS: u16 = 1000;

/// What AS1 tells.
struct Told {
    polled: &'static Polled,
    capture: &'static Capture<384>,
    manager: Manager<4>,
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

/// The tasks that have to be alive: two of each port, two that route, and the one that polls.
static ROLL: Roll<11> = Roll::new();

/// The tasks of the ports.
macro_rules! tasks {
    ($($place:literal $port:ident: $receive:ident, $run:ident($($model:ident: $type:ty)?) $function:ident;)*) => { $(
        #[embassy_executor::task]
        async fn $receive(port: &'static $port) -> ! {
            signed(|task| ROLL.sign::<$place>(task), multidrop::managed_receive(port)).await
        }

        #[embassy_executor::task]
        async fn $run(port: &'static $port $(, $model: $type)?) -> ! {
            let run = multidrop::$function(port $(, $model)?);
            signed(|task| ROLL.sign::<{ $place + 1 }>(task), run).await
        }
    )* };
}

tasks! {
    0 As1: as1_receive, as1_run(told: &'static Shared<Told>) managed_serve;
    2 As2: as2_receive, as2_run() managed_run;
    4 Rs2: rs2_receive, rs2_run() managed_run;
    6 Rs4: rs4_receive, rs4_run() managed_run;
}

#[embassy_executor::task]
async fn as1_route(router: &'static To) -> ! {
    signed(|task| ROLL.sign::<8>(task), multidrop::route(router)).await
}

#[embassy_executor::task]
async fn as2_route(router: &'static To) -> ! {
    signed(|task| ROLL.sign::<9>(task), multidrop::route(router)).await
}

#[embassy_executor::task]
async fn poll(port: &'static Rs4, polled: &'static Polled) -> ! {
    signed(
        |task| ROLL.sign::<10>(task),
        polled.run(port.client_as_set()),
    )
    .await
}

// ANCHOR: routes
/// Leads from these units to 1, 2 and 3 on RS4.
fn routes(rs4: &'static Rs4, units: [u8; 3]) -> [Route<Usart, CLIENTS>; 3] {
    let through = rs4.client_as_set();
    core::array::from_fn(|place| Route {
        unit: units[place],
        target: place as u8 + 1,
        through,
    })
}
// ANCHOR_END: routes

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board_stm32::init(Watchdog::DEFAULT);
    let lines = (
        board.as1.open(const { PortSetup::new(&PORTS[0]) }),
        board.as2.open(const { PortSetup::new(&PORTS[1]) }),
        board.rs2.open(const { PortSetup::new(&PORTS[2]) }),
        board.rs4.open(const { PortSetup::new(&PORTS[3]) }),
    );
    info!("ports: AS1, AS2, RS2, RS4");

    static CAPTURE: ConstStaticCell<Capture<384>> =
        ConstStaticCell::new(Capture::within_ms(TIMEOUT_MS));
    // ANCHOR: scan
    static POLLED: ConstStaticCell<Polled> = ConstStaticCell::new(PollList::new([
        PollEntry::holding_registers(1, 0, 1).period_ms(100),
        PollEntry::holding_registers(2, 0, 1).period_ms(100),
        PollEntry::holding_registers(3, 0, 1).period_ms(100),
    ]));
    // ANCHOR_END: scan
    let capture: &'static _ = CAPTURE.take();
    let polled: &'static _ = POLLED.take();

    // ANCHOR: capture
    static RS4: StaticCell<Rs4> = StaticCell::new();
    let rs4: &'static _ = RS4.init(ManagedPort::with(
        lines.3.observed_by(capture),
        &PORTS[3],
        PORTS[3].bank(),
        NoCoils,
        Uncounted,
    ));
    static RS2: StaticCell<Rs2> = StaticCell::new();
    let rs2 = ManagedPort::new(lines.2, &PORTS[2], PORTS[2].bank(), NoCoils);
    let rs2: &'static _ = RS2.init(rs2.printing(capture));
    // ANCHOR_END: capture

    // ANCHOR: router
    static AS2_ROUTES: StaticCell<[Route<Usart, CLIENTS>; 3]> = StaticCell::new();
    static AS2_ROUTER: StaticCell<To> = StaticCell::new();
    static AS2: StaticCell<As2> = StaticCell::new();
    let as2_router = AS2_ROUTER.init(Router::new(AS2_ROUTES.init(routes(rs4, [11, 12, 13]))));
    let (bank, coils) = (PORTS[1].bank(), PORTS[1].coil_bank(16));
    let as2 = ManagedPort::new(lines.1, &PORTS[1], bank, coils);
    let as2: &'static _ = AS2.init(as2.routed(as2_router));
    // ANCHOR_END: router

    static AS1_ROUTES: StaticCell<[Route<Usart, CLIENTS>; 3]> = StaticCell::new();
    static AS1_ROUTER: StaticCell<To> = StaticCell::new();
    static AS1: StaticCell<As1> = StaticCell::new();
    let as1_router = AS1_ROUTER.init(Router::new(AS1_ROUTES.init(routes(rs4, [1, 2, 3]))));
    let as1 = ManagedPort::new(lines.0, &PORTS[0], PORTS[0].bank(), NoCoils);
    let as1: &'static _ = AS1.init(as1.routed(as1_router));

    static TOLD: StaticCell<Shared<Told>> = StaticCell::new();
    let told: &'static _ = TOLD.init(Shared::new(Told {
        polled,
        capture,
        manager: Manager::new([as1, as2, rs2, rs4]),
    }));
    board_stm32::run(&ROLL, |spawner| {
        spawner.spawn(as1_receive(as1).unwrap());
        spawner.spawn(as1_run(as1, told).unwrap());
        spawner.spawn(as1_route(as1_router).unwrap());
        spawner.spawn(as2_receive(as2).unwrap());
        spawner.spawn(as2_run(as2).unwrap());
        spawner.spawn(as2_route(as2_router).unwrap());
        spawner.spawn(rs2_receive(rs2).unwrap());
        spawner.spawn(rs2_run(rs2).unwrap());
        spawner.spawn(rs4_receive(rs4).unwrap());
        spawner.spawn(rs4_run(rs4).unwrap());
        spawner.spawn(poll(rs4, polled).unwrap());
    })
}
