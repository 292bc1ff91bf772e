//! The two tasks of a managed port.

use core::cell::Cell;
use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::{Poll, ready};

use multidrop_protocol::client::{AnswerError, Draft, Request, RequestError};
use multidrop_protocol::format::Framing;
use multidrop_protocol::port_registers::{Mode, PortRegisters, Status, Step, Transaction};
use multidrop_protocol::registers::{Items, Rules};
use multidrop_protocol::rtu::Flaws;
use multidrop_protocol::server::{Diagnostics, Plan};

use super::{Failure, ManagedPort, Outcome};
use crate::client::{Client, ClientConfig, ClientError, Turn};
use crate::config::line_config;
use crate::line::{Frame, Line, LineConfig};
use crate::shared::Shared;

/// Runs for ever: takes frames from the line and hands them to who they are for in the port's mode.
///
/// # Cancellation
/// Safe: a frame not yet handed on is given back to the line.
pub async fn managed_receive<L: Line, P, D: Diagnostics, const N: usize>(
    port: &'static ManagedPort<L, P, D, N>,
) -> ! {
    loop {
        let heard = port.line.receive().await;
        match (port.mode.get(), heard) {
            (Mode::Master, heard) => {
                port.line.show(seen(&heard));
                port.exchange.offer(heard);
            }
            (Mode::Sniffer, Ok(frame)) if L::SNIFFS && !port.prints() => {
                port.requests.signal(frame)
            }
            (Mode::Sniffer, Err(flaws)) if L::SNIFFS && !port.prints() => {
                port.line.show(Err(flaws))
            }
            (Mode::Slave, Ok(frame)) if port.server.is_concerned(frame.unit()) => {
                port.requests.signal(frame);
            }
            (Mode::Slave, Err(flaws)) => port.server.damaged(flaws),
            _ => {}
        }
    }
}

/// Runs for ever: answers, asks, and follows what was loaded, one after the other.
///
/// # Cancellation
/// Safe at any await: a request is given up, an answer or a request under way ends with the character in
/// flight. A transaction that was under way stays so in STATUS.
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
    // Held while the port is no master, so that no client talks.
    let mut turn = None;
    loop {
        // What was loaded behind START is for later.
        let started = port.started.take();
        let (mode, line) = match &started {
            Some(started) => (Mode::Master, started.line),
            None => port.registers.with(|registers| {
                let settings = registers.settings();
                port.server.set_unit(settings.slave_id);
                (settings.mode, line_config(settings.mode, &settings.line))
            }),
        };
        if mode != port.mode.get() || line != port.config.get() {
            port.follow(&mut turn, mode, line).await;
        }
        if let Some(started) = started {
            port.transact(started.transaction, started.times).await;
        } else if let Some(frame) = port.next().await {
            port.attend(frame).await;
        }
    }
}

fn seen<'a, L: Line>(heard: &'a Result<Frame<'static, L>, Flaws>) -> Result<&'a [u8], Flaws> {
    match heard {
        Ok(frame) => Ok(&frame.bytes()[..usize::from(frame.request_len())]),
        Err(flaws) => Err(*flaws),
    }
}

impl<L: Line, P, D, const N: usize> ManagedPort<L, P, D, N> {
    /// The mode is changed by the task that asks this.
    fn is_sniffer(&self) -> bool {
        L::SNIFFS && self.mode.get() == Mode::Sniffer
    }

