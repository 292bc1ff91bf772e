//! Managed ports as masters: the register set at run time.
//!
//! Requests and answers are bytes of the standard, not made by the code under test.

#[allow(dead_code, reason = "each test binary uses a part")]
mod bench;
mod managed_port;

use bench::{Bench, Event, Heard, SENDS};
use managed_port::{Loads, Port, RS4, open, plain, slave};
use multidrop::client::ClientError;
use multidrop::line::Role;
use multidrop::managed::{EVENTS, Failure};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::format::{Framing, LineFormat};
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::port_registers::Status;
use multidrop::protocol::registers::{CoilBank, ScanList, SparseBank};

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
fn the_last_results_are_kept_as_events() {
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
fn a_load_during_a_transaction_does_not_change_it() {
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
fn a_scan_list_reaches_all_slaves_although_one_fails() {
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
