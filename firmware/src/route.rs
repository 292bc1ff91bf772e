//! Routing: requests that come in on one port and are asked on another.
//!
//! A table says which unit ids are reached through which client, and by which unit id there. A [managed
//! port](crate::managed) that is a slave hands requests to those to its [`Router`], whose task [`route()`] asks them;
//! the port sends the answer. The framings of the two ports have nothing to do with each other: RTU becomes ASCII and
//! the other way round.
//!
//! ```
//! use multidrop::protocol::port_registers::PortRegisters;
//! use multidrop::protocol::registers::{Bank, NoCoils, NoRules};
//! use multidrop::{Line, ManagedPort, PortConfig, Route, Router, route};
//!
//! const AS1: PortConfig = PortConfig::new("AS1").slave_id(10);
//! type As1<L> = ManagedPort<L, PortRegisters<Bank<1>, NoCoils, NoRules>>;
//!
//! /// `routes` say through which client.
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
//! The answer or exception of the unit. Otherwise exception 0A if the request could not go out: the other port is no master,
//! too many requests wait for it already, or its line is never silent. Or exception 0B if the request went out and no valid
//! answer came within the route's own timeout, which must be shorter than the timeout of the requesting client (APP 7). A
//! unit that has not answered an earlier request with the same function is asked when the guard time of the other port is
//! over; the requesting client must wait for that too. After Force Listen Only Mode it gets nothing, since that has no answer
//! (APP 6.8, sub-function 04).
//!
//! # Several requesting clients
//!
//! The port of each requesting client has a router. Two that send through the same port take turns with each other and with
//! the application, first come, first served. The requests of one client come one after the other: a further one means that
//! the client has given the first up, so the router gives it up as well and never sends its answer. A change of the port's
//! settings does that too.
//!
//! The port's own unit id goes before its routes. Broadcasts are for the port's own server and go no further.

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

/// A unit id and where it is.
pub struct Route<L: Line + 'static, const N: usize> {
    /// The unit id that is asked for, 1..=247.
    pub unit: u8,
    /// The unit id it has on the bus behind, 1..=247.
    pub target: u8,
    /// Through whom. Its timeout is the route's.
    pub through: Client<L, N>,
}

/// What a [managed port](crate::managed) knows of its router.
pub trait Gateway {
    /// Whether there is a route to `unit`.
    fn leads_to(&self, unit: u8) -> bool;

    /// What was asked before is not to be answered any more.
    fn give_up(&self);

    /// A request to a unit that there is a route to: unit id, function code and data, 2..=254 bytes. It stands.
    fn ask(&self, request: &[u8]);

    /// Whether there is an answer. The last one to ask is woken when there is.
    fn poll_answer(&self, context: &mut Context<'_>) -> Poll<()>;

    /// Takes it, to the beginning of `into`; returns its length, 0 if there is none.
    fn answer(&self, into: &mut Adu) -> u8;
}

/// How far a request has come.
#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    Nothing,
    /// There is a request of this length.
    Asked(u8),
    /// There is an answer of this length.
    Answered(u8),
}

/// The routes of the port of one requesting client, and its request. `N` is that of the client ports behind.
pub struct Router<L: Line + 'static, const N: usize> {
    routes: &'static [Route<L, N>],
    /// Request, then answer: unit id, function code and data.
    frame: RefCell<Adu>,
    state: Cell<State>,
    /// For the task: the state was changed by the port.
    news: Signal<NoopRawMutex, ()>,
    answered: Signal<NoopRawMutex, ()>,
}

impl<L: Line + 'static, const N: usize> Router<L, N> {
    /// Routes by this table; the first row for a unit id is the one that counts.
    pub const fn new(routes: &'static [Route<L, N>]) -> Self {
        Self {
            routes,
            frame: RefCell::new([0; 256]),
            state: Cell::new(State::Nothing),
            news: Signal::new(),
            answered: Signal::new(),
        }
    }

    fn find(&self, unit: u8) -> Option<&'static Route<L, N>> {
        self.routes.iter().find(|route| route.unit == unit)
    }

    fn change(&self, state: State) {
        self.state.set(state);
        self.news.signal(());
    }

    /// Asks, and puts the answer in the place of the request; returns its length, 0 for none.
    async fn fetch(&'static self, len: u8) -> u8 {
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
            // Told to listen only: nobody answers that.
            Ok(None) => return 0,
            Err(ClientError::Exception(exception)) => exception.code(),
            Err(ClientError::UnknownException(code)) => code,
            // Function codes that none is asked with.
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
    fn leads_to(&self, unit: u8) -> bool {
        self.find(unit).is_some()
    }

    fn give_up(&self) {
        if self.state.get() != State::Nothing {
            self.change(State::Nothing);
        }
    }

    fn ask(&self, request: &[u8]) {
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

/// Runs for ever: asks what the port of this router is asked.
///
/// # Cancellation
/// Safe: the request is given up.
pub async fn route<L: Line, const N: usize>(router: &'static Router<L, N>) -> ! {
    loop {
        let State::Asked(len) = router.state.get() else {
            router.news.wait().await;
            continue;
        };
        router.news.reset();
        // News first: the request that was in its place is no more.
        if let Either::Second(len) = select(router.news.wait(), router.fetch(len)).await {
            router.state.set(match len {
                0 => State::Nothing,
                len => State::Answered(len),
            });
            router.answered.signal(());
        }
    }
}

/// A request as it came in.
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

    /// A read is told by its length, a write by what it echoes, a diagnostic by its sub-function: behind the guard time, an answer
    /// may be another request's. Of other functions nothing is known here.
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
