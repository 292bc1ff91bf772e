//! What only some lines keep: for ASCII, for slow lines, for delays. Each stands apart, so that it takes no RAM in an image whose
//! line has no use for it.

use core::cell::UnsafeCell;

use multidrop_protocol::line::Ascii;

use super::settings::{Delays, Long};

/// What is for ASCII, apart from [`State`](super::state::State) so that it takes no RAM where nobody refers to it.
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
    /// The one there is.
    ///
    /// # Safety
    /// In an interrupt of the line, or with interrupts off; one reference at a time.
    #[inline(always)]
    pub unsafe fn get() -> &'static mut AsciiState {
        // SAFETY: as demanded above.
        unsafe { &mut *ASCII.0.get() }
    }
}

/// What is for slow lines, apart from [`State`](super::state::State) for the same reason.
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
    /// The one there is.
    ///
    /// # Safety
    /// In an interrupt of the line, or with interrupts off; one reference at a time.
    #[inline(always)]
    pub unsafe fn get() -> &'static mut Long {
        // SAFETY: as demanded above.
        unsafe { &mut *LONG.0.get() }
    }
}

/// [`Chip::set_delimiter`](multidrop_protocol::line::Chip::set_delimiter); with interrupts off.
pub(super) fn set_delimiter(delimiter: u8) {
    // SAFETY: interrupts are off.
    unsafe { AsciiState::get() }.ascii.set_delimiter(delimiter);
}

/// What an answer waits for, apart from [`State`](super::state::State) so that it takes no RAM where no answer does.
pub(super) struct DelayState {
    pub set: Delays,
    /// Ticks of the delay behind t3.5 that are left.
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
    /// The one there is.
    ///
    /// # Safety
    /// In an interrupt of the line, or with interrupts off; one reference at a time.
    #[inline(always)]
    pub unsafe fn get() -> &'static mut DelayState {
        // SAFETY: as demanded above.
        unsafe { &mut *DELAYS.0.get() }
    }
}
