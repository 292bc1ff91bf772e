//! The health of each entry of a poll list, and the limits of a list.

mod desk;

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;

use desk::{Desk, Heard, SENDS, TestLine};
use multidrop::poll::{Health, PollEntry, PollList};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::port_registers::PortRegisters;
use multidrop::protocol::registers::{Bank, NoCoils, NoRules};
use multidrop::{ClientConfig, ClientError, ManagedPort, PortConfig};

const CONFIG: ClientConfig = ClientConfig::new().timeout_ms(40).late_guard_ms(1);
const DELAY: u64 = 4;
const PERIOD: u64 = 100;
/// From the beginning of a request to the moment in which its answer stands.
const EXCHANGE: u64 = SENDS + DELAY + 1;

fn counts(health: Health) -> [u16; 4] {
    [
        health.answers,
        health.timeouts,
        health.exceptions,
        health.others,
    ]
}

#[test]
fn an_error_is_kept_through_good_answers_until_the_next_one() {
    let scan = PollList::<2, 2>::new([
        PollEntry::holding_registers(17, 7, 1).period_ms(PERIOD as u16),
        PollEntry::holding_registers(18, 7, 1).period_ms(PERIOD as u16),
    ]);
    let scan = &scan;
    let round = Rc::new(Cell::new(0_u16));
    let now = round.clone();
    // What unit 17 does in each round; unit 18 answers always.
    let good = |value: u8| Some(Heard::Frame(vec![17, 3, 2, 0, value]));
    let ends = [
        good(1),
        Some(Heard::Frame(vec![17, 0x83, 2])),
        good(2),
        good(3),
        None,
        good(4),
        Some(Heard::Damaged(ReceiveErrors::CHECK)),
        good(5),
    ];
    let heard = ends.clone();
    let mut desk = Desk::<1>::new(move |request| {
        let round = now.get();
        let heard = match request[0] {
            17 => heard[usize::from(round)].clone(),
            _ => Some(Heard::Frame(vec![18, 3, 2, 1, round as u8])),
        };
        heard.into_iter().map(|heard| (DELAY, heard)).collect()
    });
    let client = desk.port.client(CONFIG);
    desk.spawn(async move { scan.run(client).await });
    let refused = Some(ClientError::Exception(Exception::IllegalDataAddress));
    let damaged = Some(ClientError::Damaged(ReceiveErrors::CHECK));
    for (last_error, expected, cell) in [
        (None, [1, 0, 0, 0], 1),
        (refused, [1, 0, 1, 0], 1),
        (refused, [2, 0, 1, 0], 2),
        (refused, [3, 0, 1, 0], 3),
        (Some(ClientError::Timeout), [3, 1, 1, 0], 3),
        (Some(ClientError::Timeout), [4, 1, 1, 0], 4),
        (damaged, [4, 1, 1, 1], 4),
        (damaged, [5, 1, 1, 1], 5),
    ] {
        let began = desk.now();
        desk.run(PERIOD - 1);
        let health = scan.health(0);
        assert_eq!(health.last_error, last_error, "round {}", round.get());
        assert_eq!(counts(health), expected);
        scan.with_cells(0, |cells| assert_eq!(cells, [cell]));
        // When it was filled, whatever came since.
        if ends[usize::from(round.get())] == good(cell as u8) {
            let at = health.answered_at.expect("answered").as_millis();
            assert_eq!(at, began + EXCHANGE);
        }
        // Nothing of it is the other one's.
        assert_eq!(scan.health(1).last_error, None);
        assert_eq!(counts(scan.health(1)), [round.get() + 1, 0, 0, 0]);
        scan.with_cells(1, |cells| assert_eq!(cells, [0x100 + round.get()]));
        round.set(round.get() + 1);
        desk.run(1);
    }
}

