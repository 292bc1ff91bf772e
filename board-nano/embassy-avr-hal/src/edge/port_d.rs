//! PCINT2: one flag for all pins of port D, including RXD (DS 13.2.4, 13.2.5). The levels show which pin has changed.
//!
//! While a task waits, the interrupt is on and clears the flag that is the line's start-bit detector. The state of
//! RXD is then in [`START`]. One edge of RXD is enough until the line has read it: PCINT16 is masked from there to
//! the next character, so that the other edges of this one cost nothing. With the line's attention set, characters
//! take the slower path, which lifts the mask again.
//!
//! In an image in which no task waits for these pins, all of this costs nothing: see [`IN_USE`].

use core::task::Waker;

use super::{Edge, Shared, Source, Waiting, sealed};
use crate::executor::{self, EDGE};
use crate::pac::EXINT;
#[cfg(feature = "modbus")]
use crate::usart::set_attention;

/// Without a line nobody looks for start bits.
#[cfg(not(feature = "modbus"))]
fn set_attention(_: bool) {}

/// PIND (DS 14.4.10) and RXD in it.
const PIND: *const u8 = 0x29 as *const u8;
const RXD: u8 = 1 << 0;

/// PCIF2 of PCIFR and PCIE2 of PCICR (DS 13.2.4, 13.2.5).
const PORT_D: u8 = 1 << 2;
/// PCINT16, which is RXD, of PCMSK2 (DS 13.2.6).
const PCINT16: u8 = 1 << 0;

/// The first of the pins, and their number.
const FIRST: u32 = 4;
const PINS: usize = 4;

/// Not 0 after a task has waited. Nothing else sets it: if no task can wait, the compiler knows that it is 0, and
/// removes the code that reads it.
static IN_USE: Shared = Shared::new();
/// The pins for which a task waits, and of these the pins for each kind of edge.
static ARMED: Shared = Shared::new();
static RISING: Shared = Shared::new();
static FALLING: Shared = Shared::new();
/// The levels of the pins as they were last read.
static LEVELS: Shared = Shared::new();
/// Not 0 if RXD has changed since the line last checked for a start bit.
static START: Shared = Shared::new();

static WAITING: Waiting<PINS> = Waiting::new();

fn exint() -> &'static crate::pac::exint::RegisterBlock {
    // SAFETY: as for the line's registers, which these are too; with interrupts off.
    unsafe { &*EXINT::ptr() }
}

/// The levels of port D.
#[inline(always)]
fn levels() -> u8 {
    // SAFETY: reading has no effect.
    unsafe { PIND.read_volatile() }
}

/// Whether the pin-change flag is set (DS 13.2.5).
#[inline(always)]
fn flag() -> bool {
    exint().pcifr().read().bits() & PORT_D != 0
}

/// Clears the pin-change flag by writing a one.
#[inline(always)]
fn clear_flag() {
    // SAFETY: writing a one clears this flag and no other.
    exint().pcifr().write(|w| unsafe { w.bits(PORT_D) });
}

/// Switches the interrupt on or off. PCICR is shared with ports B and C.
fn enable(on: bool) {
    // SAFETY: the handler is bound where it is switched on.
    exint().pcicr().modify(|r, w| unsafe {
        w.bits(if on {
            r.bits() | PORT_D
        } else {
            r.bits() & !PORT_D
        })
    });
}

/// Changes bits of PCMSK2.
#[inline(always)]
fn mask(set: u8, clear: u8) {
    // SAFETY: any pins may be in the mask.
    exint()
        .pcmsk2()
        .modify(|r, w| unsafe { w.bits(r.bits() & !clear | set) });
}

/// Whether a task waits for an edge.
#[inline(always)]
pub(crate) fn has_waits() -> bool {
    IN_USE.get() != 0 && ARMED.get() != 0
}

/// Compares the pins with their last levels, and wakes the tasks whose edge has come. Returns whether any pin has
/// changed.
fn wake_changed(now: u8) -> bool {
    let armed = ARMED.get();
    let changed = (now ^ LEVELS.get()) & armed;
    if changed == 0 {
        return false;
    }
    LEVELS.set(now);
    let seen = changed & (now & RISING.get() | !now & FALLING.get());
    if seen != 0 {
        stop(seen);
        executor::set(EDGE);
    }
    true
}

