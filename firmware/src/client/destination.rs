//! The destinations of the data of an answer.

use multidrop_protocol::data::Registers;

/// Takes the data of a valid answer: the bytes behind unit id, function code and byte count.
pub(super) trait Take {
    fn take(&mut self, data: &[u8]);
}

/// The destination of the data of a read.
pub(super) enum Destination<'a> {
    /// One element for each register.
    Registers(&'a mut [u16]),
    /// One element for each coil or discrete input.
    Bits(&'a mut [bool]),
    /// One bit for each coil or discrete input, eight to a byte.
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
