//! An STM32F405 that runs the image that is flashed: Unicorn's Cortex-M4 in this process, in a chip that is modelled after RM0090.
//!
//! # Time
//! An instruction takes the core clocks of the Cortex-M4 TRM (r0p1, 3.3.1), a taken branch two more, an exception [`ENTRY`] and
//! [`EXIT`]. A core clock is what the firmware has made it, from the oscillators by way of RCC, and so are those of timers and
//! USARTs. Flash does not wait (its accelerator always has what is asked for), and nothing waits for the bus matrix.
//!
//! # What is not there
//! DMA, ADC and all else that the firmware does not use: an access to it ends the test and is named. So is what would not work on
//! silicon: a peripheral without its clock, a clock that is too fast, flash with too few wait states.

mod chip;
mod code;
mod exceptions;
mod gpio;
mod iwdg;
mod nvic;
mod rcc;
mod tim;
mod unicorn;
mod usart;
mod wiring;

use std::path::{Path, PathBuf};

use object::LittleEndian;
use object::read::elf::{ElfFile32, ProgramHeader};

use crate::error::BusError;
use crate::host::RxByte;
use crate::line::Line;
use crate::time::Time;
use chip::{Chip, Pause};
use code::{Code, Kind};
use gpio::pin;
use nvic::SV_CALL;
use unicorn::{Core, Memory, Register, Stand};
use wiring::WIRING;

/// Ticks of the model in a second: a whole number for each half period of 168 MHz, and of 16 and 8 MHz.
const TICKS_HZ: u64 = 336_000_000;

/// The crystal of the board.
const HSE_HZ: u64 = 8_000_000;

/// The number of ports.
const PORTS: usize = 4;

/// Memories (RM0090 2.3.1, 2.4): flash, which is at 0 too, RAM, and RAM of the core alone.
const FLASH: Memory = Memory {
    first: 0x0800_0000,
    bytes: 1 << 20,
    fixed: true,
};
const RAM: Memory = Memory {
    first: 0x2000_0000,
    bytes: 128 << 10,
    fixed: false,
};
const CORE_RAM: Memory = Memory {
    first: 0x1000_0000,
    bytes: 64 << 10,
    fixed: false,
};
/// Peripherals, and the core's own registers.
const WINDOWS: [(u32, u32); 2] = [(0x4000_0000, 0x0008_0000), (0xE000_0000, 0x0010_0000)];

/// What a store to a register is answered with.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Access {
    Done,
    /// There is no such register, or it is not modelled.
    Unknown,
    /// It would not do on the chip, or is not modelled.
    Wrong(String),
}

impl Access {
    fn wrong(what: &str) -> Self {
        Access::Wrong(what.to_owned())
    }
}

/// What a core is stopped by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    /// The memory protection unit forbids a store to this address.
    Memory(u32),
    /// And what is kept of what an exception interrupts.
    Stacking,
    /// Nothing is at this address.
    Bus(u32),
    /// Nothing can be executed there.
    Fetch,
    Undefined,
    Breakpoint,
}

/// Why an STM32 starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// It was powered up.
    Power,
    /// The supply was too low for a moment.
    BrownOut,
    /// NRST was low.
    Pin,
    /// A reset by SYSRESETREQ.
    Software,
    /// The independent watchdog.
    Watchdog,
}

/// What a port did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Output {
    Line(usize, Line),
    Byte(usize, Time, u8),
    Drive(usize, Time, bool),
    Listen(usize, bool),
    /// A character breaks off.
    Cut(usize, Time),
}

/// What the core does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Runs,
    /// Waits after WFE.
    WaitsForEvent,
    /// Waits after WFI.
    WaitsForInterrupt,
    /// A fault within the handler of faults (ARMv7-M B1.5.15): nothing but a reset ends it.
    LockedUp,
}

/// See the module.
pub struct Silicon {
    core: Core<Chip>,
    state: State,
    /// Where the core goes on.
    pc: u32,
    /// Where stores are forbidden.
    guarded: Vec<(u32, u32)>,
    /// What the vector table was reset to: where the image begins.
    vectors: u32,
}

impl Silicon {
    /// Powers an image up at `since`. The clocks are off by `ppm`.
    pub(super) fn new(
        library: &Path,
        image: &Path,
        since: Time,
        ppm: i32,
        counters_begin: u32,
    ) -> Result<Self, BusError> {
        let flash = flash(image)?;
        let chip = Chip::new(Code::of(FLASH.first, &flash), since, ppm, counters_begin);
        let mut core = Core::new(library, chip, &[FLASH, RAM, CORE_RAM], &WINDOWS)?;
        core.store(FLASH.first, &flash);
        let mut silicon = Silicon {
            core,
            state: State::Runs,
            pc: 0,
            guarded: Vec::new(),
            vectors: FLASH.first,
        };
        silicon.boot();
        Ok(silicon)
    }

