//! Modbus on a serial line.
#![no_std]
#![forbid(unsafe_code)]
