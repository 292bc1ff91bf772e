//! simavr's instruction core behind a safe face: the one module that reaches into C.
//!
//! What is used of simavr: the instruction decoder, data and flash memory, its cycle timers and
//! interrupt table for the peripherals that are *not* replaced (Timer0, Timer2, watchdog).
//! What is replaced: the run loop (see `node.rs`) and every register a [`Peripherals`] claims.
//!
//! # Time of a register access
//! simavr calls a register's callback before it adds the instruction's cycles. On silicon `in`
//! and `out` access the bus in their only cycle, and the two-cycle accesses (`lds`, `sts`, `ld`,
//! `st`) in their second. A write takes effect at the clock edge that ends the access cycle. So a
//! read sees the state of cycle `start` (`in`, `sbic`, `sbis`, `sbi`, `cbi`) or `start + 1`, and a
//! write takes effect at edge `start + 1` (`out`) or `start + 2`.

use std::ffi::{c_int, c_void};
use std::ptr::NonNull;

use simavr_ffi::{
    avr_cycle_timer_process, avr_flashaddr_t, avr_init, avr_io_addr_t, avr_io_t,
    avr_irq_register_notify, avr_irq_t, avr_loadcode, avr_make_mcu_by_name, avr_reset,
    avr_service_interrupts, avr_t, avr_terminate, bit_cb, cpu_Running, cpu_Sleeping,
};

use crate::elf::FLASH_BYTES;

// Exported by libsimavr, but declared in `sim_core.h`, which simavr-ffi leaves out of its
// bindings. The signatures are those of that header.
unsafe extern "C" {
    fn avr_run_one(avr: *mut avr_t) -> avr_flashaddr_t;
    fn _avr_push_addr(avr: *mut avr_t, addr: avr_flashaddr_t) -> c_int;
    fn free(ptr: *mut c_void);
}

/// Bytes of data memory: registers, I/O and SRAM (DS40002061B, 8.3).
pub(crate) const DATA_BYTES: usize = 0x900;
/// I/O address 0 in data memory.
const IO_BASE: u16 = 0x20;
/// Index of the I flag in simavr's split SREG.
const SREG_I: usize = 7;
/// Addresses of the stack pointer in data memory.
const SPL: usize = 0x5d;

/// What the core asks of its peripherals for `wdr`: AVR_IOCTL_WATCHDOG_RESET of `avr_watchdog.h`.
const WATCHDOG_RESET: u32 = u32::from_be_bytes(*b"wdtr");

/// Index of the invalid-opcode signal among simavr's core signals.
const BAD_OPCODE: usize = 0;

/// The registers that replace simavr's.
pub(crate) trait Peripherals: 'static {
    /// Data-memory addresses that are read and written through this.
    const REGISTERS: &'static [u16];
    /// Those of [`REGISTERS`](Self::REGISTERS) in which `sbi` and `cbi` change one bit without reading and writing
    /// all bits (DS40002061B, notes of the register summary).
    const SINGLE_BIT: &'static [u16];

    /// The value of a register in cycle `at`.
    fn read(&mut self, address: u16, at: u64) -> u8;
    /// A value written to a register at clock edge `at`. Returns for how many cycles the CPU is
    /// halted by that.
    fn write(&mut self, address: u16, value: u8, at: u64) -> u64;
    /// Sets or clears one bit of a register of [`SINGLE_BIT`](Self::SINGLE_BIT), as [`write`](Self::write) does.
    fn write_bit(&mut self, address: u16, bit: u8, set: bool, at: u64) -> u64;
    /// `wdr`, in cycle `at`.
    fn watchdog_reset(&mut self, at: u64);
    /// The core met an opcode it does not know.
    fn bad_opcode(&mut self);
}

