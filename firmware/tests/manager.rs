//! A manager of several managed ports. Frames are bytes of the standard.

#[allow(dead_code, reason = "each test binary uses a part")]
mod bench;

use bench::{Bench, Event, Heard, TestLine, Wire};
use multidrop::PortConfig;
use multidrop::line::Role;
use multidrop::managed::{ManagedPort, managed_receive, managed_run};
use multidrop::manager::{self, Managed, Manager};
use multidrop::protocol::port_registers::{PortRegisters, Register};
use multidrop::protocol::registers::{Bank, CoilBank, NoRules};

const PORTS: [PortConfig; 3] = manager::table([
    PortConfig::new("AS1").slave_id(17).baud(38_400),
    PortConfig::new("AS2").slave_id(17).baud(38_400),
    PortConfig::new("RS4").slave_id(5).client().timeout_ms(100),
]);

type Port = ManagedPort<TestLine, PortRegisters<Bank<10>, CoilBank<2>, NoRules>>;

/// The ports with their tasks.
fn open(bench: &mut Bench<'_>) -> ([&'static Wire; 3], Manager<3>) {
    let wires = PORTS.map(|config| Wire::new(config.line()));
    let mut place = 0;
    let ports = PORTS.map(|config| {
        let wire = wires[place];
        place += 1;
        let port = Port::new(TestLine(wire), &config, Bank::new(0), CoilBank::new(0, 16));
        let port: &'static Port = Box::leak(Box::new(port));
        bench.wire(wire);
        bench.spawn(async move { managed_receive(port).await });
        bench.spawn(async move { managed_run(port).await });
        port as &'static dyn Managed
    });
    bench.poll();
    (wires, Manager::new(ports))
}

/// Every register that has no index, elements 0 to 9 of REGS and 0 to 15 of COILS.
fn all() -> Vec<Register> {
    let names = [
        "MODE",
        "FRAMING",
        "BASE",
        "SLAVEID",
        "FUNC",
        "REGOFF",
        "REGCNT",
        "COILOFF",
        "COILCNT",
        "STATUS",
        "ERROR",
        "TIMEOUT",
        "RETRIES",
        "TURNAROUND",
        "DATAOK",
        "DATAERR",
        "BAUD",
        "FORMAT",
        "DUPLEX",
        "FLOW",
        "INTER_CHARACTER",
        "START",
        "LATE_GUARD",
        "CTS_TIMEOUT",
        "REQUEST_GAP",
        "DE_LEAD",
        "RESPONSE_DELAY",
    ];
    let names = names.map(|name| Register::from_name(name).unwrap());
    let regs = (0..10).map(Register::Regs);
    names
        .into_iter()
        .chain(regs)
        .chain((0..16).map(Register::Coils))
        .collect()
}

fn state(manager: &Manager<3>, place: usize) -> Vec<u32> {
    let read = |register| manager.read(place, register).unwrap();
    all().into_iter().map(read).collect()
}

#[test]
fn each_port_has_registers_of_its_own() {
    let mut bench = Bench::new();
    let (_, manager) = open(&mut bench);
    let loads = [
        (Register::Mode, 2),
        (Register::Framing, 1),
        (Register::Base, 100),
        (Register::SlaveId, 33),
        (Register::Func, 16),
        (Register::RegOff, 4),
        (Register::RegCnt, 5),
        (Register::CoilOff, 6),
        (Register::CoilCnt, 7),
        (Register::Timeout, 333),
        (Register::Retries, 3),
        (Register::Turnaround, 77),
        (Register::Baud, 9600),
        (Register::Format, 0),
        (Register::InterCharacter, 1),
        (Register::LateGuard, 1234),
        (Register::CtsTimeout, 55),
        (Register::RequestGap, 66),
        (Register::DeLead, 10_000),
        (Register::ResponseDelay, 1000),
        (Register::Regs(3), 1234),
        (Register::Coils(9), 1),
    ];
    for place in 0..3 {
        let before: Vec<_> = (0..3).map(|place| state(&manager, place)).collect();
        for (register, value) in loads {
            manager
                .load_raw(PORTS[place].name(), register, value)
                .unwrap();
            assert_eq!(manager.read(place, register), Ok(value), "{register}");
        }
        bench.run(20);
        for other in (0..3).filter(|other| *other != place) {
            assert_eq!(
                state(&manager, other),
                before[other],
                "{place} changed {other}"
            );
        }
        assert_ne!(state(&manager, place), before[place]);
    }
}

#[test]
fn a_load_affects_only_the_line_of_its_port() {
    let mut bench = Bench::new();
    let (wires, manager) = open(&mut bench);
    wires[2].answered_by(|request| vec![(5, Ok(vec![request[0], 3, 2, 0x12, 0x34]))]);
    let mut answers = [0; 2];
    for round in 0..10 {
        // One port asks, two are asked; one of these is changed meanwhile.
        manager.load_raw("RS4", Register::Start, 1).unwrap();
        let unit = manager.read("AS1", Register::SlaveId).unwrap() as u8;
        let request = |unit: u8| -> Heard { Ok(vec![unit, 3, 0, 0, 0, 1]) };
        wires[0].hear(request(unit));
        wires[1].hear(request(17));
        bench.run(2);
        manager.load_raw(0, Register::Baud, 9600 + round).unwrap();
        manager.load_raw(0, Register::SlaveId, 20 + round).unwrap();
        bench.run(40);
        for (answers, wire) in answers.iter_mut().zip(wires) {
            assert_eq!(wire.sent().len(), *answers + 1, "round {round}");
            *answers += 1;
        }
        assert_eq!(wires[0].sent().last().unwrap()[..3], [unit, 3, 2]);
        assert_eq!(manager.read("RS4", Register::DataOk), Ok(round + 1));
        assert_eq!(manager.read("RS4", Register::Regs(0)), Ok(0x1234));
    }
    let configured = |wire: &Wire| {
        let log = wire.log.borrow();
        let events = log.iter();
        events
            .filter(|event| matches!(event, Event::Configured(_)))
            .count()
    };
    assert_eq!(wires.map(configured), [10, 0, 0]);
}

#[test]
fn a_mode_is_changed_by_name() {
    let mut bench = Bench::new();
    let (wires, manager) = open(&mut bench);
    manager.load_raw("AS2", Register::Mode, 0).unwrap();
    bench.run(2);
    let log = wires[1].log.borrow();
    let [Event::Configured(line)] = log[..] else {
        panic!("{log:?}");
    };
    assert_eq!(line.role, Role::Client);
}

#[test]
fn errors_name_the_port() {
    let mut bench = Bench::new();
    let (_, manager) = open(&mut bench);
    let error = |port: &'static str, register, value| {
        manager
            .load_raw(port, register, value)
            .unwrap_err()
            .to_string()
    };
    assert_eq!(
        error("AS2", Register::SlaveId, 248),
        "port AS2: SLAVEID is 248, must be 1..=247"
    );
    assert_eq!(
        error("RS4", Register::Baud, 2_000_000),
        "port RS4: BAUD is 2000000, the clock does not make it within 2.5 %, nearest is 1000000"
    );
    assert_eq!(
        error("RS5", Register::Baud, 9600),
        "no port named RS5 (3 ports)"
    );
    assert_eq!(
        manager.read(3, Register::Mode).unwrap_err().to_string(),
        "no port number 3, must be below 3"
    );
    assert_eq!(
        manager.read(1, Register::Regs(10)).unwrap_err().to_string(),
        "port AS2: REGS.10 does not exist, must be REGS.0..=9"
    );
}
