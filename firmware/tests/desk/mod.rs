//! A client on a line without a chip; the test controls the peer and the time.
//!
//! Tasks are polled only when they are woken, so that a missing wake-up shows.
#![allow(dead_code, reason = "each test binary uses a part")]

pub mod once;
pub mod routed;

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::future::{Future, poll_fn};
use std::pin::Pin;
use std::ptr::NonNull;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Wake, Waker};

use embassy_time::{Duration, MockDriver};
use multidrop::line::{Adu, Key, Lend, Line, LineConfig, LineError};
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::{Client, ClientError, ClientPort, client_receive};

/// What comes from the wire.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Heard {
    /// A frame with a good check, unit id and PDU.
    Frame(Vec<u8>),
    /// A frame that a late character voids.
    Void(Vec<u8>),
    /// A damaged one.
    Damaged(ReceiveErrors),
    /// Somebody talks for so many ms, and nothing of it is for us.
    Talk(u64),
    /// It begins now and is over so many ms later.
    Long(u64, Box<Heard>),
}

/// Ms from a frame's end to the verdict over it.
const SETTLES: u64 = 1;
/// Ms that a request takes on the wire.
pub const SENDS: u64 = 5;

/// What the peer does when a request is over: ms later, what.
type Peer = Box<dyn FnMut(&[u8]) -> Vec<(u64, Heard)>>;

#[derive(Default)]
pub struct Wire {
    now: Cell<u64>,
    /// To come, in the order of time.
    coming: RefCell<Vec<(u64, Heard)>>,
    /// Come, and not fetched.
    come: RefCell<VecDeque<Heard>>,
    lent: Cell<bool>,
    adu: Cell<Option<*mut Adu>>,
    verdict: Cell<Option<bool>>,
    /// When there is a verdict, and which.
    settles: Cell<Option<(u64, bool)>>,
    busy_until: Cell<u64>,
    /// A frame comes in until then.
    heard_until: Cell<u64>,
    /// What is on the wire, from when.
    sending: RefCell<Option<(u64, Vec<u8>)>>,
    withheld: Cell<bool>,
    /// Requests that went out whole, and when they began.
    pub sent: RefCell<Vec<(u64, Vec<u8>)>>,
    /// Requests that were cut off.
    pub cut: Cell<usize>,
    /// Somebody begins to talk when this many requests are released, and keeps the wire for so long.
    pub interrupts: RefCell<VecDeque<u64>>,
    /// What was shown to whoever looks, and when.
    pub shown: RefCell<Vec<(u64, Vec<u8>)>>,
    peer: RefCell<Option<Peer>>,
    receiver: RefCell<Option<Waker>>,
    user: RefCell<Option<Waker>>,
}

