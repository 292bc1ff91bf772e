//! The server: a request in, an answer out, in the one buffer the request came in.
//!
//! It works in two phases, because a frame that a silence of t1.5 seems to have ended may still turn out bad when another
//! byte comes before t3.5. [`Server::prepare`] runs in between: it checks the request and makes the answer, but changes
//! nothing. [`Server::commit`] runs when the frame stands. So an answer is ready to start at t3.5, the earliest moment the
//! standard allows.
//!
//! The order of the checks is that of the state diagrams in APP 6: function, quantity and length, addresses, values, and the
//! operation itself. A write is all or nothing.
//!
//! # Example
//!
//! ```
//! use multidrop_protocol::data::{Registers, RegistersOut};
//! use multidrop_protocol::exception::Exception;
//! use multidrop_protocol::registers::Bank;
//! use multidrop_protocol::server::{DataModel, Plan, Server};
//!
//! struct Heater {
//!     setpoints: Bank<4>,
//! }
//!
//! impl DataModel for Heater {
//!     fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
//!         self.setpoints.read(first, out)
//!     }
//!     fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
//!         self.setpoints.check(first, values)
//!     }
//!     fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
//!         self.setpoints.write(first, values)
//!     }
//! }
//!
//! let server = Server::new(17);
//! let mut heater = Heater { setpoints: Bank::new(100) };
//! let mut frame = [0; 256];
//! // Write Single Register: register 101 becomes 215.
//! frame[..6].copy_from_slice(&[17, 6, 0, 101, 0, 215]);
//! let plan = server.prepare(&mut heater, &mut frame, 6);
//! assert_eq!(heater.setpoints.get(101), Some(0));
//! assert_eq!(plan, Plan::Write { len: 6 });
//! assert_eq!(server.commit(&mut heater, &mut frame, 6, plan), 6);
//! assert_eq!(heater.setpoints.get(101), Some(215));
//! ```

mod counted;
mod device_id;
mod diagnostics;
mod event_log;
mod file_records;
mod functions;
mod mask_write;
mod model;
mod read_bits;
mod read_fifo;
mod read_registers;
mod read_write_registers;
mod status;
mod write_bits;
mod write_registers;

pub use counted::Counted;
pub use device_id::Conformity;
pub use diagnostics::{Diagnostics, Uncounted};
pub use functions::{ApplicationFunction, Function, FunctionSet};
pub use model::DataModel;

use core::cell::Cell;

use crate::exception::Exception;
use crate::{Adu, BROADCAST, UNIT_MAX, UNIT_MIN, function};

/// Unit id and function code: the least a frame can be.
const LEN_MIN: u8 = 2;
/// Unit id and the longest PDU.
const LEN_MAX: u8 = 254;
/// Unit id, function code and one word.
const REQUEST_HEAD: u8 = 4;
/// Unit id, function code and exception code.
const EXCEPTION_LEN: u8 = 3;
/// What a write is answered with: unit id, function code, address, and value or quantity, as they stand in the request.
const WRITE_ANSWER_LEN: u8 = 6;

/// What is to be done with a request when its frame stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plan {
    /// Nothing: it is for another unit.
    Ignore,
    /// Nothing but to count it: a broadcast that is not executed, or the server listens only.
    Silent {
        /// The exception that nobody is told of.
        refused: Option<Exception>,
    },
    /// The answer, a read or an exception, is in `frame[..len]` and final.
    Answer {
        /// Bytes of unit id and PDU, 3..=254.
        len: u8,
    },
    /// A sub-function of Diagnostics that changes something, to be executed by [`Server::commit`]. The frame is as it came in
    /// and is the answer.
    Diagnose {
        /// Bytes of unit id and PDU, 6; 0 for what is not answered.
        len: u8,
    },
    /// A checked write, to be executed by [`Server::commit`]. The frame is as it came in; its beginning is the answer.
    Write {
        /// Bytes of unit id and PDU, as many as the answer has; 0 for a broadcast.
        len: u8,
    },
    /// What has no answer before it is executed, by [`Server::commit`]: a function of the application, Mask Write Register, and
    /// Read/Write Multiple Registers. The frame is as it came in.
    Call,
}

