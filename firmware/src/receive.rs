//! The receive task: takes frames from the line, passes on those addressed to this port.

use multidrop_protocol::BROADCAST;

use crate::line::Line;
use crate::port::Port;

/// Runs for ever: waits for frames and hands those for this unit, and broadcasts, to
/// [`serve`](crate::serve()). Damaged frames and other units' frames go no further; the latter
/// include the answers of neighbours, which are framed by silence like all else and never parsed.
///
/// # Cancellation
/// Safe: a frame not yet passed on is given back to the line.
pub async fn receive<L: Line>(port: &'static Port<L>) -> ! {
    loop {
        if let Ok(frame) = port.line.receive().await
            && (frame.unit() == port.unit || frame.unit() == BROADCAST)
        {
            port.requests.signal(frame);
        }
    }
}
