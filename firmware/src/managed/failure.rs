//! How a transaction that the registers describe ends.

use core::fmt;

use multidrop_protocol::port_registers::Status;

use crate::client::ClientError;

/// DATAOK, or DATAERR.
pub type Outcome = Result<(), Failure>;

/// Why a transaction ended badly: the first of its requests that failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Failure {
    /// The slave.
    pub unit: u8,
    /// Address of the first item of the request.
    pub address: u16,
    /// What went wrong.
    pub cause: ClientError,
}

impl Failure {
    /// STATUS: 0 if the slave refused.
    pub const fn status(&self) -> Status {
        match self.cause {
            ClientError::Exception(_) => Status::Idle,
            // Code 0 is no exception, and ERROR cannot tell it from none.
            ClientError::UnknownException(0) | ClientError::WrongFunction(_) => {
                Status::WrongFunction
            }
            ClientError::UnknownException(_) => Status::Idle,
            ClientError::WrongUnit(_) => Status::WrongSlave,
            ClientError::Damaged(_) => Status::WrongCrc,
            ClientError::Request(_) | ClientError::QueueFull | ClientError::NotMaster => {
                Status::InvalidRequest
            }
            ClientError::NoSilence
            | ClientError::CutOff
            | ClientError::Timeout
            | ClientError::WrongLength(_)
            | ClientError::WrongContent => Status::Timeout,
        }
    }

    /// ERROR: the exception code, 0 if the slave did not refuse.
    pub const fn error(&self) -> u8 {
        match self.cause {
            ClientError::Exception(exception) => exception.code(),
            ClientError::UnknownException(code) => code,
            _ => 0,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Failure {
            unit,
            address,
            cause,
        } = self;
        write!(f, "slave {unit}, address {address}: {cause}")
    }
}

impl core::error::Error for Failure {}
