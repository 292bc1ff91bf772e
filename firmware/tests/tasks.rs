//! The receive and the serve task on the host, over a line that the test drives moment by moment.
//!
//! Requests and answers are bytes of the standard and of its examples, not made by the code under test.

use std::cell::{Cell, RefCell};
use std::future::Future;
use std::pin::Pin;
use std::ptr::NonNull;
use std::task::{Context, Poll, Waker};

use multidrop::line::{Adu, Key, Lend, Line, LineConfig, LineError, TransmitError};
use multidrop::protocol::data::{Registers, RegistersOut};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::registers::Bank;
use multidrop::protocol::server::{ApplicationFunction, Counted, DataModel};
use multidrop::{PortConfig, ServerPort, Shared};

#[derive(Default)]
struct Wire {
    heard: RefCell<Option<Result<Vec<u8>, ReceiveErrors>>>,
    lent: Cell<bool>,
    verdict: Cell<Option<bool>>,
    released: Cell<u8>,
    /// What was released went out.
    whole: Cell<bool>,
    /// The number of times that another station begins to talk first.
    overtaken: Cell<usize>,
    /// The line says that what did not go out was cut off.
    cut: Cell<bool>,
    /// What went on the wire, and only once the frame stood.
    sent: RefCell<Vec<Vec<u8>>>,
    lent_adu: Cell<*mut Adu>,
}

/// A line without a chip. Its wire is leaked: it lives as long as the test.
struct TestLine(&'static Wire);

// SAFETY: what is lent is leaked, and lent once.
unsafe impl Lend for TestLine {
    fn poll_received(&self, _: &mut Context<'_>, _: Key) -> Poll<Result<u8, ReceiveErrors>> {
        match self.0.heard.borrow_mut().take() {
            None => Poll::Pending,
            Some(Err(errors)) => Poll::Ready(Err(errors)),
            Some(Ok(bytes)) => {
                assert!(!self.0.lent.replace(true), "lent twice");
                let adu = Box::leak(Box::new([0; 256]));
                adu[..bytes.len()].copy_from_slice(&bytes);
                self.0.lent_adu.set(adu);
                Poll::Ready(Ok(bytes.len() as u8))
            }
        }
    }

    fn poll_lent(&self, _: &mut Context<'_>, _: Key) -> Poll<()> {
        if self.0.lent.replace(true) {
            return Poll::Pending;
        }
        let adu = Box::leak(Box::new([0; 256]));
        self.0.lent_adu.set(adu);
        self.0.verdict.set(Some(true));
        Poll::Ready(())
    }

    fn buffer(&self, _: Key) -> NonNull<Adu> {
        NonNull::new(self.0.lent_adu.get()).expect("lent")
    }

    fn release(&self, len: u8, _: Key) {
        assert!((2..=254).contains(&len), "length {len}");
        self.0.released.set(len);
        self.0.go();
    }

    fn poll_settled(&self, _: &mut Context<'_>, _: Key) -> Poll<bool> {
        self.0.verdict.get().map_or(Poll::Pending, Poll::Ready)
    }

    fn poll_sent(&self, _: &mut Context<'_>, _: Key) -> Poll<bool> {
        match (self.0.released.get(), self.0.verdict.get()) {
            (1.., None) => Poll::Pending,
            _ => Poll::Ready(self.0.whole.get()),
        }
    }

    fn give_back(&self, _: Key) {
        self.0.lent.set(false);
        self.0.released.set(0);
        self.0.verdict.set(None);
        self.0.whole.set(false);
    }
}

impl Line for TestLine {
    async fn quiet(&self) -> ReceiveErrors {
        ReceiveErrors::NONE
    }

    fn check(&self, _: &LineConfig) -> Result<(), LineError> {
        Ok(())
    }

    async fn configure(&self, _: LineConfig) -> Result<(), LineError> {
        Ok(())
    }

    fn set_delimiter(&self, _: u8) {}

    fn was_cut(&self) -> bool {
        self.0.cut.get()
    }
}

impl Wire {
    /// The transmitter: starts when the frame stands and an answer is released.
    fn go(&self) {
        if self.verdict.get() == Some(true) && self.released.get() > 0 {
            if let Some(left) = self.overtaken.get().checked_sub(1) {
                self.overtaken.set(left);
                self.released.set(0);
                return;
            }
            self.whole.set(true);
            // SAFETY: the frame is lent, so its buffer is alive; the tasks are not running.
            let adu = unsafe { &*self.lent_adu.get() };
            self.sent
                .borrow_mut()
                .push(adu[..self.released.take() as usize].to_vec());
        }
    }
}

struct Model {
    bank: Bank<4>,
}

impl DataModel for Model {
    const WRITES_MAY_FAIL: bool = false;
    const APPLICATION: &'static [ApplicationFunction<Model>] = &[ApplicationFunction {
        code: 0x41,
        broadcast: false,
        run: reverse,
    }];

    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.bank.read(first, out)
    }

    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.bank.check(first, values)
    }

    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.bank.write(first, values)
    }
}

