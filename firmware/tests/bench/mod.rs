//! Managed ports on lines without a chip; the test controls the peers and the time, a millisecond at a time.
//!
//! Tasks are polled only when they are woken, so that a missing wake-up shows.

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
use multidrop::protocol::format::Framing;
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::port_registers::Flow;
use multidrop::sniff::Observer;

/// Ms from a frame's end to the verdict over it, and that a frame takes on the wire.
const SETTLES: u64 = 1;
pub const SENDS: u64 = 5;

/// What is heard: a frame (unit id and PDU), or a damaged one.
pub type Heard = Result<Vec<u8>, ReceiveErrors>;

/// What happened on a line.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// A frame went out whole, with these settings from its first bit to its last.
    Sent(Vec<u8>, LineConfig),
    /// The line was set up anew.
    Configured(LineConfig),
}

type Peer = Box<dyn FnMut(&[u8]) -> Vec<(u64, Heard)>>;

pub struct Wire {
    now: Cell<u64>,
    config: Cell<LineConfig>,
    coming: RefCell<Vec<(u64, Heard)>>,
    come: RefCell<VecDeque<Heard>>,
    lent: Cell<Option<*mut Adu>>,
    verdict: Cell<Option<bool>>,
    settles: Cell<Option<u64>>,
    sending: RefCell<Option<(u64, Vec<u8>)>>,
    released: Cell<u8>,
    /// The next frame that is released does not go out, and whether the line says that it was cut off.
    pub loses: Cell<Option<bool>>,
    lost: Cell<bool>,
    was_cut: Cell<bool>,
    /// Ms that it takes to set the line up.
    pub configures: Cell<u64>,
    /// Who looks at the line.
    pub observer: Cell<Option<&'static dyn Observer>>,
    pub log: RefCell<Vec<Event>>,
    peer: RefCell<Option<Peer>>,
    receiver: RefCell<Vec<Waker>>,
    user: RefCell<Vec<Waker>>,
}

/// Its wire is leaked: it lives as long as the test. The board may have other lines beside it, or not.
pub struct TestLine<const HAS_NEIGHBOURS: bool = true>(pub &'static Wire);

fn wake(place: &RefCell<Vec<Waker>>) {
    for waker in place.take() {
        waker.wake();
    }
}

impl Wire {
    pub fn new(config: LineConfig) -> &'static Wire {
        Box::leak(Box::new(Wire {
            now: Cell::new(0),
            config: Cell::new(config),
            coming: RefCell::default(),
            come: RefCell::default(),
            lent: Cell::new(None),
            verdict: Cell::new(None),
            settles: Cell::new(None),
            sending: RefCell::default(),
            released: Cell::new(0),
            loses: Cell::new(None),
            lost: Cell::new(false),
            was_cut: Cell::new(false),
            configures: Cell::new(0),
            observer: Cell::new(None),
            log: RefCell::default(),
            peer: RefCell::default(),
            receiver: RefCell::default(),
            user: RefCell::default(),
        }))
    }

    /// What the peer does when a frame is over: ms later, what.
    pub fn answered_by(&self, peer: impl FnMut(&[u8]) -> Vec<(u64, Heard)> + 'static) {
        *self.peer.borrow_mut() = Some(Box::new(peer));
    }

    /// Somebody's frame is over now.
    pub fn hear(&self, heard: Heard) {
        self.coming.borrow_mut().push((self.now.get(), heard));
    }

    /// Frames that went out.
    pub fn sent(&self) -> Vec<Vec<u8>> {
        let log = self.log.borrow();
        log.iter()
            .filter_map(|event| match event {
                Event::Sent(bytes, _) => Some(bytes.clone()),
                Event::Configured(_) => None,
            })
            .collect()
    }

    fn start(&self) {
        let len = usize::from(self.released.take());
        let adu = self.lent.get().expect("lent");
        // SAFETY: leaked, and not changed after it was released.
        let bytes = unsafe { &*adu }[..len].to_vec();
        *self.sending.borrow_mut() = Some((self.now.get(), bytes));
    }

    fn tick(&self) {
        let now = self.now.get() + 1;
        self.now.set(now);
        if self.settles.get().is_some_and(|when| when <= now) {
            self.settles.set(None);
            self.verdict.set(Some(true));
            if self.released.get() > 0 {
                self.start();
            }
            wake(&self.user);
        }
        let over = |sending: &mut (u64, Vec<u8>)| sending.0 + SENDS <= now;
        let sent = self.sending.borrow_mut().take_if(over);
        if let Some((_, bytes)) = sent {
            if let Some(peer) = &mut *self.peer.borrow_mut() {
                let answers = peer(&bytes).into_iter();
                let mut coming = self.coming.borrow_mut();
                coming.extend(answers.map(|(delay, heard)| (now + delay, heard)));
            }
            self.log
                .borrow_mut()
                .push(Event::Sent(bytes, self.config.get()));
            wake(&self.user);
        }
        let mut coming = self.coming.borrow_mut();
        coming.sort_by_key(|(when, _)| *when);
        while coming.first().is_some_and(|(when, _)| *when <= now) {
            let (_, heard) = coming.remove(0);
            self.come.borrow_mut().push_back(heard);
            wake(&self.receiver);
        }
        if self.configures.get() > 0 {
            wake(&self.user);
        }
    }
}