impl Plan {
    /// How long the answer is that may go out as soon as the frame stands, in `frame[..len]` already; 0 if there is none or it
    /// has to wait for [`Server::commit`].
    #[inline]
    pub fn answer_at_once<M: DataModel>(self) -> u8 {
        match self {
            Plan::Answer { len } | Plan::Diagnose { len } => len,
            Plan::Write { len } if !M::WRITES_MAY_FAIL => len,
            _ => 0,
        }
    }
}

/// A server with one unit id, which counts if `D` does. See [`Diagnostics`].
#[derive(Debug)]
pub struct Server<D = Uncounted> {
    unit: Cell<u8>,
    diagnostics: D,
}

impl Server {
    /// A server with this unit id, 1..=247, that does not count.
    ///
    /// # Panics
    ///
    /// If `unit` is out of range; in a `const` that is a build error.
    pub const fn new(unit: u8) -> Server {
        Server::with(unit, Uncounted)
    }
}

impl<const LOG: usize> Server<Counted<LOG>> {
    /// A server with this unit id, 1..=247, with all counters and a log of `LOG` events, 0..=64.
    ///
    /// # Panics
    ///
    /// If `unit` is out of range; in a `const` that is a build error.
    pub const fn counted(unit: u8) -> Server<Counted<LOG>> {
        Server::with(unit, Counted::new())
    }
}

impl<D> Server<D> {
    /// A server with this unit id, 1..=247, and these counters.
    ///
    /// # Panics
    ///
    /// If `unit` is out of range; in a `const` that is a build error.
    pub const fn with(unit: u8, diagnostics: D) -> Server<D> {
        assert!(
            unit >= UNIT_MIN && unit <= UNIT_MAX,
            "unit id must be 1..=247"
        );
        Server {
            unit: Cell::new(unit),
            diagnostics,
        }
    }

    /// The unit id.
    #[inline]
    pub const fn unit(&self) -> u8 {
        self.unit.get()
    }

    /// Another unit id from the next request on; `false`, and nothing changed, unless it is 1..=247.
    pub fn set_unit(&self, unit: u8) -> bool {
        let valid = (UNIT_MIN..=UNIT_MAX).contains(&unit);
        if valid {
            self.unit.set(unit);
        }
        valid
    }

    /// The counters.
    #[inline]
    pub const fn diagnostics(&self) -> &D {
        &self.diagnostics
    }
}

impl<D: Diagnostics> Server<D> {
    /// Whether a good frame to this unit id is one to [`prepare`](Server::prepare): a request to this server, or any frame at
    /// all if it counts them.
    #[inline]
    pub fn is_concerned(&self, unit: u8) -> bool {
        D::COUNTS || unit == self.unit() || unit == BROADCAST
    }

    /// A damaged frame was heard, whoever it was for. Once for each.
    #[inline]
    pub fn damaged(&self, errors: crate::rtu::ReceiveErrors) {
        self.diagnostics.damaged(errors);
    }

    /// The character that ends an ASCII frame behind CR, after an answer is sent: FC 08 may have changed it.
    #[inline]
    pub fn delimiter(&self) -> u8 {
        self.diagnostics.delimiter()
    }

    /// Checks the request in `frame[..len]`, unit id and PDU without CRC, and makes the answer in its place.
    ///
    /// `frame[..len]` is a good frame: its CRC matched. The model is asked for values and checks but not changed. When the
    /// frame turns out void, drop the plan: nothing has happened but that `frame[..254]` may be overwritten.
    #[inline(never)]
    pub fn prepare<M: DataModel>(&self, model: &mut M, frame: &mut Adu, len: u8) -> Plan {
        if !(LEN_MIN..=LEN_MAX).contains(&len) {
            return Plan::Ignore;
        }
        let broadcast = frame[0] == BROADCAST;
        if !broadcast && frame[0] != self.unit() {
            return Plan::Ignore;
        }
        if self.diagnostics.is_deaf_to(frame, len) {
            return Plan::Silent { refused: None };
        }
        match self.plan(model, frame, len, broadcast) {
            Ok(Plan::Write { .. }) if broadcast => Plan::Write { len: 0 },
            Ok(plan) => plan,
            Err(exception) if broadcast => Plan::Silent {
                refused: Some(exception),
            },
            Err(exception) => Plan::Answer {
                len: refuse(frame, exception),
            },
        }
    }

