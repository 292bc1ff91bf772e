//! The serve task: works out answers while a frame is provisional, carries out writes when it stands.

use multidrop_protocol::server::{DataModel, Plan, Server};

use crate::line::Line;
use crate::port::Port;
use crate::shared::Shared;

/// Runs for ever: answers the requests that [`receive`](crate::receive()) passes on.
///
/// The model is used only between two awaits, so a block read or write is atomic towards every other
/// task of the executor.
///
/// # Cancellation
/// Safe at any await: the request is given up, an answer under way ends with the character in flight.
pub async fn serve<L: Line, M: DataModel>(
    port: &'static Port<L>,
    server: &Server<M>,
    model: &Shared<M>,
) -> ! {
    loop {
        let mut frame = port.requests.wait().await;
        let request_len = frame.request_len();
        let plan = model.with(|model| server.prepare(model, frame.adu(), request_len));
        let early = match plan {
            Plan::Answer { len } => len,
            Plan::Write { len } if !M::WRITES_MAY_FAIL => len,
            _ => 0,
        };
        if early > 0 {
            frame.release(early);
        }
        if matches!(plan, Plan::Write { .. } | Plan::Call) {
            if !frame.settle().await {
                continue;
            }
            if !M::WRITES_MAY_FAIL && matches!(plan, Plan::Write { .. }) {
                // The answer may be on its way from the same buffer, which is only read here.
                let _ = model.with(|model| server.write(model, frame.bytes()));
            } else {
                let late = model.with(|model| server.commit(model, frame.adu(), request_len, plan));
                if late > 0 {
                    frame.release(late);
                }
            }
        }
        frame.sent().await;
    }
}
