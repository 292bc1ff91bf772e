//! The receive task: takes frames from the line and passes on those that are for this port.

use multidrop_protocol::server::Diagnostics;

use crate::line::Line;
use crate::port::ServerPort;

/// Passes the requests for this unit, and broadcasts, from the line to [`serve`](crate::serve()). Never returns.
///
/// Damaged frames, and frames for other units, are dropped; the server counts them if it has counters. Frames for
/// other units include the answers of neighbours, which are delimited by silence as all frames are, and are not
/// parsed.
///
/// # Cancellation
/// Safe: a frame that was not passed on is given back to the line.
pub async fn receive<L: Line, D: Diagnostics>(port: &'static ServerPort<L, D>) -> ! {
    loop {
        match port.line.receive().await {
            Ok(frame) if port.server.is_concerned(frame.unit()) => port.requests.signal(frame),
            Ok(_) => {}
            Err(errors) => port.server.damaged(errors),
        }
    }
}
