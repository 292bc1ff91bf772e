//! What the interrupts and the futures of the line share, and the rules by which a frame passes.
//!
//! Four interrupts and the futures, with interrupts off, are the only users of [`State`].

use core::cell::UnsafeCell;

use embassy_sync::waitqueue::AtomicWaker;
use multidrop_firmware::line::Adu;
use multidrop_firmware::protocol::rtu::{Flaws, Transmission};

use super::character::{Hot, set_attention};
use super::registers::{self, Usart};
use super::settings::Settings;
use crate::gpio::DriverEnable;
use crate::timer1;

/// Where the wire is.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Phase {
    /// A frame is coming in; compare B ends it.
    Collecting,
    /// As above, and compare B came while a start bit had been seen: one more character is waited for.
    Begun,
    /// The frame is complete; compare B is set to t3.5.
    Quiet,
    /// As above, and a start bit was seen before t3.5.
    QuietBegun,
    /// t3.5 has passed.
    Silent,
    /// We are talking.
    Sending,
    /// We have talked; compare B is set to t3.5. A frame may begin: it is known where ours ended.
    Sent,
}

/// What became of the frame that was lent, or is about to be.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Verdict {
    None,
    Pending,
    Stands,
    Void,
}

/// Who has the buffer.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Buffer {
    /// The line: the next frame may be stored.
    Free,
    /// The line, and a complete frame of `len` bytes waits in it.
    Full,
    /// A [`Frame`](multidrop_firmware::Frame).
    Lent,
}

/// The buffer, apart from [`State`] so that it starts as zeros and takes no flash.
pub(super) struct AduCell(UnsafeCell<Adu>);

// SAFETY: [`State::buffer`] says who may use it.
unsafe impl Sync for AduCell {}

pub(super) static ADU: AduCell = AduCell(UnsafeCell::new([0; 256]));

impl AduCell {
    pub fn get(&self) -> *mut Adu {
        self.0.get()
    }
}

/// [`State`] of the one USART.
pub(super) struct Shared(UnsafeCell<State>);

// SAFETY: used by interrupts, which do not nest, and with interrupts off.
unsafe impl Sync for Shared {}

pub(super) static SHARED: Shared = Shared(UnsafeCell::new(State::new()));

impl Shared {
    pub fn get(&self) -> *mut State {
        self.0.get()
    }
}

pub(super) struct State {
    pub phase: Phase,
    pub verdict: Verdict,
    pub buffer: Buffer,
    /// Length of the frame in the buffer, without CRC.
    pub len: u8,
    /// Flaws of the frame on the wire.
    pub flaws: Flaws,
    /// Flaws of damaged frames not yet fetched.
    pub damaged: Flaws,
    /// Length of the answer that starts at t3.5; 0 for none.
    pub released: u8,
    /// The first byte of that answer, taken from `transmission` ahead of time.
    pub first: u8,
    /// A future waits for the verdict or for silence; nobody else needs to be woken at t3.5.
    pub silence_awaited: bool,
    pub transmission: Transmission,
    pub settings: Settings,
    /// Woken when there is a frame to fetch.
    pub receiver: AtomicWaker,
    /// Woken when a frame is settled, an answer sent, the wire silent.
    pub user: AtomicWaker,
}

impl State {
    pub const fn new() -> Self {
        Self {
            phase: Phase::Quiet,
            verdict: Verdict::None,
            buffer: Buffer::Free,
            len: 0,
            flaws: Flaws::NONE,
            damaged: Flaws::NONE,
            released: 0,
            first: 0,
            silence_awaited: false,
            transmission: Transmission::new(),
            settings: Settings {
                ubrr: 0,
                ucsra: 0,
                ucsrc: 0,
                to_complete: 0,
                to_stand: 0,
                character: 0,
                t3_5: 0,
            },
            receiver: AtomicWaker::new(),
            user: AtomicWaker::new(),
        }
    }

    /// Puts settings into the USART and listens: to nothing before t3.5 of silence, since a frame may
    /// be half over.
    pub fn apply(&mut self, settings: Settings) {
        self.settings = settings;
        registers::set_up(&settings);
        self.flaws = Flaws::NONE;
        if self.verdict == Verdict::Pending {
            self.verdict = Verdict::Void;
            self.user.wake();
        }
        self.phase = Phase::Quiet;
        set_attention(true);
        hot().to_complete = settings.to_complete;
        registers::clear_start_bit();
        self.alarm(settings.t3_5);
    }

    /// Sets compare B to `ticks` from now.
    fn alarm(&self, ticks: u16) {
        set_compare(timer1::now().wrapping_add(ticks));
        timer1::clear(timer1::OCF1B);
        timer1::enable(timer1::OCF1B);
    }

    /// A character that is not simply the next good one of its frame: whether it is to be stored.
    pub fn on_unusual_character(&mut self, errors: u8) -> bool {
        if self.phase != Phase::Collecting {
            self.out_of_turn();
        } else if hot().is_full() {
            self.flaws |= Flaws::LENGTH;
        }
        self.flaws |= registers::flaws(errors);
        // Only a frame without flaws is stored: one that is damaged may come while the buffer is lent.
        let sound = self.flaws.is_empty();
        set_attention(!sound);
        sound
    }

