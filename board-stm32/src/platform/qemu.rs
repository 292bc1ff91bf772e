//! QEMU's `olimex-stm32-h405`. It has the USARTs, EXTI, SysTick and counting timers, but no PLL, no compare channels and no pins.
//! TIM5 counts as on the chip. In place of its channels SysTick is set to the nearest alarm, of the ports or of `embassy-time`. The
//! clock of `embassy-time` is TIM2.
//!
//! QEMU's USARTs have no time either: the simulated bus sets TXE and TC as silicon does.

use core::arch::asm;
use core::cell::{RefCell, UnsafeCell};
use core::sync::atomic::{AtomicBool, Ordering};
use core::task::Waker;

use cortex_m::peripheral::SYST;
use cortex_m::peripheral::scb::SystemHandler;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::exception;
use critical_section::Mutex;
use embassy_executor::{Spawner, raw};
use embassy_stm32::Peripherals;
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::pac::{self, TIM2, TIM5};
use embassy_time_queue_utils::Queue;
use static_cell::StaticCell;

use super::{ALARMS as PRIORITY, CHARACTERS, group_priorities};
use crate::TICK_HZ;
use crate::ports::PORTS;
use crate::usart;

/// QEMU's timers count at 1 GHz.
const TIMER_HZ: u32 = 1_000_000_000;
const _: () = assert!(TIMER_HZ.is_multiple_of(TICK_HZ));

/// QEMU's CPU clock, which SysTick counts: 84 of its ticks are 25 of TIM5's.
const CPU_TICKS: u32 = 84;
const LINE_TICKS: u32 = 25;
const _: () = assert!(168_000_000 / CPU_TICKS == TICK_HZ / LINE_TICKS);

/// The farthest that SysTick is set, in ticks of TIM5: SysTick has 24 bits. The alarms are checked again then.
const FARTHEST: u32 = 4_000_000;

/// The place of the alarm of `embassy-time`, after those of the ports.
const TIME: usize = PORTS;

/// All alarms and their ticks. Bit `n` of the masks is the alarm `at[n]`.
struct Alarms {
    at: [u32; PORTS + 1],
    on: u32,
    /// The alarms that have not gone off since they were set.
    armed: u32,
    /// The tick at which SysTick goes off.
    next: u32,
}

/// The cell of [`Alarms`], for interrupts of the line, which do not nest, and for code with interrupts off.
struct AlarmsCell(UnsafeCell<Alarms>);

// SAFETY: interrupts of the line use it, which do not nest, and code with interrupts off.
unsafe impl Sync for AlarmsCell {}

static ALARMS: AlarmsCell = AlarmsCell(UnsafeCell::new(Alarms {
    at: [0; PORTS + 1],
    on: 1 << TIME,
    armed: 0,
    next: 0,
}));

/// Gives the one [`Alarms`] of the board.
#[inline(always)]
fn alarms() -> &'static mut Alarms {
    // SAFETY: callers are interrupts of the line or have interrupts off, and keep the reference for a statement only.
    unsafe { &mut *ALARMS.0.get() }
}

/// Starts timers and interrupts. To be called once.
pub(crate) fn init() -> Peripherals {
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
    group_priorities();
    for interrupt in usart::INTERRUPTS {
        interrupt.set_priority(CHARACTERS);
        // SAFETY: each interrupt has its handler in this crate.
        unsafe { interrupt.enable() };
    }
    critical_section::with(|_| {
        // SAFETY: SysTick is this module's.
        let mut core = unsafe { cortex_m::Peripherals::steal() };
        // SAFETY: interrupts are off.
        unsafe {
            core.SCB
                .set_priority(SystemHandler::SysTick, PRIORITY.into())
        };
        let mut systick = core.SYST;
        systick.set_clock_source(SystClkSource::Core);
        alarms().set_timer();
        systick.enable_interrupt();
        systick.enable_counter();
    });
    // SAFETY: no other code has the peripherals: `embassy_stm32::init` is not called here, and this is called once.
    unsafe { Peripherals::steal() }
}

/// The source of the clocks: QEMU has no oscillators.
#[inline(always)]
pub(crate) const fn clock() -> crate::Clock {
    crate::Clock::Crystal
}

/// The present tick.
#[inline(always)]
pub(crate) fn now() -> u32 {
    TIM5.cnt().read()
}

/// The ticks from `now` until `at`; 0 if `at` has passed.
#[inline(always)]
fn until(at: u32, now: u32) -> u32 {
    let left = at.wrapping_sub(now);
    if left as i32 > 0 { left } else { 0 }
}

/// Sets the alarm of `port` to tick `at`. An enabled alarm goes off then, or at once if `at` has passed.
#[inline(always)]
pub(crate) fn set_alarm(port: usize, at: u32) {
    alarms().set(port, at);
}

/// Enables the alarm of `port`.
#[inline(always)]
pub(crate) fn alarm_on(port: usize) {
    let alarms = alarms();
    alarms.on |= 1 << port;
    alarms.hasten(port);
}

/// Disables the alarm of `port` until the next [`alarm_on`].
#[inline(always)]
pub(crate) fn alarm_off(port: usize) {
    alarms().on &= !(1 << port);
}

impl Alarms {
    #[inline(always)]
    fn set(&mut self, alarm: usize, at: u32) {
        self.at[alarm] = at;
        self.armed |= 1 << alarm;
        self.hasten(alarm);
    }

    /// Sets SysTick anew if it would come too late. Coming too early does no harm.
    #[inline(always)]
    fn hasten(&mut self, alarm: usize) {
        let is_late = (self.next.wrapping_sub(self.at[alarm]) as i32) > 0;
        if is_late && self.on & 1 << alarm != 0 {
            self.set_timer();
        }
    }

