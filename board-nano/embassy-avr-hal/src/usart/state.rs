//! The state that the interrupts and the futures of the line share: the state machine of
//! [`protocol::line`](multidrop_protocol::line), and this chip as its [`Wire`].
//!
//! Only four interrupts, and the futures with interrupts off, use this state.

use core::cell::UnsafeCell;
use core::marker::PhantomData;
use core::ptr::NonNull;

use multidrop_protocol::Adu;
use multidrop_protocol::frame::Received;
use multidrop_protocol::line::{Ascii, Interval, LineMachine, Wire};
use multidrop_protocol::timing::PART;

use super::character::{Hot, set_attention};
use super::parts::{AsciiState, DelayState};
use super::registers;
use super::settings::{Delaying, Framings, Kept, Long, Settings};
use crate::edge;
use crate::executor;
use crate::gpio::DriverEnable;
use crate::timer1;
use crate::usart0::{UDRE, Usart};

/// The buffer of the line, apart from [`State`] so that it starts as zeros and takes no flash.
pub(super) struct AduCell(UnsafeCell<Adu>);

// SAFETY: the machine decides which code may use the buffer.
unsafe impl Sync for AduCell {}

pub(super) static ADU: AduCell = AduCell(UnsafeCell::new([0; 256]));

impl AduCell {
    pub fn get(&self) -> *mut Adu {
        self.0.get()
    }

    pub fn buffer(&self) -> NonNull<Adu> {
        NonNull::from(&self.0).cast()
    }
}

/// The cell of the [`State`] of the one USART.
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
    pub machine: LineMachine,
    kept: Kept,
}

/// Sets OCR1B. The TEMP register of 16-bit accesses (DS 16.3) is safe since interrupts are off.
#[inline(always)]
fn set_compare(tick: u16) {
    // SAFETY: any value is a valid compare value.
    timer1::registers()
        .ocr1b()
        .write(|w| unsafe { w.bits(tick) });
}

/// Moves OCR1B on from its last match, so that intervals of one silence follow each other without drift.
#[inline(never)]
fn advance_compare(ticks: u16) {
    let from = timer1::registers().ocr1b().read().bits();
    let soon = timer1::now().wrapping_add(OVERDUE);
    set_compare(if soon.wrapping_sub(from) >= ticks {
        // This interrupt had to wait for the whole interval: otherwise the timer would go round first.
        soon
    } else {
        from.wrapping_add(ticks)
    });
}

/// Ticks to an alarm that is overdue, or would be due before this interrupt has ended. This interrupt has the higher priority (DS
/// 12.4): the ticks let a character that waits be handled first, and the character moves the alarm.
const OVERDUE: u16 = 32;

/// The least ticks to an alarm: enough to write the compare register before.
const SOON: u16 = 4;

/// The chip, as it is set up, with its DE pin.
#[repr(transparent)]
pub struct Driven<DE, F>(Kept, PhantomData<(DE, F)>);

impl State {
    pub const fn new() -> Self {
        Self {
            machine: LineMachine::new(),
            kept: Kept {
                ucsra: 0,
                to_stand: 0,
                to_start: 0,
                character: 0,
                t3_5: 0,
            },
        }
    }

    /// The machine, and the chip as its wire.
    #[inline(always)]
    pub fn parts<DE, F>(&mut self) -> (&mut LineMachine, &mut Driven<DE, F>) {
        let kept: *mut Kept = &mut self.kept;
        // SAFETY: `Driven` is a `Kept` by another name.
        (&mut self.machine, unsafe { &mut *kept.cast() })
    }

    /// For how long a frame may be kept, in units of 1024 ticks: for the time of 256 characters, in ASCII of twice as many, and for
    /// RESPONSE_DELAY.
    #[cfg(not(feature = "bare"))]
    #[inline(always)]
    pub fn longest<F: Framings>(&self) -> u16 {
        let mut longest = self.kept.character / 4;
        // SAFETY: interrupts are off.
        if F::ASCII && unsafe { AsciiState::get() }.is_on {
            longest *= 2;
        }
        if F::Delays::ARE_THERE {
            // SAFETY: interrupts are off.
            longest += (unsafe { DelayState::get() }.set.response / 1024) as u16 + 1;
        }
        longest
    }

    /// Handles a character that is not simply the next good one of an RTU frame. Returns a byte to store.
    #[inline(always)]
    pub fn on_unusual_character<DE: DriverEnable, F: Framings>(
        &mut self,
        errors: u8,
    ) -> Option<u8> {
        let errors = registers::errors(errors);
        edge::on_character();
        if F::SLOW {
            // Characters that skip this code follow one that did not, without an alarm between: no part was counted since.
            // SAFETY: in the interrupt.
            set_turns(unsafe { Long::get() }.to_complete);
        }
        let (machine, wire) = self.parts::<DE, F>();
        if wire.ascii().is_some() {
            machine.on_ascii_character(wire, Usart::take(), errors);
            return None;
        }
        // SAFETY: in the interrupt.
        let full = unsafe { Hot::get() }.is_full();
        let store = machine.on_character(wire, errors, full);
        // While a task waits for edges, every character has to pass this code: see `edge`.
        set_attention(store.is_none() || edge::has_waits());
        store
    }

