//! The chip around the core: what is at which address (RM0090 2.3), and when each of it does something.

mod registers;

use super::code::{Code, Instruction, Kind, REFILL};
use super::gpio::{Mode, Pin, Pins};
use super::iwdg::Iwdg;
use super::nvic::Nvic;
use super::rcc::Rcc;
use super::tim::Timer;
use super::unicorn::{Board, Flow, Register, Registers};
use super::usart::Usart;
use super::{Access, Cause, Output, PORTS, TICKS_HZ, WIRING};
use crate::time::{Clock, Time};

/// Interrupts (RM0090 12.2): those of the USARTs in the order of the ports.
const USART_IRQS: [u8; PORTS] = [37, 38, 39, 52];
const TIM2_IRQ: u8 = 28;
const TIM5_IRQ: u8 = 50;
/// Interrupts of EXTI, and their lines.
const EXTI_IRQS: [(u8, u32); 7] = [
    (6, 1 << 0),
    (7, 1 << 1),
    (8, 1 << 2),
    (9, 1 << 3),
    (10, 1 << 4),
    (23, 0x03E0),
    (40, 0xFC00),
];

/// Why the core stands in front of an instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pause {
    /// Something is due.
    Due,
    /// The instruction is to be done by us.
    Special(Kind),
}

/// See the module.
pub(super) struct Chip {
    code: Code,
    /// When it was powered up, and how fast its ticks are.
    since: Time,
    ppm: i32,
    clock: Clock,
    /// Ticks since then.
    now: u64,
    /// Ticks of a core clock.
    period: u64,
    /// The core stops in front of the first instruction from here on.
    stop_at: u64,
    /// Where it stands, and why.
    pub at: u32,
    pub pause: Pause,
    /// Where the next instruction is if there is no branch.
    next: u32,
    pub instructions: u64,
    length: u8,
    pub nvic: Nvic,
    rcc: Rcc,
    pub pins: Pins,
    pub usarts: [Usart; PORTS],
    tim2: Timer,
    pub tim5: Timer,
    pub iwdg: Iwdg,
    dbgmcu: [u32; 3],
    /// Whether the floating-point unit holds something to keep (CONTROL.FPCA).
    pub float: bool,
    pub reset: Option<Cause>,
    /// Where something was stored that may not be.
    pub forbidden: Option<u32>,
    /// What is wrong with the firmware, or not modelled.
    pub failed: Option<String>,
    pub outputs: Vec<Output>,
    /// DE of the port that has it.
    de: bool,
    counters_begin: u32,
}

impl Chip {
    /// As it is powered up at `since`; its counters count from `counters_begin` on when they are switched on.
    pub fn new(code: Code, since: Time, ppm: i32, counters_begin: u32) -> Self {
        let mut chip = Chip {
            code,
            since,
            ppm,
            clock: Clock::new(TICKS_HZ as u32, ppm),
            now: 0,
            period: 1,
            stop_at: 0,
            at: 0,
            pause: Pause::Due,
            next: 0,
            instructions: 0,
            length: 0,
            nvic: Nvic::new(),
            rcc: Rcc::new(Cause::Power, None),
            pins: Pins::new(None),
            usarts: [(); PORTS].map(|()| Usart::new(ppm, 0)),
            tim2: Timer::new(1, 0),
            tim5: Timer::new(1, 0),
            iwdg: Iwdg::new(),
            dbgmcu: [0; 3],
            float: false,
            reset: None,
            forbidden: None,
            failed: None,
            outputs: Vec::new(),
            de: false,
            counters_begin,
        };
        chip.start();
        chip
    }

    /// All as after a reset but for what is outside, and RAM.
    pub fn reset(&mut self, cause: Cause) {
        for (port, usart) in self.usarts.iter().enumerate() {
            if usart.is_sending() {
                self.outputs.push(Output::Cut(port, self.time()));
            }
        }
        self.rcc = Rcc::new(cause, Some(&self.rcc));
        self.pins = Pins::new(Some(&self.pins));
        self.iwdg.reset();
        self.nvic = Nvic::new();
        self.float = false;
        self.reset = None;
        for port in 0..PORTS {
            let listened = self.usarts[port].listens();
            self.usarts[port] = Usart::new(self.ppm, self.usarts[port].overruns());
            if listened {
                self.outputs.push(Output::Listen(port, false));
            }
        }
        self.start();
        self.show_driver();
    }

    fn start(&mut self) {
        self.tim2 = Timer::new(1, 0);
        self.tim5 = Timer::new(1, self.counters_begin);
        self.set_clocks();
    }

    /// The crystal does not swing, from the next reset on or now.
    pub fn fail_crystal(&mut self) {
        self.rcc.hse_fails = true;
    }