    #[inline(always)]
    fn plan<M: DataModel>(
        &self,
        model: &mut M,
        frame: &mut Adu,
        len: u8,
        broadcast: bool,
    ) -> Result<Plan, Exception> {
        use function::*;
        let code = frame[1];
        let is = |function| serves::<M>(code, function);
        let reads = is(READ_COILS)
            || is(READ_DISCRETE_INPUTS)
            || is(READ_HOLDING_REGISTERS)
            || is(READ_INPUT_REGISTERS)
            || is(READ_EXCEPTION_STATUS)
            || is(REPORT_SERVER_ID)
            || is(READ_FILE_RECORD)
            || is(READ_FIFO_QUEUE)
            || is(ENCAPSULATED_INTERFACE);
        if broadcast && reads {
            return Ok(Plan::Silent { refused: None });
        }
        if is(READ_COILS) || is(READ_DISCRETE_INPUTS) {
            read_bits::prepare(model, frame, len)
        } else if is(READ_HOLDING_REGISTERS) || is(READ_INPUT_REGISTERS) {
            read_registers::prepare(model, frame, len)
        } else if is(WRITE_SINGLE_COIL) || is(WRITE_MULTIPLE_COILS) {
            write_bits::prepare(model, frame, len)
        } else if is(WRITE_SINGLE_REGISTER) || is(WRITE_MULTIPLE_REGISTERS) {
            write_registers::prepare(model, frame, len)
        } else if is(READ_EXCEPTION_STATUS) || is(REPORT_SERVER_ID) {
            status::prepare(model, frame, len)
        } else if is(MASK_WRITE_REGISTER) {
            mask_write::check(model, frame, len).map(|_| Plan::Call)
        } else if is(READ_WRITE_REGISTERS) {
            read_write_registers::check(model, frame, len).map(|()| Plan::Call)
        } else if is(READ_FIFO_QUEUE) {
            read_fifo::prepare(model, frame, len)
        } else if is(ENCAPSULATED_INTERFACE) {
            device_id::prepare(model, frame, len)
        } else if is(READ_FILE_RECORD) {
            file_records::prepare_read(model, frame, len)
        } else if is(WRITE_FILE_RECORD) {
            file_records::prepare_write(model, frame, len)
        } else if D::COUNTS
            && matches!(
                code,
                DIAGNOSTICS | GET_COMM_EVENT_COUNTER | GET_COMM_EVENT_LOG
            )
        {
            self.diagnostics.prepare(frame, len, model.is_busy())
        } else {
            functions::prepare::<M>(code, broadcast)
        }
    }

    /// The answer to a request did not go out, although [`commit`](Server::commit) has given it: it was cut off. A server that
    /// counts has one more request that was not answered.
    #[inline(always)]
    pub fn cut_off(&self) {
        self.diagnostics.cut_off();
    }

    /// Does what [`prepare`](Server::prepare) planned for the request of `request_len` bytes in `frame`, once the frame
    /// stands, and returns the length of the answer in it: 3..=254 bytes of unit id and PDU, or 0 to say nothing.
    #[inline(always)]
    pub fn commit<M: DataModel>(
        &self,
        model: &mut M,
        frame: &mut Adu,
        request_len: u8,
        plan: Plan,
    ) -> u8 {
        self.conclude(model, Access::Owned(frame), request_len, plan)
    }