/// An ATmega328P core with the peripherals `P`.
///
/// Invariants: `avr` came from `avr_make_mcu_by_name("atmega328p")` and `avr_init`, is owned by
/// this value alone, and is not freed before it is dropped. `periph` came from `Box::into_raw` and
/// is owned likewise; simavr's callbacks get it as their parameter and run only inside the calls
/// of this module that take `&mut self`, during which no reference to `*periph` is alive.
pub(crate) struct Core<P: Peripherals> {
    avr: NonNull<avr_t>,
    periph: NonNull<P>,
    saved_bit_io: [bit_cb; 32],
    /// In front of simavr's peripherals, so that `wdr` is asked of it first.
    module: NonNull<Module<P>>,
}

/// A peripheral as simavr knows it.
#[repr(C)]
struct Module<P> {
    io: avr_io_t,
    periph: NonNull<P>,
}

/// What a burst of instructions ended with.
pub(crate) struct Burst {
    /// The last opcode executed.
    pub last_opcode: u16,
}

impl Burst {
    /// Whether the burst ended with `reti`.
    pub fn ended_with_reti(&self) -> bool {
        self.last_opcode == 0x9518
    }
}

impl<P: Peripherals> Core<P> {
    /// A core with `flash` in its program memory, which a reset starts at byte `start`; `None` where simavr lacks the
    /// ATmega328P.
    pub fn new(periph: P, flash: &[u8], start: u32, hz: u32) -> Option<Self> {
        // SAFETY: the name is a NUL-terminated string that outlives the call.
        let avr = NonNull::new(unsafe { avr_make_mcu_by_name(c"atmega328p".as_ptr()) })?;
        let periph = NonNull::from(Box::leak(Box::new(periph)));
        let len = flash.len().min(FLASH_BYTES);
        let mut code = flash[..len].to_vec();
        // SAFETY: `avr` is a fresh core; `avr_init` is called exactly once on it, before anything
        // else. `code` is `len` bytes and at most as large as the flash, so avr_loadcode, which
        // copies it, stays in bounds. The tables `io` and `bit_io` are indexed below 280 and 32,
        // as the addresses of the ATmega328P (0x20..=0xff) are. The callbacks get `periph`, which
        // lives as long as the core.
        let saved_bit_io = unsafe {
            avr_init(avr.as_ptr());
            let a = avr.as_ptr();
            (*a).frequency = hz;
            avr_loadcode(a, code.as_mut_ptr(), len as u32, 0);
            (*a).codeend = FLASH_BYTES as u32;
            (*a).reset_pc = start;
            let param = periph.as_ptr().cast::<c_void>();
            let saved = (*a).bit_io;
            for &address in P::REGISTERS {
                let io = &mut (*a).io[usize::from(address - IO_BASE)];
                io.r.param = param;
                io.r.c = Some(on_read::<P>);
                io.w.param = param;
                io.w.c = Some(on_write::<P>);
                if address < IO_BASE + 32 {
                    (*a).bit_io[usize::from(address - IO_BASE)].c = None;
                }
            }
            for &address in P::SINGLE_BIT {
                let slot = usize::from(address - IO_BASE);
                (*a).bit_io[slot] = bit_cb {
                    c: Some(on_bit_write::<P>),
                    param,
                };
            }
            avr_irq_register_notify((*a).irq.add(BAD_OPCODE), Some(on_bad_opcode::<P>), param);
            saved
        };
        let module = NonNull::from(Box::leak(Box::new(Module {
            // SAFETY: a structure of pointers, numbers and optional functions, for all of which zero is a value.
            io: unsafe { std::mem::zeroed() },
            periph,
        })));
        // SAFETY: both are valid. The list goes on behind the new head, which stays where it is until `drop` takes it out.
        unsafe {
            let io = &raw mut (*module.as_ptr()).io;
            (*io).avr = avr.as_ptr();
            (*io).ioctl = Some(on_ioctl::<P>);
            (*io).next = (*avr.as_ptr()).io_port;
            (*avr.as_ptr()).io_port = io;
        }
        Some(Core {
            avr,
            periph,
            saved_bit_io,
            module,
        })
    }

