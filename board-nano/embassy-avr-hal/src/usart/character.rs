//! The receive interrupt, which runs once per character on the bus.
//!
//! At 1 Mbaud a character takes 160 cycles. The common case, the next good character of a frame, is therefore written by
//! hand: it stores the byte, steps the CRC and moves the end of the silence on. The same in Rust comes out half as long
//! again from LLVM. The line's state machine decides every other case, in Rust; the common case does not save registers for
//! it.

use core::arch::asm;
use core::cell::UnsafeCell;

use multidrop_protocol::crc;
use multidrop_protocol::frame::Received;
use multidrop_protocol::rtu::Reception;

use super::settings::Framings;
use super::state::{ADU, SHARED};
use crate::gpio::DriverEnable;

/// The state that the interrupt uses for every character, in one place.
#[repr(C)]
pub(super) struct Hot {
    /// Bytes stored, modulo 256.
    len: u8,
    crc: [u8; 2],
    /// 1 when 256 bytes are stored.
    full: u8,
    /// Ticks from a character to the end of the silence that completes its frame.
    pub to_complete: u16,
}

/// The cell of [`Hot`], for the line's interrupts and for code with interrupts off.
pub(super) struct HotCell(UnsafeCell<Hot>);

// SAFETY: as for `SHARED`.
unsafe impl Sync for HotCell {}

pub(super) static HOT: HotCell = HotCell(UnsafeCell::new(Hot {
    len: 0,
    crc: [0; 2],
    full: 0,
    to_complete: 0,
}));

impl Hot {
    /// Gives the one [`Hot`] of the line.
    ///
    /// # Safety
    /// In an interrupt of the line, or with interrupts off; one reference at a time.
    #[inline(always)]
    pub unsafe fn get() -> &'static mut Hot {
        // SAFETY: the caller keeps the rules above.
        unsafe { &mut *HOT.0.get() }
    }

    /// Prepares for the first byte of a frame.
    #[inline(always)]
    pub fn restart(&mut self) {
        self.len = 0;
        self.crc = crc::INIT.to_le_bytes();
        self.full = 0;
    }

    /// Whether another byte would not fit.
    #[inline(always)]
    pub fn is_full(&self) -> bool {
        self.full != 0
    }

    /// The received bytes, taken for a whole frame.
    #[inline(always)]
    pub fn finish(&self) -> Received {
        Reception::from_parts(u16::from_le_bytes(self.crc), self.len, self.is_full()).finish()
    }
}

/// GPIOR1 (DS 8.6.5), within reach of `in` and `out`: not 0 if the next character needs more than to be
/// stored, because it begins a frame, comes out of turn, belongs to a damaged frame, does not fit, or is of
/// an ASCII frame.
const ATTENTION: *mut u8 = 0x4A as *mut u8;

/// Sets or clears the flag for the next character.
#[inline(always)]
pub(crate) fn set_attention(needed: bool) {
    // SAFETY: a plain storage register, used by the line only.
    unsafe { ATTENTION.write_volatile(needed as u8) }
}

/// Handles the interrupt USART Receive Complete.
///
/// # Safety
/// Only the interrupt USART Receive Complete may call this.
#[inline(always)]
pub(super) unsafe fn on_character<DE: DriverEnable, F: Framings>() {
    // SAFETY: this touches the registers of the line and the contents of `Hot` and `ADU`. Only a frame without errors is
    // stored, and a frame that begins while the buffer is not free has an error. Around the call this saves the
    // registers that the calling convention lets a function change, except those declared below; the interrupt saves r0
    // and SREG.
    unsafe {
        asm!(
            // OCR1B = TCNT1 + to_complete, low byte read first, high byte written first (DS 16.3).
            "lds r24, 0x84",
            "lds r25, 0x85",
            "lds r18, {hot}+4",
            "add r24, r18",
            "lds r18, {hot}+5",
            "adc r25, r18",
            "sts 0x8B, r25",
            "sts 0x8A, r24",
            // Clears OCF1B in TIFR1 and PCIF2 in PCIFR, bit 2 in both.
            "ldi r18, 4",
            "out 0x16, r18",
            "out 0x1B, r18",
            // FE, DOR and UPE of UCSR0A, before UDR0 is read (DS 20.11.1); GPIOR1.
            "lds r24, 0xC0",
            "andi r24, 0x1C",
            "in r25, 0x2A",
            "or r25, r24",
            "brne 3f",
            // Store the byte.
            "lds r19, 0xC6",
            "2: lds r24, {hot}",
            "mov r26, r24",
            "ldi r27, 0",
            "subi r26, lo8(-({adu}))",
            "sbci r27, hi8(-({adu}))",
            "st X, r19",
            "inc r24",
            "sts {hot}, r24",
            "breq 4f",
            // The CRC. a = low ^ byte, p = the parity of a.
            "5: lds r24, {hot}+1",
            "eor r24, r19",
            "mov r18, r24",
            "swap r18",
            "eor r18, r24",
            "mov r19, r18",
            "lsr r19",
            "lsr r19",
            "eor r18, r19",
            "mov r19, r18",
            "lsr r19",
            "eor r18, r19",
            "andi r18, 1",
            // new = high ^ p ^ (pa << 7) ^ (pa << 6), where pa is a with p in front.
            "lds r25, {hot}+2",
            "eor r25, r18",
            "lsr r18",
            "ror r24",
            "ror r18",
            "mov r19, r24",
            "eor r25, r18",
            "lsr r24",
            "ror r18",
            "eor r19, r24",
            "eor r25, r18",
            "sts {hot}+1, r25",
            "sts {hot}+2, r19",
            "rjmp 9f",
            // 256 bytes: the next one needs attention.
            "4: ldi r25, 1",
            "sts {hot}+3, r25",
            "out 0x2A, r25",
            "rjmp 5b",
            // Not the common case. The result tells whether there is a byte to store, and which byte.
            "3: push r20",
            "push r21",
            "push r22",
            "push r23",
            "push r30",
            "push r31",
            "call {unusual}",
            "pop r31",
            "pop r30",
            "pop r23",
            "pop r22",
            "pop r21",
            "pop r20",
            "mov r19, r25",
            "tst r24",
            "breq 9f",
            "rjmp 2b",
            "9:",
            hot = sym HOT,
            adu = sym ADU,
            unusual = sym on_unusual_character::<DE, F>,
            out("r18") _,
            out("r19") _,
            out("r24") _,
            out("r25") _,
            out("X") _,
        );
    }
}

/// Handles a character for [`on_character`] with the error bits of UCSR0A. If the lower half of the result is not 0, the upper half
/// is to be stored. If that byte is an earlier one, the new one is still in the USART, and RXC calls again (DS 20.7.3).
extern "C" fn on_unusual_character<DE: DriverEnable, F: Framings>(errors: u8) -> u16 {
    // SAFETY: in the interrupt.
    match unsafe { &mut *SHARED.get() }.on_unusual_character::<DE, F>(errors) {
        Some(byte) => u16::from_le_bytes([1, byte]),
        None => 0,
    }
}
