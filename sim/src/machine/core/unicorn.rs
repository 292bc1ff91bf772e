//! Unicorn's Cortex-M4 behind a safe face: the second module with `unsafe` in it, as `ffi.rs` is for simavr.
//!
//! Unicorn (GPL-2.0) is loaded when the first core is made and never linked. It has the instructions and the memories;
//! peripherals, interrupts and time are those of a [`Board`], which is asked before every instruction and about every access to
//! what it has.
//!
//! The functions and constants are those of `unicorn.h` and `arm.h` of version 2.1.

use std::cell::UnsafeCell;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::path::Path;

use libloading::Library;

use crate::error::BusError;

/// What is asked before an instruction is answered with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Flow {
    /// It is executed.
    Go,
    /// The core stops in front of it.
    Stop,
}

/// What the core is wired to.
pub(super) trait Board: 'static {
    /// The core is about to execute the instruction at `address`.
    fn before(&mut self, address: u32, core: &Registers<'_>) -> Flow;
    /// A load of `size` bytes.
    fn read(&mut self, address: u32, size: u32) -> u32;
    /// A store of `size` bytes.
    fn write(&mut self, address: u32, size: u32, value: u32);
    /// A store to memory that is [guarded](Core::guard). It is carried out all the same.
    fn forbidden(&mut self, address: u32) -> Flow;
}

/// A register of the core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Register {
    /// R0 to R12.
    R(u8),
    Sp,
    Lr,
    Pc,
    /// Flags, and the exception number, which is always 0 here.
    Xpsr,
    /// S0 to S31.
    S(u8),
    Fpscr,
    Primask,
    Basepri,
    Faultmask,
}

impl Register {
    /// The number in `uc_arm_reg`.
    fn number(self) -> c_int {
        match self {
            Register::R(number) => 66 + c_int::from(number),
            Register::Sp => 12,
            Register::Lr => 10,
            Register::Pc => 11,
            Register::Xpsr => 120,
            Register::S(number) => 79 + c_int::from(number),
            Register::Fpscr => 6,
            Register::Primask => 123,
            Register::Basepri => 124,
            Register::Faultmask => 126,
        }
    }
}

/// Why the core stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stand {
    /// The board has stopped it, or it fetched from where nothing can be.
    Stopped,
    /// An instruction that it cannot execute: Unicorn's number for the reason.
    Failed(c_int),
}

type Uc = *mut c_void;
type Error = c_int;

/// `uc_arch`, `uc_mode`, `uc_err`, `uc_hook_type`, `uc_control_type`, `uc_prot`.
const ARCH_ARM: c_int = 1;
const MODE_THUMB_M: c_int = 1 << 4 | 1 << 5;
const OK: Error = 0;
const HOOK_CODE: c_int = 1 << 2;
const HOOK_MEM_WRITE: c_int = 1 << 11;
/// A write with one argument of the model of the CPU.
const CTL_CPU_MODEL: c_int = 7 | 1 << 26 | 1 << 30;
const CPU_CORTEX_M4: c_int = 9;
/// A write without arguments: what was translated is translated again.
const CTL_TB_FLUSH: c_int = 10 | 1 << 30;
const PROT_READ: u32 = 1;
const PROT_EXEC: u32 = 4;
const PROT_ALL: u32 = 7;

/// Up to where it may run: nowhere.
const NEVER: u64 = 0xFFFF_FFFF;

type MmioRead = extern "C" fn(Uc, u64, u32, *mut c_void) -> u64;
type MmioWrite = extern "C" fn(Uc, u64, u32, u64, *mut c_void);

