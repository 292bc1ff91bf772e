//! The two tasks of a managed port.
#![expect(
    clippy::manual_async_fn,
    reason = "an async fn keeps each argument twice, and there is one of these futures for each port"
)]

use core::cell::Cell;
use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::{Context, Poll, ready};

use multidrop_protocol::client::{AnswerError, Draft, Request, RequestError};
use multidrop_protocol::format::Framing;
use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::port_registers::{Mode, PortRegisters, Status, TransactionStep};
use multidrop_protocol::registers::{Items, Rules};
use multidrop_protocol::server::{DataModel, Diagnostics, Plan};

use super::{Failure, ManagedPort, Outcome, Started};
use crate::client::Client;
use crate::line::{Adu, Frame, Line, LineConfig, Released};
use crate::route::Gateway;
use crate::serve::{conclude, finish, must_stand, prepare};
use crate::shared::Shared;
use crate::sniff::TextSource;

/// Runs for ever: takes frames from the line and hands each to its user in the port's mode.
///
/// # Cancellation
/// Safe: a frame that is not handed on yet is given back to the line.
pub async fn managed_receive<L: Line, P, D: Diagnostics, const N: usize>(
    port: &'static ManagedPort<L, P, D, N>,
) -> ! {
    loop {
        let heard = port.exchange.receive(&port.line).await;
        match (port.mode.get(), heard) {
            (Mode::Master, heard) => {
                port.line.show(seen(&heard));
                port.exchange.offer(heard);
            }
            (Mode::Sniffer, Ok(frame)) if L::HAS_NEIGHBOURS && !port.prints() => {
                port.requests.put(frame)
            }
            (Mode::Sniffer, Err(errors)) if L::HAS_NEIGHBOURS && !port.prints() => {
                port.line.show(Err(errors))
            }
            (Mode::Slave, Ok(frame)) => {
                port.give_up_routed();
                let unit = frame.unit();
                if port.server.is_concerned(unit) || port.router_to(unit).is_some() {
                    port.requests.put(frame);
                }
            }
            (Mode::Slave, Err(errors)) => port.server.damaged(errors),
            _ => {}
        }
    }
}

/// The body of a port's task. It is no future of its own, which would add to the size of the task.
macro_rules! run {
    ($port:expr, $model:expr) => {
        loop {
            $port.follow().await;
            // Nothing can have been started since: the mode and the line that a transaction needs are in effect.
            if let Some(started) = $port.started.take() {
                $port.transact(started).await;
                continue;
            }
            let Some(frame) = $port.next().await else {
                continue;
            };
            $port.attend($model, frame).await;
        }
    };
}

/// Runs for ever, one job after the other: answers with the port's arrays, sends requests, puts loaded settings into effect.
///
/// # Cancellation
/// Safe at any await: a request is given up, and an answer or a request under way ends with the character in flight. STATUS still
/// shows a transaction that was under way.
pub async fn managed_run<L, R, C, V, D, const N: usize>(
    port: &'static ManagedPort<L, PortRegisters<R, C, V>, D, N>,
) -> !
where
    L: Line,
    R: Items<Item = u16> + 'static,
    C: Items<Item = bool> + 'static,
    V: Rules + 'static,
    D: Diagnostics,
{
    run!(port, &port.registers)
}

/// Runs a managed port like [`managed_run`], but a slave answers with `model` in place of the port's arrays.
///
/// # Cancellation
/// Safe like [`managed_run`].
pub async fn managed_serve<L, R, C, V, D, M, const N: usize>(
    port: &'static ManagedPort<L, PortRegisters<R, C, V>, D, N>,
    model: &Shared<M>,
) -> !
where
    L: Line,
    R: Items<Item = u16> + 'static,
    C: Items<Item = bool> + 'static,
    V: Rules + 'static,
    D: Diagnostics,
    M: DataModel,
{
    run!(port, model)
}

/// The purpose for which a port has a lent frame.
#[derive(Clone, Copy)]
enum Purpose {
    /// Sends `len` bytes without a request: text, or the answer to a routed request.
    Send { len: u8 },
    /// Shows the frame to the capture: the port is a sniffer.
    Show,
    /// Answers the frame, or forwards it to the router.
    Answer {
        plan: Plan,
        router: Option<&'static dyn Gateway>,
    },
}

impl Purpose {
    /// Whether there is something to do when the frame stands.
    #[inline(always)]
    fn must_stand<D: Diagnostics>(self) -> bool {
        match self {
            Purpose::Send { .. } => false,
            Purpose::Show => true,
            Purpose::Answer { plan, router } => must_stand::<D>(plan) || router.is_some(),
        }
    }
}

