//! The errors of a request, and of an answer.

use core::fmt;

use crate::exception::Exception;

/// Why a request is outside the limits of the standard and was not sent. The caller is to blame.
///
/// The message names the field, its value and the values that are accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RequestError {
    /// The unit id is reserved: 0 is a broadcast, 1..=247 are servers (SER 2.2).
    Unit {
        /// The unit id of the request.
        unit: u8,
    },
    /// A function that reads was sent to unit 0, which no server answers (SER 2.2); 1..=247 are accepted.
    Broadcast {
        /// The function code of the request.
        function: u8,
    },
    /// The number of items is not 1..=`max`.
    Count {
        /// The number of items in the request; 65535 stands for more, too.
        count: u16,
        /// The limit of the function.
        max: u16,
    },
    /// The block would run past address 65535.
    End {
        /// The address of the first item.
        first: u16,
        /// The number of items.
        count: u16,
    },
    /// The function code of a [`Raw`](super::Raw) request is not 1..=127.
    Function {
        /// The function code of the request.
        function: u8,
    },
    /// The data, or the groups, are empty or would make the PDU too long.
    Data {
        /// The bytes of the request; 65535 stands for more, too.
        len: u16,
        /// The limit of the function.
        max: u16,
    },
    /// The length of packed coils does not fit their number; there must be exactly one byte for each eight coils.
    Packed {
        /// The bytes of the request.
        len: u16,
        /// The bytes that the coils need.
        needed: u16,
    },
    /// The file number is not 1..=65535 (APP 6.14).
    File {
        /// The file number of the request.
        file: u16,
    },
    /// The group would run past record 9999 of its file (APP 6.14).
    Record {
        /// The number of the first record.
        record: u16,
        /// The number of records.
        count: u16,
    },
    /// The code of Read Device Identification is not 1..=4 (APP 6.21).
    Code {
        /// The code of the request.
        code: u8,
    },
    /// The memory for the answer is too small.
    Room {
        /// The items that there is memory for.
        room: u16,
        /// The items of the answer.
        needed: u16,
    },
}

impl fmt::Display for RequestError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            RequestError::Unit { unit } => write!(f, "unit is {unit}, must be 0..=247"),
            RequestError::Broadcast { function } => write!(
                f,
                "unit is 0, must be 1..=247: function {function} reads, and a broadcast has no answer"
            ),
            RequestError::Count { count, max } => write!(f, "count is {count}, must be 1..={max}"),
            RequestError::End { first, count } => write!(
                f,
                "first is {first}, must be 0..={} for a count of {count}",
                65536 - u32::from(count)
            ),
            RequestError::Function { function } => {
                write!(f, "function is {function}, must be 1..=127")
            }
            RequestError::Data { len, max } => {
                write!(f, "data is {len} bytes, must be at most {max}")
            }
            RequestError::Packed { len, needed } => {
                write!(f, "packed coils are {len} bytes, must be {needed}")
            }
            RequestError::File { file } => write!(f, "file is {file}, must be 1..=65535"),
            RequestError::Record { record, count } => write!(
                f,
                "record is {record} with {count} records, must end at 9999 or before"
            ),
            RequestError::Code { code } => write!(f, "code is {code}, must be 1..=4"),
            RequestError::Room { room, needed } => {
                write!(f, "room is {room}, must be at least {needed}")
            }
        }
    }
}

impl core::error::Error for RequestError {}

/// Why a good frame is not a positive answer to the request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum AnswerError {
    /// The frame is from this unit, to which the request was not sent.
    Unit(u8),
    /// The frame has this function code, which is not that of the request.
    Function(u8),
    /// The length of the frame, this number of bytes of unit id and PDU, does not fit the request, or its own byte
    /// count.
    Length(u8),
    /// The echo in the frame differs from the request, or a field has an impossible value.
    Content,
    /// The server returned an exception, which is the answer.
    Exception(Exception),
    /// The server returned an exception code that the standard does not define, which is the answer.
    UnknownException(u8),
}

impl AnswerError {
    /// Whether this is an exception, which ends the request.
    pub const fn is_exception(self) -> bool {
        matches!(
            self,
            AnswerError::Exception(_) | AnswerError::UnknownException(_)
        )
    }
}
