//! The two tasks of a managed port.

use core::cell::Cell;
use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::Poll;

use embassy_time::{Duration, Timer};
use multidrop_protocol::client::{AnswerError, Draft, Request, RequestError};
use multidrop_protocol::port_registers::{Mode, PortRegisters, Status, Step};
use multidrop_protocol::registers::{Items, Rules};
use multidrop_protocol::server::{Diagnostics, Plan};

use super::{Failure, ManagedPort, Outcome, Started};
use crate::client::{Client, ClientError, Turn};
use crate::config::line_config;
use crate::line::{Frame, Line, LineConfig};
use crate::shared::Shared;

/// How long to wait for a place among those who wait for the line.
const QUEUE_FULL: Duration = Duration::from_millis(1);

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
            (Mode::Master, heard) => port.exchange.offer(heard),
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
        if let Some(started) = port.started.take() {
            port.follow(&mut turn, Mode::Master, started.line).await;
            let outcome = port.transact(&started).await;
            port.finish(outcome);
        }
        if port.changed.take() {
            let (mode, unit, line) = port.registers.with(|registers| {
                let settings = registers.settings();
                let line = line_config(settings.mode, &settings.line);
                (settings.mode, settings.slave_id, line)
            });
            port.server.set_unit(unit);
            port.follow(&mut turn, mode, line).await;
        }
        if let Some(frame) = port.next().await {
            port.answer(frame).await;
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
    /// A request to answer, or `None` if something was loaded that is to be followed.
    async fn next(&self) -> Option<Frame<'static, L>> {
        poll_fn(|context| {
            if let Poll::Ready(frame) = pin!(self.requests.wait()).poll(context) {
                return Poll::Ready(Some(frame));
            }
            pin!(self.work.wait()).poll(context).map(|()| None)
        })
        .await
    }

    /// Puts mode and line into effect. No request is being answered.
    async fn follow(&'static self, turn: &mut Option<Turn<N>>, mode: Mode, line: LineConfig) {
        if mode == self.mode.get() && line == self.config.get() {
            return;
        }
        if turn.is_none() {
            // A client may be in the middle of a request.
            *turn = Some(self.turn().await);
        }
        if line != self.config.get() {
            // What is heard until then is of neither. No request waits: this task takes them before it comes here.
            self.mode.set(Mode::Off);
            // Checked before it was accepted.
            if self.line.configure(line).await.is_ok() {
                self.config.set(line);
            }
        }
        self.mode.set(mode);
        if mode == Mode::Master {
            *turn = None;
        }
    }

    async fn turn(&'static self) -> Turn<N> {
        loop {
            match self.exchange.turn().await {
                Ok(turn) => return turn,
                Err(_) => Timer::after(QUEUE_FULL).await,
            }
        }
    }

    /// As [`serve`](crate::serve()) does.
    async fn answer(&self, mut frame: Frame<'static, L>) {
        let request_len = frame.request_len();
        let plan = self
            .registers
            .with(|registers| self.server.prepare(registers, frame.adu(), request_len));
        let early = plan.answer_at_once::<PortRegisters<R, C, V>>();
        if early > 0 {
            frame.release(early);
        }
        if D::COUNTS || matches!(plan, Plan::Write { .. } | Plan::Call) {
            if !frame.settle().await {
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
        frame.sent().await;
        if D::COUNTS {
            self.line.set_delimiter(self.server.delimiter());
        }
    }

    /// Request by request.
    async fn transact(&'static self, started: &Started) -> Outcome {
        let client: Client<L, N> = self.client(started.times);
        let mut transaction = started.transaction;
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
                    Err(ClientError::QueueFull) => Timer::after(QUEUE_FULL).await,
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
        outcome
    }

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
        self.step.check(self.value.get(), frame)
    }
}