    /// The core's clock, in Hz.
    pub fn core_hz(&self) -> u64 {
        self.rcc.core_hz()
    }

    fn set_clocks(&mut self) {
        self.period = TICKS_HZ / self.rcc.core_hz();
        let timers = TICKS_HZ / self.rcc.timers_hz();
        self.tim2.set_clock(timers, self.now);
        self.tim5.set_clock(timers, self.now);
        let (apb1, apb2) = (self.rcc.apb1_hz() as u32, self.rcc.apb2_hz() as u32);
        for (usart, hz) in self.usarts.iter_mut().zip([apb2, apb1, apb1, apb1]) {
            usart.set_clock(hz);
        }
    }

    /// Where it is.
    pub fn time(&self) -> Time {
        self.since + self.clock.time(self.now)
    }

    /// Ticks since it was powered up.
    pub fn ticks(&self) -> u64 {
        self.now
    }

    /// The first tick at or after `time`.
    pub fn tick_of(&self, time: Time) -> u64 {
        if time == Time::NEVER {
            return u64::MAX;
        }
        let since = time.saturating_sub(self.since);
        self.clock.tick_at_or_after(since)
    }

    /// Bytes of the instruction that it stands at.
    pub fn length(&self) -> u32 {
        self.length.into()
    }

    /// Core clocks pass without an instruction.
    pub fn spend(&mut self, clocks: u64) {
        self.now += clocks * self.period;
    }

    /// Asleep until then.
    pub fn sleep_until(&mut self, tick: u64) {
        self.now = self.now.max(tick);
    }

    /// The core stops in front of the first instruction from `tick` on; the next one is at `address`.
    pub fn run_from(&mut self, address: u32, tick: u64) {
        self.stop_at = tick;
        self.next = address;
    }

    /// When something happens next that is not an instruction.
    pub fn due(&self) -> u64 {
        let now = self.time();
        let sent = self.usarts.iter().map(|usart| usart.due(now));
        let sent = sent.fold(Time::NEVER, Time::min);
        let timers = self.tim2.next().min(self.tim5.next());
        timers.min(self.iwdg.due()).min(self.tick_of(sent))
    }

    /// Does what is due until now.
    pub fn catch_up(&mut self) {
        self.tim2.advance(self.now);
        self.tim5.advance(self.now);
        if self.iwdg.due() <= self.now {
            self.reset = Some(Cause::Watchdog);
        }
        for port in 0..PORTS {
            self.advance(port);
        }
        self.show_lines();
    }

    fn advance(&mut self, port: usize) {
        let now = self.time();
        let wiring = &WIRING[port];
        while let Some((at, byte)) = self.usarts[port].advance(now) {
            if self.pins.is_function(wiring.tx, wiring.function) {
                self.outputs.push(Output::Byte(port, at, byte));
                self.stop_at = 0;
            }
        }
    }

    /// Tells the interrupt controller the levels of all lines.
    pub fn show_lines(&mut self) {
        let now = self.time();
        for (usart, irq) in self.usarts.iter().zip(USART_IRQS) {
            self.nvic.set_line(irq, usart.interrupt(now));
        }
        self.nvic.set_line(TIM2_IRQ, self.tim2.interrupt());
        self.nvic.set_line(TIM5_IRQ, self.tim5.interrupt());
        for (irq, lines) in EXTI_IRQS {
            self.nvic.set_line(irq, self.pins.interrupts(lines));
        }
        if self.nvic.due().is_some() {
            self.stop_at = 0;
        }
    }

    /// The level of a pin.
    pub fn level(&self, at: Pin) -> bool {
        for (port, wiring) in WIRING.iter().enumerate() {
            if Some(at) == wiring.rts && self.pins.is_function(at, wiring.function) {
                return self.usarts[port].rts();
            }
        }
        self.pins.level(at)
    }

    /// A pin is driven from outside.
    pub fn drive(&mut self, at: Pin, level: Option<bool>) {
        self.pins.drive(at, level);
        self.show_handshake();
        self.show_lines();
    }

    fn show_handshake(&mut self) {
        let now = self.time();
        for (port, wiring) in WIRING.iter().enumerate() {
            if let Some(cts) = wiring.cts {
                let connected = self.pins.is_function(cts, wiring.function);
                self.usarts[port].set_cts(connected && self.pins.level(cts), now);
            }
        }
    }

    /// DE: low where the pin is no output, since the board pulls it down.
    fn show_driver(&mut self) {
        for (port, wiring) in WIRING.iter().enumerate() {
            let Some(de) = wiring.de else { continue };
            let level = match self.pins.mode(de) {
                Mode::Output => self.pins.output(de) == Some(true),
                Mode::Input | Mode::Alternate | Mode::Analog => false,
            };
            if level != self.de {
                self.de = level;
                self.outputs.push(Output::Drive(port, self.time(), level));
                self.stop_at = 0;
            }
        }
    }

