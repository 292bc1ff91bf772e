//! The chip: 168 MHz from a crystal of 8 MHz, or else from the chip's own oscillator. TIM5's four compare channels are the alarms.

use core::sync::atomic::{AtomicBool, Ordering};

use embassy_executor::{Executor, Spawner};
use embassy_stm32::Peripherals;
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::pac::{self, TIM5};
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllQDiv, PllSource,
    Sysclk,
};
use embassy_stm32::time::Hertz;
use static_cell::StaticCell;

use super::{ALARMS, CHARACTERS, OTHERS, group_priorities};
use crate::Clock;
use crate::ports::{APB1_HZ, APB2_HZ, PORTS};
use crate::usart;

/// The crystal, in Hz. For another crystal change PREDIV too.
const CRYSTAL_HZ: u32 = 8_000_000;
const PREDIV: PllPreDiv = PllPreDiv::DIV4;

/// The chip's own oscillator, which runs after reset (RM0090 7.2.2), in Hz, and the divider for the PLL's input.
const INTERNAL_HZ: u32 = 16_000_000;
const INTERNAL_PREDIV: PllPreDiv = PllPreDiv::DIV8;
const _: () = assert!(INTERNAL_HZ / INTERNAL_PREDIV.to_bits() as u32 == PLL_IN_HZ);

/// How long the crystal may take to begin to swing, in us; 2 ms are usual (DS, HSE oscillator characteristics).
const CRYSTAL_PATIENCE_US: u32 = 100_000;

/// Whether the build is for a debugger: the debugger then sees a sleeping chip, and timers stop with a halted CPU.
const IS_DEBUG: bool = cfg!(debug_assertions) || cfg!(feature = "defmt");

/// Whether the crystal does not swing, so that the chip's own oscillator is in use.
static IS_INTERNAL: AtomicBool = AtomicBool::new(false);

/// The input of the PLL: 1 to 2 MHz. The manual recommends 2 MHz, with which the output is cleaner (RM0090 7.3.2). The multiplier
/// below is for 2 MHz.
const PLL_IN_HZ: u32 = CRYSTAL_HZ / PREDIV.to_bits() as u32;
const _: () = assert!(
    PLL_IN_HZ == 2_000_000 && CRYSTAL_HZ.is_multiple_of(PLL_IN_HZ),
    "CRYSTAL_HZ divided by PREDIV must be 2 MHz"
);
const CPU_HZ: u32 = PLL_IN_HZ * 168 / 2;
const _: () = assert!(CPU_HZ / 4 == APB1_HZ && CPU_HZ / 4 == APB2_HZ);

/// TIM5 is clocked with twice APB1 (RM0090 7.2), and divided by two.
const PRESCALER: u16 = 2;
const _: () = assert!(2 * APB1_HZ / PRESCALER as u32 == crate::TICK_HZ);

/// CC1 of TIM5's SR, DIER and EGR (RM0090 18.4.4 to 18.4.6). The bits of the other channels follow it.
const CC1: u32 = 1 << 1;

/// Starts clocks, `embassy-time`, the alarms' timer and the interrupts of the line. To be called once.
pub(crate) fn init() -> Peripherals {
    let mut config = embassy_stm32::Config::default();
    let has_crystal = crystal_swings();
    IS_INTERNAL.store(!has_crystal, Ordering::Relaxed);
    let prediv = if has_crystal {
        config.rcc.hse = Some(Hse {
            freq: Hertz(CRYSTAL_HZ),
            mode: HseMode::Oscillator,
        });
        config.rcc.pll_src = PllSource::HSE;
        PREDIV
    } else {
        config.rcc.pll_src = PllSource::HSI;
        INTERNAL_PREDIV
    };
    // 2 MHz * 168 / 2 = 168 MHz; / 7 = 48 MHz, for USB and RNG (RM0090 7.3.2).
    config.rcc.pll = Some(Pll {
        prediv,
        mul: PllMul::MUL168,
        divp: Some(PllPDiv::DIV2),
        divq: Some(PllQDiv::DIV7),
        divr: None,
    });
    config.rcc.sys = Sysclk::PLL1_P;
    config.rcc.ahb_pre = AHBPrescaler::DIV1;
    config.rcc.apb1_pre = APBPrescaler::DIV4;
    config.rcc.apb2_pre = APBPrescaler::DIV4;
    // Otherwise the interrupts of DMA, which an application may use, go before characters.
    config.dma_interrupt_priority = OTHERS;
    config.enable_debug_during_sleep = IS_DEBUG;
    let peripherals = embassy_stm32::init(config);
    if IS_DEBUG {
        // For a halted CPU: otherwise the watchdog would reset it, and alarms would be long past (RM0090 38.16.4).
        pac::DBGMCU.apb1fzr().modify(|w| {
            w.set_iwdg(true);
            w.set_tim2(true);
            w.set_tim5(true);
        });
    }

    // Prefetch and both caches (RM0090 3.9.1), which `init` leaves off: without them an instruction fetch waits for up to five
    // cycles.
    pac::FLASH.acr().modify(|w| {
        w.set_prften(true);
        w.set_icen(true);
        w.set_dcen(true);
    });

    start_timer();

    group_priorities();
    for interrupt in usart::INTERRUPTS {
        enable(interrupt, CHARACTERS);
    }
    enable(interrupt::TIM5, ALARMS);
    interrupt::TIM2.set_priority(OTHERS);
    peripherals
}

