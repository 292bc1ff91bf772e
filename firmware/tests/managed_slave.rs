//! Managed ports as slaves, and what a change of mode or line means to whoever uses the port.
//!
//! Requests and answers are bytes of the standard, not made by the code under test.

#[allow(dead_code, reason = "each test binary uses a part")]
mod bench;
mod managed_port;

use bench::{Bench, Event, SENDS, TestLine, Wire};
use managed_port::{Loads, Port, RS4, open, plain, slave};
use multidrop::client::{ClientConfig, ClientError};
use multidrop::managed::{ManagedPort, managed_receive, managed_run, managed_serve};
use multidrop::protocol::data::RegistersOut;
use multidrop::protocol::exception::Exception;
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::port_registers::{PortRegisters, Register};
use multidrop::protocol::registers::{Bank, CoilBank, NoCoils, NoRules};
use multidrop::protocol::rules;
use multidrop::protocol::server::{Counted, DataModel, Uncounted};
use multidrop::{PortConfig, Shared};

rules! {
    struct Limits: "RS4";
    VALID_REG { 0..=5 }
    VALID_DATA { 1..=1 => range(100..=200) }
    DISABLE_REG { 2..=3 }
}

#[test]
fn a_slave_serves_the_same_registers_under_its_rules() {
    let mut bench = Bench::new();
    let (wire, rs4): (_, Port<Bank<10>, CoilBank<2>, Limits>) =
        open(&mut bench, RS4, RS4.bank(), RS4.coil_bank(16));
    let ask = |bench: &mut Bench<'_>, request: &[u8]| {
        let before = wire.sent().len();
        wire.hear(Ok(request.to_vec()));
        bench.run(20);
        wire.sent().get(before).cloned()
    };
    rs4.set("REGS.4", 0xABCD);
    rs4.set("COILS.3", 1);
    assert_eq!(
        ask(&mut bench, &[17, 3, 0, 4, 0, 1]),
        Some(vec![17, 3, 2, 0xAB, 0xCD])
    );
    assert_eq!(
        ask(&mut bench, &[17, 1, 0, 0, 0, 8]),
        Some(vec![17, 1, 1, 8])
    );
    assert_eq!(ask(&mut bench, &[18, 3, 0, 4, 0, 1]), None);
    assert_eq!(
        ask(&mut bench, &[17, 3, 0, 6, 0, 1]),
        Some(vec![17, 0x83, 2])
    );
    assert_eq!(
        ask(&mut bench, &[17, 6, 0, 1, 0, 99]),
        Some(vec![17, 0x86, 3])
    );
    assert_eq!(
        ask(&mut bench, &[17, 6, 0, 2, 0, 9]),
        Some(vec![17, 6, 0, 2, 0, 9])
    );
    rs4.set("DISABLE_FLG.0", 1);
    assert_eq!(
        ask(&mut bench, &[17, 6, 0, 2, 0, 8]),
        Some(vec![17, 0x86, 7])
    );
    assert_eq!(rs4.get("REGS.2"), 9);
    // A broadcast is carried out and not answered.
    assert_eq!(ask(&mut bench, &[0, 6, 0, 5, 0, 7]), None);
    assert_eq!(rs4.get("REGS.5"), 7);
    // Another slave id, from the next request on.
    rs4.set("SLAVEID", 18);
    bench.poll();
    assert_eq!(ask(&mut bench, &[17, 3, 0, 5, 0, 1]), None);
    assert_eq!(
        ask(&mut bench, &[18, 3, 0, 5, 0, 1]),
        Some(vec![18, 3, 2, 0, 7])
    );
    // As master and off nobody is answered.
    for mode in [0, 2] {
        rs4.set("MODE", mode);
        bench.poll();
        assert_eq!(ask(&mut bench, &[18, 3, 0, 5, 0, 1]), None);
    }
    rs4.set("MODE", 1);
    bench.poll();
    assert_eq!(
        ask(&mut bench, &[18, 3, 0, 5, 0, 1]),
        Some(vec![18, 3, 2, 0, 7])
    );
    assert_eq!(
        wire.log
            .borrow()
            .iter()
            .filter(|event| matches!(event, Event::Configured(_)))
            .count(),
        2,
        "a slave and a port that is off listen alike"
    );
}

