//! CRC-16/MODBUS: polynomial 0xA001 (reflected), start value 0xFFFF, sent low byte first (SER 6.2.2).
//!
//! Two ways to the same sum. With a table of 512 bytes a step is one look-up; on AVR, where every table is copied to RAM, the
//! table is computed instead of stored.

/// The sum before the first byte.
pub const INIT: u16 = 0xFFFF;

/// The sum after one more byte, in the way that suits the target.
///
/// The sum over a frame including its two check bytes is 0 when the frame is whole.
#[inline(always)]
pub fn update(crc: u16, byte: u8) -> u16 {
    #[cfg(target_arch = "avr")]
    return table_free::update(crc, byte);
    #[cfg(not(target_arch = "avr"))]
    return table::update(crc, byte);
}

/// The sum over a whole run of bytes, as it stands in a frame once it is sent low byte first.
pub fn checksum(bytes: &[u8]) -> u16 {
    let mut crc = INIT;
    for &byte in bytes {
        crc = update(crc, byte);
    }
    crc
}

/// The step without a table.
pub mod table_free {
    /// The sum after one more byte.
    ///
    /// An entry of the table for this polynomial is `(a << 6) ^ (a << 7)`, and 0xC001 on top where `a` has an odd number of
    /// ones. An 8-bit CPU has that in about the time of a look-up, a bit-by-bit loop takes four times as long.
    #[inline(always)]
    pub const fn update(crc: u16, byte: u8) -> u16 {
        let a = crc as u8 ^ byte;
        // Rotation by four is one AVR instruction, a shift by four is two.
        let nibbles = a ^ a.rotate_left(4);
        let pairs = nibbles ^ (nibbles >> 2);
        let parity = pairs ^ (pairs >> 1);
        let a7 = ((a as u16) << 8) >> 1;
        let a6 = a7 >> 1;
        let sum = (crc >> 8) ^ a7 ^ a6;
        if parity & 1 != 0 { sum ^ 0xC001 } else { sum }
    }
}

/// The step by the table of the `crc` crate.
#[cfg(not(target_arch = "avr"))]
pub mod table {
    use crc::{CRC_16_MODBUS, Crc, Table};

    static MODBUS: Crc<u16, Table<1>> = Crc::<u16, Table<1>>::new(&CRC_16_MODBUS);

    /// The sum after one more byte.
    #[inline(always)]
    pub fn update(crc: u16, byte: u8) -> u16 {
        // The crate reflects the value it starts from; reflected twice it is ours again, and the compiler drops both.
        let mut digest = MODBUS.digest_with_initial(crc.reverse_bits());
        digest.update(&[byte]);
        digest.finalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_steps_agree_on_every_sum_and_byte() {
        for crc in 0..=u16::MAX {
            for byte in 0..=u8::MAX {
                assert_eq!(
                    table_free::update(crc, byte),
                    table::update(crc, byte),
                    "{crc:04X} {byte:02X}"
                );
            }
        }
    }

    #[test]
    fn check_value_of_the_catalogue() {
        assert_eq!(checksum(b"123456789"), 0x4B37);
    }

    #[test]
    fn residue_is_zero() {
        let sum = checksum(b"123456789").to_le_bytes();
        let whole = b"123456789"
            .iter()
            .chain(&sum)
            .fold(INIT, |crc, &byte| update(crc, byte));
        assert_eq!(whole, 0);
    }
}
