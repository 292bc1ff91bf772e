//! The receive task: takes frames from the line, passes on those that concern this port.

use multidrop_protocol::server::Diagnostics;

use crate::line::Line;
use crate::port::ServerPort;

/// Runs for ever: waits for frames and hands those for this unit, and broadcasts, to
/// [`serve`](crate::serve()). Damaged frames and other units' frames go no further, unless the server
/// counts them; the latter include the answers of neighbours, which are framed by silence like all else
/// and never parsed.
///
/// # Cancellation
/// Safe: a frame not yet passed on is given back to the line.
pub async fn receive<L: Line, D: Diagnostics>(port: &'static ServerPort<L, D>) -> ! {
    loop {
        match port.line.receive().await {
            Ok(frame) if port.server.is_concerned(frame.unit()) => port.requests.signal(frame),
            Ok(_) => {}
            Err(errors) => port.server.damaged(errors),
        }
    }
}