    /// A character that is not simply the next of its frame.
    #[inline(always)]
    fn out_of_turn(&mut self) {
        match self.phase {
            Phase::Quiet | Phase::QuietBegun => {
                // Between t1.5 and t3.5: what was complete is void, and this belongs to it.
                self.flaws |= Flaws::GAP;
                if self.verdict == Verdict::Pending {
                    self.verdict = Verdict::Void;
                }
            }
            Phase::Silent | Phase::Sent => {
                hot().restart();
                self.flaws = if self.buffer == Buffer::Free {
                    Flaws::NONE
                } else {
                    // The frame before is still being worked on.
                    Flaws::OVERRUN
                };
                timer1::enable(timer1::OCF1B);
            }
            Phase::Collecting | Phase::Begun | Phase::Sending => {}
        }
        self.phase = Phase::Collecting;
    }

    /// Timer1 Compare Match B: some silence is over.
    #[inline(always)]
    pub fn on_silence<DE: DriverEnable>(&mut self) {
        set_attention(true);
        match self.phase {
            Phase::Collecting | Phase::Begun => self.on_complete::<DE>(),
            Phase::Quiet | Phase::QuietBegun => self.on_stand::<DE>(),
            Phase::Sent => self.on_free(),
            Phase::Silent | Phase::Sending => timer1::disable(timer1::OCF1B),
        }
    }

    #[inline(always)]
    fn on_complete<DE: DriverEnable>(&mut self) {
        let mut rest = self.settings.to_stand;
        if self.phase == Phase::Begun {
            // The start bit was none: no character came of it.
            registers::clear_start_bit();
            rest = rest.saturating_sub(self.settings.character);
        } else if registers::start_bit_seen() {
            self.phase = Phase::Begun;
            advance_compare(self.settings.character);
            return;
        }
        self.phase = Phase::Quiet;
        if self.flaws.is_empty() {
            let heard = hot().finish();
            self.flaws = heard.flaws;
            if heard.flaws.is_empty() {
                self.len = heard.len;
                self.buffer = Buffer::Full;
                self.verdict = Verdict::Pending;
            }
        }
        if rest == 0 {
            self.on_stand::<DE>();
        } else {
            advance_compare(rest);
        }
        if self.verdict == Verdict::Pending {
            self.receiver.wake();
        }
    }

    #[inline(always)]
    fn on_stand<DE: DriverEnable>(&mut self) {
        if self.phase == Phase::QuietBegun {
            registers::clear_start_bit();
        } else if registers::start_bit_seen() {
            self.phase = Phase::QuietBegun;
            advance_compare(self.settings.character);
            return;
        }
        if self.verdict == Verdict::Pending {
            self.verdict = Verdict::Stands;
            if self.released > 0 {
                self.start::<DE>();
                if self.silence_awaited {
                    self.silence_awaited = false;
                    self.user.wake();
                }
                return;
            }
        }
        self.on_free();
    }

    /// t3.5 has passed on the wire.
    #[inline(always)]
    fn on_free(&mut self) {
        timer1::disable(timer1::OCF1B);
        self.phase = Phase::Silent;
        if !self.flaws.is_empty() {
            self.damaged |= self.flaws;
            self.flaws = Flaws::NONE;
            self.receiver.wake();
        }
        if self.silence_awaited || self.verdict == Verdict::Void {
            self.silence_awaited = false;
            self.user.wake();
        }
    }

    /// Gets an answer of `len` bytes ready to be started.
    pub fn prepare(&mut self, len: u8) {
        self.released = len;
        self.transmission.start(len);
        // SAFETY: as in `on_ready`.
        self.first = self.transmission.next(unsafe { &*ADU.get() }).unwrap_or(0);
    }

    /// Begins to send what is in the buffer. The receiver is off meanwhile: a transceiver that hears
    /// itself would otherwise fill it (DS 19.8.7: switching it off empties it).
    #[inline(never)]
    pub fn start<DE: DriverEnable>(&mut self) {
        DE::raise();
        registers::send(&self.settings);
        Usart::put(self.first);
        self.released = 0;
        self.phase = Phase::Sending;
        // The second character fits into the USART too; for the others it interrupts.
        if Usart::status() & registers::UDRE != 0 {
            self.on_ready();
        }
    }

    /// USART Data Register Empty.
    #[inline(always)]
    pub fn on_ready(&mut self) {
        // SAFETY: while an answer is sent, the bytes of it are only read.
        match self.transmission.next(unsafe { &*ADU.get() }) {
            Some(byte) => {
                Usart::put(byte);
                if self.transmission.is_over() {
                    // Had this interrupt come late, TXC would stand for the character before. The byte
                    // just written keeps it from being set anew for a whole character.
                    registers::clear_sent(&self.settings);
                }
            }
            None => registers::nothing_more(),
        }
    }

    /// USART Transmit Complete: the last stop bit has left, or the interrupt above came too late for a
    /// character in between, which is not the end.
    #[inline(always)]
    pub fn on_sent<DE: DriverEnable>(&mut self) {
        if !self.transmission.is_over() {
            return;
        }
        DE::lower();
        registers::listen();
        self.phase = Phase::Sent;
        self.alarm(self.settings.t3_5);
        self.user.wake();
    }
}

/// What the receive interrupt keeps.
#[inline(always)]
fn hot() -> &'static mut Hot {
    // SAFETY: `State` is used by the interrupts, or with interrupts off.
    unsafe { Hot::get() }
}

/// Sets OCR1B. A 16-bit register, written through TEMP: interrupts are off.
#[inline(always)]
fn set_compare(tick: u16) {
    // SAFETY: any value is a valid compare value.
    timer1::registers()
        .ocr1b()
        .write(|w| unsafe { w.bits(tick) });
}

/// Moves OCR1B on from where it matched: the intervals of one silence add up without drift.
#[inline(always)]
fn advance_compare(ticks: u16) {
    set_compare(
        timer1::registers()
            .ocr1b()
            .read()
            .bits()
            .wrapping_add(ticks),
    );
}