fn reverse(model: &mut Model, pdu: &mut [u8], len: usize) -> Result<usize, Exception> {
    model.bank.set(3, 0xCAFE);
    pdu[1..len].reverse();
    Ok(len)
}

struct Bench {
    wire: &'static Wire,
    model: &'static Shared<Model>,
    tasks: Vec<Pin<Box<dyn Future<Output = ()>>>>,
}

impl Bench {
    fn new() -> Self {
        const PORT: PortConfig = PortConfig::new("TEST").slave_id(17);
        let wire: &'static Wire = Box::leak(Box::default());
        let port: &'static ServerPort<TestLine> =
            Box::leak(Box::new(ServerPort::new(TestLine(wire), &PORT)));
        let model: &'static Shared<Model> =
            Box::leak(Box::new(Shared::new(Model { bank: Bank::new(0) })));
        Self {
            wire,
            model,
            tasks: vec![
                Box::pin(async move { multidrop::receive(port).await }),
                Box::pin(async move { multidrop::serve(port, model).await }),
            ],
        }
    }

    fn run(&mut self) {
        let mut context = Context::from_waker(Waker::noop());
        for _ in 0..4 {
            for task in &mut self.tasks {
                assert!(task.as_mut().poll(&mut context).is_pending());
            }
        }
    }

    /// A frame is complete at t1.5.
    fn complete(&mut self, bytes: &[u8]) {
        *self.wire.heard.borrow_mut() = Some(Ok(bytes.to_vec()));
        self.run();
    }

    /// t3.5, or a late character.
    fn settle(&mut self, stands: bool) {
        self.wire.verdict.set(Some(stands));
        self.wire.go();
        self.run();
    }

    fn get(&self, address: u16) -> Option<u16> {
        self.model.with(|model| model.bank.get(address))
    }

    fn sent(&self) -> Vec<Vec<u8>> {
        self.wire.sent.take()
    }
}

#[test]
fn a_read_is_released_before_t3_5_and_sent_at_t3_5() {
    let mut bench = Bench::new();
    bench.model.with(|model| model.bank.set(1, 0xAE41));
    bench.complete(&[0x11, 0x03, 0x00, 0x01, 0x00, 0x01]);
    assert_eq!(bench.wire.released.get(), 5);
    assert!(bench.sent().is_empty());
    bench.settle(true);
    assert_eq!(bench.sent(), [[0x11, 0x03, 0x02, 0xAE, 0x41]]);
    assert!(!bench.wire.lent.get());
}

#[test]
fn a_write_is_carried_out_when_its_frame_stands_and_not_before() {
    let mut bench = Bench::new();
    bench.complete(&[0x11, 0x06, 0x00, 0x01, 0x00, 0x03]);
    assert_eq!(bench.get(1), Some(0));
    bench.settle(true);
    assert_eq!(bench.get(1), Some(3));
    assert_eq!(bench.sent(), [[0x11, 0x06, 0x00, 0x01, 0x00, 0x03]]);
}

#[test]
fn a_void_frame_changes_nothing_and_is_not_answered() {
    let mut bench = Bench::new();
    bench.complete(&[
        0x11, 0x10, 0x00, 0x01, 0x00, 0x02, 0x04, 0x00, 0x0A, 0x01, 0x02,
    ]);
    bench.settle(false);
    assert_eq!(bench.model.with(|model| *model.bank.cells()), [0; 4]);
    assert!(bench.sent().is_empty());
    assert!(!bench.wire.lent.get());
    bench.complete(&[
        0x11, 0x10, 0x00, 0x01, 0x00, 0x02, 0x04, 0x00, 0x0A, 0x01, 0x02,
    ]);
    bench.settle(true);
    assert_eq!(
        bench.model.with(|model| *model.bank.cells()),
        [0, 10, 0x102, 0]
    );
    assert_eq!(bench.sent(), [[0x11, 0x10, 0x00, 0x01, 0x00, 0x02]]);
}

#[test]
fn a_broadcast_is_carried_out_and_not_answered() {
    let mut bench = Bench::new();
    bench.complete(&[0x00, 0x06, 0x00, 0x02, 0x12, 0x34]);
    bench.settle(true);
    assert_eq!(bench.get(2), Some(0x1234));
    assert!(bench.sent().is_empty());
    assert!(!bench.wire.lent.get());
}

#[test]
fn an_application_function_runs_when_its_frame_stands() {
    let mut bench = Bench::new();
    bench.complete(&[0x11, 0x41, 1, 2, 3]);
    assert_eq!(bench.get(3), Some(0));
    bench.settle(true);
    assert_eq!(bench.get(3), Some(0xCAFE));
    assert_eq!(bench.sent(), [[0x11, 0x41, 3, 2, 1]]);
    bench.complete(&[0x11, 0x41, 1, 2]);
    bench.settle(false);
    assert!(bench.sent().is_empty());
    assert!(!bench.wire.lent.get());
}

