//! RTU frames, made without the firmware's code.

use crc::{CRC_16_MODBUS, Crc};

/// `body` with its CRC, low byte first (SER 2.5.1.2).
pub fn adu(body: &[u8]) -> Vec<u8> {
    let crc = Crc::<u16>::new(&CRC_16_MODBUS).checksum(body);
    [body, &crc.to_le_bytes()].concat()
}

/// A frame of unit id, function code and two words.
pub fn words(unit: u8, function: u8, first: u16, second: u16) -> Vec<u8> {
    let mut body = vec![unit, function];
    body.extend(first.to_be_bytes());
    body.extend(second.to_be_bytes());
    adu(&body)
}

/// A write of several items as it should be: `data` follows its own length.
pub fn block(unit: u8, function: u8, address: u16, quantity: u16, data: &[u8]) -> Vec<u8> {
    claimed(unit, function, address, quantity, data.len() as u8, data)
}

/// A write of several items with any byte count.
pub fn claimed(
    unit: u8,
    function: u8,
    address: u16,
    quantity: u16,
    count: u8,
    data: &[u8],
) -> Vec<u8> {
    let mut body = vec![unit, function];
    body.extend(address.to_be_bytes());
    body.extend(quantity.to_be_bytes());
    body.push(count);
    body.extend(data);
    adu(&body)
}

/// The exception `code` that answers `function`.
pub fn exception(unit: u8, function: u8, code: u8) -> Vec<u8> {
    adu(&[unit, function | 0x80, code])
}

/// Registers as they are on the wire.
pub fn be(values: &[u16]) -> Vec<u8> {
    values
        .iter()
        .flat_map(|value| value.to_be_bytes())
        .collect()
}

/// The answer that holds `data` after its length.
pub fn data(unit: u8, function: u8, data: &[u8]) -> Vec<u8> {
    adu(&[&[unit, function, data.len() as u8], data].concat())
}
