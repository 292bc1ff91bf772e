//! QEMU's `olimex-stm32-h405`. It has the USARTs, EXTI, SysTick and counting timers; it has no PLL, no compare
//! channels, no pins, and no time in its USARTs. In their place:
//!
//! - TIM5 counts as on the chip. SysTick is set to the nearest of the ports' alarms and that of `embassy-time`,
//!   whose clock TIM2 is.
//! - A character is sent as soon as it is written. Here its time passes before the transmitter is called
//!   ready or done: the port's alarm, which is not needed while it sends, tells.

use core::cell::RefCell;
use core::task::Waker;

use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::exception;
use critical_section::Mutex;
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::pac::{self, TIM2, TIM5};
use embassy_time_queue_utils::Queue;

use crate::TICK_HZ;
use crate::ports::{PORTS, WIRING};
use crate::usart;
use crate::usart::registers::Registers;
use crate::usart::settings::Settings;

/// QEMU's timers count at 1 GHz.
const TIMER_HZ: u32 = 1_000_000_000;
const _: () = assert!(TIMER_HZ.is_multiple_of(TICK_HZ));

/// QEMU's CPU clock, which SysTick counts: 84 of its ticks are 25 of TIM5's.
const CPU_TICKS: u32 = 84;
const LINE_TICKS: u32 = 25;
const _: () = assert!(168_000_000 / CPU_TICKS == TICK_HZ / LINE_TICKS);

/// The farthest that SysTick is set, in ticks of TIM5: it has 24 bits. It is looked at again then.
const FARTHEST: u32 = 4_000_000;

/// What the alarms know.
struct Alarms {
    ports: [Alarm; PORTS],
    time: Time,
    /// When SysTick goes off.
    next: u32,
}

/// The alarm of a port.
#[derive(Clone, Copy)]
struct Alarm {
    at: u32,
    on: bool,
    /// It has not gone off since it was set.
    armed: bool,
    transmitter: Transmitter,
}

/// A transmitter as silicon has it: a data register before a shift register.
#[derive(Clone, Copy)]
struct Transmitter {
    /// When the first of the characters was written that have followed each other without a gap.
    since: u32,
    /// How many these are, 0 if none is under way.
    characters: u32,
    /// Clock cycles of one.
    cycles: u32,
    clock_hz: u32,
}

impl Transmitter {
    const IDLE: Self = Self {
        since: 0,
        characters: 0,
        cycles: 0,
        clock_hz: 1,
    };

    /// When this many characters have left.
    fn end_of(&self, characters: u32) -> u32 {
        let cycles = u64::from(characters * self.cycles);
        let ticks = (cycles * u64::from(TICK_HZ)).div_ceil(self.clock_hz.into());
        self.since.wrapping_add(ticks as u32)
    }

    /// When the data register is empty: with the last character in the shift register.
    fn ready_at(&self) -> u32 {
        self.end_of(self.characters.saturating_sub(1))
    }

    /// When all has left.
    fn sent_at(&self) -> u32 {
        self.end_of(self.characters)
    }
}

/// The clock of `embassy-time`.
struct Time {
    /// TIM2 when it was last read, and how often it has gone round.
    count: u32,
    turns: u32,
    queue: Queue,
    /// When the queue wants to be looked at, in ticks of TIM5.
    at: Option<u32>,
}

static ALARMS: Mutex<RefCell<Alarms>> = Mutex::new(RefCell::new(Alarms {
    ports: [Alarm {
        at: 0,
        on: false,
        armed: false,
        transmitter: Transmitter::IDLE,
    }; PORTS],
    time: Time {
        count: 0,
        turns: 0,
        queue: Queue::new(),
        at: None,
    },
    next: 0,
}));

fn with_alarms<R>(f: impl FnOnce(&mut Alarms) -> R) -> R {
    critical_section::with(|cs| f(&mut ALARMS.borrow_ref_mut(cs)))
}

/// Timers and interrupts.
pub(crate) fn init() {
    pac::RCC.apb1enr().modify(|w| {
        w.set_tim2en(true);
        w.set_tim5en(true);
    });
    for (timer, hz) in [(TIM5, TICK_HZ), (TIM2, embassy_time::TICK_HZ as u32)] {
        timer.arr().write(|w| *w = u32::MAX);
        timer.psc().write_value((TIMER_HZ / hz - 1) as u16);
        timer.egr().write(|w| w.set_ug(true));
        timer.cr1().write(|w| w.set_cen(true));
    }
    for interrupt in usart::INTERRUPTS {
        // SAFETY: each has its handler in this crate.
        unsafe { interrupt.enable() };
    }
    with_alarms(|alarms| alarms.set_timer());
}

/// The present tick.
#[inline(always)]
pub(crate) fn now() -> u32 {
    TIM5.cnt().read()
}

/// How long it is from `now` until `at`; 0 if that has passed.
fn until(at: u32, now: u32) -> u32 {
    let left = at.wrapping_sub(now);
    if left as i32 > 0 { left } else { 0 }
}

/// Sets the alarm of `port`; one that is on goes off then, at once if `at` has passed.
pub(crate) fn set_alarm(port: usize, at: u32) {
    with_alarms(|alarms| alarms.set(port, at));
}

