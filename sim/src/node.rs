//! One ATmega328P: its run loop, its figures and a view into its memory.
//!
//! The run loop is ours, not simavr's, so that what the data sheet counts is counted
//! (DS40002061B, 7.7.1): an interrupt response takes four cycles, four more out of sleep; one
//! instruction follows `sei` and `reti` before an interrupt is taken; `sleep` with SMCR.SE = 0
//! does nothing. Only Idle mode is modelled: other sleep modes keep the clocks running here.
//! With the I flag off nothing wakes a sleeping core.

mod memory;

use std::path::PathBuf;

use crate::eeprom::Eeprom;
use crate::elf::Image;
use crate::error::BusError;
use crate::ffi::{Core, DATA_BYTES};
use crate::gpio::{Level, Pin};
use crate::peripherals::{Nano328, Output};
use crate::time::{Clock, Time};
use crate::usart::TxPhase;
use crate::watchdog::{WDRF, Watchdog};

/// Cycles from the acceptance of an interrupt to the first instruction of its vector (7.7.1).
const RESPONSE: u64 = 4;
/// Cycles more when the core slept (7.7.1).
const WAKE_UP: u64 = 4;
const SMCR: usize = 0x53;
const PORF: u8 = 1 << 0;
const EXTRF: u8 = 1 << 1;
const RAM_START: usize = 0x100;
/// What the firmware paints its free SRAM with, if it does (`embassy-avr-hal`, stack).
const PAINT: u8 = 0xC5;
/// Vectors of the ATmega328P, reset included (12.1).
pub const VECTORS: usize = 26;

/// How to put a Nano on the bus.
#[derive(Clone, Debug)]
pub struct Nano {
    /// Its name in records.
    pub name: String,
    /// Its firmware, an ELF image.
    pub elf: PathBuf,
    /// A boot loader, an ELF image too, and the first byte of the boot section: every reset starts there (27.5, BOOTRST).
    pub boot_loader: Option<(PathBuf, u16)>,
    /// Its nominal clock, 1 Hz to 20 MHz.
    pub clock_hz: u32,
    /// How far its clock is off, in parts per million; positive is too fast.
    pub clock_ppm: i32,
    /// The pin that enables its transceiver's driver and disables its receiver. Pulled down: the
    /// driver is off while the pin floats. `None`: always driving and always hearing.
    pub de: Option<Pin>,
    /// Whether the receiver stays on while the driver is (RE tied to ground): the node hears
    /// itself.
    pub echo: bool,
    /// What the data sheet leaves open about the transmitter.
    pub tx_phase: TxPhase,
    /// Pins whose edges are recorded besides DE.
    pub watch: Vec<Pin>,
    /// Seed of what is in the SRAM after power-up.
    pub seed: u64,
}

impl Nano {
    /// A Nano as sold: 16 MHz, DE on PD2.
    pub fn new(name: impl Into<String>, elf: impl Into<PathBuf>) -> Self {
        Nano {
            name: name.into(),
            elf: elf.into(),
            boot_loader: None,
            clock_hz: 16_000_000,
            clock_ppm: 0,
            de: Some(Pin::D2),
            echo: false,
            tx_phase: TxPhase::default(),
            watch: Vec::new(),
            seed: 1,
        }
    }
}

/// How long the executions of one interrupt took, from its acceptance to the end of `reti`: the
/// four cycles of response included, those of waking up not, and what interrupted it included.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VectorStats {
    /// The number of executions.
    pub count: u64,
    /// Cycles of the shortest.
    pub min: u64,
    /// Cycles of the longest.
    pub max: u64,
    /// Cycles of all.
    pub total: u64,
}

/// What a node did since it was powered up or its figures were cleared.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Cycles spent asleep.
    pub asleep: u64,
    /// Cycles spent executing, interrupt response and wake-up included.
    pub awake: u64,
    /// Per vector; 18 is USART_RX, 11 and 12 are TIMER1_COMPA and COMPB.
    pub vectors: [VectorStats; VECTORS],
}

/// A node on the bus.
pub struct Node {
    config: Nano,
    clock: Clock,
    image: Image,
    core: Core<Nano328>,
    powered: bool,
    shadow: bool,
    running: Vec<(u8, u64)>,
    stats: Stats,
}

