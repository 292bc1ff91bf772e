//! Managed ports: the register set at run time, as master and as slave.
//!
//! Requests and answers are bytes of the standard, put together here and not by our own codec.

#[allow(dead_code, reason = "each test binary uses a part")]
mod bench;

use bench::{Bench, Event, Heard, SENDS, TestLine, Wire};
use multidrop::client::{ClientConfig, ClientError};
use multidrop::line::Role;
use multidrop::managed::{
    EVENTS, Failure, ManagedPort, managed_receive, managed_run, managed_serve,
};
use multidrop::protocol::data::RegistersOut;
use multidrop::protocol::exception::Exception;
use multidrop::protocol::format::{Framing, LineFormat};
use multidrop::protocol::port_registers::{PortRegisters, Register, Status};
use multidrop::protocol::registers::{
    Bank, CoilBank, Items, NoCoils, NoRules, Rules, ScanList, SparseBank,
};
use multidrop::protocol::rtu::ReceiveErrors;
use multidrop::protocol::rules;
use multidrop::protocol::server::{Counted, DataModel, Uncounted};
use multidrop::{PortConfig, Shared};

type Port<R, C = CoilBank<2>, V = NoRules> =
    &'static ManagedPort<TestLine, PortRegisters<R, C, V>, Uncounted, 2>;

const RS4: PortConfig = PortConfig::new("RS4")
    .slave_id(17)
    .baud(38_400)
    .timeout_ms(100)
    .turnaround_ms(50);

