//! The poll list: periods, fairness, health, and cells that only a valid answer fills.

mod desk;

use desk::{Desk, Heard, Registers, SENDS};
use multidrop::poll::{PollEntry, PollList};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::{ClientConfig, ClientError};

const CONFIG: ClientConfig = ClientConfig::new().timeout_ms(50);
const DELAY: u64 = 4;
/// From the beginning of a request to the beginning of the next.
const EXCHANGE: u64 = SENDS + DELAY + 1;

/// Units that answer by the book.
fn answering() -> impl FnMut(&[u8]) -> Vec<(u64, Heard)> {
    let mut registers = Registers::default();
    move |request| {
        let answer = match request[1] {
            // Coils: those of odd addresses.
            1 => vec![
                request[0],
                1,
                1,
                if request[3] % 2 == 0 { 0b10 } else { 0b01 },
            ],
            _ => registers.answer(request).expect("no broadcast"),
        };
        vec![(DELAY, Heard::Frame(answer))]
    }
}

/// When requests to this unit began.
fn began<const N: usize>(desk: &Desk<'_, N>, unit: u8) -> Vec<u64> {
    let sent = desk.wire.sent.borrow();
    let own = sent.iter().filter(|(_, request)| request[0] == unit);
    own.map(|(when, _)| *when).collect()
}

#[test]
fn entries_are_read_at_their_periods_and_fill_their_cells() {
    let scan = PollList::<3, 6>::new([
        PollEntry::holding_registers(1, 100, 3).period_ms(100),
        PollEntry::coils(2, 8, 2).period_ms(250),
        PollEntry::holding_registers(3, 7, 1).period_ms(1000),
    ]);
    let scan = &scan;
    let mut desk = Desk::<1>::new(answering());
    let client = desk.port.client(CONFIG);
    desk.spawn(async move { scan.run(client).await });
    desk.run(995);
    // Where they meet, the one behind the last one read goes first.
    let expected = [0, 100, 200, 300, 400, 500 + EXCHANGE, 600, 700, 800, 900];
    assert_eq!(began(&desk, 1), expected);
    assert_eq!(began(&desk, 2), [EXCHANGE, 250, 500, 750]);
    assert_eq!(began(&desk, 3), [2 * EXCHANGE]);
    scan.with_cells(0, |cells| assert_eq!(cells, [0x1064, 0x1065, 0x1066]));
    scan.with_cells(1, |cells| assert_eq!(cells, [0, 1]));
    scan.with_cells(2, |cells| assert_eq!(cells, [0x3007]));
    assert_eq!(scan.health(0).answers, 10);
    assert_eq!(scan.health(1).answers, 4);
    assert_eq!(scan.health(0).last_error, None);
    let age = scan.health(1).age().expect("answered").as_millis();
    assert_eq!(age, desk.now() - (750 + EXCHANGE));
    assert!(scan.health(1).is_stale(age as u32 - 1) && !scan.health(1).is_stale(age as u32));
}

#[test]
fn a_list_that_demands_more_than_the_bus_carries_takes_turns() {
    let scan = PollList::<3, 3>::new([
        PollEntry::holding_registers(1, 0, 1).period_ms(1),
        PollEntry::holding_registers(2, 0, 1).period_ms(5),
        PollEntry::holding_registers(3, 0, 1).period_ms(20),
    ]);
    let scan = &scan;
    let mut desk = Desk::<1>::new(answering());
    let client = desk.port.client(CONFIG);
    desk.spawn(async move { scan.run(client).await });
    desk.run(3000);
    let counts = [0, 1, 2].map(|entry| scan.health(entry).answers);
    assert!(
        counts.iter().all(|&count| count.abs_diff(100) < 2),
        "{counts:?}"
    );
}

#[test]
fn a_silent_unit_costs_time_and_no_burst_follows() {
    let scan = PollList::<2, 2>::new([
        PollEntry::holding_registers(1, 0, 1).period_ms(20),
        PollEntry::holding_registers(9, 0, 1).period_ms(500),
    ]);
    let scan = &scan;
    let mut alive = answering();
    let mut desk = Desk::<1>::new(move |request| match request[0] {
        9 => vec![],
        _ => alive(request),
    });
    let client = desk.port.client(CONFIG.retries(2));
    desk.spawn(async move { scan.run(client).await });
    desk.run(2000);
    assert_eq!(scan.health(1).timeouts, 4);
    assert_eq!(scan.health(1).last_error, Some(ClientError::Timeout));
    assert!(scan.health(1).is_stale(u32::MAX));
    let began = began(&desk, 1);
    let gaps: Vec<u64> = began.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let dead = 3 * (SENDS + 50) + EXCHANGE;
    let (long, short): (Vec<u64>, Vec<u64>) = gaps.iter().partition(|&&gap| gap > 20);
    assert!(short.iter().all(|&gap| gap == 20), "{gaps:?}");
    assert!(
        long.iter().all(|gap| (dead..dead + 20).contains(gap)),
        "{gaps:?}"
    );
    assert_eq!(long.len(), 4);
}

#[test]
fn each_kind_of_result_is_counted_and_failures_leave_the_cells() {
    let scan = PollList::<1, 1>::new([PollEntry::holding_registers(17, 7, 1).period_ms(100)]);
    let scan = &scan;
    let answers = [
        Heard::Frame(vec![17, 3, 2, 0xAB, 0xCD]),
        Heard::Frame(vec![17, 0x83, 2]),
        Heard::Void(vec![17, 3, 2, 1, 2]),
        Heard::Damaged(ReceiveErrors::CHECK),
        Heard::Frame(vec![17, 3, 4, 1, 2, 3, 4]),
    ];
    let mut next = answers.clone().into_iter();
    let mut desk = Desk::<1>::new(move |_| match next.next() {
        Some(heard) => vec![(DELAY, heard)],
        None => vec![],
    });
    let client = desk.port.client(CONFIG);
    desk.spawn(async move { scan.run(client).await });
    let expected = [
        None,
        Some(ClientError::Exception(Exception::IllegalDataAddress)),
        Some(ClientError::Damaged(ReceiveErrors::GAP)),
        Some(ClientError::Damaged(ReceiveErrors::CHECK)),
        Some(ClientError::WrongLength(7)),
        Some(ClientError::Timeout),
    ];
    for error in expected {
        desk.run(100);
        assert_eq!(scan.health(0).last_error, error);
        scan.with_cells(0, |cells| assert_eq!(cells, [0xABCD]));
    }
    let health = scan.health(0);
    assert_eq!(
        (
            health.answers,
            health.exceptions,
            health.others,
            health.timeouts
        ),
        (1, 1, 3, 1)
    );
}