    fn fail(&mut self, what: String) {
        if self.failed.is_none() {
            let hz = self.rcc.core_hz();
            self.failed = Some(format!(
                "{what}; the instruction is at {:#010x}, the core's clock is {hz} Hz",
                self.at
            ));
        }
        self.stop_at = 0;
    }

    /// Code that is not in flash is not looked into.
    fn outside(&mut self, address: u32) -> Flow {
        self.fail(format!(
            "code at {address:#010x}, outside flash, is not modelled"
        ));
        self.pause = Pause::Due;
        Flow::Stop
    }

    /// Notes what an instruction does to what is ours; whether Unicorn must not execute it.
    fn special(&mut self, kind: Kind, core: &Registers<'_>) -> bool {
        match kind {
            Kind::Ordinary => {}
            Kind::SendEvent => self.nvic.event = true,
            Kind::Float => self.float = true,
            Kind::Mask {
                primask,
                faultmask,
                on,
            } => {
                if primask {
                    self.nvic.primask = on;
                }
                if faultmask {
                    self.nvic.faultmask = on;
                }
                self.stop_at = 0;
            }
            Kind::Set { special, from } => {
                let value = core.get(Register::R(from));
                match special {
                    // APSR and MSP.
                    0 | 8 => {}
                    16 => self.nvic.primask = value & 1 != 0,
                    17 => self.nvic.basepri = value as u8,
                    18 if value as u8 != 0
                        && (self.nvic.basepri == 0 || (value as u8) < self.nvic.basepri) =>
                    {
                        self.nvic.basepri = value as u8;
                    }
                    18 => {}
                    19 => self.nvic.faultmask = value & 1 != 0,
                    _ => self.fail(format!("MSR of special register {special} is not modelled")),
                }
                self.stop_at = 0;
            }
            Kind::WaitForEvent
            | Kind::WaitForInterrupt
            | Kind::Get { .. }
            | Kind::SupervisorCall
            | Kind::Breakpoint
            | Kind::Undefined => return true,
        }
        false
    }
}

impl Board for Chip {
    #[inline]
    fn before(&mut self, address: u32, core: &Registers<'_>) -> Flow {
        if self.forbidden.is_some() {
            // That instruction is where the fault is.
            return Flow::Stop;
        }
        self.at = address;
        let Some(instruction) = self.code.at(address) else {
            return self.outside(address);
        };
        let Instruction {
            clocks,
            kind,
            conditional,
            length,
        } = instruction;
        if self.now >= self.stop_at && !conditional {
            self.pause = Pause::Due;
            return Flow::Stop;
        }
        if address != self.next {
            self.spend(REFILL);
        }
        self.next = address + u32::from(length);
        self.instructions += 1;
        self.length = length;
        self.spend(u64::from(clocks));
        if kind == Kind::Ordinary {
            return Flow::Go;
        }
        if conditional && kind != Kind::Float {
            self.fail(format!("{kind:?} behind IT is not modelled"));
        }
        if self.special(kind, core) {
            self.pause = Pause::Special(kind);
            return Flow::Stop;
        }
        Flow::Go
    }

    fn read(&mut self, address: u32, size: u32) -> u32 {
        if self.is_off(address) {
            self.fail(format!("{address:#010x} is read while its clock is off"));
            return 0;
        }
        // Of a word a byte or a halfword is taken; priorities come as they are asked for.
        let (at, shift) = match address {
            0xE000_E400..=0xE000_E451 | 0xE000_ED18..=0xE000_ED23 => (address, 0),
            _ => (address & !3, 8 * (address & 3)),
        };
        match self.load(at, size) {
            Some(value) => {
                self.show_lines();
                value >> shift
            }
            None => {
                self.fail(format!("{address:#010x} is read, which is not modelled"));
                0
            }
        }
    }

    fn forbidden(&mut self, address: u32) -> Flow {
        if self.nvic.is_unguarded() {
            return Flow::Go;
        }
        self.forbidden.get_or_insert(address);
        self.pause = Pause::Due;
        Flow::Stop
    }

    fn write(&mut self, address: u32, size: u32, value: u32) {
        if self.is_off(address) {
            return self.fail(format!("{address:#010x} is written while its clock is off"));
        }
        match self.store(address, size, value) {
            Access::Done => self.show_lines(),
            Access::Unknown => self.fail(format!(
                "{address:#010x} is set to {value:#x}, which is not modelled"
            )),
            Access::Wrong(what) => {
                self.fail(format!("{what}: {address:#010x} is set to {value:#x}"))
            }
        }
        // Another event may be the next one now.
        self.stop_at = self.stop_at.min(self.due());
    }
}