#[test]
fn an_answer_is_sent_before_the_line_settings_change() {
    let mut bench = Bench::new();
    let (wire, rs4) = plain(&mut bench, RS4);
    wire.hear(Ok(vec![17, 3, 0, 4, 0, 1]));
    bench.run(1);
    // Worked out, and not on the wire yet.
    rs4.set("BAUD", 115_200);
    rs4.set("MODE", 2);
    bench.run(20);
    let log = wire.log.borrow();
    let [Event::Sent(bytes, old), Event::Configured(new)] = &log[..] else {
        panic!("{log:?}");
    };
    assert_eq!(bytes[..], [17, 3, 2, 0, 0]);
    assert_eq!((old.baud, new.baud), (38_400, 115_200));
}

#[test]
fn a_frame_received_during_a_change_of_settings_is_dropped() {
    let mut bench = Bench::new();
    let (wire, rs4) = plain(&mut bench, RS4);
    wire.configures.set(10);
    rs4.set("BAUD", 115_200);
    bench.run(3);
    wire.hear(Ok(vec![17, 3, 0, 4, 0, 1]));
    bench.run(3);
    rs4.set("BAUD", 9600);
    bench.run(40);
    assert!(wire.sent().is_empty());
    wire.hear(Ok(vec![17, 3, 0, 4, 0, 1]));
    bench.run(40);
    let log = wire.log.borrow();
    let bauds: Vec<u32> = log
        .iter()
        .map(|event| match event {
            Event::Sent(_, config) | Event::Configured(config) => config.baud,
        })
        .collect();
    assert_eq!(bauds, [115_200, 9600, 9600]);
}

#[test]
fn a_setting_that_the_line_does_not_support_changes_nothing() {
    let mut bench = Bench::new();
    let (wire, rs4) = plain(&mut bench, RS4);
    for (register, value, text) in [
        (
            Register::Baud,
            2_000_000,
            "BAUD is 2000000, the clock does not make it within 2.5 %, nearest is 1000000",
        ),
        (
            Register::Duplex,
            1,
            "DUPLEX is 1, must be 0: the port is wired so",
        ),
        (
            Register::Flow,
            1,
            "FLOW is 1, must be 0: the port is wired so",
        ),
        (
            Register::Format,
            5,
            "FORMAT is 5, must be 8N1 (0), 8E1 (1), 8O1 (2) or 8N2 (3) for RTU",
        ),
        (
            Register::Start,
            1,
            "MODE is 1, must be 0 (master) for START",
        ),
    ] {
        let before = rs4.read(register);
        assert_eq!(rs4.load_raw(register, value).unwrap_err().to_string(), text);
        assert_eq!(rs4.read(register), before);
    }
    bench.run(10);
    assert!(wire.log.borrow().is_empty());
    // What is loaded as it is does not disturb the line either.
    rs4.set("BAUD", 38_400);
    bench.run(10);
    assert!(wire.log.borrow().is_empty());
}