/// The functions of the library that are used here.
struct Api {
    strerror: unsafe extern "C" fn(Error) -> *const c_char,
    open: unsafe extern "C" fn(c_int, c_int, *mut Uc) -> Error,
    close: unsafe extern "C" fn(Uc) -> Error,
    ctl: unsafe extern "C" fn(Uc, c_int, ...) -> Error,
    mem_map: unsafe extern "C" fn(Uc, u64, u64, u32) -> Error,
    mem_read: unsafe extern "C" fn(Uc, u64, *mut c_void, u64) -> Error,
    mem_write: unsafe extern "C" fn(Uc, u64, *const c_void, u64) -> Error,
    mmio_map:
        unsafe extern "C" fn(Uc, u64, u64, MmioRead, *mut c_void, MmioWrite, *mut c_void) -> Error,
    hook_add: unsafe extern "C" fn(
        Uc,
        *mut usize,
        c_int,
        *mut c_void,
        *mut c_void,
        u64,
        u64,
        ...
    ) -> Error,
    hook_del: unsafe extern "C" fn(Uc, usize) -> Error,
    reg_read: unsafe extern "C" fn(Uc, c_int, *mut c_void) -> Error,
    reg_write: unsafe extern "C" fn(Uc, c_int, *const c_void) -> Error,
    emu_start: unsafe extern "C" fn(Uc, u64, u64, u64, usize) -> Error,
    emu_stop: unsafe extern "C" fn(Uc) -> Error,
    /// Loaded as long as its functions are used.
    _library: Library,
}

impl Api {
    fn load(path: &Path) -> Result<Self, libloading::Error> {
        // SAFETY: the library's initialisation asks for nothing, and the types are those of unicorn.h.
        unsafe {
            let library = Library::new(path)?;
            Ok(Api {
                strerror: *library.get(b"uc_strerror\0")?,
                open: *library.get(b"uc_open\0")?,
                close: *library.get(b"uc_close\0")?,
                ctl: *library.get(b"uc_ctl\0")?,
                mem_map: *library.get(b"uc_mem_map\0")?,
                mem_read: *library.get(b"uc_mem_read\0")?,
                mem_write: *library.get(b"uc_mem_write\0")?,
                mmio_map: *library.get(b"uc_mmio_map\0")?,
                hook_add: *library.get(b"uc_hook_add\0")?,
                hook_del: *library.get(b"uc_hook_del\0")?,
                reg_read: *library.get(b"uc_reg_read\0")?,
                reg_write: *library.get(b"uc_reg_write\0")?,
                emu_start: *library.get(b"uc_emu_start\0")?,
                emu_stop: *library.get(b"uc_emu_stop\0")?,
                _library: library,
            })
        }
    }

    fn check(&self, what: &str, error: Error) -> Result<(), BusError> {
        if error == OK {
            return Ok(());
        }
        Err(BusError::Machine {
            reason: format!("Unicorn: {what}: {}", self.text(error)),
        })
    }

    fn text(&self, error: Error) -> String {
        // SAFETY: a constant text for every number.
        let text = unsafe { CStr::from_ptr((self.strerror)(error)) };
        text.to_string_lossy().into_owned()
    }
}

/// The registers, for the board while the core stands in front of an instruction.
pub(super) struct Registers<'a> {
    api: &'a Api,
    uc: Uc,
}

impl Registers<'_> {
    /// One of them.
    pub fn get(&self, register: Register) -> u32 {
        let mut value = 0_u32;
        // SAFETY: every register of `Register` has 32 bits.
        unsafe { (self.api.reg_read)(self.uc, register.number(), (&raw mut value).cast()) };
        value
    }
}

/// What the callbacks get.
struct Wired<B> {
    board: B,
    api: Api,
}

/// A core and its board.
pub(super) struct Core<B: Board> {
    uc: Uc,
    /// Shared with the callbacks, which only run within [`Core::run`]: nothing else is borrowed of it then.
    wired: Box<UnsafeCell<Wired<B>>>,
    /// Where the board's registers begin, for the callbacks: they are told the distance from it.
    _windows: Box<[Window<B>]>,
    /// Of guarded memory.
    guards: Vec<usize>,
}

/// Registers of the board in the core's memory.
struct Window<B> {
    first: u32,
    wired: *const UnsafeCell<Wired<B>>,
}