    /// The peripherals of the chip.
    pub fn periph(&self) -> &P {
        // SAFETY: owned by `self`; the callbacks that use it run only under `&mut self`.
        unsafe { self.periph.as_ref() }
    }

    /// The peripherals of the chip, mutable.
    pub fn periph_mut(&mut self) -> &mut P {
        // SAFETY: as above, and `&mut self` makes the reference unique.
        unsafe { self.periph.as_mut() }
    }

    fn avr(&self) -> *mut avr_t {
        self.avr.as_ptr()
    }

    /// Cycles since the node's time zero.
    pub fn cycle(&self) -> u64 {
        // SAFETY: `avr` is valid (type invariant); a plain field read.
        unsafe { (*self.avr()).cycle }
    }

    /// Lets time pass without executing anything.
    pub fn set_cycle(&mut self, cycle: u64) {
        // SAFETY: as above; a plain field write.
        unsafe { (*self.avr()).cycle = cycle }
    }

    /// Byte address of the next instruction.
    pub fn pc(&self) -> u32 {
        // SAFETY: as above.
        unsafe { (*self.avr()).pc }
    }

    /// Executes instructions until at least `budget` cycles are used, a register of `P` was
    /// written, interrupts were enabled, or the core slept; at least one instruction.
    pub fn run(&mut self, budget: u64) -> Burst {
        let avr = self.avr();
        // SAFETY: `avr` is valid; no reference into it or into `*periph` is alive here, so the
        // callbacks that avr_run_one may call are free to make theirs. avr_run_one leaves `pc` on
        // the last instruction it executed and returns the next; it keeps `pc` inside the flash,
        // of which one word more than FLASH_BYTES is allocated.
        unsafe {
            (*avr).run_cycle_count = budget.max(1);
            let next = avr_run_one(avr);
            let last_opcode = opcode_at(avr, (*avr).pc);
            (*avr).pc = next;
            Burst { last_opcode }
        }
    }

    /// When simavr's own peripherals next want to be called.
    pub fn next_timer(&self) -> u64 {
        // SAFETY: `timer` is null or points into `timer_slots` of the same valid `avr_t`.
        unsafe {
            let timer = (*self.avr()).cycle_timers.timer;
            if timer.is_null() {
                u64::MAX
            } else {
                (*timer).when
            }
        }
    }

    /// Calls simavr's own peripherals that are due.
    pub fn process_timers(&mut self) {
        // SAFETY: `avr` is valid and no reference into it is alive.
        unsafe {
            avr_cycle_timer_process(self.avr());
        }
    }

    /// The I flag.
    pub fn interrupts_enabled(&self) -> bool {
        // SAFETY: a plain field read of a valid `avr_t`.
        unsafe { (*self.avr()).sreg[SREG_I] != 0 }
    }

    /// Whether the last instruction enabled interrupts (`sei`, `reti`, SREG), in which case one
    /// more instruction is executed before any is taken (DS40002061B, 7.7).
    pub fn take_interrupt_shadow(&mut self) -> bool {
        // SAFETY: a plain field access of a valid `avr_t`. simavr marks the shadow with -1.
        unsafe {
            let state = &mut (*self.avr()).interrupt_state;
            let shadow = *state < 0;
            *state = 0;
            shadow
        }
    }

