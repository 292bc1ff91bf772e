//! A port whose queue has one place, and more tasks than that: the work of the port itself waits as long as
//! necessary.

#[allow(dead_code, reason = "each test binary uses a part")]
mod bench;

use std::cell::RefCell;
use std::future::Future;
use std::pin::pin;
use std::rc::Rc;
use std::task::{Context, Poll, Waker};

use bench::{Bench, Event, SENDS, TestLine, Wire};
use multidrop::managed::{ManagedPort, managed_receive, managed_run};
use multidrop::protocol::port_registers::{PortRegisters, Register};
use multidrop::protocol::registers::{Bank, NoCoils, NoRules};
use multidrop::{ClientConfig, ClientError, PortConfig};

const RS4: PortConfig = PortConfig::new("RS4").client().slave_id(17).timeout_ms(50);
const CONFIG: ClientConfig = ClientConfig::new().timeout_ms(50);
const DELAY: u64 = 10;
/// A request and its answer.
const EXCHANGE: u64 = SENDS + DELAY + 2;

type Port = ManagedPort<TestLine, PortRegisters<Bank<4>, NoCoils, NoRules>>;
type Ends = Rc<RefCell<Vec<(u8, Result<u16, ClientError>)>>>;

/// A master whose slaves answer with their unit id.
fn open(bench: &mut Bench<'_>) -> (&'static Wire, &'static Port) {
    let wire = Wire::new(RS4.line());
    wire.answered_by(|request| vec![(DELAY, Ok(vec![request[0], 3, 2, 0, request[0]]))]);
    let port: &'static Port = Box::leak(Box::new(Port::new(
        TestLine(wire),
        &RS4,
        RS4.bank(),
        NoCoils,
    )));
    bench.wire(wire);
    bench.spawn(async move { managed_receive(port).await });
    bench.spawn(async move { managed_run(port).await });
    bench.poll();
    (wire, port)
}

/// A task that asks these units once each, beside each other; how they end.
fn ask(bench: &mut Bench<'_>, port: &'static Port, units: &[u8]) -> Ends {
    let ends = Ends::default();
    for &unit in units {
        let ends = ends.clone();
        bench.spawn(async move {
            let mut cell = [0];
            let asked = port.client(CONFIG);
            let read = asked.read_holding_registers(unit, 0, &mut cell).await;
            ends.borrow_mut().push((unit, read.map(|()| cell[0])));
        });
        bench.poll();
    }
    ends
}

fn units(wire: &Wire) -> Vec<u8> {
    wire.sent().iter().map(|sent| sent[0]).collect()
}

#[test]
fn settings_change_after_all_earlier_requests() {
    let mut bench = Bench::new();
    let (wire, port) = open(&mut bench);
    // One has the line, one the only place.
    let ends = ask(&mut bench, port, &[21, 22]);
    bench.run_restless(2);
    port.load_raw(Register::Baud, 9600).unwrap();
    bench.run_restless(4 * EXCHANGE);
    assert_eq!(*ends.borrow(), [(21, Ok(21)), (22, Ok(22))]);
    let log = wire.log.borrow();
    let [
        Event::Sent(_, first),
        Event::Sent(_, second),
        Event::Configured(now),
    ] = &log[..]
    else {
        panic!("{log:?}");
    };
    assert_eq!([first.baud, second.baud, now.baud], [19_200, 19_200, 9600]);
}

#[test]
fn a_started_transaction_finds_the_queue_full_and_waits() {
    let mut bench = Bench::new();
    let (wire, port) = open(&mut bench);
    let ends = ask(&mut bench, port, &[21, 22]);
    bench.run_restless(2);
    port.start().unwrap();
    let done = Rc::new(RefCell::new(None));
    let place = done.clone();
    bench.spawn(async move {
        let outcome = port.done().await;
        *place.borrow_mut() = Some(outcome);
    });
    bench.run_restless(4 * EXCHANGE);
    assert_eq!(units(wire), [21, 22, 17]);
    assert_eq!(*done.borrow(), Some(Ok(())));
    assert_eq!(ends.borrow().len(), 2);
    assert_eq!(port.read(Register::Regs(0)), Ok(17));
    assert_eq!(port.read(Register::Status), Ok(0));
}

#[test]
fn one_more_client_is_refused_at_once_and_the_others_go_on() {
    let mut bench = Bench::new();
    let (wire, port) = open(&mut bench);
    let ends = ask(&mut bench, port, &[21, 22, 23]);
    assert_eq!(*ends.borrow(), [(23, Err(ClientError::QueueFull))]);
    bench.run(3 * EXCHANGE);
    assert_eq!(ends.borrow()[1..], [(21, Ok(21)), (22, Ok(22))]);
    assert_eq!(units(wire), [21, 22]);
    // The place is free again.
    let ends = ask(&mut bench, port, &[24, 25]);
    bench.run(3 * EXCHANGE);
    assert_eq!(*ends.borrow(), [(24, Ok(24)), (25, Ok(25))]);
}

#[test]
fn waiting_requests_are_refused_when_the_port_stops_being_master() {
    let mut bench = Bench::new();
    let (wire, port) = open(&mut bench);
    let ends = ask(&mut bench, port, &[21, 22]);
    bench.run_restless(2);
    port.load_raw(Register::Mode, 2).unwrap();
    bench.run_restless(3 * EXCHANGE);
    assert_eq!(
        *ends.borrow(),
        [(22, Err(ClientError::NotMaster)), (21, Ok(21))]
    );
    assert_eq!(units(wire), [21]);
    // From then on at once, and again once it is master.
    let ends = ask(&mut bench, port, &[23]);
    assert_eq!(*ends.borrow(), [(23, Err(ClientError::NotMaster))]);
    port.load_raw(Register::Mode, 0).unwrap();
    bench.run(2);
    let ends = ask(&mut bench, port, &[24]);
    bench.run(2 * EXCHANGE);
    assert_eq!(*ends.borrow(), [(24, Ok(24))]);
}

/// A task that does nothing but ask lets the others run, which may make the port master again.
#[test]
fn a_task_that_retries_in_a_loop_lets_others_run() {
    let mut bench = Bench::new();
    let (_, port) = open(&mut bench);
    port.load_raw(Register::Mode, 2).unwrap();
    bench.run(2);
    let client = port.client(CONFIG);
    let mut context = Context::from_waker(Waker::noop());
    for _ in 0..3 {
        let mut cell = [0];
        let mut asked = pin!(client.read_holding_registers(21, 0, &mut cell));
        assert!(asked.as_mut().poll(&mut context).is_pending());
        let refused = Poll::Ready(Err(ClientError::NotMaster));
        assert_eq!(asked.as_mut().poll(&mut context), refused);
    }
}
