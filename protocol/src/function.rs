//! Function codes and their limits (APP 6).

/// Read Coils (APP 6.1).
pub const READ_COILS: u8 = 0x01;
/// Read Discrete Inputs (APP 6.2).
pub const READ_DISCRETE_INPUTS: u8 = 0x02;
/// Read Holding Registers (APP 6.3).
pub const READ_HOLDING_REGISTERS: u8 = 0x03;
/// Read Input Registers (APP 6.4).
pub const READ_INPUT_REGISTERS: u8 = 0x04;
/// Write Single Coil (APP 6.5).
pub const WRITE_SINGLE_COIL: u8 = 0x05;
/// Write Single Register (APP 6.6).
pub const WRITE_SINGLE_REGISTER: u8 = 0x06;
/// Write Multiple Coils (APP 6.11).
pub const WRITE_MULTIPLE_COILS: u8 = 0x0F;
/// Write Multiple Registers (APP 6.12).
pub const WRITE_MULTIPLE_REGISTERS: u8 = 0x10;

/// Set in the function code of an exception answer (APP 7).
pub const EXCEPTION_BIT: u8 = 0x80;

/// Coils or discrete inputs one request may read, from 1 (APP 6.1, 6.2).
pub const READ_BITS_MAX: u16 = 2000;
/// Registers one request may read, from 1 (APP 6.3, 6.4).
pub const READ_REGISTERS_MAX: u16 = 125;
/// Coils one request may write, from 1 (APP 6.11).
pub const WRITE_COILS_MAX: u16 = 1968;
/// Registers one request may write, from 1 (APP 6.12).
pub const WRITE_REGISTERS_MAX: u16 = 123;

/// What Write Single Coil has to carry for on; off is 0x0000 and everything else is refused (APP 6.5).
pub const COIL_ON: u16 = 0xFF00;
/// See [`COIL_ON`].
pub const COIL_OFF: u16 = 0x0000;

/// Bytes of the longest PDU, function code included (APP 4.1).
pub const PDU_MAX: usize = 253;
