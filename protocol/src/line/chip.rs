//! What the generic line of `multidrop` needs of a chip, beside its [`Wire`].

use core::cell::Cell;
use core::ptr::NonNull;
use core::task::Waker;

use super::{LineConfig, LineError, LineMachine, Wire};
use crate::Adu;
use crate::frame::ReceiveErrors;
use crate::port_registers::Duplex;

/// The task that waits, of the two tasks of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Waiting {
    /// The one that waits for a frame: [`Wire::wake_receiver`] wakes it.
    ForFrame,
    /// The one that has the frame, or waits to transmit: [`Wire::wake_user`] wakes it.
    WithFrame,
}

/// Observes a line.
pub trait Observer {
    /// Called for each frame that was heard, and for a request that has gone out: unit id, function code and data of a good one, or
    /// the errors of a damaged one.
    fn hear(&self, seen: Result<&[u8], ReceiveErrors>);
}

/// Where a line of a chip is kept, and how it is set up: what tasks ask of a chip. What interrupts ask of it is its [`Wire`].
///
/// The type is what tasks hold: a port's number, or nothing at all. `multidrop::line::ChipLine` makes a line of it.
pub trait Chip {
    /// What the machine asks of the chip.
    type Wire: Wire;

    /// What the chip's registers and alarms follow from.
    type Settings;

    /// Whether the board has other lines beside it. What is for that costs nothing where not.
    const HAS_NEIGHBOURS: bool = false;

    /// Calls `f` with the line's machine and wire while none of its interrupts can run. It is not called from within itself, nor
    /// from an interrupt, and it is the one machine and wire that the interrupts use.
    fn with<R>(&self, f: impl FnOnce(&mut LineMachine, &mut Self::Wire) -> R) -> R;

    /// Calls `f` as [`with`](Chip::with) does, and before it keeps the waker for the calls of [`Wire`] that wake this task: an
    /// event after `f` wakes it.
    fn with_waker<R>(
        &self,
        waiting: Waiting,
        waker: &Waker,
        f: impl FnOnce(&mut LineMachine, &mut Self::Wire) -> R,
    ) -> R;

    /// The line's one buffer, which lives for ever and is nobody else's. The chip writes to it where the machine has it store a
    /// character, and reads from it where [`Wire::adu`] is called.
    fn buffer(&self) -> NonNull<Adu>;

    /// What this configuration makes of the chip.
    ///
    /// # Errors
    /// [`LineError`] if the chip cannot do it.
    fn settings(&self, config: &LineConfig) -> Result<Self::Settings, LineError>;

    /// Puts settings into registers and wire: receiver and transmitter on, DE down, the frame that comes in forgotten. The line does
    /// not send; the machine is reset behind it.
    fn set_up(&self, wire: &mut Self::Wire, settings: &Self::Settings);

    /// Changes the delimiter of ASCII frames ([`Ascii::set_delimiter`](super::Ascii::set_delimiter)). A chip without ASCII has
    /// nothing to do.
    #[inline(always)]
    fn set_delimiter(&self, delimiter: u8) {
        let _ = delimiter;
    }

    /// Whether the line may be wired so: one that has a DE pin is for one pair of wires.
    fn may_be(&self, duplex: Duplex) -> bool {
        matches!(duplex, Duplex::Half)
    }

    /// Where it is kept who is shown the traffic, by a chip whose lines can be looked at.
    #[inline(always)]
    fn observer(&self) -> Option<&Cell<Option<&'static dyn Observer>>> {
        None
    }
}