impl Node {
    pub(crate) fn new(config: Nano) -> Result<Self, BusError> {
        if !(1..=20_000_000).contains(&config.clock_hz) {
            return Err(BusError::Clock(config.clock_hz));
        }
        let mut image = Image::read(&config.elf)?;
        let mut start = 0;
        if let Some((loader, section)) = &config.boot_loader {
            start = usize::from(*section);
            let loader = Image::read(loader)?;
            image.flash[start..].copy_from_slice(&loader.flash[start..]);
        }
        let mut pins = config.watch.clone();
        pins.extend(config.de);
        let eeprom = Eeprom::new(config.clock_hz, &image.eeprom);
        let periph = Nano328::new(
            config.tx_phase,
            &pins,
            eeprom,
            Watchdog::new(config.clock_hz),
        );
        let core = Core::new(periph, &image.flash, start as u32, config.clock_hz)
            .ok_or(BusError::NoCore)?;
        let mut node = Node {
            clock: Clock::new(config.clock_hz, config.clock_ppm),
            config,
            image,
            core,
            powered: false,
            shadow: false,
            running: Vec::new(),
            stats: Stats::default(),
        };
        node.power_up(Time::ZERO);
        Ok(node)
    }

    // --- power ------------------------------------------------------------------------------

    fn restart(&mut self, now: Time, mcusr: u8) {
        let cycle = self.clock.tick_at_or_after(now).max(self.core.cycle());
        self.core.set_cycle(cycle);
        self.core.reset();
        self.core.periph_mut().reset(cycle, mcusr);
        self.shadow = false;
        self.running.clear();
    }

    pub(crate) fn reset(&mut self, now: Time) {
        self.settle(now);
        let mcusr = self.core.periph().watchdog.mcusr();
        self.restart(now, mcusr | EXTRF);
    }

    pub(crate) fn power_cut(&mut self, now: Time) {
        self.settle(now);
        let cycle = self.clock.tick_at_or_after(now);
        self.core.periph_mut().eeprom.lose_power(cycle);
        self.restart(now, 0);
        self.powered = false;
    }

    pub(crate) fn power_up(&mut self, now: Time) {
        if self.powered {
            return;
        }
        self.powered = true;
        self.restart(now, PORF);
        let fill: Vec<u8> = pattern(self.config.seed).take(DATA_BYTES).collect();
        self.core.data_mut()[RAM_START..].copy_from_slice(&fill[RAM_START..]);
        self.core.data_mut()[..32].copy_from_slice(&fill[..32]);
        self.stats = Stats::default();
    }

    // --- run loop ---------------------------------------------------------------------------

    fn vector(&self) -> Option<u8> {
        if !self.core.interrupts_enabled() {
            return None;
        }
        match (self.core.periph().vector(), self.core.foreign_vector()) {
            (Some(ours), Some(theirs)) => Some(ours.min(theirs)),
            (ours, theirs) => ours.or(theirs),
        }
    }

    fn next_event(&self) -> u64 {
        self.core.periph().next_event().min(self.core.next_timer())
    }

    /// The next cycle at which this node may do something by itself.
    fn activity(&self) -> u64 {
        if !self.powered || !self.core.is_alive() {
            u64::MAX
        } else if !self.core.is_sleeping() || self.vector().is_some() {
            self.core.cycle()
        } else {
            self.next_event()
        }
    }

    /// The time of the last activity in bus time.
    pub(crate) fn activity_time(&self) -> Time {
        match self.activity() {
            u64::MAX => Time::NEVER,
            cycle => self.clock.time(cycle.max(self.core.cycle())),
        }
    }

    /// Runs until `limit` (a cycle), or until something was put out. A sleeping node stops at the
    /// last event before `limit`, so that an edge may still be told to it in the right place.
    pub(crate) fn run(&mut self, limit: u64) {
        while self.powered
            && self.core.is_alive()
            && self.core.cycle() < limit
            && !self.core.periph().has_outputs()
        {
            if !self.step(limit) {
                return;
            }
        }
    }

    fn happen(&mut self) {
        let now = self.core.cycle();
        if self.core.periph().next_event() <= now {
            self.core.periph_mut().sync(now);
        }
        if self.core.periph().watchdog.bites() {
            let mcusr = self.core.periph().watchdog.mcusr();
            self.restart(self.clock.time(now), mcusr | WDRF);
        }
        if self.core.next_timer() <= now {
            self.core.process_timers();
        }
    }

    /// One burst, interrupt or nap; false if the node sleeps beyond `limit`.
    fn step(&mut self, limit: u64) -> bool {
        self.happen();
        let now = self.core.cycle();
        let sleeping = self.core.is_sleeping();
        if (sleeping || !self.shadow)
            && let Some(vector) = self.vector()
        {
            let mut at = now;
            if sleeping {
                self.core.wake();
                at += WAKE_UP;
            }
            self.enter(vector, at);
            return true;
        }
        if sleeping {
            let next = self.next_event();
            if next > limit {
                return false;
            }
            self.nap(next.max(now));
            return true;
        }
        let budget = match self.shadow {
            true => 1,
            false => self.next_event().min(limit).saturating_sub(now),
        };
        let burst = self.core.run(budget);
        self.shadow = self.core.take_interrupt_shadow();
        let end = self.core.cycle();
        self.stats.awake += end - now;
        if burst.ended_with_reti()
            && let Some((vector, start)) = self.running.pop()
        {
            self.stats.vectors[usize::from(vector) % VECTORS].add(end - start);
        }
        // 10.1: without the sleep-enable bit the instruction does nothing.
        if self.core.is_sleeping() && self.core.data()[SMCR] & 1 == 0 {
            self.core.wake();
        }
        true
    }