    /// The lowest pending and enabled vector of simavr's own peripherals.
    pub fn foreign_vector(&self) -> Option<u8> {
        // SAFETY: `pending` is simavr's ring of 64 vectors; entries from `read` to `write` point
        // at vectors inside the same core allocation. The masks are those of the ring. A register
        // number in `enable` is an address in data memory, which has DATA_BYTES bytes.
        unsafe {
            let avr = self.avr();
            let pending = &(*avr).interrupts.pending;
            let mut lowest = None;
            let mut at = pending.read;
            while at != pending.write {
                let vector = pending.buffer[usize::from(at) % 64];
                at = (at + 1) % 64;
                let enable = (*vector).enable;
                let register = *(*avr).data.add(enable.reg() as usize % DATA_BYTES);
                let enabled = u32::from(register) >> enable.bit() & enable.mask() != 0;
                if (*vector).pending() != 0 && enabled {
                    let number = (*vector).vector;
                    lowest = Some(lowest.map_or(number, |low: u8| low.min(number)));
                }
            }
            lowest
        }
    }

    /// Lets simavr enter the lowest of its own pending vectors.
    pub fn service_foreign(&mut self) {
        // SAFETY: `avr` is valid and no reference into it is alive. A positive state is simavr's
        // mark for "something is pending", which `foreign_vector` has just seen.
        unsafe {
            (*self.avr()).interrupt_state = 1;
            avr_service_interrupts(self.avr());
            (*self.avr()).interrupt_state = 0;
        }
    }

    /// Pushes the program counter, clears I and jumps to `vector` (0 is reset).
    pub fn enter_vector(&mut self, vector: u8) {
        let avr = self.avr();
        // SAFETY: `avr` is valid; the push goes through simavr's own bounds check.
        unsafe {
            _avr_push_addr(avr, (*avr).pc);
            (*avr).sreg[SREG_I] = 0;
            (*avr).interrupt_state = 0;
            (*avr).pc = u32::from(vector) * u32::from((*avr).vector_size);
        }
    }

    /// Whether the last instruction was a `sleep`.
    pub fn is_sleeping(&self) -> bool {
        // SAFETY: a plain field read of a valid `avr_t`.
        unsafe { (*self.avr()).state == cpu_Sleeping as c_int }
    }

    /// Ends the sleep.
    pub fn wake(&mut self) {
        // SAFETY: a plain field write of a valid `avr_t`.
        unsafe { (*self.avr()).state = cpu_Running as c_int }
    }

    /// Whether the core runs or sleeps; false once simavr has stopped it for good.
    pub fn is_alive(&self) -> bool {
        // SAFETY: a plain field read of a valid `avr_t`.
        let state = unsafe { (*self.avr()).state };
        state == cpu_Running as c_int || state == cpu_Sleeping as c_int
    }

    /// A reset; `cycle` goes on counting.
    pub fn reset(&mut self) {
        let cycle = self.cycle();
        // simavr's own watchdog would start with the flag of a watchdog reset.
        self.data_mut()[0x54] = 0;
        // SAFETY: `avr` is valid and no reference into it is alive.
        unsafe { avr_reset(self.avr()) }
        self.set_cycle(cycle);
    }

    /// Data memory: 32 registers, I/O as last written, SRAM.
    pub fn data(&self) -> &[u8] {
        // SAFETY: avr_init allocated `ramend + 1` = DATA_BYTES bytes, freed only on drop; nothing
        // writes to them while `self` is borrowed.
        unsafe { std::slice::from_raw_parts((*self.avr()).data, DATA_BYTES) }
    }

    /// The data memory, mutable.
    pub fn data_mut(&mut self) -> &mut [u8] {
        // SAFETY: as above, and `&mut self` makes the borrow unique.
        unsafe { std::slice::from_raw_parts_mut((*self.avr()).data, DATA_BYTES) }
    }

    /// The stack pointer.
    pub fn sp(&self) -> u16 {
        u16::from_le_bytes([self.data()[SPL], self.data()[SPL + 1]])
    }
}

impl<P: Peripherals> Drop for Core<P> {
    fn drop(&mut self) {
        // SAFETY: both pointers are owned (type invariant) and used for the last time. simavr's
        // own entries go back into `bit_io` because avr_terminate frees what hangs on them.
        // avr_terminate frees what avr_init allocated; the core itself came from malloc in
        // avr_core_allocate.
        unsafe {
            (*self.avr()).bit_io = self.saved_bit_io;
            (*self.avr()).io_port = (*self.module.as_ptr()).io.next;
            drop(Box::from_raw(self.module.as_ptr()));
            avr_terminate(self.avr());
            free(self.avr().cast());
            drop(Box::from_raw(self.periph.as_ptr()));
        }
    }
}

