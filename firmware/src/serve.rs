//! The serve task: works out answers while a frame is provisional, carries out writes when it stands.

use multidrop_protocol::server::{DataModel, Diagnostics, Plan, Server};

use crate::line::{Line, Released};
use crate::port::ServerPort;
use crate::shared::Shared;

/// Runs for ever: answers the requests that [`receive`](crate::receive()) passes on.
///
/// The model is used only between two awaits, so a block read or write is atomic towards every other
/// task of the executor.
///
/// # Cancellation
/// Safe at any await: the request is given up, an answer under way ends with the character in flight.
pub async fn serve<L: Line, D: Diagnostics, M: DataModel>(
    port: &'static ServerPort<L, D>,
    model: &Shared<M>,
) -> ! {
    loop {
        let mut frame = port.requests.wait().await;
        let request_len = frame.request_len();
        let plan = model.with(|model| port.server.prepare(model, frame.adu(), request_len));
        let mut answer = match plan.answer_at_once::<M>() {
            0 => frame.hold(),
            len => frame.release(len),
        };
        if D::COUNTS || matches!(plan, Plan::Write { .. } | Plan::Call) {
            if !answer.settle().await {
                continue;
            }
            conclude(&port.server, model, &mut answer, request_len, plan);
        }
        if !answer.sent().await && D::COUNTS && port.line.was_cut() {
            port.server.cut_off();
        }
        if D::COUNTS {
            port.line.set_delimiter(port.server.delimiter());
        }
    }
}

/// Does what was planned for a frame that stands. An answer that was released before is only read.
#[inline(always)]
pub(crate) fn conclude<L: Line, D: Diagnostics, M: DataModel>(
    server: &Server<D>,
    model: &Shared<M>,
    answer: &mut Released<'_, L>,
    request_len: u8,
    plan: Plan,
) {
    let len = model.with(|model| server.conclude(model, answer.access(), request_len, plan));
    answer.release(len);
}
