//! The result of a transaction.

use core::fmt;

use multidrop_protocol::port_registers::Status;

use crate::client::ClientError;

/// The result of a transaction: DATAOK, or DATAERR.
pub type Outcome = Result<(), Failure>;

/// Why a transaction failed: the first of its requests that failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Failure {
    /// The unit id of the slave.
    pub unit: u8,
    /// The address of the first item of that request.
    pub address: u16,
    /// The error of that request.
    pub cause: ClientError,
}

impl Failure {
    /// The value of STATUS; 0 if the slave returned an exception.
    pub const fn status(&self) -> Status {
        match self.cause {
            ClientError::Exception(_) => Status::Idle,
            // Code 0 is no exception, and ERROR cannot distinguish it from none.
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

    /// The value of ERROR: the exception code, 0 if the slave returned none.
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