/// Lets the alarm of `port` go off.
pub(crate) fn alarm_on(port: usize) {
    with_alarms(|alarms| {
        alarms.ports[port].on = true;
        alarms.hasten(alarms.ports[port].at);
    });
}

/// No alarm of `port` until the next [`alarm_on`].
pub(crate) fn alarm_off(port: usize) {
    with_alarms(|alarms| alarms.ports[port].on = false);
}

impl Alarms {
    fn set(&mut self, port: usize, at: u32) {
        self.ports[port].at = at;
        self.ports[port].armed = true;
        if self.ports[port].on {
            self.hasten(at);
        }
    }

    /// Sets SysTick anew if it would come too late for `at`. Coming too early does no harm.
    fn hasten(&mut self, at: u32) {
        if (self.next.wrapping_sub(at) as i32) > 0 {
            self.set_timer();
        }
    }

    /// Sets SysTick to the nearest alarm. It counts RVR + 1 cycles (ARMv7-M B3.3.1).
    fn set_timer(&mut self) {
        let now = now();
        let mut left = FARTHEST;
        for alarm in &self.ports {
            if alarm.on && alarm.armed {
                left = left.min(until(alarm.at, now));
            }
        }
        if let Some(at) = self.time.at {
            left = left.min(until(at, now));
        }
        self.next = now.wrapping_add(left);
        // SAFETY: SysTick is this module's.
        let mut systick = unsafe { cortex_m::Peripherals::steal() }.SYST;
        systick.disable_counter();
        systick.set_reload((left * CPU_TICKS / LINE_TICKS).max(1));
        systick.clear_current();
        systick.set_clock_source(SystClkSource::Core);
        systick.enable_interrupt();
        systick.enable_counter();
    }

    /// A port whose alarm is due, which it is no more after this.
    fn take_due(&mut self) -> Option<usize> {
        let now = now();
        let due = |alarm: &Alarm| alarm.on && alarm.armed && until(alarm.at, now) == 0;
        let port = self.ports.iter().position(due)?;
        self.ports[port].armed = false;
        Some(port)
    }
}

#[exception]
fn SysTick() {
    while let Some(port) = with_alarms(Alarms::take_due) {
        usart::on_alarm(port);
    }
    with_alarms(|alarms| {
        alarms.time.look();
        alarms.set_timer();
    });
}

impl Time {
    fn now(&mut self) -> u64 {
        let count = TIM2.cnt().read();
        if count < self.count {
            self.turns += 1;
        }
        self.count = count;
        u64::from(self.turns) << 32 | u64::from(count)
    }

    /// Wakes what is due.
    fn look(&mut self) {
        const RATIO: u32 = TICK_HZ / embassy_time::TICK_HZ as u32;
        let now = self.now();
        self.at = match self.queue.next_expiration(now) {
            u64::MAX => None,
            at => {
                let left = at.saturating_sub(now).min((FARTHEST / RATIO).into()) as u32;
                Some(self::now().wrapping_add(left * RATIO))
            }
        };
    }
}

struct Driver;

impl embassy_time_driver::Driver for Driver {
    fn now(&self) -> u64 {
        with_alarms(|alarms| alarms.time.now())
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        with_alarms(|alarms| {
            if alarms.time.queue.schedule_wake(at, waker) {
                alarms.time.look();
                alarms.set_timer();
            }
        });
    }
}

embassy_time_driver::time_driver_impl!(static DRIVER: Driver = Driver);

/// A character was handed to the transmitter.
pub(crate) fn on_put(port: usize, settings: &Settings) {
    with_alarms(|alarms| {
        let transmitter = &mut alarms.ports[port].transmitter;
        let now = now();
        if transmitter.characters == 0 || until(transmitter.sent_at(), now) == 0 {
            *transmitter = Transmitter {
                since: now,
                characters: 0,
                cycles: settings.character_cycles,
                clock_hz: WIRING[port].clock_hz,
            };
        }
        transmitter.characters += 1;
    });
}

/// Has [`usart::on_alarm`] called as soon as the transmitter takes another character.
pub(crate) fn await_ready(port: usize, registers: &Registers, settings: &Settings) {
    registers.send(settings, 0);
    with_alarms(|alarms| alarms.set(port, alarms.ports[port].transmitter.ready_at()));
    alarm_on(port);
}

/// Has it called as soon as the last character has left, stop bits included.
pub(crate) fn await_sent(port: usize, registers: &Registers, settings: &Settings) {
    registers.send(settings, 0);
    with_alarms(|alarms| alarms.set(port, alarms.ports[port].transmitter.sent_at()));
    alarm_on(port);
}

/// Whether the transmitter takes another character.
pub(crate) fn is_ready(port: usize, _registers: &Registers) -> bool {
    with_alarms(|alarms| until(alarms.ports[port].transmitter.ready_at(), now()) == 0)
}

/// Whether all has left.
pub(crate) fn is_sent(port: usize, _registers: &Registers) -> bool {
    with_alarms(|alarms| {
        let transmitter = &mut alarms.ports[port].transmitter;
        let is_sent = until(transmitter.sent_at(), now()) == 0;
        if is_sent {
            *transmitter = Transmitter::IDLE;
        }
        is_sent
    })
}