    /// Whether it prints, as far as its line is concerned.
    fn prints(&self) -> bool {
        self.config.get().framing == Framing::Text
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
    /// A frame to attend to, or `None` if something was loaded that is to be followed.
    async fn next(&'static self) -> Option<Frame<'static, L>> {
        poll_fn(|context| {
            if let Poll::Ready(frame) = pin!(self.requests.wait()).poll(context) {
                return Poll::Ready(Some(frame));
            }
            if pin!(self.work.wait()).poll(context).is_ready() {
                return Poll::Ready(None);
            }
            match self.voice {
                Some(voice) if self.is_sniffer() && self.prints() => {
                    ready!(voice.poll_text(context));
                    pin!(self.line.lend()).poll(context).map(Some)
                }
                _ => Poll::Pending,
            }
        })
        .await
    }

    /// Puts mode and line into effect. No request is being answered, and none waits to be: this task takes them
    /// before it comes here.
    async fn follow(&'static self, turn: &mut Option<Turn<N>>, mode: Mode, line: LineConfig) {
        // A client may be in the middle of a request.
        while turn.is_none() {
            match self.exchange.turn().await {
                Ok(mine) => *turn = Some(mine),
                Err(_) => yield_now().await,
            }
        }
        if line != self.config.get() {
            // What is heard until then is of neither.
            self.mode.set(Mode::Off);
            // Checked before it was accepted.
            let _ = self.line.configure(line).await;
            self.config.set(line);
        }
        self.mode.set(mode);
        if mode == Mode::Master {
            *turn = None;
        }
    }

    /// A request is answered, as [`serve`](crate::serve()) does. A sniffer shows a frame that stands, and what does not
    /// is heard again as a damaged one; or it prints some text. These are not functions of their own so that
    /// they cost nothing where there is no sniffer.
    async fn attend(&self, mut frame: Frame<'static, L>) {
        let request_len = frame.request_len();
        let listens = self.is_sniffer() && request_len > 0;
        let mut plan = Plan::Ignore;
        let mut early = 0;
        if !self.is_sniffer() {
            plan = self
                .registers
                .with(|registers| self.server.prepare(registers, frame.adu(), request_len));
            early = plan.answer_at_once::<PortRegisters<R, C, V>>();
        } else if let Some(voice) = self.voice
            && !listens
        {
            early = voice.text(frame.adu());
        }
        if early > 0 {
            frame.release(early);
        }
        if listens
            || D::COUNTS && !self.is_sniffer()
            || matches!(plan, Plan::Write { .. } | Plan::Call)
        {
            if !frame.settle().await {
                return;
            }
            if listens {
                self.line
                    .show(Ok(&frame.bytes()[..usize::from(request_len)]));
                return;
            }
            let late = self.registers.with(|registers| {
                self.server
                    .commit(registers, frame.adu(), request_len, plan)
            });
            if early == 0 && late > 0 {
                frame.release(late);
            }
        }
        let sent = frame.sent().await;
        if self.is_sniffer() {
            if let Some(voice) = self.voice
                && sent
            {
                voice.spoken(early);
            }
        } else if D::COUNTS {
            self.line.set_delimiter(self.server.delimiter());
        }
    }

    /// Request by request.
    async fn transact(&'static self, mut transaction: Transaction, times: ClientConfig) {
        let client: Client<L, N> = self.client(times);
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
            let asked = loop {
                match client.transact(step.unit, &request).await {
                    Err(ClientError::QueueFull) => yield_now().await,
                    asked => break asked,
                }
            };
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

    #[inline(never)]
    fn finish(&self, outcome: Outcome) {
        let (status, error) = match &outcome {
            Ok(()) => (Status::Idle, 0),
            Err(failure) => (failure.status(), failure.error()),
        };
        self.registers
            .with(|registers| registers.finish(status, error));
        self.done.signal(outcome);
        if self.events.is_full() {
            let _ = self.events.try_receive();
        }
        let _ = self.events.try_send(outcome);
    }
}

/// Lets the other tasks run: more requests wait for the line than the port has places for.
async fn yield_now() {
    let mut yielded = false;
    poll_fn(|context| {
        if yielded {
            return Poll::Ready(());
        }
        yielded = true;
        context.waker().wake_by_ref();
        Poll::Pending
    })
    .await;
}

/// A step as the client sends it. What it writes is in the array until it is sent.
struct Described<'a, R, C, V> {
    registers: &'a Shared<PortRegisters<R, C, V>>,
    step: &'a Step,
    /// What a single write was sent with; the array may have another value when the echo comes.
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
