//! The exceptions a server answers with (APP 7).

/// Why a server refused a request. This is data on the wire, not a fault of the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Exception {
    /// The server does not know the function code.
    IllegalFunction = 0x01,
    /// An address of the request does not exist.
    IllegalDataAddress = 0x02,
    /// A quantity, a byte count, the length, or a value is not allowed.
    IllegalDataValue = 0x03,
    /// The operation itself failed.
    ServerDeviceFailure = 0x04,
    /// The request is accepted, but takes a long time.
    Acknowledge = 0x05,
    /// The server is busy with a long operation: send the request again later.
    ServerDeviceBusy = 0x06,
    /// The operation cannot be done now; only older editions of the standard have it.
    NegativeAcknowledge = 0x07,
    /// A record file failed its consistency check.
    MemoryParityError = 0x08,
    /// The gateway has no way to the target.
    GatewayPathUnavailable = 0x0A,
    /// The gateway's target did not answer.
    GatewayTargetFailedToRespond = 0x0B,
}

impl Exception {
    /// The code as it is on the wire.
    #[inline(always)]
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The exception with this code; `None` for a code the standard does not define.
    pub const fn from_code(code: u8) -> Option<Exception> {
        Some(match code {
            0x01 => Exception::IllegalFunction,
            0x02 => Exception::IllegalDataAddress,
            0x03 => Exception::IllegalDataValue,
            0x04 => Exception::ServerDeviceFailure,
            0x05 => Exception::Acknowledge,
            0x06 => Exception::ServerDeviceBusy,
            0x07 => Exception::NegativeAcknowledge,
            0x08 => Exception::MemoryParityError,
            0x0A => Exception::GatewayPathUnavailable,
            0x0B => Exception::GatewayTargetFailedToRespond,
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_there_and_back() {
        let known: [u8; 10] = [1, 2, 3, 4, 5, 6, 7, 8, 0x0A, 0x0B];
        for code in 0..=u8::MAX {
            assert_eq!(
                Exception::from_code(code).map(Exception::code),
                known.contains(&code).then_some(code)
            );
        }
    }
}
