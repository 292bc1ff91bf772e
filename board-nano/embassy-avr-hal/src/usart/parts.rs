//! State that only some lines keep: for ASCII, for slow lines, for delays. Each is a static of its own, so that it takes no RAM in
//! an image whose line does not use it.

use core::cell::UnsafeCell;

use multidrop_protocol::line::Ascii;

use super::settings::{Delays, Long};

/// The state for ASCII, apart from [`State`](super::state::State) so that it takes no RAM where no code refers to it.
pub(super) struct AsciiState {
    pub is_on: bool,
    pub ascii: Ascii,
}

struct AsciiCell(UnsafeCell<AsciiState>);

// SAFETY: as for `SHARED` of [`state`](super::state).
unsafe impl Sync for AsciiCell {}

static ASCII: AsciiCell = AsciiCell(UnsafeCell::new(AsciiState {
    is_on: false,
    ascii: Ascii::new(),
}));

impl AsciiState {
    /// Gives the one state for ASCII.
    ///
    /// # Safety
    /// In an interrupt of the line, or with interrupts off; one reference at a time.
    #[inline(always)]
    pub unsafe fn get() -> &'static mut AsciiState {
        // SAFETY: the caller keeps the rules above.
        unsafe { &mut *ASCII.0.get() }
    }
}

/// The state for slow lines, apart from [`State`](super::state::State) for the same reason as [`AsciiState`].
struct LongCell(UnsafeCell<Long>);

// SAFETY: as for `SHARED` of [`state`](super::state).
unsafe impl Sync for LongCell {}

static LONG: LongCell = LongCell(UnsafeCell::new(Long {
    to_complete: 0,
    to_stand: 0,
    to_stand_less_character: 0,
    less_character: 0,
    t3_5: 0,
}));

impl Long {
    /// Gives the one [`Long`] of the line.
    ///
    /// # Safety
    /// In an interrupt of the line, or with interrupts off; one reference at a time.
    #[inline(always)]
    pub unsafe fn get() -> &'static mut Long {
        // SAFETY: the caller keeps the rules above.
        unsafe { &mut *LONG.0.get() }
    }
}

/// Does what [`Chip::set_delimiter`](multidrop_protocol::line::Chip::set_delimiter) demands, with interrupts off.
pub(super) fn set_delimiter(delimiter: u8) {
    // SAFETY: interrupts are off.
    unsafe { AsciiState::get() }.ascii.set_delimiter(delimiter);
}

/// The delays of an answer, apart from [`State`](super::state::State) so that they take no RAM where no answer is delayed.
pub(super) struct DelayState {
    pub set: Delays,
    /// Ticks that are left of the delay after t3.5.
    pub left: u32,
}

struct DelayCell(UnsafeCell<DelayState>);

// SAFETY: as for `SHARED` of [`state`](super::state).
unsafe impl Sync for DelayCell {}

static DELAYS: DelayCell = DelayCell(UnsafeCell::new(DelayState {
    set: Delays {
        lead: 0,
        response: 0,
    },
    left: 0,
}));

impl DelayState {
    /// Gives the one state of the delays.
    ///
    /// # Safety
    /// In an interrupt of the line, or with interrupts off; one reference at a time.
    #[inline(always)]
    pub unsafe fn get() -> &'static mut DelayState {
        // SAFETY: the caller keeps the rules above.
        unsafe { &mut *DELAYS.0.get() }
    }
}