/// A port with these arrays, and its tasks.
fn open<R, C, V>(
    bench: &mut Bench<'_>,
    config: PortConfig,
    regs: R,
    coils: C,
) -> (&'static Wire, Port<R, C, V>)
where
    R: Items<Item = u16> + 'static,
    C: Items<Item = bool> + 'static,
    V: Rules + 'static,
{
    let wire = Wire::new(config.line());
    let port = ManagedPort::with(TestLine(wire), &config, regs, coils, Uncounted);
    let port: Port<R, C, V> = Box::leak(Box::new(port));
    bench.wire(wire);
    bench.spawn(async move { managed_receive(port).await });
    bench.spawn(async move { managed_run(port).await });
    bench.poll();
    (wire, port)
}

fn plain(bench: &mut Bench<'_>, config: PortConfig) -> (&'static Wire, Port<Bank<10>>) {
    open(bench, config, Bank::new(0), CoilBank::new(0, 16))
}

trait Loads {
    fn set(&self, name: &str, value: u32);
    fn get(&self, name: &str) -> u32;
}

impl<R: Items<Item = u16>, C: Items<Item = bool>, V: Rules> Loads
    for ManagedPort<TestLine, PortRegisters<R, C, V>, Uncounted, 2>
{
    fn set(&self, name: &str, value: u32) {
        let loaded = self.load_raw(Register::from_name(name).unwrap(), value);
        loaded.unwrap_or_else(|refused| panic!("{refused}"));
    }

    fn get(&self, name: &str) -> u32 {
        self.read(Register::from_name(name).unwrap()).unwrap()
    }
}

/// A slave with registers 100 times their address that takes every write.
fn slave(unit: u8) -> impl FnMut(&[u8]) -> Vec<(u64, Heard)> {
    move |request| {
        if request[0] != unit {
            return Vec::new();
        }
        let word = |at: usize| u16::from_be_bytes([request[at], request[at + 1]]);
        let mut answer = request[..2].to_vec();
        match request[1] {
            3 | 4 => {
                answer.push(2 * request[5]);
                for address in word(2)..word(2) + word(4) {
                    answer.extend((address.wrapping_mul(100)).to_be_bytes());
                }
            }
            1 | 2 => {
                answer.push(request[5].div_ceil(8));
                answer.extend((0..request[5].div_ceil(8)).map(|_| 0b0100_1101));
            }
            _ => answer.extend(&request[2..6]),
        }
        vec![(10, Ok(answer))]
    }
}

#[test]
fn a_master_reads_and_writes_what_its_registers_describe() {
    let mut bench = Bench::new();
    let (wire, rs4) = plain(&mut bench, RS4.client());
    wire.answered_by(slave(17));

    for (name, value) in [("FUNC", 3), ("REGOFF", 2), ("REGCNT", 3)] {
        rs4.set(name, value);
    }
    rs4.start().unwrap();
    assert_eq!((rs4.get("STATUS"), rs4.get("START")), (1, 1));
    let done = bench.ask(rs4.done());
    bench.run(SENDS - 1);
    assert_eq!(rs4.get("STATUS"), 1);
    bench.run(2);
    assert_eq!(rs4.get("STATUS"), 2);
    assert!(done.borrow().is_none());
    bench.run(20);
    assert_eq!(done.take(), Some(Ok(())));
    assert_eq!(wire.sent(), [vec![17, 3, 0, 2, 0, 3]]);
    assert_eq!(
        [
            "REGS.1", "REGS.2", "REGS.4", "REGS.5", "STATUS", "ERROR", "DATAOK", "DATAERR", "START"
        ]
        .map(|name| rs4.get(name)),
        [0, 200, 400, 0, 0, 0, 1, 0, 0]
    );

    // BASE is added, nothing is subtracted; REGS go out from REGOFF on.
    for (name, value) in [
        ("BASE", 40_001),
        ("FUNC", 16),
        ("REGS.3", 0x1234),
        ("REGCNT", 2),
    ] {
        rs4.set(name, value);
    }
    rs4.start().unwrap();
    bench.run(30);
    assert_eq!(
        wire.sent()[1],
        [17, 16, 0x9C, 0x43, 0, 2, 4, 0, 200, 0x12, 0x34]
    );
    // Coils: elements from 0 on, packed.
    for (name, value) in [("FUNC", 15), ("BASE", 0), ("COILOFF", 10), ("COILCNT", 9)] {
        rs4.set(name, value);
    }
    for coil in [0, 2, 3, 8] {
        rs4.set(&format!("COILS.{coil}"), 255);
    }
    rs4.start().unwrap();
    bench.run(30);
    assert_eq!(wire.sent()[2], [17, 15, 0, 10, 0, 9, 2, 0b1101, 1]);
    rs4.set("FUNC", 1);
    rs4.start().unwrap();
    bench.run(30);
    assert_eq!(wire.sent()[3], [17, 1, 0, 10, 0, 9]);
    let coils: Vec<u32> = (0..10)
        .map(|coil| rs4.get(&format!("COILS.{coil}")))
        .collect();
    assert_eq!(coils, [1, 0, 1, 1, 0, 0, 1, 0, 1, 0]);
    assert_eq!(rs4.get("DATAOK"), 4);
}

#[test]
fn ends_come_as_events_too_the_last_ones_of_them() {
    let mut bench = Bench::new();
    let (wire, rs4) = plain(&mut bench, RS4.client());
    wire.answered_by(slave(17));
    for unit in [17, 18, 17, 17, 18] {
        rs4.set("SLAVEID", unit);
        rs4.start().unwrap();
        bench.run(130);
    }
    let ends = bench.ask(async {
        let mut ends = Vec::new();
        for _ in 0..EVENTS {
            ends.push(rs4.event().await.is_ok());
        }
        ends
    });
    assert_eq!(ends.take(), Some(vec![true, false]));
    assert_eq!((rs4.get("DATAOK"), rs4.get("DATAERR")), (3, 2));
}

#[test]
fn a_start_under_way_is_left_alone() {
    let mut bench = Bench::new();
    let (wire, rs4) = plain(&mut bench, RS4.client());
    wire.answered_by(slave(17));
    rs4.set("REGCNT", 2);
    rs4.start().unwrap();
    // What is loaded now is for the next one, whether the request is out or not.
    for (name, value) in [
        ("REGOFF", 5),
        ("FUNC", 4),
        ("SLAVEID", 9),
        ("BASE", 700),
        ("BAUD", 9600),
    ] {
        rs4.set(name, value);
    }
    let refused = rs4.start().unwrap_err();
    assert_eq!(
        refused.to_string(),
        "START is 1, must wait: a transaction is under way"
    );
    bench.run(SENDS + 2);
    assert!(rs4.start().is_err());
    rs4.set("MODE", 1);
    bench.run(30);
    assert_eq!(wire.sent(), [vec![17, 3, 0, 0, 0, 2]]);
    assert_eq!(
        (rs4.get("REGS.1"), rs4.get("DATAOK"), rs4.get("MODE")),
        (100, 1, 1)
    );
    let log = wire.log.borrow();
    let [Event::Sent(_, old), Event::Configured(new)] = &log[..] else {
        panic!("{log:?}");
    };
    assert_eq!((old.baud, old.role), (38_400, Role::Client));
    assert_eq!((new.baud, new.role), (9600, Role::Server));
}

#[test]
fn what_is_loaded_before_start_is_in_effect_before_the_request() {
    let mut bench = Bench::new();
    let (wire, rs4) = plain(&mut bench, RS4);
    wire.answered_by(slave(17));
    for (name, value) in [("MODE", 0), ("FRAMING", 1), ("FORMAT", 4), ("BAUD", 9600)] {
        rs4.set(name, value);
    }
    rs4.start().unwrap();
    rs4.set("MODE", 2);
    bench.run(30);
    let log = wire.log.borrow();
    let [
        Event::Configured(first),
        Event::Sent(bytes, sent),
        Event::Configured(off),
    ] = &log[..]
    else {
        panic!("{log:?}");
    };
    assert_eq!(bytes[..], [17, 3, 0, 0, 0, 1]);
    assert_eq!(first, sent);
    assert_eq!(
        (sent.baud, sent.framing, sent.format, sent.role),
        (9600, Framing::Ascii, LineFormat::F7E1, Role::Client)
    );
    assert_eq!(off.role, Role::Server);
    assert_eq!(rs4.get("DATAOK"), 1);
}

#[test]
fn every_end_has_its_status_and_its_error() {
    let ok = |bytes: &[u8]| vec![(5, Ok(bytes.to_vec()))];
    type Answers = Vec<(u64, Heard)>;
    let cases: [(Answers, u32, u32, ClientError); 8] = [
        (ok(&[17, 4, 2, 0, 1]), 3, 0, ClientError::WrongFunction(4)),
        (ok(&[18, 3, 2, 0, 1]), 4, 0, ClientError::WrongUnit(18)),
        (
            vec![(5, Err(ReceiveErrors::CHECK))],
            5,
            0,
            ClientError::Damaged(ReceiveErrors::CHECK),
        ),
        (vec![], 6, 0, ClientError::Timeout),
        (
            ok(&[17, 3, 4, 0, 1, 0, 2]),
            6,
            0,
            ClientError::WrongLength(7),
        ),
        (
            ok(&[17, 0x83, 2]),
            0,
            2,
            ClientError::Exception(Exception::IllegalDataAddress),
        ),
        (
            ok(&[17, 0x83, 7]),
            0,
            7,
            ClientError::Exception(Exception::NegativeAcknowledge),
        ),
        (
            ok(&[17, 0x83, 0x7F]),
            0,
            0x7F,
            ClientError::UnknownException(0x7F),
        ),
    ];
    for (answers, status, error, cause) in cases {
        let mut bench = Bench::new();
        let (wire, rs4) = plain(&mut bench, RS4.client());
        wire.answered_by(move |_| answers.clone());
        rs4.set("REGOFF", 3);
        rs4.start().unwrap();
        let done = bench.ask(rs4.done());
        bench.run(130);
        let failure = Failure {
            unit: 17,
            address: 3,
            cause,
        };
        assert_eq!(done.take(), Some(Err(failure)));
        assert_eq!(
            (rs4.get("STATUS"), rs4.get("ERROR")),
            (status, error),
            "{failure}"
        );
        assert_eq!(
            (rs4.get("DATAOK"), rs4.get("DATAERR"), rs4.get("START")),
            (0, 1, 0)
        );
        // The next one is right, and clears both; no late answer to the first one is to come any more.
        bench.run(100);
        wire.answered_by(slave(17));
        rs4.start().unwrap();
        assert_eq!((rs4.get("STATUS"), rs4.get("ERROR")), (1, 0));
        bench.run(30);
        assert_eq!(
            (rs4.get("STATUS"), rs4.get("REGS.3"), rs4.get("DATAOK")),
            (0, 300, 1)
        );
    }
}

#[test]
fn a_read_from_slave_0_is_invalid_and_a_write_to_it_is_a_broadcast() {
    let mut bench = Bench::new();
    let (wire, rs4) = plain(&mut bench, RS4.client());
    rs4.set("SLAVEID", 0);
    rs4.start().unwrap();
    bench.run(1);
    assert_eq!(
        (rs4.get("STATUS"), rs4.get("ERROR"), rs4.get("DATAERR")),
        (7, 0, 1)
    );
    assert!(wire.sent().is_empty());
    rs4.set("FUNC", 6);
    rs4.set("REGS.0", 9);
    rs4.start().unwrap();
    bench.run(SENDS + 40);
    assert_eq!(wire.sent(), [vec![0, 6, 0, 0, 0, 9]]);
    assert_eq!(
        rs4.get("START"),
        1,
        "the slaves have the turnaround to themselves"
    );
    bench.run(20);
    assert_eq!((rs4.get("STATUS"), rs4.get("DATAOK")), (0, 1));
}

#[test]
fn timeout_and_retries_are_those_of_the_registers() {
    let mut bench = Bench::new();
    let (wire, rs4) = plain(&mut bench, RS4.client());
    rs4.set("TIMEOUT", 30);
    rs4.set("RETRIES", 2);
    rs4.start().unwrap();
    bench.run(3 * (SENDS + 30) - 2);
    assert_eq!((wire.sent().len(), rs4.get("START")), (3, 1));
    bench.run(10);
    assert_eq!((wire.sent().len(), rs4.get("STATUS")), (3, 6));
}

const TABLE: [u16; 10] = [4, 5, 6, 7, 9, 1000, 1001, 30_000, 30_004, 63_023];

#[test]
fn a_table_of_addresses_is_split_and_the_first_failure_is_told() {
    let mut bench = Bench::new();
    let (wire, rs4): (_, Port<SparseBank<10>>) = open(
        &mut bench,
        RS4.client(),
        SparseBank::new(TABLE),
        CoilBank::new(0, 8),
    );
    wire.answered_by(slave(17));
    rs4.set("REGCNT", 10);
    rs4.start().unwrap();
    bench.run(200);
    let read = |first: u16, count: u8| {
        let [high, low] = first.to_be_bytes();
        vec![17, 3, high, low, 0, count]
    };
    let all = [
        read(4, 4),
        read(9, 1),
        read(1000, 2),
        read(30_000, 1),
        read(30_004, 1),
        read(63_023, 1),
    ];
    assert_eq!(wire.sent(), all);
    for (index, address) in TABLE.iter().enumerate() {
        let value = u32::from(address.wrapping_mul(100));
        assert_eq!(rs4.get(&format!("REGS.{index}")), value);
    }
    assert_eq!(rs4.get("DATAOK"), 1);

    // The example: a write of 6 and 7, a read of 1000 and 1001.
    rs4.set("REGS.2", 102);
    rs4.set("REGS.3", 29_123);
    for (function, offset, bytes) in [
        (16, 2, vec![17, 16, 0, 6, 0, 2, 4, 0, 102, 0x71, 0xC3]),
        (3, 5, read(1000, 2)),
    ] {
        rs4.set("FUNC", function);
        rs4.set("REGOFF", offset);
        rs4.set("REGCNT", 2);
        rs4.start().unwrap();
        bench.run(50);
        assert_eq!(wire.sent().last(), Some(&bytes));
    }

    // The third request fails: the two behind it are not made.
    let mut right = slave(17);
    wire.answered_by(move |request| match request[2..4] {
        [3, 0xE8] => vec![(5, Ok(vec![17, 0x83, 4]))],
        _ => right(request),
    });
    let before = wire.sent().len();
    rs4.set("REGOFF", 0);
    rs4.set("REGCNT", 10);
    rs4.start().unwrap();
    let done = bench.ask(rs4.done());
    bench.run(200);
    assert_eq!(wire.sent()[before..], all[..3]);
    let failure = done.take().unwrap().unwrap_err();
    assert_eq!(
        (failure.address, failure.error(), failure.status()),
        (1000, 4, Status::Idle)
    );
    assert_eq!(rs4.get("ERROR"), 4);
}

#[test]
fn a_scan_list_is_walked_over_all_slaves_whoever_fails() {
    let mut bench = Bench::new();
    let list = ScanList::from_rows([4, 1000, 4, 7], [0; 4], [1, 2, 3, 1], [0, 1, 2, 3]);
    let (wire, rs4): (_, Port<ScanList<4>>) =
        open(&mut bench, RS4.client(), list, CoilBank::new(0, 8));
    let mut slaves = [slave(1)];
    wire.answered_by(move |request| slaves.iter_mut().flat_map(|slave| slave(request)).collect());
    rs4.set("REGCNT", 4);
    rs4.start().unwrap();
    let done = bench.ask(rs4.done());
    bench.run(350);
    assert_eq!(
        wire.sent(),
        [
            vec![1, 3, 0, 4, 0, 1],
            vec![2, 3, 3, 0xE8, 0, 1],
            vec![3, 3, 0, 4, 0, 1],
            vec![1, 3, 0, 7, 0, 1]
        ]
    );
    let failure = Failure {
        unit: 2,
        address: 1000,
        cause: ClientError::Timeout,
    };
    assert_eq!(done.take(), Some(Err(failure)));
    assert_eq!(
        [0, 1, 2, 3].map(|index| rs4.get(&format!("REGS.{index}"))),
        [400, 0, 0, 700]
    );
    assert_eq!(rs4.get("STATUS"), 6);
}

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
fn an_answer_goes_out_before_its_line_is_set_up_anew() {
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
fn what_is_heard_while_the_line_is_set_up_is_nobody_s() {
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
fn what_the_line_cannot_do_changes_nothing() {
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
fn a_client_may_have_the_times_that_the_registers_have_when_it_asks() {
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
