//! Functions that the application adds.

use super::{Plan, refuse};
use crate::exception::Exception;
use crate::function::{EXCEPTION_BIT, PDU_MAX};
use crate::{Adu, BROADCAST};

/// A function of the application.
///
/// Given the model, a PDU buffer of 253 bytes and the length of the request in it; `pdu[0]` is the function code. It leaves
/// the answer in the same place and returns its length, function code included; 0 says nothing. It runs when the frame
/// stands, so it may change the model; it has to check everything before it does.
///
/// # Errors
///
/// The exception to answer with.
pub type Function<M> = fn(model: &mut M, pdu: &mut [u8], len: usize) -> Result<usize, Exception>;

/// A row of the table of functions.
pub struct ApplicationFunction<M> {
    /// The function code, 1..=127 and none of the server's own; a row for another code is never reached.
    pub code: u8,
    /// Whether it is executed when it is broadcast. It is not answered then.
    pub broadcast: bool,
    /// What it does.
    pub run: Function<M>,
}

/// The functions a server has besides its own eight.
///
/// Function codes 00 and 80..=FF are always answered with exception 01 (APP 4.1).
pub struct Functions<M: 'static> {
    table: &'static [ApplicationFunction<M>],
    default: Option<Function<M>>,
}

impl<M> Functions<M> {
    /// None: an unknown function is answered with exception 01.
    pub const fn standard() -> Functions<M> {
        Functions {
            table: &[],
            default: None,
        }
    }

    /// With these.
    pub const fn with_table(self, table: &'static [ApplicationFunction<M>]) -> Functions<M> {
        Functions { table, ..self }
    }

    /// With this for every function code that is in no table. It is not executed when broadcast.
    pub const fn with_default(self, default: Function<M>) -> Functions<M> {
        Functions {
            default: Some(default),
            ..self
        }
    }

    fn find(&self, code: u8) -> Option<&'static ApplicationFunction<M>> {
        self.table.iter().find(|row| row.code == code)
    }

    /// [`Plan::Call`] if there is something to call.
    pub(super) fn prepare(&self, code: u8, broadcast: bool) -> Result<Plan, Exception> {
        if code == 0 || code & EXCEPTION_BIT != 0 {
            return Err(Exception::IllegalFunction);
        }
        match self.find(code) {
            Some(row) if broadcast && !row.broadcast => Ok(Plan::Ignore),
            Some(_) => Ok(Plan::Call),
            None if self.default.is_some() && !broadcast => Ok(Plan::Call),
            None => Err(Exception::IllegalFunction),
        }
    }

    /// Runs the function; returns the length of the answer, 0 for none.
    pub(super) fn call(&self, model: &mut M, frame: &mut Adu, request_len: u8) -> u8 {
        let [unit, pdu @ .., _, _] = frame;
        let code = pdu[0];
        let run = match self.find(code) {
            Some(row) => row.run,
            None => match self.default {
                Some(default) => default,
                None => return 0,
            },
        };
        let answered = run(model, pdu, usize::from(request_len.saturating_sub(1)));
        if *unit == BROADCAST {
            return 0;
        }
        let exception = match answered {
            Ok(0) => return 0,
            Ok(len) if len <= PDU_MAX => return len as u8 + 1,
            // An answer that fits no frame is the application's failure, to be seen by the client.
            Ok(_) => Exception::ServerDeviceFailure,
            Err(exception) => exception,
        };
        pdu[0] = code;
        refuse(frame, exception)
    }
}