fn seen<'a, L: Line>(
    heard: &'a Result<Frame<'static, L>, ReceiveErrors>,
) -> Result<&'a [u8], ReceiveErrors> {
    match heard {
        Ok(frame) => Ok(&frame.bytes()[..usize::from(frame.request_len())]),
        Err(errors) => Err(*errors),
    }
}

impl<L: Line, P, D: Diagnostics, const N: usize> ManagedPort<L, P, D, N> {
    /// Whether the port is a sniffer. Only the task that calls this changes the mode.
    fn is_sniffer(&self) -> bool {
        L::HAS_NEIGHBOURS && self.mode.get() == Mode::Sniffer
    }

    /// Whether the framing of the line lets the port print.
    fn prints(&self) -> bool {
        self.config.get().framing == Framing::Text
    }

    /// The router that asks `unit` on another port.
    fn router_to(&self, unit: u8) -> Option<&'static dyn Gateway> {
        let router = self.router.filter(|_| L::HAS_NEIGHBOURS)?;
        (unit != self.server.unit() && router.has_route(unit)).then_some(router)
    }

    /// Reports to the router that the client no longer waits for a routed answer.
    fn give_up_routed(&self) {
        if L::HAS_NEIGHBOURS
            && let Some(router) = self.router
        {
            router.give_up();
        }
    }

    /// Ready when the port has something to send that no node on the line has just asked for.
    fn poll_own(&self, context: &mut Context<'_>) -> Poll<()> {
        match (self.mode.get(), self.text_source, self.router) {
            (Mode::Sniffer, Some(text_source), _) if self.prints() => {
                text_source.poll_text(context)
            }
            (Mode::Slave, _, Some(router)) => router.poll_answer(context),
            _ => Poll::Pending,
        }
    }

    /// The source of the text that the port prints, if the port is a sniffer.
    fn text_source(&self) -> Option<&'static dyn TextSource> {
        self.text_source.filter(|_| self.is_sniffer())
    }

    /// Puts bytes to send without a request into `adu`: text, or the answer to a routed request. Gives their number, 0 for none.
    #[inline(never)]
    fn write_unsolicited(&self, adu: &mut Adu) -> u8 {
        match (self.text_source(), self.router) {
            (Some(text_source), _) => text_source.text(adu),
            (None, Some(router)) => router.answer(adu),
            (None, None) => 0,
        }
    }
}