    /// Handles Timer1 Compare Match B.
    #[inline(always)]
    pub fn on_alarm<DE: DriverEnable, F: Framings>(&mut self) {
        if F::SLOW && !self.machine.is_sending() {
            let left = turns();
            if left > 0 {
                set_turns(left - 1);
                advance_compare(PART);
                return set_attention(true);
            }
        }
        let (machine, wire) = self.parts::<DE, F>();
        machine.on_alarm(wire);
        set_attention(true);
    }
}

/// The ticks of `len` characters, of two for the CRC and of one more. In Rust this would take three times as much flash.
#[inline(always)]
fn bounded(character: u16, len: u8) -> u32 {
    let [low, high] = character.to_le_bytes();
    let (first, second, third): (u8, u8, u8);
    // SAFETY: arithmetic in registers; r1 is 0 again after it, and r0 may have any value.
    unsafe {
        core::arch::asm!(
            "clr {second}",
            "clr {third}",
            // A `len` of 253 or more goes over 255: 256 characters and the rest.
            "subi {len}, 0xFD",
            "brcs 2f",
            "mov {second}, {low}",
            "mov {third}, {high}",
            "2: mul {high}, {len}",
            "add {second}, r0",
            "adc {third}, r1",
            "mul {low}, {len}",
            "mov {first}, r0",
            "add {second}, r1",
            "clr r1",
            "adc {third}, r1",
            len = inout(reg_upper) len => _,
            low = in(reg) low,
            high = in(reg) high,
            first = lateout(reg) first,
            second = out(reg) second,
            third = out(reg) third,
            options(pure, nomem, nostack),
        );
    }
    u32::from_le_bytes([first, second, third, 0])
}

/// GPIOR2 (DS 8.6.4): how often Timer1 still goes round before a transmission has to be over. On slow lines, while they do not
/// send, the number of parts that the interval still has after the current part.
const TURNS: *mut u8 = 0x4B as *mut u8;

#[inline(always)]
fn turns() -> u8 {
    // SAFETY: a plain storage register, used by the line only.
    unsafe { TURNS.read_volatile() }
}

#[inline(always)]
fn set_turns(turns: u8) {
    // SAFETY: a plain storage register, used by the line only.
    unsafe { TURNS.write_volatile(turns) }
}

impl<DE: DriverEnable, F: Framings> Driven<DE, F> {
    /// Puts settings into the USART.
    pub(super) fn set_up(&mut self, settings: &Settings<F>) {
        self.0 = settings.kept;
        registers::set_up(settings);
        // SAFETY: interrupts are off.
        unsafe { Hot::get() }.to_complete = settings.to_complete;
        if F::ASCII {
            // SAFETY: interrupts are off.
            let state = unsafe { AsciiState::get() };
            state.is_on = settings.is_ascii();
            state.ascii.set_data_bits(settings.data_bits());
        }
        if F::SLOW {
            // SAFETY: interrupts are off.
            *unsafe { Long::get() } = settings.long();
        }
        if F::Delays::ARE_THERE {
            // SAFETY: interrupts are off.
            unsafe { DelayState::get() }.set = settings.delays.get();
        }
        set_attention(true);
    }
}

impl<DE: DriverEnable, F: Framings> Wire for Driven<DE, F> {
    const IS_BOUNDED: bool = !cfg!(feature = "bare");
    const HAS_DELAYS: bool = F::Delays::ARE_THERE;

    #[inline(always)]
    fn ascii(&mut self) -> Option<&mut Ascii> {
        if !F::ASCII {
            return None;
        }
        // SAFETY: in an interrupt of the line, or with interrupts off; the machine keeps no such reference.
        let state = unsafe { AsciiState::get() };
        state.is_on.then_some(&mut state.ascii)
    }

    #[inline(always)]
    fn take(&mut self) -> u8 {
        Usart::take()
    }

    #[inline(always)]
    fn store(&mut self, at: u8, byte: u8) {
        // SAFETY: the machine says that the buffer is not lent.
        let adu = unsafe { &mut *ADU.get() };
        adu[usize::from(at)] = byte;
    }

    #[inline(always)]
    fn start_bit_seen(&mut self) -> bool {
        edge::start_bit_seen()
    }

    #[inline(always)]
    fn clear_start_bit(&mut self) {
        edge::clear_start_bit();
    }

