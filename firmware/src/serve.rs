//! The serve task: works out answers while a frame is provisional, and carries out writes when the frame stands.

use multidrop_protocol::server::{DataModel, Diagnostics, Plan, Server};

use crate::line::{Frame, Line, Released};
use crate::port::ServerPort;
use crate::shared::Shared;

/// Runs for ever: answers the requests that [`receive`](crate::receive()) passes on.
///
/// The model is used only between two awaits, so a block read or write is atomic towards every other
/// task of the executor.
///
/// # Cancellation
/// Safe at any await: the request is given up, and an answer under way ends with the character in flight.
pub async fn serve<L: Line, D: Diagnostics, M: DataModel>(
    port: &'static ServerPort<L, D>,
    model: &Shared<M>,
) -> ! {
    loop {
        let frame = port.requests.wait().await;
        let (plan, mut answer) = prepare(&port.server, model, frame);
        if must_stand::<D>(plan) {
            if !answer.settle().await {
                continue;
            }
            conclude(&port.server, model, &mut answer, plan);
        }
        let is_out = answer.sent().await;
        finish(&port.line, &port.server, is_out);
    }
}

/// Works out the answer to a request. Releases the answer if it may be sent as soon as the frame stands.
#[inline(always)]
pub(crate) fn prepare<'l, L: Line, D: Diagnostics, M: DataModel>(
    server: &Server<D>,
    model: &Shared<M>,
    mut frame: Frame<'l, L>,
) -> (Plan, Released<'l, L>) {
    let request_len = frame.request_len();
    let plan = model.with(|model| server.prepare(model, frame.adu(), request_len));
    let answer = match plan.answer_at_once::<M>() {
        0 => frame.hold(),
        len => frame.release(len),
    };
    (plan, answer)
}

/// Whether [`conclude`] has something to do for `plan`.
#[inline(always)]
pub(crate) fn must_stand<D: Diagnostics>(plan: Plan) -> bool {
    D::COUNTS || matches!(plan, Plan::Write { .. } | Plan::Call)
}

/// Carries out the plan for a frame that stands. An answer that was released before is only read.
#[inline(always)]
pub(crate) fn conclude<L: Line, D: Diagnostics, M: DataModel>(
    server: &Server<D>,
    model: &Shared<M>,
    answer: &mut Released<'_, L>,
    plan: Plan,
) {
    let request_len = answer.request_len();
    let len = model.with(|model| server.conclude(model, answer.access(), request_len, plan));
    answer.release(len);
}

/// Counts an answer that was cut off, and sets the delimiter of ASCII frames that the request has asked for.
#[inline(always)]
pub(crate) fn finish<L: Line, D: Diagnostics>(line: &L, server: &Server<D>, is_out: bool) {
    if !is_out && D::COUNTS && line.was_cut() {
        server.cut_off();
    }
    if D::COUNTS {
        line.set_delimiter(server.delimiter());
    }
}
