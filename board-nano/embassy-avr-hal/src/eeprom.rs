//! The EEPROM: 1024 bytes, written in the background (DS 8.4).
//!
//! A byte takes 3.4 ms to write; the EEPROM-ready interrupt wakes the task for the next one. Bytes
//! that already have the right value are skipped, since each cell endures 100 000 writes. `EEPROM` in
//! [`bind_interrupts!`](crate::bind_interrupts) binds the interrupt.
//!
//! [`Eeprom::read`] and [`Eeprom::write`] are async; with the traits of `embedded-storage` it reads and writes blocking.

use core::arch::asm;
use core::future::poll_fn;
use core::task::Poll;

use embassy_sync::waitqueue::AtomicWaker;
use embedded_storage::{ReadStorage, Storage};

use crate::pac::EEPROM;

/// Bytes of EEPROM in an ATmega328P.
pub const SIZE: u16 = 1024;

/// Bits of EECR (DS 8.6.3).
const EEMPE: u8 = 1 << 2;
const EEPE: u8 = 1 << 1;
const EERE: u8 = 1 << 0;

static READY: AtomicWaker = AtomicWaker::new();

/// An address range that is not within the EEPROM. The caller is to blame; nothing was read or written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutOfRange {
    /// The first address of the request.
    pub address: u16,
    /// The number of bytes of the request.
    pub len: usize,
}

/// Says that the interrupt of the EEPROM is bound. [`bind_interrupts!`](crate::bind_interrupts) implements it.
///
/// # Safety
/// The handler must be in the binary.
#[diagnostic::on_unimplemented(
    message = "the interrupt of the EEPROM is not bound: name EEPROM in bind_interrupts!",
    label = "writing needs an interrupt that `{Self}` does not bind"
)]
pub unsafe trait Bound {}

/// The EEPROM of the chip.
pub struct Eeprom {
    registers: EEPROM,
}

impl Eeprom {
    /// Takes the peripheral, and the token that its interrupt is bound.
    pub fn new(registers: EEPROM, _: impl Bound) -> Self {
        Self { registers }
    }

    /// Reads `into.len()` bytes from `address` on; 4 cycles each once no write is under way.
    ///
    /// # Errors
    /// [`OutOfRange`].
    pub async fn read(&mut self, address: u16, into: &mut [u8]) -> Result<(), OutOfRange> {
        check(address, into.len())?;
        for (address, byte) in (address..).zip(into) {
            self.ready().await;
            *byte = self.get(address);
        }
        Ok(())
    }

    /// Writes `bytes` from `address` on, 3.4 ms for each byte that differs; returns when the last byte is stored.
    ///
    /// # Errors
    /// [`OutOfRange`].
    ///
    /// # Cancellation
    /// The byte under way is completed; the bytes after it keep their old value.
    pub async fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), OutOfRange> {
        check(address, bytes.len())?;
        for (address, &byte) in (address..).zip(bytes) {
            self.ready().await;
            self.renew(address, byte);
        }
        self.ready().await;
        Ok(())
    }

    /// Waits until no write is under way.
    async fn ready(&mut self) {
        poll_fn(|context| {
            if !self.is_writing() {
                return Poll::Ready(());
            }
            READY.register(context.waker());
            interrupt_when_ready(true);
            Poll::Pending
        })
        .await;
    }

    /// Blocks until no write is under way.
    fn block(&mut self) {
        while self.is_writing() {}
    }

    /// Returns whether a byte is being written: EEPE (DS 8.6.3).
    fn is_writing(&self) -> bool {
        self.registers.eecr().read().bits() & EEPE != 0
    }

    /// Reads one byte; no write may be under way.
    fn get(&mut self, address: u16) -> u8 {
        // SAFETY: the address was checked.
        self.registers.eear().write(|w| unsafe { w.bits(address) });
        self.control(EERE);
        self.registers.eedr().read().bits()
    }

    /// Starts to write one byte, if another one is there; no write is under way.
    fn renew(&mut self, address: u16, byte: u8) {
        if self.get(address) != byte {
            self.put(byte);
        }
    }

    /// Starts to write one byte to the address of the last [`get`](Self::get).
    fn put(&mut self, byte: u8) {
        // SAFETY: any byte may be written.
        self.registers.eedr().write(|w| unsafe { w.bits(byte) });
        critical_section::with(|_| {
            // EEPE within four cycles of EEMPE, interrupts off (DS 8.6.3).
            self.control(EEMPE);
            self.control(EEMPE | EEPE);
        });
    }

    /// Writes EECR while no write is under way: then a 0 in EEPE has no effect (DS 8.6.3).
    fn control(&self, bits: u8) {
        // SAFETY: mode bits 0: erase and write in one operation; the rest as named above.
        self.registers.eecr().write(|w| unsafe { w.bits(bits) });
    }

    /// The interrupt handler, called by [`bind_interrupts!`](crate::bind_interrupts).
    ///
    /// # Safety
    /// From the EE READY interrupt only.
    #[doc(hidden)]
    pub unsafe fn on_ready() {
        interrupt_when_ready(false);
        READY.wake();
    }
}

/// Blocks, awake, without interrupts: for use before the executor runs, and for drivers that take any storage.
///
/// An error names an offset above 65535 as address 65535.
impl ReadStorage for Eeprom {
    type Error = OutOfRange;

    /// Reads `bytes.len()` bytes from `offset` on. It blocks for 3.4 ms at most, if a write of before is under way.
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), OutOfRange> {
        let address = within(offset, bytes.len())?;
        for (address, byte) in (address..).zip(bytes) {
            self.block();
            *byte = self.get(address);
        }
        Ok(())
    }

    /// Returns the number of bytes, [`SIZE`].
    fn capacity(&self) -> usize {
        usize::from(SIZE)
    }
}

/// Blocks like [`ReadStorage`], and needs no interrupt.
impl Storage for Eeprom {
    /// Writes `bytes` from `offset` on, 3.4 ms each where they differ; returns when the last one is safe. If power is lost, the byte
    /// under way is erased, and those behind it keep their old value.
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), OutOfRange> {
        let address = within(offset, bytes.len())?;
        for (address, &byte) in (address..).zip(bytes) {
            self.block();
            self.renew(address, byte);
        }
        self.block();
        Ok(())
    }
}

/// Enables or disables the EE READY interrupt, which comes as soon as no write is under way. It is level-triggered
/// (DS 8.6.3, EERIE): if the write has ended before, it comes at once. `sbi` and `cbi` change this one bit (DS, notes
/// to the register summary): a write of the whole register would put a 0 into EEPE while a byte is being written.
fn interrupt_when_ready(on: bool) {
    // SAFETY: EERIE, bit 3 of EECR (I/O 0x1F), is used here only.
    unsafe {
        if on {
            asm!("sbi 0x1F, 3", options(nomem, nostack, preserves_flags));
        } else {
            asm!("cbi 0x1F, 3", options(nomem, nostack, preserves_flags));
        }
    }
}

/// Returns `offset` as an address, if `len` bytes from there on are within the EEPROM.
fn within(offset: u32, len: usize) -> Result<u16, OutOfRange> {
    let address = u16::try_from(offset).unwrap_or(u16::MAX);
    check(address, len).map(|()| address)
}

fn check(address: u16, len: usize) -> Result<(), OutOfRange> {
    if address > SIZE || len > usize::from(SIZE - address) {
        return Err(OutOfRange { address, len });
    }
    Ok(())
}