    fn enter(&mut self, vector: u8, at: u64) {
        let ours = self.core.periph().vector() == Some(vector);
        if ours {
            self.core.enter_vector(vector);
            self.core.periph_mut().acknowledge(vector);
        } else {
            self.core.service_foreign();
        }
        self.shadow = false;
        self.running.push((vector, at));
        let start = self.core.cycle();
        self.core.set_cycle(at + RESPONSE);
        self.stats.awake += at + RESPONSE - start;
    }

    fn nap(&mut self, until: u64) {
        let now = self.core.cycle();
        self.stats.asleep += until - now;
        self.core.set_cycle(until);
    }

    /// Lets a sleeping node's own time catch up with the bus.
    pub(crate) fn settle(&mut self, now: Time) {
        let until = self.clock.tick_at_or_after(now);
        if self.powered && self.core.is_sleeping() && self.core.cycle() < until {
            self.core.periph_mut().sync(until);
            self.nap(until);
        }
    }

    // --- the outside ------------------------------------------------------------------------

    pub(crate) fn config(&self) -> &Nano {
        &self.config
    }

    pub(crate) fn take_outputs(&mut self) -> Vec<Output> {
        self.core.periph_mut().take_outputs()
    }

    pub(crate) fn has_outputs(&self) -> bool {
        self.core.periph().has_outputs()
    }

    pub(crate) fn rxd_edge(&mut self, at: Time, level: bool) {
        let cycle = self.clock.tick_at_or_after(at);
        self.core.periph_mut().rxd_edge(cycle, level);
    }

    /// Drives one of the node's pins from outside (`None`: no longer), from now on.
    pub fn set_input(&mut self, pin: Pin, level: Option<bool>) {
        let now = self.core.cycle();
        match level {
            Some(level) => self.core.periph_mut().gpio.input(pin, level, now),
            None => self.core.periph_mut().gpio.release(pin),
        }
    }

    /// Drives one of the node's pins from outside, from a cycle on that has not come yet: the exact
    /// cycle, where [`Node::set_input`] can only act between two instructions. One whose cycle has
    /// passed acts at once.
    pub fn set_input_at(&mut self, pin: Pin, level: bool, cycle: u64) {
        let at = cycle.max(self.core.cycle());
        self.core.periph_mut().gpio.input(pin, level, at);
    }

    /// The name of the node.
    pub fn name(&self) -> &str {
        &self.config.name
    }

    /// Its clock, error included.
    pub fn clock(&self) -> Clock {
        self.clock
    }

    /// Cycles since the bus was made, power cuts included.
    pub fn cycle(&self) -> u64 {
        self.core.cycle()
    }

    /// Byte address of the next instruction.
    pub fn pc(&self) -> u32 {
        self.core.pc()
    }

    /// Whether it has power.
    pub fn is_powered(&self) -> bool {
        self.powered
    }

    /// Whether it sleeps.
    pub fn is_asleep(&self) -> bool {
        self.powered && self.core.is_sleeping()
    }

    /// `(PORTx, DDRx)` of port `'B'`, `'C'` or `'D'`; `None` for any other.
    pub fn port_state(&self, port: char) -> Option<(u8, u8)> {
        self.core.periph().gpio.port_state(port)
    }

    /// What the node does to a pin.
    pub fn output(&self, pin: Pin) -> Level {
        self.core.periph().gpio.output(pin)
    }

    /// The level of its RXD pin.
    pub fn hears(&self) -> bool {
        self.core.periph().usart.rxd()
    }

    /// Opcodes met that the core does not know: more than 0 means that the firmware is broken.
    pub fn bad_opcodes(&self) -> u32 {
        self.core.periph().bad_opcodes
    }

    /// What it did so far.
    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    /// Starts the figures anew.
    pub fn clear_stats(&mut self) {
        self.stats = Stats::default();
    }
}

impl VectorStats {
    fn add(&mut self, cycles: u64) {
        self.min = if self.count == 0 {
            cycles
        } else {
            self.min.min(cycles)
        };
        self.max = self.max.max(cycles);
        self.count += 1;
        self.total += cycles;
    }
}

/// What SRAM holds after power-up: nothing one may rely on, but the same for the same seed
/// (xorshift64*).
fn pattern(seed: u64) -> impl Iterator<Item = u8> {
    let mut state = seed | 1;
    std::iter::repeat_with(move || {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        (state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 56) as u8
    })
}
