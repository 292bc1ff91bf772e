//! Where the data of an answer goes.

use multidrop_protocol::data::Registers;

/// Somebody who takes the data behind unit id, function code and byte count of an answer that is as the request demands.
pub(super) trait Take {
    fn take(&mut self, data: &[u8]);
}

/// Where the data of a read goes.
pub(super) enum Destination<'a> {
    /// Registers.
    Registers(&'a mut [u16]),
    /// Coils or discrete inputs.
    Bits(&'a mut [bool]),
    /// The same, eight to a byte.
    Packed(&'a mut [u8]),
}

impl Take for Destination<'_> {
    fn take(&mut self, data: &[u8]) {
        match self {
            Self::Registers(cells) => Registers::new(data).copy_to(cells),
            Self::Bits(cells) => {
                for (eight, &byte) in cells.chunks_mut(8).zip(data) {
                    let mut byte = byte;
                    for cell in eight {
                        *cell = byte & 1 != 0;
                        byte >>= 1;
                    }
                }
            }
            Self::Packed(cells) => {
                for (cell, &byte) in cells.iter_mut().zip(data) {
                    *cell = byte;
                }
            }
        }
    }
}
