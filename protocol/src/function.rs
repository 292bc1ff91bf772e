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
/// Read Exception Status (APP 6.7).
pub const READ_EXCEPTION_STATUS: u8 = 0x07;
/// Diagnostics (APP 6.8).
pub const DIAGNOSTICS: u8 = 0x08;
/// Get Comm Event Counter (APP 6.9).
pub const GET_COMM_EVENT_COUNTER: u8 = 0x0B;
/// Get Comm Event Log (APP 6.10).
pub const GET_COMM_EVENT_LOG: u8 = 0x0C;
/// Write Multiple Coils (APP 6.11).
pub const WRITE_MULTIPLE_COILS: u8 = 0x0F;
/// Write Multiple Registers (APP 6.12).
pub const WRITE_MULTIPLE_REGISTERS: u8 = 0x10;
/// Report Server ID (APP 6.13).
pub const REPORT_SERVER_ID: u8 = 0x11;
/// Read File Record (APP 6.14).
pub const READ_FILE_RECORD: u8 = 0x14;
/// Write File Record (APP 6.15).
pub const WRITE_FILE_RECORD: u8 = 0x15;
/// Mask Write Register (APP 6.16).
pub const MASK_WRITE_REGISTER: u8 = 0x16;
/// Read/Write Multiple Registers (APP 6.17).
pub const READ_WRITE_REGISTERS: u8 = 0x17;
/// Read FIFO Queue (APP 6.18).
pub const READ_FIFO_QUEUE: u8 = 0x18;
/// Encapsulated Interface Transport (APP 6.19). A serial line uses its MEI type [`READ_DEVICE_ID`].
pub const ENCAPSULATED_INTERFACE: u8 = 0x2B;
/// Read Device Identification, an MEI type of [`ENCAPSULATED_INTERFACE`] (APP 6.21).
pub const READ_DEVICE_ID: u8 = 0x0E;

/// The bit of the function code that marks an exception answer (APP 7).
pub const EXCEPTION_BIT: u8 = 0x80;

/// Coils or discrete inputs one request may read, from 1 (APP 6.1, 6.2).
pub const READ_BITS_MAX: u16 = 2000;
/// Registers one request may read, from 1 (APP 6.3, 6.4).
pub const READ_REGISTERS_MAX: u16 = 125;
/// Coils one request may write, from 1 (APP 6.11).
pub const WRITE_COILS_MAX: u16 = 1968;
/// Registers one request may write, from 1 (APP 6.12).
pub const WRITE_REGISTERS_MAX: u16 = 123;
/// Registers that one Read/Write Multiple Registers may write, from 1; it reads up to [`READ_REGISTERS_MAX`] (APP 6.17).
pub const READ_WRITE_REGISTERS_MAX: u16 = 121;
/// Registers that a FIFO queue may hold to be read, from 0 (APP 6.18).
pub const FIFO_MAX: u16 = 31;
/// The last record number of a file (APP 6.14).
pub const RECORD_MAX: u16 = 9999;
/// The reference type of a file record, the only one in the standard (APP 6.14).
pub const REFERENCE_TYPE: u8 = 0x06;
/// Events that an answer to Get Comm Event Log may hold (APP 6.10).
pub const EVENTS_MAX: usize = 64;

/// The value that switches a coil on in Write Single Coil; [`COIL_OFF`] is the only other one allowed (APP 6.5).
pub const COIL_ON: u16 = 0xFF00;
/// The value that switches a coil off in Write Single Coil (APP 6.5).
pub const COIL_OFF: u16 = 0x0000;

/// Bytes of the longest PDU, function code included (APP 4.1).
pub const PDU_MAX: usize = 253;