extern "C" fn before<B: Board>(uc: Uc, address: u64, _size: u32, wired: *mut c_void) {
    // SAFETY: `wired` is the core's, and `run`, which is under way, borrows nothing of it.
    let Wired { board, api } = unsafe { &mut *wired.cast::<Wired<B>>() };
    if board.before(address as u32, &Registers { api, uc }) == Flow::Stop {
        // SAFETY: as unicorn.h has it, from a callback.
        unsafe { (api.emu_stop)(uc) };
    }
}

extern "C" fn forbidden<B: Board>(
    uc: Uc,
    _kind: c_int,
    address: u64,
    _size: c_int,
    _value: i64,
    wired: *mut c_void,
) {
    // SAFETY: as in `before`.
    let Wired { board, api } = unsafe { &mut *wired.cast::<Wired<B>>() };
    if board.forbidden(address as u32) == Flow::Stop {
        // SAFETY: as in `before`.
        unsafe { (api.emu_stop)(uc) };
    }
}

extern "C" fn read<B: Board>(_: Uc, offset: u64, size: u32, window: *mut c_void) -> u64 {
    // SAFETY: as in `before`.
    let (window, wired) = unsafe {
        let window = &*window.cast::<Window<B>>();
        (window, &mut *UnsafeCell::raw_get(window.wired))
    };
    u64::from(wired.board.read(window.first + offset as u32, size))
}

extern "C" fn write<B: Board>(_: Uc, offset: u64, size: u32, value: u64, window: *mut c_void) {
    // SAFETY: as in `before`.
    let (window, wired) = unsafe {
        let window = &*window.cast::<Window<B>>();
        (window, &mut *UnsafeCell::raw_get(window.wired))
    };
    let address = window.first + offset as u32;
    wired.board.write(address, size, value as u32);
}

/// Memory of the core.
#[derive(Clone, Copy, Debug)]
pub(super) struct Memory {
    pub first: u32,
    pub bytes: u32,
    /// It is only read and executed.
    pub fixed: bool,
}

impl<B: Board> Core<B> {
    /// A core with these memories, whose board has the registers from `first`, `bytes` of them, for each of `windows`.
    ///
    /// # Errors
    /// [`BusError::Machine`], where the library cannot be loaded or is another one.
    pub fn new(
        library: &Path,
        board: B,
        memories: &[Memory],
        windows: &[(u32, u32)],
    ) -> Result<Self, BusError> {
        let api = Api::load(library).map_err(|error| BusError::Machine {
            reason: format!("{}: {error}", library.display()),
        })?;
        let wired = Box::new(UnsafeCell::new(Wired { board, api }));
        let mut core = Core {
            uc: std::ptr::null_mut(),
            wired,
            _windows: Box::default(),
            guards: Vec::new(),
        };
        // SAFETY: calls as in unicorn.h; what the callbacks are given lives in boxes as long as the core.
        unsafe {
            let api = &(*core.wired.get()).api;
            api.check("open", (api.open)(ARCH_ARM, MODE_THUMB_M, &mut core.uc))?;
            let model = (api.ctl)(core.uc, CTL_CPU_MODEL, CPU_CORTEX_M4);
            api.check("Cortex-M4", model)?;
            for memory in memories {
                let rights = if memory.fixed {
                    PROT_READ | PROT_EXEC
                } else {
                    PROT_ALL
                };
                let (first, bytes) = (memory.first.into(), memory.bytes.into());
                api.check("map", (api.mem_map)(core.uc, first, bytes, rights))?;
            }
            let wired = &raw const *core.wired;
            let known = windows.iter().map(|&(first, _)| Window { first, wired });
            core._windows = known.collect();
            for (&(first, bytes), window) in windows.iter().zip(&core._windows) {
                let told: *mut c_void = (&raw const *window).cast_mut().cast();
                let mapped = (api.mmio_map)(
                    core.uc,
                    first.into(),
                    bytes.into(),
                    read::<B>,
                    told,
                    write::<B>,
                    told,
                );
                api.check("map", mapped)?;
            }
            let mut hook = 0;
            let callback: extern "C" fn(Uc, u64, u32, *mut c_void) = before::<B>;
            let hooked = (api.hook_add)(
                core.uc,
                &mut hook,
                HOOK_CODE,
                callback as *mut c_void,
                core.wired.get().cast(),
                // All addresses.
                1,
                0,
            );
            api.check("hook", hooked)?;
        }
        Ok(core)
    }