/// Its wire is leaked: it lives as long as the test.
pub struct TestLine(pub &'static Wire);

impl Wire {
    fn wake(place: &RefCell<Option<Waker>>) {
        if let Some(waker) = place.take() {
            waker.wake();
        }
    }

    /// Something comes from the wire, so many ms from now.
    pub fn comes(&self, after: u64, heard: Heard) {
        let when = self.now.get() + after;
        self.coming.borrow_mut().push((when, heard));
    }

    /// Whether the buffer is with a task.
    pub fn is_lent(&self) -> bool {
        self.lent.get()
    }

    fn is_silent(&self) -> bool {
        self.now.get() >= self.busy_until.get()
    }

    /// One ms later.
    fn tick(&self) {
        let now = self.now.get() + 1;
        self.now.set(now);
        if let Some((when, stands)) = self.settles.get()
            && when <= now
        {
            self.settles.set(None);
            self.verdict.set(Some(stands));
            Self::wake(&self.user);
        }
        let over = |sending: &mut (u64, Vec<u8>)| sending.0 + SENDS <= now;
        let sent = self.sending.borrow_mut().take_if(over);
        if let Some((began, bytes)) = sent {
            let answers = match &mut *self.peer.borrow_mut() {
                Some(peer) => peer(&bytes),
                None => Vec::new(),
            };
            for (delay, heard) in answers {
                self.coming.borrow_mut().push((now + delay, heard));
            }
            self.sent.borrow_mut().push((began, bytes));
            Self::wake(&self.user);
        }
        let mut coming = self.coming.borrow_mut();
        coming.sort_by_key(|(when, _)| *when);
        while coming.first().is_some_and(|(when, _)| *when <= now) {
            let (_, heard) = coming.remove(0);
            let length = match heard {
                Heard::Talk(length) | Heard::Long(length, _) => length,
                _ => SETTLES,
            };
            self.busy_until.set(self.busy_until.get().max(now + length));
            if let Heard::Long(length, heard) = heard {
                self.heard_until.set(now + length);
                coming.push((now + length, *heard));
                coming.sort_by_key(|(when, _)| *when);
                continue;
            }
            // The receiver is off while a request goes out.
            let deaf = self.sending.borrow().is_some();
            if !deaf && !matches!(heard, Heard::Talk(_)) {
                self.come.borrow_mut().push_back(heard);
                Self::wake(&self.receiver);
            }
        }
        if self.busy_until.get() == now {
            Self::wake(&self.user);
        }
    }
}

fn register(place: &RefCell<Option<Waker>>, context: &Context<'_>) {
    if let Some(before) = place.replace(Some(context.waker().clone()))
        && !before.will_wake(context.waker())
    {
        before.wake();
    }
}

// SAFETY: what is lent is leaked, and lent once.
unsafe impl Lend for TestLine {
    fn poll_received(&self, context: &mut Context<'_>, _: Key) -> Poll<Result<u8, ReceiveErrors>> {
        *self.0.receiver.borrow_mut() = Some(context.waker().clone());
        let (bytes, stands) = match self.0.come.borrow_mut().pop_front() {
            None => return Poll::Pending,
            Some(Heard::Damaged(errors)) => return Poll::Ready(Err(errors)),
            Some(Heard::Frame(bytes)) => (bytes, true),
            Some(Heard::Void(bytes)) => (bytes, false),
            Some(Heard::Talk(_) | Heard::Long(..)) => unreachable!("not a frame"),
        };
        if self.0.lent.replace(true) {
            // Nowhere to put it.
            return Poll::Ready(Err(ReceiveErrors::OVERRUN));
        }
        let adu = Box::leak(Box::new([0xEE; 256]));
        adu[..bytes.len()].copy_from_slice(&bytes);
        self.0.adu.set(Some(adu));
        self.0.verdict.set(None);
        self.0
            .settles
            .set(Some((self.0.now.get() + SETTLES, stands)));
        Poll::Ready(Ok(bytes.len() as u8))
    }

    fn poll_lent(&self, context: &mut Context<'_>, _: Key) -> Poll<()> {
        register(&self.0.user, context);
        if !self.0.is_silent() || self.0.lent.get() || self.0.settles.get().is_some() {
            return Poll::Pending;
        }
        self.0.lent.set(true);
        self.0.verdict.set(Some(true));
        let adu = Box::leak(Box::new([0xEE; 256]));
        self.0.adu.set(Some(adu));
        Poll::Ready(())
    }

    fn buffer(&self, _: Key) -> NonNull<Adu> {
        NonNull::new(self.0.adu.get().expect("lent")).expect("leaked")
    }

    fn release(&self, len: u8, _: Key) {
        assert!((2..=254).contains(&len), "length {len}");
        let interrupt = self.0.interrupts.borrow_mut().pop_front().unwrap_or(0);
        if interrupt > 0 {
            self.0.withheld.set(true);
            self.0.busy_until.set(self.0.now.get() + interrupt);
            return;
        }
        let adu = self.0.adu.get().expect("lent");
        // SAFETY: leaked, and not changed after it was released.
        let bytes = unsafe { &*adu }[..usize::from(len)].to_vec();
        *self.0.sending.borrow_mut() = Some((self.0.now.get(), bytes));
    }

    fn poll_settled(&self, context: &mut Context<'_>, _: Key) -> Poll<bool> {
        register(&self.0.user, context);
        self.0.verdict.get().map_or(Poll::Pending, Poll::Ready)
    }

    fn poll_sent(&self, context: &mut Context<'_>, _: Key) -> Poll<bool> {
        register(&self.0.user, context);
        if self.0.withheld.take() {
            return Poll::Ready(false);
        }
        match &*self.0.sending.borrow() {
            Some(_) => Poll::Pending,
            None => Poll::Ready(true),
        }
    }

    fn give_back(&self, _: Key) {
        assert!(self.0.lent.replace(false), "given back twice");
        self.0.adu.set(None);
        if self.0.sending.take().is_some() {
            self.0.cut.set(self.0.cut.get() + 1);
        }
    }
}

impl Line for TestLine {
    const HAS_NEIGHBOURS: bool = true;

    fn quiet(&self) -> impl Future<Output = ReceiveErrors> {
        poll_fn(|context| {
            register(&self.0.user, context);
            let is_heard = self.0.now.get() < self.0.heard_until.get();
            match is_heard || !self.0.come.borrow().is_empty() {
                true => Poll::Pending,
                false => Poll::Ready(ReceiveErrors::NONE),
            }
        })
    }

    fn check(&self, _: &LineConfig) -> Result<(), LineError> {
        Ok(())
    }

    async fn configure(&self, _: LineConfig) -> Result<(), LineError> {
        Ok(())
    }

    fn set_delimiter(&self, _: u8) {}

    fn show(&self, seen: Result<&[u8], ReceiveErrors>) {
        let seen = seen.expect("a good frame").to_vec();
        self.0.shown.borrow_mut().push((self.0.now.get(), seen));
    }
}

struct Flag(AtomicBool);

impl Wake for Flag {
    fn wake(self: Arc<Self>) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// A task of the test.
pub struct Task<'a> {
    future: Option<Pin<Box<dyn Future<Output = ()> + 'a>>>,
    flag: Arc<Flag>,
}

/// A port for `N` tasks that ask, and its tasks.
pub struct Desk<'a, const N: usize> {
    pub wire: &'static Wire,
    pub port: &'static ClientPort<TestLine, N>,
    /// Lines of other ports.
    others: Vec<&'static Wire>,
    tasks: Vec<Task<'a>>,
    _time: MutexGuard<'static, ()>,
}

