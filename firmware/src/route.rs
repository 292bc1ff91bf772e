//! Routing: a request that is received on one port is sent on another.
//!
//! A table tells which unit ids are reached through which client, and which unit id each has there. A [managed
//! port](crate::managed) that is a slave passes requests for these units to its [`Router`]. The router's task
//! [`route()`] sends them through the client, and the port returns the answer. The two ports may have different
//! framings, RTU and ASCII.
//!
//! ```
//! use multidrop::protocol::port_registers::PortRegisters;
//! use multidrop::protocol::registers::{Bank, NoCoils, NoRules};
//! use multidrop::{Line, ManagedPort, PortConfig, Route, Router, route};
//!
//! const AS1: PortConfig = PortConfig::new("AS1").slave_id(10);
//! type As1<L> = ManagedPort<L, PortRegisters<Bank<1>, NoCoils, NoRules>>;
//!
//! /// `routes` name the client for each unit id.
//! fn routed<L: Line>(line: L, router: &'static Router<L, 4>) -> As1<L> {
//!     ManagedPort::new(line, &AS1, AS1.bank(), NoCoils).routed(router)
//! }
//!
//! /// The body of a task.
//! async fn run<L: Line>(router: &'static Router<L, 4>) -> ! {
//!     route(router).await
//! }
//! ```
//!
//! # What the requesting client gets
//!
//! The answer or exception of the unit, or one of two exceptions of the gateway (APP 7):
//!
//! - 0A, if the request was not sent: the other port is not master, its queue is full, or its line is never silent.
//! - 0B, if the request was sent and no valid answer came within the route's own timeout. That timeout must be
//!   shorter than the timeout of the requesting client.
//!
//! If the unit still owes the answer to an earlier request with the same function, the request is sent after the
//! guard time of the other port; the requesting client must wait for that too. Force Listen Only Mode has no answer
//! (APP 6.8, sub-function 04), and the requesting client gets none.
//!
//! # Several requesting clients
//!
//! The port of each requesting client has a router. Two routers that send through one port take turns with each other
//! and with the application, in the order of their requests. A client sends one request at a time. If another one
//! comes, the client has given up the first, so the router gives it up as well and never returns its answer. A change
//! of the port's settings has that effect too.
//!
//! The port's own unit id takes precedence over its routes. Broadcasts are for the port's own server and are not
//! routed.

use core::cell::{Cell, RefCell};
use core::future::Future;
use core::pin::pin;
use core::task::{Context, Poll};

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use multidrop_protocol::Adu;
use multidrop_protocol::client::{AnswerError, Draft, Request, RequestError};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::function::{
    DIAGNOSTICS, EXCEPTION_BIT, MASK_WRITE_REGISTER, READ_COILS, READ_DISCRETE_INPUTS,
    READ_HOLDING_REGISTERS, READ_INPUT_REGISTERS, READ_WRITE_REGISTERS, WRITE_FILE_RECORD,
    WRITE_MULTIPLE_COILS, WRITE_MULTIPLE_REGISTERS, WRITE_SINGLE_COIL, WRITE_SINGLE_REGISTER,
};

use crate::client::{Client, ClientError};
use crate::line::Line;

/// The route to one unit.
pub struct Route<L: Line + 'static, const N: usize> {
    /// The unit id in the request, 1..=247.
    pub unit: u8,
    /// The unit id of that unit on the other bus, 1..=247.
    pub target: u8,
    /// The client that sends the request. Its timeout is that of the route.
    pub through: Client<L, N>,
}

/// The side of a router that its [managed port](crate::managed) uses.
pub trait Gateway {
    /// Whether there is a route to `unit`.
    fn has_route(&self, unit: u8) -> bool;

    /// Gives up the request that was passed on: its answer is dropped.
    fn give_up(&self);

    /// Passes on a request for a unit that has a route: unit id, function code and data, 2..=254 bytes, of a frame
    /// that stands.
    fn forward(&self, request: &[u8]);

    /// Ready when there is an answer. Only the last task that polled is woken.
    fn poll_answer(&self, context: &mut Context<'_>) -> Poll<()>;

    /// Moves the answer to the beginning of `into`; returns its length, 0 if there is none.
    fn answer(&self, into: &mut Adu) -> u8;
}

/// The state of the request.
#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    Nothing,
    /// A request of this length waits.
    Asked(u8),
    /// An answer of this length is there.
    Answered(u8),
}

/// The routes of one requesting client's port, and its request. `N` is that of the clients which send.
pub struct Router<L: Line + 'static, const N: usize> {
    routes: &'static [Route<L, N>],
    /// The request, then the answer: unit id, function code and data.
    frame: RefCell<Adu>,
    state: Cell<State>,
    /// Wakes the task after the port has changed the state.
    changed: Signal<NoopRawMutex, ()>,
    answered: Signal<NoopRawMutex, ()>,
}

