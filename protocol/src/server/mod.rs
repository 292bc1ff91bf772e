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
//! use multidrop_protocol::server::{DataModel, Functions, Plan, Server};
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
//! const SERVER: Server<Heater> = Server::new(17, Functions::standard());
//!
//! let mut heater = Heater { setpoints: Bank::new(100) };
//! let mut frame = [0; 256];
//! // Write Single Register: register 101 becomes 215.
//! frame[..6].copy_from_slice(&[17, 6, 0, 101, 0, 215]);
//! let plan = SERVER.prepare(&mut heater, &mut frame, 6);
//! assert_eq!(heater.setpoints.get(101), Some(0));
//! assert_eq!(plan, Plan::Write { len: 6 });
//! assert_eq!(SERVER.commit(&mut heater, &mut frame, 6, plan), 6);
//! assert_eq!(heater.setpoints.get(101), Some(215));
//! ```

mod functions;
mod model;
mod read_bits;
mod read_registers;
mod write_bits;
mod write_registers;

pub use functions::{ApplicationFunction, Function, Functions};
pub use model::DataModel;

use crate::exception::Exception;
use crate::{Adu, BROADCAST, UNIT_MAX, UNIT_MIN, function};

/// Unit id and function code: the least a frame can be.
const LEN_MIN: u8 = 2;
/// Unit id and the longest PDU.
const LEN_MAX: u8 = 254;
/// Unit id, function code and exception code.
const EXCEPTION_LEN: u8 = 3;
/// What a write is answered with: unit id, function code, address, and value or quantity, as they stand in the request.
const WRITE_ANSWER_LEN: u8 = 6;

/// What is to be done with a request when its frame stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plan {
    /// Nothing: it is for another unit, or a broadcast that is not executed.
    Ignore,
    /// The answer, a read or an exception, is in `frame[..len]` and final.
    Answer {
        /// Bytes of unit id and PDU, 3..=254.
        len: u8,
    },
    /// A checked write, to be executed by [`Server::commit`]. The frame is as it came in; its beginning is the answer.
    Write {
        /// Bytes of unit id and PDU, 6; 0 for a broadcast.
        len: u8,
    },
    /// A function of the application, to be run by [`Server::commit`]. The frame is as it came in.
    Call,
}

/// A server with one unit id.
pub struct Server<M: 'static> {
    unit: u8,
    functions: Functions<M>,
}

impl<M> Server<M> {
    /// A server with this unit id, 1..=247.
    ///
    /// # Panics
    ///
    /// If `unit` is out of range; in a `const` that is a build error.
    pub const fn new(unit: u8, functions: Functions<M>) -> Server<M> {
        assert!(
            unit >= UNIT_MIN && unit <= UNIT_MAX,
            "unit id must be 1..=247"
        );
        Server { unit, functions }
    }

    /// The unit id.
    #[inline]
    pub const fn unit(&self) -> u8 {
        self.unit
    }
}

impl<M: DataModel> Server<M> {
    /// Checks the request in `frame[..len]`, unit id and PDU without CRC, and makes the answer in its place.
    ///
    /// `frame[..len]` is a good frame: its CRC matched. The model is asked for values and checks but not changed. When the
    /// frame turns out void, drop the plan: nothing has happened but that `frame[..254]` may be overwritten.
    #[inline(never)]
    pub fn prepare(&self, model: &mut M, frame: &mut Adu, len: u8) -> Plan {
        if !(LEN_MIN..=LEN_MAX).contains(&len) {
            return Plan::Ignore;
        }
        let broadcast = frame[0] == BROADCAST;
        if !broadcast && frame[0] != self.unit {
            return Plan::Ignore;
        }
        let planned = match frame[1] {
            function::READ_COILS | function::READ_DISCRETE_INPUTS => {
                if broadcast {
                    return Plan::Ignore;
                }
                read_bits::prepare(model, frame, len)
            }
            function::READ_HOLDING_REGISTERS | function::READ_INPUT_REGISTERS => {
                if broadcast {
                    return Plan::Ignore;
                }
                read_registers::prepare(model, frame, len)
            }
            function::WRITE_SINGLE_COIL | function::WRITE_MULTIPLE_COILS => {
                write_bits::prepare(model, frame, len)
            }
            function::WRITE_SINGLE_REGISTER | function::WRITE_MULTIPLE_REGISTERS => {
                write_registers::prepare(model, frame, len)
            }
            code => self.functions.prepare(code, broadcast),
        };
        match planned {
            Ok(Plan::Write { .. }) if broadcast => Plan::Write { len: 0 },
            Ok(plan) => plan,
            Err(_) if broadcast => Plan::Ignore,
            Err(exception) => Plan::Answer {
                len: refuse(frame, exception),
            },
        }
    }

    /// Does what [`prepare`](Server::prepare) planned for the request of `request_len` bytes in `frame`, once the frame
    /// stands, and returns the length of the answer in it: 3..=254 bytes of unit id and PDU, or 0 to say nothing.
    ///
    /// Where [`DataModel::WRITES_MAY_FAIL`] is `false`, a [`Plan::Write`] leaves the frame untouched, so the answer may be
    /// on its way already.
    pub fn commit(&self, model: &mut M, frame: &mut Adu, request_len: u8, plan: Plan) -> u8 {
        match plan {
            Plan::Ignore => 0,
            Plan::Answer { len } => len,
            Plan::Write { len } => match self.write(model, frame) {
                Err(exception) if M::WRITES_MAY_FAIL && len != 0 => refuse(frame, exception),
                _ => len,
            },
            Plan::Call => self.functions.call(model, frame, request_len),
        }
    }

    /// Executes the write that was planned as [`Plan::Write`] and nothing else. [`commit`](Server::commit) does it for those
    /// who are not sending the answer from the same buffer meanwhile.
    ///
    /// # Errors
    ///
    /// The model's, if its writes may fail.
    pub fn write(&self, model: &mut M, frame: &Adu) -> Result<(), Exception> {
        match frame[1] {
            function::WRITE_SINGLE_COIL | function::WRITE_MULTIPLE_COILS => {
                write_bits::commit(model, frame)
            }
            _ => write_registers::commit(model, frame),
        }
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