/// There is one time for all tests of a binary.
static TIME: Mutex<()> = Mutex::new(());

impl<'a, const N: usize> Desk<'a, N> {
    /// A peer that does this when a request is over.
    pub fn new(peer: impl FnMut(&[u8]) -> Vec<(u64, Heard)> + 'static) -> Self {
        let time = TIME.lock().unwrap_or_else(PoisonError::into_inner);
        MockDriver::get().reset();
        let wire: &'static Wire = Box::leak(Box::default());
        *wire.peer.borrow_mut() = Some(Box::new(peer));
        let port: &'static ClientPort<TestLine, N> =
            Box::leak(Box::new(ClientPort::new(TestLine(wire))));
        let mut desk = Self {
            wire,
            port,
            others: Vec::new(),
            tasks: Vec::new(),
            _time: time,
        };
        desk.spawn(async move { client_receive(port).await });
        desk
    }

    /// The line of another port, on which nobody answers.
    pub fn other(&mut self) -> &'static Wire {
        let wire: &'static Wire = Box::leak(Box::default());
        wire.now.set(self.now());
        self.others.push(wire);
        wire
    }

    /// Adds a task; its number is for [`Desk::is_over`] and [`Desk::cancel`].
    pub fn spawn(&mut self, future: impl Future<Output = ()> + 'a) -> usize {
        self.tasks.push(Task {
            future: Some(Box::pin(future)),
            flag: Arc::new(Flag(AtomicBool::new(true))),
        });
        self.tasks.len() - 1
    }

    /// Polls what is awake until all sleep.
    pub fn poll(&mut self) {
        let mut polls = 0;
        while let Some(task) = self
            .tasks
            .iter_mut()
            .find(|task| task.future.is_some() && task.flag.0.swap(false, Ordering::Relaxed))
        {
            polls += 1;
            assert!(polls < 10_000, "never sleeps");
            let waker = Waker::from(task.flag.clone());
            let mut context = Context::from_waker(&waker);
            if let Some(future) = &mut task.future
                && future.as_mut().poll(&mut context).is_ready()
            {
                task.future = None;
            }
        }
    }

    /// A ms in which no task is polled but the one that takes frames from the line.
    pub fn receive_only(&mut self) {
        self.wire.tick();
        MockDriver::get().advance(Duration::from_millis(1));
        let rest = self.tasks.split_off(1);
        self.poll();
        self.tasks.extend(rest);
    }

    /// Ms since the start.
    pub fn now(&self) -> u64 {
        self.wire.now.get()
    }

    /// Lets so many ms pass.
    pub fn run(&mut self, ms: u64) {
        self.poll();
        for _ in 0..ms {
            self.wire.tick();
            self.others.iter().for_each(|wire| wire.tick());
            MockDriver::get().advance(Duration::from_millis(1));
            self.poll();
        }
    }

    pub fn is_over(&self, task: usize) -> bool {
        self.tasks[task].future.is_none()
    }

    /// Drops a task where it is.
    pub fn cancel(&mut self, task: usize) {
        self.tasks[task].future = None;
    }

    /// Runs a future to its end; its result and the ms it took.
    pub fn ask<R: 'a>(&mut self, future: impl Future<Output = R> + 'a) -> (R, u64) {
        let result = Rc::new(RefCell::new(None));
        let place = result.clone();
        let began = self.now();
        let task = self.spawn(async move {
            let value = future.await;
            *place.borrow_mut() = Some(value);
        });
        self.poll();
        while !self.is_over(task) {
            assert!(self.now() - began < 100_000, "never over");
            self.run(1);
        }
        let value = result.take().expect("over");
        (value, self.now() - began)
    }

    /// Requests that went out whole.
    pub fn sent(&self) -> Vec<Vec<u8>> {
        let sent = self.wire.sent.borrow();
        sent.iter().map(|(_, bytes)| bytes.clone()).collect()
    }
}