    #[inline(always)]
    fn alarm(&mut self, interval: Interval) -> bool {
        let kept = &self.0;
        if F::SLOW {
            // SAFETY: in an interrupt of the line, or with interrupts off.
            let long = unsafe { Long::get() };
            set_turns(match interval {
                Interval::ToStand => long.to_stand,
                Interval::ToStandLessCharacter => long.to_stand_less_character,
                Interval::T3_5 | Interval::T3_5Then => long.t3_5,
                Interval::ToStart | Interval::Character | Interval::Fortieth => 0,
            });
        }
        let ticks = match interval {
            Interval::ToStand => kept.to_stand,
            // SAFETY: as above.
            Interval::ToStandLessCharacter if F::SLOW => unsafe { Long::get() }.less_character,
            Interval::ToStandLessCharacter => kept.to_stand.saturating_sub(kept.character),
            Interval::ToStart => kept.to_start,
            Interval::T3_5Then => kept.t3_5,
            Interval::Character => kept.character,
            Interval::T3_5 => {
                set_compare(timer1::now().wrapping_add(kept.t3_5));
                return true;
            }
            // SAFETY: in the interrupt.
            Interval::Fortieth => unsafe { Hot::get() }.to_complete,
        };
        if ticks > 0 {
            advance_compare(ticks);
        }
        ticks > 0
    }

    #[inline(always)]
    fn alarm_on(&mut self) {
        timer1::clear(timer1::OCF1B);
        timer1::enable(timer1::OCF1B);
    }

    #[inline(always)]
    fn alarm_off(&mut self) {
        timer1::disable(timer1::OCF1B);
    }

    #[inline(always)]
    fn restart(&mut self) {
        // SAFETY: in the interrupt.
        unsafe { Hot::get() }.restart();
    }

    #[inline(always)]
    fn finish(&mut self) -> Received {
        // SAFETY: in the interrupt.
        unsafe { Hot::get() }.finish()
    }

    #[inline(always)]
    fn adu(&self) -> &Adu {
        // SAFETY: these bytes are read while an answer is sent, and are not changed then.
        unsafe { &*ADU.get() }
    }

    /// Keeps the receiver off: a transceiver that hears itself would otherwise fill the receiver (DS 20.7.6: switching the receiver
    /// off empties it).
    #[inline(always)]
    fn talk(&mut self, first: u8) {
        DE::raise();
        registers::send(&self.0);
        Usart::put(first);
    }

    /// Compare B matches when the part of the limit is over that is no whole turn of the timer, and again with each turn.
    #[inline(always)]
    fn bound(&mut self, len: u8) {
        let mut ticks = bounded(self.0.character, len);
        if self.ascii().is_some() {
            // `:`, two digits for each byte and for the LRC, CR, LF and one more character: twice as many.
            ticks *= 2;
        }
        let [first, second, turns, _] = ticks.to_le_bytes();
        set_turns(turns);
        let part = u16::from_le_bytes([first | SOON as u8, second]);
        set_compare(timer1::now().wrapping_add(part));
        self.alarm_on();
    }

    #[inline(always)]
    fn is_bound_over(&mut self) -> bool {
        let left = turns();
        set_turns(left.wrapping_sub(1));
        left == 0
    }

    #[inline(always)]
    fn begin_delay(&mut self) {
        // SAFETY: in the interrupt.
        let state = unsafe { DelayState::get() };
        state.left = state.set.response;
    }

    #[inline(always)]
    fn end_delay(&mut self) {
        // SAFETY: in the interrupt, or with interrupts off.
        unsafe { DelayState::get() }.left = 0;
    }

    #[inline(always)]
    fn is_delay_over(&mut self) -> bool {
        // SAFETY: in the interrupt.
        let state = unsafe { DelayState::get() };
        if state.left == 0 {
            return true;
        }
        let part = state.left.min(u32::from(PART));
        state.left -= part;
        advance_compare(part as u16);
        false
    }

    #[inline(always)]
    fn lead(&mut self) -> bool {
        // SAFETY: in the interrupt, or with interrupts off.
        let lead = unsafe { DelayState::get() }.set.lead;
        if lead == 0 || !DE::IS_ONE_PAIR {
            return false;
        }
        DE::raise();
        registers::hold();
        set_compare(timer1::now().wrapping_add(lead.max(SOON)));
        self.alarm_on();
        true
    }

    #[inline(always)]
    fn is_ready(&mut self) -> bool {
        Usart::status() & UDRE != 0
    }

    #[inline(always)]
    fn put(&mut self, byte: u8, last: bool) {
        Usart::put(byte);
        if last {
            // If this interrupt came late, TXC would report the character before. The byte just written keeps TXC from being set
            // again for a whole character.
            registers::clear_sent(&self.0);
        }
    }

    #[inline(always)]
    fn end(&mut self) {
        registers::nothing_more();
    }

    #[inline(always)]
    fn listen(&mut self) {
        DE::lower();
        registers::listen();
    }

    #[inline(always)]
    fn frame_is_back(&mut self) {
        #[cfg(not(feature = "bare"))]
        crate::watchdog::frame_is_back();
    }

    #[inline(always)]
    fn wake_receiver(&mut self) {
        executor::RECEIVER.wake();
    }

    #[inline(always)]
    fn wake_user(&mut self) {
        executor::USER.wake();
    }
}