    /// Sets SysTick to the nearest alarm.
    #[inline(never)]
    fn set_timer(&mut self) {
        let now = now();
        let (_, left) = self.nearest(now);
        self.start_timer(now, left);
    }

    /// Sets SysTick to `left` ticks from `now`. SysTick counts RVR + 1 cycles, from the write of CVR (ARMv7-M B3.3.1).
    #[inline(always)]
    fn start_timer(&mut self, now: u32, left: u32) {
        self.next = now.wrapping_add(left);
        // SAFETY: SysTick is this module's.
        let systick = unsafe { &*SYST::PTR };
        // SAFETY: any value of 24 bits but 0 is valid.
        unsafe {
            systick.rvr.write((left * CPU_TICKS / LINE_TICKS).max(1));
            systick.cvr.write(0);
        }
    }

    /// The alarm that goes off first, of those that are on and have not gone off, with the ticks until then: 0 if the alarm is due,
    /// [`FARTHEST`] if no alarm is due before.
    #[inline(always)]
    fn nearest(&self, now: u32) -> (usize, u32) {
        let mut nearest = (TIME, FARTHEST);
        let mut pending = self.on & self.armed;
        while pending != 0 {
            let alarm = pending.trailing_zeros() as usize;
            pending &= pending - 1;
            let left = until(self.at[alarm], now);
            if left < nearest.1 {
                nearest = (alarm, left);
            }
        }
        nearest
    }
}

#[exception]
fn SysTick() {
    let now = now();
    let (alarm, left) = alarms().nearest(now);
    if left > 0 {
        // The alarm was put off meanwhile.
        return alarms().start_timer(now, left);
    }
    alarms().armed &= !(1 << alarm);
    // The code below sees an alarm that is set meanwhile.
    alarms().next = now;
    // One alarm at a time: characters come between. SysTick interrupts again for the other alarms.
    if alarm == TIME {
        critical_section::with(|cs| CLOCK.borrow_ref_mut(cs).look());
    } else {
        usart::on_alarm(alarm);
    }
    alarms().set_timer();
}

/// The clock of `embassy-time`.
struct Clock {
    /// The last count of TIM2, and how often TIM2 has gone round.
    count: u32,
    turns: u32,
    queue: Queue,
}

static CLOCK: Mutex<RefCell<Clock>> = Mutex::new(RefCell::new(Clock {
    count: 0,
    turns: 0,
    queue: Queue::new(),
}));

impl Clock {
    fn now(&mut self) -> u64 {
        let count = TIM2.cnt().read();
        if count < self.count {
            self.turns += 1;
        }
        self.count = count;
        u64::from(self.turns) << 32 | u64::from(count)
    }

    /// Wakes the tasks that are due and sets the alarm for the next one. Runs also once within each turn of TIM2.
    fn look(&mut self) {
        const RATIO: u32 = TICK_HZ / embassy_time::TICK_HZ as u32;
        let now = self.now();
        let left = self.queue.next_expiration(now).saturating_sub(now);
        let left = left.min(u64::from(i32::MAX as u32 / RATIO)) as u32;
        alarms().set(TIME, self::now().wrapping_add(left * RATIO));
    }
}

/// For tests: lets TIM2 wrap after this number of us. Call it before tasks run.
pub(crate) fn wrap_time_in(us: u32) {
    TIM2.cnt().write(|w| *w = us.wrapping_neg());
}

/// For tests: lets TIM5 wrap after this number of us. Call it while no port has an alarm on.
pub(crate) fn wrap_line_timer_in(us: u32) {
    critical_section::with(|cs| {
        TIM5.cnt()
            .write(|w| *w = (us * (TICK_HZ / 1_000_000)).wrapping_neg());
        // The alarm of `embassy-time` is one of TIM5's.
        CLOCK.borrow_ref_mut(cs).look();
        alarms().set_timer();
    });
}

struct Driver;

impl embassy_time_driver::Driver for Driver {
    fn now(&self) -> u64 {
        critical_section::with(|cs| CLOCK.borrow_ref_mut(cs).now())
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|cs| {
            let mut clock = CLOCK.borrow_ref_mut(cs);
            if clock.queue.schedule_wake(at, waker) {
                clock.look();
            }
        });
    }
}

embassy_time_driver::time_driver_impl!(static DRIVER: Driver = Driver);

/// Whether a task is in the queue.
static WORK: AtomicBool = AtomicBool::new(false);

#[unsafe(export_name = "__pender")]
fn pender(_context: *mut ()) {
    WORK.store(true, Ordering::Relaxed);
}

/// Runs tasks for ever. Between them the CPU does nothing, but it does not sleep: for a sleeping CPU no time would pass.
pub(crate) fn run(init: impl FnOnce(Spawner)) -> ! {
    static EXECUTOR: StaticCell<raw::Executor> = StaticCell::new();
    let executor: &'static raw::Executor = EXECUTOR.init(raw::Executor::new(core::ptr::null_mut()));
    init(executor.spawner());
    loop {
        WORK.store(false, Ordering::Relaxed);
        // SAFETY: called from this one place, never from within itself.
        unsafe { executor.poll() };
        idle();
    }
}

/// Waits for work. A simulator tells these instructions from working ones by the symbol of this function. A run of
/// instructions that do nothing costs the simulator next to nothing. The run is as long as an interrupt may have to wait, 32 x
/// 8 ns.
#[inline(never)]
#[unsafe(export_name = "multidrop_idle")]
fn idle() {
    while !WORK.load(Ordering::Relaxed) {
        // SAFETY: the instructions change nothing.
        unsafe {
            asm!(
                ".rept 32",
                "nop",
                ".endr",
                options(nomem, nostack, preserves_flags)
            )
        };
    }
}