#[test]
fn other_units_frames_and_damaged_ones_are_given_back_unanswered() {
    let mut bench = Bench::new();
    for unit in [1, 16, 18, 247, 248, 255] {
        bench.complete(&[unit, 0x03, 0x00, 0x01, 0x00, 0x01]);
        assert!(!bench.wire.lent.get(), "unit {unit}");
        assert_eq!(bench.wire.released.get(), 0, "unit {unit}");
    }
    *bench.wire.heard.borrow_mut() = Some(Err(ReceiveErrors::CHECK));
    bench.run();
    bench.complete(&[0x11, 0x03, 0x00, 0x01, 0x00, 0x01]);
    bench.settle(true);
    assert_eq!(bench.sent().len(), 1);
}

/// Not first when the task that serves comes to it: what answers them may come meanwhile.
#[test]
fn other_units_frames_are_not_passed_on() {
    let mut bench = Bench::new();
    let mut context = Context::from_waker(Waker::noop());
    for (unit, is_ours) in [
        (16, false),
        (18, false),
        (255, false),
        (17, true),
        (0, true),
    ] {
        *bench.wire.heard.borrow_mut() = Some(Ok(vec![unit, 0x03, 0x00, 0x01, 0x00, 0x01]));
        let receive = &mut bench.tasks[0];
        assert!(receive.as_mut().poll(&mut context).is_pending());
        assert_eq!(bench.wire.lent.get(), is_ours, "unit {unit}");
        bench.run();
        bench.settle(true);
        assert!(!bench.wire.lent.get());
    }
}

/// Of two answers that did not go out the one is missing that was cut off, and not one that somebody else has overtaken.
#[test]
fn an_answer_that_was_cut_off_counts_as_no_response() {
    const PORT: PortConfig = PortConfig::new("TEST").slave_id(17);
    let wire: &'static Wire = Box::leak(Box::default());
    let port: &'static ServerPort<TestLine, Counted<8>> =
        Box::leak(Box::new(ServerPort::counted(TestLine(wire), &PORT)));
    let model: &'static Shared<Model> =
        Box::leak(Box::new(Shared::new(Model { bank: Bank::new(0) })));
    let mut bench = Bench {
        wire,
        model,
        tasks: vec![
            Box::pin(async move { multidrop::receive(port).await }),
            Box::pin(async move { multidrop::serve(port, model).await }),
        ],
    };
    let read = [0x11, 0x03, 0x00, 0x01, 0x00, 0x01];
    // Two are cut off; of those that go out one does while the line still knows of a cut.
    for (overtaken, cut, sent) in [
        (1, false, 0),
        (1, true, 0),
        (1, true, 0),
        (0, true, 1),
        (0, false, 1),
    ] {
        wire.overtaken.set(overtaken);
        wire.cut.set(cut);
        bench.complete(&read);
        bench.settle(true);
        assert_eq!(bench.sent().len(), sent);
    }
    // Server messages, and those that were not answered; the one that asks is among the first.
    for (sub, count) in [(0x0E, 6), (0x0F, 2)] {
        bench.complete(&[0x11, 0x08, 0x00, sub, 0x00, 0x00]);
        bench.settle(true);
        assert_eq!(bench.sent(), [[0x11, 0x08, 0x00, sub, 0x00, count]]);
    }
}

#[test]
fn a_dropped_task_gives_the_frame_back() {
    let mut bench = Bench::new();
    bench.complete(&[0x11, 0x03, 0x00, 0x01, 0x00, 0x01]);
    assert!(bench.wire.lent.get());
    bench.tasks.clear();
    assert!(!bench.wire.lent.get());
    assert_eq!(bench.wire.released.get(), 0);
}

fn transmit(wire: &'static Wire, bytes: &[u8]) -> Result<(), TransmitError> {
    let line = TestLine(wire);
    let mut transmit = std::pin::pin!(line.transmit(bytes));
    let mut context = Context::from_waker(Waker::noop());
    match transmit.as_mut().poll(&mut context) {
        Poll::Ready(result) => result,
        Poll::Pending => panic!("waits for what is there"),
    }
}

#[test]
fn a_frame_of_an_invalid_length_is_not_transmitted() {
    let wire: &'static Wire = Box::leak(Box::default());
    for len in [0, 1, 255, 256, 300] {
        let result = transmit(wire, &vec![7; len]);
        assert_eq!(result, Err(TransmitError::Length(len)));
    }
    for len in [2, 254] {
        assert_eq!(transmit(wire, &vec![7; len]), Ok(()));
    }
    assert_eq!(wire.sent.take(), [vec![7; 2], vec![7; 254]]);
    assert!(!wire.lent.get());
}

#[test]
fn a_request_overtaken_by_traffic_is_tried_until_it_is_sent() {
    let wire: &'static Wire = Box::leak(Box::default());
    wire.overtaken.set(3);
    assert_eq!(transmit(wire, &[1, 2, 3]), Ok(()));
    assert_eq!(wire.sent.take(), [[1, 2, 3]]);
    assert_eq!(wire.overtaken.get(), 0);
}