impl<L: Line + 'static, const N: usize> Router<L, N> {
    /// A router with this table. If two rows have one unit id, the first one counts.
    pub const fn new(routes: &'static [Route<L, N>]) -> Self {
        Self {
            routes,
            frame: RefCell::new([0; 256]),
            state: Cell::new(State::Nothing),
            changed: Signal::new(),
            answered: Signal::new(),
        }
    }

    fn find(&self, unit: u8) -> Option<&'static Route<L, N>> {
        self.routes.iter().find(|route| route.unit == unit)
    }

    fn change(&self, state: State) {
        self.state.set(state);
        self.changed.signal(());
    }

    /// Sends the request, and replaces it by the answer; returns the length of the answer, 0 for none.
    async fn transact(&'static self, len: u8) -> u8 {
        let unit = self.frame.borrow()[0];
        let Some(route) = self.find(unit) else {
            return 0;
        };
        let request = Forwarded {
            frame: &self.frame,
            len,
        };
        let asked = route.through.transact(route.target, &request).await;
        let mut frame = self.frame.borrow_mut();
        let exception = match asked {
            Ok(Some(reply)) => {
                let bytes = reply.bytes();
                let Some(place) = frame.get_mut(..bytes.len()) else {
                    return 0;
                };
                place.copy_from_slice(bytes);
                frame[0] = unit;
                return bytes.len() as u8;
            }
            // The unit was told to listen only, and does not answer.
            Ok(None) => return 0,
            Err(ClientError::Exception(exception)) => exception.code(),
            Err(ClientError::UnknownException(code)) => code,
            // The function code is not one of a request.
            Err(ClientError::Request(_)) => Exception::IllegalFunction.code(),
            Err(
                ClientError::NotMaster
                | ClientError::QueueFull
                | ClientError::NoSilence
                | ClientError::CutOff,
            ) => Exception::GatewayPathUnavailable.code(),
            Err(_) => Exception::GatewayTargetFailedToRespond.code(),
        };
        frame[1] |= EXCEPTION_BIT;
        frame[2] = exception;
        3
    }
}

impl<L: Line + 'static, const N: usize> Gateway for Router<L, N> {
    fn has_route(&self, unit: u8) -> bool {
        self.find(unit).is_some()
    }

    fn give_up(&self) {
        if self.state.get() != State::Nothing {
            self.change(State::Nothing);
        }
    }

    fn forward(&self, request: &[u8]) {
        let mut frame = self.frame.borrow_mut();
        if let Some(place) = frame.get_mut(..request.len()) {
            place.copy_from_slice(request);
            self.change(State::Asked(request.len() as u8));
        }
    }

    fn poll_answer(&self, context: &mut Context<'_>) -> Poll<()> {
        loop {
            let answered = pin!(self.answered.wait()).poll(context);
            if matches!(self.state.get(), State::Answered(_)) {
                return Poll::Ready(());
            }
            if answered.is_pending() {
                return Poll::Pending;
            }
        }
    }

    fn answer(&self, into: &mut Adu) -> u8 {
        match self.state.get() {
            State::Answered(len) => {
                *into = *self.frame.borrow();
                self.state.set(State::Nothing);
                len
            }
            _ => 0,
        }
    }
}

/// Runs the task of a router: sends the requests that its port passes on. Never returns.
///
/// # Cancellation
/// Safe: the request is given up.
pub async fn route<L: Line, const N: usize>(router: &'static Router<L, N>) -> ! {
    loop {
        let State::Asked(len) = router.state.get() else {
            router.changed.wait().await;
            continue;
        };
        router.changed.reset();
        // A change of the state comes first: it replaces the request.
        if let Either::Second(len) = select(router.changed.wait(), router.transact(len)).await {
            router.state.set(match len {
                0 => State::Nothing,
                len => State::Answered(len),
            });
            router.answered.signal(());
        }
    }
}

/// A request as it was received.
struct Forwarded<'a> {
    frame: &'a RefCell<Adu>,
    len: u8,
}

impl Request for Forwarded<'_> {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        let frame = self.frame.borrow();
        let pdu = frame.get(1..usize::from(self.len)).unwrap_or(&[]);
        let function = pdu.first().copied().unwrap_or(0);
        if function == 0 || function & EXCEPTION_BIT != 0 {
            return Err(RequestError::Function { function });
        }
        for &byte in pdu {
            draft.byte(byte);
        }
        if matches!(pdu, [DIAGNOSTICS, 0, 4, 0, 0]) {
            draft.silence();
        }
        Ok(())
    }

    /// Checks reads by length, writes by their echo, diagnostics by the sub-function, since an answer that comes
    /// after the guard time may belong to another request. Answers to other functions are not checked.
    fn check(&self, answer: &[u8]) -> Result<(), AnswerError> {
        let frame = self.frame.borrow();
        let asked = frame.get(1..usize::from(self.len)).unwrap_or(&[]);
        let told = answer.get(1..).unwrap_or(&[]);
        let word = |high, low| usize::from(u16::from_be_bytes([high, low]));
        let (len, echoed) = match *asked {
            [READ_COILS | READ_DISCRETE_INPUTS, _, _, high, low] => {
                (2 + word(high, low).div_ceil(8), 1)
            }
            [
                READ_HOLDING_REGISTERS | READ_INPUT_REGISTERS,
                _,
                _,
                high,
                low,
            ]
            | [READ_WRITE_REGISTERS, _, _, high, low, ..] => (2 + 2 * word(high, low), 1),
            [
                WRITE_SINGLE_COIL
                | WRITE_SINGLE_REGISTER
                | WRITE_MULTIPLE_COILS
                | WRITE_MULTIPLE_REGISTERS,
                _,
                _,
                _,
                _,
                ..,
            ] => (5, 5),
            [MASK_WRITE_REGISTER, _, _, _, _, _, _] => (7, 7),
            [WRITE_FILE_RECORD, ..] => (asked.len(), asked.len()),
            [DIAGNOSTICS, _, _, ..] => (told.len(), 3),
            _ => return Ok(()),
        };
        if told.len() != len {
            Err(AnswerError::Length(answer.len() as u8))
        } else if told.get(..echoed) != asked.get(..echoed) {
            Err(AnswerError::Content)
        } else {
            Ok(())
        }
    }
}
