//! The errors of a client's request.

use core::fmt;

use multidrop_protocol::client::{AnswerError, Failure, RequestError};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::frame::ReceiveErrors;

/// Why a request has no valid answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ClientError {
    /// The request is outside the limits of the standard; nothing was sent.
    Request(RequestError),
    /// More tasks have requests than the `N` of the port; nothing was sent.
    QueueFull,
    /// The [managed port](crate::managed) is not master; nothing was sent.
    NotMaster,
    /// The line was not silent for t3.5 within the timeout; nothing was sent.
    NoSilence,
    /// The request was sent in part: CTS stayed off for longer than
    /// [CTS_TIMEOUT](crate::line::LineConfig::cts_timeout_ms), or the transmitter did not reach the end of the frame.
    CutOff,
    /// The server returned an exception. This is data on the wire, not a fault.
    Exception(Exception),
    /// The server returned an exception code that the standard does not define.
    UnknownException(u8),
    /// No character was received within the timeout.
    Timeout,
    /// No valid answer: an answer of this unit was received, which is not the unit of the request.
    WrongUnit(u8),
    /// No valid answer: an answer with this function code was received, which is not that of the request.
    WrongFunction(u8),
    /// No valid answer: an answer of this length (unit id and PDU) was received, which does not fit the request.
    WrongLength(u8),
    /// No valid answer: an answer was received whose echo or fixed fields differ from the request.
    WrongContent,
    /// No valid answer: a damaged frame was received.
    Damaged(ReceiveErrors),
}

/// The party that can remove the cause of an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Blame {
    /// The program that made the request.
    Caller,
    /// The server, which was reached.
    Peer,
    /// The bus, or a server that is not there.
    Wire,
}

impl ClientError {
    /// The party that is to blame for this error.
    pub const fn blame(self) -> Blame {
        match self {
            Self::Request(_) | Self::QueueFull | Self::NotMaster => Blame::Caller,
            Self::Exception(_)
            | Self::UnknownException(_)
            | Self::WrongUnit(_)
            | Self::WrongFunction(_)
            | Self::WrongLength(_)
            | Self::WrongContent => Blame::Peer,
            Self::NoSilence | Self::CutOff | Self::Timeout | Self::Damaged(_) => Blame::Wire,
        }
    }
}

impl From<RequestError> for ClientError {
    fn from(error: RequestError) -> Self {
        Self::Request(error)
    }
}

impl From<Failure> for ClientError {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::Timeout => Self::Timeout,
            Failure::Answer(error) => error.into(),
            Failure::Damaged(errors) => Self::Damaged(errors),
        }
    }
}

impl From<AnswerError> for ClientError {
    fn from(error: AnswerError) -> Self {
        match error {
            AnswerError::Unit(unit) => Self::WrongUnit(unit),
            AnswerError::Function(function) => Self::WrongFunction(function),
            AnswerError::Length(len) => Self::WrongLength(len),
            AnswerError::Content => Self::WrongContent,
            AnswerError::Exception(exception) => Self::Exception(exception),
            AnswerError::UnknownException(code) => Self::UnknownException(code),
        }
    }
}

impl fmt::Display for ClientError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Request(error) => write!(f, "not sent: {error}"),
            Self::QueueFull => {
                f.write_str("not sent: more tasks wait for the port than its queue holds")
            }
            Self::NotMaster => f.write_str("not sent: the port is not a master"),
            Self::NoSilence => f.write_str("not sent: the line was not silent within the timeout"),
            Self::CutOff => {
                f.write_str("sent in part: CTS stayed off, or the transmission did not end")
            }
            Self::Exception(exception) => {
                write!(f, "exception {:02X}: {exception:?}", exception.code())
            }
            Self::UnknownException(code) => write!(f, "exception {code:02X}"),
            Self::Timeout => f.write_str("no answer"),
            Self::WrongUnit(unit) => write!(f, "no valid answer: unit {unit} answered"),
            Self::WrongFunction(function) => {
                write!(f, "no valid answer: function code {function:02X}")
            }
            Self::WrongLength(len) => write!(f, "no valid answer: wrong length, {len} bytes"),
            Self::WrongContent => {
                f.write_str("no valid answer: the content does not match the request")
            }
            Self::Damaged(errors) => write!(f, "no valid answer: {errors}"),
        }
    }
}

impl core::error::Error for ClientError {}