impl<L, R, C, V, D, const N: usize> ManagedPort<L, PortRegisters<R, C, V>, D, N>
where
    L: Line,
    R: Items<Item = u16> + 'static,
    C: Items<Item = bool> + 'static,
    V: Rules + 'static,
    D: Diagnostics,
{
    /// Waits for a frame to attend to, empty if the port is to fill it. `None` if loaded settings are to take effect.
    fn next(&'static self) -> impl Future<Output = Option<Frame<'static, L>>> {
        poll_fn(|context| {
            if let Poll::Ready(frame) = self.requests.poll(context) {
                return Poll::Ready(Some(frame));
            }
            if self.work.take() {
                return Poll::Ready(None);
            }
            if L::HAS_NEIGHBOURS {
                ready!(self.poll_own(context));
                return pin!(self.line.lend()).poll(context).map(Some);
            }
            Poll::Pending
        })
    }

    /// The mode and line to put into effect: those of a started transaction, else the loaded ones. Values loaded after START wait.
    fn target(&self) -> (Mode, LineConfig) {
        match self.started.get() {
            Some(started) => (Mode::Master, started.line),
            None => self.registers.with(|registers| {
                let settings = registers.settings();
                self.server.set_unit(settings.slave_id);
                (settings.mode, LineConfig::of(settings.mode, &settings.line))
            }),
        }
    }

    /// Puts mode and line into effect, until they are the ones loaded last. No request is being answered, and none waits for an
    /// answer: the task takes requests before it calls this.
    async fn follow(&'static self) {
        loop {
            let (mode, line) = self.target();
            if mode == self.mode.get() && line == self.config.get() {
                return;
            }
            self.give_up_routed();
            if mode != Mode::Master {
                self.exchange.close();
            }
            // Makes the line neither `Send` nor `Sync`: it is not to be used from an interrupt.
            let _turn = self.exchange.hold().await;
            if line != self.config.get() {
                // A frame that is heard until then belongs to neither setting.
                self.mode.set(Mode::Off);
                // The settings were checked before they were accepted.
                let _ = self.line.configure(line).await;
                self.config.set(line);
            }
            self.mode.set(mode);
            if mode == Mode::Master {
                self.exchange.open();
            }
        }
    }

    /// Attends to one frame, from its arrival until it is given back.
    fn attend<M: DataModel>(
        &self,
        model: &Shared<M>,
        frame: Frame<'static, L>,
    ) -> impl Future<Output = ()> {
        async move {
            let Some((purpose, mut answer)) = self.begin(model, frame) else {
                return;
            };
            if purpose.must_stand::<D>()
                && !(answer.settle().await && self.on_stands(model, &mut answer, purpose))
            {
                return;
            }
            let is_out = answer.sent().await;
            self.on_sent(purpose, is_out);
        }
    }

    /// Fills an empty frame, or works out the answer to a request, and releases the bytes that may be sent. `None` if an empty
    /// frame stays empty.
    #[inline(always)]
    fn begin<M: DataModel>(
        &self,
        model: &Shared<M>,
        mut frame: Frame<'static, L>,
    ) -> Option<(Purpose, Released<'static, L>)> {
        if L::HAS_NEIGHBOURS && frame.request_len() == 0 {
            return match self.write_unsolicited(frame.adu()) {
                0 => None,
                len => Some((Purpose::Send { len }, frame.release(len))),
            };
        }
        if self.is_sniffer() {
            return Some((Purpose::Show, frame.hold()));
        }
        let router = self.router_to(frame.unit());
        let (plan, answer) = prepare(&self.server, model, frame);
        Some((Purpose::Answer { plan, router }, answer))
    }

    /// Carries out the plan for a frame that stands. `false` if nothing is sent after it.
    #[inline(always)]
    fn on_stands<M: DataModel>(
        &self,
        model: &Shared<M>,
        answer: &mut Released<'static, L>,
        purpose: Purpose,
    ) -> bool {
        let Purpose::Answer { plan, router } = purpose else {
            // A frame that does not stand is heard again, as a damaged frame.
            self.line.show(Ok(answer.heard()));
            return false;
        };
        conclude(&self.server, model, answer, plan);
        if let Some(router) = router {
            router.forward(answer.heard());
        }
        router.is_none()
    }

    /// Takes note of whether the released bytes were sent.
    #[inline(always)]
    fn on_sent(&self, purpose: Purpose, is_out: bool) {
        match purpose {
            // A client that sends instead of waiting for an answer has given it up. Text that was not sent is sent again.
            Purpose::Send { len } => {
                if is_out && let Some(text_source) = self.text_source() {
                    text_source.sent(len);
                }
            }
            _ => finish(&self.line, &self.server, is_out),
        }
    }

    /// Runs a transaction request by request.
    fn transact(&'static self, started: Started) -> impl Future<Output = ()> {
        let client: Client<L, N> = self.client(started.times);
        let mut transaction = started.transaction;
        async move {
            let mut outcome = Ok(());
            while let Some(step) = self
                .registers
                .with(|registers| registers.next_step(&mut transaction))
            {
                let request = Described {
                    registers: &self.registers,
                    step: &step,
                    value: Cell::new(0),
                };
                let asked = client.start(step.unit, &request).await;
                match asked {
                    Ok(Some(reply)) => self
                        .registers
                        .with(|registers| registers.store(&step, reply.bytes())),
                    Ok(None) => {}
                    Err(cause) => {
                        let failure = Failure {
                            unit: step.unit,
                            address: step.first,
                            cause,
                        };
                        outcome = outcome.and(Err(failure));
                        if !transaction.goes_on() {
                            break;
                        }
                    }
                }
            }
            self.finish(outcome);
        }
    }

    #[inline(never)]
    fn finish(&self, outcome: Outcome) {
        let (status, error) = match &outcome {
            Ok(()) => (Status::Idle, 0),
            Err(failure) => (failure.status(), failure.error()),
        };
        self.registers
            .with(|registers| registers.finish(status, error));
        self.done.put(outcome);
        let [first, second] = &self.events;
        // A new outcome replaces the oldest.
        match (first.get(), second.get()) {
            (None, _) => first.set(Some(outcome)),
            (_, older) => {
                if older.is_some() {
                    first.set(older);
                }
                second.set(Some(outcome));
            }
        }
        self.ended.wake();
    }
}

/// A step as the client sends it. The values that it writes stay in the array until it is sent.
struct Described<'a, R, C, V> {
    registers: &'a Shared<PortRegisters<R, C, V>>,
    step: &'a TransactionStep,
    /// The value that a single write was sent with. The array may have another value when the echo comes.
    value: Cell<u16>,
}

impl<R, C, V> Request for Described<'_, R, C, V>
where
    R: Items<Item = u16>,
    C: Items<Item = bool>,
    V: Rules,
{
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        let encoded = self
            .registers
            .with(|registers| registers.encode(self.step, draft));
        self.value.set(encoded?);
        Ok(())
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        PortRegisters::<R, C, V>::check(self.step, self.value.get(), frame)
    }
}