    /// From the vector table (ARMv7-M B1.5.5).
    fn boot(&mut self) {
        for number in 0..13 {
            self.core.set(Register::R(number), 0);
        }
        // What the core reads of its masks is Unicorn's.
        for mask in [Register::Primask, Register::Basepri, Register::Faultmask] {
            self.core.set(mask, 0);
        }
        self.core.set(Register::Lr, u32::MAX);
        self.core.set(Register::Xpsr, 0x0100_0000);
        let stack = self.word(self.vectors);
        self.core.set(Register::Sp, stack & !3);
        self.pc = self.word(self.vectors + 4) & !1;
        self.state = State::Runs;
        self.guarded.clear();
        self.core.guard(&[]);
    }

    fn chip(&self) -> &Chip {
        self.core.board()
    }

    fn chip_mut(&mut self) -> &mut Chip {
        self.core.board_mut()
    }

    pub(super) fn now(&self) -> Time {
        self.chip().time()
    }

    pub(super) fn instructions(&self) -> u64 {
        self.chip().instructions
    }

    pub(super) fn overruns(&self, port: usize) -> u64 {
        self.chip().usarts[port].overruns()
    }

    /// Bytes of memory; `None` where there is none.
    pub fn memory<const N: usize>(&self, address: u32) -> Option<[u8; N]> {
        self.core.load(address)
    }

    /// What the core would read at the address of a register, with all that follows from it; `None` if there is none.
    pub fn register(&mut self, address: u32) -> Option<u32> {
        self.chip_mut().load(address, 4)
    }

    /// The core's clock, in Hz.
    pub fn core_hz(&self) -> u64 {
        self.chip().core_hz()
    }

    /// The level of a pin, such as `('A', 12)`.
    pub fn pin(&self, gpio: char, number: u8) -> bool {
        self.chip().level(pin(gpio, number))
    }

    /// Drives a pin from outside, or lets go of it.
    pub fn drive(&mut self, gpio: char, number: u8, level: Option<bool>) {
        self.chip_mut().drive(pin(gpio, number), level);
    }

    /// The crystal does not swing. In time before the firmware switches it on.
    pub fn fail_crystal(&mut self) {
        self.chip_mut().fail_crystal();
    }

    /// Sets the frequency of the watchdog's oscillator in Hz, 17 000 to 47 000 (DS, LSI oscillator characteristics), from its next reload on.
    pub fn set_lsi(&mut self, hz: u32) {
        self.chip_mut().iwdg.set_lsi(hz);
    }

    /// Whether a fault within the handler of faults has stopped the core for good.
    pub fn is_locked_up(&self) -> bool {
        self.state == State::LockedUp
    }

    fn word(&self, address: u32) -> u32 {
        self.core.load(address).map_or(0, u32::from_le_bytes)
    }

    /// A reset; after one by power RAM is 0.
    pub(crate) fn reset(&mut self, cause: Cause) {
        self.chip_mut().reset(cause);
        if cause == Cause::Power {
            for memory in [RAM, CORE_RAM] {
                let zeros = vec![0; memory.bytes as usize];
                self.core.store(memory.first, &zeros);
            }
        }
        self.boot();
    }

    /// Runs to `limit`, or to where it has something to tell.
    ///
    /// # Panics
    /// Where the firmware does what is not modelled, or what would not work on the chip.
    pub(super) fn run_to(&mut self, limit: Time) -> Vec<Output> {
        let limit = self.chip().tick_of(limit);
        loop {
            self.chip_mut().catch_up();
            if let Some(cause) = self.chip().reset {
                self.reset(cause);
            }
            if let Some(failed) = &self.chip().failed {
                panic!("{failed}");
            }
            self.guard();
            self.wake();
            let chip = self.core.board_mut();
            if !chip.outputs.is_empty() || chip.ticks() >= limit {
                return std::mem::take(&mut chip.outputs);
            }
            let next = limit.min(chip.due());
            if self.state == State::Runs {
                chip.run_from(self.pc, next);
                self.run();
            } else {
                chip.sleep_until(next);
            }
        }
    }

    /// Follows the memory protection unit.
    fn guard(&mut self) {
        let mpu = &mut self.core.board_mut().nvic.mpu;
        if !std::mem::take(&mut mpu.changed) {
            return;
        }
        let guarded = mpu.guarded();
        let guarded = guarded.unwrap_or_else(|| panic!("{mpu:x?} is not modelled"));
        self.core.guard(&guarded);
        self.guarded = guarded;
    }

