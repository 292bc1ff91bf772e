//! The independent watchdog (RM0090 21), fed by a [roll](multidrop::roll) of tasks.
//!
//! Its clock is LSI, an oscillator of 17 to 47 kHz (DS, LSI oscillator characteristics). A time in ms is nominal, for 32 kHz: it
//! may be shorter by a third or longer by nearly as much again. The roll is called three times within the nominal time, so that it
//! is called twice within the shortest. Only a reset stops the watchdog once it runs.
//!
//! A task may keep a frame for the time of the longest frame plus the watchdog's time. After that the watchdog is not
//! fed.

use multidrop::protocol::message::Message;

/// A time that the watchdog can wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Watchdog {
    /// Contents of PR and RLR.
    pr: u8,
    rlr: u16,
    ms: u16,
}

/// The nominal rate of LSI, in kHz.
const LSI_KHZ: u32 = 32;
/// RLR has 12 bits (RM0090 21.4.3).
const COUNTS: u32 = 4096;

impl Watchdog {
    /// The default of two seconds.
    pub const DEFAULT: Self = Self::ms::<2000>();

    /// A nominal time in ms, 32..=32768: any up to 4096, even ones up to 8192, multiples of 4 above, of 8 from 16384 on.
    ///
    /// # Panics
    /// At compile time, for any other value.
    pub const fn ms<const MS: u32>() -> Self {
        const { Self::of(MS) }
    }

    const fn of(ms: u32) -> Self {
        // The divider is 4 shifted by PR (RM0090 21.4.2).
        let mut pr = 0;
        while pr < 6 && ms * LSI_KHZ > COUNTS << (pr + 2) {
            pr += 1;
        }
        let divider = 4 << pr;
        let cycles = ms * LSI_KHZ;
        if ms < 32 || cycles > COUNTS * divider || !cycles.is_multiple_of(divider) {
            Message::new()
                .text("watchdog is ")
                .number(ms)
                .text(" ms, must be 32..=32768; over 4096 ms a multiple of 2, over 8192 of 4, over 16384 of 8")
                .fail()
        }
        Self {
            pr: pr as u8,
            rlr: (cycles / divider - 1) as u16,
            ms: ms as u16,
        }
    }
}

#[cfg(target_arch = "arm")]
pub use running::Dog;
#[cfg(target_arch = "arm")]
pub(crate) use running::{call, start};

/// A roll of `N` tasks that feeds the watchdog.
#[cfg(target_arch = "arm")]
pub type Roll<const N: usize> = multidrop::Roll<Dog, N>;

#[cfg(target_arch = "arm")]
mod running {
    use core::sync::atomic::{AtomicU16, Ordering};
    use core::task::Waker;

    use embassy_executor::raw::{TaskRef, task_from_waker, wake_task};
    use embassy_stm32::pac::IWDG;
    use embassy_stm32::pac::iwdg::{regs::Kr, vals::Key, vals::Pr};
    use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
    use embassy_time::{Duration, Timer};

    use super::Watchdog;
    use crate::usart;

    /// The watchdog's time in ms.
    static TIME_MS: AtomicU16 = AtomicU16::new(0);

    /// How often to check whether PR and RLR are taken over, which takes up to 5 periods of LSI (RM0090 21.4.4): 1 ms of CPU time
    /// and more. Limited, since an LSI that does not run must not keep the board from starting.
    const PATIENCE: u32 = 100_000;

    /// Starts the watchdog. The order is that of later manuals of the same block (RM0390 20.3.2): only the running LSI takes PR and
    /// RLR over.
    pub(crate) fn start(watchdog: Watchdog) {
        TIME_MS.store(watchdog.ms, Ordering::Relaxed);
        IWDG.kr().write_value(key(Key::START));
        IWDG.kr().write_value(key(Key::ENABLE));
        IWDG.pr().write(|w| w.set_pr(Pr::from_bits(watchdog.pr)));
        IWDG.rlr().write(|w| w.set_rl(watchdog.rlr));
        for _ in 0..PATIENCE {
            let status = IWDG.sr().read();
            if !status.pvu() && !status.rvu() {
                break;
            }
        }
        IWDG.kr().write_value(key(Key::RESET));
    }

    /// The value of KR for a key (RM0090 21.4.1).
    fn key(key: Key) -> Kr {
        let mut kr = Kr(0);
        kr.set_key(key);
        kr
    }

    /// The watchdog of the board.
    pub struct Dog;

    /// A task, in half the room of a waker.
    #[derive(Clone, Copy)]
    pub struct Task(TaskRef);

    impl multidrop::roll::Watchdog for Dog {
        const IS_ON: bool = !cfg!(feature = "bare");

        type Lock = CriticalSectionRawMutex;
        type Task = Task;

        fn task(waker: &Waker) -> Task {
            Task(task_from_waker(waker))
        }

        fn wake(task: Task) {
            wake_task(task.0);
        }

        fn is_healthy() -> bool {
            let time_ms = TIME_MS.load(Ordering::Relaxed).into();
            usart::no_frame_is_stuck(period_ms(time_ms), time_ms)
        }

        fn feed() {
            IWDG.kr().write_value(key(Key::RESET));
        }
    }

    /// A roll of any length.
    pub(crate) trait Calls: Sync {
        fn call(&self);
    }

    impl<const N: usize> Calls for super::Roll<N> {
        fn call(&self) {
            Self::call(self);
        }
    }

    /// The period of the roll: two periods are within the shortest time that a nominal one may be, 32/47 of it.
    fn period_ms(time_ms: u32) -> u32 {
        time_ms / 3
    }

    /// Calls the roll for ever.
    #[embassy_executor::task]
    pub(crate) async fn call(roll: &'static dyn Calls) -> ! {
        let time_ms = TIME_MS.load(Ordering::Relaxed).into();
        loop {
            roll.call();
            Timer::after(Duration::from_millis(period_ms(time_ms).into())).await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_worked_by_hand() {
        // RM0090 21.3: at 32 kHz a divider of 4 counts 0.125 ms.
        for (ms, pr, rlr) in [
            (32, 0, 255),
            (512, 0, 4095),
            (513, 1, 2051),
            (2000, 2, 3999),
            (4096, 3, 4095),
            (4098, 4, 2048),
            (32_768, 6, 4095),
        ] {
            let made = Watchdog::of(ms);
            assert_eq!((made.pr, made.rlr), (pr, rlr), "{ms}");
        }
    }

    #[test]
    #[should_panic(
        expected = "watchdog is 4097 ms, must be 32..=32768; over 4096 ms a multiple of 2"
    )]
    fn a_time_between_two_steps_is_refused() {
        Watchdog::of(4097);
    }

    #[test]
    #[should_panic(expected = "watchdog is 32776 ms")]
    fn a_time_beyond_the_counter_is_refused() {
        Watchdog::of(32_776);
    }
}
