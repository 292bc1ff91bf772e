//! Four ports that work at the same time.
//!
//! | port | is |
//! |---|---|
//! | AS1 | slave 10, RTU 38400 8N1: gives a PC the collected values, loads all ports' registers, routes units 1, 2 and 3 to RS4 |
//! | AS2 | slave 1, ASCII 19200 7E1: 16 registers and 16 coils of its own; routes units 11, 12 and 13 to 1, 2 and 3 on RS4 |
//! | RS2 | prints what RS4 sends and hears, 230400 8N1 |
//! | RS4 | master, RTU 38400 8N1: polls register 0 of units 1, 2 and 3 by scan list |
//!
//! `multidrop_apps::ports` describes what a PC finds on AS1 at unit 10.
#![no_std]
#![no_main]

use board_stm32::{Dog, PortSetup, Usart, Watchdog, info};
use multidrop::poll::{PollEntry, PollList};
use multidrop::prelude::*;
use multidrop::protocol::port_registers::{Mode, PortRegisters};
use multidrop::protocol::server::Uncounted;
use multidrop::sniff::Capture;
use multidrop::{ManagedPort, Manager, Route, Router, manager};
use multidrop_apps::ports::Told;
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

/// How long RS4 waits for a unit at first. The printer takes a frame within this time for the unit's answer.
const TIMEOUT_MS: u32 = 50;

/// The tasks that send requests on RS4: the run task of its registers, the poll list, the routers.
const CLIENTS: usize = 4;

type As1 = ManagedPort<Usart, PortRegisters<Bank<1>, NoCoils, NoRules>>;
type As2 = ManagedPort<Usart, PortRegisters<Bank<16>, CoilBank<2>, NoRules>>;
type Rs2 = ManagedPort<Usart, PortRegisters<Bank<1>, NoCoils, NoRules>>;
type Rs4 = ManagedPort<Usart, PortRegisters<Bank<16>, NoCoils, NoRules>, Uncounted, CLIENTS>;
type To = Router<Usart, CLIENTS>;
type Polled = PollList<3, 3>;

// ANCHOR: tasks
multidrop::tasks! {
    /// The tasks that have to be alive: two of each port, two that route, and the one that polls.
    static ROLL: Roll<Dog>;

    fn as1_receive(port: &'static As1) = multidrop::managed_receive(port);
    fn as1_run(port: &'static As1, told: &'static Shared<Told>) =
        multidrop::managed_serve(port, told);
    fn as2_receive(port: &'static As2) = multidrop::managed_receive(port);
    fn as2_run(port: &'static As2) = multidrop::managed_run(port);
    fn rs2_receive(port: &'static Rs2) = multidrop::managed_receive(port);
    fn rs2_run(port: &'static Rs2) = multidrop::managed_run(port);
    fn rs4_receive(port: &'static Rs4) = multidrop::managed_receive(port);
    fn rs4_run(port: &'static Rs4) = multidrop::managed_run(port);
    fn as1_route(router: &'static To) = multidrop::route(router);
    fn as2_route(router: &'static To) = multidrop::route(router);
    fn poll(port: &'static Rs4, polled: &'static Polled) = polled.run(port.client_as_set());
}
// ANCHOR_END: tasks

// ANCHOR: routes
/// Makes the routes from these units to 1, 2 and 3 on RS4.
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
    let (capture, polled): (&'static _, &'static _) = (CAPTURE.take(), POLLED.take());

    // ANCHOR: capture
    static RS4: StaticCell<Rs4> = StaticCell::new();
    let (line, bank) = (lines.3.observed_by(capture), PORTS[3].bank());
    let rs4: &'static _ = RS4.init(ManagedPort::with(line, &PORTS[3], bank, NoCoils, Uncounted));
    static RS2: StaticCell<Rs2> = StaticCell::new();
    let rs2 = ManagedPort::new(lines.2, &PORTS[2], PORTS[2].bank(), NoCoils);
    let rs2: &'static _ = RS2.init(rs2.printing(capture));
    // ANCHOR_END: capture

    // ANCHOR: router
    static ROUTES: StaticCell<[[Route<Usart, CLIENTS>; 3]; 2]> = StaticCell::new();
    static ROUTERS: StaticCell<[To; 2]> = StaticCell::new();
    let to_rs4: &'static _ = ROUTES.init([[1, 2, 3], [11, 12, 13]].map(|units| routes(rs4, units)));
    let [as1_router, as2_router] = ROUTERS.init([Router::new(&to_rs4[0]), Router::new(&to_rs4[1])]);
    static AS2: StaticCell<As2> = StaticCell::new();
    let (bank, coils) = (PORTS[1].bank(), PORTS[1].coil_bank(16));
    let as2 = ManagedPort::new(lines.1, &PORTS[1], bank, coils);
    let as2: &'static _ = AS2.init(as2.routed(as2_router));
    // ANCHOR_END: router

    static AS1: StaticCell<As1> = StaticCell::new();
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