    /// Takes an exception that is due, and ends a sleep that is over.
    fn wake(&mut self) {
        if self.state == State::LockedUp {
            return;
        }
        if let Some(exception) = self.chip().nvic.due() {
            self.state = State::Runs;
            return self.enter(exception);
        }
        let nvic = &mut self.core.board_mut().nvic;
        let wakes = match self.state {
            State::WaitsForEvent => std::mem::take(&mut nvic.event),
            State::WaitsForInterrupt => nvic.wakes(),
            State::Runs | State::LockedUp => false,
        };
        if wakes {
            self.state = State::Runs;
        }
    }

    fn run(&mut self) {
        let stand = self.core.run(self.pc);
        let at = self.chip().at;
        match stand {
            Stand::Stopped => {
                self.pc = at;
                if let Some(at) = self.chip_mut().forbidden.take() {
                    return self.fault(Fault::Memory(at));
                }
                if let Pause::Special(kind) = self.chip().pause {
                    self.special(kind);
                }
            }
            Stand::Failed(reason) => {
                let pc = self.core.get(Register::Pc);
                if pc >= 0xFFFF_FFE0 && self.chip().nvic.running() != 0 {
                    return self.leave(pc | 1);
                }
                self.pc = at;
                let reason = self.core.reason(reason);
                let fault = if reason.contains("FETCH") {
                    Fault::Fetch
                } else if reason.contains("INSN") {
                    Fault::Undefined
                } else {
                    Fault::Bus(self.core.get(Register::Pc))
                };
                self.fault(fault);
            }
        }
    }

    /// An instruction that is ours; it has taken its time already.
    fn special(&mut self, kind: Kind) {
        let behind = self.pc + self.chip().length();
        match kind {
            Kind::WaitForEvent => {
                self.pc = behind;
                self.state = State::WaitsForEvent;
            }
            Kind::WaitForInterrupt => {
                self.pc = behind;
                self.state = State::WaitsForInterrupt;
            }
            Kind::SupervisorCall => {
                self.pc = behind;
                self.chip_mut().nvic.pend(SV_CALL);
            }
            Kind::Get { special: 5, into } => {
                let running = self.chip().nvic.running();
                self.core.set(Register::R(into), running.into());
                self.pc = behind;
            }
            Kind::Get { special, .. } => {
                panic!(
                    "MRS of special register {special} at {:#010x} is not modelled",
                    self.pc
                )
            }
            Kind::Breakpoint => self.fault(Fault::Breakpoint),
            _ => self.fault(Fault::Undefined),
        }
    }

    /// A port has heard a character.
    pub(super) fn deliver(&mut self, port: usize, byte: RxByte) {
        let chip = self.chip_mut();
        let wiring = &WIRING[port];
        if chip.pins.is_function(wiring.rx, wiring.function) {
            chip.usarts[port].deliver(byte);
            chip.show_lines();
        }
    }

    /// RXD of a port has this level.
    pub(super) fn receive(&mut self, port: usize, level: bool) {
        self.chip_mut().drive(WIRING[port].rx, Some(level));
    }
}

/// What an image has in flash.
fn flash(path: &Path) -> Result<Vec<u8>, BusError> {
    let bytes = std::fs::read(path).map_err(|source| BusError::Read {
        path: path.to_owned(),
        source,
    })?;
    let not_elf = |reason: String| BusError::NotElf {
        path: path.to_owned(),
        reason,
    };
    let elf =
        ElfFile32::<LittleEndian>::parse(&*bytes).map_err(|error| not_elf(error.to_string()))?;
    let mut flash = Vec::new();
    for segment in elf.elf_program_headers() {
        let data = segment.data(LittleEndian, &*bytes).unwrap_or_default();
        if segment.p_type(LittleEndian) != object::elf::PT_LOAD || data.is_empty() {
            continue;
        }
        let first = segment.p_paddr(LittleEndian).checked_sub(FLASH.first);
        let first = first.filter(|first| *first as usize + data.len() <= FLASH.bytes as usize);
        let first = first.ok_or_else(|| not_elf("it has code outside flash".to_owned()))? as usize;
        if flash.len() < first + data.len() {
            flash.resize(first + data.len(), 0xFF);
        }
        flash[first..first + data.len()].copy_from_slice(data);
    }
    Ok(flash)
}

/// Where set-up has put Unicorn's library.
pub(super) fn library(root: &Path) -> Option<PathBuf> {
    let versions = std::fs::read_dir(root.join("target/python/lib")).ok()?;
    let libraries = versions.flatten().flat_map(|version| {
        let folder = version.path().join("site-packages/unicorn/lib");
        ["libunicorn.so.2", "libunicorn.2.dylib"].map(|name| folder.join(name))
    });
    let mut there = libraries.filter(|path| path.is_file());
    there.next()
}