/// The opcode at a byte address.
///
/// # Safety
/// `avr` is valid, and `pc` is inside its flash.
unsafe fn opcode_at(avr: *mut avr_t, pc: u32) -> u16 {
    let at = pc as usize & (FLASH_BYTES - 2);
    // SAFETY: `at` is even and below FLASH_BYTES, the size of the allocation.
    unsafe { u16::from_le_bytes([*(*avr).flash.add(at), *(*avr).flash.add(at + 1)]) }
}

unsafe extern "C" fn on_read<P: Peripherals>(
    avr: *mut avr_t,
    address: avr_io_addr_t,
    param: *mut c_void,
) -> u8 {
    // SAFETY: called from avr_run_one inside `Core::run`: `avr` is valid and `param` is the
    // core's `periph`, to which no other reference is alive.
    unsafe {
        let opcode = opcode_at(avr, (*avr).pc);
        // `in` is 1011_0xxx, `cbi sbic sbi sbis` are 1001_10xx; the others read in cycle 2.
        let first_cycle = opcode & 0xf800 == 0xb000 || opcode & 0xfc00 == 0x9800;
        let at = (*avr).cycle + u64::from(!first_cycle);
        (*param.cast::<P>()).read(address, at)
    }
}

unsafe extern "C" fn on_write<P: Peripherals>(
    avr: *mut avr_t,
    address: avr_io_addr_t,
    value: u8,
    param: *mut c_void,
) {
    // SAFETY: as in `on_read`. `address` is one of `P::REGISTERS`, inside data memory.
    unsafe {
        let out = opcode_at(avr, (*avr).pc) & 0xf800 == 0xb800;
        let at = (*avr).cycle + if out { 1 } else { 2 };
        (*avr).cycle += (*param.cast::<P>()).write(address, value, at);
        *(*avr).data.add(usize::from(address)) = value;
        // The write may have changed what comes next: end the burst after this instruction.
        (*avr).run_cycle_count = 0;
    }
}

unsafe extern "C" fn on_bit_write<P: Peripherals>(
    avr: *mut avr_t,
    bit: u8,
    value: u8,
    param: *mut c_void,
) -> c_int {
    // SAFETY: as in `on_read`.
    unsafe {
        // The callback is not told the address; it is in the opcode, 1001_10x0_AAAA_Abbb.
        let opcode = opcode_at(avr, (*avr).pc);
        let address = IO_BASE + (opcode >> 3 & 0x1f);
        let at = (*avr).cycle + 2;
        (*avr).cycle += (*param.cast::<P>()).write_bit(address, bit, value != 0, at);
        (*avr).run_cycle_count = 0;
    }
    1
}

unsafe extern "C" fn on_ioctl<P: Peripherals>(
    io: *mut avr_io_t,
    ctl: u32,
    _param: *mut c_void,
) -> c_int {
    if ctl != WATCHDOG_RESET {
        return -1;
    }
    // SAFETY: called from avr_run_one inside `Core::run`; `io` is the first field of the core's own module, and no other
    // reference to its `periph` is alive.
    unsafe {
        let at = (*(*io).avr).cycle;
        (*(*io.cast::<Module<P>>()).periph.as_ptr()).watchdog_reset(at + 1);
    }
    0
}

unsafe extern "C" fn on_bad_opcode<P: Peripherals>(
    _irq: *mut avr_irq_t,
    _value: u32,
    param: *mut c_void,
) {
    // SAFETY: as in `on_read`.
    unsafe { (*param.cast::<P>()).bad_opcode() }
}
