//! Options of a build, taken from environment variables: `MULTIDROP_UNIT=2 cargo build --release`, or
//! `cargo xtask build nano demo-unit --unit 2`, which sets them.

use multidrop::protocol::format::{Framing, LineFormat};

/// The unit id: `MULTIDROP_UNIT`, or `default`.
pub const fn unit(default: u32) -> u32 {
    number(option_env!("MULTIDROP_UNIT"), default)
}

/// The items in each table: `MULTIDROP_COUNT`, 1..=128, or `default`.
pub const fn count(default: usize) -> usize {
    let count = number(option_env!("MULTIDROP_COUNT"), default as u32);
    assert!(
        count >= 1 && count <= 128,
        "MULTIDROP_COUNT must be 1..=128"
    );
    count as usize
}

/// The baud rate: `MULTIDROP_BAUD`, or `default`.
pub const fn baud(default: u32) -> u32 {
    number(option_env!("MULTIDROP_BAUD"), default)
}

/// The character format: `MULTIDROP_FORMAT`, or `default`, or 7E1 for ASCII (SER 2.5.2).
pub const fn format(default: LineFormat) -> LineFormat {
    match option_env!("MULTIDROP_FORMAT") {
        None if ascii() => LineFormat::F7E1,
        None => default,
        Some(name) => match LineFormat::from_name(name) {
            Some(format) => format,
            None => panic!("MULTIDROP_FORMAT must be 8N1, 8E1, 8O1, 8N2, 7E1, 7O1 or 7N2"),
        },
    }
}

/// The CPU clock in Hz: `MULTIDROP_CLOCK`, 8 to 20 MHz, or `default`. For boards such as a Pro Mini with 8 MHz.
pub const fn clock(default: u32) -> u32 {
    let clock = number(option_env!("MULTIDROP_CLOCK"), default);
    assert!(
        clock >= 8_000_000 && clock <= 20_000_000,
        "MULTIDROP_CLOCK must be 8000000..=20000000"
    );
    clock
}

/// Whether the watchdog is used: not if `MULTIDROP_BOOTLOADER` is `old`.
pub const fn watchdog() -> bool {
    match option_env!("MULTIDROP_BOOTLOADER") {
        None => true,
        Some(name) => match name.as_bytes() {
            b"none" | b"new" => true,
            b"old" => false,
            _ => panic!("MULTIDROP_BOOTLOADER must be none, new or old"),
        },
    }
}

/// Whether `MULTIDROP_ASCII` is `1`: ASCII framing instead of RTU, for the applications that can be built for both.
pub const fn ascii() -> bool {
    match option_env!("MULTIDROP_ASCII") {
        None => false,
        Some(value) => match value.as_bytes() {
            b"1" => true,
            _ => panic!("MULTIDROP_ASCII must be 1 or not be set"),
        },
    }
}

/// The framing by [`ascii`].
pub const fn framing() -> Framing {
    if ascii() {
        Framing::Ascii
    } else {
        Framing::Rtu
    }
}

const fn number(text: Option<&str>, default: u32) -> u32 {
    let Some(text) = text else { return default };
    match u32::from_str_radix(text, 10) {
        Ok(number) => number,
        Err(_) => panic!("MULTIDROP_UNIT, _COUNT, _BAUD and _CLOCK must be decimal numbers"),
    }
}