#[test]
fn a_client_of_the_port_is_refused_while_it_is_not_master() {
    const NOT_MASTER: Option<Result<(), ClientError>> = Some(Err(ClientError::NotMaster));
    let mut bench = Bench::new();
    let wire = Wire::new(RS4.line());
    let port = ManagedPort::with(
        TestLine(wire),
        &RS4,
        Bank::new(0),
        CoilBank::new(0, 16),
        Uncounted,
    );
    let rs4: Port<Bank<10>> = Box::leak(Box::new(port));
    bench.wire(wire);
    wire.answered_by(slave(17));
    let client = rs4.client(ClientConfig::new().timeout_ms(100).retries(3));
    // Before the port's tasks run for the first time too.
    let asked = bench.ask(async move { client.write_register(17, 3, 9).await });
    assert_eq!(asked.take(), NOT_MASTER);
    bench.spawn(async move { managed_receive(rs4).await });
    bench.spawn(async move { managed_run(rs4).await });
    let asked = bench.ask(async move { client.write_register(17, 3, 9).await });
    assert_eq!(asked.take(), NOT_MASTER);
    bench.run(500);
    assert!(wire.sent().is_empty());

    rs4.set("MODE", 0);
    bench.run(1);
    let asked = bench.ask(async move {
        let mut values = [0; 2];
        client
            .read_holding_registers(17, 3, &mut values)
            .await
            .map(|()| values)
    });
    bench.run(100);
    assert_eq!(asked.take(), Some(Ok([300, 400])));
    // The line is not set up under a client's request; one that waits behind it is refused, and does not go out.
    let asked = bench.ask(async move { client.write_register(17, 3, 9).await });
    let behind = bench.ask(async move { client.write_register(17, 4, 9).await });
    bench.run(SENDS + 2);
    rs4.set("BAUD", 9600);
    rs4.set("MODE", 1);
    bench.run(50);
    assert_eq!(asked.take(), Some(Ok(())));
    assert_eq!(behind.take(), NOT_MASTER);
    assert_eq!(wire.sent().len(), 2);
    assert!(
        matches!(wire.log.borrow().last(), Some(Event::Configured(config)) if config.baud == 9600)
    );
}

#[test]
fn a_client_waits_while_the_line_of_a_master_is_changed() {
    let mut bench = Bench::new();
    let (wire, rs4) = plain(&mut bench, RS4.client());
    wire.answered_by(slave(17));
    wire.configures.set(20);
    let client = rs4.client(ClientConfig::new().timeout_ms(100));
    rs4.set("BAUD", 9600);
    bench.run(5);
    let asked = bench.ask(async move { client.write_register(17, 3, 9).await });
    bench.run(100);
    assert_eq!(asked.take(), Some(Ok(())));
    let log = wire.log.borrow();
    assert!(matches!(log[0], Event::Configured(_)) && log.len() == 2);
}

#[test]
fn a_client_may_use_the_times_of_the_registers() {
    let mut bench = Bench::new();
    let (wire, rs4) = plain(&mut bench, RS4.client());
    let as_set = rs4.client_as_set();
    let own = rs4.client(ClientConfig::new().timeout_ms(80));
    for (unit, timeout, retries, client, ms) in [
        (17, 100, 0, as_set, 100),
        (18, 30, 0, as_set, 30),
        (19, 30, 2, as_set, 3 * 30 + 2 * SENDS),
        (20, 30, 2, own, 80),
        (21, 30, 2, own.with(ClientConfig::new().timeout_ms(20)), 20),
    ] {
        rs4.set("TIMEOUT", timeout);
        rs4.set("RETRIES", retries);
        let asked = bench.ask(async move { client.write_register(unit, 3, 9).await });
        bench.run(SENDS + ms - 1);
        assert!(asked.borrow().is_none(), "{timeout} ms, {retries} retries");
        bench.run(1);
        assert_eq!(asked.take(), Some(Err(ClientError::Timeout)));
    }
    assert_eq!(wire.sent().len(), 1 + 1 + 3 + 1 + 1);
}

/// A register whose value is 7 times its address, with nothing behind it.
struct Sevens;

impl DataModel for Sevens {
    fn holding_registers(
        &mut self,
        first: u16,
        mut out: RegistersOut<'_>,
    ) -> Result<(), Exception> {
        out.fill_from((first..).map(|address| address.wrapping_mul(7)));
        Ok(())
    }
}