/// A server with holding registers and nothing else, by the book. Register n is 0x1000 * unit + n at first.
#[derive(Default)]
pub struct Registers {
    written: std::collections::HashMap<(u8, u16), u16>,
}

impl Registers {
    pub fn get(&self, unit: u8, address: u16) -> u16 {
        let first = 0x1000_u16.wrapping_mul(unit.into()).wrapping_add(address);
        *self.written.get(&(unit, address)).unwrap_or(&first)
    }

    /// What is answered; `None` to a broadcast.
    pub fn answer(&mut self, request: &[u8]) -> Option<Vec<u8>> {
        let word = |at: usize| u16::from(request[at]) * 256 + u16::from(request[at + 1]);
        let (unit, function) = (request[0], request[1]);
        let answer = match function {
            3 => {
                let (first, count) = (word(2), word(4));
                let mut answer = vec![unit, 3, (count * 2) as u8];
                for address in first..first + count {
                    answer.extend(self.get(unit, address).to_be_bytes());
                }
                answer
            }
            6 => {
                self.written.insert((unit, word(2)), word(4));
                request.to_vec()
            }
            16 => {
                for place in 0..word(4) {
                    let value = word(7 + 2 * usize::from(place));
                    self.written.insert((unit, word(2) + place), value);
                }
                request[..6].to_vec()
            }
            _ => vec![unit, function | 0x80, 1],
        };
        (unit != 0).then_some(answer)
    }
}

/// Reads one register.
pub async fn read<const N: usize>(
    client: Client<TestLine, N>,
    unit: u8,
    address: u16,
) -> Result<u16, ClientError> {
    let mut cell = [0xEEEE];
    let read = client.read_holding_registers(unit, address, &mut cell);
    read.await.map(|()| cell[0])
}
