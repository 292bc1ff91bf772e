//! Managed serial ports.
#![no_std]
#![forbid(unsafe_code)]
