//! The message and the blame of each error of a request.

use multidrop::client::{Blame, ClientError};
use multidrop::managed::Failure;
use multidrop::protocol::client::{AnswerError, Failure as Ended, RequestError};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::port_registers::Status;

/// Each error, what it says, whose it is, and STATUS and ERROR of a port where it ends a transaction.
const ERRORS: &[(ClientError, &str, Blame, Status, u8)] = &[
    (
        ClientError::QueueFull,
        "not sent: more tasks wait for the port than its queue holds",
        Blame::Caller,
        Status::InvalidRequest,
        0,
    ),
    (
        ClientError::NotMaster,
        "not sent: the port is not a master",
        Blame::Caller,
        Status::InvalidRequest,
        0,
    ),
    (
        ClientError::NoSilence,
        "not sent: the line was not silent within the timeout",
        Blame::Wire,
        Status::Timeout,
        0,
    ),
    (
        ClientError::CutOff,
        "sent in part: CTS stayed off, or the transmission did not end",
        Blame::Wire,
        Status::Timeout,
        0,
    ),
    (
        ClientError::Exception(Exception::IllegalDataAddress),
        "exception 02: IllegalDataAddress",
        Blame::Peer,
        Status::Idle,
        2,
    ),
    (
        ClientError::Exception(Exception::GatewayTargetFailedToRespond),
        "exception 0B: GatewayTargetFailedToRespond",
        Blame::Peer,
        Status::Idle,
        0x0B,
    ),
    (
        ClientError::UnknownException(0x7F),
        "exception 7F",
        Blame::Peer,
        Status::Idle,
        0x7F,
    ),
    // No exception has this code, and ERROR would say that there was none.
    (
        ClientError::UnknownException(0),
        "exception 00",
        Blame::Peer,
        Status::WrongFunction,
        0,
    ),
    (
        ClientError::Timeout,
        "no answer",
        Blame::Wire,
        Status::Timeout,
        0,
    ),
    (
        ClientError::WrongUnit(18),
        "no valid answer: unit 18 answered",
        Blame::Peer,
        Status::WrongSlave,
        0,
    ),
    (
        ClientError::WrongFunction(0x0F),
        "no valid answer: function code 0F",
        Blame::Peer,
        Status::WrongFunction,
        0,
    ),
    (
        ClientError::WrongLength(7),
        "no valid answer: wrong length, 7 bytes",
        Blame::Peer,
        Status::Timeout,
        0,
    ),
    (
        ClientError::WrongContent,
        "no valid answer: the content does not match the request",
        Blame::Peer,
        Status::Timeout,
        0,
    ),
];

#[test]
fn each_error_has_its_message_its_blame_and_its_status() {
    let said = |cause: ClientError, says: &str, blame, status, error| {
        assert_eq!(cause.to_string(), says);
        assert_eq!(cause.blame(), blame, "{says}");
        let failure = Failure {
            unit: 17,
            address: 1000,
            cause,
        };
        assert_eq!(
            failure.to_string(),
            format!("slave 17, address 1000: {says}")
        );
        assert_eq!((failure.status(), failure.error()), (status, error));
    };
    for (cause, says, blame, status, error) in ERRORS {
        said(*cause, says, *blame, *status, *error);
    }
    let errors = ReceiveErrors::GAP | ReceiveErrors::CHECK;
    said(
        ClientError::Damaged(errors),
        "no valid answer: gap, CRC or LRC error",
        Blame::Wire,
        Status::WrongCrc,
        0,
    );
    let request = RequestError::Unit { unit: 248 };
    said(
        ClientError::Request(request),
        &format!("not sent: {request}"),
        Blame::Caller,
        Status::InvalidRequest,
        0,
    );
}

#[test]
fn each_end_of_a_wait_gives_its_error() {
    for (ended, error) in [
        (Ended::Timeout, ClientError::Timeout),
        (
            Ended::Damaged(ReceiveErrors::PARITY),
            ClientError::Damaged(ReceiveErrors::PARITY),
        ),
        (
            Ended::Answer(AnswerError::Unit(18)),
            ClientError::WrongUnit(18),
        ),
        (
            Ended::Answer(AnswerError::Function(4)),
            ClientError::WrongFunction(4),
        ),
        (
            Ended::Answer(AnswerError::Length(9)),
            ClientError::WrongLength(9),
        ),
        (
            Ended::Answer(AnswerError::Content),
            ClientError::WrongContent,
        ),
        (
            Ended::Answer(AnswerError::Exception(Exception::Acknowledge)),
            ClientError::Exception(Exception::Acknowledge),
        ),
        (
            Ended::Answer(AnswerError::UnknownException(9)),
            ClientError::UnknownException(9),
        ),
    ] {
        assert_eq!(ClientError::from(ended), error);
    }
    let request = RequestError::File { file: 0 };
    assert_eq!(ClientError::from(request), ClientError::Request(request));
}
