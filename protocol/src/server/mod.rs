//! The server: makes the answer to a request in the buffer that holds the request.
//!
//! It works in two phases. A frame that seems to have ended with a silence of t1.5 is void if another character comes
//! before t3.5. [`Server::prepare`] runs in between: it checks the request and makes the answer, but changes nothing.
//! [`Server::commit`] runs when the frame stands. So an answer can start at t3.5, the earliest moment that the
//! standard allows.
//!
//! The order of the checks is that of the state diagrams in APP 6: function, quantity and length, addresses, values,
//! and then the operation itself. A write is executed whole or not at all.
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
mod reset;
mod status;
mod write_bits;
mod write_registers;

pub use counted::Counted;
pub use device_id::Conformity;
pub use diagnostics::{Diagnostics, Uncounted};
pub use functions::{ApplicationFunction, Function, FunctionSet};
pub use model::DataModel;
pub use reset::ResetCause;

use core::cell::Cell;

use crate::exception::Exception;
use crate::frame::{LEN_MAX, LEN_MIN, ReceiveErrors};
use crate::{Adu, BROADCAST, UNIT_MAX, UNIT_MIN, function};

/// Bytes of unit id, function code and one word.
const REQUEST_HEAD: u8 = 4;
/// Bytes of unit id, function code, address and quantity.
const READ_LEN: u8 = 6;
/// Bytes of unit id, function code and exception code.
const EXCEPTION_LEN: u8 = 3;
/// Bytes of the answer to a write: unit id, function code, address, and value or quantity, as in the request.
const WRITE_ANSWER_LEN: u8 = 6;

/// The action for a request when its frame stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plan {
    /// No action, since the request is for another unit.
    Ignore,
    /// Only count the request: a broadcast that is not executed, or a request in listen-only mode.
    Silent {
        /// The exception that is not sent.
        refused: Option<Exception>,
    },
    /// Send the answer in `frame[..len]`, which is complete: a read or an exception.
    Answer {
        /// Bytes of unit id and PDU, 3..=254.
        len: u8,
    },
    /// Execute a sub-function of Diagnostics by [`Server::commit`]. The frame holds the request, which is the answer
    /// as well.
    Diagnose {
        /// Bytes of unit id and PDU, 6; 0 if there is no answer.
        len: u8,
    },
    /// Execute a checked write by [`Server::commit`]. The frame holds the request; its beginning is the answer.
    Write {
        /// Bytes of unit id and PDU of the answer; 0 for a broadcast.
        len: u8,
    },
    /// Execute a request by [`Server::commit`] whose answer depends on the execution: a function of the application,
    /// Mask Write Register, or Read/Write Multiple Registers. The frame holds the request.
    Call,
}

impl Plan {
    /// The length of the answer that may be sent as soon as the frame stands, in `frame[..len]`; 0 if there is none,
    /// or if it is made by [`Server::commit`].
    #[inline]
    pub fn answer_at_once<M: DataModel>(self) -> u8 {
        match self {
            Plan::Answer { len } | Plan::Diagnose { len } => len,
            Plan::Write { len } if !M::WRITES_MAY_FAIL => len,
            _ => 0,
        }
    }
}

/// A server with one unit id, with counters if `D` has them. See [`Diagnostics`].
#[derive(Debug)]
pub struct Server<D = Uncounted> {
    unit: Cell<u8>,
    diagnostics: D,
}

impl Server {
    /// A server with this unit id, 1..=247, without counters.
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

    /// The server's unit id.
    #[inline]
    pub const fn unit(&self) -> u8 {
        self.unit.get()
    }

    /// Sets the unit id from the next request on; returns `false` and changes nothing unless it is 1..=247.
    pub fn set_unit(&self, unit: u8) -> bool {
        let valid = (UNIT_MIN..=UNIT_MAX).contains(&unit);
        if valid {
            self.unit.set(unit);
        }
        valid
    }

    /// The server's counters.
    #[inline]
    pub const fn diagnostics(&self) -> &D {
        &self.diagnostics
    }
}

impl<D: Diagnostics> Server<D> {
    /// Whether a good frame to this unit id must be passed to [`prepare`](Server::prepare): a request to this server,
    /// or any frame if the server has counters.
    #[inline]
    pub fn is_concerned(&self, unit: u8) -> bool {
        D::COUNTS || unit == self.unit() || unit == BROADCAST
    }

    /// Counts a damaged frame for any unit. Call it once for each.
    #[inline]
    pub fn damaged(&self, errors: ReceiveErrors) {
        self.diagnostics.damaged(errors);
    }

    /// The character behind CR that ends an ASCII frame. FC 08 can change it, so read it after each answer.
    #[inline]
    pub fn delimiter(&self) -> u8 {
        self.diagnostics.delimiter()
    }

    /// Checks the request in `frame[..len]`, unit id and PDU without CRC, and replaces it by the answer.
    ///
    /// `frame[..len]` must be a good frame, whose CRC was checked. The model is read and asked for checks, but not
    /// changed. If the frame becomes void, drop the plan: nothing has changed, except that `frame[..254]` may be
    /// overwritten.
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

    /// Counts an answer that was cut off after [`commit`](Server::commit) had returned it. A server with counters
    /// counts the request as one without an answer.
    #[inline(always)]
    pub fn cut_off(&self) {
        self.diagnostics.cut_off();
    }

    /// Executes the plan of [`prepare`](Server::prepare) for the request of `request_len` bytes in `frame`, when the
    /// frame stands. Returns the length of the answer in `frame`: 3..=254 bytes of unit id and PDU, or 0 for no
    /// answer.
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

    /// Executes a plan like [`commit`](Server::commit), also if the answer is already being sent: the one whose
    /// length is [`Plan::answer_at_once`].
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

/// Access to the frame of a request.
#[derive(Debug)]
pub enum Access<'a> {
    /// The frame may be changed.
    Owned(&'a mut Adu),
    /// The frame is being sent and may only be read.
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

/// Whether `code` is this function and the model has it. The compiler removes functions that it has not.
#[inline(always)]
fn serves<M: DataModel>(code: u8, function: u8) -> bool {
    M::FUNCTIONS.has(function) && code == function
}

/// Executes a [`Plan::Write`].
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

/// Executes a [`Plan::Call`].
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

/// Replaces the request in `frame` by the exception answer; returns its length.
fn refuse(frame: &mut Adu, exception: Exception) -> u8 {
    frame[1] |= function::EXCEPTION_BIT;
    frame[2] = exception.code();
    EXCEPTION_LEN
}

/// The two words of a request: address and quantity, or address and value.
#[inline(always)]
fn two_words(frame: &Adu) -> (u16, u16) {
    (
        u16::from_be_bytes([frame[2], frame[3]]),
        u16::from_be_bytes([frame[4], frame[5]]),
    )
}

/// Address and quantity of a request to read a block of 1..=`max` items.
///
/// # Errors
/// The exception to answer with.
#[inline(always)]
fn read_block(frame: &Adu, len: u8, max: u16) -> Result<(u16, u16), Exception> {
    let (first, count) = two_words(frame);
    if len != READ_LEN || count == 0 || count > max {
        return Err(Exception::IllegalDataValue);
    }
    check_end(first, count)?;
    Ok((first, count))
}

/// Refuses a block of `count` items, at least 1, that runs past address 65535.
#[inline(always)]
fn check_end(first: u16, count: u16) -> Result<(), Exception> {
    match first.checked_add(count - 1) {
        Some(_) => Ok(()),
        None => Err(Exception::IllegalDataAddress),
    }
}
