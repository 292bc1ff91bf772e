//! The functions of a server: a selection of the standard's, and those of the application.

use super::{DataModel, Plan, refuse};
use crate::exception::Exception;
use crate::function::{self, EXCEPTION_BIT, PDU_MAX};
use crate::{Adu, BROADCAST};

/// The standard's functions of a model, for [`DataModel::FUNCTIONS`]. Other functions are answered with exception 01
/// and take no flash.
///
/// Diagnostics, Get Comm Event Counter and Get Comm Event Log are not selected here: a server with counters has them,
/// see [`Server::counted`](super::Server::counted).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FunctionSet(u64);

impl FunctionSet {
    /// FC 01 to 06, 0F and 10: reading and writing coils, inputs and registers.
    pub const EIGHT: FunctionSet = FunctionSet(0)
        .with(function::READ_COILS)
        .with(function::READ_DISCRETE_INPUTS)
        .with(function::READ_HOLDING_REGISTERS)
        .with(function::READ_INPUT_REGISTERS)
        .with(function::WRITE_SINGLE_COIL)
        .with(function::WRITE_SINGLE_REGISTER)
        .with(function::WRITE_MULTIPLE_COILS)
        .with(function::WRITE_MULTIPLE_REGISTERS);

    /// All functions except those for file records: the eight, and FC 07, 11, 16, 17, 18 and 2B.
    pub const WITHOUT_FILES: FunctionSet = FunctionSet::EIGHT
        .with(function::READ_EXCEPTION_STATUS)
        .with(function::REPORT_SERVER_ID)
        .with(function::MASK_WRITE_REGISTER)
        .with(function::READ_WRITE_REGISTERS)
        .with(function::READ_FIFO_QUEUE)
        .with(function::ENCAPSULATED_INTERFACE);

    /// All functions that can be selected.
    pub const ALL: FunctionSet = FunctionSet::WITHOUT_FILES
        .with(function::READ_FILE_RECORD)
        .with(function::WRITE_FILE_RECORD);

    /// Adds the function with this code.
    ///
    /// # Panics
    ///
    /// If the standard has no such function, or it cannot be selected here; in a `const` that is a build error.
    pub const fn with(self, code: u8) -> FunctionSet {
        assert!(
            matches!(
                code,
                0x01..=0x07 | 0x0F..=0x11 | 0x14..=0x18 | function::ENCAPSULATED_INTERFACE
            ),
            "FunctionSet: the function code must be 01 to 07, 0F to 11, 14 to 18 or 2B"
        );
        FunctionSet(self.0 | 1 << code)
    }

    /// Removes the function with this code.
    pub const fn without(self, code: u8) -> FunctionSet {
        if code < 64 {
            FunctionSet(self.0 & !(1 << code))
        } else {
            self
        }
    }

    /// Whether the set has the function with this code.
    #[inline(always)]
    pub const fn has(self, code: u8) -> bool {
        code < 64 && self.0 >> code & 1 != 0
    }
}

/// A function of the application.
///
/// The arguments are the model, a PDU buffer of 253 bytes and the length of the request in it; `pdu[0]` is the
/// function code. The function writes the answer to the buffer and returns its length, function code included, or 0
/// for no answer. It is called when the frame stands, so it may change the model; it must check the request before it
/// does.
///
/// # Errors
///
/// The exception of the answer.
pub type Function<M> = fn(model: &mut M, pdu: &mut [u8], len: usize) -> Result<usize, Exception>;

/// A row of the table of functions, [`DataModel::APPLICATION`].
pub struct ApplicationFunction<M> {
    /// The function code, 1..=127. A row with the code of one of the server's own functions is never used.
    pub code: u8,
    /// Whether the function is executed as a broadcast, which has no answer.
    pub broadcast: bool,
    /// The function to call.
    pub run: Function<M>,
}

fn find<M: DataModel>(code: u8) -> Option<&'static ApplicationFunction<M>> {
    M::APPLICATION.iter().find(|row| row.code == code)
}

/// Returns [`Plan::Call`] if there is a function for this code.
pub(super) fn prepare<M: DataModel>(code: u8, broadcast: bool) -> Result<Plan, Exception> {
    if code == 0 || code & EXCEPTION_BIT != 0 {
        return Err(Exception::IllegalFunction);
    }
    match find::<M>(code) {
        Some(row) if broadcast && !row.broadcast => Ok(Plan::Silent { refused: None }),
        Some(_) => Ok(Plan::Call),
        None if M::DEFAULT.is_some() && broadcast => Ok(Plan::Silent { refused: None }),
        None if M::DEFAULT.is_some() => Ok(Plan::Call),
        None => Err(Exception::IllegalFunction),
    }
}

/// Calls the function. Returns the length of the answer with its unit id, 0 for none.
///
/// # Errors
///
/// The exception of the function.
pub(super) fn call<M: DataModel>(
    model: &mut M,
    frame: &mut Adu,
    request_len: u8,
) -> Result<u8, Exception> {
    let [_, pdu @ .., _, _] = frame;
    let code = pdu[0];
    let run = match find::<M>(code) {
        Some(row) => row.run,
        None => match M::DEFAULT {
            Some(default) => default,
            None => return Ok(0),
        },
    };
    let answered = run(model, pdu, usize::from(request_len.saturating_sub(1)));
    // The frame keeps the function code of the request, whatever is in the buffer now.
    pdu[0] = match answered {
        Ok(1..=PDU_MAX) => pdu[0],
        _ => code,
    };
    match answered? {
        0 => Ok(0),
        len if len <= PDU_MAX => Ok(len as u8 + 1),
        // An answer that fits no frame is a failure of the application, of which the client is told.
        _ => Err(Exception::ServerDeviceFailure),
    }
}

/// The answer of a function that was executed when the frame stood: its result, the exception, or nothing to a
/// broadcast.
pub(super) fn answer(frame: &mut Adu, outcome: Result<u8, Exception>) -> u8 {
    match outcome {
        _ if frame[0] == BROADCAST => 0,
        Ok(len) => len,
        Err(exception) => refuse(frame, exception),
    }
}
