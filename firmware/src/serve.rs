//! The serve task: works out answers while a frame is provisional, carries out writes when it stands.

use multidrop_protocol::server::{DataModel, Diagnostics, Plan};

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
pub async fn serve<L: Line, D: Diagnostics, M: DataModel>(
    port: &'static Port<L, D>,
    model: &Shared<M>,
) -> ! {
    loop {
        let mut frame = port.requests.wait().await;
        let request_len = frame.request_len();
        let plan = model.with(|model| port.server.prepare(model, frame.adu(), request_len));
        let early = plan.answer_at_once::<M>();
        if early > 0 {
            frame.release(early);
        }
        if D::COUNTS || matches!(plan, Plan::Write { .. } | Plan::Call) {
            if !frame.settle().await {
                continue;
            }
            // An answer that was released is only read from here on.
            let late =
                model.with(|model| port.server.commit(model, frame.adu(), request_len, plan));
            if early == 0 && late > 0 {
                frame.release(late);
            }
        }
        if !frame.sent().await && D::COUNTS && port.line.was_cut() {
            port.server.cut_off();
        }
        if D::COUNTS {
            port.line.set_delimiter(port.server.delimiter());
        }
    }
}