#[test]
fn an_entry_is_stale_by_its_last_good_answer() {
    let scan =
        PollList::<1, 1>::new([PollEntry::input_registers(17, 7, 1).period_ms(PERIOD as u16)]);
    let scan = &scan;
    let mut answers = [true, false, false].into_iter();
    let mut desk = Desk::<1>::new(move |_| match answers.next() {
        Some(true) => vec![(DELAY, Heard::Frame(vec![17, 4, 2, 0, 1]))],
        _ => vec![],
    });
    let client = desk.port.client(CONFIG);
    assert_eq!(scan.health(0).age(), None);
    assert!(scan.health(0).is_stale(0) && scan.health(0).is_stale(u32::MAX));
    desk.spawn(async move { scan.run(client).await });
    desk.run(EXCHANGE);
    for age in 0..3 * PERIOD {
        let health = scan.health(0);
        assert_eq!(health.age().map(|age| age.as_millis()), Some(age));
        assert!(!health.is_stale(age as u32));
        assert_eq!(health.is_stale((age as u32).saturating_sub(1)), age > 0);
        desk.run(1);
    }
    assert_eq!(counts(scan.health(0)), [1, 2, 0, 0]);
}

#[test]
fn each_table_is_read_into_cells_of_its_own() {
    let scan = PollList::<4, 32>::new([
        PollEntry::coils(17, 100, 17),
        PollEntry::discrete_inputs(17, 200, 10),
        PollEntry::holding_registers(17, 300, 3),
        PollEntry::input_registers(17, 400, 2),
    ]);
    let scan = &scan;
    let mut desk = Desk::<1>::new(|request| {
        let answer = match request[1] {
            1 => vec![17, 1, 3, 0b1010_0101, 0b0000_1111, 1],
            2 => vec![17, 2, 2, 0b1100_0011, 0b10],
            3 => vec![17, 3, 6, 0x12, 0x34, 0xFF, 0xFE, 0, 1],
            _ => vec![17, 4, 4, 0xAB, 0xCD, 0, 0],
        };
        vec![(DELAY, Heard::Frame(answer))]
    });
    let client = desk.port.client(CONFIG);
    desk.spawn(async move { scan.run(client).await });
    desk.run(999);
    assert_eq!(
        desk.sent(),
        [
            [17, 1, 0, 100, 0, 17],
            [17, 2, 0, 200, 0, 10],
            [17, 3, 1, 44, 0, 3],
            [17, 4, 1, 144, 0, 2]
        ]
    );
    scan.with_cells(0, |cells| {
        assert_eq!(cells, [1, 0, 1, 0, 0, 1, 0, 1, 1, 1, 1, 1, 0, 0, 0, 0, 1]);
    });
    scan.with_cells(1, |cells| {
        assert_eq!(cells, [1, 1, 0, 0, 0, 0, 1, 1, 0, 1]);
    });
    scan.with_cells(2, |cells| assert_eq!(cells, [0x1234, 0xFFFE, 1]));
    scan.with_cells(3, |cells| assert_eq!(cells, [0xABCD, 0]));
    // Every second, if not said otherwise.
    desk.run(4 * EXCHANGE);
    assert_eq!(desk.sent().len(), 8);
}

#[test]
fn counts_stop_at_their_maximum() {
    type Port = ManagedPort<TestLine, PortRegisters<Bank<1>, NoCoils, NoRules>>;
    const SLAVE: PortConfig = PortConfig::new("RS4");
    let scan = PollList::<1, 1>::new([PollEntry::holding_registers(17, 7, 1).period_ms(1)]);
    let scan = &scan;
    let mut desk = Desk::<1>::new(|_| vec![]);
    // Of a port that is no master nobody may ask, and it is told at once.
    let line = TestLine(desk.other());
    let port = Port::new(line, &SLAVE, SLAVE.bank(), NoCoils);
    let port: &'static Port = Box::leak(Box::new(port));
    desk.spawn(async move { scan.run(port.client(CONFIG)).await });
    desk.run(65_533);
    for others in [65_534, 65_535, 65_535, 65_535] {
        assert_eq!(counts(scan.health(0)), [0, 0, 0, others]);
        desk.run(1);
    }
    assert_eq!(scan.health(0).last_error, Some(ClientError::NotMaster));
    scan.with_cells(0, |cells| assert_eq!(cells, [0]));
}