#[test]
fn a_slave_may_answer_with_a_model_of_the_application() {
    let mut bench = Bench::new();
    let wire = Wire::new(RS4.line());
    type OfSevens = ManagedPort<TestLine, PortRegisters<Bank<1>, NoCoils, NoRules>>;
    let port = ManagedPort::new(TestLine(wire), &RS4, RS4.bank(), NoCoils);
    let port: &'static OfSevens = Box::leak(Box::new(port));
    let sevens: &'static Shared<Sevens> = Box::leak(Box::new(Shared::new(Sevens)));
    bench.wire(wire);
    bench.spawn(async move { managed_receive(port).await });
    bench.spawn(async move { managed_serve(port, sevens).await });
    wire.hear(Ok(vec![17, 3, 3, 0, 0, 2]));
    bench.run(20);
    // Its settings are the port's all the same.
    port.load_raw(Register::SlaveId, 18).unwrap();
    bench.run(1);
    wire.hear(Ok(vec![18, 6, 0, 0, 0, 1]));
    bench.run(20);
    let answers = [vec![17, 3, 4, 0x15, 0, 0x15, 7], vec![18, 0x86, 2]];
    assert_eq!(wire.sent(), answers);
}

#[test]
fn a_slave_that_counts_has_its_counters_in_every_mode() {
    let mut bench = Bench::new();
    let wire = Wire::new(RS4.line());
    type Counting =
        ManagedPort<TestLine, PortRegisters<Bank<10>, CoilBank<2>, NoRules>, Counted<8>>;
    let port: &'static Counting = Box::leak(Box::new(ManagedPort::counted(
        TestLine(wire),
        &RS4,
        RS4.bank(),
        RS4.coil_bank(16),
    )));
    bench.wire(wire);
    bench.spawn(async move { managed_receive(port).await });
    bench.spawn(async move { managed_run(port).await });
    bench.poll();
    wire.hear(Err(ReceiveErrors::CHECK));
    wire.hear(Err(ReceiveErrors::GAP));
    wire.hear(Ok(vec![18, 3, 0, 0, 0, 1]));
    bench.run(20);
    // What a master or a port that is off hears is none of the slave's business.
    for mode in [0, 2] {
        port.load_raw(Register::Mode, mode).unwrap();
        bench.run(5);
        wire.hear(Err(ReceiveErrors::CHECK));
        bench.run(5);
    }
    port.load_raw(Register::Mode, 1).unwrap();
    bench.run(5);
    wire.hear(Ok(vec![17, 8, 0, 12, 0, 0]));
    bench.run(20);
    wire.hear(Ok(vec![17, 8, 0, 11, 0, 0]));
    bench.run(20);
    assert_eq!(
        wire.sent(),
        [vec![17, 8, 0, 12, 0, 2], vec![17, 8, 0, 11, 0, 3]]
    );
}

/// One register set that is shared by all instances: modbus-esp8266 #178.
#[test]
fn each_port_has_a_set_of_its_own() {
    let mut bench = Bench::new();
    let (first, as1) = plain(&mut bench, PortConfig::new("AS1").slave_id(1).client());
    let (second, rs4) = plain(&mut bench, RS4);
    first.answered_by(slave(2));
    as1.set("SLAVEID", 2);
    as1.set("BAUD", 9600);
    as1.set("REGCNT", 2);
    as1.start().unwrap();
    rs4.set("REGS.1", 7);
    second.hear(Ok(vec![17, 3, 0, 1, 0, 1]));
    bench.run(30);
    assert_eq!(first.sent(), [vec![2, 3, 0, 0, 0, 2]]);
    assert_eq!(second.sent(), [vec![17, 3, 2, 0, 7]]);
    assert_eq!((as1.get("REGS.1"), rs4.get("REGS.1")), (100, 7));
    assert_eq!(
        (as1.name(), as1.get("BAUD"), as1.get("DATAOK")),
        ("AS1", 9600, 1)
    );
    assert_eq!(
        (rs4.name(), rs4.get("BAUD"), rs4.get("DATAOK")),
        ("RS4", 38_400, 0)
    );
}
