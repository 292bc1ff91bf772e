//! Routing: requests that come in on one port and are asked on another.
//!
//! A table says which unit ids are reached through which client, and by which unit id there. The receive task of the
//! asker's port hands such requests to a [`Router`]; its task [`route()`] asks them and sends the answer back. The
//! framings of the two ports have nothing to do with each other: RTU becomes ASCII and the other way round.
//!
//! ```ignore
//! static ROUTES: [Route<Usart, 4>; 2] = ...;
//! let router = ROUTER.init(Router::new(routes));
//! spawner.spawn(receive(as1, router).unwrap()); // receive_and_route(port, router).await
//! spawner.spawn(serve(as1).unwrap());           // the port's own unit is served as ever
//! spawner.spawn(route(as1, router).unwrap());   // route(port.line(), router).await
//! ```
//!
//! # What the asker is told
//!
//! The answer or exception of the unit. Else exception 0A, where the request could not go out: nobody is asked, since
//! too many wait already or the line behind is never silent. Or 0B, where it did and no good answer came within the
//! route's own timeout, which is to be shorter than the asker's (APP 7).
//!
//! # Several askers
//!
//! Each asker's port has a router; two that ask through the same client take turns with each other and with the
//! application, in the order in which they asked. The requests of one asker come one after the other: a further one
//! means that it has given the first up, so that is given up here as well, and its answer is never sent.
//!
//! Broadcasts are for the port's own server and go no further.

use core::cell::Cell;

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use multidrop_protocol::Adu;
use multidrop_protocol::client::{AnswerError, Draft, Request, RequestError};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::function::{DIAGNOSTICS, EXCEPTION_BIT};
use multidrop_protocol::server::Diagnostics;

use crate::client::{Client, ClientError};
use crate::line::{Frame, Line};
use crate::port::Port;

/// A unit id and where it is.
pub struct Route<L: Line + 'static, const N: usize> {
    /// The unit id that is asked for, 1..=247.
    pub unit: u8,
    /// The unit id it has on the bus behind, 1..=247.
    pub target: u8,
    /// Through whom. Its timeout is the route's.
    pub through: Client<L, N>,
}

/// The routes of one asker's port, and its request.
pub struct Router<L: Line + 'static, const N: usize> {
    routes: &'static [Route<L, N>],
    asked: Signal<NoopRawMutex, Frame<'static, L>>,
    /// Counts frames: an answer is sent only if none has come since.
    heard: Cell<u8>,
}

impl<L: Line + 'static, const N: usize> Router<L, N> {
    /// Routes by this table; the first row for a unit id is the one that counts.
    pub const fn new(routes: &'static [Route<L, N>]) -> Self {
        Self {
            routes,
            asked: Signal::new(),
            heard: Cell::new(0),
        }
    }

    fn find(&self, unit: u8) -> Option<&'static Route<L, N>> {
        self.routes.iter().find(|route| route.unit == unit)
    }

    /// For the task that takes frames from the asker's line: takes one that is to be routed, gives back any other.
    pub fn offer(&self, frame: Frame<'static, L>) -> Option<Frame<'static, L>> {
        self.heard.set(self.heard.get().wrapping_add(1));
        if self.find(frame.unit()).is_none() {
            return Some(frame);
        }
        self.asked.signal(frame);
        None
    }
}

/// Runs for ever: the receive task of a port with a router. What is not routed goes where
/// [`receive`](crate::receive()) would hand it.
///
/// # Cancellation
/// Safe: a frame not yet passed on is given back to the line.
pub async fn receive_and_route<L: Line, D: Diagnostics, const N: usize>(
    port: &'static Port<L, D>,
    router: &'static Router<L, N>,
) -> ! {
    loop {
        match port.line.receive().await {
            Ok(frame) => {
                if let Some(frame) = router.offer(frame)
                    && port.server.is_concerned(frame.unit())
                {
                    port.requests.signal(frame);
                }
            }
            Err(flaws) => port.server.damaged(flaws),
        }
    }
}

/// Runs for ever: asks what is to be routed, and sends the answers on the asker's `line`.
///
/// # Cancellation
/// Safe at any await: the request is given up.
pub async fn route<L: Line, const N: usize>(line: &L, router: &'static Router<L, N>) -> ! {
    let mut adu: Adu = [0; 256];
    let mut next = None;
    loop {
        let frame = match next.take() {
            Some(frame) => frame,
            None => router.asked.wait().await,
        };
        // Copied, so that the asker's line can hear what it does meanwhile.
        let Some(len) = take(frame, &mut adu).await else {
            continue;
        };
        let heard = router.heard.get();
        let len = match select(ask(router, &mut adu, len), router.asked.wait()).await {
            Either::First(len) => len,
            Either::Second(frame) => {
                next = Some(frame);
                continue;
            }
        };
        if len == 0 {
            continue;
        }
        let mut frame = match select(line.lend(), router.asked.wait()).await {
            Either::First(frame) => frame,
            Either::Second(frame) => {
                next = Some(frame);
                continue;
            }
        };
        // Whoever has asked for something else since has given this up, and might take it for that.
        if router.heard.get() == heard {
            *frame.adu() = adu;
            frame.release(len);
            // Somebody who talks instead has given it up as well.
            frame.sent().await;
        }
    }
}

/// The request, if it stands, as its length.
async fn take<L: Line>(mut frame: Frame<'static, L>, adu: &mut Adu) -> Option<u8> {
    *adu = *frame.bytes();
    let len = frame.request_len();
    frame.settle().await.then_some(len)
}

/// Asks, and puts the answer in the place of the request; returns its length, 0 for none.
async fn ask<L: Line, const N: usize>(router: &'static Router<L, N>, adu: &mut Adu, len: u8) -> u8 {
    let unit = adu[0];
    let Some(route) = router.find(unit) else {
        return 0;
    };
    let code = adu[1];
    let request = Forwarded(&adu[1..usize::from(len)]);
    let exception = match route.through.transact(route.target, &request).await {
        Ok(Some(reply)) => {
            let bytes = reply.bytes();
            let Some(place) = adu.get_mut(..bytes.len()) else {
                return 0;
            };
            place.copy_from_slice(bytes);
            let len = bytes.len() as u8;
            adu[0] = unit;
            return len;
        }
        // Told to listen only: nobody answers that.
        Ok(None) => return 0,
        Err(ClientError::Exception(exception)) => exception.code(),
        Err(ClientError::UnknownException(code)) => code,
        // Function codes that none is asked with.
        Err(ClientError::Request(_)) => Exception::IllegalFunction.code(),
        Err(ClientError::QueueFull | ClientError::NoSilence) => {
            Exception::GatewayPathUnavailable.code()
        }
        Err(_) => Exception::GatewayTargetFailedToRespond.code(),
    };
    adu[1] = code | EXCEPTION_BIT;
    adu[2] = exception;
    3
}

/// Function code and data as they came in.
struct Forwarded<'a>(&'a [u8]);

impl Request for Forwarded<'_> {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        let function = self.0.first().copied().unwrap_or(0);
        if function == 0 || function & EXCEPTION_BIT != 0 {
            return Err(RequestError::Function { function });
        }
        for &byte in self.0 {
            draft.byte(byte);
        }
        if matches!(self.0, [DIAGNOSTICS, 0, 4, 0, 0]) {
            draft.silence();
        }
        Ok(())
    }

    fn check(&self, _: &[u8]) -> Result<(), AnswerError> {
        Ok(())
    }
}