/// A list whose task is dropped while it waits for the line leaves its place to others.
#[test]
fn a_list_that_is_dropped_leaves_the_queue() {
    let scan = PollList::<1, 1>::new([PollEntry::holding_registers(17, 7, 1)]);
    let scan = &scan;
    let mut desk = Desk::<1>::new(|request| {
        let answer = vec![request[0], 3, 2, 0, request[0]];
        vec![(DELAY, Heard::Frame(answer))]
    });
    let client = desk.port.client(CONFIG);
    let read = move |unit| async move {
        let mut cell = [0];
        let read = client.read_holding_registers(unit, 0, &mut cell).await;
        read.map(|()| cell[0])
    };
    let first = desk.spawn(async move {
        assert_eq!(read(20).await, Ok(20));
    });
    desk.poll();
    // Its task waits behind that, in the only place.
    let scans = desk.spawn(async move { scan.run(client).await });
    desk.run(2);
    desk.cancel(scans);
    assert_eq!(desk.ask(read(21)).0, Ok(21));
    assert!(desk.is_over(first) && !client.is_busy());
    assert_eq!(counts(scan.health(0)), [0; 4]);
    // And it may be run again.
    desk.spawn(async move { scan.run(client).await });
    desk.run(2 * EXCHANGE);
    assert_eq!(counts(scan.health(0)), [1, 0, 0, 0]);
}

/// What would stop the build; `None` if nothing does.
fn refused<R>(build: impl FnOnce() -> R) -> Option<String> {
    let panic = catch_unwind(AssertUnwindSafe(|| drop(build()))).err()?;
    let literal = panic.downcast_ref::<&str>().map(ToString::to_string);
    literal.or_else(|| panic.downcast_ref::<String>().cloned())
}

#[test]
fn an_entry_is_limited_to_one_request() {
    type Of = fn(u8, u16, u16) -> PollEntry;
    for (of, limit) in [
        (PollEntry::holding_registers as Of, 125),
        (PollEntry::input_registers, 125),
        (PollEntry::coils, 2000),
        (PollEntry::discrete_inputs, 2000),
    ] {
        for unit in [1, 247] {
            for (first, count) in [
                (0, 1),
                (0, limit),
                (65_535, 1),
                (65_534, 2),
                (65_535 - limit + 1, limit),
            ] {
                assert_eq!(refused(|| of(unit, first, count)), None, "{first}, {count}");
            }
        }
        for unit in [0, 248, 255] {
            assert_eq!(
                refused(|| of(unit, 0, 1)).as_deref(),
                Some("unit must be 1..=247")
            );
        }
        for count in [0, limit + 1, u16::MAX] {
            assert_eq!(
                refused(|| of(1, 0, count)).as_deref(),
                Some("count must be 1..=125 registers or 1..=2000 bits")
            );
        }
        for (first, count) in [(65_535, 2), (65_534, 3), (65_535 - limit + 2, limit)] {
            assert_eq!(
                refused(|| of(1, first, count)).as_deref(),
                Some("first and count must end at address 65535 or before")
            );
        }
    }
    let entry = || PollEntry::coils(1, 0, 1);
    assert_eq!(
        refused(|| entry().period_ms(0)).as_deref(),
        Some("period_ms is 0, must be 1..=65535")
    );
    assert_eq!(refused(|| entry().period_ms(1)), None);
    assert_eq!(entry().period_ms(1000), entry());
    assert_ne!(entry().period_ms(u16::MAX), entry());
}

#[test]
fn the_number_of_cells_is_that_of_the_items_read() {
    let entries = || {
        [
            PollEntry::coils(1, 0, 9),
            PollEntry::input_registers(1, 0, 2),
        ]
    };
    let expected = Some("a scan list must have as many cells as its entries read");
    assert_eq!(refused(|| PollList::<2, 11>::new(entries())), None);
    assert_eq!(
        refused(|| PollList::<2, 10>::new(entries())).as_deref(),
        expected
    );
    assert_eq!(
        refused(|| PollList::<2, 12>::new(entries())).as_deref(),
        expected
    );
    let scan = PollList::<2, 11>::new(entries());
    assert_eq!(
        [0, 1].map(|entry| scan.with_cells(entry, <[u16]>::len)),
        [9, 2]
    );
}