/// Ends the wait for these pins.
fn stop(pins: u8) {
    let armed = ARMED.get() & !pins;
    ARMED.set(armed);
    mask(0, pins);
    if armed == 0 {
        // The flag is again the detector of RXD alone.
        mask(PCINT16, 0);
        enable(false);
    }
}

/// The flag was set: clears it and finds its pins.
fn serve() {
    let is_rxd_masked = exint().pcmsk2().read().bits() & PCINT16 == 0;
    clear_flag();
    let now = levels();
    // Up to 57600 baud a start bit is longer than the delay of an interrupt: if another pin has changed as well, RXD
    // is still low.
    let is_other = wake_changed(now);
    if !is_rxd_masked && (!is_other || now & RXD == 0) {
        START.set(1);
        if has_waits() {
            mask(0, PCINT16);
        }
        set_attention(true);
    }
}

/// Whether RXD has changed since [`clear_start_bit`]. After a complete character the next change can only be a start
/// bit (or noise), so this tells that a character has begun, a whole character before RXC does. The flag is set
/// whether or not the interrupt is enabled (DS 13.2.5).
#[cfg(feature = "modbus")]
#[inline(always)]
pub(crate) fn start_bit_seen() -> bool {
    if has_waits() {
        if flag() {
            serve();
        }
    } else if flag() {
        return true;
    }
    has_seen_start()
}

/// Whether [`START`] is set.
#[cfg(feature = "modbus")]
#[inline(always)]
fn has_seen_start() -> bool {
    IN_USE.get() != 0 && START.get() != 0
}

/// Clears the detector of start bits. A pin that has changed is still detected.
#[cfg(feature = "modbus")]
#[inline(always)]
pub(crate) fn clear_start_bit() {
    if IN_USE.get() != 0 {
        START.set(0);
    }
    if has_waits() {
        mask(PCINT16, 0);
        clear_flag();
        wake_changed(levels());
    } else {
        clear_flag();
    }
}

/// A character was received; its interrupt has cleared the flag.
#[cfg(feature = "modbus")]
#[inline(always)]
pub(crate) fn on_character() {
    if has_waits() || has_seen_start() {
        clear_start_bit();
    }
}

/// PCINT2, the source for PD4 to PD7.
pub enum PortD {}

impl sealed::Sealed for PortD {}

impl Source for PortD {
    fn arm(pins: u8, edge: Edge) {
        IN_USE.set(1);
        if has_waits() {
            // Changes of the other pins up to now are handled first.
            wake_changed(levels());
        }
        let kinds = [
            (&RISING, edge != Edge::Falling),
            (&FALLING, edge != Edge::Rising),
        ];
        for (kind, is_waited_for) in kinds {
            let others = kind.get() & !pins;
            kind.set(if is_waited_for { others | pins } else { others });
        }
        LEVELS.set(LEVELS.get() & !pins | levels() & pins);
        ARMED.set(ARMED.get() | pins);
        mask(pins, 0);
        set_attention(true);
        // A change of RXD up to now is handled by this.
        enable(true);
    }

    fn disarm(pins: u8) {
        if ARMED.get() & pins != 0 {
            if flag() {
                serve();
            }
            stop(ARMED.get() & pins);
        }
    }

    fn is_armed(pins: u8) -> bool {
        ARMED.get() & pins != 0
    }

    fn register(pins: u8, waker: &Waker) {
        WAITING.register((pins.trailing_zeros() - FIRST) as usize, waker);
    }
}

impl PortD {
    /// The interrupt handler, called by [`bind_interrupts!`](crate::bind_interrupts).
    ///
    /// # Safety
    /// From the interrupt PCINT2 only.
    #[doc(hidden)]
    pub unsafe fn on_change() {
        serve();
    }

    #[inline(always)]
    pub(super) fn wake() {
        if IN_USE.get() != 0 {
            let armed = critical_section::with(|_| ARMED.get()) >> FIRST;
            WAITING.wake(|index| armed & 1 << index == 0);
        }
    }
}
