//! One request, from its turn to its end.
#![expect(
    clippy::manual_async_fn,
    reason = "an async fn keeps each argument twice, and there is one of these futures for each port"
)]

use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::Poll;

use embassy_time::{Instant, Timer};
use multidrop_protocol::client::{Request, encode, judge};
use multidrop_protocol::data::Registers;
use multidrop_protocol::exception::Exception;
use multidrop_protocol::rtu::Flaws;

use super::exchange::{Turn, poll_over};
use super::{Client, ClientError, duration};
use crate::line::{Frame, Line};

/// An answer that stands, in the buffer of the line. As long as it lives the line hears nothing and nobody
/// else can ask: read it, drop it, and do not keep it over an await.
pub struct Reply<L: Line + 'static, const N: usize> {
    frame: Frame<'static, L>,
    // Dropped behind the frame: who has the turn next finds the buffer free.
    _turn: Turn<N>,
}

impl<L: Line + 'static, const N: usize> Reply<L, N> {
    /// Unit id, function code and data.
    pub fn bytes(&self) -> &[u8] {
        heard(&self.frame)
    }
}

/// Where the data of a read goes.
pub(super) enum Destination<'a> {
    /// Nowhere.
    Nothing,
    /// Registers.
    Registers(&'a mut [u16]),
    /// Coils or discrete inputs.
    Bits(&'a mut [bool]),
    /// The same, eight to a byte.
    Packed(&'a mut [u8]),
}

impl Destination<'_> {
    /// Takes the data behind unit id, function code and byte count of an answer that is as the request demands.
    #[inline(never)]
    fn take(&mut self, frame: &[u8]) {
        let data = frame.get(3..).unwrap_or(&[]);
        match self {
            Self::Nothing => {}
            Self::Registers(cells) => Registers::new(data).copy_to(cells),
            Self::Bits(cells) => {
                for (eight, &byte) in cells.chunks_mut(8).zip(data) {
                    let mut byte = byte;
                    for cell in eight {
                        *cell = byte & 1 != 0;
                        byte >>= 1;
                    }
                }
            }
            Self::Packed(cells) => {
                for (cell, &byte) in cells.iter_mut().zip(data) {
                    *cell = byte;
                }
            }
        }
    }
}

impl<L: Line + 'static, const N: usize> Client<L, N> {
    /// Sends any request to `unit` (1..=247, or 0 for a broadcast where the function allows it) and waits for its
    /// answer. `None` if there is none to wait for: after a broadcast, and after Force Listen Only Mode.
    ///
    /// The methods named after functions do the same and give the data.
    ///
    /// # Errors
    /// [`ClientError`].
    ///
    /// # Cancellation
    /// Safe, see [`Client`].
    pub fn transact(
        &self,
        unit: u8,
        request: &dyn Request,
    ) -> impl Future<Output = Result<Option<Reply<L, N>>, ClientError>> {
        self.run(unit, request, Destination::Nothing)
    }

    /// The same, and the data goes to `into`: at t1.5, before it is known whether the answer stands. What takes
    /// long is done then, and the next request starts in time.
    pub(super) fn run(
        &self,
        unit: u8,
        request: &dyn Request,
        mut into: Destination<'_>,
    ) -> impl Future<Output = Result<Option<Reply<L, N>>, ClientError>> {
        async move {
            let mut retries = self.config().retries;
            loop {
                let turn = self.exchange.turn().await?;
                let error = 'tried: {
                    if self.exchange.is_owed() {
                        // The answer to a request that was given up is dropped; or all are done with a broadcast.
                        let expecting = self.exchange.expect();
                        let until = self.exchange.owed_until();
                        while let Some(Err(_)) = expecting.heard_until(until).await {}
                        drop(expecting);
                        self.exchange.settle();
                    }

                    // Of the wait for silence first, then of that for the answer.
                    let mut deadline = Instant::MIN;
                    let (function, answered, debt) = loop {
                        let Some(mut frame) = self.lend(&mut deadline).await else {
                            break 'tried ClientError::NoSilence;
                        };
                        let encoded = encode(request, unit, frame.adu())?;
                        let function = frame.bytes()[1];
                        frame.release(encoded.len);
                        let debt = self.exchange.owe(if encoded.answered {
                            self.config().timeout()
                        } else {
                            self.config().turnaround()
                        });
                        if frame.sent().await {
                            let sent = &frame.bytes()[..usize::from(encoded.len)];
                            self.line.show(Ok(sent));
                            break (function, encoded.answered, debt);
                        }
                        debt.settle();
                        if self.line.was_cut() {
                            break 'tried ClientError::CutOff;
                        }
                        // Somebody has begun to talk.
                    };
                    if !answered {
                        Timer::after(duration(self.config().turnaround())).await;
                        debt.settle();
                        return Ok(None);
                    }

                    let expecting = self.exchange.expect();
                    deadline = self.timeout();
                    let mut end = ClientError::Timeout;
                    let mut acknowledged = false;
                    let error = loop {
                        let Some(heard) = expecting.heard_until(deadline).await else {
                            break end;
                        };
                        let error = match heard {
                            Err(flaws) => ClientError::Damaged(flaws),
                            Ok(mut frame) => {
                                let judged = judge(request, unit, function, self::heard(&frame));
                                if judged.is_ok() {
                                    into.take(self::heard(&frame));
                                }
                                match judged {
                                    Err(error) if !error.is_exception() => error.into(),
                                    _ if !frame.settle().await => ClientError::Damaged(Flaws::GAP),
                                    Ok(()) => {
                                        debt.settle();
                                        return Ok(Some(Reply { frame, _turn: turn }));
                                    }
                                    Err(error) => error.into(),
                                }
                            }
                        };
                        match error {
                            ClientError::Exception(Exception::Acknowledge) if !acknowledged => {
                                acknowledged = true;
                                deadline = self.timeout();
                                end = error;
                            }
                            ClientError::Exception(_) | ClientError::UnknownException(_) => {
                                break error;
                            }
                            // Once the server has accepted the request, that is what is to be told.
                            _ if acknowledged => {}
                            _ => end = error,
                        }
                    };
                    debt.settle();
                    error
                };
                // Others may ask before this is tried again.
                drop(turn);
                if retries == 0 || !error.is_passing() {
                    return Err(error);
                }
                retries -= 1;
                if matches!(error, ClientError::Exception(_)) {
                    Timer::after(duration(self.config().timeout())).await;
                }
            }
        }
    }

    /// When a wait is over that begins now.
    #[inline(never)]
    fn timeout(&self) -> Instant {
        Instant::now() + duration(self.config().timeout())
    }

    /// The buffer to send from, or `None` if it is not to be had until a timeout is over. The time is looked at only if
    /// there is anything to wait for: a request right after an answer has none to lose. `deadline` is set then, if it
    /// is not yet.
    fn lend(&self, deadline: &mut Instant) -> impl Future<Output = Option<Frame<'static, L>>> {
        poll_fn(|context| {
            if let Poll::Ready(frame) = pin!(self.line.lend()).poll(context) {
                return Poll::Ready(Some(frame));
            }
            if *deadline == Instant::MIN {
                *deadline = self.timeout();
            }
            poll_over(*deadline, context).map(|()| None)
        })
    }
}

/// The bytes of a frame that was heard.
fn heard<'a, L: Line>(frame: &'a Frame<'static, L>) -> &'a [u8] {
    &frame.bytes()[..usize::from(frame.request_len())]
}
