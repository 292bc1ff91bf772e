//! The interface of the generic line of `multidrop` to a chip, beside its [`Wire`].

use core::cell::Cell;
use core::ptr::NonNull;
use core::task::Waker;

use super::{LineConfig, LineError, LineMachine, Wire};
use crate::Adu;
use crate::frame::ReceiveErrors;
use crate::port_registers::Duplex;

/// The two tasks of a line, of which one waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Waiting {
    /// The task that waits for a frame: [`Wire::wake_receiver`] wakes it.
    ForFrame,
    /// The task that has the frame, or waits to transmit: [`Wire::wake_user`] wakes it.
    WithFrame,
}

/// Observes a line.
pub trait Observer {
    /// Called for each frame that was heard, and for a request that was sent: with unit id, function code and data of a good frame,
    /// or with the errors of a damaged frame.
    fn hear(&self, seen: Result<&[u8], ReceiveErrors>);
}

/// The state of a chip's line, and its setup: the interface for tasks. The interface for interrupts is the chip's [`Wire`].
///
/// Tasks hold a value of this type: a port's number, or nothing at all. `multidrop::line::ChipLine` makes a line of it.
pub trait Chip {
    /// The chip as the machine uses it.
    type Wire: Wire;

    /// The values for the chip's registers and alarms.
    type Settings;

    /// Whether the board has other lines beside this one. If not, the code for other lines costs nothing.
    const HAS_NEIGHBOURS: bool = false;

    /// Calls `f` with the line's machine and wire while none of its interrupts can run. No call comes from within `f` or from an
    /// interrupt. The interrupts use the same machine and the same wire.
    fn with<R>(&self, f: impl FnOnce(&mut LineMachine, &mut Self::Wire) -> R) -> R;

    /// Calls `f` as [`with`](Chip::with) does, and before that keeps the waker for the calls of [`Wire`] that wake this task: an
    /// event after `f` wakes the task.
    fn with_waker<R>(
        &self,
        waiting: Waiting,
        waker: &Waker,
        f: impl FnOnce(&mut LineMachine, &mut Self::Wire) -> R,
    ) -> R;

    /// The one buffer of the line, which lives for ever and is used by no one else. The chip writes to it where the machine has a
    /// character stored, and reads from it where [`Wire::adu`] is called.
    fn buffer(&self) -> NonNull<Adu>;

    /// The settings of the chip for this configuration.
    ///
    /// # Errors
    /// [`LineError`] if the chip cannot do it.
    fn settings(&self, config: &LineConfig) -> Result<Self::Settings, LineError>;

    /// Puts settings into registers and wire: receiver and transmitter on, DE down, the incoming frame forgotten. The line does not
    /// send during this call. The caller resets the machine afterwards.
    fn set_up(&self, wire: &mut Self::Wire, settings: &Self::Settings);

    /// Changes the delimiter of ASCII frames ([`Ascii::set_delimiter`](super::Ascii::set_delimiter)). A chip without ASCII does
    /// nothing.
    #[inline(always)]
    fn set_delimiter(&self, delimiter: u8) {
        let _ = delimiter;
    }

    /// Whether the line may be wired for `duplex`: a line that has a DE pin is for one pair of wires.
    fn may_be(&self, duplex: Duplex) -> bool {
        matches!(duplex, Duplex::Half)
    }

    /// The place of the observer that sees the traffic, for a chip whose lines can be observed.
    #[inline(always)]
    fn observer(&self) -> Option<&Cell<Option<&'static dyn Observer>>> {
        None
    }
}
