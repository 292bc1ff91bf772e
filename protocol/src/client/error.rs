//! What can be wrong with a request, and with an answer.

use core::fmt;

use crate::exception::Exception;

/// A request that is outside the limits of the standard and is not sent: the caller's fault.
///
/// Displayed it names the field, its value and what would be right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RequestError {
    /// No such unit: 0 is a broadcast, 1..=247 are servers (SER 2.2).
    Unit {
        /// What was asked for.
        unit: u8,
    },
    /// To unit 0, which nobody answers (SER 2.2), with a function that reads: 1..=247 would be right.
    Broadcast {
        /// The function code.
        function: u8,
    },
    /// Items of a block: 1..=`max` can be asked for at once.
    Count {
        /// What was asked for; 65535 stands for more, too.
        count: u16,
        /// The limit of the function.
        max: u16,
    },
    /// A block that would run past address 65535.
    End {
        /// Its first address.
        first: u16,
        /// Its items.
        count: u16,
    },
    /// Function code of a [`Raw`](super::Raw) request: 1..=127 would be right.
    Function {
        /// What was asked for.
        function: u8,
    },
    /// Bytes of data, or of groups: the PDU would be too long, or they are none.
    Data {
        /// How many there are; 65535 stands for more, too.
        len: u16,
        /// The limit of the function.
        max: u16,
    },
    /// Bytes of packed coils: eight coils to a byte, neither more nor fewer.
    Packed {
        /// How many there are.
        len: u16,
        /// How many the coils need.
        needed: u16,
    },
    /// A file number: 1..=65535 would be right (APP 6.14).
    File {
        /// What was asked for.
        file: u16,
    },
    /// A group that would run past record 9999 of its file (APP 6.14).
    Record {
        /// Its first record.
        record: u16,
        /// Its records.
        count: u16,
    },
    /// A code of Read Device Identification: 1..=4 would be right (APP 6.21).
    Code {
        /// What was asked for.
        code: u8,
    },
    /// The memory that the answer is to go to is too small for it.
    Room {
        /// What there is of it.
        room: u16,
        /// What the answer needs.
        needed: u16,
    },
}

impl fmt::Display for RequestError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            RequestError::Unit { unit } => write!(f, "unit is {unit}, must be 0..=247"),
            RequestError::Broadcast { function } => write!(
                f,
                "unit is 0, must be 1..=247: function {function} reads and a broadcast is not answered"
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

/// What a good frame is, if it is not the answer that was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnswerError {
    /// It is from this unit, which was not asked.
    Unit(u8),
    /// It has this function code, which was not asked for.
    Function(u8),
    /// Its length, these bytes of unit id and PDU, is not what the request demands, or not what its own byte count says.
    Length(u8),
    /// Its echo is not that of the request, or a field has a value that it cannot have.
    Content,
    /// The server refused: this is the answer.
    Exception(Exception),
    /// The server refused with a code that the standard does not define: this is the answer.
    UnknownException(u8),
}

impl AnswerError {
    /// Whether the request is answered by this.
    pub const fn is_exception(self) -> bool {
        matches!(
            self,
            AnswerError::Exception(_) | AnswerError::UnknownException(_)
        )
    }
}