// SAFETY: what is lent is leaked, and lent once.
unsafe impl<const HAS_NEIGHBOURS: bool> Lend for TestLine<HAS_NEIGHBOURS> {
    fn poll_received(&self, context: &mut Context<'_>, _: Key) -> Poll<Result<u8, ReceiveErrors>> {
        self.0.receiver.borrow_mut().push(context.waker().clone());
        let bytes = match self.0.come.borrow_mut().pop_front() {
            None => return Poll::Pending,
            Some(Err(errors)) => return Poll::Ready(Err(errors)),
            Some(Ok(bytes)) => bytes,
        };
        let adu = Box::leak(Box::new([0xEE; 256]));
        adu[..bytes.len()].copy_from_slice(&bytes);
        assert_eq!(self.0.lent.replace(Some(adu)), None, "heard while lent");
        self.0.verdict.set(None);
        self.0.settles.set(Some(self.0.now.get() + SETTLES));
        Poll::Ready(Ok(bytes.len() as u8))
    }

    fn poll_lent(&self, context: &mut Context<'_>, _: Key) -> Poll<()> {
        self.0.user.borrow_mut().push(context.waker().clone());
        if self.0.lent.get().is_some() || self.0.settles.get().is_some() {
            return Poll::Pending;
        }
        let adu = Box::leak(Box::new([0xEE; 256]));
        self.0.lent.set(Some(adu));
        self.0.verdict.set(Some(true));
        Poll::Ready(())
    }

    fn buffer(&self, _: Key) -> NonNull<Adu> {
        NonNull::new(self.0.lent.get().expect("lent")).expect("leaked")
    }

    fn release(&self, len: u8, _: Key) {
        assert!((1..=254).contains(&len), "length {len}");
        if let Some(was_cut) = self.0.loses.take() {
            self.0.lost.set(true);
            self.0.was_cut.set(was_cut);
            return;
        }
        self.0.released.set(len);
        if self.0.verdict.get() == Some(true) {
            self.0.start();
        }
    }

    fn poll_settled(&self, context: &mut Context<'_>, _: Key) -> Poll<bool> {
        self.0.user.borrow_mut().push(context.waker().clone());
        self.0.verdict.get().map_or(Poll::Pending, Poll::Ready)
    }

    fn poll_sent(&self, context: &mut Context<'_>, _: Key) -> Poll<bool> {
        if self.0.lost.take() {
            return Poll::Ready(false);
        }
        self.0.user.borrow_mut().push(context.waker().clone());
        match self.0.released.get() > 0 || self.0.sending.borrow().is_some() {
            true => Poll::Pending,
            false => Poll::Ready(true),
        }
    }

    fn give_back(&self, _: Key) {
        let was_lent = self.0.lent.take().is_some();
        let is_cut = self.0.sending.take().is_some();
        // A test that fails elsewhere drops what is under way.
        if !std::thread::panicking() {
            assert!(was_lent, "given back twice");
            assert!(!is_cut, "cut off");
        }
        self.0.released.set(0);
        wake(&self.0.user);
    }
}

impl<const HAS_NEIGHBOURS: bool> Line for TestLine<HAS_NEIGHBOURS> {
    const HAS_NEIGHBOURS: bool = HAS_NEIGHBOURS;

    async fn quiet(&self) -> ReceiveErrors {
        ReceiveErrors::NONE
    }