/// Returns whether the crystal swings, and switches it off if it does not. TIM5 counts the chip's own oscillator meanwhile, in us,
/// since APB1 is not divided after reset (RM0090 7.2, 7.3.3).
fn crystal_swings() -> bool {
    pac::RCC.apb1enr().modify(|w| w.set_tim5en(true));
    pac::RCC.apb1enr().read();
    TIM5.psc().write_value((INTERNAL_HZ / 1_000_000 - 1) as u16);
    TIM5.arr().write(|w| *w = u32::MAX);
    TIM5.egr().write(|w| w.set_ug(true));
    TIM5.cr1().write(|w| w.set_cen(true));
    let begin = now();
    pac::RCC.cr().modify(|w| w.set_hseon(true));
    let swings = loop {
        if pac::RCC.cr().read().hserdy() {
            break true;
        }
        if now().wrapping_sub(begin) >= CRYSTAL_PATIENCE_US {
            pac::RCC.cr().modify(|w| w.set_hseon(false));
            break false;
        }
    };
    TIM5.cr1().write(|w| w.set_cen(false));
    swings
}

/// The source of the clocks.
#[inline(always)]
pub(crate) fn clock() -> Clock {
    if IS_INTERNAL.load(Ordering::Relaxed) {
        Clock::Internal
    } else {
        Clock::Crystal
    }
}

fn enable(interrupt: pac::Interrupt, priority: Priority) {
    interrupt.set_priority(priority);
    // SAFETY: every interrupt of the line has its handler in this crate.
    unsafe { interrupt.enable() };
}

/// Starts TIM5, which counts up and round, 32 bits wide (RM0090 18.3.1). Its channels are compare channels, frozen, as after reset:
/// a match sets CCxIF and nothing else (RM0090 18.3.8).
fn start_timer() {
    pac::RCC.apb1enr().modify(|w| w.set_tim5en(true));
    pac::RCC.apb1enr().read();
    TIM5.psc().write_value(PRESCALER - 1);
    TIM5.arr().write(|w| *w = u32::MAX);
    // The prescaler takes effect with an update (RM0090 18.4.6, UG).
    TIM5.egr().write(|w| w.set_ug(true));
    TIM5.sr().write(|w| w.0 = 0);
    TIM5.cr1().write(|w| w.set_cen(true));
}

/// The present tick.
#[inline(always)]
pub(crate) fn now() -> u32 {
    TIM5.cnt().read()
}

/// Sets the alarm of `port` to tick `at`. An enabled alarm goes off then, or at once if `at` has passed.
#[inline(always)]
pub(crate) fn set_alarm(port: usize, at: u32) {
    TIM5.ccr(port).write(|w| *w = at);
    // A match with the earlier tick counts no more. Flags are cleared by a 0 (RM0090 18.4.5).
    TIM5.sr().write(|w| w.0 = !(CC1 << port));
    if (now().wrapping_sub(at) as i32) >= 0 {
        // The timer may miss the match (RM0090 18.4.6, CCxG).
        TIM5.egr().write(|w| w.0 = CC1 << port);
    }
}

/// Enables the alarm of `port`.
#[inline(always)]
pub(crate) fn alarm_on(port: usize) {
    TIM5.dier().modify(|w| w.0 |= CC1 << port);
}

/// Disables the alarm of `port` until the next [`alarm_on`].
#[inline(always)]
pub(crate) fn alarm_off(port: usize) {
    TIM5.dier().modify(|w| w.0 &= !(CC1 << port));
}

#[interrupt]
fn TIM5() {
    let due = TIM5.sr().read().0 & TIM5.dier().read().0;
    // One alarm at a time: characters come between. The other alarms keep the interrupt pending.
    if let Some(port) = (0..PORTS).find(|port| due & CC1 << port != 0) {
        TIM5.sr().write(|w| w.0 = !(CC1 << port));
        usart::on_alarm(port);
    }
}

/// Runs tasks for ever, asleep between them.
pub(crate) fn run(init: impl FnOnce(Spawner)) -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    EXECUTOR.init(Executor::new()).run(init)
}