    fn api(&self) -> &Api {
        // SAFETY: it is never changed.
        unsafe { &(*self.wired.get()).api }
    }

    /// The board around the core.
    pub fn board(&self) -> &B {
        // SAFETY: the callbacks run within `run` only, which borrows all of the core.
        unsafe { &(*self.wired.get()).board }
    }

    /// The board around the core, mutable.
    pub fn board_mut(&mut self) -> &mut B {
        // SAFETY: as in `board`.
        unsafe { &mut (*self.wired.get()).board }
    }

    /// From now on stores to this memory are told, and to no other: first and last address of each piece.
    pub fn guard(&mut self, pieces: &[(u32, u32)]) {
        if self.guards.is_empty() && pieces.is_empty() {
            return;
        }
        for hook in std::mem::take(&mut self.guards) {
            // SAFETY: it was added below.
            unsafe { (self.api().hook_del)(self.uc, hook) };
        }
        for &(first, last) in pieces {
            let mut hook = 0;
            let callback: extern "C" fn(Uc, c_int, u64, c_int, i64, *mut c_void) = forbidden::<B>;
            let wired = self.wired.get();
            // SAFETY: as in `new`.
            unsafe {
                let add = (*wired).api.hook_add;
                let callback = callback as *mut c_void;
                let (first, last) = (first.into(), last.into());
                let kind = HOOK_MEM_WRITE;
                add(
                    self.uc,
                    &mut hook,
                    kind,
                    callback,
                    wired.cast(),
                    first,
                    last,
                );
            }
            self.guards.push(hook);
        }
        // SAFETY: as unicorn.h has it, while the core stands.
        unsafe { (self.api().ctl)(self.uc, CTL_TB_FLUSH) };
    }

    /// Executes instructions from `address` on until the board says stop.
    pub fn run(&mut self, address: u32) -> Stand {
        // The lowest bit says that it is Thumb code.
        let (begin, wired) = (u64::from(address | 1), self.wired.get());
        // SAFETY: `wired` outlives the call, in which the callbacks alone use the board. Of the functions only a copy is used.
        let error = unsafe {
            let start = (*wired).api.emu_start;
            start(self.uc, begin, NEVER, 0, 0)
        };
        match error {
            OK => Stand::Stopped,
            error => Stand::Failed(error),
        }
    }

    /// What [`Stand::Failed`] means.
    pub fn reason(&self, error: c_int) -> String {
        self.api().text(error)
    }

    /// The value of a register.
    pub fn get(&self, register: Register) -> u32 {
        let (api, uc) = (self.api(), self.uc);
        Registers { api, uc }.get(register)
    }

    /// Sets a register.
    pub fn set(&mut self, register: Register, value: u32) {
        // SAFETY: every register of `Register` has 32 bits.
        unsafe {
            (self.api().reg_write)(self.uc, register.number(), (&raw const value).cast());
        }
    }

    /// Reads memory; `None` where there is none.
    pub fn load<const N: usize>(&self, address: u32) -> Option<[u8; N]> {
        let mut bytes = [0; N];
        let (at, len) = (address.into(), N as u64);
        // SAFETY: `bytes` has `len` bytes.
        let error = unsafe { (self.api().mem_read)(self.uc, at, bytes.as_mut_ptr().cast(), len) };
        (error == OK).then_some(bytes)
    }

    /// Writes memory, fixed too; whether there is some.
    pub fn store(&mut self, address: u32, bytes: &[u8]) -> bool {
        let (at, len) = (address.into(), bytes.len() as u64);
        // SAFETY: `bytes` has `len` bytes.
        unsafe { (self.api().mem_write)(self.uc, at, bytes.as_ptr().cast(), len) == OK }
    }
}

impl<B: Board> Drop for Core<B> {
    fn drop(&mut self) {
        if !self.uc.is_null() {
            // SAFETY: it is open, and not used again.
            unsafe { (self.api().close)(self.uc) };
        }
    }
}