    fn check(&self, config: &LineConfig) -> Result<(), LineError> {
        if config.framing == Framing::Rtu && config.format.data_bits() == 7 {
            Err(LineError::Format(config.format))
        } else if config.flow != Flow::None {
            Err(LineError::Flow)
        } else if config.baud > 1_000_000 {
            Err(LineError::Baud { nearest: 1_000_000 })
        } else {
            Ok(())
        }
    }

    async fn configure(&self, config: LineConfig) -> Result<(), LineError> {
        self.check(&config)?;
        let until = self.0.now.get() + self.0.configures.get();
        poll_fn(|context| {
            self.0.user.borrow_mut().push(context.waker().clone());
            if self.0.now.get() >= until {
                Poll::Ready(())
            } else {
                Poll::Pending
            }
        })
        .await;
        assert!(self.0.sending.borrow().is_none(), "set up while it talks");
        assert!(self.0.lent.get().is_none(), "set up under a frame");
        self.0.config.set(config);
        self.0.log.borrow_mut().push(Event::Configured(config));
        Ok(())
    }

    fn set_delimiter(&self, _: u8) {}

    fn show(&self, seen: Result<&[u8], ReceiveErrors>) {
        if let Some(observer) = self.0.observer.get() {
            observer.hear(seen);
        }
    }

    fn was_cut(&self) -> bool {
        self.0.was_cut.get()
    }
}

struct Flag(AtomicBool);

impl Wake for Flag {
    fn wake(self: Arc<Self>) {
        self.0.store(true, Ordering::Relaxed);
    }
}

struct Task<'a> {
    future: Option<Pin<Box<dyn Future<Output = ()> + 'a>>>,
    flag: Arc<Flag>,
}

impl Task<'_> {
    /// Polls it if it is awake; whether it was.
    fn poll(&mut self) -> bool {
        let Some(future) = &mut self.future else {
            return false;
        };
        if !self.flag.0.swap(false, Ordering::Relaxed) {
            return false;
        }
        let waker = Waker::from(self.flag.clone());
        let mut context = Context::from_waker(&waker);
        if future.as_mut().poll(&mut context).is_ready() {
            self.future = None;
        }
        true
    }
}

/// The tasks of a test, and its time.
pub struct Bench<'a> {
    wires: Vec<&'static Wire>,
    tasks: Vec<Task<'a>>,
    _time: MutexGuard<'static, ()>,
}

/// There is one time for all tests of a binary.
static TIME: Mutex<()> = Mutex::new(());

impl<'a> Bench<'a> {
    pub fn new() -> Self {
        let time = TIME.lock().unwrap_or_else(PoisonError::into_inner);
        MockDriver::get().reset();
        Self {
            wires: Vec::new(),
            tasks: Vec::new(),
            _time: time,
        }
    }

    pub fn wire(&mut self, wire: &'static Wire) {
        self.wires.push(wire);
    }

    pub fn spawn(&mut self, future: impl Future<Output = ()> + 'a) -> usize {
        self.tasks.push(Task {
            future: Some(Box::pin(future)),
            flag: Arc::new(Flag(AtomicBool::new(true))),
        });
        self.tasks.len() - 1
    }

    /// Runs a future beside the rest; what it gives will be there.
    pub fn ask<R: 'a>(&mut self, future: impl Future<Output = R> + 'a) -> Rc<RefCell<Option<R>>> {
        let result = Rc::new(RefCell::new(None));
        let place = result.clone();
        self.spawn(async move {
            let value = future.await;
            *place.borrow_mut() = Some(value);
        });
        self.poll();
        result
    }

    /// Polls what is awake until all sleep.
    pub fn poll(&mut self) {
        let mut polls = 0;
        while self.tasks.iter_mut().any(Task::poll) {
            polls += 1;
            assert!(polls < 10_000, "never sleeps");
        }
    }

    /// Lets so many ms pass, in each of which every task that is awake is polled some times, whether it ever sleeps or not.
    pub fn run_restless(&mut self, ms: u64) {
        for _ in 0..ms {
            for wire in &self.wires {
                wire.tick();
            }
            MockDriver::get().advance(Duration::from_millis(1));
            for _ in 0..10 {
                for task in &mut self.tasks {
                    task.poll();
                }
            }
        }
    }

    /// Lets so many ms pass.
    pub fn run(&mut self, ms: u64) {
        self.poll();
        for _ in 0..ms {
            for wire in &self.wires {
                wire.tick();
            }
            MockDriver::get().advance(Duration::from_millis(1));
            self.poll();
        }
    }
}