    /// [`commit`](Server::commit), also for a request whose answer may be on its way already: one of which
    /// [`Plan::answer_at_once`] has the length.
    pub fn conclude<M: DataModel>(
        &self,
        model: &mut M,
        mut frame: Access<'_>,
        request_len: u8,
        plan: Plan,
    ) -> u8 {
        let mut refused = None;
        let answer_len = match plan {
            Plan::Ignore => {
                self.diagnostics.overheard();
                return 0;
            }
            Plan::Silent { refused: exception } => {
                refused = exception;
                0
            }
            Plan::Answer { len } => {
                let frame = frame.read();
                if D::COUNTS && len == EXCEPTION_LEN && frame[1] & function::EXCEPTION_BIT != 0 {
                    refused = Exception::from_code(frame[2]);
                }
                len
            }
            Plan::Diagnose { len } => len,
            Plan::Write { len } => {
                let written = write(model, frame.read());
                if M::WRITES_MAY_FAIL {
                    refused = written.err();
                }
                match (written, &mut frame) {
                    (Err(exception), Access::Owned(frame)) if M::WRITES_MAY_FAIL && len != 0 => {
                        refuse(frame, exception)
                    }
                    _ => len,
                }
            }
            Plan::Call => {
                let Access::Owned(frame) = &mut frame else {
                    return 0;
                };
                let outcome = call(model, frame, request_len);
                refused = outcome.err();
                functions::answer(frame, outcome)
            }
        };
        self.diagnostics
            .completed(frame.read(), plan, answer_len, refused);
        answer_len
    }
}

/// What may be done with a frame.
#[derive(Debug)]
pub enum Access<'a> {
    /// Everything.
    Owned(&'a mut Adu),
    /// It is being sent.
    Released(&'a Adu),
}

impl Access<'_> {
    #[inline(always)]
    fn read(&self) -> &Adu {
        match self {
            Access::Owned(frame) => frame,
            Access::Released(frame) => frame,
        }
    }
}

/// Whether `code` is this function and the model has it. What it has not is gone when this is compiled.
#[inline(always)]
fn serves<M: DataModel>(code: u8, function: u8) -> bool {
    M::FUNCTIONS.has(function) && code == function
}

/// Executes what was planned as [`Plan::Write`].
fn write<M: DataModel>(model: &mut M, frame: &Adu) -> Result<(), Exception> {
    use function::*;
    let code = frame[1];
    let is = |function| serves::<M>(code, function);
    if is(WRITE_FILE_RECORD) {
        file_records::write(model, frame)
    } else if is(WRITE_SINGLE_COIL) || is(WRITE_MULTIPLE_COILS) {
        write_bits::commit(model, frame)
    } else {
        write_registers::commit(model, frame)
    }
}

/// Executes what was planned as [`Plan::Call`].
fn call<M: DataModel>(model: &mut M, frame: &mut Adu, request_len: u8) -> Result<u8, Exception> {
    use function::*;
    let code = frame[1];
    let is = |function| serves::<M>(code, function);
    if is(MASK_WRITE_REGISTER) {
        mask_write::execute(model, frame, request_len)
    } else if is(READ_WRITE_REGISTERS) {
        read_write_registers::execute(model, frame, request_len)
    } else {
        functions::call(model, frame, request_len)
    }
}

/// Turns the request in `frame` into the exception answer, returns its length.
fn refuse(frame: &mut Adu, exception: Exception) -> u8 {
    frame[1] |= function::EXCEPTION_BIT;
    frame[2] = exception.code();
    EXCEPTION_LEN
}

/// Address and quantity, or address and value, of a request.
#[inline(always)]
fn two_words(frame: &Adu) -> (u16, u16) {
    (
        u16::from_be_bytes([frame[2], frame[3]]),
        u16::from_be_bytes([frame[4], frame[5]]),
    )
}

/// Refuses a block of `count` items, at least 1, that runs past address 65535.
#[inline(always)]
fn check_end(first: u16, count: u16) -> Result<(), Exception> {
    match first.checked_add(count - 1) {
        Some(_) => Ok(()),
        None => Err(Exception::IllegalDataAddress),
    }
}
