//! How a request can end but well.

use core::fmt;

use multidrop_protocol::client::{AnswerError, Failure, RequestError};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::rtu::ReceiveErrors;

/// Why there is no answer to a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClientError {
    /// The request is outside the limits of the standard; nothing was sent.
    Request(RequestError),
    /// More tasks ask than the `N` of the port; nothing was sent.
    QueueFull,
    /// The [managed port](crate::managed) is not master; nothing was sent.
    NotMaster,
    /// The line was not silent for as long as the timeout; nothing was sent.
    NoSilence,
    /// The request has begun to go out and was cut off: the peer's CTS did not let it be sent for
    /// [CTS_TIMEOUT](crate::line::LineConfig::cts_timeout_ms), or the transmitter did not come to its end.
    CutOff,
    /// The server refused. Data on the wire, not a fault.
    Exception(Exception),
    /// The server refused with a code that the standard does not define.
    UnknownException(u8),
    /// Nothing was heard.
    Timeout,
    /// Nothing better was heard than the answer of this unit, which was not asked.
    WrongUnit(u8),
    /// Nothing better was heard than an answer with this function code, which was not asked for.
    WrongFunction(u8),
    /// Nothing better was heard than an answer of this length (unit id and PDU), which is not that of the
    /// answer asked for.
    WrongLength(u8),
    /// Nothing better was heard than an answer whose echo or fixed fields are not those of the request.
    WrongContent,
    /// Nothing better was heard than a damaged frame.
    Damaged(ReceiveErrors),
}

/// Who could do something about an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blame {
    /// The program that asked.
    Caller,
    /// The server.
    Peer,
    /// The bus, or a server that is not there.
    Wire,
}

impl ClientError {
    /// Whose fault it is.
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
            Self::QueueFull => f.write_str("not sent: more tasks ask than the port is for"),
            Self::NotMaster => f.write_str("not sent: the port is not master"),
            Self::NoSilence => f.write_str("not sent: the line was not silent"),
            Self::CutOff => f.write_str("not sent to its end: no CTS, or no end of it"),
            Self::Exception(exception) => {
                write!(f, "exception {:02X}: {exception:?}", exception.code())
            }
            Self::UnknownException(code) => write!(f, "exception {code:02X}"),
            Self::Timeout => f.write_str("no answer"),
            Self::WrongUnit(unit) => write!(f, "no answer but from unit {unit}"),
            Self::WrongFunction(function) => {
                write!(f, "no answer but with function {function:02X}")
            }
            Self::WrongLength(len) => write!(f, "no answer but of {len} bytes"),
            Self::WrongContent => f.write_str("no answer but to another request"),
            Self::Damaged(errors) => write!(f, "no answer but damaged ({errors:?})"),
        }
    }
}

impl core::error::Error for ClientError {}
