//! INT0 and INT1: one flag for each pin, which the edges selected in EICRA set (DS 13.2.1).

use core::task::Waker;

use super::{Edge, Shared, Source, Waiting, sealed};
use crate::executor::{self, EDGE};
use crate::pac::EXINT;

fn exint() -> &'static crate::pac::exint::RegisterBlock {
    // SAFETY: the block exists at this address for the life of the program; EICRA, EIMSK and EIFR are changed here only, in
    // interrupts or with interrupts off.
    unsafe { &*EXINT::ptr() }
}

/// ISCn1 and ISCn0 of EICRA (DS 13.2.1, tables 13-1 and 13-2).
const fn sense(edge: Edge) -> u8 {
    match edge {
        Edge::Any => 0b01,
        Edge::Falling => 0b10,
        Edge::Rising => 0b11,
    }
}

/// Begins to wait on INT`n`: the interrupt is off while its edge is chosen, which may set its flag (DS 13.2.1).
fn arm(n: u8, edge: Edge) {
    disarm(n);
    // SAFETY: two bits of EICRA for each of the two; a one in EIFR clears that flag; a bit of EIMSK enables that interrupt, whose
    // handler is bound.
    unsafe {
        exint()
            .eicra()
            .modify(|r, w| w.bits(r.bits() & !(0b11 << (2 * n)) | sense(edge) << (2 * n)));
        exint().eifr().write(|w| w.bits(1 << n));
        exint().eimsk().modify(|r, w| w.bits(r.bits() | 1 << n));
    }
}

fn disarm(n: u8) {
    // SAFETY: as in `arm`.
    unsafe { exint().eimsk().modify(|r, w| w.bits(r.bits() & !(1 << n))) };
}

macro_rules! external {
    ($($(#[$doc:meta])* $name:ident: $n:literal, $in_use:ident, $waiting:ident;)*) => {
        $(
            /// Not 0 after a task has waited: if no task can, the compiler removes the code that reads it.
            static $in_use: Shared = Shared::new();
            static $waiting: Waiting<1> = Waiting::new();

            $(#[$doc])*
            pub enum $name {}

            impl sealed::Sealed for $name {}

            impl Source for $name {
                fn arm(_: u8, edge: Edge) {
                    $in_use.set(1);
                    arm($n, edge);
                }

                fn disarm(_: u8) {
                    disarm($n);
                }

                fn is_armed(_: u8) -> bool {
                    exint().eimsk().read().bits() & 1 << $n != 0
                }

                fn register(_: u8, waker: &Waker) {
                    $waiting.register(0, waker);
                }
            }

            impl $name {
                /// The interrupt handler, called by [`bind_interrupts!`](crate::bind_interrupts).
                ///
                /// # Safety
                /// From the interrupt of this name only.
                #[doc(hidden)]
                #[inline(always)]
                pub unsafe fn on_edge() {
                    // One edge ends the wait.
                    disarm($n);
                    executor::set(EDGE);
                }

                #[inline(always)]
                pub(super) fn wake() {
                    if $in_use.get() != 0 {
                        $waiting.wake(|_| !Self::is_armed(0));
                    }
                }
            }
        )*
    };
}

external! {
    /// INT0, on PD2.
    Int0: 0, IN_USE_0, WAITING_0;
    /// INT1, on PD3.
    Int1: 1, IN_USE_1, WAITING_1;
}
