//! The roll on the host: the last signature feeds the watchdog, and no earlier one.

use std::future::{pending, ready};
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::task::{Context, Poll, Wake, Waker};

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use multidrop::roll::Watchdog;
use multidrop::{Roll, signed};

/// A task that counts how often it is woken.
#[derive(Default)]
struct Task(AtomicU32);

impl Wake for Task {
    fn wake(self: Arc<Self>) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

impl Task {
    fn woken(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }
}

/// A watchdog for one test each: what is static there is the test's own.
macro_rules! dog {
    ($dog:ident, $is_on:expr, $fed:ident, $lives:ident) => {
        static $fed: AtomicU32 = AtomicU32::new(0);
        static $lives: AtomicBool = AtomicBool::new(true);

        struct $dog;

        impl Watchdog for $dog {
            const IS_ON: bool = $is_on;

            type Lock = CriticalSectionRawMutex;
            type Task = &'static Waker;

            fn task(waker: &Waker) -> Self::Task {
                Box::leak(Box::new(waker.clone()))
            }

            fn wake(task: Self::Task) {
                task.wake_by_ref();
            }

            fn is_healthy() -> bool {
                $lives.load(Ordering::Relaxed)
            }

            fn feed() {
                $fed.fetch_add(1, Ordering::Relaxed);
            }
        }
    };
}

#[test]
fn only_the_last_signature_feeds() {
    dog!(Dog, true, FED, LIVES);
    static ROLL: Roll<Dog, 3> = Roll::new();
    let fed = || FED.load(Ordering::Relaxed);
    let tasks = [0; 3].map(|_| Arc::new(Task::default()));
    let wakers = tasks.each_ref().map(|task| Waker::from(Arc::clone(task)));
    for round in 0..3 {
        ROLL.sign::<0>(&wakers[0]);
        ROLL.sign::<2>(&wakers[2]);
        // One that is polled again does not sign for another.
        ROLL.sign::<0>(&wakers[0]);
        assert_eq!(fed(), round);
        ROLL.sign::<1>(&wakers[1]);
        assert_eq!(fed(), round + 1);
        ROLL.sign::<1>(&wakers[1]);
        assert_eq!(fed(), round + 1);
        ROLL.call();
        assert!(tasks.iter().all(|task| task.woken() == round + 1));
    }
    // Whoever has not signed is not woken, and holds the feeding back over any number of calls.
    ROLL.sign::<0>(&wakers[0]);
    ROLL.call();
    ROLL.sign::<0>(&wakers[0]);
    ROLL.sign::<2>(&wakers[2]);
    ROLL.call();
    assert_eq!(tasks.each_ref().map(|task| task.woken()), [5, 3, 4]);
    assert_eq!(fed(), 3);
}

#[test]
fn the_roll_is_not_called_while_the_board_is_unhealthy() {
    dog!(Dog, true, FED, LIVES);
    static ROLL: Roll<Dog, 1> = Roll::new();
    let task = Arc::new(Task::default());
    let waker = Waker::from(Arc::clone(&task));
    ROLL.sign::<0>(&waker);
    LIVES.store(false, Ordering::Relaxed);
    ROLL.call();
    ROLL.sign::<0>(&waker);
    assert_eq!((task.woken(), FED.load(Ordering::Relaxed)), (0, 1));
    LIVES.store(true, Ordering::Relaxed);
    ROLL.call();
    ROLL.sign::<0>(&waker);
    assert_eq!((task.woken(), FED.load(Ordering::Relaxed)), (1, 2));
}

#[test]
fn an_empty_roll_feeds_the_watchdog_when_called() {
    dog!(Dog, true, FED, LIVES);
    static ROLL: Roll<Dog, 0> = Roll::new();
    ROLL.call();
    ROLL.call();
    assert_eq!(FED.load(Ordering::Relaxed), 2);
    assert!(LIVES.load(Ordering::Relaxed));
}

#[test]
fn a_task_signs_when_it_is_polled_and_its_future_goes_on() {
    dog!(Dog, true, FED, LIVES);
    static ROLL: Roll<Dog, 1> = Roll::new();
    let mut context = Context::from_waker(Waker::noop());
    let mut waits = pin!(signed(|task| ROLL.sign::<0>(task), pending::<()>()));
    for round in 1..=3 {
        assert_eq!(waits.as_mut().poll(&mut context), Poll::Pending);
        assert_eq!(FED.load(Ordering::Relaxed), round);
        ROLL.call();
    }
    let ends = pin!(signed(|task| ROLL.sign::<0>(task), ready(7)));
    assert_eq!(ends.poll(&mut context), Poll::Ready(7));
    assert!(LIVES.load(Ordering::Relaxed));
}

#[test]
fn a_roll_without_watchdog_never_feeds() {
    dog!(Dog, false, FED, LIVES);
    static ROLL: Roll<Dog, 1> = Roll::new();
    ROLL.sign::<0>(Waker::noop());
    assert_eq!(FED.load(Ordering::Relaxed), 0);
    assert!(LIVES.load(Ordering::Relaxed));
}
